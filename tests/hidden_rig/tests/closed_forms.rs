//! The plant against closed forms: tanks that blow down, a cylinder that is shut, balances that must close.

#![allow(clippy::unwrap_used)] // a test that cannot go on should say where

use hidden_rig::build_sheet::BuildSheet;
use hidden_rig::gas::{GAS_CONSTANT, Gas, HEAT_RATIO};
use hidden_rig::integrate::{DormandPrince, Switched, Tolerance};
use hidden_rig::orifice::sonic_conductance;
use hidden_rig::plant::Plant;
use hidden_rig::rates::{CHECK_VALVES, Drive, Driven};
use hidden_rig::run::{Precision, Run};
use hidden_rig::state::{self, CHAMBER, CRANK, CYLINDER, LEDGER, LIFT, SPEED, STATES, State, VOLUME};

/// Choked flow per area of an ideal nozzle, √κ (2/(κ+1))^((κ+1)/(2(κ−1))).
fn choked_number() -> f64 {
    HEAT_RATIO.sqrt() * (2.0 / (HEAT_RATIO + 1.0)).powf((HEAT_RATIO + 1.0) / (2.0 * (HEAT_RATIO - 1.0)))
}

/// A plant that only leaks: pump stopped, vents shut, the positive chamber at 9 bar with a hole of 2 mm².
fn tank(wall_conductance_w_k: f64) -> (Plant, State) {
    let mut plant = Plant::paper();
    plant.chambers[0].leak.sharp = sonic_conductance(2e-6);
    plant.chambers[0].wall_conductance_w_k = wall_conductance_w_k;
    for vent in &mut plant.vents {
        vent.preload_m = 1.0;
    }
    let mut state = plant.at_rest();
    state[SPEED] = 0.0;
    let gas = Gas { pressure_pa: 9e5, temperature_k: plant.chambers[0].wall_k };
    [state[CHAMBER], state[CHAMBER + 1]] = gas.store(state[VOLUME]);
    (plant, state)
}

fn advance(plant: &Plant, state: &mut State, pump_on: bool, seconds: f64, relative: f64) {
    let drive = Drive { current: [0.0; 2], throat: [1.0; 2], pump_on };
    let mut driven = Driven { plant, drive, open: [false; CHECK_VALVES], held: [false; 2] };
    driven.open = driven.guards(0.0, state).map(|guard| guard > 0.0);
    let tolerance = Tolerance { relative, scales: state::scales(), longest_s: 2.5e-3 };
    DormandPrince::new(tolerance).advance(&mut driven, state, 0.0, seconds);
}

/// Isentropic discharge of a tank through a choked throat (Zucker and Biblarz, *Fundamentals of Gas Dynamics*, 11.5):
/// p/p₀ = (1 + (κ−1)/2 · ψ A √(R T₀) t / V)^(−2κ/(κ−1)).
#[test]
fn an_insulated_tank_blows_down_isentropically() {
    let (plant, mut state) = tank(0.0);
    let seconds = 1.0;
    advance(&plant, &mut state, false, seconds, 1e-9);
    let rate = choked_number() * 2e-6 * (GAS_CONSTANT * 293.15).sqrt() / 0.75e-3;
    let expected = 9e5 * (1.0 + 0.5 * (HEAT_RATIO - 1.0) * rate * seconds).powf(-2.0 * HEAT_RATIO / (HEAT_RATIO - 1.0));
    let gas = plant.chamber_gas(&state, 0);
    assert!(expected > 101_325.0 / 0.4, "still choked");
    assert!((gas.pressure_pa / expected - 1.0).abs() < 1e-6, "{} against {expected}", gas.pressure_pa);
    // Isentropic: T follows p.
    let temperature = 293.15 * (expected / 9e5).powf((HEAT_RATIO - 1.0) / HEAT_RATIO);
    assert!((gas.temperature_k / temperature - 1.0).abs() < 1e-6);
}

/// Packed with enough wool, the same tank loses pressure exponentially: p = p₀ exp(−ψ A √(R T) t / V).
#[test]
fn a_packed_tank_blows_down_isothermally() {
    let (plant, mut state) = tank(2e4);
    let seconds = 1.0;
    advance(&plant, &mut state, false, seconds, 1e-8);
    let rate = choked_number() * 2e-6 * (GAS_CONSTANT * 293.15).sqrt() / 0.75e-3;
    let expected = 9e5 * (-rate * seconds).exp();
    let gas = plant.chamber_gas(&state, 0);
    // 20 kW/K leave the air short by the heat it takes up: some 0.4 kW, so 0.02 K of 293.
    assert!((gas.pressure_pa / expected - 1.0).abs() < 2e-4, "{} against {expected}", gas.pressure_pa);
}

/// A cylinder with its valves held shut and no heat loss: p V^κ stays what it was, turn after turn.
#[test]
fn a_shut_cylinder_without_heat_loss_is_isentropic() {
    let mut plant = Plant::paper();
    plant.pump.wall_conductance_w_k = 0.0;
    plant.pump.inlet.cracking_pa = 1e12;
    plant.pump.outlet.cracking_pa = 1e12;
    let mut state = plant.at_rest();
    let invariant = |state: &State| {
        let volume = plant.pump.swept(state[CRANK]).volume_m3[1];
        let gas = Gas::of_store(state[CYLINDER + 2], state[CYLINDER + 3], volume);
        gas.pressure_pa * volume.powf(HEAT_RATIO)
    };
    let before = invariant(&state);
    // A time at which the second piston, which starts at the far end, is compressed tenfold and more.
    for seconds in [0.0093, 0.1, 0.0507] {
        advance(&plant, &mut state, true, seconds, 1e-9);
        assert!((invariant(&state) / before - 1.0).abs() < 1e-5);
    }
}

/// Mass and energy: what cylinders and chambers hold is what came in from outside. Runge–Kutta methods keep linear sums,
/// so this holds to rounding unless a flow is taken from one store and not given to the other.
#[test]
fn what_is_held_is_what_came_in() {
    let mut rig = BuildSheet::paper().rig();
    rig.plant.cross_leak = 3e-16;
    rig.plant.pump.ring_leak = 2e-16;
    rig.plant.chambers[0].wall_conductance_w_k = 2.0;
    let held = |state: &State, offset: usize| {
        (0..2).map(|i| state[CYLINDER + 2 * i + offset] + state[CHAMBER + 2 * i + offset]).sum::<f64>()
    };
    let mut run = Run::from_rest(&rig, [0.8, 0.8], Precision::Coarse);
    let start = *run.state();
    for k in 0..200 {
        run.tick(if k % 50 < 25 { [0.7, 0.9] } else { [0.9, 0.7] }, k < 150);
    }
    let end = run.state();
    for offset in 0..2 {
        let gained = held(end, offset) - held(&start, offset);
        let exchanged = end[LEDGER + offset] - start[LEDGER + offset];
        assert!(gained.abs() > 1e-6, "something was exchanged");
        assert!((gained - exchanged).abs() < 1e-10 * held(end, offset).abs(), "{gained} {exchanged}");
    }
}

/// In a settled rig the air that leaves the positive vent is the air that enters the negative one, on average, and the
/// heat that the compressor puts in is lost again: the mean of the stores does not move.
#[test]
fn a_settled_rig_passes_on_what_it_takes_in() {
    let rig = BuildSheet::paper().rig();
    let mut run = Run::settled(&rig, [0.8, 0.8], Precision::Fine);
    let before = *run.state();
    for _ in 0..50 {
        run.tick([0.8, 0.8], true);
    }
    let after = run.state();
    // A second of 0.5 g/s passed through; the stores hold the same to a millionth of that.
    for i in 0..2 {
        let change = (after[CHAMBER + 2 * i] - before[CHAMBER + 2 * i]).abs();
        assert!(change < 5e-4 * 1e-4, "{change}");
    }
}

/// Tolerances converge, and the precision of recordings is good to a few pascals.
#[test]
fn traces_converge_with_the_tolerance() {
    let rig = BuildSheet::paper().rig();
    let trace = |precision: Precision| {
        let mut run = Run::from_rest(&rig, [0.8, 0.8], precision);
        let row = |k: u32| if k % 40 < 20 { [0.7, 0.95] } else { [0.95, 0.65] };
        (0..150)
            .map(|k| {
                run.tick(row(k), true);
                run.clean_kpa()
            })
            .collect::<Vec<_>>()
    };
    let worst = |a: &[[f64; 2]], b: &[[f64; 2]]| {
        a.iter().zip(b).flat_map(|(a, b)| [(a[0] - b[0]).abs(), (a[1] - b[1]).abs()]).fold(0.0, f64::max)
    };
    let reference = trace(Precision::Relative(1e-9));
    let errors = [1e-4, 1e-5, 1e-6, 1e-7].map(|relative| worst(&trace(Precision::Relative(relative)), &reference));
    assert!(errors.windows(2).all(|pair| pair[1] < pair[0]), "{errors:?}");
    assert!(worst(&trace(Precision::Fine), &reference) < 0.01, "{errors:?}");
    assert!(worst(&trace(Precision::Coarse), &reference) < 0.03, "{errors:?}");
}

/// Air at rest stays at rest: nothing flows, heats or moves in a rig without pump and at the atmosphere.
#[test]
fn air_at_rest_stays_at_rest() {
    let mut plant = Plant::paper();
    plant.pump.wall_k = 293.15;
    let mut state = plant.at_rest();
    state[SPEED] = 0.0;
    let before = state;
    advance(&plant, &mut state, false, 1.0, 1e-6);
    for i in (0..STATES).filter(|i| *i != LIFT && *i != LIFT + 1) {
        assert!((state[i] - before[i]).abs() <= 1e-9 * before[i].abs().max(state::scales()[i]), "state {i}");
    }
}
