//! The end of a flight on what is new where it tracks worse than what was there.
//!
//! The promise is about a window: in no 60 s the error of both channels together may be more than a twentieth above that
//! of the flight of what was there along the same part of the reference. Two looks end a flight before the window is
//! over. Where the squares so far are more than the whole window may have, nothing that follows can make up for it.
//! Where the excess so far is more than the window's, what controlled before would leave the window too bad even if it
//! went on at once; as noise adds up to an excess as well, that must also be three times as much as sums of such
//! differences vary by chance.

use model::observation::TICKS_PER_S;
use proto::recording::TickRecord;

use crate::recorded::RUN;
use crate::tracking::SKIPPED;
use crate::yardstick::Yardstick;

/// A run this much worse than another is ended (both channels together; chosen: runs of one controller differ by half of it, 0.6 to 3.5 % in the
/// mean of pairs).
pub(crate) const WORSE: f64 = 1.05;
/// Length of the window, in s; a shorter flight is one window.
const WINDOW_S: usize = 60;
/// Least part of a window that anything is said of, in s: as much as a flight must have for a figure.
const LEAST_S: usize = 5;
/// Standard deviations of a sum of differences that chance is not believed to reach (chosen: once in some hundred
/// flights).
const CLEARLY: f64 = 3.0;
/// Ticks of a second.
const SECOND: usize = TICKS_PER_S as usize;

/// Mean squares of the error of both channels together, in kPa², for each whole second of a flight that began at tick
/// `start`, behind the way to where the reference begins; nothing of a second in which the rig was not controlled.
pub(crate) fn squares_by_second(ticks: &[TickRecord], start: u32, yardstick: &Yardstick) -> Vec<Option<f64>> {
    let mut sums: Vec<(f64, u32)> = Vec::new();
    let mut ticks_of_last = 0;
    for (tick, [pos, neg]) in ticks.iter().zip(yardstick.errors_kpa(ticks)) {
        let Some(behind) = (tick.tick.wrapping_sub(start) as usize).checked_sub(SKIPPED) else { continue };
        let second = behind / SECOND;
        if second >= sums.len() {
            sums.resize(second + 1, (0.0, 0));
        }
        ticks_of_last = behind % SECOND + 1;
        let square = pos.powi(2) + neg.powi(2);
        if let Some((sum, count)) = sums.get_mut(second).filter(|_| tick.state == RUN && square.is_finite()) {
            *sum += square;
            *count += 1;
        }
    }
    if ticks_of_last < SECOND {
        sums.pop();
    }
    sums.into_iter().map(|(sum, count)| (count > 0).then(|| sum / f64::from(count))).collect()
}

/// Root mean squares of a flight and of what was there, in a window in which the flight is worse by more than is
/// allowed, or cannot but become so.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct WorseWindow {
    pub(crate) flown_kpa: f64,
    pub(crate) there_kpa: f64,
}

/// The first window in which a flight, as far as it has come, tracks worse than what was there; both second by second. Seconds that one of
/// them lacks count in neither.
pub(crate) fn worse_window(flown: &[Option<f64>], there: &[Option<f64>]) -> Option<WorseWindow> {
    let window = WINDOW_S.min(there.len());
    there.windows(window.max(1)).zip(0..).find_map(|(there, from)| {
        let so_far = flown.get(from..)?;
        let so_far = so_far.get(..window).unwrap_or(so_far);
        let both: Vec<(f64, f64)> = so_far.iter().zip(there).filter_map(|(flown, there)| flown.zip(*there)).collect();
        if both.len() < LEAST_S.min(window) {
            return None;
        }
        let [spent, beside] = [|(flown, _): &(f64, f64)| *flown, |(_, there): &(f64, f64)| *there]
            .map(|of: fn(&(f64, f64)) -> f64| both.iter().map(of).sum::<f64>());
        let to_come: f64 = there.iter().skip(so_far.len()).flatten().sum();
        let whole = beside + to_come;
        let allowed = whole * WORSE * WORSE;
        let squares: f64 = both.iter().map(|(flown, there)| (flown - there).powi(2)).sum();
        let excess = spent - beside;
        let is_clear = excess > allowed - whole && excess > CLEARLY * squares.sqrt();
        let rms = |sum: f64| (sum / both.len().max(1) as f64).sqrt();
        (spent > allowed || is_clear).then(|| WorseWindow { flown_kpa: rms(spent), there_kpa: rms(beside) })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Seconds after which a flight of this square error is ended beside one of 1 kPa².
    fn ended_after(square: f64, seconds: usize) -> Option<usize> {
        let (flown, there) = (vec![Some(square); seconds], vec![Some(1.0); seconds]);
        (0..=seconds).find(|n| worse_window(&flown[..*n], &there).is_some())
    }

    #[test]
    fn the_worse_a_flight_the_sooner_it_is_ended() {
        assert_eq!(ended_after(31.0, 55), Some(5), "0.47 instead of 0.084 kPa: at the first look");
        assert!(ended_after(4.0, 55).unwrap() <= 10, "twice the error");
        assert!(ended_after(1.21, 55).unwrap() <= 30, "a tenth more: half way, so that the window still holds");
        assert_eq!(ended_after(1.06 * 1.06, 55).map(|n| n < 55), Some(true));
        for good in [0.5, 1.0, 1.04 * 1.04] {
            assert_eq!(ended_after(good, 55), None);
            assert_eq!(ended_after(good, 200), None);
        }
    }

    #[test]
    fn a_window_far_into_a_long_flight_is_seen_and_a_bad_second_is_not() {
        let there = vec![Some(1.0); 200];
        let mut flown = there.clone();
        flown[100] = Some(5.0);
        assert_eq!(worse_window(&flown, &there), None, "a single second");
        flown[100..160].fill(Some(1.3));
        assert!(worse_window(&flown, &there).is_some());
        assert_eq!(worse_window(&flown[..100], &there), None);
    }

    /// Squares of noise alone, from the golden ratio's fractional parts: two flights of one controller.
    #[test]
    fn noise_ends_no_flight() {
        let noise = |phase: f64| -> Vec<Option<f64>> {
            (0..55).map(|n| Some(1.0 + 0.4 * ((f64::from(n) * 0.618_033_988_749 + phase).fract() - 0.5))).collect()
        };
        for n in 0..20 {
            let (flown, there) = (noise(f64::from(n) * 0.05), noise(0.0));
            assert!((1..=55).all(|seconds| worse_window(&flown[..seconds], &there).is_none()), "{n}");
        }
    }

    #[test]
    fn squares_are_of_whole_seconds_behind_the_way_to_the_reference() {
        let ticks: Vec<TickRecord> = (0..375)
            .map(|n: u32| TickRecord {
                state: RUN,
                tick: 1000 + n,
                p_pos_kpa: 0.3,
                p_neg_kpa: 0.4,
                ..TickRecord::default()
            })
            .map(|tick| TickRecord { ref_pos_kpa: 0.0, ref_neg_kpa: 0.0, ..tick })
            .collect();
        let squares = squares_by_second(&ticks, 1000, &Yardstick::default());
        assert_eq!(squares.len(), 2, "the last half second does not count");
        assert!(squares.iter().flatten().all(|square| (square - 0.25).abs() < 1e-12), "{squares:?}");
        // A second without control has no error.
        let vented = |tick: &TickRecord| TickRecord { state: if tick.tick < 1300 { 2 } else { RUN }, ..*tick };
        let vented: Vec<TickRecord> = ticks.iter().map(vented).collect();
        let squares = squares_by_second(&vented, 1000, &Yardstick::default());
        assert!(squares.len() == 2 && squares[0].is_none() && squares[1].is_some(), "{squares:?}");
    }

    /// Seconds without control are neither a credit to a flight nor an error of nothing in what was there.
    #[test]
    fn seconds_without_control_count_in_neither_flight() {
        let seconds = |square: f64| vec![Some(square); 55];
        let gap = |mut seconds: Vec<Option<f64>>| {
            seconds[20..40].fill(None);
            seconds
        };
        assert_eq!(worse_window(&seconds(1.0), &gap(seconds(1.0))), None);
        assert_eq!(worse_window(&gap(seconds(1.0)), &seconds(1.0)), None);
        assert!(worse_window(&gap(seconds(1.3)), &seconds(1.0)).is_some());
    }
}
