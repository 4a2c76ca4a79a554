//! Figures of a flight against numbers worked out by hand.
#![allow(clippy::unwrap_used)]

use flight::statistics::{Pacing, Stage};
use flight::{FileState, FlightStatistics, StatisticsOptions, Verdict};
use proto::recording::{Arrival, TickRecord};

/// A tick of a daemon that steers, with the given errors (kPa).
fn steered(tick: u32, error_pos: f64, error_neg: f64) -> TickRecord {
    TickRecord {
        session: 7,
        tick,
        receive_ns: u64::from(tick) * 20_000_000,
        arrival: Arrival::InTime,
        sense_present: true,
        command_present: true,
        p_pos_kpa: 80.0 + error_pos,
        p_neg_kpa: -70.0 + error_neg,
        ref_pos_kpa: 80.0,
        ref_neg_kpa: -70.0,
        u_pos: 0.75,
        u_neg: 0.5,
        mode: 1,
        compute_ns: 400_000,
        ..TickRecord::default()
    }
}

#[test]
fn only_what_comes_after_settling_counts() {
    // 250 ticks of 1,000 kPa error are the first 5 s; then errors 0.3, −0.4, 0 over and over.
    let error = |k: u32| match (k < 250, k % 3) {
        (true, _) => 1_000.0,
        (false, 0) => 0.3,
        (false, 1) => -0.4,
        (false, _) => 0.0,
    };
    let ticks: Vec<TickRecord> = (0..1_150).map(|k| steered(k, error(k), -2.0 * error(k))).collect();
    let summary = FlightStatistics::of(&ticks, StatisticsOptions::default()).summary();
    assert_eq!((summary.ticks, summary.tracked_ticks, summary.seconds), (1_150, 900, 23.0));
    // 900 are left, 300 of each kind: √((300·0.09 + 300·0.16) / 900).
    let rmse = (25.0_f64 / 300.0).sqrt();
    // 80 + 0.3 − 80 loses 3e-14 of its digits.
    let close = |told: Option<f64>, by_hand: f64| (told.unwrap() - by_hand).abs() < 1e-12;
    assert!(close(summary.rmse_pos_kpa, rmse) && close(summary.rmse_neg_kpa, 2.0 * rmse), "{summary:?}");
    assert!(close(summary.max_abs_pos_kpa, 0.4) && close(summary.max_abs_neg_kpa, 0.8));
    assert!(close(summary.mean_error_pos_kpa, -0.1 / 3.0) && close(summary.mean_error_neg_kpa, 0.2 / 3.0));
    assert_eq!(summary.action_change_rms_pos_duty, Some(0.0));
    assert_eq!(summary.verdict, Verdict::Look, "a pattern of three ticks is an oscillation: {:?}", summary.findings);
    let pos = summary.repetition_pos.unwrap();
    assert!((pos.period_s / 0.06 - (pos.period_s / 0.06).round()).abs() < 1e-9, "{pos:?}");
}

#[test]
fn a_vent_begins_settling_anew_and_is_told() {
    let vented = |k| TickRecord { mode: 0, fault: 3, u_pos: 1.0, u_neg: 1.0, ..steered(k, 50.0, 0.0) };
    // Two seconds of standby, 6 s of flight, 1 s of vent with a fault, 6 s of flight, standby again.
    let tick = |k: u32| match k {
        0..100 => TickRecord { ref_pos_kpa: f64::NAN, ref_neg_kpa: f64::NAN, mode: 0, ..steered(k, 0.0, 0.0) },
        400..450 => vented(k),
        750.. => TickRecord { mode: 0, ..steered(k, 9.0, 9.0) },
        _ => steered(k, 0.1, 0.1),
    };
    let ticks: Vec<TickRecord> = (0..800).map(tick).collect();
    let summary = FlightStatistics::of(&ticks, StatisticsOptions::default()).summary();
    // 50 ticks after 5 s of each flight.
    assert_eq!(summary.tracked_ticks, 100);
    assert!((summary.rmse_pos_kpa.unwrap() - 0.1).abs() < 1e-9);
    assert_eq!((summary.faults, summary.fault_s, summary.vented_s), (1, 1.0, 1.0), "the last standby is no vent");
    assert_eq!(summary.verdict, Verdict::Bad);
    assert_eq!(
        summary.headline,
        "Tracked the pressures to 0.10 kPa (positive) and 0.10 kPa (negative) RMS; 1 fault; vented for 1.0 s; no deadline missed; slowest tick 400 µs of 20 ms."
    );
}

#[test]
fn limits_and_misses_turn_the_verdict() {
    let ticks: Vec<TickRecord> = (0..600)
        .map(|k| TickRecord {
            compute_ns: if k == 280 { 21_000_000 } else { 400_000 },
            deadline_missed: k == 280,
            ..steered(k, 0.7, 0.2)
        })
        .collect();
    let options = StatisticsOptions { rmse_limit_kpa: Some([0.6, 0.25]), ..StatisticsOptions::default() };
    let summary = FlightStatistics::of(&ticks, options).summary();
    assert_eq!(summary.verdict, Verdict::Bad);
    assert_eq!(
        summary.headline,
        "Tracked the pressures to 0.70 kPa (positive) and 0.20 kPa (negative) RMS, the positive one above its limit of 0.60 kPa; 1 of 600 deadlines missed; slowest tick 21.0 ms, and a tick has 20 ms."
    );
    assert_eq!(
        summary.findings,
        ["positive RMSE 0.700 kPa is above its limit of 0.600 kPa", "1 of 600 deadlines missed"]
    );
    let good = StatisticsOptions { rmse_limit_kpa: Some([0.8, 0.25]), ..options };
    let lockstep = StatisticsOptions { pacing: Pacing::Lockstep, ..good };
    let summary = FlightStatistics::of(&ticks, lockstep).summary();
    assert_eq!((summary.verdict, summary.findings.len()), (Verdict::Good, 0), "no deadlines in lockstep");
}

#[test]
fn what_befell_the_ticks_is_counted() {
    let mut ticks: Vec<TickRecord> = (0..20).map(|k| steered(k, 0.0, 0.0)).collect();
    ticks[3].arrival = Arrival::Late;
    ticks[4].arrival = Arrival::Missing;
    ticks[5].arrival = Arrival::Missing;
    ticks[6].arrival = Arrival::Damaged;
    ticks[7].fault = 1;
    ticks[8].fault = 2;
    ticks[9].fault = 2;
    ticks[11].fault = 2;
    ticks[12].crio_trip = 1;
    ticks[13].crio_trip = 3;
    for (index, tick) in ticks.iter_mut().enumerate() {
        tick.records_dropped = if index >= 15 { 4 } else { 0 };
        if index >= 15 {
            tick.tick += 4;
        }
        if index == 19 {
            *tick = TickRecord { session: 8, tick: 0, records_dropped: 1, ..*tick };
        }
    }
    // Before any session, what does not come is not missing.
    ticks.insert(0, TickRecord::default());
    let statistics = FlightStatistics::of(&ticks, StatisticsOptions::default());
    let counts = statistics.counts();
    assert_eq!((counts.frames_missing, counts.frames_late, counts.frames_damaged), (2, 1, 1));
    assert_eq!((counts.faults, counts.fault_ticks, counts.crio_trips), (3, 4, 2));
    assert_eq!((counts.records_dropped, counts.ticks_skipped, counts.sessions), (5, 4, 2));
}

/// Ticks that the recorder could not keep are a failure of the run; those that a damaged file lacks are none, nor those that a whole
/// one does not have, whose cause is another.
#[test]
fn ticks_without_a_record_count_by_why_they_are_missing() {
    let run = |dropped: u32, file_state: FileState, pacing: Pacing| {
        let mut ticks: Vec<TickRecord> = (0..600).map(|k| steered(k, 0.0, 0.0)).collect();
        for tick in &mut ticks[400..] {
            tick.tick += 7;
            tick.records_dropped = dropped;
        }
        let options = StatisticsOptions { file_state, pacing, ..StatisticsOptions::default() };
        FlightStatistics::of(&ticks, options).summary()
    };
    for (file_state, pacing, cause) in [
        (FileState::Damaged, Pacing::Realtime, "the file is damaged"),
        (FileState::Whole, Pacing::Realtime, "the computer stood still, or the cRIO left frames out"),
        (FileState::Damaged, Pacing::Lockstep, "the file is damaged"),
        (FileState::Whole, Pacing::Lockstep, "frames never came, or a table lacks rows"),
    ] {
        let lacking = run(0, file_state, pacing);
        let told = format!("7 ticks without a record ({cause})");
        assert!(lacking.findings.iter().any(|found| found.contains(&told)), "{told}: {:?}", lacking.findings);
        assert_ne!(lacking.verdict, Verdict::Bad, "{:?}", lacking.findings);
    }
    let dropped = run(7, FileState::Whole, Pacing::Realtime);
    assert_eq!(dropped.verdict, Verdict::Bad);
    assert!(dropped.findings.iter().any(|found| found.contains("7 ticks not recorded")), "{:?}", dropped.findings);
    assert!(!dropped.findings.iter().any(|found| found.contains("without a record")), "{:?}", dropped.findings);
}

#[test]
fn stages_count_where_they_ran_and_lateness_where_a_frame_came() {
    let mut ticks: Vec<TickRecord> = (0..10).map(|k| steered(k, 0.0, 0.0)).collect();
    for (k, tick) in ticks.iter_mut().enumerate() {
        tick.law_ns = 100 * k as u32;
        tick.arrival_lateness_ns = 1_000 * k as i64 - 5_000;
    }
    ticks[9].arrival = Arrival::Missing;
    let statistics = FlightStatistics::of(&ticks, StatisticsOptions::default());
    assert_eq!(statistics.stage(Stage::Law).total(), 9, "0 ns: it did not run");
    assert_eq!(statistics.stage(Stage::Predict).total(), 0);
    assert_eq!((statistics.lateness().total(), statistics.lateness().max_ns()), (9, Some(3_000)));
    assert_eq!(statistics.lateness().percentile_ns(0.0), Some(0), "early is not late");
    let summary = statistics.summary();
    assert_eq!((summary.stages_us.law.max, summary.stages_us.predict.p50), (Some(0.9), None));
    assert_eq!((summary.compute_us_p50, summary.compute_us_max), (Some(400.0), Some(400.0)));
}

#[test]
fn the_json_has_the_keys_that_scripts_read() {
    let ticks: Vec<TickRecord> = (0..600).map(|k| steered(k, 0.1, -0.1)).collect();
    let json = serde_json::to_value(FlightStatistics::of(&ticks, StatisticsOptions::default()).summary()).unwrap();
    for key in [
        "rmse_pos_kpa",
        "rmse_neg_kpa",
        "max_abs_pos_kpa",
        "max_abs_neg_kpa",
        "compute_us_p50",
        "compute_us_p999",
        "compute_us_max",
        "seconds",
    ] {
        assert!(json[key].is_f64(), "{key}: {}", json[key]);
    }
    for key in ["ticks", "deadline_misses", "frames_missing", "frames_late", "records_dropped"] {
        assert!(json[key].is_u64(), "{key}: {}", json[key]);
    }
    assert_eq!(json["verdict"], "good");
    assert!(json["stages_us"]["predict"]["p999"].is_null(), "a stage that never ran has no figure");
    // A second behind the settling says nothing of how well it tracks.
    let stopped =
        serde_json::to_value(FlightStatistics::of(&ticks[..300], StatisticsOptions::default()).summary()).unwrap();
    assert!(stopped["verdict"] == "look" && stopped["findings"][0].as_str().unwrap().starts_with("only 1.0 s count"));
    // A flight without a tick has no figure, and JSON no NaN.
    let empty = serde_json::to_value(FlightStatistics::default().summary()).unwrap();
    assert!(empty["rmse_pos_kpa"].is_null() && empty["verdict"] == "bad");
}

#[test]
fn lines_keep_their_columns_and_the_table_says_what_was_asked() {
    let mut statistics = FlightStatistics::default();
    let empty = statistics.live_line("waiting");
    assert_eq!(empty, "     0 s  no tick yet  waiting");
    statistics.push(&steered(0, 3.41, 0.08));
    let first = statistics.live_line("");
    assert_eq!(first, "    0 s   83.41 ->  80.00  +3.41  -69.92 -> -70.00  +0.08  0.750 0.500  0.4 ms");
    statistics.push(&TickRecord { p_pos_kpa: f64::NAN, compute_ns: 12_340_000, ..steered(1, 0.0, 0.0) });
    statistics.push(&steered(2, 0.0, 0.0));
    statistics.push(&TickRecord { p_pos_kpa: f64::NAN, ..steered(3, 0.0, 0.0) });
    let second = statistics.live_line("SAFE");
    assert!(second.contains(" 12.3 ms"), "the slowest since the last line: {second}");
    assert!(second.contains("s      -- ->  80.00     --") && second.ends_with("ms  SAFE"), "{second}");
    let column = |line: &str| line.find("-69.92").or(line.find("-70.00 ->"));
    assert_eq!(column(&first), column(&second), "{first}\n{second}");
    assert!(first.len() <= 80 && FlightStatistics::live_header().len() <= 80);
    let table = statistics.summary().table();
    for words in ["RMSE", "largest error", "99.9 %", "deadlines missed 0", "Verdict: worth a look."] {
        assert!(table.contains(words), "{words}: {table}");
    }
    assert!(table.is_ascii(), "{table}");
    statistics.push(&TickRecord { deadline_missed: true, ..steered(4, 0.0, 0.0) });
    let missed = statistics.live_line("SAFE");
    assert!(missed.ends_with("ms  1 missed  SAFE"), "{missed}");
}
