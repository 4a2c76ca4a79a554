//! Retrials: a candidate that erred more is tried again, behind the incumbent, before it is refused.
//!
//! The reference may have come to a stretch that costs anybody more. Where the incumbent still decides four fifths of the command or more that
//! is the likelier cause, and where the candidate's part in the commands cannot explain the errors it is the only one.

/// Retrials before a verdict on a level above a small share counts.
const RETRIALS: u32 = 2;
/// Retrials before one on a small share counts.
const RETRIALS_AT_SMALL_SHARE: u32 = 4;
/// Levels below this one are a small share: 20 % and less.
const SMALL_SHARE_BELOW: usize = 3;
/// Retrials, besides, for errors that its part in the commands cannot explain.
const MOST_UNBLAMED: u32 = 3;

/// Retrials that a candidate has had.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Retrials {
    blamed: u32,
    unblamed: u32,
}

impl Retrials {
    /// Grants another one, or none, for a verdict on a level whose errors the candidate's share explains.
    ///
    /// # Real-time
    /// May run in the tick.
    pub(crate) fn grant_explained(&mut self, level: usize) -> bool {
        let most = if level < SMALL_SHARE_BELOW { RETRIALS_AT_SMALL_SHARE } else { RETRIALS };
        let granted = self.blamed < most;
        self.blamed += u32::from(granted);
        granted
    }

    /// Grants another one, or none, for a verdict on a level whose errors the candidate's share does not explain.
    ///
    /// # Real-time
    /// May run in the tick.
    pub(crate) fn grant_unexplained(&mut self, level: usize) -> bool {
        if self.unblamed < MOST_UNBLAMED {
            self.unblamed += 1;
            return true;
        }
        self.grant_explained(level)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_third_verdict_counts_the_fifth_on_a_small_share_and_what_is_not_explained_comes_on_top() {
        let granted = |grant: fn(&mut Retrials, usize) -> bool, level| {
            let mut retrials = Retrials::default();
            (0..100).take_while(|_| grant(&mut retrials, level)).count()
        };
        assert_eq!([4, 0].map(|level| granted(Retrials::grant_explained, level)), [2, 4]);
        assert_eq!([4, 0].map(|level| granted(Retrials::grant_unexplained, level)), [5, 7]);
    }
}
