//! Tests of the arbiter: the errors that it judges by, and who answers for a command that was bent.

use model::observation::{GOALS_AHEAD, TICKS_PER_S};
use model::rig::Rig;

use super::*;
use crate::channel::channel;

/// A ramp on a rig whose positive sensor lags by 160 ms: a chamber on it reads late, and a reading on it is ahead.
#[test]
fn behind_a_late_sensor_the_chamber_is_to_be_on_the_reference() {
    let late_toml = "[[mechanisms]]\nid = \"sensor_lag\"\ncomponent = \"sensor_pos\"\ntime_constant_ms = 160.0\n";
    let late = Rig::from_toml(&format!("{}\n{late_toml}", model::rig::DUAL_PRESSURE)).unwrap();
    let plain = Rig::builtin("dual_pressure").unwrap();
    let map = Arc::new(SteadyMap::new(&plain).unwrap());
    let (end, _store) = channel();
    let mut arbiter = Arbiter::new(Arc::clone(&map), ShownReference::of(&late), None, end);
    let (rate, tau_s) = (2.0, 0.16);
    let goal = |tick: u32| 80.0 + rate * f64::from(tick) / TICKS_PER_S;
    let fly = |arbiter: &mut Arbiter, ticks: std::ops::Range<u32>, late_kpa: f64| {
        for tick in ticks {
            let goals_kpa: [Pair; GOALS_AHEAD + 1] = std::array::from_fn(|ahead| [goal(tick + ahead as u32), -70.0]);
            let measured_kpa = [goal(tick) - late_kpa, -70.0];
            let input = ControlInput::of_measured(measured_kpa, goals_kpa);
            let decided = arbiter.decide(&input, &[measured_kpa; AHEAD]).decision.duty();
            arbiter.applied(decided);
        }
        arbiter.error_kpa
    };
    arbiter.restart([1.0; CHANNELS]);
    // After twelve time constants.
    let error_kpa = fly(&mut arbiter, 0..100, rate * tau_s);
    assert!(error_kpa[0].abs() < 1e-4 && error_kpa[1] == 0.0, "{error_kpa:?}");
    let error_kpa = fly(&mut arbiter, 100..101, 0.0);
    assert!((error_kpa[0] + rate * tau_s).abs() < 1e-4, "{error_kpa:?}");
    // Frames that are missing move the reference on as well.
    (101..106).for_each(|_| arbiter.held([0.9; CHANNELS]));
    let error_kpa = fly(&mut arbiter, 106..107, rate * tau_s);
    assert!(error_kpa[0].abs() < 1e-4, "{error_kpa:?}");
    // Armed anew, the reference begins anew.
    arbiter.restart([1.0; CHANNELS]);
    assert_eq!(fly(&mut arbiter, 107..108, 0.0), [0.0; CHANNELS]);
    // A model whose sensors are not late: readings less reference.
    arbiter.exchange_model(&map, &ShownReference::of(&plain));
    let error_kpa = fly(&mut arbiter, 108..300, rate * tau_s);
    assert_eq!(error_kpa[0].to_bits(), (goal(299) - (goal(299) - rate * tau_s)).to_bits());
}

#[test]
fn who_shares_in_a_command_answers_for_its_own_part_of_the_bending() {
    let neg = 0.5;
    let bent = |part: f64, decided: f64, sent: f64| is_bent_for(&[part, 0.0], &[decided, neg], &[sent, neg]);
    // The incumbent alone wanted 0.40, of which 0.45 was made.
    assert!(!bent(0.01, 0.41, 0.45), "the part led to where it had to go");
    assert!(!bent(-0.01, 0.39, 0.45), "the part led away, and was a fifth of it");
    // It wanted 0.50, and that would have been let through.
    assert!(bent(-0.10, 0.40, 0.45));
    assert!(bent(-0.05, 0.40, 0.45), "to the edge");
    assert!(!bent(-0.05, 0.45, 0.45), "nothing was bent");
}
