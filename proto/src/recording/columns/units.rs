//! Units that loggers write beside their columns, and what a number in them is in the rig's.
//!
//! A unit stands in a row of units under the header, in brackets behind a column's name (`P [mbar]`, `p (psi)`), or in the
//! rig file (`unit = "hPa abs"`). Pressures come out as gauge kPa, times as s, commands as shares of 1. Factors are those of
//! the SI brochure and NIST SP 811.

/// Quantity that a number in a unit measures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Unit {
    /// Pressure against the open air: kPa per unit.
    Gauge(f64),
    /// Pressure against vacuum: kPa per unit.
    Absolute(f64),
    /// Time: s per unit.
    Time(f64),
    /// Electric: V per unit.
    Volt(f64),
    /// A current loop of 4 … 20 mA: mA per unit.
    Loop(f64),
    /// Share of 1 per unit.
    Share(f64),
    /// Something that is no pressure, no time and no command (a flow, a temperature, a current).
    Other,
}

/// kPa per unit of pressure.
const PRESSURES: [(&str, f64); 48] = [
    ("kpa", 1.0),
    ("pa", 1e-3),
    ("hpa", 0.1),
    ("mpa", 1e3),
    ("bar", 100.0),
    ("mbar", 0.1),
    ("psi", 6.894_757_293_168),
    ("lbf/in2", 6.894_757_293_168),
    ("mmhg", 0.133_322_387_415),
    ("torr", 0.133_322_368_421),
    ("inhg", 3.386_389),
    ("cmh2o", 0.098_066_5),
    ("mmh2o", 0.009_806_65),
    ("mmwc", 0.009_806_65),
    ("inh2o", 0.249_088_91),
    ("inwc", 0.249_088_91),
    ("mh2o", 9.806_65),
    ("mwc", 9.806_65),
    ("atm", 101.325),
    ("at", 98.066_5),
    ("kgf/cm2", 98.066_5),
    ("n/m2", 1e-3),
    ("n/mm2", 1e3),
    ("kn/m2", 1.0),
    ("kg/cm2", 98.066_5),
    ("dbar", 10.0),
    ("ubar", 1e-4),
    ("cmhg", 1.333_223_874_15),
    ("mmws", 0.009_806_65),
    ("cmws", 0.098_066_5),
    ("mws", 9.806_65),
    ("pascal", 1e-3),
    ("hectopascal", 0.1),
    ("kilopascal", 1.0),
    ("megapascal", 1e3),
    ("millibar", 0.1),
    ("bars", 100.0),
    ("mbars", 0.1),
    ("pascals", 1e-3),
    ("hectopascals", 0.1),
    ("kilopascals", 1.0),
    ("megapascals", 1e3),
    ("millibars", 0.1),
    ("decibar", 10.0),
    ("decibars", 10.0),
    ("microbar", 1e-4),
    ("microbars", 1e-4),
    ("atmospheres", 101.325),
];

/// s per unit of time.
const TIMES: [(&str, f64); 17] = [
    ("s", 1.0),
    ("sec", 1.0),
    ("secs", 1.0),
    ("second", 1.0),
    ("seconds", 1.0),
    ("ms", 1e-3),
    ("msec", 1e-3),
    ("milliseconds", 1e-3),
    ("us", 1e-6),
    ("microseconds", 1e-6),
    ("ns", 1e-9),
    ("nanoseconds", 1e-9),
    ("min", 60.0),
    ("minutes", 60.0),
    ("h", 3600.0),
    ("hours", 3600.0),
    ("days", 86_400.0),
];

/// Units (and what data loggers write for those of a time stamp and a record number) of what a rig neither reads nor is commanded by, which make a row of units one all the same.
const OTHERS: [&str; 25] = [
    "a", "w", "hz", "khz", "rpm", "1/min", "c", "degc", "f", "degf", "k", "l/min", "lpm", "slpm", "l/s", "ml/s",
    "ml/min", "n", "mm", "m", "deg", "v/v", "count", "ts", "rn",
];

impl Unit {
    /// The unit that a text names; `None` where it names none.
    ///
    /// Case does not count, but for `mPa` (which nobody measures a chamber in) and `MPa`, taken as MPa both. `g` and `gauge`,
    /// `a`, `abs` and `absolute` say against what a pressure is measured; without a word it is gauge.
    pub(crate) fn parse(text: &str) -> Option<Self> {
        let text = text.trim();
        let within = |open, close| text.strip_prefix(open).and_then(|rest| rest.strip_suffix(close));
        let bare = within('[', ']').or_else(|| within('(', ')')).unwrap_or(text).trim();
        let plain: String = bare
            .chars()
            .map(|c| match c {
                'µ' | 'μ' => 'u',
                '₂' | '²' => '2',
                '°' => ' ',
                'Ü' => 'ü',
                c => c.to_ascii_lowercase(),
            })
            // `kPa (gauge)`, `bar(a)`: brackets within a unit are as good as none, and so is the mark before an exponent (`N/m^2`).
            .filter(|c| !c.is_whitespace() && !matches!(c, '_' | '.' | '^' | '(' | ')'))
            .collect();
        match plain.as_str() {
            "%" | "percent" | "pct" => return Some(Unit::Share(0.01)),
            "‰" | "permille" | "permil" => return Some(Unit::Share(1e-3)),
            "-" | "1" | "--" | "none" | "duty" | "0-1" | "0…1" | "bool" | "onoff" | "on/off" => {
                return Some(Unit::Share(1.0));
            }
            "0-255" | "0…255" | "8bit" => return Some(Unit::Share(1.0 / 255.0)),
            "v" | "volt" | "volts" | "vdc" => return Some(Unit::Volt(1.0)),
            "mv" => return Some(Unit::Volt(1e-3)),
            "ma" | "madc" => return Some(Unit::Loop(1.0)),
            _ => {}
        }
        let of =
            |table: &[(&str, f64)], name: &str| table.iter().find(|(unit, _)| *unit == name).map(|(_, factor)| *factor);
        if let Some(s) = of(&TIMES, &plain) {
            return Some(Unit::Time(s));
        }
        if let Some(kpa) = of(&PRESSURES, &plain) {
            return Some(Unit::Gauge(kpa));
        }
        // The longest ending first: `bara` before `a`, `abs` before nothing.
        for (ending, absolute) in [
            ("absolute", true),
            ("abs", true),
            ("gauge", false),
            ("relative", false),
            ("rel", false),
            // `barü`, and `ue` where a logger has no umlaut: against the air, in German.
            ("ü", false),
            ("ue", false),
            ("g", false),
            ("a", true),
        ] {
            if let Some(kpa) = plain.strip_suffix(ending).and_then(|unit| of(&PRESSURES, unit)) {
                return Some(if absolute { Unit::Absolute(kpa) } else { Unit::Gauge(kpa) });
            }
        }
        OTHERS.contains(&plain.as_str()).then_some(Unit::Other)
    }

    /// The unit at the end of a column's name, in brackets (`p [kPa]`), behind a stroke as ISO 80000 has it (`p / kPa`) or behind `in`,
    /// and the name before it.
    pub(crate) fn in_name(name: &str) -> Option<(&str, &str)> {
        let name = name.trim();
        let apart = [" / ", " in "].into_iter().find_map(|mark| name.rsplit_once(mark));
        // `flow / n` is a ratio more often than a flow in newtons.
        let is_sure = |unit: &str| Unit::parse(unit).is_some_and(|unit| unit != Unit::Other);
        if let Some((before, unit)) = apart.filter(|(before, unit)| !before.trim().is_empty() && is_sure(unit)) {
            return Some((before.trim_end(), unit.trim()));
        }
        if let Some((before, unit)) = name.rsplit_once('/').filter(|(before, unit)| is_over(before, unit)) {
            return Some((before.trim_end(), unit.trim()));
        }
        let (open, close) = [('[', ']'), ('(', ')')].into_iter().find(|(_, close)| name.ends_with(*close))?;
        // The bracket that the last one closes: `p (kPa(g))`.
        let mut depth = 0_i32;
        let start = name.char_indices().rev().find_map(|(at, c)| {
            depth += i32::from(c == close) - i32::from(c == open);
            (depth == 0).then_some(at)
        })?;
        let inside = name.get(start + 1..name.len() - 1)?;
        let before = name.get(..start)?.trim_end();
        (!before.is_empty() && Unit::parse(inside).is_some()).then_some((before, inside))
    }
}

/// Tells whether a stroke without blanks stands between a name and its unit (`p/kPa`, `Time/s`), and not within a unit (`l/min`), nor
/// between what is divided (`on/off`).
fn is_over(before: &str, unit: &str) -> bool {
    let of_time = ["time", "zeit", "stamp", "elapsed"].iter().any(|word| before.to_ascii_lowercase().contains(word));
    let is_one = match Unit::parse(unit) {
        // Anything may go on by the second.
        Some(Unit::Time(_)) => of_time || before.eq_ignore_ascii_case("t"),
        Some(Unit::Other) | None => false,
        Some(_) => unit.contains(char::is_alphabetic) || unit.trim() == "%",
    };
    let is_unit = |word: &str| Unit::parse(word).is_some();
    is_one && before.split_whitespace().next_back().is_some_and(|word| !is_unit(word))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_what_they_are_called() {
        for (text, unit) in [
            ("kPa", Unit::Gauge(1.0)),
            ("[mbar]", Unit::Gauge(0.1)),
            ("(hPa)", Unit::Gauge(0.1)),
            ("psig", Unit::Gauge(6.894_757_293_168)),
            ("psia", Unit::Absolute(6.894_757_293_168)),
            ("bar(a)", Unit::Absolute(100.0)),
            ("bara", Unit::Absolute(100.0)),
            ("kPa (gauge)", Unit::Gauge(1.0)),
            ("[mbar (absolute)]", Unit::Absolute(0.1)),
            ("kPa(rel.)", Unit::Gauge(1.0)),
            ("kPa abs", Unit::Absolute(1.0)),
            ("kPa_gauge", Unit::Gauge(1.0)),
            ("Pa", Unit::Gauge(1e-3)),
            ("cmH₂O", Unit::Gauge(0.098_066_5)),
            ("V", Unit::Volt(1.0)),
            ("mV", Unit::Volt(1e-3)),
            ("mA", Unit::Loop(1.0)),
            ("N/m^2", Unit::Gauge(1e-3)),
            ("kgf/cm^2", Unit::Gauge(98.066_5)),
            ("Pascal", Unit::Gauge(1e-3)),
            ("kilopascals (abs.)", Unit::Absolute(1.0)),
            ("mbarÜ", Unit::Gauge(0.1)),
            ("mmWS", Unit::Gauge(0.009_806_65)),
            ("cmHg", Unit::Gauge(1.333_223_874_15)),
            ("%", Unit::Share(0.01)),
            ("‰", Unit::Share(1e-3)),
            ("-", Unit::Share(1.0)),
            ("ms", Unit::Time(1e-3)),
            ("µs", Unit::Time(1e-6)),
            ("°C", Unit::Other),
            ("L/min", Unit::Other),
        ] {
            assert_eq!(Unit::parse(text), Some(unit), "{text}");
        }
        for text in ["", "Sensor 3", "run_1.csv", "pressure", "3.5"] {
            assert_eq!(Unit::parse(text), None, "{text}");
        }
    }

    #[test]
    fn units_in_names_are_found() {
        assert_eq!(Unit::in_name("P [mbar]"), Some(("P", "mbar")));
        assert_eq!(Unit::in_name("chamber 1 (kPa(g))"), Some(("chamber 1", "kPa(g)")));
        assert_eq!(Unit::in_name("p / kPa"), Some(("p", "kPa")));
        assert_eq!(Unit::in_name("p_kpa [kPa (gauge)]"), Some(("p_kpa", "kPa (gauge)")));
        assert_eq!(Unit::in_name("duty in %"), Some(("duty", "%")));
        assert_eq!(Unit::in_name("p_pos_kpa/bar"), Some(("p_pos_kpa", "bar")));
        assert_eq!(Unit::in_name("Time/s"), Some(("Time", "s")));
        assert_eq!(Unit::in_name("u/%"), Some(("u", "%")));
        for name in ["l/min", "flow l/min", "on/off", "date/time", "kPa/s", "p/s", "V/V", "1/min"] {
            assert_eq!(Unit::in_name(name), None, "{name}");
        }
        assert_eq!(Unit::in_name("valve (left)"), None);
        assert_eq!(Unit::in_name("plug in c"), None);
        assert_eq!(Unit::in_name("[kPa]"), None);
    }
}
