//! The paper's reward (§III-A4, Table IV).
//!
//! ```text
//! r = k Σ_{j=0…5} w_j Σ_c f_c h_c(|g_{τ+j,c} − o_{τ+j,c}|)       pressures in kPa
//! h_c(e) = e up to e_c, and a tenth of what is beyond
//! ```
//!
//! `o_τ` is measured, `o_{τ+1} …` are MPObs. On a rig whose sensors are late `g` is what they show of chambers on the goals
//! ([`model::shown_reference`]): pay for readings on the goals would teach to drive the chambers ahead. `k` and the channels'
//! `f_c` are 1 in the paper, `e_c` is endless. The tenth keeps a reason to come back from far away. Without MPObs only what is
//! measured can be paid for; its weight is then the sum of all, so that rewards of both kinds compare.

use model::observation::{AHEAD, Pair};

use crate::settings::RewardSettings;

/// Share that counts of an error beyond the limit.
const BEYOND: f64 = 0.1;

/// The reward of being where the measurement says, with the predictions that there are.
pub fn reward(
    settings: &RewardSettings,
    goals_kpa: &[Pair],
    measured_kpa: Pair,
    predicted_kpa: Option<&[Pair; AHEAD]>,
) -> f64 {
    let error_price = |goal: Option<&Pair>, at: Pair| -> f64 {
        let Some(goal) = goal else { return 0.0 };
        let channels = settings.channels.iter().zip(settings.most_kpa);
        let counted = |error: f64, most: f64| error.min(most) + BEYOND * (error - most).max(0.0);
        goal.iter().zip(at).zip(channels).map(|((g, o), (f, most))| f * counted((g - o).abs(), most)).sum()
    };
    let weight = |j: usize| if j == AHEAD { settings.last } else { settings.between };
    let sum = match predicted_kpa {
        Some(predicted) => {
            let ahead =
                predicted.iter().enumerate().map(|(j, at)| weight(j + 1) * error_price(goals_kpa.get(j + 1), *at));
            settings.now * error_price(goals_kpa.first(), measured_kpa) + ahead.sum::<f64>()
        }
        None => {
            let all = settings.now + (1..=AHEAD).map(weight).sum::<f64>();
            all * error_price(goals_kpa.first(), measured_kpa)
        }
    };
    settings.scale * sum
}

/// The price of a correction (contract 2): of an action's first two numbers, each within −1 … 1.
pub fn correction_price(settings: &RewardSettings, action: &[f32]) -> f64 {
    let price: f64 = action.iter().zip(settings.correction).map(|(a, price)| price * f64::from(*a).powi(2)).sum();
    settings.scale * price
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_beyond_the_limit_cost_a_tenth() {
        let settings = RewardSettings { most_kpa: [5.0, 2.0], ..RewardSettings::default() };
        let goals = [[90.0, -70.0]; AHEAD + 1];
        let r = reward(&settings, &goals, [40.0, -30.0], None);
        assert!((r + 0.59 * (5.0 + 0.1 * 45.0 + 2.0 + 0.1 * 38.0)).abs() < 1e-12, "{r}");
    }

    #[test]
    fn is_the_papers_sum() {
        let goals = [[90.0, -70.0]; AHEAD + 1];
        let predicted = std::array::from_fn(|j| [90.0 + j as f64, -70.0]);
        let r = reward(&RewardSettings::default(), &goals, [88.0, -71.0], Some(&predicted));
        // −0.3·(2+1) − 0.01·(0+1+2+3) − 0.25·4
        assert!((r - (-0.9 - 0.06 - 1.0)).abs() < 1e-12, "{r}");
        let r = reward(&RewardSettings::default(), &goals, [88.0, -71.0], None);
        assert!((r + 0.59 * 3.0).abs() < 1e-12, "{r}");
    }
}
