//! Worth of answers: by what the program says, the share of cases in which it is so.
//!
//! A score card asks how often what is concealed is found. Who reads an answer asks the other way round. What comes out
//! goes for rigs like those of the suite, of which a quarter lack nothing: where more lack something, silence is worth less
//! and a name more.

use std::collections::BTreeMap;
use std::fmt::Write;

use serde::{Deserialize, Serialize};

use crate::card::{Share, Spread};
use crate::case::CaseScore;
use crate::free_run::root_mean_square;
use crate::judge::{Name, Outcome};

/// Kinds of answers, in the order in which it is told.
const SAID: [&str; 4] = ["something is named", "nothing is missing", "something unknown is missing", "not decided"];

/// Kind of a last answer: one of [`SAID`].
fn said(answer: &str) -> &'static str {
    match answer {
        "adequate" | "parameters_moved" => SAID[1],
        "unknown_mechanism" => SAID[2],
        "undecided" => SAID[3],
        _ => SAID[0],
    }
}

/// Cases in which an answer of one kind is so.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Kept {
    /// Answers of this kind.
    pub answers: usize,
    /// All that is concealed, and nothing else; or undecided with the truth among the rivals.
    pub whole: usize,
    /// A part of what is concealed, in its place or not.
    pub part: usize,
    /// Nothing false, but there is more than is said: nothing where something is, something unknown that has a name.
    pub more: usize,
    /// A name of what is not there, or rivals without the truth.
    pub wrong: usize,
}

/// Worth of answers.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Worth {
    /// Last answers, by what they say.
    pub answers: BTreeMap<String, Kept>,
    /// Names in last answers of what is there, be it as a small thing that is wrong besides.
    pub names: Share,
    /// Where nothing was said to be missing and something is: what the free run is off by on rows kept back, beside the trace
    /// without noise (kPa, root of the mean of both channels' squares).
    pub missed_kpa: Option<Spread>,
}

impl Worth {
    /// Worth of the answers in these cases.
    pub fn of(cases: &[CaseScore]) -> Self {
        let mut answers: BTreeMap<String, Kept> = BTreeMap::new();
        for case in cases.iter().filter(|case| case.last != Outcome::Failed) {
            let kept = answers.entry(said(&case.answer).to_owned()).or_default();
            kept.answers += 1;
            *match case.last {
                _ if case.falsely_named() => &mut kept.wrong,
                Outcome::Right | Outcome::Undecided => &mut kept.whole,
                Outcome::Partly | Outcome::Misplaced | Outcome::Adjacent => &mut kept.part,
                Outcome::Missed | Outcome::ThoughtUnknown => &mut kept.more,
                Outcome::UndecidedAstray | Outcome::FalseName | Outcome::Failed => &mut kept.wrong,
            } += 1;
        }
        let names: Vec<Name> = cases.iter().flat_map(|case| &case.names).map(|(_, name)| *name).collect();
        let there = |name: &&Name| matches!(name, Name::True | Name::Nuisance);
        let missed =
            cases.iter().filter(|case| case.last == Outcome::Missed).filter_map(|case| case.held_out.extended_kpa);
        Worth {
            answers,
            names: Share { of_them: names.iter().filter(there).count(), all: names.len() },
            missed_kpa: Spread::of(missed.map(root_mean_square)),
        }
    }

    /// As a table to read. Writing to a string cannot fail, so results of `write!` are not looked at.
    pub fn table(&self) -> String {
        let mut text =
            "| the last answer says | so often | all of it, and no more | a part | there is more | it is wrong |\n\
             | --- | --- | --- | --- | --- | --- |\n"
                .to_owned();
        for said in SAID {
            let Some(Kept { answers, whole, part, more, wrong }) = self.answers.get(said) else { continue };
            let percent = |count: &usize| format!("{count} ({:.0} %)", 100.0 * *count as f64 / *answers as f64);
            let cells: Vec<String> = [whole, part, more, wrong].into_iter().map(percent).collect();
            let _ = writeln!(text, "| {said} | {answers} | {} |", cells.join(" | "));
        }
        let Share { of_them, all } = self.names;
        let _ = writeln!(text, "\nOf {all} names {of_them} are of what is there.");
        if let Some(Spread { count, median, ninetieth, .. }) = self.missed_kpa {
            let _ = writeln!(
                text,
                "Where nothing was said to be missing and something is ({count}), the free run is off by {median:.3} kPa in the \
                 median and by {ninetieth:.3} in nine tenths at most, noise aside."
            );
        }
        text
    }
}
