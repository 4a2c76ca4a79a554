//! Meanings that a column of pressures may have instead of gauge kPa.
//!
//! Each meaning says what gauge pressure a number would then be; the meaning under which the numbers come closest to
//! what the rig would do is the one told. Units closer to each other than rigs are to their files (bar and atm) share a
//! line.
//!
//! A unit that is said of a column, by the file or its map, was taken before anybody looked, and may be wrong. So meanings go by the
//! numbers as they are written: that is also what the key goes by, which takes the place of what is said.

use model::rig::{Rig, Sensor};
use proto::recording::FileUnit;

use super::mend::pressure_key;

/// Units that pressures are found in, and how many there are of each in 1 kPa.
const UNITS: [(f64, &str); 8] = [
    (1e3, "Pa"),
    (10.0, "mbar, hPa or cmH2O"),
    (7.500_62, "mmHg"),
    (0.295_3, "inHg"),
    (0.145_038, "psi"),
    (0.101_972, "m of water"),
    (0.01, "bar (or atm, kgf/cm²)"),
    (0.001, "MPa"),
];

/// A channel as recorded, and as the rig would stand.
pub(super) struct Standing<'a> {
    /// Place among the channels.
    pub(super) channel: usize,
    /// Median of what was recorded.
    pub(super) recorded: f64,
    /// Median of the simulation, gauge kPa.
    pub(super) simulated: f64,
    /// The channel's sensor.
    pub(super) sensor: Option<&'a Sensor>,
    /// Margins of this channel as a share of those of a rig of 50 kPa or more.
    pub(super) scale: f64,
    /// The unit, other than kPa, that is said of it and that it was read by.
    pub(super) file_unit: Option<&'a FileUnit>,
    /// Medians, recorded and simulated (kPa), where the rig would stand lowest and highest of all rows.
    pub(super) ends: Vec<[f64; 2]>,
}

/// An electric output of a sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Output {
    /// Volts over the sensor's `range_v`.
    Volts,
    /// Millivolts over the sensor's `range_v`.
    Millivolts,
    /// A current loop, 4 … 20 mA over the sensor's range (IEC 60381-1).
    Loop,
}

impl Output {
    const ALL: [Output; 3] = [Output::Volts, Output::Millivolts, Output::Loop];

    /// As `[recording]` calls it.
    pub(super) fn unit(self) -> &'static str {
        match self {
            Output::Volts => "V",
            Output::Millivolts => "mV",
            Output::Loop => "mA",
        }
    }

    /// At the ends of the sensor's range.
    fn ends(self, sensor: &Sensor) -> [f64; 2] {
        match self {
            Output::Volts => sensor.range_v,
            Output::Millivolts => sensor.range_v.map(|volts| 1e3 * volts),
            Output::Loop => [4.0, 20.0],
        }
    }
}

/// Meaning of the numbers of a column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Meaning {
    /// Gauge kPa, as it was read.
    AsRead,
    /// Gauge pressure, so many to 1 kPa.
    Gauge(f64, &'static str),
    /// Absolute pressure, so many to 1 kPa.
    Absolute(f64, &'static str),
    /// Output of the sensor.
    Output(Output),
    /// Counts that a converter makes of it: the largest one, and the volts that give it; without those, counts over the sensor's range.
    Counts {
        /// The largest count.
        full: f64,
        /// Volts at the largest count.
        volts: Option<f64>,
    },
    /// Gauge kPa, as it was read, without its sign.
    Unsigned,
}

/// The meaning that a column should have.
pub(super) const RIGHT: Meaning = Meaning::AsRead;
/// Numbers that are gauge kPa as they are written, whatever unit is said of them.
pub(super) const AS_WRITTEN: Meaning = Meaning::Gauge(1.0, "kPa");
/// Lines this near to each other in scale (share) and at zero (kPa) are one.
const ONE_LINE: [f64; 2] = [0.05, 1.0];

impl Meaning {
    /// All wrong ones.
    pub(super) fn wrong() -> impl Iterator<Item = Meaning> {
        let units = UNITS.into_iter();
        units
            .clone()
            .map(|(per_kpa, unit)| Meaning::Gauge(per_kpa, unit))
            .chain(units.map(|(per_kpa, unit)| Meaning::Absolute(per_kpa, unit)))
            .chain([Meaning::Absolute(1.0, "kPa"), Meaning::Unsigned])
            .chain(Output::ALL.into_iter().map(Meaning::Output))
    }

    /// Gauge kPa per number as it is written, and at zero; `None` where the rig file says nothing of the sensor.
    pub(super) fn line(
        self,
        sensor: Option<&Sensor>,
        file_unit: Option<&FileUnit>,
        atmosphere_kpa: f64,
    ) -> Option<[f64; 2]> {
        let as_read = file_unit.map_or([1.0, 0.0], |unit| [unit.scale, unit.zero]);
        match self {
            Meaning::AsRead => Some(as_read),
            Meaning::Gauge(per_kpa, _) => Some([1.0 / per_kpa, 0.0]),
            Meaning::Absolute(per_kpa, _) => Some([1.0 / per_kpa, -atmosphere_kpa]),
            Meaning::Output(output) => sensor.map(|sensor| {
                let ([p0, p1], [from, to]) = (sensor.range_kpa_gauge, output.ends(sensor));
                let slope = (p1 - p0) / (to - from);
                [slope, p0 - from * slope]
            }),
            Meaning::Counts { full, volts } => sensor.map(|sensor| {
                let [p0, p1] = sensor.range_kpa_gauge;
                let [from, to] = volts.map_or([0.0, full], |volts| sensor.range_v.map(|v| v / volts * full));
                let slope = (p1 - p0) / (to - from);
                [slope, p0 - from * slope]
            }),
            Meaning::Unsigned => Some(as_read.map(|x| -x)),
        }
    }

    /// The gauge pressure (kPa) that a reading of a sensor's column would be; `None` where it cannot have this meaning.
    pub(super) fn of(
        self,
        recorded: f64,
        sensor: Option<&Sensor>,
        file_unit: Option<&FileUnit>,
        atmosphere_kpa: f64,
    ) -> Option<f64> {
        let written = file_unit.map_or(recorded, |unit| unit.written(recorded));
        // Nothing is below vacuum.
        let can_be = !matches!(self, Meaning::Absolute(..)) || written > 0.0;
        let line = self.line(sensor, file_unit, atmosphere_kpa).filter(|_| can_be);
        line.map(|[scale, offset]| scale * written + offset)
    }

    /// Tells whether it is the unit that a column was read by.
    pub(super) fn is_as_read(self, sensor: Option<&Sensor>, file_unit: Option<&FileUnit>, atmosphere_kpa: f64) -> bool {
        let of = |meaning: Meaning| meaning.line(sensor, file_unit, atmosphere_kpa);
        let [share, kpa] = ONE_LINE;
        of(self).zip(of(Meaning::AsRead)).is_some_and(|([scale, zero], [read, read_zero])| {
            (scale / read - 1.0).abs() <= share && (zero - read_zero).abs() <= kpa
        })
    }

    /// Distance at which this meaning puts a channel from the simulation, in units of `share` of it and `kpa` (at scale 1); above 1
    /// it does not fit.
    pub(super) fn misfit(self, standing: &Standing<'_>, atmosphere_kpa: f64, margins: [f64; 2]) -> f64 {
        self.misfit_at(standing, [standing.recorded, standing.simulated], atmosphere_kpa, margins)
    }

    /// Misfit at the worst of all places that the channel stood at.
    pub(super) fn misfit_anywhere(self, standing: &Standing<'_>, atmosphere_kpa: f64, margins: [f64; 2]) -> f64 {
        let places = standing.ends.iter().copied().chain([[standing.recorded, standing.simulated]]);
        places.map(|place| self.misfit_at(standing, place, atmosphere_kpa, margins)).fold(0.0, f64::max)
    }

    /// Tells whether this meaning puts the channel no further from the simulation than the numbers as they were read do, or than
    /// `near_kpa` (at scale 1), wherever it stood: what suits it at one place by chance is further off at another. Two lines cross
    /// somewhere, so what is near all the same is not held against a meaning.
    pub(super) fn is_nearer_everywhere(self, standing: &Standing<'_>, atmosphere_kpa: f64, near_kpa: f64) -> bool {
        let off = |meaning: Meaning, place| meaning.misfit_at(standing, place, atmosphere_kpa, [0.0, near_kpa]);
        standing.ends.iter().all(|place| off(self, *place) <= off(RIGHT, *place).max(1.0))
    }

    fn misfit_at(
        self,
        standing: &Standing<'_>,
        [recorded, simulated]: [f64; 2],
        atmosphere_kpa: f64,
        [share, kpa]: [f64; 2],
    ) -> f64 {
        let allowed = share * simulated.abs() + kpa * standing.scale;
        let meant = self.of(recorded, standing.sensor, standing.file_unit, atmosphere_kpa);
        meant.map_or(f64::INFINITY, |p| (p - simulated).abs() / allowed)
    }

    /// Words on what is wrong with a column, and the mend.
    pub(super) fn text(self, rig: &Rig, column: &str, standing: &Standing<'_>) -> String {
        let Standing { recorded, simulated, sensor, file_unit, .. } = standing;
        let atmosphere_kpa = rig.atmosphere.pressure_kpa_abs;
        let is = match (self, file_unit) {
            (meaning, Some(said)) if meaning != Meaning::Unsigned => said_otherwise(said, meaning),
            (meaning, _) => meaning.words(*sensor, *simulated, atmosphere_kpa),
        };
        let key = pressure_key(rig, column, self, *file_unit);
        format!("reads {} where about {} kPa are expected: {is}: {key}", figures(*recorded), about(*simulated))
    }

    /// Words for the unit that numbers seem to be in where nobody says one.
    pub(super) fn words(self, sensor: Option<&Sensor>, simulated_kpa: f64, atmosphere_kpa: f64) -> String {
        match self {
            Meaning::AsRead => "the pressure seems to be in kPa".to_owned(),
            Meaning::Gauge(_, unit) => format!("the pressure seems to be in {unit}"),
            Meaning::Absolute(_, "kPa") => {
                format!("the pressure seems to be absolute; subtract the atmosphere's {atmosphere_kpa:.1} kPa")
            }
            Meaning::Absolute(_, unit) => format!("the pressure seems to be absolute, in {unit}"),
            Meaning::Output(output) => {
                let what = match output {
                    Output::Volts => "the sensor's volts",
                    Output::Millivolts => "the sensor's millivolts",
                    Output::Loop => "the mA of a current loop",
                };
                let scale = sensor.map_or_else(String::new, |sensor| {
                    let ([p0, p1], [from, to]) = (sensor.range_kpa_gauge, output.ends(sensor));
                    format!(" ({from} … {to} {} are {p0} … {p1} kPa)", output.unit())
                });
                format!("these seem to be {what}{scale}")
            }
            Meaning::Counts { full, volts } => {
                let over = volts.map_or("the sensor's range".to_owned(), |volts| format!("0 … {volts} V"));
                format!("these seem to be the raw counts of a converter (0 … {full} over {over})")
            }
            Meaning::Unsigned => lost_sign(simulated_kpa).to_owned(),
        }
    }
}

/// Misfits this near to each other tell no unit from another.
const RIVAL: f64 = 0.1;

/// The other key that helps as well where numbers that something wrong is said of may be in one of two units; empty where they cannot.
pub(super) fn or_rival(
    rig: &Rig,
    column: &str,
    (of, wrong): (&[&Standing<'_>], [f64; 2]),
    (meaning, file_unit): (Meaning, Option<&FileUnit>),
) -> String {
    let atmosphere_kpa = rig.atmosphere.pressure_kpa_abs;
    let misfit =
        |meaning: Meaning| of.iter().map(|s| meaning.misfit_anywhere(s, atmosphere_kpa, wrong)).fold(0.0, f64::max);
    let most = (misfit(meaning) + RIVAL).min(1.0);
    let is_rival = |other: &Meaning| {
        let is_told = *other == meaning || matches!(other, Meaning::Unsigned);
        !is_told && misfit(*other) < most && of.iter().all(|s| !other.is_as_read(s.sensor, s.file_unit, atmosphere_kpa))
    };
    let rivals = Meaning::wrong().filter(|other| file_unit.is_some() && meaning != AS_WRITTEN && is_rival(other));
    let nearest = rivals.min_by(|a, b| misfit(*a).total_cmp(&misfit(*b)));
    nearest.map_or_else(String::new, |other| {
        format!("; or, which cannot be told from it here, {}", pressure_key(rig, column, other, file_unit))
    })
}

/// The complaint about numbers that are something else than what is said of them.
pub(super) fn said_otherwise(said: &FileUnit, meaning: Meaning) -> String {
    let seems = match meaning {
        AS_WRITTEN if said.zero == 0.0 => "kPa as they stand".to_owned(),
        AS_WRITTEN | Meaning::AsRead => "gauge kPa".to_owned(),
        Meaning::Gauge(_, unit) => format!("{unit}, gauge"),
        Meaning::Absolute(_, unit) => format!("absolute, in {unit}"),
        Meaning::Output(output) => format!("the sensor's {}", output.unit()),
        Meaning::Counts { .. } => "the raw counts of a converter".to_owned(),
        Meaning::Unsigned => "without their sign".to_owned(),
    };
    format!("{}, and the numbers seem to be {seems}", said.says())
}

/// Words on what is wrong with the sign of a pressure that is expected to be above or below the atmosphere.
pub(super) fn lost_sign(expected_kpa: f64) -> &'static str {
    if expected_kpa < 0.0 {
        "the sign seems to be lost; below the atmosphere is negative"
    } else {
        "the sign seems to be turned round; above the atmosphere is positive"
    }
}

/// A pressure that is only roughly known, in kPa.
fn about(kpa: f64) -> String {
    let digits = match kpa.abs() {
        10.0.. => 0,
        1.0.. => 1,
        0.1.. => 2,
        _ => 0,
    };
    format!("{kpa:.digits$}")
}

/// A number with four or five figures.
fn figures(number: f64) -> String {
    let digits = match number.abs() {
        1e3.. => 0,
        1e2..1e3 => 1,
        1.0..1e2 => 2,
        _ => 4,
    };
    format!("{number:.digits$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Readings in absolute psi are the gauge pressure in kPa by chance at 17 kPa, where any rig's error decides which is nearer.
    #[test]
    fn a_unit_is_told_by_where_lines_are_apart_and_not_by_where_they_cross() {
        let (atmosphere_kpa, near_kpa) = (101.325, 8.0);
        let psi_abs = |kpa: f64| (kpa + atmosphere_kpa) * 0.145_038;
        let standing = |ends: Vec<[f64; 2]>| Standing {
            channel: 0,
            recorded: ends[0][0],
            simulated: ends[0][1],
            sensor: None,
            scale: 1.0,
            file_unit: None,
            ends,
        };
        let psi = Meaning::Absolute(0.145_038, "psi");
        let crossing = standing(vec![[psi_abs(18.0), 17.2], [psi_abs(81.0), 80.0]]);
        assert!(psi.is_nearer_everywhere(&crossing, atmosphere_kpa, near_kpa));
        // A pressure that is right, and is what psi would make of it at one place.
        let by_chance = standing(vec![[17.1, 17.2], [78.0, 80.0]]);
        assert!(!psi.is_nearer_everywhere(&by_chance, atmosphere_kpa, near_kpa));
    }
}
