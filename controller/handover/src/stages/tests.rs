//! Ways of candidates, against a record that is known.

use super::*;
use crate::conditions::JUMPED;
use crate::conduct::WIDE_TICKS;

fn record() -> Record {
    let mut record = Record::default();
    (0..2000).for_each(|tick| add(&mut record, tick, 1.0));
    record
}

fn add(record: &mut Record, tick: u32, scale: f64) {
    let sign = if tick % 60 < 30 { scale } else { -scale };
    record.add([0, 1], [0.3 * sign, 0.2 * sign], [0.002, 0.002], false);
}

/// Ticks with errors `scale` times the record's, until something comes of it; the incumbent errs as it did.
fn run(stages: &mut Stages, scale: f64, change: f64) -> (Vec<Next>, u32) {
    against(stages, scale, change, 1.0)
}

/// Ticks as in [`run`], where the incumbent, measured once more, errs `later` times what it did.
fn against(stages: &mut Stages, scale: f64, change: f64, later: f64) -> (Vec<Next>, u32) {
    let (mut all, mut record) = (Vec::new(), record());
    for tick in 0..60_000 {
        stages.begin_tick();
        let sign = if tick % 60 < 30 { 1.0 } else { -1.0 };
        let error_kpa = [0.3 * sign * scale, 0.2 * sign * scale];
        let part_duty = [0.1 * stages.authority(); 2];
        let shown = Shown { kinds: [0, 1], error_kpa, change_duty: [change; 2], filtered: false, part_duty };
        if stages.now().measures_incumbent() && stages.incumbent_alone() {
            add(&mut record, tick, later);
        }
        match stages.end_tick(&shown, &record) {
            Next::Stay => {}
            next => all.push(next),
        }
        if matches!(all.last(), Some(Next::Active | Next::Lost(_))) {
            return (all, tick);
        }
    }
    (all, 60_000)
}

#[test]
fn as_good_a_candidate_goes_all_the_way() {
    let mut stages = Stages::from_shadow();
    let (all, ticks) = run(&mut stages, 1.0, 0.002);
    let ramp = |levels: std::ops::Range<usize>| levels.map(StageNow::Ramp);
    let mut expected: Vec<Next> = ramp(0..RECHECKED_LEVEL)
        .chain([StageNow::Recheck])
        .chain(ramp(RECHECKED_LEVEL..LEVELS.len()))
        .chain([StageNow::Probation])
        .map(Next::Passed)
        .collect();
    expected.push(Next::Active);
    assert_eq!(all, expected);
    // Five levels of some 800 ticks, the recheck, and some 3,500 in all of the command: within the ten minutes that are asked for.
    println!("{ticks} ticks");
    assert!((5_000..15_000).contains(&ticks), "{ticks}");
    assert_eq!(stages.authority(), 1.0);
}

#[test]
fn a_worse_candidate_loses_it_on_the_first_level_once_the_incumbent_was_measured_again() {
    for scale in [1.8, 3.0] {
        let (all, _) = run(&mut Stages::from_shadow(), scale, 0.002);
        let again = [Next::Passed(StageNow::Retrial), Next::Passed(StageNow::Ramp(0))];
        let expected: Vec<Next> = [Next::Passed(StageNow::Ramp(0))]
            .into_iter()
            .chain([again; 4].into_iter().flatten())
            .chain([Next::Lost(Loss::Worse)])
            .collect();
        assert_eq!(all, expected, "{scale}");
    }
    let (all, _) = run(&mut Stages::from_shadow(), 1.0, 0.04);
    assert_eq!(all.last(), Some(&Next::Lost(Loss::Hunts)));
    let (all, ticks) = run(&mut Stages::straight(), 20.0, 0.002);
    assert_eq!((all.last(), ticks), (Some(&Next::Lost(Loss::FarOff)), WIDE_TICKS - 1));
}

/// The reference costs three times as much from now on, whoever controls: the record says otherwise until it is measured anew.
#[test]
fn a_stretch_that_costs_anybody_more_is_not_held_against_a_candidate() {
    let (all, ticks) = against(&mut Stages::from_shadow(), 3.0, 0.002, 3.0);
    println!("{ticks} ticks, {all:?}");
    assert_eq!(all[1..3], [Next::Passed(StageNow::Retrial), Next::Passed(StageNow::Ramp(0))]);
    assert_eq!(all.last(), Some(&Next::Active), "{all:?}");
}

#[test]
fn what_was_as_good_as_an_incumbent_that_still_learned_is_found_out_by_the_recheck() {
    // The record of before is still half of what is known then.
    let (all, _) = against(&mut Stages::from_shadow(), 1.0, 0.002, 0.35);
    assert!(all.contains(&Next::Passed(StageNow::Recheck)), "{all:?}");
    assert_eq!(all.last(), Some(&Next::Lost(Loss::Worse)));
}

/// At 5 % of a command that is the incumbent's to a tenth of a per cent: the rig was knocked, or the incumbent errs.
#[test]
fn what_a_candidate_had_no_part_in_sends_it_back_to_the_shadow() {
    let record = record();
    for (part, expected) in [(0.0001, Next::Passed(StageNow::Shadow)), (0.01, Next::Lost(Loss::FarOff))] {
        let mut stages = Stages { authority: 0.05, ..Stages::at(StageNow::Ramp(0), Judged::Compared) };
        let far = Shown {
            kinds: [0; 2],
            error_kpa: [5.0, 0.1],
            change_duty: [0.0; 2],
            filtered: false,
            part_duty: [0.0, part],
        };
        let all: Vec<Next> = (0..WIDE_TICKS).map(|_| stages.end_tick(&far, &record)).collect();
        assert_eq!(all.last(), Some(&expected));
    }
}

/// Far off, bent and hunting at once, with all of it its own: nothing is held against the last resort.
#[test]
fn the_fallback_is_active_within_half_a_second_whatever_it_does() {
    let (mut stages, record) = (Stages::last_resort(), record());
    let worst =
        Shown { kinds: [0; 2], error_kpa: [30.0, 20.0], change_duty: [0.1; 2], filtered: true, part_duty: [0.5; 2] };
    let nexts: Vec<Next> = (0..25)
        .map(|_| {
            stages.begin_tick();
            stages.end_tick(&worst, &record)
        })
        .collect();
    assert!(nexts[..24].iter().all(|next| *next == Next::Stay), "{nexts:?}");
    assert_eq!(nexts[24], Next::Active);
    assert_eq!(stages.anew().now(), Stages::last_resort().now());
}

/// Changes of 0.06 of duty for five ticks and back for five, once a second, are a step's; to and fro all the time is hunting,
/// also where the reference never stops jumping.
#[test]
fn a_jump_of_the_reference_moves_duties_far_and_hides_no_hunting() {
    let record = record();
    let lost = |change_duty: fn(u32) -> f64| {
        let mut stages = Stages::straight();
        let nexts = (0..PROBATION_TICKS).map(|tick| {
            stages.begin_tick();
            let shown = Shown {
                kinds: [JUMPED, 0],
                error_kpa: [5.0, 0.1],
                change_duty: [change_duty(tick), 0.0],
                filtered: false,
                part_duty: [0.1; 2],
            };
            stages.end_tick(&shown, &record)
        });
        nexts.filter(|next| *next != Next::Stay).collect::<Vec<Next>>()
    };
    let step = |tick: u32| match tick % 50 {
        0..5 => 0.06,
        5..10 => -0.06,
        _ => 0.0,
    };
    assert_eq!(lost(step), [Next::Active]);
    let chatter = |tick: u32| if tick.is_multiple_of(2) { 0.03 } else { -0.03 };
    assert_eq!(lost(chatter).first(), Some(&Next::Lost(Loss::Hunts)));
    // Half a range to and fro, as a policy does that only knows open and shut.
    let swing = |tick: u32| match tick % 20 {
        0..5 => 0.1,
        10..15 => -0.1,
        _ => 0.0,
    };
    assert_eq!(lost(swing).first(), Some(&Next::Lost(Loss::Hunts)));
}

/// A reference out of reach keeps whoever controls far off: what an operator asks for takes over all the same.
#[test]
fn what_an_operator_asks_for_takes_over_where_nobody_could_do_better() {
    let (mut stages, record) = (Stages::straight(), Record::default());
    let far =
        Shown { kinds: [0; 2], error_kpa: [5.0, 0.1], change_duty: [0.0; 2], filtered: false, part_duty: [0.0; 2] };
    let nexts: Vec<Next> = (0..PROBATION_TICKS).map(|_| stages.end_tick(&far, &record)).collect();
    assert!(nexts[..nexts.len() - 1].iter().all(|next| *next == Next::Stay), "{nexts:?}");
    assert_eq!(nexts.last(), Some(&Next::Active));
}

#[test]
fn the_filter_ends_it_at_the_third_intervention() {
    let (mut stages, record) = (Stages::straight(), record());
    let shown =
        Shown { kinds: [0; 2], error_kpa: [0.0; 2], change_duty: [0.0; 2], filtered: true, part_duty: [0.1; 2] };
    assert_eq!(stages.end_tick(&shown, &record), Next::Stay);
    assert_eq!(stages.end_tick(&shown, &record), Next::Stay);
    assert_eq!(stages.end_tick(&shown, &record), Next::Lost(Loss::Filtered));
}

/// With a part in commands of an incumbent of which the filter bends a burst of ten every ten seconds, a candidate is not to
/// blame for such bursts; for two thirds of all commands it is.
#[test]
fn interventions_that_the_incumbent_draws_by_itself_are_not_the_candidates() {
    let mut record = Record::default();
    for tick in 0..2000 {
        record.add([0, 1], [0.3, 0.2], [0.002, 0.002], tick % 500 < 10);
    }
    assert!((9.0..=10.0).contains(&record.most_bent()), "{}", record.most_bent());
    // Bent in so many of 50 ticks.
    for (bent, is_lost) in [(10, false), (33, true)] {
        let mut stages = Stages { authority: 0.05, ..Stages::at(StageNow::Ramp(0), Judged::Compared) };
        let nexts = (0..100).map(|tick| {
            let filtered = tick % 50 < bent;
            let shown =
                Shown { kinds: [0; 2], error_kpa: [0.1; 2], change_duty: [0.0; 2], filtered, part_duty: [0.01; 2] };
            stages.end_tick(&shown, &record)
        });
        let nexts: Vec<Next> = nexts.collect();
        assert_eq!(nexts.contains(&Next::Lost(Loss::Filtered)), is_lost, "{bent} of 50");
    }
    for _ in 0..30 * 6000 {
        record.add([0, 1], [0.3, 0.2], [0.002, 0.002], false);
    }
    assert!(record.most_bent() < 1.0, "it is forgotten: {}", record.most_bent());
}

#[test]
fn authority_never_jumps() {
    let mut stages = Stages::straight();
    let mut before = 0.0;
    for _ in 0..100 {
        let now = stages.begin_tick();
        assert!((now - before).abs() <= AUTHORITY_PER_TICK + 1e-12);
        before = now;
    }
    assert_eq!(before, 1.0);
}
