//! `controller check`.

use std::path::Path;

use controller::config::Config;
use controller::cycle::Cycle;
use controller::daemon;
use controller::machine::machine_check;
use controller::machine::tick_trial::TickTrial;
use controller::reach::Reach;
use controller::state::Arming;
use serde_json::json;

use super::Failure;
use super::console::{say, tell};

/// Findings of a configuration that is sound.
struct Sound {
    summary: String,
    remarks: Vec<String>,
    reach: Option<Reach>,
    trial: TickTrial,
}

pub(super) fn check(file: &Path, as_json: bool) -> Result<(), Failure> {
    let found = answer(
        as_json,
        sound(file),
        |Sound { summary, remarks, reach, trial }| {
            let word = soundness(remarks);
            for remark in remarks {
                tell(format_args!("{remark}"));
            }
            if let Some(reach) = reach {
                say(format_args!("by its model the rig reaches {reach}"));
            }
            if let Some(times) = &trial.times {
                say(format_args!(
                    "a tick takes {:.2} ms here, {:.2} ms in one of 1,000, {:.2} ms at most ({} ticks in lockstep); late after {:.0} ms",
                    times.p50_ms, times.p999_ms, times.max_ms, trial.ticks, trial.deadline_ms
                ));
            }
            if trial.is_good() {
                say(format_args!("{}: {word} ({summary})", file.display()));
            }
        },
        |Sound { summary, remarks, reach, trial }| json!({"sound": trial.is_good(), "summary": summary, "remarks": remarks, "reach": reach, "tick": trial}),
    )?;
    if !found.trial.is_good() {
        let what = match (found.trial.fault, found.trial.bars_arming) {
            (Some(fault), _) => format!("it opened both vents for a fault ({})", fault.name()),
            (None, Some(condition)) => format!("it never came under control: it was not armed ({})", condition.name()),
            (None, None) => "it never came under control".to_owned(),
        };
        return Err(Failure::not_good(format!(
            "{}: not good: simulated on its own model for 20 s, {what}; `controller demo` with this reference shows why",
            file.display()
        )));
    }
    Ok(())
}

/// Words of the last line: what was remarked may be no more than a network that is off, and is not looked past.
fn soundness(remarks: &[String]) -> &'static str {
    if remarks.is_empty() { "sound" } else { "sound but for what is remarked above" }
}

fn sound(file: &Path) -> Result<Sound, Failure> {
    let config = Config::read(file)?;
    let mut remarks = machine_check::check(&config).map_err(Failure::input)?;
    let loaded = daemon::load(&config)?;
    remarks.extend(loaded.remarks.iter().cloned());
    let name = loaded.rig.name.clone();
    let runs = loaded.policy.as_ref().map_or("the feed-forward PI".to_owned(), |p| p.name().to_owned());
    let summary =
        format!("cRIO {}, model {name}, {runs} runs, reference {}", config.link.address, loaded.reference_name);
    let cycle = Cycle::new(&loaded.rig, loaded.policy, loaded.reference, config.safety, Arming::Manual)
        .map_err(|e| Failure::input(format!("rig {}: {e}", config.rig.file)))?;
    let tracking = cycle.duty_source().tracking();
    remarks.extend(tracking.beyond_reach());
    let reach = tracking.reach();
    // Read once more, for the trial uses up what it runs.
    let trial = TickTrial::run(&config, daemon::load(&config)?).map_err(Failure::work)?;
    if let Some(times) = trial.times.filter(|times| times.p999_ms > 0.5 * trial.deadline_ms) {
        remarks.push(format!(
            "one tick in 1,000 takes {:.1} ms of {:.0}: too slow a machine for this model; `controller rt-test` tells more",
            times.p999_ms, trial.deadline_ms
        ));
    }
    Ok(Sound { summary, remarks, reach, trial })
}

/// Prints what was found as text or as one JSON object, also where it is bad.
fn answer<T>(
    as_json: bool,
    outcome: Result<T, Failure>,
    text: impl Fn(&T),
    object: impl Fn(&T) -> serde_json::Value,
) -> Result<T, Failure> {
    match &outcome {
        Ok(found) if as_json => say(format_args!("{}", object(found))),
        Ok(found) => text(found),
        Err(failure) if as_json => say(format_args!("{}", json!({"sound": false, "error": failure.line}))),
        Err(_) => {}
    }
    outcome
}
