//! The page: whole and self-contained whatever the flight, and honest about what went wrong.
#![allow(clippy::unwrap_used)]

use flight::statistics::Pacing;
use flight::{CodeNames, FlightInfo, FlightNote, NoteTime, RecorderOptions, StatisticsOptions, flight_report};
use proptest::prelude::*;
use proto::recording::{Arrival, Attachment, EventLevel, LogTime, RecordingInfo, TickRecord, read_mcap};

fn codes() -> CodeNames {
    CodeNames {
        state: |state| if state == 1 { "run" } else { "standby" },
        fault: |fault| if fault == 3 { "link lost" } else { "over-pressure" },
    }
}

fn info() -> FlightInfo {
    FlightInfo::new("Flight <7>", codes(), StatisticsOptions::default())
}

fn steered(tick: u32) -> TickRecord {
    let p_pos_kpa = 80.0 + 0.1 * f64::from(tick % 5);
    TickRecord {
        session: 7,
        tick,
        receive_ns: u64::from(tick) * 20_000_000,
        arrival: Arrival::InTime,
        p_pos_kpa,
        p_neg_kpa: -70.0,
        ref_pos_kpa: 80.2,
        ref_neg_kpa: -70.0,
        predicted_pos_kpa: [p_pos_kpa; 5],
        predicted_neg_kpa: [-70.1; 5],
        u_pos: 0.75,
        u_neg: 0.5,
        mode: 1,
        state: 1,
        compute_ns: 400_000,
        predict_ns: 300_000,
        ..TickRecord::default()
    }
}

/// Nothing that a browser would have to fetch, and every element closed.
fn check_page(page: &str) {
    assert!(page.starts_with("<!DOCTYPE html>") && page.trim_end().ends_with("</html>"));
    for outside in ["src=", "href=", "url(http", "@import"] {
        assert!(!page.contains(outside), "{outside}");
    }
    // The scripts at its end are no markup; what they draw is tested in a browser.
    let page = page.split("<script").next().unwrap();
    for number in ["NaN", "inf"] {
        let around = page.find(number).map(|at| page.get(at.saturating_sub(120)..at + 20));
        assert_eq!(around, None, "a number that is none reached the page");
    }
    for element in ["svg", "table", "figure", "main", "g", "clipPath"] {
        let open = page.matches(&format!("<{element}>")).count() + page.matches(&format!("<{element} ")).count();
        assert_eq!(open, page.matches(&format!("</{element}>")).count(), "{element}");
    }
}

#[test]
fn a_good_flight_says_so_and_names_where_it_comes_from() {
    let ticks: Vec<TickRecord> = (0..600).map(steered).collect();
    let mut info = info();
    info.rig = "bench".to_owned();
    info.policy = Some(("default".to_owned(), "ab12".to_owned()));
    info.files = vec![("controller.toml".to_owned(), "[link]\n".to_owned())];
    let page = flight_report(&ticks, &info);
    check_page(&page);
    // √(2·0.04 + 2·0.01)/√5 = 0.141 around 80.2.
    for words in [
        "Flight &lt;7&gt;",
        "Tracked the pressures to 0.14 kPa (positive) and 0.00 kPa (negative) RMS; no deadline missed; slowest tick 400 µs of 20 ms.",
        "default (SHA-256 ab12)",
        "rig bench",
        "controller.toml",
        "state run",
        "MPObs is further off than assuming that nothing changes",
    ] {
        assert!(page.contains(words), "{words}");
    }
    assert!(!page.contains("Look at</h2>"));
}

#[test]
fn trouble_is_told_with_its_time() {
    let mut ticks: Vec<TickRecord> = (0..600).map(steered).collect();
    for tick in &mut ticks[300..320] {
        (tick.fault, tick.mode, tick.arrival) = (3, 0, Arrival::Missing);
    }
    ticks[400].deadline_missed = true;
    (ticks[400].compute_ns, ticks[400].predict_ns) = (25_000_000, 24_000_000);
    ticks[410].deadline_missed = true;
    ticks[410].arrival_lateness_ns = 31_000_000;
    ticks[420].crio_trip = 0b1000_0011;
    ticks.drain(500..510);
    let mut info = info();
    info.notes = vec![FlightNote {
        at: NoteTime::MonotonicNs(6_410_000_000),
        level: EventLevel::Warning,
        part: "socket".to_owned(),
        message: "operator pressed <arm>".to_owned(),
    }];
    let page = flight_report(&ticks, &info);
    check_page(&page);
    for words in [
        "Look at</h2>",
        "<td class=\"number\">6.00 s</td><td class=\"number\">0.40 s</td><td>✗</td><td>daemon</td><td>fault: link lost (code 3)</td>",
        "<td>link</td><td>20 frames did not come</td>",
        "the tick took 25.0 ms, of that prediction (MPObs) 24.0 ms",
        "deadline missed; its frame came 31.0 ms late",
        "trip: over-pressure, command lost, unknown bits 0x80",
        "<td class=\"number\">10.00 s</td><td class=\"number\">0.20 s</td><td>!</td><td>recorder</td><td>10 ticks without a record</td>",
        "<td class=\"number\">6.41 s</td><td class=\"number\"></td><td>!</td><td>socket</td><td>operator pressed &lt;arm&gt;</td>",
    ] {
        assert!(page.contains(words), "{words}");
    }
}

#[test]
fn a_flood_of_one_kind_is_cut_and_counted() {
    let mut ticks: Vec<TickRecord> = (0..600).map(steered).collect();
    // 300 single misses.
    ticks.iter_mut().step_by(2).for_each(|tick| tick.deadline_missed = true);
    let page = flight_report(&ticks, &info());
    assert_eq!(page.matches("<td>deadline missed;").count(), 20);
    assert!(page.contains("… and 280 more of this kind"));
}

#[test]
fn a_recording_tells_its_own_report() {
    let path = std::env::temp_dir().join(format!("flight-report-{}.mcap", std::process::id()));
    for log_time in [LogTime::Arrival, LogTime::Tick] {
        let mut recording = RecordingInfo::new("controller 9.9", 1_000_000_000);
        recording.log_time = log_time;
        recording.policy = Some(("default".to_owned(), "cd34".to_owned()));
        for (key, value) in [("rig", "bench"), ("model_rig", "dual_pressure"), ("host", "lab-3")] {
            recording.extra.insert(key.to_owned(), value.to_owned());
        }
        let text = |name: &str, data: &[u8]| Attachment {
            name: name.to_owned(),
            media_type: "application/octet-stream".to_owned(),
            data: data.to_vec(),
        };
        let files = [text("controller.toml", b"[link]"), text("policy.onnx", &[0xFF, 0xFE, 0x00])];
        let (recorder, mut sink) =
            flight::Recorder::start(&path, &recording, &files, RecorderOptions::new(|_| "vented".to_owned())).unwrap();
        for k in 0..100 {
            // In lockstep the whole flight passes in 100 ms.
            let period_ns = if log_time == LogTime::Arrival { 20_000_000 } else { 1_000_000 };
            let receive_ns = 1_000_000_000 + u64::from(k) * period_ns;
            sink.push(&TickRecord { receive_ns, ..steered(k) });
            if k == 75 {
                let (level, part) = (EventLevel::Error, "safety");
                sink.event(flight::Event { at_ns: receive_ns, level, part, code: 1, values: [0.0; 4] });
            }
        }
        recorder.finish().unwrap();
        let content = read_mcap(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        let info = FlightInfo::from_recording("From a file", &content, codes(), StatisticsOptions::default());
        let lockstep = log_time == LogTime::Tick;
        assert_eq!(info.options.pacing, if lockstep { Pacing::Lockstep } else { Pacing::Realtime });
        assert_eq!((info.rig.as_str(), info.model_rig.as_str()), ("bench", "dual_pressure"));
        assert_eq!(info.files, [("controller.toml".to_owned(), "[link]".to_owned())], "no binary on a page");
        let page = flight_report(&content.ticks, &info);
        check_page(&page);
        // The start is kept to the millisecond, so the last digit may move by one.
        let at = |time: &str| {
            page.contains(&format!("<td class=\"number\">{time} s</td><td></td><td>✗</td><td>safety</td>"))
        };
        assert!(at("1.50"), "the event stands at tick 75");
        assert!(page.contains("lab-3") && page.contains("controller 9.9") && page.contains("cd34"));
        assert_eq!(page.contains("in lockstep, without deadlines"), lockstep);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    #[test]
    fn any_ticks_make_a_whole_page(
        ticks in prop::collection::vec(
            (
                (0_u32..3, 0_u32..400, any::<u64>(), 0_u8..4, any::<u8>(), any::<u8>(), 0_u16..3),
                prop::array::uniform6(prop_oneof![
                    8 => -100.0..200.0_f64,
                    1 => Just(f64::NAN),
                    1 => prop::sample::select(vec![f64::INFINITY, f64::NEG_INFINITY, f64::MAX, -0.0, 1e-300]),
                ]),
                (any::<i64>(), any::<u32>(), any::<bool>(), any::<u32>()),
            ),
            0..60,
        ),
        lockstep in any::<bool>(),
    ) {
        let ticks: Vec<TickRecord> = ticks
            .into_iter()
            .map(|((session, tick, receive_ns, arrival, mode, state, fault), p, (late, ns, missed, dropped))| TickRecord {
                session,
                tick,
                receive_ns,
                arrival: Arrival::from_code(arrival).unwrap_or_default(),
                mode: mode % 3,
                state,
                fault,
                p_pos_kpa: p[0],
                p_neg_kpa: p[1],
                ref_pos_kpa: p[2],
                ref_neg_kpa: p[3],
                predicted_pos_kpa: [p[4]; 5],
                u_pos: p[5],
                arrival_lateness_ns: late,
                compute_ns: ns,
                predict_ns: ns / 2,
                deadline_missed: missed,
                records_dropped: dropped,
                ..TickRecord::default()
            })
            .collect();
        let mut info = info();
        // No settling, so that short flights count.
        info.options.skip_s = 0.0;
        info.options.pacing = if lockstep { Pacing::Lockstep } else { Pacing::Realtime };
        check_page(&flight_report(&ticks, &info));
    }
}
