//! Judgement of a flight: findings, a verdict, and one sentence.

use serde::Serialize;

use crate::statistics::{Counterpart, FileState, StatisticsOptions};
use crate::summary::{FlightSummary, RepetitionFigures};
use crate::wording;
use crate::yardstick::{OnWhichRig, Standing};

/// Verdict on a flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// Nothing to look at.
    Good,
    /// It flew, and something is worth a look.
    Look,
    /// Something failed.
    Bad,
}

impl Verdict {
    /// One or two plain words.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Look => "worth a look",
            Self::Bad => "not good",
        }
    }
}

/// Findings that a summary gives reason to look at, the worst first, and the verdict that follows.
pub(crate) fn findings(summary: &FlightSummary, options: &StatisticsOptions) -> (Verdict, Vec<String>) {
    let mut found: Vec<(Verdict, String)> = Vec::new();
    let mut find = |level: Verdict, when: bool, text: &dyn Fn() -> String| {
        if when {
            found.push((level, text()));
        }
    };
    let (bad, look) = (Verdict::Bad, Verdict::Look);
    // A run that was not meant to be longer is no failure; one that never came so far is.
    let short = summary.controlled_s > 0.0 && summary.seconds < summary.settling_s + SHORTEST_S && summary.faults == 0;
    let untold = summary.rmse_pos_kpa.is_none() || summary.rmse_neg_kpa.is_none();
    find(if short { look } else { bad }, untold, &|| {
        format!(
            "no figure for tracking: the rig was not under control with a sound reading for longer than the {} of settling{}",
            wording::seconds(summary.settling_s),
            if short { "; a longer run says more" } else { "" }
        )
    });
    find(look, !untold && summary.tracked_ticks < TELLING_TICKS, &|| {
        format!(
            "only {} count for tracking, behind the {} of settling: too few to say how well it tracks; a longer run says more",
            wording::seconds(summary.tracked_ticks as f64 / 50.0),
            wording::seconds(summary.settling_s)
        )
    });
    for (channel, rmse, limit) in channels(summary) {
        if let Some((rmse, limit)) = above(rmse, limit) {
            find(bad, true, &|| format!("{channel} RMSE {rmse:.3} kPa is above its limit of {limit:.3} kPa"));
        }
    }
    for (index, (channel, rmse, _)) in channels(summary).into_iter().enumerate() {
        if let (Some(yardstick), Some(rmse)) = (options.yardstick, rmse) {
            let over_kpa = yardstick.fallback_kpa[index].map_or(0.0, |fallback| rmse - fallback);
            let proven = summary.tracked_ticks >= PROVEN_TICKS || over_kpa > PLAIN_KPA;
            let level = match yardstick.standing(index, rmse) {
                Standing::Fair => continue,
                Standing::FarWorse if proven => bad,
                Standing::Worse | Standing::FarWorse => look,
            };
            find(level, true, &|| against_fallback(channel, rmse, yardstick.fallback_kpa[index], yardstick.on));
        }
    }
    find(bad, summary.faults > 0, &|| {
        let in_all = if summary.faults > 1 { " in all" } else { "" };
        format!("{}, {} long{in_all}", counted_faults(summary), wording::seconds(summary.fault_s))
    });
    find(bad, summary.crio_trips > 0, &|| {
        format!("the cRIO reported {}", wording::counted(summary.crio_trips, "trip", "trips"))
    });
    find(bad, summary.vented_s > 0.0, &|| format!("vented for {} of the run", wording::seconds(summary.vented_s)));
    find(bad, summary.is_realtime() && summary.deadline_misses > 0, &|| {
        format!("{} of {} missed", wording::count(summary.deadline_misses), deadlines(summary))
    });
    let late = summary.deadline_misses + summary.frames_missing + summary.frames_late;
    if let Some(text) = busy_computer(summary, options).filter(|_| late > 0) {
        find(look, true, &|| text.clone());
    }
    find(bad, summary.records_dropped > 0, &|| {
        format!(
            "{} not recorded: the recorder could not keep up (is the disk slow or full?)",
            wording::counted(summary.records_dropped, "tick", "ticks")
        )
    });
    // The recorder kept all that it was given: the file was damaged afterwards, or there was no tick of that number. In real time
    // the link takes the newest frame of those that queued up while the computer stood still.
    find(look, summary.ticks_skipped > summary.records_dropped, &|| {
        let other = summary.ticks_skipped - summary.records_dropped;
        let why = match options.file_state {
            FileState::Damaged => "the file is damaged",
            FileState::Whole if summary.is_realtime() => "the computer stood still, or the cRIO left frames out",
            FileState::Whole => "frames never came, or a table lacks rows",
        };
        format!(
            "{} without a record ({why}): the figures are those of the others",
            wording::counted(other, "tick", "ticks")
        )
    });
    find(look, summary.sessions > 1, &|| {
        format!("{} sessions: the link was made anew in between", wording::count(summary.sessions))
    });
    let frames = [
        (summary.frames_missing, "did not come"),
        (summary.frames_late, "came late"),
        (summary.frames_damaged, "came damaged"),
    ];
    for (number, what) in frames {
        find(look, number > 0, &|| format!("{} {what}", wording::counted(number, "frame", "frames")));
    }
    for (channel, repetition) in [("positive", summary.repetition_pos), ("negative", summary.repetition_neg)] {
        if let Some(RepetitionFigures { oscillating: true, period_s, amplitude_kpa, .. }) = repetition {
            find(look, true, &|| {
                format!(
                    "the {channel} pressure oscillates every {period_s:.2} s by ±{amplitude_kpa:.2} kPa: perhaps a limit cycle"
                )
            });
        }
    }
    found.sort_by_key(|(level, _)| std::cmp::Reverse(*level));
    let worst = found.first().map_or(Verdict::Good, |(level, _)| *level);
    (worst, found.into_iter().map(|(_, text)| text).collect())
}

/// Ticks that must count before a run says how well it tracks: 5 s, one of the paper's periods.
const TELLING_TICKS: u64 = 250;
/// Ticks that must count before an error is called far worse than the fallback's: 10 s, two of the paper's periods.
const PROVEN_TICKS: u64 = 500;
/// Unless it is worse by so much (kPa) that no stretch of a reference explains it.
const PLAIN_KPA: f64 = 0.5;

/// Beside the settling time, a run that is no longer than this (s) was not meant to say how well it tracks.
const SHORTEST_S: f64 = 1.0;

fn against_fallback(channel: &str, rmse_kpa: f64, fallback_kpa: Option<f64>, on: OnWhichRig) -> String {
    let fallback_kpa = fallback_kpa.unwrap_or(f64::NAN);
    format!(
        "{channel} RMSE {rmse_kpa:.3} kPa is {:.1} times what the feed-forward PI reaches {} ({fallback_kpa:.3} kPa)",
        rmse_kpa / fallback_kpa,
        on.words()
    )
}

/// Ticks that usually take less than this share of their 20 ms are not to blame for one that takes all of it.
const OWN_SHARE: f64 = 0.25;

/// Whose fault it is that something was late, where both ends are on one computer and the program itself is not slow.
fn busy_computer(summary: &FlightSummary, options: &StatisticsOptions) -> Option<String> {
    let median_us = summary.compute_us_p50.filter(|median_us| *median_us < OWN_SHARE * 20_000.0)?;
    if options.counterpart != Counterpart::SameComputer || !summary.is_realtime() {
        return None;
    }
    Some(format!(
        "it was the computer that was late, not the controller: half of the ticks take less than {}; close other programs, or use --fast, which runs in lockstep and has no deadlines",
        wording::short_time(Some(median_us))
    ))
}

/// The run in one sentence.
pub(crate) fn headline(summary: &FlightSummary) -> String {
    let mut parts = vec![tracking(summary)];
    if summary.faults > 0 {
        parts.push(counted_faults(summary));
    }
    if summary.faults == 0 && summary.crio_trips > 0 {
        parts.push(format!("the cRIO tripped {}", times(summary.crio_trips)));
    }
    if summary.vented_s > 0.0 {
        parts.push(format!("vented for {}", wording::seconds(summary.vented_s)));
    }
    parts.push(match (summary.is_realtime(), summary.deadline_misses) {
        (false, _) => "in lockstep, without deadlines".to_owned(),
        (true, 0) => "no deadline missed".to_owned(),
        (true, misses) => format!("{} of {} missed", wording::count(misses), deadlines(summary)),
    });
    if let Some(slowest) = summary.compute_us_max {
        let time = wording::short_time(Some(slowest));
        parts.push(if slowest < 20_000.0 {
            format!("slowest tick {time} of 20 ms")
        } else {
            format!("slowest tick {time}, and a tick has 20 ms")
        });
    }
    format!("{}.", parts.join("; "))
}

fn tracking(summary: &FlightSummary) -> String {
    let (Some(pos), Some(neg)) = (summary.rmse_pos_kpa, summary.rmse_neg_kpa) else {
        return match summary.ticks {
            0 => "No tick was recorded".to_owned(),
            _ => "Controlled too little to say how well it tracks".to_owned(),
        };
    };
    let limits: Vec<String> = channels(summary)
        .into_iter()
        .filter_map(|(channel, rmse, limit)| above(rmse, limit).map(|(_, limit)| (channel, limit)))
        .map(|(channel, limit)| format!("the {channel} one above its limit of {limit:.2} kPa"))
        .collect();
    let limits = if limits.is_empty() { String::new() } else { format!(", {}", limits.join(" and ")) };
    let others = match (summary.fallback_rmse_pos_kpa, summary.fallback_rmse_neg_kpa, summary.yardstick_on) {
        (Some(pos), Some(neg), Some(on)) => format!(" (the feed-forward PI {}: {pos:.2} and {neg:.2})", on.words()),
        _ => String::new(),
    };
    format!("Tracked the pressures to {pos:.2} kPa (positive) and {neg:.2} kPa (negative) RMS{others}{limits}")
}

/// Name, RMSE and limit of both channels.
fn channels(summary: &FlightSummary) -> [(&'static str, Option<f64>, Option<f64>); 2] {
    [
        ("positive", summary.rmse_pos_kpa, summary.rmse_limit_pos_kpa),
        ("negative", summary.rmse_neg_kpa, summary.rmse_limit_neg_kpa),
    ]
}

fn above(rmse: Option<f64>, limit: Option<f64>) -> Option<(f64, f64)> {
    rmse.zip(limit).filter(|(rmse, limit)| rmse > limit)
}

fn counted_faults(summary: &FlightSummary) -> String {
    wording::counted(summary.faults, "fault", "faults")
}

fn deadlines(summary: &FlightSummary) -> String {
    wording::counted(summary.ticks, "deadline", "deadlines")
}

fn times(number: u64) -> String {
    match number {
        1 => "once".to_owned(),
        2 => "twice".to_owned(),
        _ => format!("{} times", wording::count(number)),
    }
}
