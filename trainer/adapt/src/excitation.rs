//! An experiment that moves both valves over the range that a reference needs: what tracking alone hardly shows.
//!
//! A controller that tracks moves its valves slowly and little, so that a lag, a delay and a wrong gain look alike. This
//! programme holds random steps first, then slow triangles that reverse at many places (play, sticking), then fast switching
//! around the middle (delay, lag). Levels and times come from the golden ratio's fractional parts, which fill a range evenly
//! however many are taken (Weyl 1916): the same programme comes out on every machine.

use model::observation::{CHANNELS, Pair};
use model::rig::{Rig, RigError};
use model::steady::SteadyMap;
use proto::recording::csv::{self, Column, ColumnData};
use proto::reference::Reference;

use crate::rig_time::TICK_S;

/// Length of the programme and of each of its three parts, in s.
pub const SECONDS: f64 = 60.0;
const PART_S: f64 = SECONDS / 3.0;
/// Distance beyond the reference's pressures that the duties may take each chamber by itself, by the model, in kPa (chosen: a third of
/// what the paper's reference spans).
const BEYOND_KPA: Pair = [10.0, 3.0];
/// The least that a valve is moved over, in duty: where a reference hardly moves, its valves would hardly be moved.
const LEAST_SPAN_DUTY: f64 = 0.2;
/// Shortest and longest hold of the first part, and of the last, in s.
const STEPS_S: [f64; 2] = [0.2, 1.6];
const SWITCHING_S: [f64; 2] = [0.06, 0.4];
/// Share of the span that is switched in the last part.
const SWITCHED_SHARE: f64 = 0.4;
/// Periods of the triangles, of each channel, in s: they never come together again within the part.
const TRIANGLES_S: Pair = [4.7, 3.1];
/// Time between two looks at a reference, in s.
const LOOK_S: f64 = 0.1;
/// The golden ratio's fractional part, and the square root of two's for the other channel.
const STEP: Pair = [0.618_033_988_749_894_9, 0.414_213_562_373_095_1];

/// Duties between which each valve is moved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spans(pub [[f64; 2]; CHANNELS]);

impl Spans {
    /// Spans in which the model holds the pressures of a reference, and some more.
    ///
    /// # Errors
    /// A rig that the controller cannot drive.
    pub fn of(model: &Rig, reference: &Reference) -> Result<Self, RigError> {
        let map = SteadyMap::new(model)?;
        let looks = (reference.end_s() / LOOK_S).ceil().min(1e5) as u32;
        let mut ends = [[f64::INFINITY, f64::NEG_INFINITY]; CHANNELS];
        for goal in (0..=looks).map(|n| reference.at(f64::from(n) * LOOK_S)) {
            // One chamber at a time: what the pump gives one of them depends on the other.
            for (c, sign) in [(0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0)] {
                let mut beyond = goal;
                beyond[c] += sign * BEYOND_KPA[c];
                let duty = map.duty_for(beyond, [0.0; CHANNELS])[c];
                ends[c] = [ends[c][0].min(duty), ends[c][1].max(duty)];
            }
        }
        Ok(Spans(std::array::from_fn(|c| {
            let [low, high] = ends[c].map(|u| u.clamp(0.0, 1.0));
            let wider = (0.5 * (LEAST_SPAN_DUTY - (high - low))).max(0.0);
            [(low - wider).max(0.0), (high + wider).min(1.0)]
        })))
    }

    /// Spans around the same middles, narrower by a factor.
    #[must_use]
    pub fn narrowed(self, share: f64) -> Self {
        Spans(self.0.map(|[low, high]| {
            let (middle, half) = (0.5 * (low + high), 0.5 * share * (high - low));
            [middle - half, middle + half]
        }))
    }
}

/// Commands of the programme as a table for `controller experiment`; another `number` has other levels and times.
pub fn programme(spans: &Spans, number: usize) -> String {
    let rows = (SECONDS / TICK_S).round() as usize;
    let mut shares: [Vec<f64>; CHANNELS] = [Vec::with_capacity(rows), Vec::with_capacity(rows)];
    for (c, shares) in shares.iter_mut().enumerate() {
        let mut draw = Draw { at: (number as f64 + 1.0) * STEP[1 - c], step: STEP[c] };
        let part = (PART_S / TICK_S).round() as usize;
        hold(shares, part, STEPS_S, &mut draw, |draw| draw.next());
        for row in 0..part {
            let phase = (row as f64 * TICK_S / TRIANGLES_S[c]).fract();
            // From the middle over both ends: each turn a little later in the span, so that play is crossed everywhere.
            let growing = (row as f64 / part as f64).sqrt();
            shares.push(0.5 + (0.5 - (2.0 * phase - 1.0).abs()) * growing);
        }
        let mut high = false;
        hold(shares, rows - 2 * part, SWITCHING_S, &mut draw, |_| {
            high = !high;
            0.5 + if high { 0.5 } else { -0.5 } * SWITCHED_SHARE
        });
    }
    let column = |c: usize, name: &str| {
        let [low, high] = spans.0[c];
        let duties = shares[c].iter().map(|share| ((low + share * (high - low)) * 1e4).round() / 1e4);
        Column { name: name.to_owned(), data: ColumnData::Numbers(duties.collect()) }
    };
    let time_s: Vec<f64> = (0..rows).map(|row| (row as f64 * TICK_S * 1e2).round() / 1e2).collect();
    csv::to_csv(&time_s, &[column(0, "u_pos"), column(1, "u_neg")])
}

/// Fractional parts of multiples of an irrational number.
struct Draw {
    at: f64,
    step: f64,
}

impl Draw {
    fn next(&mut self) -> f64 {
        self.at = (self.at + self.step).fract();
        self.at
    }
}

/// Adds so many rows in which levels are held for drawn times.
fn hold(
    rows: &mut Vec<f64>,
    count: usize,
    times_s: [f64; 2],
    draw: &mut Draw,
    mut level: impl FnMut(&mut Draw) -> f64,
) {
    let end = rows.len() + count;
    while rows.len() < end {
        let value = level(draw);
        let seconds = times_s[0] + draw.next() * (times_s[1] - times_s[0]);
        let ticks = (seconds / TICK_S).round().max(1.0) as usize;
        rows.resize(end.min(rows.len() + ticks), value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::recording::csv::Table;

    fn paper() -> (Rig, Spans) {
        let model = Rig::builtin("dual_pressure").unwrap();
        let spans = Spans::of(&model, &Reference::paper()).unwrap();
        (model, spans)
    }

    #[test]
    fn spans_hold_what_the_reference_needs_and_no_valve_is_shut() {
        let (model, spans) = paper();
        let map = SteadyMap::new(&model).unwrap();
        for n in 0..600 {
            let duty = map.duty_for(Reference::paper().at(f64::from(n) * 0.1), [0.0; CHANNELS]);
            for (c, [low, high]) in spans.0.into_iter().enumerate() {
                assert!((low - 0.01..=high + 0.01).contains(&duty[c]), "{n}: {duty:?} {spans:?}");
            }
        }
        assert!(spans.0.iter().all(|[low, high]| *low > 0.2 && high - low >= LEAST_SPAN_DUTY - 1e-9), "{spans:?}");
        let hold = Spans::of(&model, &Reference::constant(90.0, -72.0)).unwrap();
        assert!(hold.0.iter().all(|[low, high]| high - low >= LEAST_SPAN_DUTY - 1e-9), "{hold:?}");
    }

    #[test]
    fn a_programme_is_a_minute_that_fills_its_spans_and_another_number_is_another() {
        let (_, spans) = paper();
        let text = programme(&spans, 0);
        assert_eq!(text, programme(&spans, 0));
        assert_ne!(text, programme(&spans, 1));
        let table = Table::parse("programme", text.as_bytes(), &["u_pos", "u_neg"]).unwrap();
        for (c, name) in ["u_pos", "u_neg"].into_iter().enumerate() {
            let duty = table.numbers(name).unwrap();
            assert_eq!(duty.len(), 3000);
            let [low, high] = spans.0[c];
            assert!(duty.iter().all(|u| (low - 1e-4..=high + 1e-4).contains(u)));
            // Every tenth of the span is visited, in steps as in triangles.
            for rows in [0..1000, 1000..2000] {
                let visited = |tenth: usize| {
                    let at = |u: f64| ((u - low) / (high - low) * 10.0) as usize;
                    duty[rows.clone()].iter().any(|u| at(*u).min(9) == tenth)
                };
                assert!((0..10).all(visited), "{name}");
            }
            let jumps = duty[2000..].windows(2).filter(|pair| pair[0] != pair[1]).count();
            assert!((50..=330).contains(&jumps), "{jumps} switches in 20 s");
        }
    }
}
