//! Other writings of loggers that are not plain: current loops, commands written where they change, rows that stand twice, times of writing,
//! markers for no reading.

#![allow(clippy::unwrap_used, reason = "the helpers of a test fail by panicking, as the test does")]

use model::rig::Rig;
use proto::recording::{Recording, RecordingError};

const RIG: &str = r#"
format = 1
name = "line"
[gas]
gas_constant_j_per_kg_k = 287.0
heat_capacity_ratio = 1.4
[atmosphere]
pressure_kpa_abs = 101.325
temperature_k = 293.15
[volumes.line]
volume_l = 0.1
temperature_k = 293.15
[pumps.pump]
kind = "flow"
outlet = "line"
command = "u"
flow_l_per_min = 2.0
[sources.meter]
kind = "flow"
to = "line"
flow_l_per_min = 1.0
signal = "q"
[sensors.sensor]
volume = "line"
column = "p_kpa"
range_kpa_gauge = [0.0, 100.0]
range_v = [0.0, 5.0]
"#;

/// Reads a text with a map of these lines.
fn read_with(map: &str, text: &str) -> Result<Recording, RecordingError> {
    let rig = Rig::from_toml(&format!("{}[recording]\n{map}", RIG)).unwrap();
    Recording::parse_for("x.csv", text.as_bytes(), &rig)
}

#[test]
fn current_loops_and_units_behind_strokes_are_read() {
    let text = "time / ms,u / %,q,p_kpa in mA\n0,50,1,4\n20,50,1,12\n40,50,1,20\n";
    let recording = read_with("", text).unwrap();
    assert_eq!(recording.column("p_kpa").unwrap(), [0.0, 50.0, 100.0]);
    assert_eq!(recording.column("u").unwrap(), [0.5; 3]);
    assert!((recording.time_s()[2] - 0.04).abs() < 1e-12);
}

#[test]
fn commands_are_held_where_their_cells_are_blank() {
    let rows: String = (0..60)
        .map(|k| format!("{},{},1,5\n", 0.02 * f64::from(k), if k % 20 == 3 { k.to_string() } else { String::new() }))
        .collect();
    let recording =
        read_with("columns.u = { from = \"u\", scale = 0.01 }", &format!("time_s,u,q,p_kpa\n{rows}")).unwrap();
    let u = recording.column("u").unwrap();
    assert_eq!([u[0], u[3], u[22], u[23], u[59]], [0.03, 0.03, 0.03, 0.23, 0.43]);
    assert!(recording.notes().iter().any(|note| note.contains("u held where")), "{:?}", recording.notes());
}

#[test]
fn rows_that_stand_twice_are_passed_over_and_told() {
    let row = |k: u32| format!("{},0.5,1,{}\n", 0.02 * f64::from(k), 5 + k % 3);
    let twice: String = (0..40).map(|k| row(k) + &row(k)).collect();
    let recording = read_with("", &format!("time_s,u,q,p_kpa\n{twice}")).unwrap();
    assert_eq!(recording.rows(), 40);
    assert!(recording.notes()[0].contains("40 rows are the row before") && recording.notes()[0].contains("line 3"));
    // Without a column that counts on, alike rows are readings that stand still.
    let still = format!("u,q,p_kpa\n{}", "0.5,1,5\n".repeat(40));
    assert_eq!(read_with("period_ms = 20.0", &still).unwrap().rows(), 40);
}

#[test]
fn times_of_writing_are_refused_with_the_key_that_helps() {
    let time = |k: u32| 0.2 * f64::from(k / 10) + 0.0005 * f64::from(k % 10);
    let rows: String = (0..400).map(|k| format!("{},0.5,1,{k}\n", time(k))).collect();
    let text = format!("time_s,u,q,p_kpa\n{rows}");
    let said = read_with("", &text).unwrap_err().to_string();
    assert!(said.contains("10 at a time") && said.contains("period_ms = 20.0"), "{said}");
    let recording = read_with("period_ms = 20.0", &text).unwrap();
    assert_eq!((recording.rows(), recording.segments().len()), (400, 1));
    let said = read_with("", "time_s,u,q,p_kpa\nnow,0.5,1,5\nthen,0.5,1,5\n").unwrap_err().to_string();
    assert!(said.contains("line 2") && said.contains("period_ms"), "{said}");
}

#[test]
fn readings_below_any_vacuum_get_the_likely_reason() {
    let said = |range: &str, readings: [f64; 3]| {
        let rows: String =
            readings.iter().enumerate().map(|(k, p)| format!("{},0.5,1,{p}\n", 0.02 * k as f64)).collect();
        let rig = RIG.replace("[0.0, 100.0]", range);
        let text = format!("time_s,u,q,p_kpa\n{rows}");
        Recording::parse_for("x.csv", text.as_bytes(), &Rig::from_toml(&rig).unwrap()).unwrap_err().to_string()
    };
    assert!(said("[0.0, 2000.0]", [-300.0, -1200.0, 0.5]).contains("scale = -1.0"));
    assert!(said("[0.0, 2000.0]", [-440.0, 9e5, 1.8e6]).contains("unit = \"Pa\""));
    assert!(said("[0.0, 2000.0]", [300.0, -9999.0, 310.0]).contains("no reading"));
    assert!(said("[-100.0, 0.0]", [-750.0, -400.0, -100.0]).contains("mbar, hPa or mmHg"));
}

/// Bytes that are no text are called that, whether they happen to be UTF-8 or not; a file of a fixed size with zeros at its end is read.
#[test]
fn binary_files_are_called_that() {
    let random = |k: u32| (k.wrapping_mul(2_654_435_761) >> 13) as u8;
    let low: Vec<u8> = (0..3000).map(|k| random(k) & 0x1f).collect();
    let any: Vec<u8> = (0..3000).map(|k| random(k).max(1)).collect();
    for bytes in [low, any] {
        let error = Recording::parse_for("x.csv", &bytes, &Rig::from_toml(RIG).unwrap()).unwrap_err().to_string();
        assert!(error.contains("binary file") && error.contains("as CSV"), "{error}");
    }
    let padded = format!("time_s,u,q,p_kpa\n0,1,1,5\n0.02,1,1,6\n0.04,1,1,5\n{}", "\0".repeat(6000));
    assert_eq!(read_with("", &padded).unwrap().column("p_kpa").unwrap(), [5.0, 6.0, 5.0]);
}
