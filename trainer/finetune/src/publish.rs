//! Policies go out: with their plan fitted, their provenance, written aside and renamed into the watched folder.

use std::path::PathBuf;
use std::sync::mpsc::{RecvTimeoutError, channel};

use model::rig::Rig;
use proto::atomic_file;
use training::settings::Plan;
use training::trained_policy::Origin;
use training::{RunFiles, TrainedPolicy, TrainingError};

use crate::FinetuneError;
use crate::callback::FinetuneCallback;
use crate::checkpoint::Position;
use crate::run::{FinetuneRun, LOOK};
use crate::settings::PublishedPlan;

impl FinetuneRun {
    pub(crate) fn is_to_be_published(&self) -> bool {
        let Position { steps, published_at, .. } = self.position;
        steps > published_at && steps.is_multiple_of(self.settings.publish_every_steps)
    }

    /// Publishes the policy as it stands, with the spread of its distribution for exploring on with it; `false` where the
    /// callback wants to stop first.
    pub(crate) fn publish(&mut self, callback: &mut dyn FinetuneCallback) -> Result<bool, FinetuneError> {
        // What follows takes seconds: whoever stops in them goes on from here.
        self.keep()?;
        let Some(model) = self.transitions.model().cloned() else { return Ok(true) };
        let policy = self.policy(&model)?;
        let (sender, receiver) = channel();
        let plans = (self.training.policy.plan, self.settings.plan);
        std::thread::spawn(move || {
            let fitted = match plans {
                (Plan::Learned, _) => policy.with_spread_on(&model),
                (Plan::Fitted, PublishedPlan::Held) => Ok(policy.with_held_plan()),
                (Plan::Fitted, PublishedPlan::Fitted) => policy.with_plan_fitted_on(&model),
            };
            // Nobody is left to take it where the run was stopped meanwhile.
            let _ = sender.send(fitted);
        });
        let policy = loop {
            match receiver.recv_timeout(LOOK) {
                Ok(policy) => break policy?,
                Err(RecvTimeoutError::Timeout) if callback.stop() => return Ok(false),
                Err(RecvTimeoutError::Timeout) => self.tell(callback, "fitting the plan"),
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(TrainingError::learner("plan", &"the thread that fits it has failed").into());
                }
            }
        };
        let bytes = policy.to_onnx(&self.provenance())?;
        RunFiles::write(&self.files.policy(), &policy.to_bytes()?)?;
        RunFiles::write(&self.files.onnx(), &bytes)?;
        let path = self.published_path();
        atomic_file::write(&path, &bytes)?;
        self.position.published += 1;
        self.position.published_at = self.position.steps;
        self.last_published = path.file_name().map(|name| name.to_string_lossy().into_owned());
        callback.say(&format!("published {}", path.display()));
        self.keep()?;
        Ok(true)
    }

    fn policy(&self, model: &Rig) -> Result<TrainedPolicy, FinetuneError> {
        let network = self.average.get().cloned().unwrap_or_else(|| self.learner.policy());
        let mut settings = self.training.clone();
        settings.rig.trained_on.clone_from(&model.name);
        Ok(TrainedPolicy::new(settings, Origin::of(model)?, self.position.steps, network))
    }

    fn published_path(&self) -> PathBuf {
        self.settings.publish.join(format!("{}-{:06}.onnx", self.settings.name, self.position.steps))
    }

    /// Where a published policy comes from, beside what every policy says.
    fn provenance(&self) -> Vec<(String, String)> {
        let settings = &self.settings;
        [
            ("method", "finetune".to_owned()),
            ("from_crc32c", settings.from_crc32c.clone()),
            ("updates", self.position.updates.to_string()),
            ("updates_per_tick", settings.updates_per_tick.to_string()),
            ("lambda_temporal", settings.lambda_at(self.position.steps).to_string()),
            ("last_recording", self.transitions.recording()),
        ]
        .map(|(key, value)| (key.to_owned(), value))
        .into()
    }
}
