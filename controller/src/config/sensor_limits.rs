//! Check that the sensors of a rig show the pressures at which a configuration has it vented.

use model::predict::DualPressurePorts;
use model::rig::Rig;
use proto::emulator::load_for_loop;
use proto::rig_file::RigFileError;

use super::Safety;

/// A limit that lies beyond what its sensor shows, so that nothing would ever be vented for it.
#[derive(Debug, thiserror::Error)]
#[error(
    "{rig_file}: {} = {limit_kpa} kPa lies {} or at the end of the range of sensor {sensor} (sensors.{sensor}.range_kpa_gauge ends at {end_kpa} kPa), which never shows it; write {}the range that the sensor has in the rig file",
    side.key(),
    side.beyond(),
    side.other_limit(*end_kpa)
)]
pub struct LimitBeyondSensor {
    /// The rig file, as it is told.
    rig_file: String,
    side: Side,
    limit_kpa: f64,
    sensor: String,
    /// End of the sensor's range on the limit's side.
    end_kpa: f64,
}

/// Reason why a rig cannot be the model of a loop under a configuration's limits.
#[derive(Debug, thiserror::Error)]
pub enum ModelRigError {
    /// The rig cannot be read, or could not stand behind the wire.
    #[error(transparent)]
    File(#[from] RigFileError),
    /// A limit lies beyond what the rig's sensor shows.
    #[error(transparent)]
    Limits(#[from] LimitBeyondSensor),
}

/// Side of a sensor's range on which its limit is.
#[derive(Debug, Clone, Copy)]
enum Side {
    Above,
    Below,
}

impl Side {
    /// The sides of both readings, in the order of [`DualPressurePorts::READING`].
    const OF_READINGS: [Side; 2] = [Side::Above, Side::Below];

    fn key(self) -> &'static str {
        match self {
            Side::Above => "safety.max_pos_kpa",
            Side::Below => "safety.min_neg_kpa",
        }
    }

    fn limit_kpa(self, safety: Safety) -> f64 {
        match self {
            Side::Above => safety.max_pos_kpa,
            Side::Below => safety.min_neg_kpa,
        }
    }

    /// End of a range that may be written from either end.
    fn end_kpa(self, [a, b]: [f64; 2]) -> f64 {
        match self {
            Side::Above => a.max(b),
            Side::Below => a.min(b),
        }
    }

    /// Tells whether a sensor never goes beyond its limit; one that ends there stands still at it.
    fn is_out_of_reach(self, limit_kpa: f64, end_kpa: f64) -> bool {
        match self {
            Side::Above => limit_kpa >= end_kpa,
            Side::Below => limit_kpa <= end_kpa,
        }
    }

    fn beyond(self) -> &'static str {
        match self {
            Side::Above => "above",
            Side::Below => "below",
        }
    }

    /// Words for a limit inside the range, where a configuration may have one: it takes 10 kPa of either pressure at least.
    fn other_limit(self, end_kpa: f64) -> String {
        match self {
            Side::Above if end_kpa > 10.0 => format!("a {} below {end_kpa} kPa in the configuration, or ", self.key()),
            Side::Below if end_kpa < -10.0 => format!("a {} above {end_kpa} kPa in the configuration, or ", self.key()),
            Side::Above | Side::Below => String::new(),
        }
    }
}

/// Reads the rig by which a loop is to be closed, and checks that its sensors show both limits. `given_as` says in errors of the file
/// how it was asked for, where it was.
///
/// # Errors
/// As [`load_for_loop`], or the first limit that its sensor never shows.
pub fn load_within_limits(rig_file: &str, given_as: Option<&str>, safety: Safety) -> Result<Rig, ModelRigError> {
    let rig = load_for_loop(rig_file, given_as)?;
    limits_within_ranges(safety, &rig, rig_file)?;
    Ok(rig)
}

/// Checks that both limits lie inside the ranges of the sensors by which they are watched. A rig without such a sensor is no matter of
/// this check.
///
/// # Errors
/// The first limit that its sensor never shows.
fn limits_within_ranges(safety: Safety, rig: &Rig, rig_file: &str) -> Result<(), LimitBeyondSensor> {
    for (column, side) in DualPressurePorts::READING.into_iter().zip(Side::OF_READINGS) {
        let Some((name, sensor)) = rig.sensor_of(column) else { continue };
        let (limit_kpa, end_kpa) = (side.limit_kpa(safety), side.end_kpa(sensor.range_kpa_gauge));
        if side.is_out_of_reach(limit_kpa, end_kpa) {
            return Err(LimitBeyondSensor {
                rig_file: rig_file.to_owned(),
                side,
                limit_kpa,
                sensor: name.to_owned(),
                end_kpa,
            });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::Config;
    use super::*;

    fn told(safety: Safety, edit: impl Fn(&mut Rig)) -> Option<String> {
        let mut rig = Rig::builtin("dual_pressure").unwrap();
        edit(&mut rig);
        limits_within_ranges(safety, &rig, "r.toml").err().map(|error| error.to_string())
    }

    #[test]
    fn a_limit_that_its_sensor_never_shows_is_told_with_both_keys_and_the_mend() {
        let default = Safety::default();
        let positive = |end_kpa| move |rig: &mut Rig| rig.sensors["sensor_pos"].range_kpa_gauge = [0.0, end_kpa];
        let line = told(default, positive(110.0)).unwrap();
        for words in
            ["r.toml: safety.max_pos_kpa = 160 kPa", "sensors.sensor_pos.range_kpa_gauge ends at 110", "below 110"]
        {
            assert!(line.contains(words) && !line.contains('\n'), "`{words}` is not in: {line}");
        }
        assert!(told(default, positive(160.0)).is_some() && told(default, positive(161.0)).is_none());
        assert!(told(Safety { max_pos_kpa: 105.0, ..default }, positive(110.0)).is_none());
        // Written from either end.
        let negative = |rig: &mut Rig| rig.sensors["sensor_neg"].range_kpa_gauge = [-90.0, 0.0];
        let line = told(default, negative).unwrap();
        assert!(line.contains("safety.min_neg_kpa = -95 kPa") && line.contains("above -90 kPa"), "{line}");
        assert!(told(Safety { min_neg_kpa: -85.0, ..default }, negative).is_none());
    }

    #[test]
    fn a_range_that_no_limit_fits_is_to_be_mended_itself() {
        let default = Safety::default();
        for (sensor, range_kpa_gauge, words) in [
            // A vacuum sensor written with positive numbers.
            ("sensor_neg", [0.0, 101.0], "safety.min_neg_kpa = -95 kPa lies below or at the end"),
            ("sensor_neg", [-10.0, 0.0], "safety.min_neg_kpa = -95 kPa lies below or at the end"),
            ("sensor_pos", [-101.0, 0.0], "safety.max_pos_kpa = 160 kPa lies above or at the end"),
            ("sensor_pos", [0.0, 10.0], "safety.max_pos_kpa = 160 kPa lies above or at the end"),
        ] {
            let line = told(default, |rig| rig.sensors[sensor].range_kpa_gauge = range_kpa_gauge).unwrap();
            assert!(line.contains(words), "{line}");
            assert!(line.ends_with("; write the range that the sensor has in the rig file"), "{line}");
        }
        // Where a limit fits, the configuration takes one.
        for (sensor, range_kpa_gauge, limit) in
            [("sensor_neg", [-10.5, 0.0], "min_neg_kpa = -10.25"), ("sensor_pos", [0.0, 10.5], "max_pos_kpa = 10.25")]
        {
            let narrow = |rig: &mut Rig| rig.sensors[sensor].range_kpa_gauge = range_kpa_gauge;
            assert!(told(default, narrow).unwrap().contains(" in the configuration, or the range"));
            let text = format!("[link]\naddress = \"10.0.0.2:50500\"\n[safety]\n{limit}\n");
            let safety = Config::parse(&text, Path::new("c.toml")).unwrap().safety;
            assert_eq!(told(safety, narrow), None, "{limit}");
        }
    }

    #[test]
    fn the_default_limits_lie_within_the_ranges_of_the_built_in_rigs() {
        for name in Rig::BUILTIN {
            limits_within_ranges(Safety::default(), &Rig::builtin(name).unwrap(), name).unwrap();
        }
    }
}
