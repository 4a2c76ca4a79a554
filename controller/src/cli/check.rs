//! `controller check` and `controller check-policy`.

use std::path::Path;

use controller::config::Config;
use controller::cycle::Cycle;
use controller::daemon::{self, contracts};
use policy::Policy;
use serde_json::json;

use super::Failure;
use super::console::{say, tell};

pub(super) fn check(file: &Path, as_json: bool) -> Result<(), Failure> {
    let sound = || -> Result<(String, Vec<String>), Failure> {
        let config = Config::read(file)?;
        let loaded = daemon::load(&config)?;
        let (name, mut remarks) = (loaded.rig.name.clone(), loaded.remarks.clone());
        let flies = loaded.policy.as_ref().map_or("the feed-forward PI".to_owned(), |p| p.name().to_owned());
        let summary =
            format!("cRIO {}, model {name}, {flies} flies, reference {}", config.link.address, loaded.reference_name);
        let cycle = Cycle::new(&loaded.rig, loaded.policy, loaded.reference, config.safety, false)
            .map_err(|e| Failure::input(format!("rig {}: {e}", config.rig.file)))?;
        remarks.extend(cycle.duty_source().out_of_reach().map(daemon::out_of_reach_text));
        Ok((summary, remarks))
    };
    answer(
        as_json,
        sound(),
        |(summary, remarks)| {
            for remark in remarks {
                tell(format_args!("{remark}"));
            }
            say(format_args!("{}: sound ({summary})", file.display()));
        },
        |(summary, remarks)| json!({"sound": true, "summary": summary, "remarks": remarks}),
    )
}

pub(super) fn check_policy(file: &Path, as_json: bool) -> Result<(), Failure> {
    let loaded = Policy::load(file, &contracts()).map_err(Failure::input);
    answer(
        as_json,
        loaded,
        |policy| say(format_args!("{}: sound. {}", file.display(), policy.describe())),
        |policy| {
            json!({
                "sound": true,
                "name": policy.name(),
                "contract": policy.contract().version,
                "inputs": policy.inputs(),
                "outputs": policy.outputs(),
                "sha256": policy.hash().to_string(),
                "description": policy.describe(),
            })
        },
    )
}

/// Prints what was found as text or as one JSON object, also where it is bad.
fn answer<T>(
    as_json: bool,
    outcome: Result<T, Failure>,
    text: impl Fn(&T),
    object: impl Fn(&T) -> serde_json::Value,
) -> Result<(), Failure> {
    match &outcome {
        Ok(found) if as_json => say(format_args!("{}", object(found))),
        Ok(found) => text(found),
        Err(failure) if as_json => say(format_args!("{}", json!({"sound": false, "error": failure.line}))),
        Err(_) => {}
    }
    outcome.map(|_| ())
}
