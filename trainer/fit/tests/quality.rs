//! Each check fires on a recording made bad in its way, and none fires on good ones.
#![allow(clippy::unwrap_used, clippy::panic)] // a test that cannot set up its case must fail

mod made;

use fit::data::quality::{Quality, Severity, Trouble};
use fit::data::{Records, noise};
use made::{noisy, quick_rig, recording, recording_at, truth};
use model::rig::Rig;
use proto::recording::Recording;
use proto::recording::csv::{Column, ColumnData};
use rand::{RngExt as _, SeedableRng};
use rand_pcg::Pcg64Mcg;

const ROWS: usize = 2000;

struct Good {
    rig: Rig,
    duty: [Vec<f64>; 2],
    pressures: [Vec<f64>; 2],
}

fn good() -> Good {
    let rig = quick_rig();
    let (duty, pressures) = truth(&rig, ROWS, 11);
    Good { rig, duty, pressures: noisy(&pressures, 12) }
}

fn quality(rig: &Rig, recordings: &[Recording]) -> Quality {
    let records = Records::new(rig, recordings).unwrap();
    let noise = noise(&records);
    Quality::of(rig, &records, &noise).unwrap()
}

/// The finding of a kind, which must name the file or column and be of this severity.
fn assert_finds(quality: &Quality, trouble: Trouble, severity: Severity, words: &[&str]) {
    let found = quality.findings.iter().find(|f| f.trouble == trouble);
    let found = found.unwrap_or_else(|| panic!("{trouble:?} not among {:?}", quality.findings));
    assert_eq!(found.severity, severity, "{found}");
    let text = found.to_string();
    assert!(!text.contains('\n'));
    for word in words {
        assert!(text.contains(word), "`{word}` is not in: {text}");
    }
}

#[test]
fn good_recordings_have_no_findings() {
    let g = good();
    let found = quality(&g.rig, &[recording("good.csv", &g.duty, &g.pressures)]);
    assert_eq!(found.findings, []);
    assert!(found.usable.iter().all(|u| *u == 1.0));
    // A rig whose parts are all ten per cent off is a rig to be identified, not a bad recording.
    let mut other = g.rig.clone();
    for valve in other.valves.values_mut() {
        valve.input_area_mm2 *= 1.1;
        valve.spring_area_mm2 *= 1.08;
    }
    other.volumes[0].volume_l *= 0.9;
    assert_eq!(quality(&other, &[recording("good.csv", &g.duty, &g.pressures)]).findings, []);
}

#[test]
fn noise_is_measured() {
    let g = good();
    let records = Records::new(&g.rig, &[recording("good.csv", &g.duty, &g.pressures)]).unwrap();
    for channel in noise(&records) {
        let expected = (made::SIGMA_KPA.powi(2) + made::STEP_KPA.powi(2) / 12.0).sqrt();
        // 2000 readings, of which five go into each difference: ±3 %; the plant's own steps add a little.
        assert!((channel.sigma_kpa / expected - 1.0).abs() < 0.06, "{channel:?}, {expected}");
        assert!((channel.step_kpa - made::STEP_KPA).abs() < 1e-6, "{channel:?}");
    }
}

/// A sensor that drops out for one reading in seven, or lacks one in five, has the noise of the others.
#[test]
fn noise_is_that_of_sound_readings() {
    let g = good();
    let records =
        |pressures: &[Vec<f64>; 2]| Records::new(&g.rig, &[recording("good.csv", &g.duty, pressures)]).unwrap();
    let sound = noise(&records(&g.pressures));
    let mut dropped = g.pressures.clone();
    dropped[0].iter_mut().skip(3).step_by(7).for_each(|p| *p = 0.0);
    let left_out: Vec<bool> = (0..2 * ROWS).map(|place| place % 5 == 2).collect();
    let missing = records(&g.pressures).without_readings(&left_out);
    for (what, records) in [("dropped", records(&dropped)), ("missing", missing)] {
        for (of, sound) in noise(&records).iter().zip(&sound) {
            assert!((of.sigma_kpa / sound.sigma_kpa - 1.0).abs() < 0.15, "{what}: {of:?} {sound:?}");
        }
    }
    let found = quality(&g.rig, &[recording("dropped.csv", &g.duty, &dropped)]);
    assert_finds(&found, Trouble::Spikes, Severity::Unusable, &["p_pos_kpa", "286 wild readings"]);
    assert!(!found.has(Trouble::Clipped), "{:?}", found.findings);
}

#[test]
fn too_short() {
    let g = good();
    let cut = |rows: usize| {
        let part = |c: &[Vec<f64>; 2]| [c[0][..rows].to_vec(), c[1][..rows].to_vec()];
        recording("short.csv", &part(&g.duty), &part(&g.pressures))
    };
    let found = quality(&g.rig, &[cut(600)]);
    assert_finds(&found, Trouble::TooShort, Severity::Unusable, &["12.0 s", "20 s"]);
    assert!(found.refusal().is_some());
    let beside = quality(&g.rig, &[recording("good.csv", &g.duty, &g.pressures), cut(300)]);
    assert_finds(&beside, Trouble::TooShort, Severity::Doubtful, &["short.csv", "6.0 s"]);
    assert!(beside.refusal().is_none());
}

#[test]
fn flat_stuck_clipped_and_wild_readings() {
    let g = good();
    let with = |change: &dyn Fn(&mut Vec<f64>)| {
        let mut pressures = g.pressures.clone();
        change(&mut pressures[0]);
        quality(&g.rig, &[recording("bad.csv", &g.duty, &pressures)])
    };
    let flat = with(&|p| p.fill(90.0));
    assert_finds(&flat, Trouble::Flat, Severity::Unusable, &["bad.csv", "p_pos_kpa", "90.00"]);

    let stuck = with(&|p| {
        let value = 0.5 * (p[700] + p[701]);
        p[700..800].fill((value / 0.03).round() * 0.03);
    });
    assert_finds(&stuck, Trouble::Stuck, Severity::Doubtful, &["p_pos_kpa", "100 readings", "2.0 s"]);
    assert!(stuck.usable[700..800].iter().all(|u| *u == 0.0) && stuck.usable[690] == 1.0);

    // A reading without noise that stands for most of the recording leaves nothing to tell noise by.
    let smooth: Vec<f64> = (0..ROWS).map(|k| -60.0 + 5.0 * (0.01 * k as f64).sin()).collect();
    let frozen = |from: usize| {
        let mut pressures = g.pressures.clone();
        pressures[1].clone_from(&smooth);
        pressures[1][from..].fill(smooth[from]);
        quality(&g.rig, &[recording("bad.csv", &g.duty, &pressures)])
    };
    assert_finds(&frozen(700), Trouble::Stuck, Severity::Unusable, &["p_neg_kpa", "26.0 s", "dead sensor"]);
    assert!(frozen(700).usable[ROWS + 700..2 * ROWS].iter().all(|u| *u == 0.0));

    let mut sorted = g.pressures[0].clone();
    sorted.sort_by(f64::total_cmp);
    let limit = (sorted[ROWS * 9 / 10] / 0.03).round() * 0.03;
    let clipped = with(&|p| p.iter_mut().for_each(|v| *v = v.min(limit)));
    assert_finds(&clipped, Trouble::Clipped, Severity::Doubtful, &["p_pos_kpa", "a limit"]);

    let wild = with(&|p| [300, 900, 1500].map(|k: usize| p[k] += 25.0).into_iter().for_each(drop));
    assert_finds(&wild, Trouble::Spikes, Severity::Doubtful, &["3 wild", "kPa off the neighbours"]);
    assert_eq!(wild.usable[..ROWS].iter().filter(|u| **u == 0.0).count(), 3);

    // A line that rings stands out of its neighbours at every crest; those are readings.
    let ringing = with(&|p| {
        for (k, v) in p.iter_mut().enumerate() {
            *v += 25.0 * (std::f64::consts::TAU * 4.0 * 0.02 * k as f64).sin();
        }
    });
    assert!(ringing.findings.iter().all(|finding| finding.trouble != Trouble::Spikes), "{:?}", ringing.findings);
}

/// An amplifier at its end, and noise behind it: no reading repeats.
#[test]
fn a_limit_in_front_of_the_noise_is_a_limit() {
    let g = good();
    let (_, truth) = truth(&g.rig, ROWS, 11);
    let mut sorted = truth[0].clone();
    sorted.sort_by(f64::total_cmp);
    for share in [0.6, 0.8] {
        let limit = sorted[(share * ROWS as f64) as usize];
        let cut = [truth[0].iter().map(|p| p.min(limit)).collect::<Vec<_>>(), truth[1].clone()];
        let found = quality(&g.rig, &[recording("cut.csv", &g.duty, &noisy(&cut, 12))]);
        let words = ["p_pos_kpa", "within their noise", "a limit"];
        assert_finds(&found, Trouble::Clipped, Severity::Doubtful, &words);
        // Runs of less than half a second at the limit stay, and nothing else goes.
        let at_limit = |row: &usize| truth[0][*row] >= limit;
        let left_out: Vec<usize> = (0..ROWS).filter(|row| found.usable[*row] == 0.0).collect();
        let wrongly = left_out.iter().filter(|row| truth[0][**row] < limit - 0.5).count();
        let of = (0..ROWS).filter(at_limit).count();
        assert!(
            wrongly == 0 && 2 * left_out.len() > of && left_out.len() < of + 40,
            "{share}: {} of {of}",
            left_out.len()
        );
    }
}

/// A pressure that stands at one level for other reasons is at no limit: a chamber that the pump has filled as far as it can,
/// behind a valve that the rig file says opens later or earlier.
#[test]
fn a_chamber_as_full_as_the_pump_makes_it_is_no_limit() {
    let mut rig = quick_rig();
    let (mut duty, _) = truth(&rig, ROWS, 11);
    for (row, u) in duty[0].iter_mut().enumerate() {
        *u = if (row / 250).is_multiple_of(2) { 0.0 } else { 0.75 };
    }
    let blank = recording("blank", &duty, &[vec![0.0; ROWS], vec![0.0; ROWS]]);
    let records = Records::new(&rig, &[blank]).unwrap();
    let simulator = fit::simulate::Simulator::new(&records, fit::simulate::Fidelity::Detailed);
    let trace = simulator.free(std::slice::from_ref(&rig)).pop().unwrap().unwrap();
    let pressures = noisy(&[0, 1].map(|c| trace[records.layout().channel(0, c)].to_vec()), 12);
    for factor in [1.0, 0.9, 1.1] {
        rig.valves[0].spring_area_mm2 *= factor;
        let found = quality(&rig, &[recording("full.csv", &duty, &pressures)]);
        assert!(!found.has(Trouble::Clipped), "{factor}: {:?}", found.findings);
    }
}

/// The logger was started before the pump, or ran on after it.
#[test]
fn a_pump_that_stands_unseen_is_told() {
    let g = good();
    let (from, to) = (300, 900);
    let at_rest = noisy(&[vec![0.0; ROWS], vec![0.0; ROWS]], 14);
    let stood = |rows: std::ops::Range<usize>| {
        let mut pressures = g.pressures.clone();
        for (values, at_rest) in pressures.iter_mut().zip(&at_rest) {
            values[rows.clone()].copy_from_slice(&at_rest[rows.clone()]);
        }
        quality(&g.rig, &[recording("stood.csv", &g.duty, &pressures)])
    };
    let words = ["stood.csv", "0.00 to 5.98 s", "was the pump off", "pump_on"];
    assert_finds(&stood(0..from), Trouble::PumpStood, Severity::Unusable, &words);
    assert_finds(&stood(to..ROWS), Trouble::PumpStood, Severity::Unusable, &["18.00 to 39.98 s"]);
    assert!(!stood(from..from + 40).has(Trouble::PumpStood), "0.8 s may be anything");
    // Where the recording says that it stood it is no finding.
    let mut pressures = g.pressures.clone();
    pressures.iter_mut().zip(&at_rest).for_each(|(values, at_rest)| values[..from].copy_from_slice(&at_rest[..from]));
    let on: Vec<f64> = (0..ROWS).map(|row| f64::from(u8::from(row >= from))).collect();
    let [[u_pos, u_neg], [p_pos, p_neg]] = [&g.duty, &pressures];
    let all = [("u_pos", u_pos), ("u_neg", u_neg), ("p_pos_kpa", p_pos), ("p_neg_kpa", p_neg), ("pump_on", &on)];
    let columns = all.map(|(name, x)| Column { name: name.to_owned(), data: ColumnData::Numbers(x.clone()) });
    let time_s = (0..ROWS).map(|k| k as f64 * 0.02).collect();
    let said = Recording::new("said.csv", time_s, columns.to_vec()).unwrap();
    assert!(!quality(&g.rig, &[said]).has(Trouble::PumpStood));
}

/// A logger that lost the commands for the second half, and one that lost them for some seconds, in which a chamber only settles.
#[test]
fn commands_that_are_not_recorded_for_a_while_are_told() {
    let g = good();
    let stands = |from: usize, to: usize| {
        let mut duty = g.duty.clone();
        duty.iter_mut().for_each(|u| {
            let last = u[from];
            u[from..to].fill(last);
        });
        quality(&g.rig, &[recording("still.csv", &duty, &g.pressures)])
    };
    let words = ["still.csv", "no command moves, from 18.4 to 40.0 s", "Leave these rows out"];
    assert_finds(&stands(900, ROWS), Trouble::NothingMoves, Severity::Unusable, &words);
    assert!(!stands(900, 1200).has(Trouble::NothingMoves));
}

/// A supply that cycles for a lesser part of a recording while the commands stand is for a comparison to find; two such parts may be the
/// larger one together.
#[test]
fn what_moves_unseen_for_a_lesser_part_leaves_a_recording_usable() {
    let g = good();
    let stands = |parts: &[(usize, usize)]| {
        let mut duty = g.duty.clone();
        for u in &mut duty {
            for (from, to) in parts {
                let last = u[*from];
                u[*from..*to].fill(last);
            }
        }
        quality(&g.rig, &[recording("cycles.csv", &duty, &g.pressures)])
    };
    let once = stands(&[(900, 1700)]);
    let words = ["cycles.csv", "no command moves, from 18.4", "Leave these rows out"];
    assert_finds(&once, Trouble::NothingMoves, Severity::Doubtful, &words);
    assert_eq!(once.findings.iter().filter(|f| f.trouble == Trouble::NothingMoves).count(), 1);
    assert_finds(&stands(&[(100, 800), (1100, 1900)]), Trouble::NothingMoves, Severity::Unusable, &["cycles.csv"]);
}

#[test]
fn gaps_and_uneven_time() {
    let g = good();
    let time = |f: &dyn Fn(usize) -> f64| -> Vec<f64> { (0..ROWS).map(f).collect() };
    let gap = time(&|k| k as f64 * 0.02 + if k >= 800 { 3.0 } else { 0.0 });
    let found = quality(&g.rig, &[recording_at("gap.csv", gap, &g.duty, &g.pressures)]);
    assert_finds(&found, Trouble::Gaps, Severity::Doubtful, &["gap.csv", "1 gaps", "19.00 s"]);
    let torn = time(&|k| k as f64 * 0.02 + (k / 200) as f64);
    let found = quality(&g.rig, &[recording_at("torn.csv", torn, &g.duty, &g.pressures)]);
    assert_finds(&found, Trouble::Gaps, Severity::Unusable, &["9 gaps", "4.0 s"]);
    let jitter = time(&|k| k as f64 * 0.02 + if k % 4 == 3 { 0.004 } else { 0.0 });
    let found = quality(&g.rig, &[recording_at("jitter.csv", jitter, &g.duty, &g.pressures)]);
    assert_finds(&found, Trouble::UnevenTime, Severity::Doubtful, &["jitters", "2.8 ms"]);
    let slow = time(&|k| k as f64 * 0.0206);
    let found = quality(&g.rig, &[recording_at("slow.csv", slow, &g.duty, &g.pressures)]);
    assert_finds(&found, Trouble::UnevenTime, Severity::Doubtful, &["20.60 ms", "3.0 %"]);
}

#[test]
fn swapped_columns_and_duties() {
    let g = good();
    let swap = |c: &[Vec<f64>; 2]| [c[1].clone(), c[0].clone()];
    let pressures = quality(&g.rig, &[recording("swap.csv", &g.duty, &swap(&g.pressures))]);
    assert_finds(&pressures, Trouble::SwappedPressures, Severity::Unusable, &["p_pos_kpa", "p_neg_kpa", "swapped"]);
    let duties = quality(&g.rig, &[recording("swap.csv", &swap(&g.duty), &g.pressures)]);
    assert_finds(&duties, Trouble::SwappedDuties, Severity::Unusable, &["u_pos", "u_neg", "swapped"]);
    let inverted = [g.duty[0].clone(), g.duty[1].iter().map(|u| 1.64 - u).collect()];
    let inverted = quality(&g.rig, &[recording("inverted.csv", &inverted, &g.pressures)]);
    assert_finds(&inverted, Trouble::InvertedDuty, Severity::Unusable, &["u_neg", "wrong way"]);
}

/// A reading that goes the wrong way for a fifth of a second after each step, as one does whose line rings, and follows over
/// seconds all the same: the recording is good.
#[test]
fn what_goes_the_wrong_way_at_first_does_not_invert_a_duty() {
    let g = good();
    let mut random = Pcg64Mcg::seed_from_u64(5);
    let mut steps = |n: usize| -> Vec<f64> { (0..n).map(|_| 0.2 * random.random::<f64>() - 0.1).collect() };
    let held = |values: &[f64]| -> Vec<f64> { values.iter().flat_map(|v| [*v; 10]).collect() };
    let around = |channel: usize| {
        let mut sorted = g.pressures[channel].clone();
        sorted.sort_by(f64::total_cmp);
        sorted[ROWS / 2]
    };
    let of = |u: &[f64], level: f64, [now, before]: [f64; 2]| -> Vec<f64> {
        let mut p = vec![0.0];
        for k in 1..u.len() {
            let earlier = if k > 1 { u[k - 2] } else { 0.0 };
            p.push(0.5 * p[k - 1] + now * u[k - 1] + before * earlier);
        }
        held(&p.iter().map(|p| level + p).collect::<Vec<_>>())
    };
    let u = [steps(600), steps(600)];
    let duty = [0, 1].map(|valve| held(&u[valve].iter().map(|u| 0.8 + u).collect::<Vec<_>>()));
    // The negative valve lets air in: its pressure rises in the end, 60 / 0.5 kPa per unit of duty.
    let pressures = [of(&u[0], around(0), [-60.0, 0.0]), of(&u[1], around(1), [-40.0, 100.0])];
    let found = quality(&g.rig, &[recording("kicked.csv", &duty, &noisy(&pressures, 6))]);
    assert!(found.findings.iter().all(|f| f.severity != Severity::Unusable), "{:?}", found.findings);
}

#[test]
fn wrong_units_and_scales() {
    let g = good();
    let with = |change: &dyn Fn(f64) -> f64| {
        let changed = g.pressures.clone().map(|p| p.into_iter().map(change).collect());
        quality(&g.rig, &[recording("unit.csv", &g.duty, &changed)])
    };
    assert_finds(&with(&|p| p * 0.01), Trouble::WrongUnit, Severity::Unusable, &["unit.csv", "bar"]);
    assert_finds(&with(&|p| p * 0.001), Trouble::WrongUnit, Severity::Unusable, &["MPa"]);
    assert_finds(&with(&|p| p * 0.145_04), Trouble::WrongUnit, Severity::Unusable, &["psi"]);
    assert_finds(&with(&|p| p + 101.325), Trouble::Absolute, Severity::Unusable, &["absolute", "101.3"]);
    // Pa and mbar put the vacuum below −101.325, which reading refuses, unless the positive chamber stands alone;
    // absolute Pa pass.
    assert_finds(&with(&|p| p.abs()), Trouble::WrongUnit, Severity::Unusable, &["sign"]);
    let percent = g.duty.clone().map(|u| u.into_iter().map(|u| u * 0.01).collect());
    let found = quality(&g.rig, &[recording("scale.csv", &percent, &g.pressures)]);
    assert_finds(&found, Trouble::DutyScale, Severity::Unusable, &["u_pos", "share"]);
}

#[test]
fn nothing_happens() {
    let rig = quick_rig();
    let g = good();
    let still = [vec![0.8; ROWS], vec![0.8; ROWS]];
    let level = [vec![g.pressures[0][0]; ROWS], vec![g.pressures[1][0]; ROWS]];
    let found = quality(&rig, &[recording("still.csv", &still, &noisy(&level, 5))]);
    assert_finds(&found, Trouble::NoExcitation, Severity::Unusable, &["u_pos, u_neg: no command moves"]);
    assert!(found.findings.iter().any(|f| f.column == "u_pos" && f.trouble == Trouble::NoExcitation));
}

/// A chamber by itself, in one file open to the air and in another under pressure that it holds, in either order; and a quiet gauge that
/// is off by a little at the open air, which holds nothing.
#[test]
fn what_a_chamber_holds_is_told_by_all_files_and_beyond_a_sensors_drift() {
    let rig = Rig::from_toml(
        "format = 1\nname = \"chamber\"\n[gas]\ngas_constant_j_per_kg_k = 287.0\nheat_capacity_ratio = 1.4\n\
         [atmosphere]\npressure_kpa_abs = 101.325\ntemperature_k = 293.15\n\
         [volumes.chamber]\nvolume_l = 0.5\ntemperature_k = 293.15\n\
         [sensors.gauge]\nvolume = \"chamber\"\ncolumn = \"p_kpa\"\nrange_kpa_gauge = [0.0, 400.0]\nrange_v = [0.0, 5.0]\n",
    )
    .unwrap();
    let file = |source: &str, level_kpa: f64, sigma_kpa: f64| {
        let mut random = Pcg64Mcg::seed_from_u64(7);
        // Uniform, of this standard deviation.
        let mut off = || 12.0_f64.sqrt() * sigma_kpa * (random.random::<f64>() - 0.5);
        let p = (0..ROWS).map(|_| level_kpa + off()).collect();
        let column = Column { name: "p_kpa".to_owned(), data: ColumnData::Numbers(p) };
        Recording::new(source, (0..ROWS).map(|k| k as f64 * 0.02).collect(), vec![column]).unwrap()
    };
    let (open, held) = (file("open.csv", 0.0, 0.06), file("held.csv", 200.0, 0.06));
    for files in [[open.clone(), held.clone()], [held, open]] {
        assert_finds(&quality(&rig, &files), Trouble::NoExcitation, Severity::Doubtful, &["stands at 200.0 kPa"]);
        assert_eq!(quality(&rig, &files).refusal(), None);
    }
    let quiet = quality(&rig, &[file("quiet.csv", 0.3, 0.005)]);
    assert_finds(&quiet, Trouble::NoExcitation, Severity::Unusable, &["no pressure moves"]);
}

/// A chamber that reads half of what is expected for a while, as one does whose relief valve is open, stands where absolute inches of
/// mercury would put it there, and nowhere else.
#[test]
fn what_one_place_alone_suits_is_no_other_unit() {
    let g = good();
    let relieved: Vec<f64> =
        g.pressures[0].iter().enumerate().map(|(row, p)| if row < 900 { 0.58 * p } else { *p }).collect();
    let found = quality(&g.rig, &[recording("relieved.csv", &g.duty, &[relieved, g.pressures[1].clone()])]).findings;
    assert!(!found.iter().any(|f| matches!(f.trouble, Trouble::WrongUnit | Trouble::Absolute)), "{found:?}");
}

/// A shut chamber that a leak empties stands where no rig file says; here at half an atmosphere in absolute inches of mercury.
#[test]
fn a_leak_that_empties_shut_chambers_is_no_other_unit() {
    let rig = quick_rig();
    let (rows, running) = (850, 150);
    let on = |row: usize, value: f64| if row < running { value } else { 0.0 };
    let duty = [0.74, 0.90].map(|u| (0..rows).map(|row| on(row, u)).collect::<Vec<f64>>());
    let relay: Vec<f64> = (0..rows).map(|row| on(row, 1.0)).collect();
    // 8 kPa/s at first, as a leak of 1e-15 kg/(s Pa²) from one chamber into the other does it.
    let pressures = [97.0, -72.7].map(|start: f64| {
        (0..rows).map(|row| start * (-0.04 * 0.02 * row.saturating_sub(running) as f64).exp()).collect::<Vec<f64>>()
    });
    let time_s = (0..rows).map(|k| k as f64 * 0.02).collect();
    let columns = [("u_pos", &duty[0]), ("u_neg", &duty[1]), ("pump_on", &relay)];
    let columns = columns.into_iter().chain(["p_pos_kpa", "p_neg_kpa"].into_iter().zip(&pressures));
    let columns = columns.map(|(name, c)| Column { name: name.to_owned(), data: ColumnData::Numbers(c.clone()) });
    let shut_in = Recording::new("shut_in.csv", time_s, columns.collect()).unwrap();
    let found = quality(&rig, &[shut_in]).findings;
    assert!(!found.iter().any(|f| matches!(f.trouble, Trouble::WrongUnit | Trouble::Absolute)), "{found:?}");
}
