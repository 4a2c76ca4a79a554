//! What a column of pressures may hold instead of gauge kPa.
//!
//! Each meaning says what gauge pressure a number would then be; the meaning under which the numbers come closest to
//! what the rig would do is the one told. Units closer to each other than rigs are to their files (bar and atm) share a
//! line.

use model::rig::Sensor;

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
    /// Its place among the channels.
    pub(super) channel: usize,
    /// Median of what was recorded.
    pub(super) recorded: f64,
    /// Median of the simulation, gauge kPa.
    pub(super) simulated: f64,
    /// The channel's sensor.
    pub(super) sensor: Option<&'a Sensor>,
    /// Margins of this channel as a share of those of a rig of 50 kPa or more.
    pub(super) scale: f64,
}

/// What the numbers of a column are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Meaning {
    /// Gauge pressure, so many to 1 kPa.
    Gauge(f64, &'static str),
    /// Absolute pressure, so many to 1 kPa.
    Absolute(f64, &'static str),
    /// The sensor's volts.
    Volts,
    /// Gauge kPa without its sign.
    Unsigned,
}

/// Gauge kPa, as it should be.
pub(super) const RIGHT: Meaning = Meaning::Gauge(1.0, "kPa");

impl Meaning {
    /// All wrong ones.
    pub(super) fn wrong() -> impl Iterator<Item = Meaning> {
        let units = UNITS.into_iter();
        units
            .clone()
            .map(|(per_kpa, unit)| Meaning::Gauge(per_kpa, unit))
            .chain(units.map(|(per_kpa, unit)| Meaning::Absolute(per_kpa, unit)))
            .chain([Meaning::Absolute(1.0, "kPa"), Meaning::Volts, Meaning::Unsigned])
    }

    /// The gauge pressure (kPa) that a number is under this meaning; `None` where it cannot have it.
    fn kpa(self, standing: &Standing<'_>, atmosphere_kpa: f64) -> Option<f64> {
        self.of(standing.recorded, standing.sensor, atmosphere_kpa)
    }

    /// The same of any number that a sensor's column holds.
    pub(super) fn of(self, recorded: f64, sensor: Option<&Sensor>, atmosphere_kpa: f64) -> Option<f64> {
        match self {
            Meaning::Gauge(per_kpa, _) => Some(recorded / per_kpa),
            // Nothing is below vacuum.
            Meaning::Absolute(per_kpa, _) => (recorded > 0.0).then_some(recorded / per_kpa - atmosphere_kpa),
            Meaning::Volts => sensor.map(|sensor| {
                let ([p0, p1], [v0, v1]) = (sensor.range_kpa_gauge, sensor.range_v);
                p0 + (recorded - v0) / (v1 - v0) * (p1 - p0)
            }),
            Meaning::Unsigned => Some(-recorded),
        }
    }

    /// How far this meaning puts a channel from the simulation, in units of `share` of it and `kpa` (at scale 1); above 1 it does
    /// not fit.
    pub(super) fn misfit(self, standing: &Standing<'_>, atmosphere_kpa: f64, [share, kpa]: [f64; 2]) -> f64 {
        let allowed = share * standing.simulated.abs() + kpa * standing.scale;
        self.kpa(standing, atmosphere_kpa).map_or(f64::INFINITY, |p| (p - standing.simulated).abs() / allowed)
    }

    /// What is wrong, and the mend.
    pub(super) fn text(self, standing: &Standing<'_>, atmosphere_kpa: f64) -> String {
        let Standing { recorded, simulated, sensor, .. } = standing;
        let recorded = figures(*recorded);
        let reads = format!("reads {recorded} where about {} kPa are expected", about(*simulated));
        match self {
            Meaning::Gauge(_, unit) => format!("{reads}: the pressure seems to be in {unit}; convert it to gauge kPa"),
            Meaning::Absolute(_, "kPa") => {
                format!("{reads}: the pressure seems to be absolute; subtract the atmosphere's {atmosphere_kpa:.1} kPa")
            }
            Meaning::Absolute(_, unit) => format!(
                "{reads}: the pressure seems to be absolute, in {unit}; convert it to kPa and subtract the atmosphere's \
                 {atmosphere_kpa:.1} kPa"
            ),
            Meaning::Volts => {
                let scale = sensor.map_or_else(String::new, |sensor| {
                    let ([p0, p1], [v0, v1]) = (sensor.range_kpa_gauge, sensor.range_v);
                    format!(" ({v0:.0} … {v1:.0} V are {p0:.0} … {p1:.0} kPa)")
                });
                format!("{reads}: these seem to be the sensor's volts; convert them to gauge kPa{scale}")
            }
            Meaning::Unsigned => format!("{reads}: {}", lost_sign(*simulated)),
        }
    }
}

/// What is wrong with the sign of a pressure that is expected to be above or below the atmosphere.
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
