//! Recordings read by somebody else's reader: the public Python packages for MCAP and Protocol Buffers.
//!
//! Runs where `python3` has both packages (`pip install mcap mcap-protobuf-support`), and says in a
//! line that it was skipped where not.

use std::path::Path;
use std::process::Command;
use std::time::{Duration, UNIX_EPOCH};

use proto::recording::{Arrival, Attachment, EventLevel, LawParts, RecordingInfo, RecordingWriter, TickRecord};

const START_NS: u64 = 1_795_140_245_000_000_000;

fn tick() -> TickRecord {
    TickRecord {
        session: 0xDEAD_BEEF,
        tick: 3,
        receive_ns: u64::MAX / 3,
        arrival: Arrival::Late,
        sense_present: true,
        sense: std::array::from_fn(|i| i as u8 ^ 0xA5),
        command_present: true,
        command: std::array::from_fn(|i| 255 - i as u8),
        volts: [1.5, 4.25, f32::NAN, -0.0],
        echo_pos: 0.75,
        echo_neg: 1.0,
        crio_state: 3,
        crio_trip: 255,
        p_pos_kpa: 100.1,
        p_neg_kpa: f64::from_bits(0x7ff8_0000_0000_1234),
        ref_pos_kpa: -0.0,
        ref_neg_kpa: f64::NEG_INFINITY,
        predicted_pos_kpa: [1.0, 2.0, 3.0, 4.0, f64::MIN_POSITIVE],
        predicted_neg_kpa: [-1.0, -2.0, -3.0, -4.0, -5.0],
        law_pos: LawParts {
            feed_forward: 0.1,
            backlash: 0.01,
            correction: 0.02,
            proportional: 0.2,
            integral: 0.3,
            u_raw: 0.6,
        },
        law_neg: LawParts {
            feed_forward: -0.1,
            backlash: -0.01,
            correction: -0.02,
            proportional: -0.2,
            integral: -0.3,
            u_raw: -0.6,
        },
        u_pos: 0.6,
        u_neg: 0.0,
        pump_on: true,
        mode: 2,
        state: 200,
        fault: 65_535,
        arrival_lateness_ns: -1_234_567_890_123,
        receive_check_ns: 11,
        predict_ns: 12,
        law_ns: 13,
        send_ns: 14,
        compute_ns: u32::MAX,
        deadline_missed: true,
        records_dropped: 5,
        findings: u64::MAX,
        inputs: 0x921,
        observation_hash: 1 << 63,
        policy_output: std::array::from_fn(|i| i as f32 / 8.0 - 0.5),
        policy_stage: 6,
        authority: 0.35,
        swap_id: 17,
        command_before_filter: [0.25, -0.0],
        filter_active: true,
        experiment: 2,
        exploration_pos: 0.0125,
        exploration_neg: -0.02,
        exploration_plan: std::array::from_fn(|i| 0.25 - i as f32 / 16.0),
    }
}

/// Number formats as in recording_read_back.py.
fn hex(value: f64) -> String {
    format!("{:016x}", value.to_bits())
}

fn hex_all(values: impl IntoIterator<Item = f64>) -> String {
    format!("[{}]", values.into_iter().map(hex).collect::<Vec<_>>().join(","))
}

fn hex_bytes(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[test]
fn the_public_python_reader_sees_every_field() {
    let packages = Command::new("python3").args(["-c", "import mcap, mcap_protobuf"]).output();
    if !packages.is_ok_and(|output| output.status.success()) {
        println!("skipped: needs python3 with the packages mcap and mcap-protobuf-support");
        return;
    }
    let folder = std::env::temp_dir().join(format!("recording-python-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("run.mcap");
    let tick = tick();

    let mut info = RecordingInfo::new("controller 0.1.0", tick.receive_ns - 5_000);
    info.started = UNIX_EPOCH + Duration::from_nanos(START_NS);
    info.seed = Some(9);
    let rig = Attachment {
        name: "rig.toml".to_owned(),
        media_type: "application/toml".to_owned(),
        data: b"name = \"bench\"\n".to_vec(),
    };
    let mut writer = RecordingWriter::create(&path, &info, std::slice::from_ref(&rig)).unwrap();
    writer.write(&tick).unwrap();
    writer.event(tick.receive_ns + 7, EventLevel::Warning, "link", "late").unwrap();
    writer.finish().unwrap();

    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/recording_read_back.py");
    let output = Command::new("python3").arg(script).arg(&path).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    std::fs::remove_dir_all(folder).unwrap();
    let lines: Vec<&str> = text.lines().collect();

    for topic in ["/tick", "/sense", "/command", "/event"] {
        assert!(lines.contains(&format!("count {topic} 1").as_str()), "{text}");
    }
    assert!(lines.contains(&"metadata recording program controller 0.1.0"), "{text}");
    assert!(lines.contains(&"metadata recording seed 9"), "{text}");
    let attached = format!("attachment rig.toml application/toml {}", hex_bytes(&rig.data));
    assert!(lines.contains(&attached.as_str()), "{text}");

    let at = START_NS + 5_000;
    let frame = |name: &str, bytes: &[u8]| {
        let (data, length) = (hex_bytes(bytes), bytes.len());
        format!("message {name} pneumatic.Frame 1 {at} {at} data={data} length={length}")
    };
    assert!(lines.contains(&frame("/sense", &tick.sense).as_str()), "{text}");
    assert!(lines.contains(&frame("/command", &tick.command).as_str()), "{text}");
    let event = at + 7;
    let event =
        format!("message /event foxglove.Log 1 {event} {event} timestamp={event} level=3 message=late name=link");
    assert!(lines.contains(&event.as_str()), "{text}");

    let law = |side: &str, law: &LawParts| {
        format!(
            "law_{side}_feed_forward={} law_{side}_proportional={} law_{side}_integral={} law_{side}_u_raw={}",
            hex(law.feed_forward),
            hex(law.proportional),
            hex(law.integral),
            hex(law.u_raw)
        )
    };
    let shares = |side: &str, law: &LawParts| {
        format!("law_{side}_backlash={} law_{side}_correction={}", hex(law.backlash), hex(law.correction))
    };
    let expected = format!(
        "message /tick pneumatic.Tick 1 {at} {at} session={} tick=3 receive_ns={} arrival=1 volts={} \
         echo_pos={} echo_neg={} crio_state=3 crio_trip=255 p_pos_kpa={} p_neg_kpa={} ref_pos_kpa={} \
         ref_neg_kpa={} predicted_pos_kpa={} predicted_neg_kpa={} {} {} u_pos={} u_neg={} pump_on=1 \
         mode=2 state=200 fault=65535 arrival_lateness_ns=-1234567890123 receive_check_ns=11 \
         predict_ns=12 law_ns=13 send_ns=14 compute_ns=4294967295 deadline_missed=1 records_dropped=5 {} {} \
         findings=18446744073709551615 inputs=2337 observation_hash=9223372036854775808 policy_output={} \
         policy_stage=6 authority={} swap_id=17 command_before_filter={} filter_active=1 \
         experiment=2 exploration_pos={} exploration_neg={} exploration_plan={}",
        0xDEAD_BEEF_u32,
        tick.receive_ns,
        hex_all(tick.volts.map(f64::from)),
        hex(tick.echo_pos.into()),
        hex(tick.echo_neg.into()),
        hex(tick.p_pos_kpa),
        hex(tick.p_neg_kpa),
        hex(tick.ref_pos_kpa),
        hex(tick.ref_neg_kpa),
        hex_all(tick.predicted_pos_kpa),
        hex_all(tick.predicted_neg_kpa),
        law("pos", &tick.law_pos),
        law("neg", &tick.law_neg),
        hex(tick.u_pos),
        hex(tick.u_neg),
        shares("pos", &tick.law_pos),
        shares("neg", &tick.law_neg),
        hex_all(tick.policy_output.map(f64::from)),
        hex(tick.authority),
        hex_all(tick.command_before_filter),
        hex(tick.exploration_pos),
        hex(tick.exploration_neg),
        hex_all(tick.exploration_plan.map(f64::from)),
    );
    let found = lines.iter().find(|line| line.starts_with("message /tick")).copied();
    assert_eq!(found, Some(expected.as_str()));
}

/// The lines of `docs/recordings.md`, as they stand there.
#[test]
fn the_python_lines_of_the_page_open_a_recording() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/recordings.md");
    let page = std::fs::read_to_string(page).unwrap();
    // The first block is for the project's own package, whose tests run it.
    let from = page.split("```python\n").nth(2).unwrap();
    let (lines, _) = from.split_once("```").unwrap();
    let packages = Command::new("python3").args(["-c", "import mcap, mcap_protobuf, numpy, pandas"]).output();
    if !packages.is_ok_and(|output| output.status.success()) {
        println!("skipped: needs python3 with the packages mcap, mcap-protobuf-support, numpy and pandas");
        return;
    }
    let folder = std::env::temp_dir().join(format!("recording-page-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("run.mcap");
    let mut writer = RecordingWriter::create(&path, &RecordingInfo::new("controller 0.1.0", 0), &[]).unwrap();
    for k in 0..3 {
        writer.write(&TickRecord { tick: k, p_pos_kpa: 90.0 + f64::from(k), ..tick() }).unwrap();
    }
    writer.finish().unwrap();
    let output = Command::new("python3").args(["-c", lines]).arg(&path).output().unwrap();
    std::fs::remove_dir_all(folder).unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(String::from_utf8_lossy(&output.stdout), "3 rows; largest positive pressure 92.0 kPa\n");
}

/// Every path of the layout is a field of a message that recordings have.
#[test]
fn the_foxglove_layout_names_fields_that_are_there() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let layout = std::fs::read_to_string(folder.join("../docs/foxglove-layout.json")).unwrap();
    let layout: serde_json::Value = serde_json::from_str(&layout).unwrap();
    let schema = std::fs::read_to_string(folder.join("src/recording/mcap_file/schema.rs")).unwrap();
    let panels = layout["configById"].as_object().unwrap();
    let paths = panels.values().filter_map(|panel| panel["paths"].as_array()).flatten();
    let mut count = 0;
    for path in paths.map(|path| path["value"].as_str().unwrap()) {
        let field = path.strip_prefix("/tick.").unwrap().split('[').next().unwrap();
        assert!(schema.contains(&format!(" {field} = ")), "{path}");
        count += 1;
    }
    assert!(count > 10 && panels["RosOut!events"]["topicToRender"] == "/event");
}
