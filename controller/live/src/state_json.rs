//! Messages to the page: everything once, then what is new.

use std::collections::VecDeque;

use proto::recording::{EventLevel, TickRecord};
use serde_json::{Value, json};

use crate::hub::{COMPUTE_EDGES_S, Hub, Known, Seen};

/// Position up to which a page has everything.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Cursor {
    /// Number of the next tick or event that it lacks.
    pub(crate) next: u64,
    /// Edition of what it knows about run, policies and link.
    pub(crate) edition: Option<u64>,
}

/// Gives what a page lacks, and moves its cursor on.
pub(crate) fn news(hub: &Hub, known: &Known, cursor: &mut Cursor) -> Value {
    let ticks: Vec<Value> = since(&known.ticks, cursor.next).map(|seen| tick(hub, seen)).collect();
    let events: Vec<Value> = since(&known.events, cursor.next)
        .map(|seen| {
            let level = match seen.what.level {
                EventLevel::Info => "info",
                EventLevel::Warning => "warning",
                EventLevel::Error => "error",
            };
            json!({"t": seconds(seen.unix_ns), "level": level, "part": seen.what.part, "message": seen.what.message})
        })
        .collect();
    let totals = &known.totals;
    let mut out = json!({
        "ticks": ticks,
        "events": events,
        "daemon": daemon(hub, known),
        "age_s": known.age().map(|age| age.as_secs_f64()),
        "current": known.current().is_some(),
        "totals": {
            "ticks": totals.ticks,
            "deadline_misses": totals.deadline_misses,
            "frames_missing": totals.frames_missing,
            "faults": totals.faults,
            "filter_interventions": totals.filter_interventions,
            "sessions": totals.sessions,
        },
        "compute": {"edges_ms": COMPUTE_EDGES_S.map(|edge| edge * 1e3), "counts": totals.compute},
    });
    if cursor.edition != Some(known.edition) {
        out["about"] = json!(known.about);
        out["policies"] = serde_json::from_str(&known.policies).unwrap_or(Value::Null);
        cursor.edition = Some(known.edition);
    }
    cursor.next = known.next();
    out
}

/// The daemon's state, or why it is not known.
pub(crate) fn daemon(hub: &Hub, known: &Known) -> Value {
    match known.daemon() {
        Ok(state) => json!({
            "up": true,
            "state": (hub.names.state)(state.state),
            "fault": hub.fault_name(state.fault),
            "waits": hub.fault_name(state.waits),
            "session": state.session,
            "policy": state.policy,
            "policy_sha256": state.policy_sha256,
            "model": state.model,
            "model_sha256": state.model_sha256,
            "reference": state.reference,
            "recording_problem": known.recording_problem(),
            "recording_free_bytes": state.recording_free_bytes,
        }),
        Err(why) => json!({"up": false, "state": "unknown", "fault": why}),
    }
}

fn since<T>(queue: &VecDeque<Seen<T>>, next: u64) -> impl Iterator<Item = &Seen<T>> {
    let from = queue.partition_point(|seen| seen.number < next);
    queue.range(from..)
}

fn tick(hub: &Hub, seen: &Seen<TickRecord>) -> Value {
    let t = &seen.what;
    let [.., five_pos] = t.predicted_pos_kpa;
    let [.., five_neg] = t.predicted_neg_kpa;
    // JSON has no number for what was not measured; serde_json writes null.
    json!({
        "t": seconds(seen.unix_ns),
        "n": t.tick,
        "session": t.session,
        "p": [t.p_pos_kpa, t.p_neg_kpa],
        "r": [t.ref_pos_kpa, t.ref_neg_kpa],
        "f": [five_pos, five_neg],
        "u": [t.u_pos, t.u_neg],
        "state": (hub.names.state)(t.state),
        "fault": hub.fault_name(t.fault),
        "stage": t.policy_stage,
        "authority": t.authority,
        "swap": t.swap_id,
        "explored": [t.exploration_pos, t.exploration_neg],
        "experiment": t.experiment,
        "bent": t.filter_active,
        "findings": t.findings,
        "ms": f64::from(t.compute_ns) * 1e-6,
        "late": t.deadline_missed,
    })
}

fn seconds(unix_ns: u64) -> f64 {
    // To the tenth of a millisecond: what is below that is no news for a page.
    (unix_ns / 100_000) as f64 * 1e-4
}

#[cfg(test)]
mod tests {
    use super::*;
    use flight::CodeNames;
    use proto::stream::{DaemonState, Message};

    #[test]
    fn a_page_is_sent_everything_once() {
        let hub = Hub::new(CodeNames { state: |_| "run", fault: |_| "?" });
        let put = |number: u32| {
            let tick = TickRecord { tick: number, p_pos_kpa: 90.0, ..TickRecord::default() };
            hub.take(Message::Tick { unix_ns: 1_500_000_000, tick: Box::new(tick) });
        };
        put(0);
        put(1);
        let mut cursor = Cursor::default();
        let first = news(&hub, &hub.lock(), &mut cursor);
        assert_eq!(first["ticks"].as_array().unwrap().len(), 2);
        assert_eq!((&first["ticks"][0]["p"][0], &first["ticks"][0]["p"][1]), (&json!(90.0), &Value::Null));
        assert!(first["daemon"]["up"] == false && first["current"] == false && first["about"].is_object());
        put(2);
        let second = news(&hub, &hub.lock(), &mut cursor);
        assert_eq!((&second["ticks"][0]["n"], second["ticks"].as_array().unwrap().len()), (&json!(2), 1));
        assert!(second.get("about").is_none());
    }

    /// No tick is needed for it, and none that is old stands for it.
    #[test]
    fn the_daemons_state_is_in_every_picture() {
        let hub = Hub::new(CodeNames { state: |_| "connecting", fault: |_| "link lost" });
        hub.link(Ok(()));
        let lost = DaemonState { state: 6, fault: 7, age_ms: Some(10_900), ..DaemonState::default() };
        hub.take(Message::State(lost));
        let mut cursor = Cursor::default();
        for _ in 0..2 {
            let picture = news(&hub, &hub.lock(), &mut cursor);
            let daemon = &picture["daemon"];
            assert_eq!((&daemon["state"], &daemon["fault"]), (&json!("connecting"), &json!("link lost")));
            assert!(picture["age_s"].as_f64().unwrap() >= 10.9 && picture["current"] == false, "{picture}");
        }
    }
}
