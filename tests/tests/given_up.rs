//! Flights that are given up although every frame is sound: a policy that only the safety filter keeps within the envelope, and a pressure
//! that the open vent does not lower.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use controller::config::Safety;
use controller::cycle::Cycle;
use controller::daemon::shipped_policy;
use controller::operator::notice::Notice;
use controller::state::{Arming, Condition, State};
use model::rig::Rig;
use model::steady::SteadyMap;
use proto::reference::Reference;
use proto::wire::Mode;
use tests::Stream::Err;
use tests::lockstep::Flight;
use tests::scene::Scene;

/// In lockstep without a socket: the daemon takes no reference beyond its limits.
#[test]
fn what_only_the_filter_holds_within_the_envelope_is_not_trusted() {
    let rig = Rig::builtin("dual_pressure").unwrap();
    let safety = Safety { max_pos_kpa: 75.0, ..Safety::default() };
    let policy = shipped_policy().unwrap().0;
    let cycle = Cycle::new(&rig, Some(policy), Reference::constant(90.0, -70.0), safety, Arming::Automatic).unwrap();
    let mut flight = Flight::new(&rig, cycle, 3);
    let (mut bent, mut reverted) = (Vec::new(), None);
    for tick in 0..600 {
        let before = flight.cycle.filter_interventions();
        let flown = flight.step();
        bent.push(flight.cycle.filter_interventions() > before);
        let told = |n: &Notice| matches!(n, Notice::Reverted { condition: Condition::FilterBusy, .. });
        if flown.told.iter().any(told) {
            reverted = Some(tick);
            break;
        }
    }
    // In the tick after the one in which it has bent a 21st of fifty.
    let reverted = reverted.unwrap_or_else(|| panic!("bent {} times", bent.iter().filter(|bent| **bent).count()));
    let newest = |end: usize| bent[end.saturating_sub(50)..end].iter().filter(|bent| **bent).count();
    println!("reverted at tick {reverted}, {} of 50 bent", newest(reverted));
    assert_eq!((newest(reverted - 1), newest(reverted)), (20, 21));
    assert_eq!(flight.cycle.state(), State::Revert);
}

/// A rig whose muffler is so clogged that the pump keeps the chamber at some 130 kPa through a valve that is fully open.
fn clogged() -> Rig {
    let rigs = (5..60).map(|tenths| {
        let mechanism = format!(
            "\n[[mechanisms]]\nid = \"exhaust_restriction\"\ncomponent = \"valve_pos\"\narea_mm2 = {}\n",
            f64::from(tenths) / 10.0
        );
        Rig::from_toml(&(model::rig::DUAL_PRESSURE.to_owned() + &mechanism)).unwrap()
    });
    let rests_kpa = |rig: &Rig| SteadyMap::new(rig).unwrap().settled_kpa([1.0, 0.8]);
    rigs.into_iter().find(|rig| rests_kpa(rig).is_some_and(|[positive, _]| positive < 135.0)).unwrap()
}

/// The daemon's model knows of it, so that no reading contradicts it.
#[test]
fn a_pressure_that_the_open_vent_does_not_lower_vents_and_waits_for_a_person() {
    let mut scene = Scene::on(&clogged(), "control.auto_arm = true\nrig.file = \"rig.toml\"");
    let mut armed = false;
    let vented = (0..1_500).any(|_| {
        let mode = scene.step();
        armed |= mode == Some(Mode::Run);
        armed && mode == Some(Mode::Vent)
    });
    println!("{:?} {}", scene.crio.true_kpa(), scene.daemon.said(Err));
    assert!(vented, "{:?} {}", scene.crio.true_kpa(), scene.daemon.said(Err));
    scene.told("stays beyond its reference with the vent open");
    scene.wait_for_state(State::Vent);
    scene.check_waits_for_a_person();
    scene.end();
}
