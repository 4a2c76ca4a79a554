//! The score card as a page to read.

use std::fmt::Write;

use crate::card::{Card, Share, Spread, class_name};
use crate::case::CaseScore;

fn share(share: Share) -> String {
    let percent = share.fraction().map_or_else(|| "–".to_owned(), |fraction| format!("{:.0} %", 100.0 * fraction));
    format!("{} of {} ({percent})", share.of_them, share.all)
}

fn spread(spread: Option<Spread>, digits: usize, unit: &str) -> String {
    spread.map_or_else(
        || "–".to_owned(),
        |s| {
            format!(
                "{:.digits$}{unit} (a tenth below {:.digits$}, a tenth above {:.digits$}; {} values)",
                s.median, s.tenth, s.ninetieth, s.count
            )
        },
    )
}

fn met(fraction: Option<f64>, goal: impl Fn(f64) -> bool) -> &'static str {
    match fraction {
        Some(fraction) if goal(fraction) => "met",
        Some(_) => "missed",
        None => "–",
    }
}

/// The page. Writing to a string cannot fail, so results of `write!` are not looked at.
pub fn page(card: &Card, cases: &[CaseScore]) -> String {
    let mut text = String::new();
    let origin = &card.provenance;
    let _ = write!(
        text,
        "# Score card of `trainer diagnose`\n\nSuite `{}`, seed `{}`, {} cases, commit `{}`, {} cores.\n\n```sh\n{}\n```\n\n",
        origin.suite, origin.seed, card.cases, origin.commit, origin.cores, origin.command
    );
    goals(&mut text, card);
    let _ = write!(text, "## What an answer is worth\n\n{}\n", card.worth.table());
    outcomes(&mut text, card);
    confusion(&mut text, card);
    lines(&mut text, cases);
    text
}

fn goals(text: &mut String, card: &Card) {
    text.push_str("| | result | goal | |\n| --- | --- | --- | --- |\n");
    let mut row = |what: &str, result: String, goal: &str, met: &str| {
        let _ = writeln!(text, "| {what} | {result} | {goal} | {met} |");
    };
    let nulls = card.false_names_on_nulls;
    row("false names on nulls", share(nulls), "0 of 30", met(nulls.fraction(), |fraction| fraction == 0.0));
    row("nulls left undecided", share(card.undecided_nulls), "", "");
    let right = card.right_where_separable;
    row("right where the oracle separates", share(right), "95 %", met(right.fraction(), |fraction| fraction >= 0.95));
    row("false names where it does not", share(card.false_where_inseparable), "0", "");
    row("outside the library: unknown, or its neighbour named", share(card.outside_seen), "85 %", "");
    row("undecided, and the truth among the rivals", share(card.rivals_hold_truth), "95 %", "");
    row("of these decided by the proposed experiment", share(card.experiment_decides), "70 %", "");
    row("experiments within 120 s and -95 to 160 kPa", share(card.safe_experiments), "all", "");
    let median = card.gain.map(|gain| gain.median);
    row("share of the achievable gain", spread(card.gain, 3, ""), "0.95", met(median, |median| median >= 0.95));
    row("the same where the answer is right", spread(card.gain_where_right, 3, ""), "", "");
    row("parameter error, relative", spread(card.parameter_error, 3, ""), "0.10", "");
    let covered = card.coverage;
    row(
        "90 % intervals that hold the truth",
        share(covered),
        "85 to 95 %",
        met(covered.fraction(), |fraction| (0.85..=0.95).contains(&fraction)),
    );
    row("time of a diagnosis", spread(card.wall_s, 0, " s"), "180 s on 2 cores", "");
    row("its processor time", spread(card.cpu_s, 0, " s"), "", "");
    row("no answer", card.failed.to_string(), "0", "");
    for (name, error) in &card.held_out_kpa {
        row(&format!("held-out error, {}", &name[2..]), spread(Some(*error), 3, " kPa"), "", "");
    }
    for (class, right) in &card.right_by_class {
        row(&format!("right: {class}"), share(*right), "", "");
    }
    text.push_str(
        "\nRight is: named at once, all of it and nothing else; or undecided with the truth among the rivals, and named \
         after the proposed experiment was run on the hidden rig. Held-out errors are against the trace without noise.\n\n",
    );
}

fn outcomes(text: &mut String, card: &Card) {
    text.push_str("## Outcomes\n\n| class | outcomes |\n| --- | --- |\n");
    for (class, counts) in &card.outcomes {
        let counts: Vec<String> = counts.iter().map(|(outcome, count)| format!("{outcome} {count}")).collect();
        let _ = writeln!(text, "| {class} | {} |", counts.join(", "));
    }
}

fn confusion(text: &mut String, card: &Card) {
    text.push_str("\n## Confusion table\n\n| concealed | answered (cases) |\n| --- | --- |\n");
    for (concealed, answers) in &card.confusion {
        let mut answers: Vec<(&String, &usize)> = answers.iter().collect();
        answers.sort_by_key(|(_, count)| std::cmp::Reverse(**count));
        let answers: Vec<String> = answers.iter().map(|(answer, count)| format!("{answer} {count}")).collect();
        let _ = writeln!(text, "| {concealed} | {} |", answers.join(", "));
    }
}

fn lines(text: &mut String, cases: &[CaseScore]) {
    text.push_str(
        "\n## Cases\n\n| case | class | concealed | raw kPa | oracle χ² | answered | outcome | after experiment | refit kPa \
         | found kPa | gain | s |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    let error = |pair: Option<[f64; 2]>| pair.map_or_else(|| "–".to_owned(), |[p, n]| format!("{p:.3}/{n:.3}"));
    for case in cases {
        let separation = case.oracle.separation();
        let separation = if separation.is_finite() {
            format!("{separation:.0}{}", if case.separable { "" } else { " (below)" })
        } else {
            "–".to_owned()
        };
        let after = match case.experiments.last() {
            Some(experiment) => format!("{}: {}", experiment.answer, case.last.as_str()),
            None => String::new(),
        };
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {separation} | {} | {} | {after} | {} | {} | {} | {:.0} |",
            case.case,
            class_name(case.class),
            case.concealed,
            case.level_kpa,
            case.trouble.as_deref().unwrap_or(&case.first_answer).replace('|', "/"),
            case.first.as_str(),
            error(case.held_out.refit_kpa),
            error(case.held_out.extended_kpa),
            case.held_out.share().map_or_else(|| "–".to_owned(), |share| format!("{share:.2}")),
            case.took.wall_s,
        );
    }
}
