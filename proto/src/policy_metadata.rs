//! Keys of a policy file's metadata that more than one program reads or writes, and how their values are written.

use model::observation::{ACTION_LEN, CHANNELS};

/// Standard deviations of a policy's own distribution in the unit of its outputs (duty), in their order: what `trainer export`
/// writes and `controller explore` draws from. Two for a policy that learned the answers for now alone, one for each output of
/// one that learned the plan as well.
pub const EXPLORATION_STD_KEY: &str = "exploration_std";
/// A deviation beyond this is no deviation of a duty, which goes from 0 to 1.
const MOST_STD_DUTY: f64 = 1.0;

/// The value under [`EXPLORATION_STD_KEY`].
pub fn exploration_std_text(std: &[f64]) -> String {
    let numbers: Vec<String> = std.iter().map(|std| format!("{std:.6}")).collect();
    numbers.join(",")
}

/// The deviations that a value states, two or one an output, from 0 to 1 each; `None` where it states none.
pub fn exploration_std(text: &str) -> Option<Vec<f64>> {
    let std: Vec<f64> = text.split(',').map(|number| number.trim().parse().ok()).collect::<Option<_>>()?;
    let is_whole = [CHANNELS, ACTION_LEN].contains(&std.len());
    (is_whole && std.iter().all(|std| (0.0..=MOST_STD_DUTY).contains(std))).then_some(std)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_back_and_nothing_else_is_a_deviation() {
        let of_all: Vec<f64> = (0..ACTION_LEN).map(|i| i as f64 / 100.0).collect();
        for std in [vec![0.0125, 0.02], of_all] {
            assert_eq!(exploration_std(&exploration_std_text(&std)), Some(std));
        }
        assert_eq!(exploration_std(" 0.01 , 0 "), Some(vec![0.01, 0.0]));
        for text in ["", "0.01", "0.01,", "0.01,x", "-0.01,0.02", "0.01,1.5", "NaN,0.01", "0.01,0.02,0.03"] {
            assert_eq!(exploration_std(text), None, "{text}");
        }
    }
}
