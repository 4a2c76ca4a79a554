//! Steps that ask the daemon for a change, wait for what comes of it, and put back what was.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use proto::atomic_file;
use proto::reference::Reference;

use crate::AdaptError;
use crate::daemon::{FALLBACK, LOOK};
use crate::journal::{Before, Verdict};
use crate::programs::Console;
use crate::recorded;
use crate::rig_time::TICKS_PER_S;
use crate::run::{Adaptation, FALLBACK_ON_MODEL, WITH_MODEL};
use crate::tracking::Tracking;

/// Time in which a tick must follow another, in lockstep on a busy machine as well.
const STILL: Duration = Duration::from_secs(20);
/// Time in which a recording must hold what was flown: it is flushed once a second.
const FLUSHED: Duration = Duration::from_secs(10);
/// Shortest run for a figure, in s.
const SHORTEST_S: f64 = 20.0;

/// How the daemon is asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Asking {
    /// As a step that a person sees.
    AsAStep,
    /// Beside a step that is under way.
    Silently,
}

impl Adaptation {
    /// Begins the reference anew, waits for its end, and works out how well it was tracked.
    pub(crate) fn fly(&mut self, what: &str, console: &mut dyn Console) -> Result<Tracking, AdaptError> {
        if let Some(tracking) = self.journal.flown(what) {
            return Ok(tracking);
        }
        self.in_control(console)?;
        let file = self.before_folder().join("reference.csv");
        let (session, start) = self.begin_reference(&file, Asking::AsAStep, console)?;
        let end = start.wrapping_add((self.fly_s()? * TICKS_PER_S) as u32);
        self.moves_until = end;
        self.wait_for_tick(session, end, console)?;
        let missing = "the recording of a run";
        let ticks = self.wait_for(missing, FLUSHED, console, |this, _| {
            let ticks = recorded::between(&this.folders.recordings, session, start..end)?;
            Ok(ticks.last().is_some_and(|last| last.tick.wrapping_add(1) >= end).then_some(ticks))
        })?;
        let vented = || AdaptError::NotRunning { state: "vented on the way".into(), waits_for: String::new() };
        let tracking = Tracking::of(&ticks).ok_or_else(vented)?;
        let [pos, neg] = tracking.rmse_kpa;
        console.say(&format!("{what}: {pos:.3}/{neg:.3} kPa"));
        self.note_flown(what, tracking, console)?;
        Ok(tracking)
    }

    pub(crate) fn fly_s(&self) -> Result<f64, AdaptError> {
        Ok(self.reference()?.end_s().max(SHORTEST_S).min(self.journal.settings.fly_seconds.max(SHORTEST_S)))
    }

    /// Has the daemon follow a reference from its beginning; session and tick from then on.
    fn begin_reference(
        &mut self,
        file: &Path,
        asking: Asking,
        console: &mut dyn Console,
    ) -> Result<(u32, u32), AdaptError> {
        let file = file.to_string_lossy();
        match asking {
            Asking::AsAStep => self.daemon.tell(&["reference", &file], console)?,
            Asking::Silently => self.daemon.try_silently(&["reference", &file], console)?,
        };
        let status = self.daemon.status(console)?;
        if !status.is_running() {
            return Err(status.not_running());
        }
        Ok(status.at)
    }

    fn wait_for_tick(&self, session: u32, end: u32, console: &mut dyn Console) -> Result<(), AdaptError> {
        let (mut last, mut moved) = (0, Instant::now());
        loop {
            let status = self.daemon.status(console)?;
            if !status.is_running() || status.at.0 != session {
                return Err(status.not_running());
            }
            if status.at.1 >= end {
                return Ok(());
            }
            if status.at.1 != last {
                (last, moved) = (status.at.1, Instant::now());
            }
            if moved.elapsed() > STILL {
                return Err(AdaptError::TooLong { what: "no tick".to_owned(), seconds: STILL.as_secs() });
            }
            if console.stop() {
                return Err(AdaptError::Stopped);
            }
            let left_s = f64::from(end.wrapping_sub(status.at.1)) / TICKS_PER_S;
            console.waiting(&format!("running, {left_s:.0} s of the rig left"), Duration::ZERO, None);
            std::thread::sleep(LOOK);
        }
    }

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

    /// Runs along the reference on the new model: of the fallback, which uses all of it, and of the policy that controlled before, if
    /// by the daemon's own trial it is sound there. What tracked best controls on, in words and figures.
    pub(crate) fn fly_on_the_model(
        &mut self,
        before: &Before,
        console: &mut dyn Console,
    ) -> Result<(&'static str, Tracking), AdaptError> {
        if before.policy == FALLBACK {
            return Ok((WITH_MODEL, self.fly(WITH_MODEL, console)?));
        }
        if self.journal.flown(FALLBACK_ON_MODEL).is_none() && self.in_control(console)?.policy != FALLBACK {
            self.swap(FALLBACK, console)?;
        }
        let fallback = self.fly(FALLBACK_ON_MODEL, console)?;
        if !self.is_sound_on_the_model(console)? {
            return Ok((FALLBACK_ON_MODEL, fallback));
        }
        if self.journal.flown(WITH_MODEL).is_none() {
            self.swap(&before.policy, console)?;
        }
        let policy = self.fly(WITH_MODEL, console)?;
        if policy.over(&fallback) <= 1.0 {
            return Ok((WITH_MODEL, policy));
        }
        self.swap(FALLBACK, console)?;
        Ok((FALLBACK_ON_MODEL, fallback))
    }

    /// Whether the policy that controlled before passes the daemon's trial on the model that was found: without a minute of the rig.
    fn is_sound_on_the_model(&mut self, console: &mut dyn Console) -> Result<bool, AdaptError> {
        let policy = self.before_folder().join("policy.onnx");
        if !policy.exists() {
            return Ok(false);
        }
        let rig = self.journal.found.clone().unwrap_or_default().join("rig.toml");
        let arguments = ["check-policy".as_ref(), policy.as_os_str(), "--rig".as_ref(), rig.as_os_str()];
        let said = self.computed(|this, console| this.daemon.programs.controller(arguments).run(console), console)?;
        if said.status != Some(0) {
            console.say(&said.last_line());
        }
        Ok(said.status == Some(0))
    }

    /// Has a policy that has passed take over, and waits until it does.
    fn swap(&mut self, name: &str, console: &mut dyn Console) -> Result<(), AdaptError> {
        self.in_control(console)?;
        self.daemon.tell(&["swap", name], console)?;
        let most = Duration::from_secs(self.journal.settings.verdict_seconds);
        let began = Instant::now();
        while self.in_control(console)?.policy != name {
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
            let file = self.out.join("back-and-forth.csv");
            atomic_file::write(&file, back_and_forth(&reference).as_bytes())?;
            let (_, start) = self.begin_reference(&file, Asking::Silently, console)?;
            self.moves_until = start.wrapping_add((2.0 * reference.end_s() * TICKS_PER_S) as u32);
        }
        Ok(())
    }

    /// Improves the policy that controlled on the model that was found, or the fallback where that tracks better on it.
    pub(crate) fn train(&mut self, before: &Before, console: &mut dyn Console) -> Result<PathBuf, AdaptError> {
        if let Some(trained) = &self.journal.trained {
            return Ok(trained.clone());
        }
        let (run, policy) = (self.out.join("run"), self.out.join("adapted.onnx"));
        let text = |path: &Path| path.to_string_lossy().into_owned();
        let arguments = if run.join("checkpoint.bin").exists() {
            vec!["improve".to_owned(), "--resume".to_owned(), text(&run)]
        } else {
            let settings = &self.journal.settings;
            let rig = self.journal.found.clone().unwrap_or_default().join("rig.toml");
            let mut arguments: Vec<String> = ["improve", "--config", "adaptation", "--rig"].map(str::to_owned).into();
            arguments.push(text(&rig));
            let from = self.before_folder().join("policy.onnx");
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
                // Ended after its time it keeps what it has, and says so with status 0.
                this.daemon.programs.trainer(&arguments).at_most(most).done(console)?;
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
        let name = format!("adapted-{seconds}");
        let path = self.folders.policies.join(format!("{name}.onnx"));
        let bytes = std::fs::read(policy).map_err(|error| AdaptError::file(policy, error))?;
        crate::make_folder(self.folders.policies.clone())?;
        console.command(&format!("cp {} {} (aside, then renamed)", policy.display(), path.display()));
        atomic_file::write(&path, &bytes)?;
        self.journal.published = Some(name.clone());
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
                self.daemon.tell(&["rollback"], console)?;
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

    /// Puts model and policy back, as far as they were changed; whether all is as it was. What cannot be put back is told: a
    /// daemon keeps a model that foresees what it has just seen better than the one before.
    pub(crate) fn restore(&mut self, console: &mut dyn Console) -> bool {
        let mut console = Unstoppable(console);
        let Some(before) = self.journal.before.clone() else { return true };
        let is_changed = self.journal.model_line.is_some() || self.journal.published.is_some();
        let mut is_restored = true;
        let mut back = Vec::new();
        if is_changed && self.daemon.status(&mut console).is_ok_and(|status| status.policy != before.policy) {
            back.push(vec!["swap".to_owned(), before.policy.clone()]);
        }
        if self.journal.model_line.is_some() {
            let model = self.before_folder().join("model.toml");
            back.push(vec!["model".to_owned(), model.to_string_lossy().into_owned()]);
        }
        for arguments in back {
            let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
            let why = match self.daemon.try_to(&arguments, &mut console) {
                Ok(said) if said.status == Some(0) => continue,
                Ok(said) => said.last_line(),
                Err(error) => error.to_string(),
            };
            console.say(&format!("not put back: {why}"));
            is_restored = false;
        }
        if is_restored {
            self.journal.forget_changes();
        }
        if let Err(error) = self.journal.keep(&self.out) {
            console.say(&error.to_string());
        }
        is_restored
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

/// A console that goes on to the end of what must be done.
struct Unstoppable<'a>(&'a mut dyn Console);

impl Console for Unstoppable<'_> {
    fn step(&mut self, number: usize, of: usize, what: &str) {
        self.0.step(number, of, what);
    }
    fn command(&mut self, command: &str) {
        self.0.command(command);
    }
    fn say(&mut self, text: &str) {
        self.0.say(text);
    }
    fn waiting(&mut self, what: &str, elapsed: Duration, most: Option<Duration>) {
        self.0.waiting(what, elapsed, most);
    }
    fn stop(&self) -> bool {
        false
    }
    fn ask(&mut self, _question: &str) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
