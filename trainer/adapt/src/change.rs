//! Steps that ask the daemon for a change and wait for what comes of it.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use model::observation::TICKS_PER_S;
use proto::atomic_file;
use proto::reference::Reference;

use crate::AdaptError;
use crate::daemon::{FALLBACK, LOOK};
use crate::journal::{Before, Verdict};
use crate::programs::Console;
use crate::run::Adaptation;

impl Adaptation {
    /// Asks again and again until there is an answer.
    pub(crate) fn wait_for<T>(
        &self,
        what: &str,
        most: Duration,
        console: &mut dyn Console,
        mut ask: impl FnMut(&Self, &mut dyn Console) -> Result<Option<T>, AdaptError>,
    ) -> Result<T, AdaptError> {
        let began = Instant::now();
        loop {
            if let Some(answer) = ask(self, console)? {
                return Ok(answer);
            }
            if began.elapsed() > most {
                return Err(AdaptError::TooLong { what: what.to_owned(), seconds: most.as_secs() });
            }
            if console.stop() {
                return Err(AdaptError::Stopped);
            }
            console.waiting(what, began.elapsed(), Some(most));
            std::thread::sleep(LOOK);
        }
    }

    /// Has the daemon take the model that was found, if it finds that it foresees no worse.
    pub(crate) fn change_model(&mut self, console: &mut dyn Console) -> Result<(), AdaptError> {
        if self.journal.model_line.is_some() {
            return Ok(());
        }
        let rig = self.found_rig();
        let asked = self.moment(console)?;
        let said = self.daemon.tell(&["model", &rig.to_string_lossy()], console)?;
        self.examined_since(&asked, console)?;
        let line = said.last_line();
        console.say(&line);
        self.journal.model_line = Some(line);
        self.journal.keep(&self.out)
    }

    /// Has a policy that has passed take over, and waits until it does for good: with the command it is on probation at
    /// first, and may lose it again.
    pub(crate) fn swap(&mut self, name: &str, console: &mut dyn Console) -> Result<(), AdaptError> {
        self.in_control(console)?;
        self.taking_over = Some(name.to_owned());
        let taken = self.take_over(name, console);
        // Refused, it does not come; whatever else ended the wait, it may still take over.
        let asked = self.daemon.text(&["swap", name]);
        let is_refused = matches!(&taken, Err(AdaptError::Failed { command, .. }) if *command == asked);
        if taken.is_ok() || is_refused {
            self.taking_over = None;
        }
        taken
    }

    fn take_over(&mut self, name: &str, console: &mut dyn Console) -> Result<(), AdaptError> {
        self.daemon.tell(&["swap", name], console)?;
        let most = Duration::from_secs(self.journal.settings.verdict_seconds);
        let began = Instant::now();
        let controls = |this: &Self, console: &mut dyn Console| -> Result<bool, AdaptError> {
            let controlling = this.in_control(console)?.policy;
            match this.daemon.policy(name, console)? {
                // It was not refused when it was asked for, so it has lost the command since and does not come back.
                (state, why) if state == "refused" => {
                    let command = this.daemon.text(&["swap", name]);
                    Err(AdaptError::Failed { command, said: format!("{name} was refused on the rig ({why})") })
                }
                (state, _) => Ok(controlling == name && state == "active"),
            }
        };
        while !controls(self, console)? {
            self.keep_moving(console)?;
            if began.elapsed() > most {
                let what = format!("{name} does not control");
                return Err(AdaptError::TooLong { what, seconds: most.as_secs() });
            }
            self.pass(&format!("{name} takes over"), began, most, console)?;
        }
        Ok(())
    }

    fn pass(&self, what: &str, began: Instant, most: Duration, console: &mut dyn Console) -> Result<(), AdaptError> {
        if console.stop() {
            return Err(AdaptError::Stopped);
        }
        console.waiting(what, began.elapsed(), Some(most));
        std::thread::sleep(LOOK);
        Ok(())
    }

    /// Has the rig go back and forth along the reference, again where that is over: a policy is judged on a rig that moves, and a jump
    /// to the beginning would tell of nothing but the jump.
    fn keep_moving(&mut self, console: &mut dyn Console) -> Result<(), AdaptError> {
        let status = self.in_control(console)?;
        if status.at.1 > self.moves_until {
            let reference = self.reference()?;
            let file = self.back_and_forth_file();
            atomic_file::write(&file, back_and_forth(&reference).as_bytes())?;
            let (_, start) = self.begin_reference(&file, console)?.at;
            self.moves_until = start.wrapping_add((2.0 * reference.end_s() * TICKS_PER_S) as u32);
        }
        Ok(())
    }

    /// Improves the policy that controlled on the model that was found, or the fallback where that tracks better on it.
    pub(crate) fn train(&mut self, before: &Before, console: &mut dyn Console) -> Result<PathBuf, AdaptError> {
        if let Some(trained) = &self.journal.trained {
            return Ok(trained.clone());
        }
        let (run, policy) = (self.training_folder(), self.trained_policy());
        let text = |path: &Path| path.to_string_lossy().into_owned();
        let arguments = if run.join("checkpoint.bin").exists() {
            vec!["improve".to_owned(), "--resume".to_owned(), text(&run)]
        } else {
            let settings = &self.journal.settings;
            let mut arguments: Vec<String> = ["improve", "--config", "adaptation", "--rig"].map(str::to_owned).into();
            arguments.push(text(&self.found_rig()));
            let from = self.policy_before();
            if before.policy != FALLBACK && from.exists() {
                arguments.extend(["--from".to_owned(), text(&from)]);
            }
            let (rounds, seed) = (settings.train_rounds.to_string(), settings.seed.to_string());
            arguments.extend(["--rounds", &rounds, "--seed", &seed, "--out"].map(str::to_owned));
            arguments.push(text(&run));
            arguments
        };
        let most = Duration::from_secs(self.journal.settings.train_seconds);
        let exported = ["export".to_owned(), text(&run), "--out".to_owned(), text(&policy)];
        self.computed(
            |this, console| {
                // Ended after its time it keeps what it has, and says so with status 0; before anything is scored it has nothing.
                this.daemon.programs.trainer(&arguments).at_most(most).done(console)?;
                if !run.join("policy.bin").exists() {
                    let what =
                        "no policy yet to train on (--resume goes on with it; a new run takes a longer --train-seconds)";
                    return Err(AdaptError::TooLong { what: what.to_owned(), seconds: most.as_secs() });
                }
                this.daemon.programs.trainer(&exported).done(console)
            },
            console,
        )?;
        self.journal.trained = Some(policy.clone());
        self.journal.keep(&self.out)?;
        Ok(policy)
    }

    /// Publishes a policy, lets it go on to the rig once it has passed, and waits for what the daemon makes of it.
    pub(crate) fn publish(&mut self, policy: &Path, console: &mut dyn Console) -> Result<Verdict, AdaptError> {
        if let Some(verdict) = &self.journal.verdict {
            return Ok(verdict.clone());
        }
        let seconds = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        let file = |name: &str| self.folders.policies.join(format!("{name}.onnx"));
        // Another run may have published in the same second; what it published is not replaced.
        let mut names = (seconds..).map(|seconds| format!("adapted-{seconds}"));
        let name = names.find(|name| !file(name).exists()).unwrap_or_default();
        let path = file(&name);
        let bytes = std::fs::read(policy).map_err(|error| AdaptError::file(policy, error))?;
        crate::make_folder(self.folders.policies.clone())?;
        let incumbent = self.in_control(console)?.policy;
        console.command(&format!("cp {} {} (aside, then renamed)", policy.display(), path.display()));
        atomic_file::write(&path, &bytes)?;
        self.journal.published = Some(name.clone());
        self.journal.incumbent = Some(incumbent);
        self.journal.keep(&self.out)?;
        let most = Duration::from_secs(self.journal.settings.verdict_seconds);
        let (began, mut is_asked) = (Instant::now(), false);
        let published = self.moment(console)?;
        let verdict = loop {
            let (state, why) = self.daemon.policy(&name, console)?;
            match state.as_str() {
                "active" | "refused" => {
                    if !is_asked {
                        self.examined_since(&published, console)?;
                    }
                    break Verdict { state, why };
                }
                "passed" if !is_asked => {
                    self.examined_since(&published, console)?;
                    self.daemon.tell(&["swap", &name], console)?;
                    is_asked = true;
                }
                // On the rig it was taken back: by the daemon, or by somebody else.
                "passed" | "gone" | "previous" if is_asked && began.elapsed() > LOOK * 50 => {
                    break Verdict { state: "refused".to_owned(), why: format!("taken back, now {state}") };
                }
                _ => {}
            }
            self.keep_moving(console)?;
            if began.elapsed() > most {
                self.swap_to_incumbent(console)?;
                let why = format!("undecided after {} s", most.as_secs());
                break Verdict { state: "refused".to_owned(), why };
            }
            self.pass(&format!("{name}: {state}"), began, most, console)?;
        };
        self.journal.verdict = Some(verdict.clone());
        self.journal.keep(&self.out)?;
        Ok(verdict)
    }

    /// Waits until another policy controls.
    pub(crate) fn wait_until_policy_is_not(&self, name: &str, console: &mut dyn Console) -> Result<(), AdaptError> {
        let most = Duration::from_secs(self.journal.settings.verdict_seconds);
        self.wait_for("the policy before it takes over", most, console, |this, console| {
            Ok((this.in_control(console)?.policy != name).then_some(()))
        })
    }
}

/// A reference backwards and forwards, in 20 ms rows: it begins where it ends, and can be followed again and again without a jump.
fn back_and_forth(reference: &Reference) -> String {
    let ticks = (reference.end_s() * TICKS_PER_S).ceil() as usize;
    let row = |n: usize| {
        let [pos, neg] = reference.at(ticks.abs_diff(n) as f64 / TICKS_PER_S);
        format!("{:.2},{pos:.4},{neg:.4}\n", n as f64 / TICKS_PER_S)
    };
    std::iter::once("time_s,ref_pos_kpa,ref_neg_kpa\n".to_owned()).chain((0..=2 * ticks).map(row)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::tests::stand_in;
    use crate::judging::tests::{Said, flown_before, forget};

    /// For the half second in which a policy takes over the daemon names the one before it, which is not to be taken for what is
    /// left to control.
    #[test]
    fn what_has_been_asked_to_take_over_is_taken_back() {
        let mut adaptation = flown_before("swapped", "");
        let answers = r#"[ $1 = swap ] && echo $2 >> $here/swapped
            case $1 in
            status) echo '{"state": "run", "status": {"session": 5, "tick": 100}, "running": {"policy": "older"}}';;
            policies) echo '{"policies": [{"name": "fallback", "state": "passed"}]}';;
            esac"#;
        adaptation.daemon.programs = stand_in(&adaptation.out, answers);
        let before = r#"{"policy": "older", "model": "dual_pressure", "interventions": 0, "at": [5, 1]}"#;
        adaptation.journal.before = Some(serde_json::from_str(before).unwrap());
        (adaptation.journal.model_line, adaptation.moves_until) = (Some("taken".to_owned()), 200);
        let swapped = adaptation.out.join("swapped");
        let stopped = adaptation.swap(FALLBACK, &mut Said::stops_behind(swapped.clone()));
        assert!(matches!(stopped, Err(AdaptError::Stopped)), "{stopped:?}");
        assert!(adaptation.put_back(&mut Said::default()));
        let swapped = std::fs::read_to_string(swapped).unwrap();
        assert_eq!(swapped.lines().collect::<Vec<_>>(), [FALLBACK, "older"]);
        forget(&adaptation);
    }

    /// A policy that the daemon refuses on the rig never controls: waiting for it would take the quarter of an hour that a verdict may.
    #[test]
    fn a_policy_that_is_refused_on_the_rig_is_not_waited_for() {
        let mut adaptation = flown_before("refused", "");
        let answers = r#"case $1 in
            status) echo '{"state": "run", "status": {"session": 5, "tick": 100}, "running": {"policy": "fallback"}}';;
            policies) echo '{"policies": [{"name": "older", "state": "refused",
                "refusal": {"stage": "probation", "reason": "duties hunt"}}]}';;
            esac"#;
        adaptation.daemon.programs = stand_in(&adaptation.out, answers);
        let began = Instant::now();
        let said = adaptation.swap("older", &mut Said::default()).unwrap_err().to_string();
        assert!(said.contains("swap older") && said.contains("probation: duties hunt"), "{said}");
        assert!(began.elapsed() < Duration::from_secs(adaptation.journal.settings.verdict_seconds) / 10);
        forget(&adaptation);
    }

    #[test]
    fn a_reference_goes_back_and_forth_without_a_jump() {
        let paper = Reference::paper();
        let moving = Reference::parse("moving", back_and_forth(&paper).as_bytes()).unwrap();
        assert_eq!(moving.end_s(), 120.0);
        for time_s in [0.0, 13.5, 60.0, 77.7, 120.0] {
            let expected = paper.at((60.0_f64 - time_s).abs());
            let found = moving.at(time_s);
            assert!((0..2).all(|c| (found[c] - expected[c]).abs() < 1e-3), "{time_s} s: {found:?} for {expected:?}");
        }
    }
}
