//! Policies go out: with their plan fitted, their provenance, written aside and renamed into the watched folder.

use std::fs::hard_link;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{RecvTimeoutError, channel};

use model::rig::Rig;
use proto::atomic_file::{self, AtomicFileError, AtomicFileStep, HiddenFile};
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
        let named = self.published_path();
        let path = write_new(&named, &bytes)?;
        if path != named {
            callback.say(&format!("{} is another policy, which stays; published beside it", named.display()));
        }
        self.position.published += 1;
        self.position.published_at = self.position.steps;
        self.position.last_published = path.file_name().map(|name| name.to_string_lossy().into_owned());
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
        let (settings, steps) = (&self.settings, self.position.steps);
        settings.publish.join(format!("{}-{}-{steps:06}.onnx", settings.name, settings.run_name()))
    }

    /// Where a published policy comes from, beside what every policy says.
    fn provenance(&self) -> Vec<(String, String)> {
        let settings = &self.settings;
        [
            ("method", "finetune".to_owned()),
            ("from_crc32c", settings.from_crc32c.clone()),
            ("updates", self.position.updates.to_string()),
            ("updates_per_tick", settings.updates_per_tick.to_string()),
            ("lambda_temporal", self.lambda_now().to_string()),
            ("last_recording", self.transitions.recording()),
        ]
        .map(|(key, value)| (key.to_owned(), value))
        .into()
    }
}

/// Writes a policy under a name that nobody has: with `-2`, `-3` … behind it where the name is another policy's, which
/// is never replaced. One that holds these very bytes is this one, published before a run was stopped.
fn write_new(named: &Path, bytes: &[u8]) -> Result<PathBuf, AtomicFileError> {
    let stem = named.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let aside = named.with_file_name(format!(".{stem}.{}.new", std::process::id()));
    let aside = HiddenFile::write(aside, bytes)?;
    let mut number = 1;
    loop {
        let path = match number {
            1 => named.to_owned(),
            _ => named.with_file_name(format!("{stem}-{number}.onnx")),
        };
        // A link, as against a renaming, replaces nothing: not even what another run publishes in this moment.
        match hard_link(aside.path(), &path) {
            Ok(()) => return Ok(path),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {
                if std::fs::read(&path).is_ok_and(|there| there == bytes) {
                    return Ok(path);
                }
                number += 1;
            }
            // A file system without links: nothing better is left than to look first.
            Err(_) if !path.exists() => return atomic_file::write(&path, bytes).map(|()| path),
            Err(source) => return Err(AtomicFileError { path, step: AtomicFileStep::Rename, source }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_another_run_published_stays_and_the_same_policy_is_published_once() {
        let folder = std::env::temp_dir().join(format!("finetune-publish-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let named = folder.join("finetuned-00000000-000300.onnx");
        assert_eq!(write_new(&named, b"one").unwrap(), named);
        assert_eq!(write_new(&named, b"one").unwrap(), named, "gone on with after it was stopped");
        let beside = write_new(&named, b"other").unwrap();
        assert_eq!(beside, folder.join("finetuned-00000000-000300-2.onnx"));
        assert_eq!(std::fs::read(&named).unwrap(), b"one");
        assert_eq!(std::fs::read(&beside).unwrap(), b"other");
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 2, "nothing else is left");
        std::fs::remove_dir_all(folder).unwrap();
    }
}
