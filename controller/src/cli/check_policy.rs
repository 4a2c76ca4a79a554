//! `controller check-policy`: a policy through all stages before the rig, and what it does.

use std::path::{Path, PathBuf};

use admission::{Admitted, Examiner, Limits, Refusal, SignatureRule, Stage, Standing};
use clap::Args;
use controller::config::Safety;
use controller::daemon::contracts;
use policy::Links;
use proto::emulator::load_for_loop;
use serde_json::json;

use super::Failure;
use super::console::say;

/// Says what is wrong with a policy, or that it is sound and what it does.
#[derive(Debug, Args)]
pub(crate) struct CheckPolicy {
    /// ONNX file.
    file: PathBuf,
    /// The model that it is tried on: a built-in name (dual_pressure, bench) or a rig file.
    #[arg(long, default_value = "dual_pressure", value_name = "FILE")]
    rig: String,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

impl CheckPolicy {
    pub(super) fn run(self) -> Result<(), Failure> {
        let rig = load_for_loop(&self.rig, Some("--rig")).map_err(Failure::input)?;
        let Safety { max_pos_kpa, min_neg_kpa } = Safety::default();
        let limits = Limits { max_pos_kpa, min_neg_kpa };
        let examiner = Examiner::new(contracts().into(), SignatureRule::None, &rig, limits)
            .map_err(|e| Failure::input(format!("rig {}: {e}", self.rig)))?;
        match examiner.examine(&self.file, Links::Follow, examiner.fallback()) {
            Ok(admitted) => {
                let behind = examiner.standing_of(&admitted.tallies).filter(Standing::is_behind);
                if self.json {
                    say(format_args!("{}", sound_json(&admitted, &rig.name, behind.as_ref())));
                } else {
                    say(format_args!("{}", sound_text(&self.file, &admitted, &rig.name)));
                    if let Some(standing) = behind {
                        say(format_args!("{}", behind_text(&standing, &rig.name)));
                    }
                }
                Ok(())
            }
            Err(refusal) => {
                if self.json {
                    let error = format!("{}: {}", self.file.display(), refusal.reason);
                    say(format_args!(
                        "{}",
                        json!({"sound": false, "stage": refusal.stage, "error": error, "sha256": refusal.sha256, "trial": refusal.figures})
                    ));
                }
                Err(failure(&self.file, &refusal))
            }
        }
    }
}

/// A file that is none is bad input; a policy that is well formed and does harm is a verdict.
fn failure(file: &Path, refusal: &Refusal) -> Failure {
    let line = match refusal.stage {
        Stage::File | Stage::Network => format!("{}: {}", file.display(), refusal.reason),
        stage => {
            format!("{}: not sound (stage {}; file and network are): {}", file.display(), stage.name(), refusal.reason)
        }
    };
    match refusal.stage {
        Stage::File | Stage::Signature | Stage::Network => Failure::input(line),
        _ => Failure::not_good(line),
    }
}

fn sound_text(file: &Path, admitted: &Admitted, rig: &str) -> String {
    let (f, a) = (&admitted.figures, &admitted.answers);
    let [[pos_low, pos_high], [neg_low, neg_high]] = a.range_duty;
    format!(
        "{}: sound. {}\nAnswers: positive valve {pos_low:.3} … {pos_high:.3}, negative {neg_low:.3} … {neg_high:.3} over the range; \
         1 kPa more in its own chamber moves them by {:+.4} and {:+.4}; {:.1} µs an inference.\n\
         Trial around `{rig}`, errors positive/negative: on the model {:.3}/{:.3} kPa (fallback {:.3}/{:.3}); on rigs around it \
         {:.2}/{:.2} times the fallback's, {:.2}/{:.2} on the worst; with worn valves {:.2}/{:.2}. On holds pressures swing by \
         {:.2}/{:.2} kPa and duties change by {:.4}/{:.4} a tick at most (RMS).",
        file.display(),
        admitted.policy.describe(),
        a.per_kpa_duty[0],
        a.per_kpa_duty[1],
        admitted.inference_us,
        f.rmse_kpa[0],
        f.rmse_kpa[1],
        f.fallback_rmse_kpa[0],
        f.fallback_rmse_kpa[1],
        f.ratio[0],
        f.ratio[1],
        f.worst_ratio[0],
        f.worst_ratio[1],
        f.worn_ratio[0],
        f.worn_ratio[1],
        f.swing_kpa[0],
        f.swing_kpa[1],
        f.chatter_duty[0],
        f.chatter_duty[1],
    )
}

/// Sentence on a policy that tracks worse than the fallback on this model, and on the daemon's answer to that.
fn behind_text(standing: &Standing, rig: &str) -> String {
    format!(
        "Behind the fallback on `{rig}`: {standing}. A daemon on this model flies the fallback in its place (policy.when_behind)."
    )
}

fn sound_json(admitted: &Admitted, rig: &str, behind: Option<&Standing>) -> serde_json::Value {
    let policy = &admitted.policy;
    json!({
        "sound": true,
        "name": policy.name(),
        "contract": policy.contract().version,
        "inputs": policy.inputs(),
        "outputs": policy.outputs(),
        "sha256": policy.hash().to_string(),
        "description": policy.describe(),
        "model": rig,
        "answers": admitted.answers,
        "trial": admitted.figures,
        "behind": behind,
        "inference_us": admitted.inference_us,
    })
}

#[cfg(test)]
mod tests {
    use model::rig::Rig;

    use super::*;

    #[test]
    fn a_model_whose_sensor_leaves_the_volts_of_the_wire_is_refused_before_the_policy_is_read() {
        let mut rig = Rig::builtin("bench").unwrap();
        rig.sensors["sensor_neg"].range_v = [0.5, 4.5];
        let path = std::env::temp_dir().join(format!("model-of-half-a-volt-{}.toml", std::process::id()));
        proto::rig_file::save(&path, &rig).unwrap();
        let check = CheckPolicy { file: "none.onnx".into(), rig: path.display().to_string(), json: false };
        let refused = check.run();
        std::fs::remove_file(&path).unwrap();
        let failure = refused.unwrap_err();
        assert_eq!(failure.status(None), 2);
        let beginning = format!("{} (--rig): sensors.sensor_neg.range_v: ", path.display());
        assert!(failure.line.starts_with(&beginning), "{}", failure.line);
    }
}
