//! Reference, policy, model and exploration of the daemon while a flight is made: a flight says something of one controller
//! on one reference, so it counts only where nobody changes any of them on the way.

use std::path::Path;

use proto::recording::TickRecord;

use crate::AdaptError;
use crate::daemon::{Daemon, DaemonStatus, FALLBACK};
use crate::programs::Console;
use crate::run::Adaptation;

/// Mark that the daemon puts behind a name that it cuts off.
const CUT_OFF: char = '…';

/// Stage of a policy that controls, as recordings have it; any other is a candidate's.
const INCUMBENT: u8 = 0;

/// Part of what is in force that may be changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Part {
    Reference,
    Policy,
    Model,
    Exploration,
}

/// Change between two answers of the daemon, in words.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Change {
    pub(crate) part: Part,
    pub(crate) words: String,
}

/// First difference between what is in force at the beginning of a flight and now; nothing where there is none. The reference first: it is
/// what an operator changes most easily, and what the figures are of.
pub(crate) fn change(then: &DaemonStatus, now: &DaemonStatus) -> Option<Change> {
    if then.reference != now.reference {
        let words = format!(
            "the reference was changed by somebody else (it is {}, no longer {})",
            now.reference, then.reference
        );
        return Some(Change { part: Part::Reference, words });
    }
    let named = |name: &str, sha256: &str| match sha256.get(..8) {
        Some(begins) => format!("{name} ({begins}…)"),
        None => name.to_owned(),
    };
    let replaced = |what: &str, then: String, now: String| {
        format!("the {what} was changed by somebody else (it is {now}, no longer {then})")
    };
    if (&then.model, &then.model_sha256) != (&now.model, &now.model_sha256) {
        let words = replaced("model", named(&then.model, &then.model_sha256), named(&now.model, &now.model_sha256));
        return Some(Change { part: Part::Model, words });
    }
    if (&then.policy, &then.policy_sha256) != (&now.policy, &now.policy_sha256) {
        let words =
            replaced("policy", named(&then.policy, &then.policy_sha256), named(&now.policy, &now.policy_sha256));
        return Some(Change { part: Part::Policy, words });
    }
    (then.exploration != now.exploration).then(|| Change {
        part: Part::Exploration,
        words: format!("exploration was switched {} by somebody else", now.exploration.as_str()),
    })
}

/// Largest share of the command that a policy on its way to take over had in these ticks; nothing where none had any. No
/// answer to `status` tells of it before that policy has all of the command.
fn share_of_candidate(ticks: &[TickRecord]) -> Option<f64> {
    let shares = ticks.iter().filter(|tick| tick.policy_stage != INCUMBENT && tick.authority > 0.0);
    shares.map(|tick| tick.authority).reduce(f64::max)
}

/// Checks that no other policy had a share of the command in the ticks of a flight.
///
/// # Errors
/// [`AdaptError::Changed`] where one had.
pub(crate) fn of_one_controller(ticks: &[TickRecord], flown: &str) -> Result<(), AdaptError> {
    match share_of_candidate(ticks) {
        None => Ok(()),
        Some(share) => Err(AdaptError::Changed {
            what: format!(
                "another policy was on its way to take over, by somebody else's wish (its share of the command came to {share:.2}),"
            ),
            meanwhile: uncounted(flown),
        }),
    }
}

/// Time of a change in a flight, and what follows from it.
fn uncounted(flown: &str) -> String {
    format!("while `{flown}` was flown: nothing of this flight counts")
}

/// Tells whether a file is the one that the daemon names, which cuts off names that are very long.
pub(crate) fn is_named(path: &Path, followed: &str) -> bool {
    let Ok(path) = std::path::absolute(path) else { return false };
    match followed.strip_suffix(CUT_OFF) {
        Some(begins) => path.to_string_lossy().starts_with(begins),
        // Through a link that has been there since, or is named otherwise.
        None => {
            let followed = Path::new(followed);
            path == followed
                || path.canonicalize().is_ok_and(|path| followed.canonicalize().is_ok_and(|followed| followed == path))
        }
    }
}

impl Daemon {
    /// Tells whether the daemon itself had another policy take over: it sets one aside that is behind the fallback, and refuses one that
    /// fails. What it makes of a policy belongs to how that policy controls.
    fn has_replaced_policy(
        &self,
        then: &DaemonStatus,
        now: &DaemonStatus,
        console: &mut dyn Console,
    ) -> Result<bool, AdaptError> {
        if now.policy == FALLBACK && now.is_set_aside {
            return Ok(true);
        }
        Ok(then.policy != FALLBACK && self.policy(&then.policy, console)?.0 == "refused")
    }
}

impl Adaptation {
    /// Checks that what a flight is made with is still in force; what the daemon itself has put in a policy's place is
    /// taken for it from then on.
    ///
    /// # Errors
    /// [`AdaptError::Changed`] where somebody else has changed it.
    pub(crate) fn still_in_force(
        &self,
        then: &mut DaemonStatus,
        now: &DaemonStatus,
        flown: &str,
        console: &mut dyn Console,
    ) -> Result<(), AdaptError> {
        let Some(Change { part, words }) = change(then, now) else { return Ok(()) };
        if part == Part::Policy && self.daemon.has_replaced_policy(then, now, console)? {
            console.say(&format!("the daemon itself had {} take over from {}", now.policy, then.policy));
            *then = now.clone();
            return Ok(());
        }
        Err(AdaptError::Changed { what: words, meanwhile: uncounted(flown) })
    }

    /// Checks before the daemon is given a reference that it follows the one that this run has given it, or that was
    /// there when this sitting began: another is the operator's, who means it.
    ///
    /// # Errors
    /// [`AdaptError::Changed`] where it follows another.
    pub(crate) fn still_followed(&self, now: &DaemonStatus) -> Result<(), AdaptError> {
        match &self.followed {
            Some(followed) if *followed != now.reference => Err(AdaptError::Changed {
                what: format!(
                    "the reference was changed by somebody else (it is {}, no longer {followed})",
                    now.reference
                ),
                meanwhile: "before this run gave the daemon its next one".to_owned(),
            }),
            _ => Ok(()),
        }
    }

    /// Notes the reference that is followed when a sitting begins. One that is neither of this run nor what the
    /// operator had at first is one that he has put in since.
    pub(crate) fn note_followed(&mut self, now: &DaemonStatus) {
        self.followed = Some(now.reference.clone());
        let Some(before) = &self.journal.before else { return };
        if before.reference == now.reference {
            self.journal.put_in_since = None;
        } else if !self.is_of_this_run(&now.reference) {
            self.journal.put_in_since = Some(now.reference.clone());
        }
    }

    /// Tells whether the daemon follows a file of this run.
    pub(crate) fn is_of_this_run(&self, followed: &str) -> bool {
        is_named(&self.recorded_reference(), followed) || is_named(&self.back_and_forth_file(), followed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::Exploration;
    use crate::journal::Before;
    use crate::programs::Programs;
    use crate::run::GoesOn;
    use crate::settings::AdaptSettings;

    fn status() -> DaemonStatus {
        DaemonStatus {
            state: "run".to_owned(),
            waits_for: String::new(),
            at: (5, 100),
            policy: "default".to_owned(),
            policy_sha256: "aa".repeat(32),
            is_set_aside: false,
            model: "dual_pressure".to_owned(),
            model_sha256: "bb".repeat(32),
            reference: "/out/before/reference.csv".to_owned(),
            exploration: Exploration::Off,
            interventions: 0,
        }
    }

    #[test]
    fn whatever_is_changed_in_a_flight_is_told_by_name() {
        let then = status();
        assert_eq!(change(&then, &DaemonStatus { at: (5, 900), interventions: 7, ..status() }), None, "time passes");
        for (now, part, words) in [
            (
                DaemonStatus { reference: "/o/HOLD.csv".to_owned(), ..status() },
                Part::Reference,
                "it is /o/HOLD.csv, no longer /out/",
            ),
            (
                DaemonStatus { policy: FALLBACK.to_owned(), policy_sha256: String::new(), ..status() },
                Part::Policy,
                "it is fallback, no longer default",
            ),
            (
                DaemonStatus { policy_sha256: "cc".repeat(32), ..status() },
                Part::Policy,
                "default (cccccccc…), no longer default (aaaaaaaa…)",
            ),
            (DaemonStatus { model_sha256: "dd".repeat(32), ..status() }, Part::Model, "dual_pressure (dddddddd…)"),
            (DaemonStatus { exploration: Exploration::On, ..status() }, Part::Exploration, "switched on"),
        ] {
            let found = change(&then, &now).unwrap();
            assert_eq!(found.part, part);
            assert!(found.words.contains(words) && found.words.contains("by somebody else"), "{}", found.words);
        }
    }

    #[test]
    fn a_candidate_with_a_share_of_the_command_is_told_and_one_in_shadow_is_not() {
        let tick = |policy_stage, authority| TickRecord { policy_stage, authority, ..TickRecord::default() };
        // The fallback, the policy that controls, and a candidate that is only computed.
        assert!(of_one_controller(&[tick(0, 0.0), tick(0, 1.0), tick(1, 0.0)], "before").is_ok());
        let told = of_one_controller(&[tick(0, 1.0), tick(2, 0.25), tick(2, 0.5), tick(3, 0.0)], "before").unwrap_err();
        assert!(told.to_string().contains("came to 0.50), while `before` was flown"), "{told}");
    }

    #[test]
    fn a_name_that_the_daemon_cuts_off_is_the_file_that_it_begins_like() {
        let path = Path::new("/out/before/reference.csv");
        assert!(is_named(path, "/out/before/reference.csv") && is_named(path, "/out/befo…"));
        assert!(!is_named(path, "/out/befo") && !is_named(path, "/elsewhere/…") && !is_named(path, "paper"));
    }

    /// An adaptation that began while the daemon followed `operators.csv`.
    fn begun(name: &str) -> Adaptation {
        let folder = std::env::temp_dir().join(format!("adapt-in-force-{}-{name}", std::process::id()));
        std::fs::create_dir_all(folder.join("out/before")).unwrap();
        let config = folder.join("c.toml");
        std::fs::write(&config, "[link]\naddress = \"127.0.0.1:1\"\n").unwrap();
        let programs = Programs { controller: "controller".into(), trainer: "trainer".into() };
        let mut adaptation =
            Adaptation::begin(AdaptSettings::new(config), &folder.join("out"), programs, Box::new(GoesOn)).unwrap();
        let reference = folder.join("operators.csv").display().to_string();
        adaptation.journal.before = Some(Before {
            policy: FALLBACK.to_owned(),
            model: "m".to_owned(),
            reference,
            interventions: 0,
            at: (5, 1),
        });
        adaptation
    }

    #[test]
    fn another_reference_stops_the_next_order_and_is_the_operators_when_the_run_goes_on() {
        let mut adaptation = begun("another");
        let folder = adaptation.out.parent().unwrap().to_owned();
        let follows = |file: &Path| DaemonStatus { reference: file.display().to_string(), ..status() };
        let (operators, hold) = (folder.join("operators.csv"), folder.join("HOLD.csv"));
        adaptation.note_followed(&follows(&operators));
        assert!(adaptation.still_followed(&follows(&operators)).is_ok());
        let told = adaptation.still_followed(&follows(&hold)).unwrap_err().to_string();
        assert!(told.contains("HOLD.csv, no longer ") && told.contains("by somebody else"), "{told}");
        assert_eq!(adaptation.journal.put_in_since, None);
        // The next sitting goes on with it, and puts it back at its end.
        adaptation.note_followed(&follows(&hold));
        assert!(adaptation.still_followed(&follows(&hold)).is_ok());
        assert_eq!(adaptation.journal.put_in_since, Some(hold.display().to_string()));
        std::fs::write(&hold, "time_s,ref_pos_kpa,ref_neg_kpa\n0,85,-72\n").unwrap();
        assert_eq!(adaptation.operators_reference(), hold);
        // A sitting that was killed leaves a reference of the run behind, which is nobody's wish.
        adaptation.note_followed(&follows(&adaptation.back_and_forth_file()));
        assert_eq!(adaptation.operators_reference(), hold);
        adaptation.note_followed(&follows(&operators));
        assert_eq!(adaptation.journal.put_in_since, None);
        std::fs::remove_dir_all(folder).unwrap();
    }
}
