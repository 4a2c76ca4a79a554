//! Rows of any rate, lost or uneven, and readings that are repeated: what is read are rows at one distance, and which of them were measured.

#![allow(clippy::unwrap_used, reason = "the helpers of a test fail by panicking, as the test does")]

mod logged;

use logged::{HEADER, paper, read, row, wave, with};

#[test]
fn any_rate_is_read_under_own_and_other_names_alike() {
    let samples = |header: &str, step: f64, count: usize| {
        let line = |k: usize| {
            let t = step * k as f64;
            format!("{t:.4},{},0.8,{:.6},-66\n", if t < 0.5 { 0.2 } else { 0.9 }, 90.0 + 10.0 * t)
        };
        format!("{header}\n") + &(0..count).map(line).collect::<String>()
    };
    let foreign = with(
        "time = \"t\"\ncolumns.u_pos = \"a\"\ncolumns.u_neg = \"b\"\ncolumns.p_pos_kpa = \"c\"\ncolumns.p_neg_kpa = \"d\"",
    );
    for (step, count, sampling) in
        [(0.002, 1000, 0.02), (0.01, 200, 0.02), (0.021, 100, 0.02), (0.1, 20, 0.1), (0.5, 5, 0.5)]
    {
        let own = read(samples(HEADER, step, count), &paper()).unwrap();
        let other = read(samples("t,a,b,c,d", step, count), &foreign).unwrap();
        assert!((own.sampling_s() - sampling).abs() < 1e-9 && own.segments().len() == 1, "{step}");
        assert_eq!((own.time_s(), own.measured()), (other.time_s(), other.measured()), "{step}");
        let [p, u] = own.require(["p_pos_kpa", "u_pos"]).unwrap();
        assert_eq!(other.require(["p_pos_kpa", "u_pos"]).unwrap(), [p, u]);
        for (row, t) in own.time_s().iter().enumerate().skip(1).take(own.rows() - 2) {
            // A ramp is what it is however it is averaged or joined.
            assert!((p[row] - 90.0 - 10.0 * t).abs() < 1e-4, "{step} {t}: {}", p[row]);
        }
        let measured = own.measured().map_or(own.rows(), |m| m.iter().filter(|m| **m).count());
        assert_eq!(measured, if sampling > 0.02 { count } else { own.rows() }, "{step}");
        assert!(own.notes()[0].contains(&format!("samples {:.1} ms apart", 1e3 * step)), "{:?}", own.notes());
        assert_eq!(own.notes()[0].contains("nothing faster than"), sampling > 0.02, "{:?}", own.notes());
    }
}

/// One row of twenty lost, two in a row here and there; and the clock off by up to 6 ms.
#[test]
fn lost_rows_and_jitter_are_bridged_and_told() {
    let lost = |k: usize| k % 20 == 7 || k % 200 == 8;
    let line = |k: usize, t: f64| {
        let ramp = 50.0 + 5.0 * t;
        format!("{t:.4},{},0.8,{ramp:.5},-66\n", if k % 100 < 50 { 0.3 } else { 0.9 })
    };
    let text = |jitter: f64, keep: &dyn Fn(usize) -> bool| {
        let rows = (0..1000).filter(|k| keep(*k));
        format!("{HEADER}\n") + &rows.map(|k| line(k, 0.02 * k as f64 + jitter * wave(k, 1.7))).collect::<String>()
    };
    let recording = read(text(0.0, &|k| !lost(k)), &paper()).unwrap();
    assert_eq!((recording.rows(), recording.segments().len()), (1000, 1));
    assert!(
        recording.notes()[0].contains("55 rows lost in 50 places (after 0.12, 0.52, 0.92, 1.32 … s)"),
        "{:?}",
        recording.notes()
    );
    let measured = recording.measured().unwrap();
    let [u, p] = recording.require(["u_pos", "p_pos_kpa"]).unwrap();
    for k in 0..1000 {
        assert_eq!(measured[k], !lost(k), "{k}");
        assert!((p[k] - 50.0 - 0.1 * k as f64).abs() < 1e-4, "{k}");
        assert_eq!(u[k], if k % 100 < 50 { 0.3 } else { 0.9 }, "{k}");
    }
    let jittered = read(text(0.006, &|_| true), &paper()).unwrap();
    assert_eq!((jittered.segments().len(), jittered.measured()), (1, None));
    assert!(
        jittered.rows().abs_diff(1000) <= 1 && jittered.notes()[0].contains("scatter by"),
        "{:?}",
        jittered.notes()
    );
    let [p] = jittered.require(["p_pos_kpa"]).unwrap();
    for (t, p) in jittered.time_s().iter().zip(p).skip(1).take(997) {
        assert!((p - 50.0 - 5.0 * t).abs() < 2e-3, "stamps are believed: {t} {p}");
    }
    let both = read(text(0.006, &|k| !lost(k)), &paper()).unwrap();
    assert_eq!(both.segments().len(), 1, "{:?}", both.notes());
    let out = both.measured().unwrap().iter().filter(|measured| !**measured).count();
    // A hole that the clock shortens to less than 35 ms is no hole.
    assert!((30..=60).contains(&out), "{out}");
    // Half a second without rows is a gap, and nothing is made up in it.
    let gap = read(text(0.0, &|k| !(300..325).contains(&k)), &paper()).unwrap();
    assert_eq!((gap.rows(), gap.segments().len(), gap.measured()), (975, 2, None));
}

/// A sensor read at 10 Hz and logged at 50: one row of five is a reading.
#[test]
fn readings_that_are_repeated_are_no_readings() {
    let line = |k: usize| {
        let [_, _, p, n] = row(k / 5);
        format!("{:.2},{},0.8,{p:.5},{n:.5}\n", 0.02 * k as f64, if k % 100 < 50 { 0.3 } else { 0.9 })
    };
    let text = format!("{HEADER}\n") + &(0..500).map(line).collect::<String>();
    let recording = read(text, &paper()).unwrap();
    assert!((recording.sampling_s() - 0.1).abs() < 1e-9, "{:?}", recording.notes());
    let measured = recording.measured().unwrap();
    assert!((0..500).all(|k| measured[k] == (k % 5 == 0)));
    assert!(recording.notes()[0].contains("every reading stands there 5 times"), "{:?}", recording.notes());
}
