//! What Prometheus reads: text format 0.0.4.

use std::fmt::Write;

use proto::recording::TickRecord;

use crate::hub::{COMPUTE_EDGES_S, Hub, Known};

/// All metrics. Pressures and duties are those of the newest tick; counts begin with this viewer.
pub(crate) fn text(hub: &Hub) -> String {
    let known = hub.lock();
    let mut out = String::new();
    gauge(
        &mut out,
        "controller_up",
        "Whether the daemon's stream is there.",
        &[("", f64::from(u8::from(known.trouble.is_none())))],
    );
    if let Some(age) = known.age() {
        gauge(
            &mut out,
            "controller_data_age_seconds",
            "Time since the daemon last said anything.",
            &[("", age.as_secs_f64())],
        );
    }
    if let Some(seen) = known.newest() {
        newest(&mut out, &seen.what, hub);
    }
    info(&mut out, &known);
    counters(&mut out, &known);
    compute(&mut out, &known);
    out
}

fn newest(out: &mut String, tick: &TickRecord, hub: &Hub) {
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
    let state = format!("{{state=\"{}\"}}", label((hub.names.state)(tick.state)));
    gauge(
        out,
        "controller_state",
        "The daemon's state: its code, and its name as a label.",
        &[(&state, f64::from(tick.state))],
    );
    let name = if tick.fault == 0 { "" } else { (hub.names.fault)(tick.fault) };
    let fault = format!("{{fault=\"{}\"}}", label(name));
    gauge(
        out,
        "controller_fault",
        "The daemon's fault: its code, 0 for none, and its name.",
        &[(&fault, f64::from(tick.fault))],
    );
}

fn info(out: &mut String, known: &Known) {
    let labels: Vec<String> =
        [("program", "program"), ("policy", "policy_name"), ("sha256", "policy_sha256"), ("model", "model_rig")]
            .into_iter()
            .map(|(name, key)| format!("{name}=\"{}\"", label(known.about.get(key).map_or("", String::as_str))))
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
    use flight::CodeNames;
    use proto::stream::Message;

    #[test]
    fn every_line_is_a_comment_or_a_sample_and_the_histogram_adds_up() {
        let hub = Hub::new(CodeNames { state: |_| "run", fault: |_| "link lost" });
        hub.link(Ok(()));
        hub.take(Message::About([("policy_name".to_owned(), "a \"quoted\\ name".to_owned())].into()));
        for (number, compute_ns) in [(0, 150_000), (1, 400_000), (2, 25_000_000)] {
            let tick = TickRecord { tick: number, compute_ns, p_pos_kpa: 91.5, fault: 7, ..TickRecord::default() };
            hub.take(Message::Tick { unix_ns: 1, tick: Box::new(tick) });
        }
        let text = text(&hub);
        for line in text.lines().filter(|line| !line.starts_with("# ")) {
            let (name, value) = line.rsplit_once(' ').unwrap();
            assert!(value.parse::<f64>().is_ok() && name.starts_with("controller_"), "{line}");
        }
        for line in [
            "controller_up 1",
            "controller_pressure_kpa{channel=\"positive\"} 91.5",
            "controller_pressure_kpa{channel=\"negative\"} NaN",
            "controller_fault{fault=\"link lost\"} 7",
            "controller_faults_total 1",
            "controller_exploration_duty{channel=\"negative\"} 0",
            "controller_experiment_phase 0",
            "controller_tick_compute_seconds_bucket{le=\"0.0002\"} 1",
            "controller_tick_compute_seconds_bucket{le=\"0.0005\"} 2",
            "controller_tick_compute_seconds_bucket{le=\"0.05\"} 3",
            "controller_tick_compute_seconds_bucket{le=\"+Inf\"} 3",
            "controller_tick_compute_seconds_count 3",
        ] {
            assert!(text.lines().any(|found| found == line), "{line} is not in\n{text}");
        }
        assert!(text.contains("policy=\"a \\\"quoted\\\\ name\""));
    }
}
