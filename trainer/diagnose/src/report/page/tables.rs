//! Tables of the page.

use fit::objective::Fitted;
use fit::parameters::End;
use fit::wording::percent;
use report::Table;

use super::{rival_name, shows_extended};
use crate::locate::Suspect;
use crate::report::findings::Findings;
use crate::report::wording::{short, three};
use proto::diagnosis::FoundMechanism;

/// Candidates of a round that are shown.
const MOST_SHOWN: usize = 6;

pub(super) fn found_table(mechanisms: &[FoundMechanism]) -> Table {
    let mut table = Table::new([
        "mechanism",
        "where",
        "parameter",
        "value",
        "90 % interval",
        "unit",
        "gain in log-likelihood",
        "own gain",
    ]);
    for m in mechanisms {
        for (at, (name, p)) in m.parameters.iter().enumerate() {
            // What belongs to the mechanism as a whole stands once.
            let once = |text: String| if at == 0 { text } else { String::new() };
            table.push([
                once(m.id.clone()),
                once(m.component.replace(',', ", ")),
                name.clone(),
                if p.undetermined { "not told".to_owned() } else { three(p.value) },
                format!("{} … {}", three(p.low), three(p.high)),
                p.unit.clone(),
                once(gain_in_words(m.evidence.delta_log_likelihood)),
                once(percent(m.evidence.held_out_rmse_gain, 0)),
            ]);
        }
    }
    table
}

/// Gain in log-likelihood from which on its size says nothing but that the readings have next to no noise.
const BEYOND_DOUBT: f64 = 1e6;

fn gain_in_words(gain: f64) -> String {
    if gain.abs() < BEYOND_DOUBT { format!("{gain:+.0}") } else { "beyond doubt".to_owned() }
}

pub(super) fn horizons(findings: &Findings<'_, '_>) -> Table {
    // A quick search leaves the windows out.
    let windows = !findings.given.one_second.is_empty();
    let mut head = vec!["RMSE in kPa", "rig", "open loop"];
    if windows {
        head.extend(["10 s", "1 s"]);
    }
    head.push("accuracy, open loop");
    let mut table = Table::new(head);
    for (channel, column) in findings.bench.records.sensors().iter().enumerate() {
        let mut rigs = vec![("as given", &findings.given), ("parameters fitted", &findings.reidentified)];
        if shows_extended(findings) {
            rigs.push(("with what was found", &findings.extended));
        }
        for (at, (name, f)) in rigs.into_iter().enumerate() {
            let mut row = vec![if at == 0 { column.clone() } else { String::new() }, name.to_owned()];
            let horizons = [&f.free, &f.ten_seconds, &f.one_second];
            for errors in horizons.into_iter().take(if windows { 3 } else { 1 }) {
                row.push(errors.get(channel).map_or(String::new(), |e| format!("{:.3}", e.rmse_kpa)));
            }
            let accuracy = f.accuracy.get(channel).copied().filter(|a| a.is_finite());
            row.push(accuracy.map_or(String::new(), |a| percent(a, 2)));
            table.push(row);
        }
    }
    table
}

pub(super) fn suspects(findings: &Findings<'_, '_>) -> Table {
    let volume = |channel: &usize| {
        findings.bench.rig.sensors.values().nth(*channel).map_or_else(String::new, |s| s.volume.clone())
    };
    let mut table = Table::new(["switched on alone", "gain in log-likelihood", "time scale (s)", "size"]).caption(
        "Each equation given a free error of its own, one at a time: which one explains the most? An error that may be \
         anything at any time gains far more than a mechanism can. Time scales and sizes are the best of a coarse grid.",
    );
    for s in &findings.missing.suspicions {
        let (name, unit) = match &s.suspect {
            Suspect::Balance { channel } => (format!("mass balance, {}", volume(channel)), "kPa/s"),
            Suspect::Transfer { from, to } => (format!("pump flow {} → {}", volume(from), volume(to)), "kPa/s"),
            Suspect::Reading { channel } => (format!("reading, {}", volume(channel)), "kPa"),
        };
        table.push([name, gain_in_words(s.gain), s.length_s.to_string(), format!("{} {unit}", s.size)]);
    }
    table
}

pub(super) fn tried(findings: &Findings<'_, '_>) -> Table {
    let mut table = Table::new(["on top of", "mechanism", "gain in log-likelihood", ""]).caption(
        "The best candidates of each round. Gains are those of a short fit, on the fitted rows and prior included; several \
         were then fitted to the end, and what was best after that is marked.",
    );
    let name = |k: &usize| findings.candidates.get(*k).map_or_else(String::new, |c| short(findings, c));
    for round in &findings.found.rounds {
        let base = if round.base.is_empty() {
            "parameters alone".to_owned()
        } else {
            round.base.iter().map(name).collect::<Vec<_>>().join(" + ")
        };
        let became = if round.taken { "taken" } else { "below the bar" };
        let best = |k: usize| round.best.as_slice() == [k];
        let shown = round.ranked.iter().enumerate().filter(|(at, r)| *at < MOST_SHOWN || best(r.candidate));
        for (_, ranked) in shown {
            let mark = if best(ranked.candidate) { became } else { "" };
            table.push([base.clone(), name(&ranked.candidate), format!("{:+.1}", ranked.gain), mark.to_owned()]);
        }
        // At two places at once, or in a plainer shape than was ranked.
        if !round.ranked.iter().any(|r| best(r.candidate)) && !round.best.is_empty() {
            let names = round.best.iter().map(name).collect::<Vec<_>>().join(" + ");
            let gain = round.evidence.map_or(String::new(), |e| format!("{:+.1}", e.posterior));
            table.push([base, names, gain, became.to_owned()]);
        }
    }
    table
}

/// Errors of each competing hypothesis, on validation data and on other rows.
pub(super) fn hypotheses(findings: &Findings<'_, '_>) -> Table {
    let mut table = Table::new(["hypothesis", "off by on validation data, kPa", "on other rows, kPa"]);
    for (at, rival) in findings.judgement.rivals.iter().enumerate() {
        let bench = findings.bench;
        let squares = bench.squares_by_channel(&rival.trace, false);
        let others_kpa = (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt();
        let validation_kpa = bench.validation_kpa(&rival.trace);
        table.push([rival_name(findings, at), format!("{validation_kpa:.3}"), format!("{others_kpa:.3}")]);
    }
    table
}

pub(super) fn separation(findings: &Findings<'_, '_>) -> Table {
    let mut table = Table::new(["one", "other", "expected difference in log-likelihood"])
        .caption("How far apart the experiment will drive them, all that either could still adjust allowed for.");
    if let Some(plan) = &findings.plan {
        for (one, other, half_d) in &plan.separation {
            table.push([rival_name(findings, *one), rival_name(findings, *other), format!("{half_d:.0}")]);
        }
    }
    table
}

pub(super) fn parameters(findings: &Findings<'_, '_>) -> Table {
    let extended = shows_extended(findings);
    let mut head = vec!["parameter", "given", "fitted", "± sd", "shift"];
    let mut caption = "Shift: fitted less given, in standard deviations of what was known before.".to_owned();
    if extended {
        head.extend(["found", "± sd"]);
        caption.push_str(" Found: fitted again together with what was found.");
    }
    head.push("unit");
    let mut table = Table::new(head).caption(&caption);
    let best = &findings.found.best;
    for (at, e) in findings.found.nominal.fitted.estimates.iter().enumerate() {
        let [value, sd] = value_and_sd(&findings.found.nominal.fitted, at);
        let mut row = vec![e.parameter.path.clone(), three(e.parameter.mean), value, sd, format!("{:+.1}", e.shift)];
        if extended {
            row.extend(value_and_sd(&best.fitted, at));
        }
        row.push(e.parameter.unit().to_owned());
        table.push(row);
    }
    table
}

/// An estimate and its standard error; of what has no limit the side that it is on, and no error.
fn value_and_sd(fitted: &Fitted, at: usize) -> [String; 2] {
    match (fitted.estimates.get(at), fitted.runaway(at)) {
        (None, _) => [String::new(), String::new()],
        (Some(e), None) => [three(e.value), three(e.sd)],
        (Some(_), Some(runaway)) => {
            let side = if runaway.end == End::High { "above" } else { "below" };
            [format!("{side} {}", three(runaway.beyond)), "no limit".to_owned()]
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use proto::diagnosis::{FoundEvidence, FoundParameter};
    use report::Report;

    use super::*;

    /// A number that the recordings do not tell stands nowhere in the table, its interval does.
    #[test]
    fn a_number_that_is_not_told_is_not_shown() {
        let number = |value: f64, undetermined: bool| FoundParameter {
            value,
            unit: "ms".to_owned(),
            low: 0.125,
            high: 900.0,
            at_end_of_range: None,
            undetermined,
        };
        let found = FoundMechanism {
            id: "sensor_lag".to_owned(),
            side: "positive".to_owned(),
            component: "sensor_pos".to_owned(),
            summary: String::new(),
            parameters: BTreeMap::from([
                ("known_ms".to_owned(), number(23.4, false)),
                ("unknown_ms".to_owned(), number(56.7, true)),
            ]),
            evidence: FoundEvidence { delta_log_likelihood: 100.0, held_out_rmse_gain: 0.5 },
            rivals: Vec::new(),
        };
        let page = Report::new("Report").table(found_table(&[found])).to_html();
        assert!(page.contains("23.4") && page.contains("unknown_ms") && page.contains("not told"), "{page}");
        assert!(!page.contains("56.7") && page.matches("0.125 … 900").count() == 2, "{page}");
    }
}
