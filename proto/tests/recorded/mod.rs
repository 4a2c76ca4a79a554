//! A run as the daemon records it, its bits, and a folder to keep it in, for the tests of recordings.

// Each test program uses its own part of this.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::path::{Path, PathBuf};
use std::time::{Duration, UNIX_EPOCH};

use proto::recording::{Arrival, LawParts, RecordingInfo, RecordingWriter, TickRecord};

/// A folder of this test's own, gone at the end.
pub struct Folder(PathBuf);

impl Folder {
    pub fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("recording-{}-{name}", std::process::id()));
        let _ = std::fs::remove_dir_all(&path);
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    pub fn join(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

pub fn info() -> RecordingInfo {
    let mut info = RecordingInfo::new("controller 0.1.0", 1_000);
    info.started = UNIX_EPOCH + Duration::from_secs(1_795_140_245);
    info
}

/// Every bit of a record, so that NaN compares with NaN.
pub fn bits(tick: &TickRecord) -> Vec<u64> {
    let law = |l: &LawParts| {
        [l.feed_forward, l.backlash, l.correction, l.proportional, l.integral, l.u_raw].map(f64::to_bits)
    };
    let byte = |b: &u8| u64::from(*b);
    let mut all = vec![
        tick.session.into(),
        tick.tick.into(),
        tick.receive_ns,
        tick.arrival.code().into(),
        tick.sense_present.into(),
        tick.command_present.into(),
        tick.crio_state.into(),
        tick.crio_trip.into(),
        tick.pump_on.into(),
        tick.mode.into(),
        tick.state.into(),
        tick.fault.into(),
        tick.arrival_lateness_ns as u64,
        tick.receive_check_ns.into(),
        tick.predict_ns.into(),
        tick.law_ns.into(),
        tick.send_ns.into(),
        tick.compute_ns.into(),
        tick.deadline_missed.into(),
        tick.records_dropped.into(),
        tick.findings,
        tick.inputs.into(),
        tick.observation_hash,
        tick.policy_stage.into(),
        tick.authority.to_bits(),
        tick.swap_id.into(),
        tick.filter_active.into(),
        tick.experiment.into(),
        tick.exploration_pos.to_bits(),
        tick.exploration_neg.to_bits(),
    ];
    all.extend(tick.policy_output.iter().chain(&tick.exploration_plan).map(|v| u64::from(v.to_bits())));
    all.extend(tick.command_before_filter.map(f64::to_bits));
    all.extend(tick.sense.iter().map(byte));
    all.extend(tick.command.iter().map(byte));
    let single = [tick.echo_pos, tick.echo_neg];
    all.extend(tick.volts.iter().chain(&single).map(|v| u64::from(v.to_bits())));
    let double = [tick.p_pos_kpa, tick.p_neg_kpa, tick.ref_pos_kpa, tick.ref_neg_kpa];
    let predicted = tick.predicted_pos_kpa.iter().chain(&tick.predicted_neg_kpa);
    all.extend(double.iter().chain(predicted).map(|v| v.to_bits()));
    all.extend([tick.u_pos, tick.u_neg].map(f64::to_bits));
    all.extend(law(&tick.law_pos).into_iter().chain(law(&tick.law_neg)));
    all
}

pub fn all_bits(ticks: &[TickRecord]) -> Vec<Vec<u64>> {
    ticks.iter().map(bits).collect()
}

/// A run as the daemon makes it: readings, a command and both frames in every tick.
pub fn run(ticks: u32) -> Vec<TickRecord> {
    (0..ticks)
        .map(|tick| {
            let t = f64::from(tick) / 50.0;
            let mut record = TickRecord {
                session: 77,
                tick,
                receive_ns: 1_000 + u64::from(tick) * 20_000_000 + u64::from(tick * 7_919 % 90_001),
                arrival: Arrival::InTime,
                sense_present: true,
                command_present: true,
                p_pos_kpa: 80.0 + t / 3.0 + 6.0 * (t * 0.785).sin(),
                p_neg_kpa: -70.0 - t / 12.0 + 3.0 * (t * 0.628).sin(),
                ref_pos_kpa: 80.0 + t / 3.0,
                ref_neg_kpa: -70.0 - t / 12.0,
                u_pos: 0.7 + 0.1 * t.sin(),
                u_neg: 0.8 + 0.1 * t.cos(),
                pump_on: true,
                mode: 1,
                ..TickRecord::default()
            };
            // Everything else that a tick measures or computes, with noise in its last bits.
            let noise = |k: u32| f64::from((tick * 26_107 + k * 40_503) % 10_007) / 10_007.0 - 0.5;
            record.volts = [4.2 + 0.003 * noise(1) as f32, 3.9 + 0.003 * noise(2) as f32, f32::NAN, f32::NAN];
            (record.echo_pos, record.echo_neg) = (record.u_pos as f32, record.u_neg as f32);
            record.p_pos_kpa += 0.1 * noise(3);
            record.p_neg_kpa += 0.03 * noise(4);
            let ahead = |p: f64| std::array::from_fn(|i| p + 0.02 * noise(5 + i as u32));
            record.predicted_pos_kpa = ahead(record.p_pos_kpa);
            record.predicted_neg_kpa = ahead(record.p_neg_kpa);
            let law = |u: f64, k: u32| LawParts {
                feed_forward: u + 0.01 * noise(k),
                proportional: 0.01 * noise(k + 1),
                integral: 0.02 * noise(k + 2),
                u_raw: u,
                ..LawParts::default()
            };
            (record.law_pos, record.law_neg) = (law(record.u_pos, 10), law(record.u_neg, 20));
            let ns = |typical: f64, k: u32| (typical * (1.0 + 0.2 * noise(k))) as u32;
            record.arrival_lateness_ns = i64::from(ns(60_000.0, 30)) - 60_000;
            record.receive_check_ns = ns(4_000.0, 31);
            record.predict_ns = ns(300_000.0, 32);
            record.law_ns = ns(2_000.0, 33);
            record.send_ns = ns(15_000.0, 34);
            record.compute_ns = ns(321_000.0, 35);
            record.sense = std::array::from_fn(|i| (tick as usize * 31 + i * 17) as u8);
            record.command = std::array::from_fn(|i| (tick as usize * 13 + i * 7) as u8);
            record
        })
        .collect()
}

pub fn write(path: &Path, ticks: &[TickRecord], flush_every: usize) {
    let mut writer = RecordingWriter::create(path, &info(), &[]).unwrap();
    for seconds in ticks.chunks(flush_every) {
        for tick in seconds {
            writer.write(tick).unwrap();
        }
        writer.flush().unwrap();
    }
    assert_eq!(writer.finish().unwrap(), path);
}
