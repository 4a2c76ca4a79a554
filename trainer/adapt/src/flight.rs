//! Runs along the reference: each begun anew, watched, ended early where it is worse than what was there, and put in
//! figures. What a step gets of one are its figures where it is sound: flown to its end, and not worse than what it was held
//! against.

use std::ops::Range;
use std::path::Path;
use std::time::{Duration, Instant};

use model::observation::TICKS_PER_S;

use crate::AdaptError;
use crate::daemon::{DaemonStatus, Exploration, FALLBACK, LOOK};
use crate::guard::{WorseWindow, squares_by_second, worse_window};
use crate::in_force::{is_named, of_one_controller};
use crate::journal::{BEFORE, Before, Flown, TickSpan};
use crate::judging::{late_squares, told};
use crate::programs::Console;
use crate::recorded::{self, FlightTicks};
use crate::run::{Adaptation, FALLBACK_ON_MODEL, WITH_MODEL};
use crate::tracking::Tracking;
use crate::yardstick::Yardstick;

/// Time in which a tick must follow another, in lockstep on a busy machine as well.
const STILL: Duration = Duration::from_secs(20);
/// Time in which a recording must hold what was flown: it is flushed once a second.
const FLUSHED: Duration = Duration::from_secs(10);
/// Shortest run along a reference that is shorter, in s: diagnosis takes 20 s and more that it can begin in.
const SHORTEST_S: f64 = 30.0;

/// Squares of what was there, second by second, and the yardstick of both.
struct HeldAgainst<'a> {
    there: &'a [Option<f64>],
    yardstick: &'a Yardstick,
}

impl Adaptation {
    /// Runs along the reference before anything is changed.
    pub(crate) fn fly_before(&mut self, console: &mut dyn Console) -> Result<Tracking, AdaptError> {
        self.fly(BEFORE, &[], console)?;
        self.journal
            .flown(BEFORE)
            .ok_or_else(|| AdaptError::NotRunning { state: "vented on the way".to_owned(), waits_for: String::new() })
    }

    /// Begins the reference anew, waits for its end, and works out how well it was tracked. Ended early where it tracks
    /// worse than the run of the name `against`.
    pub(crate) fn fly_against(
        &mut self,
        what: &str,
        against: &str,
        console: &mut dyn Console,
    ) -> Result<Option<Tracking>, AdaptError> {
        let there = self.journal.flight(against).map(Flown::judged_squares).unwrap_or_default();
        self.fly(what, &there, console)
    }

    fn fly(
        &mut self,
        what: &str,
        there: &[Option<f64>],
        console: &mut dyn Console,
    ) -> Result<Option<Tracking>, AdaptError> {
        if let Some(flown) = self.journal.flight(what) {
            return Ok(flown.sound());
        }
        self.in_control(console)?;
        let yardstick = self.yardstick()?;
        let file = self.recorded_reference();
        let begun = self.begin_reference(&file, console)?;
        if begun.exploration == Exploration::On {
            return Err(AdaptError::Explores { flown: what.to_owned() });
        }
        let (session, start) = begun.at;
        let end = start.wrapping_add((self.fly_s()? * TICKS_PER_S) as u32);
        self.moves_until = end;
        let mut following = FlightTicks::new(&self.folders.recordings, session, start..end);
        let against = HeldAgainst { there, yardstick: &yardstick };
        let until = self.watch(what, begun, start..end, &mut following, &against, console)?;
        let missing = "the recording of a run";
        let ticks = self.wait_for(missing, FLUSHED, console, |this, _| {
            let ticks = recorded::between(&this.folders.recordings, session, start..until)?;
            Ok(ticks.last().is_some_and(|last| last.tick.wrapping_add(1) >= until).then_some(ticks))
        })?;
        // What the recording lost since the last look, or where nothing was looked at, is told as well.
        following.so_far()?;
        following.take_notes().iter().for_each(|note| console.say(note));
        of_one_controller(&ticks, what)?;
        let vented = || AdaptError::NotRunning { state: "vented on the way".into(), waits_for: String::new() };
        let mut flown = Flown {
            what: what.to_owned(),
            tracking: Tracking::of(&ticks, &yardstick).ok_or_else(vented)?,
            rig_minutes: self.rig_minutes(console)?,
            recorded: Some(TickSpan { session, start, until }),
            ended_after_s: None,
            squares: squares_by_second(&ticks, start, &Yardstick::default()),
            late_squares: late_squares(&ticks, start, &yardstick),
        };
        console.say(&format!("{what}: {}", told(&flown.tracking)));
        if let Some(WorseWindow { flown_kpa, there_kpa }) = worse_window(&flown.judged_squares(), there) {
            let flown_s = f64::from(until.wrapping_sub(start)) / TICKS_PER_S;
            let when = if until == end { "at its end" } else { "and is ended" };
            console.say(&format!(
                "{what}: after {flown_s:.0} s it errs by {flown_kpa:.3} kPa where what was there errs by {there_kpa:.3} (both channels together): it tracks worse, {when}"
            ));
            flown.ended_after_s = Some(flown_s);
        }
        let sound = flown.sound();
        self.journal.flown.push(flown);
        self.journal.keep(&self.out)?;
        Ok(sound)
    }

    pub(crate) fn fly_s(&self) -> Result<f64, AdaptError> {
        Ok(self.reference()?.end_s().max(SHORTEST_S).min(self.journal.settings.fly_seconds))
    }

    /// Has the daemon follow a reference from its beginning, unless the operator has given it another meanwhile; its
    /// state from then on.
    pub(crate) fn begin_reference(
        &mut self,
        file: &Path,
        console: &mut dyn Console,
    ) -> Result<DaemonStatus, AdaptError> {
        self.tell_of_reference(console);
        let status = self.daemon.status(console)?;
        self.still_followed(&status)?;
        self.daemon.tell(&["reference", &file.to_string_lossy()], console)?;
        let status = self.daemon.status(console)?;
        // In the moment between the two somebody else may have given it another.
        if !is_named(file, &status.reference) {
            self.followed = Some(file.display().to_string());
            self.still_followed(&status)?;
        }
        self.followed = Some(status.reference.clone());
        if !status.is_running() {
            return Err(status.not_running());
        }
        Ok(status)
    }

    /// Waits for the end of a flight that was begun in this state; the tick behind its last, which is earlier where it tracks worse
    /// than what was there.
    fn watch(
        &self,
        what: &str,
        begun: DaemonStatus,
        flight: Range<u32>,
        ticks: &mut FlightTicks,
        HeldAgainst { there, yardstick }: &HeldAgainst<'_>,
        console: &mut dyn Console,
    ) -> Result<u32, AdaptError> {
        let (mut last, mut moved) = (0, Instant::now());
        let mut begun = begun;
        loop {
            let status = self.daemon.status(console)?;
            if !status.is_running() || status.at.0 != begun.at.0 {
                return Err(status.not_running());
            }
            // Also behind the last tick: the change may have come before it.
            self.still_in_force(&mut begun, &status, what, console)?;
            if status.at.1 >= flight.end {
                return Ok(flight.end);
            }
            if !there.is_empty() {
                let so_far = ticks.so_far()?;
                let recorded = so_far.iter().take_while(|tick| tick.tick < status.at.1).count();
                let so_far = so_far.get(..recorded).unwrap_or_default();
                let is_worse = worse_window(&squares_by_second(so_far, flight.start, yardstick), there).is_some();
                let ended = so_far.last().filter(|_| is_worse).map(|last| last.tick.wrapping_add(1));
                ticks.take_notes().iter().for_each(|note| console.say(note));
                if let Some(ended) = ended {
                    return Ok(ended);
                }
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
            let left_s = f64::from(flight.end.wrapping_sub(status.at.1)) / TICKS_PER_S;
            console.waiting(&format!("running, {left_s:.0} s of the rig left"), Duration::ZERO, None);
            std::thread::sleep(LOOK);
        }
    }

    /// Runs along the reference on the new model: of the policy that controlled before, if by the daemon's own trial it
    /// is sound there, and of the fallback, which uses all of the model. What tracked best controls on, in words and
    /// figures; nothing where each tracked worse than what was there.
    pub(crate) fn fly_on_the_model(
        &mut self,
        before: &Before,
        console: &mut dyn Console,
    ) -> Result<Option<(&'static str, Tracking)>, AdaptError> {
        if before.policy == FALLBACK {
            return Ok(self.fly_against(WITH_MODEL, BEFORE, console)?.map(|tracking| (WITH_MODEL, tracking)));
        }
        // The policy first: it controls already, and is nearer to what was there than the fallback.
        let policy = match self.journal.flight(WITH_MODEL).map(Flown::sound) {
            Some(sound) => sound,
            None if self.is_sound_on_the_model(console)? => {
                self.let_control(&before.policy, console)?;
                self.fly_against(WITH_MODEL, BEFORE, console)?
            }
            None => None,
        };
        if self.journal.flight(FALLBACK_ON_MODEL).is_none() {
            self.let_control(FALLBACK, console)?;
        }
        let against = if policy.is_some() { WITH_MODEL } else { BEFORE };
        let fallback = self.fly_against(FALLBACK_ON_MODEL, against, console)?;
        match (policy, fallback) {
            (Some(policy), fallback) if fallback.is_none_or(|fallback| policy.over(&fallback) <= 1.0) => {
                self.let_control(&before.policy, console)?;
                Ok(Some((WITH_MODEL, policy)))
            }
            (_, Some(fallback)) => {
                self.let_control(FALLBACK, console)?;
                Ok(Some((FALLBACK_ON_MODEL, fallback)))
            }
            (_, None) => Ok(None),
        }
    }

    /// Has a policy take over unless it controls already.
    fn let_control(&mut self, policy: &str, console: &mut dyn Console) -> Result<(), AdaptError> {
        if self.in_control(console)?.policy == policy { Ok(()) } else { self.swap(policy, console) }
    }

    /// Says whether the policy that controlled before passes the daemon's trial on the model that was found: without a
    /// minute of the rig.
    fn is_sound_on_the_model(&mut self, console: &mut dyn Console) -> Result<bool, AdaptError> {
        let policy = self.policy_before();
        if !policy.exists() {
            return Ok(false);
        }
        let rig = self.found_rig();
        let arguments = ["check-policy".as_ref(), policy.as_os_str(), "--rig".as_ref(), rig.as_os_str()];
        let said = self.computed(|this, console| this.daemon.programs.controller(arguments).run(console), console)?;
        if said.status != Some(0) {
            console.say(&said.last_line());
        }
        Ok(said.status == Some(0))
    }
}
