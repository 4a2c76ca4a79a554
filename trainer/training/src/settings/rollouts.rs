//! Settings by which a policy is improved by rollouts ([`crate::rollouts`]).

use serde::{Deserialize, Serialize};

/// Settings by which a policy is improved by rollouts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RolloutSettings {
    /// Rounds: so many times rigs are flown and the policy is moved.
    pub rounds: u64,
    /// Episodes of a round, of eight rigs each.
    pub episodes: u64,
    /// Length of an episode in s, instead of the environment's.
    pub episode_s: f64,
    /// Ticks from one branching to the next, in the mean.
    pub branch_every_ticks: usize,
    /// Ticks over which a branch's answers are shifted. Long enough for a valve to leave its play: a shift of one tick within the
    /// play does nothing one way and stays for good the other way, and what such shifts do does not add up.
    pub shift_ticks: usize,
    /// Ticks for which a branch is flown and paid for.
    pub horizon_ticks: usize,
    /// Largest shift of an answer, as a share of half its range.
    pub shift: f64,
    /// The most that an answer is moved in a round, as a share of half its range.
    pub most_move: f64,
    /// Learning rate of the first round; it falls in a line to a tenth at the last.
    pub learning_rate: f64,
    /// Times that a round's branches are gone through.
    pub epochs: u64,
    /// Errors up to about these (kPa) are paid for by their square, larger ones by themselves.
    pub error_scale_kpa: [f64; 2],
    /// Price of an answer's change from tick to tick, per square of its share of half its range.
    pub change_price: f64,
    /// Step of the simulated rigs in ms, their pumps averaged over a revolution.
    pub averaged_step_ms: f64,
}

impl Default for RolloutSettings {
    fn default() -> Self {
        RolloutSettings {
            rounds: 12,
            episodes: 4,
            episode_s: 30.0,
            branch_every_ticks: 10,
            shift_ticks: 20,
            horizon_ticks: 40,
            shift: 0.03,
            most_move: 0.2,
            learning_rate: 3e-4,
            epochs: 2,
            error_scale_kpa: [0.1, 0.03],
            change_price: 5.0,
            averaged_step_ms: 2.0,
        }
    }
}

impl RolloutSettings {
    /// Checks every number; the text names key, value and range.
    pub(super) fn check(&self) -> Result<(), String> {
        let within = |key: &str, value: f64, low: f64, high: f64| {
            if value.is_finite() && (low..=high).contains(&value) {
                return Ok(());
            }
            Err(format!("rollouts.{key} = {value} is not within {low} … {high}"))
        };
        within("rounds", self.rounds as f64, 1.0, 1e6)?;
        within("episodes", self.episodes as f64, 1.0, 1e4)?;
        within("episode_s", self.episode_s, 5.0, 600.0)?;
        within("branch_every_ticks", self.branch_every_ticks as f64, 1.0, 1e4)?;
        within("shift_ticks", self.shift_ticks as f64, 1.0, 1e3)?;
        within("horizon_ticks", self.horizon_ticks as f64, self.shift_ticks as f64, 1e3)?;
        within("shift", self.shift, 1e-4, 0.5)?;
        within("most_move", self.most_move, 1e-3, 1.0)?;
        within("learning_rate", self.learning_rate, 1e-7, 0.1)?;
        within("epochs", self.epochs as f64, 1.0, 100.0)?;
        for scale_kpa in self.error_scale_kpa {
            within("error_scale_kpa", scale_kpa, 1e-3, 100.0)?;
        }
        within("change_price", self.change_price, 0.0, 1e4)?;
        within("averaged_step_ms", self.averaged_step_ms, 0.5, 10.0)
    }
}
