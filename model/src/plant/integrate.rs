//! One tick: command paths, crank, then fixed-step RK4.
//!
//! The whole tick is one inlined function so that it can be compiled for each instruction set
//! (see [`super::dispatch`]); loops over states have a constant length, so states stay in registers.

use super::rates::{Gas, rates};
use super::{MOST_STATES, Plant, Scratch, State};
use crate::real::Real;

/// Advances `state` by one tick under `inputs` (in the order of [`Plant::inputs`]).
#[inline(always)]
pub(crate) fn tick<R: Real>(plant: &Plant<R>, state: &mut State<R>, scratch: &mut Scratch<R>, inputs: &[R]) {
    prepare(plant, state, scratch, inputs);
    match plant.carried_states() {
        4 => steps::<R, 4, 8, false>(plant, state, scratch),
        8 => steps::<R, 8, 16, true>(plant, state, scratch),
        _ => steps::<R, MOST_STATES, 16, true>(plant, state, scratch),
    }
    for (phase, speed) in state.phase.iter_mut().zip(&scratch.speeds) {
        *phase = (*phase + *speed * R::splat(plant.tick_s())).map(|p| p - p.floor());
    }
    state.ticks += 1;
}

/// Everything about the coming tick that does not depend on pressure.
#[inline(always)]
fn prepare<R: Real>(plant: &Plant<R>, state: &mut State<R>, scratch: &mut Scratch<R>, inputs: &[R]) {
    let input = |index: usize| inputs.get(index).copied().unwrap_or(R::splat(0.0));
    let scale = |command: Option<usize>| command.map_or(R::splat(1.0), input);
    for (path, samples) in plant.commands.iter().zip(&mut scratch.duties) {
        path.run(input(path.input), &mut state.memory, samples);
    }
    for (i, drive) in plant.drives.iter().enumerate() {
        let on = scale(drive.relay).map(|relay| if relay >= 0.5 { 1.0 } else { 0.0 });
        let speed = drive.speed * on;
        let phase = state.phase.get(i).copied().unwrap_or(R::splat(0.0));
        if let Some(slot) = scratch.speeds.get_mut(i) {
            *slot = speed;
        }
        scratch.walls.turn(i, drive, &plant.cylinders, phase, speed, 0.5 * plant.step_s);
    }
    for given in &plant.given {
        state.x[given.node % state.x.len()] = given.atmosphere + given.gauge * scale(given.command);
    }
    for (pump, slot) in plant.displacements.iter().zip(&mut scratch.displacements) {
        *slot = scale(pump.command);
    }
    for (feed, slot) in plant.feeds.iter().zip(&mut scratch.feeds) {
        *slot = scale(feed.command);
    }
}

/// Classical RK4 with constant step over the tick.
#[inline(always)]
fn steps<R: Real, const STATES: usize, const NODES: usize, const THERMAL: bool>(
    plant: &Plant<R>,
    state: &mut State<R>,
    scratch: &Scratch<R>,
) {
    let h = plant.step_s;
    let (whole, half, sixth) = (R::splat(h), R::splat(0.5 * h), R::splat(h / 6.0));
    let two = R::splat(2.0);
    let mut x: [R; NODES] = std::array::from_fn(|i| state.x[i % state.x.len()]);
    let mut y = x;
    let mut gas = Gas {
        temperature: std::array::from_fn(|i| plant.temperature[i % plant.temperature.len()]),
        inverse_speed: std::array::from_fn(|i| plant.inverse_speed[i % plant.inverse_speed.len()]),
    };
    let lagging = plant.sensors.iter().any(|sensor| sensor.memory.is_some());
    for step in 0..plant.steps {
        let k1: [R; STATES] = rates::<R, STATES, NODES, THERMAL>(plant, scratch, &mut gas, &x, 2 * step);
        for i in 0..STATES {
            y[i] = k1[i].mul_add(half, x[i]);
        }
        let k2: [R; STATES] = rates::<R, STATES, NODES, THERMAL>(plant, scratch, &mut gas, &y, 2 * step + 1);
        for i in 0..STATES {
            y[i] = k2[i].mul_add(half, x[i]);
        }
        let k3: [R; STATES] = rates::<R, STATES, NODES, THERMAL>(plant, scratch, &mut gas, &y, 2 * step + 1);
        for i in 0..STATES {
            y[i] = k3[i].mul_add(whole, x[i]);
        }
        let k4: [R; STATES] = rates::<R, STATES, NODES, THERMAL>(plant, scratch, &mut gas, &y, 2 * step + 2);
        let start = x;
        for i in 0..STATES {
            x[i] = sixth.mul_add(two.mul_add(k2[i] + k3[i], k1[i] + k4[i]), x[i]);
        }
        if lagging {
            for sensor in &plant.sensors {
                if let Some(reading) = sensor.memory.and_then(|m| state.memory.get_mut(m)) {
                    let mean = R::splat(0.5) * (start[sensor.node % NODES] + x[sensor.node % NODES]);
                    *reading = sensor.approach.mul_add(mean - *reading, *reading);
                }
            }
        }
    }
    for (kept, new) in state.x.iter_mut().zip(&x).take(STATES) {
        *kept = *new;
    }
}
