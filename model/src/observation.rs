//! The observation contract: what a policy sees and what it answers. One place, used by daemon and trainer.
//!
//! Park et al., §III-A: the state is the pressures of the last ten ticks, of now and of the next five as the
//! model predicts them (MPObs); the goals run from ten ticks ago to fifteen ahead; the answer is the duties
//! for now and five ticks ahead.
//!
//! | index of 84 | meaning | unit |
//! | --- | --- | --- |
//! | 2(j+10), 2(j+10)+1 for j = −10 … 0 | measured positive, negative pressure at tick τ+j | kPa gauge |
//! | 2(j+10), 2(j+10)+1 for j = 1 … 5 | predicted positive, negative pressure at tick τ+j | kPa gauge |
//! | 32+2(j+10), 32+2(j+10)+1 for j = −10 … 15 | positive, negative reference at tick τ+j | kPa gauge |
//!
//! | index of 12 | meaning | unit |
//! | --- | --- | --- |
//! | 2j, 2j+1 for j = 0 … 5 | duty of the positive, negative valve at tick τ+j | duty, 0 … 1 |
//!
//! # A second contract beside the paper's
//! With these 84 numbers a policy cannot tell a valve that has shifted or that has play: the duties that led to
//! the pressures are not among them. [`ObservationLayout::Correction`] adds what was applied and lets the policy correct the
//! fallback instead of replacing it:
//!
//! | index of 124 | meaning | unit |
//! | --- | --- | --- |
//! | 0 … 83 | as above | kPa gauge |
//! | 84+2(j+10), … for j = −10 … −1 | duty that was applied at tick τ+j | duty, 0 … 1 |
//! | 104+2j, … for j = 0 … 5 | the fallback's own duty for tick τ+j | duty, 0 … 1 |
//! | 116, 117 | the fallback's integral part | duty |
//! | 118, 119 | the part of the fallback's duty that undoes play | duty |
//! | 120, 121 | half width of play that the fallback has learned | duty |
//! | 122, 123 | how far the applied duty has come since it last turned round, upwards positive | duty |
//!
//! The last pair is what a play operator's state depends on and what the last tenths of a second do not tell: on a slow
//! reference a valve crosses its play in a second.
//!
//! Its 12 answers are added to the fallback's duties, each within ±[`CORRECTION_LIMIT`].
//!
//! # Departs from the paper
//! Its Table IV calls n_f = 15 the "number of predicted observations"; its text uses n_a = 5 predicted
//! observations and 15 future goals. The text's dimensions hold.

/// Channels: positive, then negative.
pub const CHANNELS: usize = 2;
/// n_p: past ticks that are observed, besides now.
pub const PAST: usize = 10;
/// n_a: ticks that are predicted, and planned ahead.
pub const AHEAD: usize = 5;
/// n_f: ticks of reference ahead that the policy sees.
pub const GOALS_AHEAD: usize = 15;
/// Numbers of the state: 32.
pub const STATE_LEN: usize = CHANNELS * (PAST + 1 + AHEAD);
/// Numbers of the goal trajectory: 52.
pub const GOAL_LEN: usize = CHANNELS * (PAST + 1 + GOALS_AHEAD);
/// Inputs of a policy: 84.
pub const OBSERVATION_LEN: usize = STATE_LEN + GOAL_LEN;
/// Outputs of a policy: 12.
pub const ACTION_LEN: usize = CHANNELS * (AHEAD + 1);
/// Inputs of a policy that corrects the fallback.
pub const CORRECTION_OBSERVATION_LEN: usize = OBSERVATION_LEN + CHANNELS * (PAST + AHEAD + 1 + 4);
/// The most that a policy may add to or take from the fallback's duty.
pub const CORRECTION_LIMIT: f64 = 0.25;
/// Control ticks per second.
pub const TICKS_PER_S: f64 = 50.0;
/// The most that a command may change in a tick, in duty. A tenth of the range: full travel takes 0.2 s, four times the coil's own lag.
/// Measured: sound controllers move by 0.025 a tick at most on the paper's reference (`safety_filter/tests/envelope.rs`); chosen:
/// four times that.
pub const MOST_CHANGE_DUTY: f64 = 0.1;

/// One number per channel: positive, then negative.
pub type Pair = [f64; CHANNELS];

/// Contract of a policy: the numbers that it is told, and the meaning of its answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ObservationLayout {
    /// Version 1, the paper's: 84 pressures and goals in, duties out.
    Paper,
    /// Version 2: besides these the duties applied and the fallback's; out come corrections of the latter.
    Correction,
}

impl ObservationLayout {
    /// The number in a policy's metadata.
    pub fn version(self) -> u32 {
        match self {
            ObservationLayout::Paper => 1,
            ObservationLayout::Correction => 2,
        }
    }

    /// The contract of that number.
    pub fn of_version(version: u32) -> Option<Self> {
        [ObservationLayout::Paper, ObservationLayout::Correction].into_iter().find(|c| c.version() == version)
    }

    /// Numbers of an observation; both answer with [`ACTION_LEN`].
    pub fn observation_len(self) -> usize {
        match self {
            ObservationLayout::Paper => OBSERVATION_LEN,
            ObservationLayout::Correction => CORRECTION_OBSERVATION_LEN,
        }
    }
}

/// Duties for now and the next five ticks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ActionTrajectory(pub [Pair; AHEAD + 1]);

impl ActionTrajectory {
    /// Trajectory of the same duties now and ahead.
    pub fn held(duty: Pair) -> Self {
        ActionTrajectory([duty; AHEAD + 1])
    }

    /// The duties for now.
    pub fn now(&self) -> Pair {
        self.0[0]
    }

    /// Duties that were planned, one tick ago, for now and the next four ticks: the input of MPObs.
    pub fn remaining(&self) -> [Pair; AHEAD] {
        std::array::from_fn(|j| self.0[j + 1])
    }

    /// Reads a policy's answer.
    pub fn from_outputs(outputs: &[f32; ACTION_LEN]) -> Self {
        ActionTrajectory(std::array::from_fn(|j| std::array::from_fn(|c| f64::from(outputs[CHANNELS * j + c]))))
    }
}

/// The measured past and the goals that went with it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct History {
    /// Oldest first; the last is now.
    measured: [Pair; PAST + 1],
    goals: [Pair; PAST + 1],
    started: bool,
}

impl Default for History {
    fn default() -> Self {
        History { measured: [[0.0; CHANNELS]; PAST + 1], goals: [[0.0; CHANNELS]; PAST + 1], started: false }
    }
}

impl History {
    /// Takes in the tick's readings and reference (kPa gauge). The first call fills the whole past with them:
    /// a rig that was just connected has been where it is.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn push(&mut self, measured_kpa: Pair, goal_kpa: Pair) {
        if !self.started {
            self.started = true;
            self.measured = [measured_kpa; PAST + 1];
            self.goals = [goal_kpa; PAST + 1];
        }
        self.measured.rotate_left(1);
        self.goals.rotate_left(1);
        self.measured[PAST] = measured_kpa;
        self.goals[PAST] = goal_kpa;
    }

    /// Writes the observation of this tick, given the predictions for the next five ticks and the goals of
    /// the next fifteen (kPa gauge).
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn observe(
        &self,
        predicted_kpa: &[Pair; AHEAD],
        goals_ahead_kpa: &[Pair; GOALS_AHEAD],
        observation: &mut [f32; OBSERVATION_LEN],
    ) {
        let state = self.measured.iter().chain(predicted_kpa);
        let goals = self.goals.iter().chain(goals_ahead_kpa);
        for (slot, value) in observation.iter_mut().zip(state.chain(goals).flatten()) {
            *slot = *value as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_the_papers() {
        assert_eq!((STATE_LEN, GOAL_LEN, OBSERVATION_LEN, ACTION_LEN), (32, 52, 84, 12));
        assert_eq!(CORRECTION_OBSERVATION_LEN, 124);
    }

    /// Ticks are numbered so that the value tells its own place: measured τ, goal 1000 + τ, negative channel minus.
    #[test]
    fn every_number_lands_where_the_table_says() {
        let mut history = History::default();
        let number = |t: i32| [f64::from(t), -f64::from(t)];
        let goal = |t: i32| [1000.0 + f64::from(t), -1000.0 - f64::from(t)];
        for t in 0..=30 {
            history.push(number(t), goal(t));
        }
        let predicted = std::array::from_fn(|j| number(31 + j as i32));
        let goals = std::array::from_fn(|j| goal(31 + j as i32));
        let mut observation = [0.0f32; OBSERVATION_LEN];
        history.observe(&predicted, &goals, &mut observation);
        for j in -10i32..=5 {
            let at = (2 * (j + 10)) as usize;
            assert_eq!(observation[at..at + 2], [(30 + j) as f32, -(30 + j) as f32]);
        }
        for j in -10i32..=15 {
            let at = (32 + 2 * (j + 10)) as usize;
            assert_eq!(observation[at..at + 2], [(1030 + j) as f32, -(1030 + j) as f32]);
        }
    }

    #[test]
    fn remaining_actions_are_shifted_by_one_tick() {
        let trajectory = ActionTrajectory(std::array::from_fn(|j| [j as f64, 10.0 + j as f64]));
        assert_eq!(trajectory.now(), [0.0, 10.0]);
        assert_eq!(trajectory.remaining()[0], [1.0, 11.0]);
        assert_eq!(trajectory.remaining()[4], [5.0, 15.0]);
    }
}
