//! Decisions of a checked fault script: the outcome of each frame, link and sensor at each tick.
//!
//! Every decision hangs on seed, fault and tick alone, never on what was asked before, so that both
//! paces and any order of frames within a tick meet the same faults.

use std::time::Duration;

use crate::split_mix::SplitMix64;
use crate::wire::{FrameType, RawFrame, TripBits};

use super::faults::FaultScript;
use super::sensors::SensorFault;

/// One fault of a script.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Fault {
    pub(super) when: When,
    pub(super) action: Action,
}

/// At which ticks a fault strikes.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum When {
    /// At these, sorted.
    Ticks(Vec<u64>),
    /// From `first` to `last`, every `every`-th, each with a probability.
    Span { first: u64, last: u64, every: u64, probability: f64 },
}

/// A type of frame in one direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Wire {
    pub(super) kind: FrameType,
    /// True from the cRIO to the daemon.
    pub(super) outgoing: bool,
}

/// Action of a fault.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Action {
    Lose(Wire),
    Delay(Wire, Duration),
    /// `None`: by the dice.
    Corrupt {
        wire: Wire,
        byte: Option<usize>,
        xor: Option<u8>,
    },
    Repeat(Wire, u32),
    /// With how long new connections are reset.
    DropLink(Duration),
    Sensor {
        channel: usize,
        fault: SensorFault,
    },
    Trip(TripBits),
}

/// Outcome for one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FaultOutcome {
    /// The bytes that go on, changed or not.
    pub(super) raw: RawFrame,
    /// Number of times that they go on; 0: lost.
    pub(super) times: u32,
    /// Time by which they go on later.
    pub(super) delay: Duration,
    /// True where the bytes were changed.
    pub(super) corrupted: bool,
}

impl FaultOutcome {
    /// True where the frame goes on as if there were no script.
    pub(super) fn untouched(&self) -> bool {
        self.times == 1 && self.delay.is_zero() && !self.corrupted
    }
}

/// Tells throws for the chance of a fault and for the byte it spoils apart.
const THROW_CHANCE: u64 = 1;
const THROW_BYTE: u64 = 2;

impl FaultScript {
    /// Outcome for a frame of this type and direction at this tick.
    pub(super) fn outcome(&self, wire: Wire, tick: u64, raw: RawFrame) -> FaultOutcome {
        let mut outcome = FaultOutcome { raw, times: 1, delay: Duration::ZERO, corrupted: false };
        for (index, action) in self.striking(tick) {
            match action {
                Action::Lose(of) if *of == wire => outcome.times = 0,
                Action::Delay(of, delay) if *of == wire => outcome.delay += *delay,
                Action::Repeat(of, times) if *of == wire && outcome.times > 0 => outcome.times += times,
                Action::Corrupt { wire: of, byte, xor } if *of == wire => {
                    let mut dice = SplitMix64::keyed(self.seed, &[index, tick, THROW_BYTE]);
                    let length = outcome.raw.as_bytes().len().max(1) as u64;
                    // Thrown even where given, so that giving one leaves the other as it was.
                    let thrown_byte = (dice.next_u64() % length) as usize;
                    let thrown_xor = (dice.next_u64() % 255 + 1) as u8;
                    outcome.raw = flipped(outcome.raw, byte.unwrap_or(thrown_byte), xor.unwrap_or(thrown_xor));
                    outcome.corrupted = true;
                }
                _ => {}
            }
        }
        outcome
    }

    /// Time for which new links are reset, where the link drops at this tick.
    pub(super) fn link_drop(&self, tick: u64) -> Option<Duration> {
        self.striking(tick)
            .filter_map(|(_, action)| if let Action::DropLink(refuse) = action { Some(*refuse) } else { None })
            .max()
    }

    /// The faults of one sensor at this tick, appended to `faults`.
    pub(super) fn sensor_faults(&self, channel: usize, tick: u64, faults: &mut Vec<SensorFault>) {
        faults.extend(self.striking(tick).filter_map(|(_, action)| match action {
            Action::Sensor { channel: of, fault } if *of == channel => Some(*fault),
            _ => None,
        }));
    }

    /// The trips the script wants at this tick.
    pub(super) fn trips(&self, tick: u64) -> TripBits {
        self.striking(tick).fold(TripBits::NONE, |trips, (_, action)| match action {
            Action::Trip(bits) => trips.with(*bits),
            _ => trips,
        })
    }

    fn striking(&self, tick: u64) -> impl Iterator<Item = (u64, &Action)> {
        self.faults.iter().zip(0_u64..).filter_map(move |(fault, index)| {
            let strikes = match &fault.when {
                When::Ticks(ticks) => ticks.binary_search(&tick).is_ok(),
                When::Span { first, last, every, probability } => {
                    (*first..=*last).contains(&tick)
                        && (tick - first).is_multiple_of(*every)
                        && (*probability >= 1.0
                            || SplitMix64::keyed(self.seed, &[index, tick, THROW_CHANCE]).unit() < *probability)
                }
            };
            strikes.then_some((index, &fault.action))
        })
    }
}

fn flipped(raw: RawFrame, byte: usize, xor: u8) -> RawFrame {
    let mut bytes = [0; crate::wire::MAX_LENGTH];
    for (to, from) in bytes.iter_mut().zip(raw.as_bytes()) {
        *to = *from;
    }
    let bytes = bytes.get_mut(..raw.as_bytes().len()).unwrap_or(&mut []);
    if let Some(spoilt) = bytes.get_mut(byte) {
        *spoilt ^= xor;
    }
    RawFrame::of(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SENSE: Wire = Wire { kind: FrameType::Sense, outgoing: true };
    const COMMAND: Wire = Wire { kind: FrameType::Command, outgoing: false };

    fn script(toml: &str) -> FaultScript {
        FaultScript::from_toml(toml, "test.toml").unwrap()
    }

    fn struck(script: &FaultScript, wire: Wire, ticks: std::ops::Range<u64>) -> Vec<u64> {
        ticks.filter(|tick| !script.outcome(wire, *tick, RawFrame::of(&[0; 44])).untouched()).collect()
    }

    #[test]
    fn ticks_spans_and_every_nth_strike_where_they_say() {
        let at = script("[[fault]]\nkind = \"lose\"\nframe = \"sense\"\nticks = [7, 3]");
        assert_eq!(struck(&at, SENSE, 0..20), [3, 7]);
        assert_eq!(struck(&at, COMMAND, 0..20), [] as [u64; 0], "another frame");
        let span = script("[[fault]]\nkind = \"lose\"\nframe = \"command\"\nfirst = 4\nlast = 12\nevery = 4");
        assert_eq!(struck(&span, COMMAND, 0..30), [4, 8, 12]);
    }

    #[test]
    fn probability_is_met_and_hangs_on_the_seed_alone() {
        let text = |seed: u32| {
            script(&format!("seed = {seed}\n[[fault]]\nkind = \"lose\"\nframe = \"sense\"\nprobability = 0.25"))
        };
        let first = struck(&text(1), SENSE, 0..20_000);
        // Five standard deviations of a binomial: √(20000 × 0.25 × 0.75) = 61.
        assert!((first.len() as f64 - 5000.0).abs() < 5.0 * 61.3, "{}", first.len());
        assert_eq!(first, struck(&text(1), SENSE, 0..20_000));
        assert_ne!(first, struck(&text(2), SENSE, 0..20_000));
        // Asked from the middle on, the same ticks are struck.
        assert_eq!(
            first.iter().copied().filter(|t| *t >= 9000).collect::<Vec<_>>(),
            struck(&text(1), SENSE, 9000..20_000)
        );
    }

    #[test]
    fn a_corruption_changes_one_byte_always() {
        let dice = script("[[fault]]\nkind = \"corrupt\"\nframe = \"command\"\nfirst = 0");
        let mut places = std::collections::BTreeSet::new();
        for tick in 0..2000 {
            let outcome = dice.outcome(COMMAND, tick, RawFrame::of(&[0x55; 44]));
            let changed: Vec<usize> = (0..44).filter(|at| outcome.raw.as_bytes()[*at] != 0x55).collect();
            assert_eq!(changed.len(), 1);
            places.extend(changed);
        }
        assert_eq!(places.len(), 44, "every byte has its turn");
        let given = script("[[fault]]\nkind = \"corrupt\"\nframe = \"command\"\nbyte = 30\nxor = 16\nfirst = 0");
        assert_eq!(given.outcome(COMMAND, 5, RawFrame::of(&[0; 44])).raw.as_bytes()[30], 16);
    }

    #[test]
    fn faults_add_up_and_a_lost_frame_stays_lost() {
        let both = script(
            "[[fault]]\nkind = \"delay\"\nframe = \"sense\"\nby_ticks = 2\nfirst = 0\n\
             [[fault]]\nkind = \"repeat\"\nframe = \"sense\"\ntimes = 3\nfirst = 0\n\
             [[fault]]\nkind = \"lose\"\nframe = \"sense\"\nticks = [9]\n\
             [[fault]]\nkind = \"repeat\"\nframe = \"sense\"\nfirst = 0",
        );
        let outcome = both.outcome(SENSE, 0, RawFrame::of(&[0; 64]));
        assert_eq!((outcome.times, outcome.delay), (5, Duration::from_millis(40)));
        assert_eq!(both.outcome(SENSE, 9, RawFrame::of(&[0; 64])).times, 0);
    }

    #[test]
    fn links_sensors_and_trips() {
        let script = script(
            "[[fault]]\nkind = \"drop_link\"\nticks = [5]\nrefuse_s = 1.5\n\
             [[fault]]\nkind = \"sensor\"\nsensor = \"negative\"\neffect = \"offset\"\nkpa = -2.0\nfirst = 10\nlast = 11\n\
             [[fault]]\nkind = \"trip\"\nreason = \"operator_stop\"\nticks = [20]",
        );
        assert_eq!(script.link_drop(5), Some(Duration::from_millis(1500)));
        assert_eq!(script.link_drop(6), None);
        let faults = |channel, tick| {
            let mut faults = Vec::new();
            script.sensor_faults(channel, tick, &mut faults);
            faults
        };
        assert_eq!(faults(1, 10), [SensorFault::Offset(-2.0)]);
        assert_eq!(faults(0, 10), []);
        assert_eq!(faults(1, 12), []);
        assert_eq!(script.trips(20), TripBits::OPERATOR_STOP);
        assert_eq!(script.trips(21), TripBits::NONE);
    }
}
