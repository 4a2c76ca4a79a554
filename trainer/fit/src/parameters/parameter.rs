//! One free parameter: how it is scaled and what is known of it beforehand.
//!
//! Fits work in coordinates `z`: the parameter, transformed, less its prior mean, in units of the prior's standard
//! deviation. All coordinates are then of order one, and a Gaussian prior is `½ z²`.

/// Natural variation of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transform {
    /// By factors: areas, volumes, time constants; always positive.
    Log,
    /// By differences: offsets, and anything that may be zero or negative.
    Linear,
}

/// Knowledge of a parameter before the recordings are looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Knowledge {
    /// Gaussian around the rig file's value: `sd` in the parameter's unit, or as a share for [`Transform::Log`].
    Prior {
        /// Standard deviation.
        sd: f64,
    },
    /// Nothing; `scale` is a distance that makes a visible difference (units as `sd`).
    Nothing {
        /// Scale of the coordinate.
        scale: f64,
    },
}

/// A free parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Dotted key of the rig file.
    pub path: String,
    /// Natural variation.
    pub transform: Transform,
    /// The value at coordinate zero: the prior's mean (median for [`Transform::Log`]).
    pub mean: f64,
    /// Knowledge beforehand.
    pub knowledge: Knowledge,
    /// Lowest and highest value, in the parameter's unit.
    pub bounds: [f64; 2],
    /// The part between its bounds in which a search looks first.
    pub range: SearchRange,
}

/// The range in which a search looks for a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SearchRange {
    /// Between its bounds, which say what such a number can be.
    Whole,
    /// About its mean, and further off, up to the bounds, only where it ends up there: a step beyond all measure must not lead astray,
    /// and what was stated must not decide how far off a part may be.
    Growing,
}

/// An end of a range.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// The lower one.
    Low,
    /// The upper one.
    High,
}

/// The factor either way of its mean within which a positive parameter is searched first, and by which its range grows: five times as
/// much or a fifth of what a part is sold as is another part.
const FIRST_FACTOR: f64 = 5.0;
/// The factor beyond which a range does not grow.
const MOST_FACTOR: f64 = 1e4;

/// Share of a bound by which a value beyond it is rounding.
const ROUNDING: f64 = 1e-9;
/// Share of a bound, or of what lies between both, within which a value stands at it.
const AT_AN_END: f64 = 1e-6;

impl Parameter {
    /// A positive parameter with a relative prior.
    pub fn log(path: impl Into<String>, mean: f64, sd: f64) -> Self {
        let bounds = [mean / MOST_FACTOR, mean * MOST_FACTOR];
        let (transform, knowledge) = (Transform::Log, Knowledge::Prior { sd });
        Parameter { path: path.into(), transform, mean, knowledge, bounds, range: SearchRange::Growing }
    }

    /// A parameter that may be negative, with a prior in its unit.
    pub fn linear(path: impl Into<String>, mean: f64, sd: f64) -> Self {
        let bounds = [mean - 20.0 * sd, mean + 20.0 * sd];
        let (transform, knowledge) = (Transform::Linear, Knowledge::Prior { sd });
        Parameter { path: path.into(), transform, mean, knowledge, bounds, range: SearchRange::Whole }
    }

    /// The parameter within other bounds.
    #[must_use]
    pub fn within(mut self, low: f64, high: f64) -> Self {
        self.bounds = [low, high];
        self
    }

    /// The parameter within a factor of five of what is stated, and no further: unlike a search's range, that of the result does not grow.
    /// Parameters without such a range, and narrower bounds, stay as they are.
    #[must_use]
    pub fn near_its_mean(mut self) -> Self {
        if self.range == SearchRange::Growing {
            let [low, high] = self.bounds;
            self.bounds = [low.max(self.mean / FIRST_FACTOR), high.min(self.mean * FIRST_FACTOR)];
            self.range = SearchRange::Whole;
        }
        self
    }

    /// Size of one unit of the coordinate, in the parameter's unit or as a share.
    pub fn scale(&self) -> f64 {
        match self.knowledge {
            Knowledge::Prior { sd } => sd,
            Knowledge::Nothing { scale } => scale,
        }
    }

    /// 1 with a prior, 0 without.
    pub fn prior_weight(&self) -> f64 {
        match self.knowledge {
            Knowledge::Prior { .. } => 1.0,
            Knowledge::Nothing { .. } => 0.0,
        }
    }

    /// The value at a coordinate.
    pub fn value(&self, coordinate: f64) -> f64 {
        let value = match self.transform {
            Transform::Log => self.mean * (self.scale() * coordinate).exp(),
            Transform::Linear => self.mean + self.scale() * coordinate,
        };
        // A bound's coordinate leads back to the bound, not to the next number beyond, which a rig file refuses.
        let [low, high] = self.bounds;
        let limited = value.clamp(low, high);
        if (value - limited).abs() <= ROUNDING * limited.abs() { limited } else { value }
    }

    /// The coordinate of a value.
    pub fn coordinate(&self, value: f64) -> f64 {
        match self.transform {
            Transform::Log => (value / self.mean).ln() / self.scale(),
            Transform::Linear => (value - self.mean) / self.scale(),
        }
    }

    /// The bounds as coordinates.
    pub fn coordinate_bounds(&self) -> [f64; 2] {
        self.bounds.map(|value| self.coordinate(value))
    }

    /// The bounds, as coordinates, of a search that has come to `coordinate`: they grow with the way that it has gone.
    pub fn search_bounds(&self, coordinate: f64) -> [f64; 2] {
        let [low, high] = self.coordinate_bounds();
        if self.range == SearchRange::Whole {
            return [low, high];
        }
        let first = FIRST_FACTOR.ln() / self.scale();
        // The next wider one from where it has come to an end of the last.
        let reach = first * ((coordinate.abs() / first + ROUNDING).floor() + 1.0);
        [low.max(-reach), high.min(reach)]
    }

    /// Says whether a search that began at one coordinate ended at another because its range ended there, and may go on.
    pub fn was_cut_off(&self, began: f64, ended: f64) -> bool {
        let at = |[low, high]: [f64; 2]| ended <= low + ROUNDING || ended >= high - ROUNDING;
        at(self.search_bounds(began)) && !at(self.coordinate_bounds())
    }

    /// The end of its bounds that a value stands at, if it does.
    pub fn end_at(&self, value: f64) -> Option<End> {
        let [low, high] = self.bounds;
        let near = |end: f64| (value - end).abs() <= AT_AN_END * (high - low).min(end.abs().max(ROUNDING));
        if near(low) {
            Some(End::Low)
        } else if near(high) {
            Some(End::High)
        } else {
            None
        }
    }

    /// Interval of the value for an interval of `±by` around `coordinate`, within the bounds.
    pub fn interval(&self, coordinate: f64, by: f64) -> [f64; 2] {
        let [low, high] = self.bounds;
        [self.value(coordinate - by).clamp(low, high), self.value(coordinate + by).clamp(low, high)]
    }

    /// Unit of the parameter by the end of its key, for tables: mm² for `input_area_mm2`.
    pub fn unit(&self) -> &'static str {
        const UNITS: [(&str, &str); 27] = [
            ("_mm2_per_n2", "mm²/N²"),
            ("_mm2_per_n", "mm²/N"),
            ("_per_mm2", "1/mm²"),
            ("_kpa_per_min", "kPa/min"),
            ("_kg_per_s_pa2", "kg/(s Pa²)"),
            ("_kpa_s_per_l", "kPa s/L"),
            ("_l_per_min", "L/min"),
            ("_ml_per_kpa", "mL/kPa"),
            ("_w_per_k", "W/K"),
            ("_per_bar", "1/bar"),
            ("_per_kpa", "1/kPa"),
            ("_kpa_abs", "kPa"),
            ("_kpa_gauge", "kPa"),
            ("_percent", "%"),
            ("_mm2", "mm²"),
            ("_cm2", "cm²"),
            ("_mm", "mm"),
            ("_ml", "mL"),
            ("_rpm", "rev/min"),
            ("_kpa", "kPa"),
            ("_duty", "duty"),
            ("_deg", "°"),
            ("_hz", "Hz"),
            ("_ms", "ms"),
            ("_k", "K"),
            ("_l", "L"),
            ("_s", "s"),
        ];
        UNITS.iter().find(|(ending, _)| self.path.ends_with(ending)).map_or("", |(_, unit)| unit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn coordinates_and_values_are_inverse(mean in 0.01_f64..100.0, sd in 0.001_f64..0.5, z in -4.0_f64..4.0) {
            for parameter in [Parameter::log("a_mm", mean, sd), Parameter::linear("b_k", mean, sd)] {
                // Cancellation of `value − mean` costs up to mean/sd roundings.
                prop_assert!((parameter.coordinate(parameter.value(z)) - z).abs() < 1e-9);
                prop_assert_eq!(parameter.value(0.0), mean);
            }
        }
    }

    #[test]
    fn the_coordinate_of_a_bound_does_not_lead_beyond_it() {
        for mean in [20.0, 33.0, 40.7, 80.0, 181.0] {
            for parameter in [Parameter::log("a_ms", mean, 1.5), Parameter::linear("a_ms", mean, 1.5)] {
                let parameter = Parameter { bounds: [0.3, 320.0], ..parameter };
                for bound in [0.3, 320.0] {
                    let value = parameter.value(parameter.coordinate(bound));
                    // Never beyond it, which a rig file refuses; inside, a rounding does no harm.
                    assert!((0.3..=320.0).contains(&value), "{value:?} {parameter:?}");
                    assert!((value / bound - 1.0).abs() < 1e-12, "{value:?} {parameter:?}");
                }
            }
        }
    }

    #[test]
    fn a_search_range_grows_with_the_way_that_a_search_has_gone() {
        let flow = Parameter::log("pumps.p.flow_l_per_min", 5.0, 0.3);
        let range = |value: f64| flow.search_bounds(flow.coordinate(value)).map(|z| flow.value(z));
        let about = |[low, high]: [f64; 2], expected: [f64; 2]| {
            (low / expected[0] - 1.0).abs() < 1e-6 && (high / expected[1] - 1.0).abs() < 1e-6
        };
        assert!(about(range(5.0), [1.0, 25.0]) && about(range(24.0), [1.0, 25.0]), "{:?}", range(5.0));
        // From the end of one range the next wider one, up to what a rig file accepts.
        assert!(about(range(25.0), [0.2, 125.0]), "{:?}", range(25.0));
        let [began, ended] = [5.0, 25.0].map(|value| flow.coordinate(value));
        assert!(flow.was_cut_off(began, ended) && !flow.was_cut_off(began, ended - 0.1));
        let limited = flow.clone().within(1e-6, 100.0);
        assert!(about(limited.search_bounds(limited.coordinate(30.0)).map(|z| limited.value(z)), [0.2, 100.0]));
        let [began, ended] = [30.0, 100.0].map(|value| limited.coordinate(value));
        assert!(!limited.was_cut_off(began, ended), "a bound does not grow");
        assert_eq!(limited.end_at(limited.value(ended)), Some(End::High));
        assert_eq!(limited.end_at(30.0), None);
        assert_eq!(Parameter::linear("atmosphere.pressure_kpa_abs", 101.3, 0.5).end_at(91.3), Some(End::Low));
    }

    #[test]
    fn a_parameter_near_its_mean_ends_at_a_factor_of_five() {
        let about = |one: f64, other: f64| (one / other - 1.0).abs() < 1e-9;
        let flow = Parameter::log("pumps.p.flow_l_per_min", 5.0, 0.3);
        let near = flow.clone().near_its_mean();
        assert_eq!((near.bounds, near.range), ([1.0, 25.0], SearchRange::Whole));
        // A search that has come to the end of it, or beyond, looks no further; without the bounds it would.
        for value in [5.0, 25.0, 100.0] {
            let [low, high] = near.search_bounds(near.coordinate(value)).map(|z| near.value(z));
            assert!(about(low, 1.0) && about(high, 25.0), "{value}: {low} {high}");
        }
        let [began, ended] = [5.0, 25.0].map(|value| near.coordinate(value));
        assert!(flow.was_cut_off(began, ended) && !near.was_cut_off(began, ended));
        assert_eq!((near.end_at(25.0), near.end_at(1.0)), (Some(End::High), Some(End::Low)));
        // What a rig file accepts is not widened, and what has no growing range keeps its own.
        assert_eq!(flow.within(4.0, 6.0).near_its_mean().bounds, [4.0, 6.0]);
        let pressure = Parameter::linear("atmosphere.pressure_kpa_abs", 101.3, 0.5);
        assert_eq!(pressure.clone().near_its_mean(), pressure);
    }

    #[test]
    fn a_unit_of_the_coordinate_is_a_standard_deviation() {
        assert!((Parameter::log("x", 2.0, 0.1).value(1.0) - 2.0 * 0.1_f64.exp()).abs() < 1e-15);
        assert!((Parameter::linear("x", 2.0, 0.1).value(-1.0) - 1.9).abs() < 1e-15);
    }

    #[test]
    fn units_stand_in_the_path() {
        for (path, unit) in [
            ("valves.v.input_area_mm2", "mm²"),
            ("valves.v.pressure_area_mm2_per_n", "mm²/N"),
            ("volumes.p.volume_l", "L"),
            ("pumps.p.gas_temperature_k", "K"),
            ("mechanisms.valve_lag@v.time_constant_ms", "ms"),
            ("mechanisms.sensor_drift@s.rate_kpa_per_min", "kPa/min"),
            ("mechanisms.valve_force_curve@v.inverse_full_area_per_mm2", "1/mm²"),
            ("mechanisms.valve_force_curve@v.pressure_curvature_mm2_per_n2", "mm²/N²"),
            ("gas.heat_capacity_ratio", ""),
        ] {
            assert_eq!(Parameter::log(path, 1.0, 1.0).unit(), unit, "{path}");
        }
    }
}
