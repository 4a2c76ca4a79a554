//! Too short, gaps, uneven time.

use proto::recording::PERIOD_S;

use super::{Finding, Severity, Trouble};
use crate::data::Records;

/// Everything together must last this long, in s: less does not fill one block of 10 s for fitting and one to
/// check on.
const LEAST_TOTAL_S: f64 = 20.0;
/// One recording ought to last this long, in s: a few time constants of the chambers beyond its start.
const LEAST_EACH_S: f64 = 10.0;
/// Steps may scatter by this much, in ms, before a reading's time is in doubt.
const JITTER_MS: f64 = 2.0;
/// And the clock may be off by this share.
const CLOCK: f64 = 0.01;

pub(super) fn check(records: &Records, findings: &mut Vec<Finding>) {
    let total_s = records.rows() as f64 * PERIOD_S;
    if total_s < LEAST_TOTAL_S {
        findings.push(Finding {
            source: String::new(),
            column: String::new(),
            severity: Severity::Unusable,
            trouble: Trouble::TooShort,
            text: format!(
                "too short: {total_s:.1} s in all recordings together; record at least {LEAST_TOTAL_S:.0} s, better \
                 three runs of 100 s"
            ),
        });
    }
    for record in records.records() {
        let add = |severity, trouble, text| Finding {
            source: record.source.clone(),
            column: String::new(),
            severity,
            trouble,
            text,
        };
        let rows = record.time_s.len();
        let seconds = rows as f64 * PERIOD_S;
        if total_s >= LEAST_TOTAL_S && seconds < LEAST_EACH_S {
            findings.push(add(
                Severity::Doubtful,
                Trouble::TooShort,
                format!("short: {seconds:.1} s; it adds little beyond its own start"),
            ));
        }
        if record.segments.len() > 1 {
            let longest = record.segments.iter().map(ExactSizeIterator::len).max().unwrap_or(0) as f64 * PERIOD_S;
            let first = record.segments.get(1).and_then(|s| record.time_s.get(s.start)).copied().unwrap_or(0.0);
            let severity = if longest < LEAST_EACH_S { Severity::Unusable } else { Severity::Doubtful };
            findings.push(add(
                severity,
                Trouble::Gaps,
                format!(
                    "{} gaps, the first before {first:.2} s; the longest run without one lasts {longest:.1} s. Each \
                     gap loses the state of everything that no sensor shows; look for lost packets",
                    record.segments.len() - 1
                ),
            ));
        }
        let steps: Vec<f64> = record
            .segments
            .iter()
            .filter_map(|rows| record.time_s.get(rows.clone()))
            .flat_map(|times| times.windows(2).map(|w| w[1] - w[0]))
            .collect();
        if steps.is_empty() {
            continue;
        }
        let n = steps.len() as f64;
        let mean = steps.iter().sum::<f64>() / n;
        let jitter_ms = 1e3 * (steps.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / n).sqrt();
        if jitter_ms > JITTER_MS {
            findings.push(add(
                Severity::Doubtful,
                Trouble::UnevenTime,
                format!(
                    "time_s jitters by {jitter_ms:.1} ms; rows are taken as 20 ms apart, so fast effects (delays, \
                     lags) cannot be trusted"
                ),
            ));
        }
        if (mean / PERIOD_S - 1.0).abs() > CLOCK {
            findings.push(add(
                Severity::Doubtful,
                Trouble::UnevenTime,
                format!(
                    "rows are {:.2} ms apart on average, taken as 20 ms; every time constant will be off by {:.1} %",
                    1e3 * mean,
                    100.0 * (mean / PERIOD_S - 1.0).abs()
                ),
            ));
        }
    }
}
