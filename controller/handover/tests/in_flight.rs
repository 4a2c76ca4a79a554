//! Policies change while the loop is closed: good ones arrive, bad ones lose, nothing bumps.
#![allow(clippy::unwrap_used, clippy::panic)]

#[path = "../../admission/tests/corpus/mod.rs"]
mod corpus;
mod loop_on_bench;

use corpus::{bad_networks, network, perturbed, shipped};
use handover::{Candidate, Command, Haste, Loss, PolicyEvent, PolicyTag, StageNow};
use loop_on_bench::{ENVELOPE, Loop, policy};
use proto::reference::Reference;

/// Scatter that the converter's noise gives a limit of the envelope: five standard deviations, 0.06 and 0.006 kPa each.
const SCATTER_KPA: [f64; 2] = [0.3, 0.03];
/// The largest change of a duty while one controller decides on the paper's reference (0.025), and twice that for the blend.
const CALM_DUTY: f64 = 0.06;
/// Twenty minutes: how long a candidate may be on its way here.
const MOST_TICKS: u32 = 60_000;

fn rms(errors: &[[f64; 2]], c: usize) -> f64 {
    (errors.iter().map(|e| e[c] * e[c]).sum::<f64>() / errors.len() as f64).sqrt()
}

/// The shipped policy over the fallback on `bench`: through all stages, without a bump, and better in the end.
#[test]
fn a_better_policy_comes_to_full_authority_within_ten_minutes() {
    let mut run = Loop::new(None, Reference::paper(), 1);
    run.ticks(400);
    run.steepest = 0.0;
    let candidate = Candidate::new(policy(&shipped()));
    let tag = candidate.tag;
    assert!(run.store.ask(Command::Try(candidate, Haste::Proving)).is_ok());
    let active = run.until(30_000, |run| run.arbiter.active() == tag);
    println!("{:?}", run.events);
    assert!(active, "not active after ten minutes: {:?}", run.snapshot());
    let stages: Vec<u8> = run
        .events
        .iter()
        .filter_map(|(_, event)| if let PolicyEvent::Passed(_, stage) = event { Some(*stage) } else { None })
        .collect();
    // More than half of the command comes behind the recheck.
    assert_eq!(stages, [1, 2, 3, 4, 8, 5, 6, 7]);
    println!("active after {} ticks, steepest change {:.4} of duty", run.errors.len() - 400, run.steepest);
    assert!(run.steepest < CALM_DUTY, "{}", run.steepest);
    let (before, after) = (run.errors[400..1400].to_vec(), run.errors.len());
    run.ticks(3000);
    let after = run.errors[after..].to_vec();
    println!(
        "before {:.3}/{:.3} kPa, after {:.3}/{:.3}",
        rms(&before, 0),
        rms(&before, 1),
        rms(&after, 0),
        rms(&after, 1)
    );
    assert!(rms(&after, 1) < rms(&before, 1));

    // And back: the fallback takes over within half a second, without a bump.
    run.steepest = 0.0;
    assert!(run.store.ask(Command::Rollback).is_ok());
    assert!(run.until(600, |run| run.arbiter.active() == PolicyTag::FALLBACK));
    assert!(run.steepest < CALM_DUTY, "{}", run.steepest);
    assert!(run.store.ask(Command::Rollback).is_ok());
    assert!(run.until(600, |run| run.arbiter.active() == tag));
    assert!(run.steepest < CALM_DUTY, "{}", run.steepest);
}

/// Two sines whose turns meet for 20 s and miss each other for 20 s: the fallback leaves five times as much in one half as in the other.
fn beating(t: f64) -> [f64; 2] {
    let wave = |period_s: f64| (std::f64::consts::TAU * t / period_s).sin();
    [90.0 + 6.0 * wave(8.0), -70.0 + 3.0 * wave(10.0)]
}

/// A move of some kPa in 4 s after 11 s of rest, each to another place.
fn moves(t: f64) -> [f64; 2] {
    let place = |k: f64| [84.0 + 12.0 * (0.618_034 * k).fract(), -73.0 + 5.0 * (0.754_878 * k).fract()];
    let (k, share) = ((t / 15.0).floor(), ((t / 15.0).fract() * 15.0 - 11.0).max(0.0) / 4.0);
    let smooth = share * share * (3.0 - 2.0 * share);
    std::array::from_fn(|c| place(k)[c] + smooth * (place(k + 1.0)[c] - place(k)[c]))
}

/// Triangles whose periods have nothing in common.
fn triangles(t: f64) -> [f64; 2] {
    let wave = |period_s: f64| 4.0 * ((t / period_s).fract() - 0.5).abs() - 1.0;
    [90.0 + 6.0 * wave(40.0), -71.0 + 2.0 * wave(25.0)]
}

/// A reference of a minute, in the rows that an operator's file would have.
fn reference(at: fn(f64) -> [f64; 2]) -> Reference {
    let rows = (0..=300).map(|k| {
        let t = 0.2 * f64::from(k);
        format!("{t:.1},{:.6},{:.6}\n", at(t)[0], at(t)[1])
    });
    let csv = std::iter::once("time_s,ref_pos_kpa,ref_neg_kpa\n".to_owned()).chain(rows).collect::<String>();
    Reference::parse("made here", csv.as_bytes()).unwrap()
}

/// Flights on each reference, by `FLIGHTS`.
fn flights_of_each() -> u64 {
    std::env::var("FLIGHTS").ok().and_then(|flights| flights.parse().ok()).unwrap_or(2)
}

/// Thrown straight at the rig, past all the stages that refuse them: none comes to full authority, none leaves the
/// envelope, the incumbent goes on. Constant corrections are left out: the fallback's integral
/// takes them up, so they are as good as the fallback.
fn never_come_to_full_authority(bad: impl Iterator<Item = (String, Vec<u8>)>) {
    let mut problems = Vec::new();
    for (name, bytes) in
        bad.filter(|(name, _)| !["correct_shut", "correct_open", "correct_nothing"].contains(&name.as_str()))
    {
        let mut run = Loop::new(None, Reference::paper(), 2);
        run.ticks(300);
        let tag = Candidate::new(policy(&bytes)).tag;
        assert!(run.store.ask(Command::Try(Candidate::new(policy(&bytes)), Haste::Proving)).is_ok());
        let mut most = 0.0_f64;
        let lost = run.until(MOST_TICKS, |run| {
            most = most.max(run.snapshot().authority);
            matches!(run.events.last(), Some((_, PolicyEvent::Lost(..))))
        });
        println!("{name}: at most {:.0} %, {:?} at tick {}", 100.0 * most, run.events.last(), run.errors.len());
        let last = run.events.last().map(|(_, event)| *event);
        if !(lost && most < 1.0 && matches!(last, Some(PolicyEvent::Lost(of, _, _)) if of == tag)) {
            problems.push(format!("{name}: {most}, {last:?}"));
            continue;
        }
        run.steepest = 0.0;
        run.ticks(100);
        if run.steepest >= CALM_DUTY {
            problems.push(format!("{name}: a bump of {} when it went", run.steepest));
        }
        assert!(run.farthest[0] <= ENVELOPE.max_pos_kpa + SCATTER_KPA[0], "{name}: {:?}", run.farthest);
        assert!(run.farthest[1] >= ENVELOPE.min_neg_kpa - SCATTER_KPA[1], "{name}: {:?}", run.farthest);
    }
    assert!(problems.is_empty(), "{problems:#?}");
}

#[test]
fn bad_policies_never_come_to_full_authority() {
    never_come_to_full_authority(bad_networks().into_iter().step_by(5));
}

/// In full authority at once, as an operator may want it of what was active before: the filter and the watch hold it.
#[test]
fn a_bad_policy_in_full_authority_is_taken_back_in_the_same_tick() {
    let (layout, graph) = network(&shipped());
    let good = corpus::export(layout, &perturbed(&graph, 1.0, 9));
    // The same flight with nobody let in: what the reference itself costs in each stretch.
    let mut alone = Loop::new(Some(policy(&good)), Reference::paper(), 3);
    alone.ticks(1500 + 2000 + 1200);
    for (name, bytes) in bad_networks().into_iter().filter(|(name, _)| name.contains("bang") || name.contains("wrong"))
    {
        let mut run = Loop::new(Some(policy(&good)), Reference::paper(), 3);
        let incumbent = run.arbiter.active();
        run.ticks(1500);
        assert!(run.store.ask(Command::Try(Candidate::new(policy(&bytes)), Haste::Straight)).is_ok());
        assert!(run.until(2000, |run| matches!(run.events.last(), Some((_, PolicyEvent::Lost(..))))), "{name}");
        println!("{name}: {:?}, farthest {:.1?} kPa", run.events.last(), run.farthest);
        assert_eq!(run.arbiter.active(), incumbent);
        assert!(run.steepest <= 0.1 + 1e-12, "{name}: beyond the slew limit: {}", run.steepest);
        assert!(
            run.farthest[0] <= ENVELOPE.max_pos_kpa + SCATTER_KPA[0]
                && run.farthest[1] >= ENVELOPE.min_neg_kpa - SCATTER_KPA[1]
        );
        run.ticks(1200);
        let end = run.errors.len();
        let (back, usual) = (rms(&run.errors[end - 200..], 0), rms(&alone.errors[end - 200..end], 0));
        println!("{name}: {back:.3} kPa 20 to 24 s after the incumbent took over, {usual:.3} without");
        // Integral and play have by then found back from what the bad policy taught them.
        assert!(back < usual + 0.1, "{name}: {back} kPa after the incumbent took over, {usual} without");
    }
}

/// A reference that goes up and down by 13 kPa at once, each level held for so long.
fn steps(held_s: u32) -> Reference {
    let rows = (0..60 / held_s).map(|k| {
        let (begins_s, kpa) = (f64::from(k * held_s), if k % 2 == 0 { 85.0 } else { 98.0 });
        format!("{begins_s:.2},{kpa},-70\n{:.2},{kpa},-70\n", begins_s + f64::from(held_s) - 0.02)
    });
    let csv = std::iter::once("time_s,ref_pos_kpa,ref_neg_kpa\n".to_owned()).chain(rows).collect::<String>();
    Reference::parse("made here", csv.as_bytes()).unwrap()
}

fn losses(run: &Loop) -> Vec<PolicyEvent> {
    run.events.iter().map(|(_, event)| *event).filter(|event| matches!(event, PolicyEvent::Lost(..))).collect()
}

/// Steps that take anybody's duties far, on a model of which the law asks the most: whoever asked for the fallback, an operator or
/// the comparison with it, it stays.
#[test]
fn the_fallback_takes_over_and_stays_whatever_the_reference_asks_of_it() {
    for held_s in [1, 2, 5] {
        let mut run = Loop::knowing("bench", Some(policy(&shipped())), steps(held_s), 5);
        run.ticks(600);
        assert!(run.store.ask(Command::Try(Candidate::fallback(), Haste::Straight)).is_ok());
        assert!(run.until(30, |run| run.arbiter.active() == PolicyTag::FALLBACK), "every {held_s} s: {:?}", run.events);
        run.ticks(3000);
        assert_eq!((run.arbiter.active(), losses(&run)), (PolicyTag::FALLBACK, Vec::new()), "every {held_s} s");
    }
}

/// A venting in the half second of its way.
#[test]
fn the_fallback_stays_also_where_the_rig_is_vented_before_it_has_all_of_the_command() {
    let mut run = Loop::new(Some(policy(&shipped())), Reference::constant(85.0, -71.0), 6);
    run.ticks(300);
    assert!(run.store.ask(Command::Try(Candidate::fallback(), Haste::Straight)).is_ok());
    run.ticks(5);
    let authority = run.snapshot().authority;
    assert!(authority > 0.0 && authority < 1.0, "{authority}");
    run.arbiter.vented();
    assert_eq!(run.arbiter.active(), PolicyTag::FALLBACK);
}

/// Straight into all of the command under steps: what is good keeps it, what goes to and fro loses it.
#[test]
fn steps_of_the_reference_are_not_held_against_a_policy_and_hide_no_hunting() {
    for held_s in [1, 2, 5] {
        let mut run = Loop::knowing("bench", None, steps(held_s), 7);
        run.ticks(600);
        let candidate = Candidate::new(policy(&shipped()));
        let tag = candidate.tag;
        assert!(run.store.ask(Command::Try(candidate, Haste::Straight)).is_ok());
        assert!(run.until(600, |run| run.arbiter.active() == tag), "every {held_s} s: {:?}", run.events);
    }
    for (name, bytes) in bad_networks().into_iter().filter(|(name, _)| name.contains("bang")) {
        let mut run = Loop::new(None, steps(10), 8);
        run.ticks(600);
        assert!(run.store.ask(Command::Try(Candidate::new(policy(&bytes)), Haste::Straight)).is_ok());
        let lost = run.until(2000, |run| !losses(run).is_empty());
        println!("{name}: {:?}", run.events.last());
        assert!(lost && run.arbiter.active() == PolicyTag::FALLBACK, "{name}: {:?}", run.events);
    }
}

/// An operator takes a candidate back; a second candidate replaces the first; everything that went comes back by the queue.
#[test]
fn candidates_can_be_withdrawn_and_replaced_and_nothing_is_freed_in_the_tick() {
    let mut run = Loop::new(None, Reference::constant(85.0, -71.0), 4);
    run.ticks(10);
    let mut taken = 0;
    for round in 0..40 {
        assert!(run.store.ask(Command::Try(Candidate::new(policy(&shipped())), Haste::Straight)).is_ok());
        run.ticks(3 + round % 5);
        taken += run.store.sweep();
    }
    assert_eq!(taken, 39, "each but the last came back");
    assert!(run.store.ask(Command::Rollback).is_ok());
    run.ticks(2);
    assert!(
        matches!(run.events.last(), Some((_, PolicyEvent::Lost(_, _, Loss::Withdrawn)))),
        "{:?}",
        run.events.last()
    );
    assert_eq!((run.store.sweep(), run.arbiter.active()), (1, PolicyTag::FALLBACK));
    for stage in [
        StageNow::Shadow,
        StageNow::Ramp(0),
        StageNow::Ramp(5),
        StageNow::Probation,
        StageNow::Recheck,
        StageNow::Retrial,
    ] {
        assert_eq!(StageNow::of_code(stage.code()), stage);
    }
}

/// Tests of the thorough tier (docs/testing.md).
mod thorough {
    use super::*;

    /// A policy that is as good as the incumbent, because it is the incumbent with its weights off by up to 3 %, comes through, whatever
    /// the reference.
    /// `FLIGHTS=10 cargo test --release --workspace --test in_flight -- --ignored as_good --nocapture` for more.
    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn as_good_a_policy_comes_through_on_references_of_several_kinds() {
        let (layout, graph) = network(&shipped());
        let as_good = corpus::export(layout, &perturbed(&graph, 3.0, 11));
        let (mut flights, mut arrived) = (0_u32, 0_u32);
        for (name, kind) in [("beating", beating as fn(f64) -> [f64; 2]), ("moves", moves), ("triangles", triangles)] {
            for seed in 0..flights_of_each() {
                let mut run = Loop::new(Some(policy(&shipped())), reference(kind), seed);
                run.ticks(400);
                let candidate = Candidate::new(policy(&as_good));
                let tag = candidate.tag;
                assert!(run.store.ask(Command::Try(candidate, Haste::Proving)).is_ok());
                run.until(MOST_TICKS, |run| {
                    run.arbiter.active() == tag || matches!(run.events.last(), Some((_, PolicyEvent::Lost(..))))
                });
                println!("{name} {seed}: {:?} after {} ticks", run.events.last(), run.errors.len());
                flights += 1;
                arrived += u32::from(run.arbiter.active() == tag);
            }
        }
        println!("{arrived} of {flights} came to full authority");
        // Of 30 one did not: two of six are one in two hundred.
        assert!(arrived + flights.div_ceil(6) >= flights, "{arrived} of {flights}");
    }

    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn all_bad_policies_never_come_to_full_authority() {
        never_come_to_full_authority(bad_networks().into_iter());
    }
}
