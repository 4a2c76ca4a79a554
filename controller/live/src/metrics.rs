//! Metrics for Prometheus: text format 0.0.4.

use std::fmt::Write;

use proto::recording::TickRecord;
use proto::stream::DaemonState;

use crate::hub::{COMPUTE_EDGES_S, Hub, Known};

/// All metrics. Pressures and duties are those of the newest tick, and left out where that no longer tells what is, as
/// is the state of a daemon that says nothing; counts begin with this viewer.
pub(crate) fn text(hub: &Hub) -> String {
    let known = hub.lock();
    let mut out = String::new();
    let daemon = known.daemon();
    gauge(
        &mut out,
        "controller_up",
        "1 while the daemon tells its state, else 0.",
        &[("", f64::from(u8::from(daemon.is_ok())))],
    );
    if let Some(age) = known.age() {
        gauge(
            &mut out,
            "controller_data_age_seconds",
            "Age of the newest frame of the cRIO that was answered.",
            &[("", age.as_secs_f64())],
        );
    }
    if let Ok(state) = &daemon {
        standing(&mut out, state, hub);
        recording(&mut out, &known);
        free_space(&mut out, state);
        info(&mut out, state, &known);
    }
    if let Some(seen) = known.current() {
        newest(&mut out, &seen.what);
    }
    counters(&mut out, &known);
    compute(&mut out, &known);
    out
}

/// The daemon's state, with or without a session.
fn standing(out: &mut String, daemon: &DaemonState, hub: &Hub) {
    let state = format!("{{state=\"{}\"}}", label((hub.names.state)(daemon.state)));
    gauge(
        out,
        "controller_state",
        "The daemon's state: its code, and its name as a label.",
        &[(&state, f64::from(daemon.state))],
    );
    let fault = format!("{{fault=\"{}\"}}", label(hub.fault_name(daemon.fault)));
    gauge(
        out,
        "controller_fault",
        "Why the rig is vented or the last session ended: its code, 0 for nothing, and its name.",
        &[(&fault, f64::from(daemon.fault))],
    );
    let waits = format!("{{fault=\"{}\"}}", label(hub.fault_name(daemon.waits)));
    gauge(
        out,
        "controller_waits_for_acknowledge",
        "The worst that waits for `controller acknowledge`: its code, 0 for nothing, and its name.",
        &[(&waits, f64::from(daemon.waits))],
    );
}

/// Left out where the daemon does not say.
fn recording(out: &mut String, known: &Known) {
    if let Some(problem) = known.recording_problem() {
        gauge(
            out,
            "controller_recording",
            "1 while what happens can be recorded, 0 while something keeps it from being recorded.",
            &[("", f64::from(u8::from(problem.is_empty())))],
        );
    }
}

/// Left out where the daemon does not know.
fn free_space(out: &mut String, daemon: &DaemonState) {
    if let Some(bytes) = daemon.recording_free_bytes {
        gauge(
            out,
            "controller_recording_free_bytes",
            "Bytes that may still be written where recordings go.",
            &[("", bytes as f64)],
        );
    }
}

fn newest(out: &mut String, tick: &TickRecord) {
    let pair = |pos: f64, neg: f64| [("{channel=\"positive\"}", pos), ("{channel=\"negative\"}", neg)];
    gauge(out, "controller_pressure_kpa", "Measured pressure, kPa gauge.", &pair(tick.p_pos_kpa, tick.p_neg_kpa));
    gauge(out, "controller_reference_kpa", "Reference, kPa gauge.", &pair(tick.ref_pos_kpa, tick.ref_neg_kpa));
    let [.., five_pos] = tick.predicted_pos_kpa;
    let [.., five_neg] = tick.predicted_neg_kpa;
    gauge(
        out,
        "controller_predicted_kpa",
        "Pressure predicted five ticks ahead, kPa gauge.",
        &pair(five_pos, five_neg),
    );
    gauge(out, "controller_duty", "Duty sent, 0 closed to 1 open.", &pair(tick.u_pos, tick.u_neg));
    gauge(out, "controller_authority", "Share of the policy's answer that counts.", &[("", tick.authority)]);
    gauge(
        out,
        "controller_exploration_duty",
        "Duty that exploration added to the policy's answer.",
        &pair(tick.exploration_pos, tick.exploration_neg),
    );
    gauge(
        out,
        "controller_experiment_phase",
        "Experiment under way: 0 none, 1 waiting for rest, 2 playing, 3 coming to rest.",
        &[("", f64::from(tick.experiment))],
    );
    gauge(out, "controller_tick", "Number of the newest tick in its session.", &[("", f64::from(tick.tick))]);
}

fn info(out: &mut String, daemon: &DaemonState, known: &Known) {
    let program = known.about.get("program").map_or("", String::as_str);
    let labels: Vec<String> = [
        ("program", program),
        ("policy", daemon.policy.as_str()),
        ("sha256", daemon.policy_sha256.as_str()),
        ("model", daemon.model.as_str()),
        ("model_sha256", daemon.model_sha256.as_str()),
    ]
    .into_iter()
    .map(|(name, text)| format!("{name}=\"{}\"", label(text)))
    .collect();
    gauge(
        out,
        "controller_info",
        "What runs: 1, with its names as labels.",
        &[(&format!("{{{}}}", labels.join(",")), 1.0)],
    );
}

fn counters(out: &mut String, known: &Known) {
    let totals = &known.totals;
    for (name, help, value) in [
        ("ticks", "Ticks seen.", totals.ticks),
        ("deadline_misses", "Commands that left late.", totals.deadline_misses),
        ("frames_missing", "Frames that did not come.", totals.frames_missing),
        ("frames_damaged", "Frames that came damaged.", totals.frames_damaged),
        ("faults", "Faults that began.", totals.faults),
        ("filter_interventions", "Ticks in which the safety filter bent the command.", totals.filter_interventions),
        ("sessions", "Sessions with the cRIO.", totals.sessions),
        ("events", "Events.", totals.events),
    ] {
        // Writing to a String cannot fail.
        let _ = write!(
            out,
            "# HELP controller_{name}_total {help}\n# TYPE controller_{name}_total counter\ncontroller_{name}_total {value}\n"
        );
    }
}

fn compute(out: &mut String, known: &Known) {
    let name = "controller_tick_compute_seconds";
    let _ = write!(out, "# HELP {name} From the frame in hand to the command sent.\n# TYPE {name} histogram\n");
    let mut below = 0;
    for (edge, count) in COMPUTE_EDGES_S.iter().zip(known.totals.compute) {
        below += count;
        let _ = writeln!(out, "{name}_bucket{{le=\"{edge}\"}} {below}");
    }
    let (all, sum) = (known.totals.ticks, known.totals.compute_sum_s);
    let _ = write!(out, "{name}_bucket{{le=\"+Inf\"}} {all}\n{name}_sum {sum}\n{name}_count {all}\n");
}

/// A gauge with its samples; labels stand as they are to be written.
fn gauge(out: &mut String, name: &str, help: &str, samples: &[(&str, f64)]) {
    let _ = write!(out, "# HELP {name} {help}\n# TYPE {name} gauge\n");
    for (labels, value) in samples {
        let value = if value.is_finite() { value.to_string() } else { "NaN".to_owned() };
        let _ = writeln!(out, "{name}{labels} {value}");
    }
}

/// A label's value: backslash, quote and line end escaped.
fn label(text: &str) -> String {
    text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::RECORDING_PROBLEM;
    use flight::CodeNames;
    use proto::recording::Arrival;
    use proto::stream::Message;

    fn hub() -> Hub {
        let name = |state: u8| if state == 6 { "connecting" } else { "run" };
        let hub = Hub::new(CodeNames { state: name, fault: |_| "link lost" });
        hub.link(Ok(()));
        hub
    }

    fn running() -> DaemonState {
        DaemonState {
            state: 1,
            session: 9,
            age_ms: Some(0),
            policy: "a \"quoted\\ name".to_owned(),
            ..Default::default()
        }
    }

    /// Ticks by the time that they took to compute.
    fn tick(hub: &Hub, number: u32, compute_ns: u32) {
        let arrival = Arrival::InTime;
        let tick = TickRecord { tick: number, compute_ns, arrival, p_pos_kpa: 91.5, fault: 7, ..TickRecord::default() };
        hub.take(Message::Tick { unix_ns: 1, tick: Box::new(tick) });
    }

    fn check(hub: &Hub, lines: &[&str], not: &[&str]) {
        let text = text(hub);
        for line in lines {
            assert!(text.lines().any(|found| found == *line), "{line} is not in\n{text}");
        }
        for begin in not {
            assert!(!text.lines().any(|found| found.starts_with(begin)), "{begin} is in\n{text}");
        }
    }

    #[test]
    fn every_line_is_a_comment_or_a_sample_and_the_histogram_adds_up() {
        let hub = hub();
        hub.take(Message::State(running()));
        for (number, compute_ns) in [(0, 150_000), (1, 400_000), (2, 25_000_000)] {
            tick(&hub, number, compute_ns);
        }
        for line in text(&hub).lines().filter(|line| !line.starts_with("# ")) {
            let (name, value) = line.rsplit_once(' ').unwrap();
            assert!(value.parse::<f64>().is_ok() && name.starts_with("controller_"), "{line}");
        }
        let lines = [
            "controller_up 1",
            "controller_pressure_kpa{channel=\"positive\"} 91.5",
            "controller_pressure_kpa{channel=\"negative\"} NaN",
            "controller_state{state=\"run\"} 1",
            "controller_fault{fault=\"\"} 0",
            "controller_faults_total 1",
            "controller_exploration_duty{channel=\"negative\"} 0",
            "controller_experiment_phase 0",
            "controller_tick_compute_seconds_bucket{le=\"0.0002\"} 1",
            "controller_tick_compute_seconds_bucket{le=\"0.0005\"} 2",
            "controller_tick_compute_seconds_bucket{le=\"0.05\"} 3",
            "controller_tick_compute_seconds_bucket{le=\"+Inf\"} 3",
            "controller_tick_compute_seconds_count 3",
        ];
        check(&hub, &lines, &[]);
        assert!(text(&hub).contains("policy=\"a \\\"quoted\\\\ name\""));
    }

    #[test]
    fn whether_anything_is_recorded_is_told_while_the_daemon_says_so() {
        let hub = hub();
        hub.take(Message::State(running()));
        check(&hub, &[], &["controller_recording"]);
        for (problem, line) in [("", "controller_recording 1"), ("only 3 MiB free", "controller_recording 0")] {
            hub.take(Message::About([(RECORDING_PROBLEM.to_owned(), problem.to_owned())].into()));
            check(&hub, &[line], &[]);
        }
        hub.link(Err("the daemon ended; waiting for it".to_owned()));
        check(&hub, &["controller_up 0"], &["controller_recording"]);
    }

    #[test]
    fn the_room_for_recordings_is_told_in_bytes_where_it_is_known() {
        let hub = hub();
        hub.take(Message::State(running()));
        check(&hub, &["controller_up 1"], &["controller_recording_free_bytes"]);
        hub.take(Message::State(DaemonState { recording_free_bytes: Some(123 << 30), ..running() }));
        check(&hub, &["controller_recording_free_bytes 132070244352"], &[]);
        hub.link(Err("the daemon ended; waiting for it".to_owned()));
        check(&hub, &["controller_up 0"], &["controller_recording_free_bytes"]);
    }

    #[test]
    fn what_is_not_known_any_more_is_left_out_and_the_state_goes_on() {
        let hub = hub();
        hub.take(Message::State(running()));
        tick(&hub, 0, 150_000);
        let lost = DaemonState { state: 6, fault: 7, waits: 7, session: 0, age_ms: Some(3_000), ..running() };
        hub.take(Message::State(lost));
        let plant = ["controller_pressure_kpa", "controller_duty", "controller_reference_kpa", "controller_tick "];
        let lines = [
            "controller_up 1",
            "controller_state{state=\"connecting\"} 6",
            "controller_fault{fault=\"link lost\"} 7",
            "controller_waits_for_acknowledge{fault=\"link lost\"} 7",
        ];
        check(&hub, &lines, &plant);
        hub.link(Err("the daemon ended; waiting for it".to_owned()));
        let gone = [&plant[..], &["controller_state", "controller_fault{", "controller_info"]].concat();
        check(&hub, &["controller_up 0"], &gone);
        let age = text(&hub).lines().find_map(|line| line.strip_prefix("controller_data_age_seconds ")?.parse().ok());
        assert!(age.is_some_and(|age: f64| age >= 3.0), "{age:?}");
    }
}
