//! No trip without a cause: rigs that the monitor's nominal model does not know, flown in lockstep.
//!
//! The long one, 10 h of flight over 20 rigs: `cargo test --release --workspace --test false_trips -- --ignored --nocapture`;
//! `MINUTES` in the environment sets another time for each rig.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::fmt::Write as _;
use std::sync::atomic::{AtomicUsize, Ordering};

use controller::config::Safety;
use controller::cycle::Cycle;
use controller::operator::notice::Notice;
use evaluate::rigs_around::rigs_around;
use model::rig::Rig;
use proto::reference::Reference;
use supervisor::Arming;
use tests::coarse_rigs::coarse;
use tests::dice::Dice;
use tests::lockstep::Flight;
use tests::strange_rigs::{with_other_parts, with_sensor_lag, with_volumes};

/// Ticks of a minute.
const MINUTE: u64 = 3_000;
/// Levels that are stepped between: time until the next (s), kPa gauge. All are within reach of the rigs drawn around `bench`.
const STEPS: [(f64, f64, f64); 8] = [
    (5.0, 85.0, -72.0),
    (4.0, 70.0, -66.0),
    (4.0, 100.0, -75.0),
    (3.0, 90.0, -67.0),
    (3.0, 75.0, -68.0),
    (5.0, 95.0, -75.0),
    (2.0, 80.0, -66.0),
    (4.0, 80.0, -72.0),
];

/// Who decides.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum By {
    Fallback,
    Policy,
}

/// Course that is followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Course {
    Paper,
    Steps,
    /// Steps half as far, behind holds five times as long: by then the model's record is of a rig at rest. (Not as far: of 20 rigs three
    /// cannot come from 100 to 70 kPa for as long as the negative reference is at -66 kPa, and are vented for that.)
    RareSteps,
    /// Levels for long, 5 kPa/s from one to the next.
    RareMoves,
}

/// The paper's reference or steps, again and again for so many minutes.
fn reference(course: Course, minutes: f64) -> Reference {
    let mut csv = "time_s,ref_pos_kpa,ref_neg_kpa\n".to_owned();
    let (paper, end_s) = (Reference::paper(), 60.0 * minutes);
    let mut time_s = 0.0;
    for round in 0.. {
        let row = match course {
            Course::Paper => {
                let [pos, neg] = paper.at(0.1 * f64::from(round) % paper.end_s());
                writeln!(csv, "{time_s:.2},{pos},{neg}").unwrap();
                0.1
            }
            Course::Steps | Course::RareSteps | Course::RareMoves => {
                let (seconds, pos, neg) = match (course, STEPS[round as usize % STEPS.len()]) {
                    (Course::Steps, step) => step,
                    (_, (seconds, pos, neg)) => (5.0 * seconds, 0.5 * (pos + 85.0), neg),
                };
                let moves_s = if course == Course::RareMoves { 3.0 } else { 0.02 };
                writeln!(csv, "{time_s:.2},{pos},{neg}\n{:.2},{pos},{neg}", time_s + seconds - moves_s).unwrap();
                seconds
            }
        };
        time_s += row;
        if time_s >= end_s {
            break;
        }
    }
    Reference::parse("course.csv", csv.as_bytes()).unwrap()
}

/// Flies so many ticks, disarmed and armed anew every two minutes; what vented it.
fn trips(rig: &Rig, model: &Rig, (by, course): (By, Course), ticks: u64, seed: u64) -> Vec<String> {
    let policy = (by == By::Policy).then(|| controller::daemon::shipped_policy().unwrap().0);
    let minutes = ticks as f64 / MINUTE as f64;
    let cycle = Cycle::new(model, policy, reference(course, minutes), Safety::default(), Arming::Automatic).unwrap();
    trips_of(Flight::new(rig, cycle, seed), rig, &format!("by {by:?} on {course:?}"), ticks)
}

/// Trips of a flight that is laid out already.
fn trips_of(mut flight: Flight, rig: &Rig, told_as: &str, ticks: u64) -> Vec<String> {
    let (mut found, mut armed) = (Vec::new(), 0);
    for tick in 0..ticks {
        if tick % (2 * MINUTE) == 2 * MINUTE - 50 {
            flight.cycle.disarm();
        }
        if tick % (2 * MINUTE) == 10 && tick > 10 {
            flight.cycle.arm();
        }
        for notice in flight.step().told {
            match notice {
                Notice::Armed { .. } => armed += 1,
                Notice::Vented { cause, tick, value } => {
                    found.push(format!("{} {told_as}: tick {tick}, {cause:?} {value:.2}", rig.name));
                }
                _ => {}
            }
        }
        if !found.is_empty() {
            // What follows a trip is no flight.
            break;
        }
    }
    assert!(armed >= 1, "{} was never armed", rig.name);
    found
}

/// Flies all rigs, on as many threads as there are CPUs; what vented any of them.
fn fly_all(rigs: &[(Rig, Rig)], ticks: u64, each: &(dyn Fn(usize) -> Vec<(By, Course)> + Sync)) -> Vec<String> {
    let next = AtomicUsize::new(0);
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        let work = || {
            let mut found = Vec::new();
            loop {
                let n = next.fetch_add(1, Ordering::Relaxed);
                let Some((rig, model)) = rigs.get(n) else { return found };
                let flights = each(n);
                for flight in &flights {
                    found.extend(trips(rig, model, *flight, ticks / flights.len() as u64, n as u64 + 1));
                }
                println!("rig {n} ({}): {} ticks, {} trips so far here", rig.name, ticks, found.len());
            }
        };
        let started: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        started.into_iter().flat_map(|thread| thread.join().unwrap()).collect()
    })
}

fn nominal() -> Rig {
    coarse("dual_pressure")
}

#[test]
fn a_minute_on_rigs_that_the_model_does_not_know_trips_nothing() {
    let bench = coarse("bench");
    let mut rigs: Vec<(Rig, Rig)> =
        rigs_around(&bench, 3, 7).unwrap().into_iter().map(|rig| (rig, nominal())).collect();
    rigs.push((bench, nominal()));
    let both = |n: usize| {
        if n.is_multiple_of(2) {
            vec![(By::Fallback, Course::Steps), (By::Policy, Course::Paper)]
        } else {
            vec![(By::Policy, Course::Steps), (By::Fallback, Course::Paper)]
        }
    };
    assert_eq!(fly_all(&rigs, 2 * MINUTE, &both), Vec::<String>::new());
}

#[test]
fn a_late_sensor_trips_nothing_whether_the_model_knows_of_it_or_not() {
    let bench = coarse("bench");
    let late: Vec<Rig> = [60.0, 160.0].into_iter().map(|ms| with_sensor_lag(&bench, ms)).collect();
    let told = with_sensor_lag(&nominal(), 160.0);
    let rigs: Vec<(Rig, Rig)> = vec![
        (late[0].clone(), nominal()),
        (late[1].clone(), nominal()),
        (late[1].clone(), late[1].clone()),
        (told.clone(), told),
    ];
    let flights = |_: usize| vec![(By::Fallback, Course::Steps), (By::Fallback, Course::Paper)];
    assert_eq!(fly_all(&rigs, MINUTE, &flights), Vec::<String>::new());
}

#[test]
fn a_rig_that_is_much_slower_than_its_model_trips_nothing() {
    let rigs: Vec<(Rig, Rig)> = [(nominal(), 3.0), (nominal(), 10.0), (coarse("bench"), 10.0)]
        .into_iter()
        .map(|(rig, times)| (with_volumes(&rig, times), nominal()))
        .collect();
    let flights = |_: usize| vec![(By::Fallback, Course::Steps), (By::Fallback, Course::Paper)];
    assert_eq!(fly_all(&rigs, MINUTE, &flights), Vec::<String>::new());
}

/// Filling and the first half minute on rigs of which no part is as the model says: what a wrong gain looks like, and is none.
#[test]
fn rigs_whose_parts_are_all_others_fill_and_hold_without_a_trip() {
    let mut found = Vec::new();
    for n in 0..16 {
        let base = coarse(if n % 2 == 0 { "dual_pressure" } else { "bench" });
        let rig = with_other_parts(&base, 0.1, &mut Dice::new(n + 100));
        let cycle =
            Cycle::new(&nominal(), None, Reference::constant(85.0, -70.0), Safety::default(), Arming::Automatic)
                .unwrap();
        let mut flight = Flight::new(&rig, cycle, n + 1);
        let told = (0..1_500).flat_map(|_| flight.step().told).filter(|notice| matches!(notice, Notice::Vented { .. }));
        found.extend(told.map(|notice| format!("{} {n}: {notice:?}", rig.name)));
    }
    assert_eq!(found, Vec::<String>::new());
}

/// 30 min on each of 20 rigs, half of it by the policy.
#[test]
#[ignore = "10 h of flight: half an hour of two cores"]
fn ten_hours_over_twenty_rigs_trip_nothing() {
    let minutes: u64 = std::env::var("MINUTES").ok().and_then(|text| text.parse().ok()).unwrap_or(30);
    let bench = coarse("bench");
    let rigs: Vec<(Rig, Rig)> = rigs_around(&bench, 20, 1).unwrap().into_iter().map(|rig| (rig, nominal())).collect();
    let courses = [Course::Steps, Course::Paper, Course::RareSteps, Course::RareMoves];
    let flights =
        |_: usize| [By::Fallback, By::Policy].into_iter().flat_map(|by| courses.map(|course| (by, course))).collect();
    let found = fly_all(&rigs, minutes * MINUTE, &flights);
    println!("{} rigs, {minutes} min each: {} trips", rigs.len(), found.len());
    assert_eq!(found, Vec::<String>::new());
}

/// Tests of the thorough tier (docs/testing.md).
mod thorough {
    use super::*;

    /// A rig that has rested long is stepped: the record of what the model leaves is of a rest, and says nothing of a step.
    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn a_step_behind_a_long_hold_trips_nothing() {
        let bench = coarse("bench");
        let count = std::env::var("RIGS").ok().and_then(|rigs| rigs.parse().ok()).unwrap_or(3);
        let mut rigs: Vec<(Rig, Rig)> =
            rigs_around(&bench, count, 11).unwrap().into_iter().map(|rig| (rig, nominal())).collect();
        rigs.push((bench, nominal()));
        let flights = |_: usize| vec![(By::Fallback, Course::RareSteps), (By::Policy, Course::RareMoves)];
        assert_eq!(fly_all(&rigs, 6 * MINUTE, &flights), Vec::<String>::new());
    }

    /// Converters of other makers: without any noise, with less than a step of it, and with twenty times as much as the one at hand; in
    /// `NOISES_MV` others, parted by commas.
    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn quiet_and_noisy_converters_trip_nothing() {
        let noises = std::env::var("NOISES_MV").unwrap_or_else(|_| "0,0.05,1,5".to_owned());
        let noises: Vec<f64> = noises.split(',').map(|mv| mv.parse().expect("a noise in mV")).collect();
        let of_course = |(name, course): (&str, Course)| {
            let rig = coarse(name);
            let mut found = Vec::new();
            for (n, noise_mv) in noises.iter().enumerate() {
                let cycle =
                    Cycle::new(&nominal(), None, reference(course, 2.0), Safety::default(), Arming::Automatic).unwrap();
                let flight = Flight::new(&rig, cycle, 1).with_noise(&rig, 1e-3 * noise_mv, n as u64 + 1);
                found.extend(trips_of(flight, &rig, &format!("with {noise_mv} mV on {course:?}"), 2 * MINUTE));
            }
            found
        };
        let found: Vec<String> = std::thread::scope(|scope| {
            let courses = [("bench", Course::RareSteps), ("dual_pressure", Course::RareMoves)];
            let started = courses.map(|course| scope.spawn(move || of_course(course)));
            started.into_iter().flat_map(|flown| flown.join().unwrap()).collect()
        });
        assert_eq!(found, Vec::<String>::new());
    }
}
