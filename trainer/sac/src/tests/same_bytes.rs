//! Same seed, same bytes: whatever the machine, and after a stop.

use super::case::*;
use crate::*;

/// The state after some updates, exploration in between.
fn state(size: Size, machine: Machine, updates: u64) -> Vec<u8> {
    let mut learner = learner(size, settings(size), machine);
    for _ in 0..updates {
        learner.update(1);
        learner.act(&vec![0.5; 3 * size.observations], true).unwrap();
    }
    learner.save()
}

#[test]
fn neither_threads_nor_instructions_change_a_bit() {
    let machine = |threads, set| Machine { threads, cpu: Cpu::with(set).unwrap() };
    let reference = state(SMALL, machine(1, InstructionSet::Portable), 5);
    for cpu in Cpu::all() {
        for threads in [1, 2] {
            assert!(state(SMALL, machine(threads, cpu.instruction_set()), 5) == reference, "{cpu:?} {threads}");
        }
    }
    let reference = state(PAPER, Machine::with_threads(1), 3);
    for threads in [2, 3, 4] {
        assert!(state(PAPER, Machine::with_threads(threads), 3) == reference, "{threads} threads");
    }
}

#[test]
fn grouping_updates_changes_nothing() {
    let run = |groups: &[u64]| {
        let mut learner = learner(SMALL, settings(SMALL), Machine::with_threads(2));
        groups.iter().for_each(|&times| drop(format!("{:?}", learner.update(times))));
        learner.save()
    };
    assert!(run(&[7]) == run(&[1, 4, 0, 2]));
}

#[test]
fn a_restored_learner_goes_on_as_if_it_had_never_stopped() {
    let goes_on = |learner: &mut Learner| {
        push(learner, SMALL, 13, &mut Dice(9)); // over the ring's end
        let actions = learner.act(&[0.25; 11], true).unwrap();
        let report = learner.update(6);
        (actions, report, learner.save())
    };
    let mut straight = learner(SMALL, settings(SMALL), Machine::with_threads(2));
    straight.update(4);
    straight.act(&[0.5; 22], true).unwrap();
    straight.set_lambda_temporal(2.5).unwrap();
    let bytes = straight.save();
    let mut restored = Learner::restore(&bytes, Machine::with_threads(1)).unwrap();
    assert!(restored.save() == bytes);
    assert!(goes_on(&mut straight) == goes_on(&mut restored));
}

#[test]
fn a_replay_that_is_not_full_is_restored_too() {
    let mut settings = settings(SMALL);
    settings.replay_capacity = 1000;
    let mut straight = learner(SMALL, settings, Machine::with_threads(1));
    let mut restored = Learner::restore(&straight.save(), Machine::with_threads(1)).unwrap();
    assert_eq!(restored.replay_len(), SMALL.rows);
    assert_eq!(straight.update(2), restored.update(2));
}

/// A core with the rows put back in pieces is the whole state, over the ring's end, too; a piece that was never needed
/// does no harm.
#[test]
fn a_core_and_its_rows_are_the_whole_state() {
    let mut straight = learner(SMALL, settings(SMALL), Machine::with_threads(2));
    push(&mut straight, SMALL, 13, &mut Dice(5));
    straight.update(3);
    let (mut restored, written) = Learner::restore_core(&straight.save_core(), Machine::with_threads(1)).unwrap();
    assert_eq!(restored.replay_len(), 0);
    let rows = straight.replay_rows();
    assert_eq!(rows.end, written);
    let middle = rows.start + 5;
    for piece in [rows.start..middle, middle..rows.end] {
        let floats = straight.copy_replay_rows(piece.clone());
        assert_eq!(floats.len() as u64, (piece.end - piece.start) * straight.replay_width() as u64);
        restored.restore_replay_rows(piece.start, &floats);
    }
    assert!(restored.save() == straight.save());
    assert_eq!(straight.update(2), restored.update(2));
}

/// While the actor is frozen not a bit of it moves and the critics learn, on any number of threads.
#[test]
fn critics_learn_beside_a_frozen_actor() {
    let run = |threads| {
        let mut learner = learner(SMALL, settings(SMALL), Machine::with_threads(threads));
        let (policy, temperature) = (learner.policy(), learner.temperature());
        let first = learner.update_critics(1).critic_loss;
        let last = learner.update_critics(200).critic_loss;
        assert_eq!((learner.policy(), learner.temperature()), (policy, temperature));
        assert!(last < first, "{last} {first}");
        learner.update(2);
        learner.save()
    };
    assert!(run(1) == run(2));
}

#[test]
fn other_seeds_give_other_bytes() {
    let run = |seed| {
        let mut settings = settings(SMALL);
        settings.seed = seed;
        learner(SMALL, settings, Machine::with_threads(1)).policy()
    };
    assert_ne!(run(1), run(2));
}

#[test]
fn the_policy_by_itself_is_the_learner_to_the_bit() {
    let mut learner = learner(PAPER, settings(PAPER), Machine::with_threads(2));
    learner.update(2);
    let policy = learner.policy();
    policy.check().unwrap();
    let mut dice = Dice(3);
    let observations: Vec<f32> = (0..40 * 84).map(|_| dice.number()).collect();
    let actions = learner.act(&observations, false).unwrap();
    assert_eq!(actions.len(), 40 * 12);
    for (observation, action) in observations.chunks(84).zip(actions.chunks(12)) {
        assert_eq!(policy.mean_action(observation), action);
    }
    let restored = Network::restore(&policy.save()).unwrap();
    assert_eq!(restored, policy);
    // Into another learner and out again.
    let mut other_settings = settings(PAPER);
    other_settings.seed = 77;
    let mut other = super::case::learner(PAPER, other_settings, Machine::with_threads(3));
    assert_ne!(other.policy(), policy);
    other.warm_start(&policy).unwrap();
    assert_eq!(other.policy(), policy);
}

#[test]
fn critics_and_temperature_go_over_and_nothing_else_does() {
    let mut trained = learner(PAPER, settings(PAPER), Machine::with_threads(2));
    trained.update(3);
    let mut other_settings = settings(PAPER);
    other_settings.seed = 77;
    let mut other = learner(PAPER, other_settings, Machine::with_threads(3));
    let (before, from) = (snapshot(&other), snapshot(&trained));
    assert!(before.critics != from.critics && before.temperature != from.temperature);
    other.warm_start_critics(&trained).unwrap();
    let after = snapshot(&other);
    for (after, from) in after.critics.iter().zip(&from.critics) {
        let [value, mean, square, target] = after;
        assert!(value == &from[0] && target == &from[3]);
        let is_zero = |layers: &[crate::parameters::Plain]| {
            layers.iter().all(|layer| layer.weights.iter().chain(&layer.bias).all(|x| *x == 0.0))
        };
        assert!(is_zero(mean) && is_zero(square), "the optimiser begins anew");
    }
    assert_eq!(after.actor, before.actor);
    assert_eq!(other.temperature(), trained.temperature());
    assert!(other.update(1).finite);

    let other_size = Size { hidden: [64, 64], ..PAPER };
    let mut narrow = learner(other_size, settings(other_size), Machine::with_threads(1));
    assert!(matches!(narrow.warm_start_critics(&trained), Err(LearnerError::Network(_))));
    let mut small = learner(SMALL, settings(SMALL), Machine::with_threads(1));
    assert!(matches!(small.warm_start_critics(&trained), Err(LearnerError::Settings(_))));
}

#[test]
fn exploration_scatters_around_the_mean_and_never_repeats() {
    let mut learner = learner(PAPER, settings(PAPER), Machine::with_threads(1));
    let rows = vec![0.1; 8 * 84];
    let mean = learner.act(&rows, false).unwrap();
    let (first, second) = (learner.act(&rows, true).unwrap(), learner.act(&rows, true).unwrap());
    let distinct: std::collections::HashSet<u32> = first.iter().chain(&second).map(|x| x.to_bits()).collect();
    assert!(distinct.len() > 190); // of 192; a tie of 24-bit numbers happens
    assert!(first.iter().chain(&second).all(|x| x.abs() < 1.0));
    let off: f32 = first.iter().zip(&mean).map(|(a, m)| a.atanh() - m.atanh()).sum::<f32>() / 96.0;
    // The mean of 96 draws with a deviation of at most e^0.05; five standard errors.
    assert!(off.abs() < 0.54, "{off}");
}

#[test]
fn damage_gets_a_clear_line() {
    let learner = learner(SMALL, settings(SMALL), Machine::with_threads(1));
    let bytes = learner.save();
    let restore = |bytes: &[u8]| Learner::restore(bytes, Machine::with_threads(1)).map(drop).unwrap_err().to_string();
    assert!(restore(b"hello").contains("not a learner file"));
    assert!(restore(&learner.policy().save()).contains("not a learner file"));
    assert!(restore(&bytes[..bytes.len() - 9]).contains("ends too early"));
    for at in (12..bytes.len()).step_by(bytes.len() / 97) {
        let mut bytes = bytes.clone();
        bytes[at] ^= 0x10;
        assert!(!restore(&bytes).is_empty(), "{at}");
    }
    let mut other = bytes.clone();
    other[8] = 9;
    assert!(restore(&other).contains("version 9"));
    let mut more = bytes.clone();
    more.push(0);
    assert!(restore(&more).contains("damaged"));
    let policy = learner.policy().save();
    assert!(Network::restore(&policy[..policy.len() - 1]).unwrap_err().to_string().contains("too early"));
}
