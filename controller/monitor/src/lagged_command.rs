//! A command as a slow valve would follow it: two ticks late, then a first-order lag.
//!
//! Least known to a model is how fast a command becomes a flow: delays on the way, the coil, the armature. So the model
//! is run twice, under the command as sent and under this one; a reading between both forecasts contradicts neither.

use model::observation::Pair;

/// Delay in ticks (chosen: one of the wire and one to spare).
const DELAY_TICKS: usize = 2;
/// Share of the way that is made in a tick: a time constant of 80 ms (chosen: the slowest valve of this size, half as much
/// again as the rig `bench` has).
const SHARE: f64 = 0.22;

/// The lagged command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LaggedCommand {
    waiting: [Pair; DELAY_TICKS],
    duty: Pair,
}

impl LaggedCommand {
    /// A duty that has long been in force.
    pub fn settled(duty: Pair) -> Self {
        LaggedCommand { waiting: [duty; DELAY_TICKS], duty }
    }

    /// Takes the command of a tick and answers what a slow valve does in it.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn follow(&mut self, command: Pair) -> Pair {
        let late = self.waiting[DELAY_TICKS - 1];
        self.waiting.rotate_right(1);
        self.waiting[0] = command;
        for (duty, late) in self.duty.iter_mut().zip(late) {
            *duty += SHARE * (late - *duty);
        }
        self.duty
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_arrives_late_and_in_full() {
        let mut lagged = LaggedCommand::settled([1.0, 1.0]);
        let course: Vec<f64> = (0..60).map(|_| lagged.follow([0.5, 0.5])[0]).collect();
        assert_eq!(course[..DELAY_TICKS], [1.0, 1.0]);
        // 63 % after delay and time constant (4 ticks), 99.9 % in the end.
        assert!((0.65..0.75).contains(&course[DELAY_TICKS + 3]), "{course:?}");
        assert!((course[59] - 0.5).abs() < 0.001);
    }
}
