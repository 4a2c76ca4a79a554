//! Ranges that loggers write a command over, and the key that brings each to a share of 1.
//!
//! A converter's output is written as it leaves it: a current loop, a voltage, the width of a servo's pulse, counts of some bits, percent.
//! Where a range does not begin at nought (4 … 20 mA), its numbers never go below its begin, and a scale alone would make a duty of a
//! closed valve. Which range it is nobody can tell for certain, so where two are likely both are told.

use crate::recording::columns::units::Unit;
use crate::recording::csv::numbers::figures;
use crate::recording::csv::toml_text;

/// Figures of a scale that is told: full scales of 16 bits must come out as 1 to less than a rounding.
const FIGURES: usize = 6;
/// Share of a range within which a number is at its end.
const AT_END: f64 = 0.02;
/// Share of a range from whose end on it is reached as good as in full, and no larger one is likely.
const FILLED: f64 = 0.95;
/// Ranges that are told at most.
const TOLD: usize = 4;
/// Share by which numbers are near to a range's begin, or to 0 … 1.
const NEARLY: f64 = 0.1;
const PERCENT: &str = "percent";
/// Share of a range that its numbers may lie outside, as measured ones do; …
const OUTSIDE: f64 = 0.01;
/// … from this share on its ends are told as they were measured, so that the key that is told leaves nothing outside 0 … 1.
const MEASURED: f64 = 5e-4;

/// The unit that a range is written in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Written {
    Milliamperes,
    Volts,
    Microseconds,
    Numbers,
}

/// Numbers that a command is written over.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Range {
    shut: f64,
    open: f64,
    called: &'static str,
    written: Written,
}

const fn range(shut: f64, open: f64, called: &'static str, written: Written) -> Range {
    Range { shut, open, called, written }
}

/// Ranges that begin above nought: nothing below their begin is ever written.
const LIVE_ZERO: [Range; 5] = [
    range(4.0, 20.0, "4 … 20 mA", Written::Milliamperes),
    range(1.0, 5.0, "1 … 5 V", Written::Volts),
    range(2.0, 10.0, "2 … 10 V", Written::Volts),
    range(1000.0, 2000.0, "pulses of 1000 … 2000 µs", Written::Microseconds),
    range(1.0, 2.0, "pulses of 1 … 2 ms", Written::Numbers),
];
/// Ranges from nought on, smallest first.
const FROM_NOUGHT: [Range; 16] = [
    range(0.0, 5.0, "0 … 5 V", Written::Volts),
    range(0.0, 10.0, "0 … 10 V", Written::Volts),
    range(0.0, 20.0, "0 … 20 mA", Written::Milliamperes),
    range(0.0, 24.0, "0 … 24 V", Written::Volts),
    range(0.0, 100.0, PERCENT, Written::Numbers),
    range(0.0, 127.0, "counts of 7 bits", Written::Numbers),
    range(0.0, 180.0, "a servo's 0 … 180 degrees", Written::Numbers),
    range(0.0, 255.0, "counts of 8 bits", Written::Numbers),
    range(0.0, 1000.0, "per mille", Written::Numbers),
    range(0.0, 1023.0, "counts of 10 bits", Written::Numbers),
    range(0.0, 4095.0, "counts of 12 bits", Written::Numbers),
    range(0.0, 5000.0, "0 … 5000 mV", Written::Numbers),
    range(0.0, 10_000.0, "hundredths of a percent, or 0 … 10 V in mV", Written::Numbers),
    range(0.0, 27_648.0, "a PLC's 0 … 27648", Written::Numbers),
    range(0.0, 32_767.0, "counts of 15 bits", Written::Numbers),
    range(0.0, 65_535.0, "counts of 16 bits", Written::Numbers),
];
/// Ranges on both sides of nought, smallest first.
const BOTH_SIDES: [Range; 6] = [
    range(-1.0, 1.0, "-1 … 1", Written::Numbers),
    range(-5.0, 5.0, "±5 V", Written::Volts),
    range(-10.0, 10.0, "±10 V", Written::Volts),
    range(-100.0, 100.0, "±100 percent", Written::Numbers),
    range(-127.0, 127.0, "signed counts of 8 bits", Written::Numbers),
    range(-32_768.0, 32_767.0, "signed counts of 16 bits", Written::Numbers),
];

impl Range {
    fn span(&self) -> f64 {
        self.open - self.shut
    }

    /// Tells whether all numbers lie in it.
    fn holds(&self, [least, most]: [f64; 2]) -> bool {
        let outside = OUTSIDE * self.span();
        least >= self.shut - outside && most <= self.open + outside
    }

    fn begins_at(&self, least: f64) -> bool {
        least <= self.shut + AT_END * self.span()
    }

    fn ends_at(&self, most: f64) -> bool {
        most >= self.open - AT_END * self.span()
    }
}

/// The straight line that a range stands for, as keys of a term.
fn keys(shut: f64, open: f64) -> String {
    let scale = figures(1.0 / (open - shut), FIGURES);
    let offset = figures(-shut / (open - shut), FIGURES);
    // A range of the other sign has a begin of -0.
    if shut == 0.0 { format!("scale = {scale:?}") } else { format!("scale = {scale:?}, offset = {offset:?}") }
}

/// Ranges that numbers of a unit may be written over, the likeliest first; none where they are shares of 1 but for an offset, or of a range
/// that is not known here.
fn likely(ends: [f64; 2], written: Option<Written>) -> Vec<&'static Range> {
    let [least, most] = ends;
    let is_asked = |range: &&'static Range| written.is_none_or(|unit| range.written == unit) && range.holds(ends);
    if written.is_none() && least > -NEARLY && most < 1.0 + NEARLY {
        return Vec::new();
    }
    // Where the smallest is reached to its end, the next larger one is not likely.
    let smallest = |ranges: &'static [Range], reached: f64| {
        let fitting: Vec<&'static Range> = ranges.iter().filter(is_asked).take(2).collect();
        let is_filled = fitting.first().is_some_and(|first| FILLED * first.open <= reached);
        let told = if is_filled { 1 } else { fitting.len() };
        (fitting.into_iter().take(told).collect::<Vec<_>>(), is_filled)
    };
    if least < -OUTSIDE * most.abs() {
        return smallest(&BOTH_SIDES, most.max(-least)).0;
    }
    let (near, far): (Vec<&'static Range>, Vec<&'static Range>) =
        LIVE_ZERO.iter().filter(is_asked).partition(|range| least <= range.shut + NEARLY * range.span());
    if let Some(of_both_ends) = near.iter().find(|range| range.begins_at(least) && range.ends_at(most)) {
        return vec![*of_both_ends];
    }
    let (mut from_nought, is_filled) = smallest(&FROM_NOUGHT, most);
    let percent = FROM_NOUGHT.iter().find(|range| range.called == PERCENT).filter(is_asked).filter(|_| !is_filled);
    if let Some(percent) = percent {
        from_nought.retain(|range| range.called != PERCENT);
        // Most people write a percentage, and hardly anybody a few percent of it alone.
        match most {
            ..12.0 => from_nought.push(percent),
            ..24.0 => from_nought.insert(0, percent),
            _ => from_nought = vec![percent],
        }
    }
    near.into_iter().chain(from_nought).chain(far).take(TOLD).collect()
}

/// Says by what a command outside 0 … 1 is scaled, and the key that says so: for the ranges that its numbers may be written over, and for their
/// own ends where they are of none of these.
pub(crate) fn hint(name: &str, from: &str, numbers: &[f64]) -> String {
    let [least, most] = ends(numbers);
    let ranges: Vec<Range> = if least < -NEARLY && most <= 0.0 {
        let turned = likely([-most, -least], None);
        let turned = turned.iter().map(|of| range(-of.shut, -of.open, of.called, of.written));
        let turned: Vec<Range> = turned.collect();
        if turned.is_empty() {
            vec![range(0.0, -1.0, "a share of 1 with its sign turned round", Written::Numbers)]
        } else {
            turned
        }
    } else {
        likely([least, most], None).into_iter().copied().collect()
    };
    let is_percent = ranges.first().is_some_and(|range| range.called == PERCENT);
    let what = if is_percent { "a duty is a share, not a percentage" } else { "a command is a share of 1" };
    let key = told(name, from, [least, most], &ranges);
    let [least, most] = [least, most].map(|end| figures(end, 5));
    let reaches =
        if least == 0.0 { format!("{name} reaches {most}") } else { format!("{name} goes from {least} to {most}") };
    format!("; {what}, and {reaches}: {key}")
}

/// Ends of a command that the rig file scales already: its own ends where they are near to 0 and 1, and all of its numbers as they stand
/// in the file otherwise.
pub(crate) fn of_scaled(name: &str, from: &str, scaled: &[f64], written: &[f64]) -> String {
    let [least, most] = ends(scaled);
    if least < -NEARLY || most > 1.0 + NEARLY {
        return hint(name, from, written);
    }
    let [least, most] = [least, most].map(|end| figures(end, 5));
    format!("; as it is scaled, {name} goes from {least} to {most}: {}", told(name, from, ends(written), &[]))
}

/// The keys for a command whose unit is said to be of current, voltage or time; `None` for other units.
pub(crate) fn of_unit(name: &str, from: &str, unit: &Unit, numbers: &[f64]) -> Option<String> {
    let (written, per) = match unit {
        Unit::Volt(volt) => (Written::Volts, *volt),
        Unit::Loop(ma) => (Written::Milliamperes, *ma),
        Unit::Time(s) => (Written::Microseconds, 1e6 * s),
        _ => return None,
    };
    let [least, most] = ends(numbers);
    let ranges = likely([least * per, most * per], Some(written));
    let of_numbers: Vec<Range> =
        ranges.iter().map(|of| range(of.shut / per, of.open / per, of.called, of.written)).collect();
    Some(told(name, from, [least, most], &of_numbers))
}

fn ends(numbers: &[f64]) -> [f64; 2] {
    let finite = numbers.iter().copied().filter(|x| x.is_finite());
    let (least, most) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, m), x| (x.min(l), x.max(m)));
    [least, most]
}

/// The key for the first range in full, for the others what is different in it.
fn told(name: &str, from: &str, [least, most]: [f64; 2], ranges: &[Range]) -> String {
    let key = |keys: String| format!("[recording] columns.{name} = {{ from = {}, {keys} }}", toml_text(from));
    let Some((first, others)) = ranges.split_first() else {
        // A range of the rig's own: at least these numbers are in it.
        let open = if most > least { most } else { least + 1.0 };
        return format!(
            "if {} is shut and {} is open, {}",
            figures(least, 5),
            figures(open, 5),
            key(keys(least, open))
        );
    };
    let widened = |of: &Range| {
        let far = MEASURED * of.span();
        let shut = if far > 0.0 && least < of.shut - far { least } else { of.shut };
        let open = if far > 0.0 && most > of.open + far { most } else { of.open };
        keys(shut, open)
    };
    let mut all = format!("for {}, {}", first.called, key(widened(first)));
    for other in others {
        all.push_str(&format!("; for {}, {} instead", other.called, widened(other)));
    }
    all
}

/// Says by what a relay's column is scaled where it has two numbers, and what to do where it has more.
pub(crate) fn of_relay(name: &str, from: &str, numbers: &[f64]) -> String {
    let [least, most] = ends(numbers);
    let is_one_of_two = |x: &f64| *x == least || *x == most;
    if !numbers.iter().filter(|x| x.is_finite()).all(is_one_of_two) {
        return format!(
            "; the pump is on (1) or off (0), and {name} has more than two numbers: write 1 above a threshold and 0 below it"
        );
    }
    // A relay that was never switched is on at what is not nought.
    let shut = if most > least { least } else { 0.0 };
    format!(
        "; the pump is on (1) or off (0): if {most} is on, [recording] columns.{name} = {{ from = {}, {} }}",
        toml_text(from),
        keys(shut, most)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hints(numbers: &[f64]) -> String {
        hint("u", "PWM", numbers)
    }

    #[test]
    fn each_range_is_told_with_its_numbers_and_two_where_two_fit() {
        for (numbers, told, not_told) in [
            (
                &[4.0, 12.3, 20.0][..],
                &["4 … 20 mA", "{ from = \"PWM\", scale = 0.0625, offset = -0.25 }"][..],
                "percent",
            ),
            (&[4.0, 7.5, 11.0], &["4 … 20 mA", "offset = -0.25", "scale = 0.05 instead"], "2 … 10"),
            (&[1000.0, 1600.0, 2000.0], &["1000 … 2000 µs", "scale = 0.001, offset = -1.0"], "bits"),
            (&[1000.0, 1400.0], &["1000 … 2000 µs", "counts of 12 bits"], "percent"),
            (&[1.0, 3.0, 5.0], &["1 … 5 V", "scale = 0.25, offset = -0.25"], "0 … 5 V"),
            (&[0.0, 5.0], &["0 … 5 V", "scale = 0.2 }"], "instead"),
            (&[0.0, 4.2], &["0 … 5 V", "scale = 0.2 }", "percent, scale = 0.01 instead"], "mA"),
            (&[0.0, 10.0], &["0 … 10 V", "scale = 0.1 }"], "instead"),
            (&[-1.0, 0.2, 1.0], &["-1 … 1", "scale = 0.5, offset = 0.5 }"], "instead"),
            (&[-10.0, 10.0], &["±10 V", "scale = 0.05, offset = 0.5 }"], "instead"),
            (&[0.0, 80.0], &["not a percentage", "reaches 80", "scale = 0.01 }"], "instead"),
            (&[0.0, 255.0], &["8 bits", "scale = 0.00392157 }"], "instead"),
            (&[0.0, 1023.0], &["10 bits", "scale = 0.000977517 }"], "instead"),
            (&[0.0, 4095.0], &["12 bits", "scale = 0.0002442 }"], "instead"),
            (&[0.0, 65_535.0], &["16 bits", "scale = 1.5259e-5 }"], "instead"),
            (&[-0.02, 0.5, 0.97], &["if -0.02 is shut and 0.97 is open"], "instead"),
            (&[-100.0, -20.0, 0.0], &["percent", "scale = -0.01 }"], "offset"),
            (&[-1.0, 0.0], &["sign turned round", "scale = -1.0 }"], "offset"),
            (&[-0.05, 3.0, 10.0], &["0 … 10 V", "scale = 0.0995025, offset = 0.00497512 }"], "instead"),
            (&[3.98, 7.0, 20.02], &["4 … 20 mA", "scale = 0.0623441, offset = -0.24813 }"], "instead"),
            (&[-3.0, 200_000.0], &["if -3 is shut and 200000 is open", "scale = 4.99993e-6"], "= …"),
        ] {
            let said = hints(numbers);
            assert!(told.iter().all(|part| said.contains(part)), "{numbers:?}: {said}");
            assert!(!said.contains(not_told) && !said.contains("scale = …"), "{numbers:?}: {said}");
        }
    }

    #[test]
    fn a_range_brings_its_own_ends_to_0_and_1() {
        for range in LIVE_ZERO.iter().chain(&FROM_NOUGHT).chain(&BOTH_SIDES) {
            let text = format!("{{ {} }}", keys(range.shut, range.open));
            let number = |key: &str| {
                let behind = text.split_once(&format!("{key} = ")).map_or("0", |(_, behind)| behind);
                behind.split([',', ' ']).next().unwrap().parse::<f64>().unwrap()
            };
            let at = |x: f64| number("scale") * x + number("offset");
            assert!(at(range.shut).abs() < 2e-5 && (at(range.open) - 1.0).abs() < 2e-5, "{text}");
        }
    }

    #[test]
    fn a_relay_of_24_v_and_a_unit_that_is_said_are_told_with_numbers() {
        let said = of_relay("pump_on", "relay", &[24.0, 0.0, 24.0]);
        assert!(said.contains("scale = 0.0416667 }"), "{said}");
        assert!(of_relay("pump_on", "relay", &[0.0, 3.0, 24.0]).contains("threshold"));
        let said = of_unit("u", "u [mA]", &Unit::Loop(1.0), &[4.0, 16.0]).unwrap();
        assert!(said.contains("4 … 20 mA") && said.contains("offset = -0.25") && !said.contains("percent"), "{said}");
        let said = of_unit("u", "u [mV]", &Unit::Volt(1e-3), &[0.0, 10_000.0]).unwrap();
        assert!(said.contains("0 … 10 V") && said.contains("scale = 0.0001 }"), "{said}");
    }
}
