//! Keys of a policy file's metadata that more than one program reads or writes, and how their values are written.

/// Standard deviation of a policy's own distribution, two numbers in the unit of its outputs (duty): what
/// `trainer export` writes and `controller explore` draws from.
pub const EXPLORATION_STD_KEY: &str = "exploration_std";
/// A deviation beyond this is no deviation of a duty, which goes from 0 to 1.
const MOST_STD_DUTY: f64 = 1.0;

/// The value under [`EXPLORATION_STD_KEY`] for the positive and the negative valve.
pub fn exploration_std_text([positive, negative]: [f64; 2]) -> String {
    format!("{positive:.6},{negative:.6}")
}

/// The deviations that a value states, from 0 to 1; `None` where it states none.
pub fn exploration_std(text: &str) -> Option<[f64; 2]> {
    let (positive, negative) = text.split_once(',')?;
    let pair = [positive.trim().parse().ok()?, negative.trim().parse().ok()?];
    pair.iter().all(|std| (0.0..=MOST_STD_DUTY).contains(std)).then_some(pair)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_back_and_nothing_else_is_a_deviation() {
        assert_eq!(exploration_std(&exploration_std_text([0.0125, 0.02])), Some([0.0125, 0.02]));
        assert_eq!(exploration_std(" 0.01 , 0 "), Some([0.01, 0.0]));
        for text in ["", "0.01", "0.01,", "0.01,x", "-0.01,0.02", "0.01,1.5", "NaN,0.01", "0.01,0.02,0.03"] {
            assert_eq!(exploration_std(text), None, "{text}");
        }
    }
}
