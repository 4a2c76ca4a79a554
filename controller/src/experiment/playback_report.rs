//! Report on a sequence, from its ticks: which commands the cRIO says it applied, and what the pressures did.
//!
//! A row's command holds from its SENSE to the next, so the next SENSE must report that duty in force and the
//! pump as asked. Where it does not (a command that came late or not at all), the recording tells of a command that
//! the rig did not get.

use model::observation::CHANNELS;
use proto::recording::TickRecord;
use proto::wire::{Frame, Mode};
use serde::{Deserialize, Serialize};

use crate::experiment::pump_relay::PumpRelay;

/// Figures of a sequence as it was played.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct PlaybackReport {
    /// Rows that were sent.
    pub rows: u32,
    /// Rows whose next frame reports other duties, or another state of the pump, than were sent.
    pub not_applied: u32,
    /// Rows without a reading: their frame did not come.
    pub without_reading: u32,
    /// Rows whose command left late.
    pub deadline_misses: u32,
    /// Least and largest reading while rows were played, in kPa gauge; `None` before the first.
    pub range_kpa: Option<[[f64; 2]; CHANNELS]>,
    /// Tick of the first row.
    pub first_tick: Option<u32>,
    #[serde(skip)]
    last: Option<Sent>,
    #[serde(skip)]
    relay: PumpRelay,
}

/// A row that waits for its echo.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Sent {
    tick: u32,
    duty: [f32; CHANNELS],
    pump_on: bool,
}

impl PlaybackReport {
    /// Nothing seen yet, on a rig with or without a relay.
    pub fn new(relay: PumpRelay) -> Self {
        PlaybackReport { relay, ..PlaybackReport::default() }
    }

    /// Tells whether nothing differs from what was to be played.
    pub fn is_clean(&self) -> bool {
        self.not_applied == 0 && self.without_reading == 0
    }

    /// Takes the next tick.
    pub fn push(&mut self, tick: &TickRecord) {
        if let Some(sent) = self.last.take()
            && tick.sense_present
            && tick.tick == sent.tick.wrapping_add(1)
        {
            self.not_applied += u32::from(!self.applied(&sent, tick));
        }
        if tick.mode == Mode::Vent.code() {
            return;
        }
        self.rows += 1;
        self.first_tick.get_or_insert(tick.tick);
        self.without_reading += u32::from(!tick.sense_present);
        self.deadline_misses += u32::from(tick.deadline_missed);
        let duty = [tick.u_pos as f32, tick.u_neg as f32];
        self.last = Some(Sent { tick: tick.tick, duty, pump_on: tick.pump_on });
        if tick.sense_present {
            let range = self.range_kpa.get_or_insert([[f64::INFINITY, f64::NEG_INFINITY]; CHANNELS]);
            for ([least, most], kpa) in range.iter_mut().zip([tick.p_pos_kpa, tick.p_neg_kpa]) {
                (*least, *most) = (least.min(kpa), most.max(kpa));
            }
        }
    }

    fn applied(&self, sent: &Sent, next: &TickRecord) -> bool {
        let pump = match Frame::decode(&next.sense) {
            Ok(Frame::Sense(sense)) => self.relay == PumpRelay::Absent || sense.pump_running == sent.pump_on,
            _ => true,
        };
        pump && sent.duty == [next.echo_pos, next.echo_neg]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tick(number: u32, duty: f64, echo: f32) -> TickRecord {
        TickRecord {
            tick: number,
            sense_present: true,
            mode: Mode::Run.code(),
            u_pos: duty,
            u_neg: duty,
            echo_pos: echo,
            echo_neg: echo,
            p_pos_kpa: 80.0 + f64::from(number),
            p_neg_kpa: -70.0,
            ..TickRecord::default()
        }
    }

    #[test]
    fn a_command_is_applied_when_the_next_frame_says_so() {
        let mut witness = PlaybackReport::new(PumpRelay::Absent);
        witness.push(&tick(5, 0.1, 1.0));
        // 0.1 has no exact f32, and the wire carries that.
        witness.push(&tick(6, 0.2, 0.1));
        assert!(witness.is_clean());
        witness.push(&tick(7, 0.3, 0.1));
        assert_eq!((witness.not_applied, witness.rows, witness.first_tick), (1, 3, Some(5)));
        assert_eq!(witness.range_kpa, Some([[85.0, 87.0], [-70.0, -70.0]]));
    }

    #[test]
    fn a_missing_frame_is_no_proof_of_anything_but_itself() {
        let mut witness = PlaybackReport::new(PumpRelay::Absent);
        witness.push(&tick(5, 0.1, 1.0));
        witness.push(&TickRecord { sense_present: false, ..tick(6, 0.2, f32::NAN) });
        witness.push(&tick(7, 0.3, 0.2));
        witness.push(&TickRecord { mode: 0, ..tick(8, 1.0, 0.3) });
        assert_eq!((witness.rows, witness.not_applied, witness.without_reading), (3, 0, 1));
    }
}
