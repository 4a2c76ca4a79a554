//! One tick: command paths, crank, then fixed-step RK4.
//!
//! The whole tick is one inlined function so that it can be compiled for each instruction set
//! (see [`super::dispatch`]); loops over states have a constant length, so states stay in registers.

use super::command::Samples;
use super::elements::{AveragedPump, SpringCheck};
use super::lag;
use super::rates::{Gas, rates};
use super::{INSTANTS_PER_STEP, MEMORY, MOST_STATES, NODES, Plant, Scratch, State};
use crate::real::Real;

/// Advances `state` by one tick under `inputs` (in the order of [`Plant::inputs`]).
#[inline(always)]
pub(crate) fn tick<R: Real>(plant: &Plant<R>, state: &mut State<R>, scratch: &mut Scratch<R>, inputs: &[R]) {
    prepare(plant, state, scratch, inputs);
    match plant.carried_states() {
        4 if !plant.extended => steps::<R, 4, 8, false>(plant, state, scratch),
        4 => steps::<R, 4, 8, true>(plant, state, scratch),
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
    if plant.sags.is_empty() {
        for (path, samples) in plant.commands.iter().zip(&mut scratch.duties) {
            path.run(input(path.input), &mut state.memory, samples);
        }
    } else {
        run_on_one_supply(plant, state, scratch, inputs);
    }
    if plant.mean_duties {
        scratch.duties.iter_mut().for_each(Samples::take_means);
    }
    for (i, drive) in plant.drives.iter().enumerate() {
        let on = scale(drive.relay).map(|relay| if relay >= 0.5 { 1.0 } else { 0.0 });
        let mut speed = drive.speed * on;
        if drive.warms {
            // In the middle of the tick.
            let elapsed = R::splat(-(state.ticks as f64 + 0.5) * plant.tick_s());
            let warmth = R::splat(1.0) - (elapsed * drive.approach_rate).map(f64::exp);
            speed = speed * drive.warm_share.mul_add(warmth, R::splat(1.0));
            if let Some(slot) = scratch.warmth.get_mut(i) {
                *slot = warmth;
            }
        }
        if let Some((inlet, outlet)) = drive.droops {
            let against = state.x[outlet % NODES] - state.x[inlet % NODES];
            speed = speed * (R::splat(1.0) - drive.droop * against).at_least(R::splat(0.0));
        }
        let phase = state.phase.get(i).copied().unwrap_or(R::splat(0.0));
        if let (Some(slot), Some(running)) = (scratch.speeds.get_mut(i), scratch.running.get_mut(i)) {
            *slot = speed;
            *running = on;
        }
        scratch.walls.turn(i, drive, &plant.cylinders, phase, speed, plant.instant_s());
    }
    for given in &plant.given {
        state.x[given.node % NODES] = given.atmosphere + given.gauge * scale(given.command);
    }
    for pump in &plant.averaged {
        switch(plant, pump, state, scratch.running(pump.drive));
    }
    for (pump, slot) in plant.displacements.iter().zip(&mut scratch.displacements) {
        *slot = scale(pump.command);
    }
    for (feed, slot) in plant.feeds.iter().zip(&mut scratch.feeds) {
        *slot = scale(feed.command);
    }
    for (joined, slot) in plant.joined.iter().zip(&mut scratch.joining) {
        let tick_s = plant.tick_s();
        let [now, then] = [state.ticks, state.ticks + 1].map(|ticks| joined.volume_at(ticks as f64 * tick_s));
        *slot = (then - now) * R::splat(1.0 / tick_s);
    }
}

/// Hands an averaged pump's ripple to its chambers when it stops, and takes it out again when it starts: while it runs
/// states are means, while it stands they are the pressures themselves.
#[inline(always)]
fn switch<R: Real>(plant: &Plant<R>, pump: &AveragedPump<R>, state: &mut State<R>, running: R) {
    let ran = state.memory[pump.memory % MEMORY];
    let zero = R::splat(0.0);
    let stopped = ran - running;
    if stopped.any_above(zero) || (-stopped).any_above(zero) {
        let phase = state.phase[pump.drive % state.phase.len()];
        let moved = plant.moved(pump, &state.x, phase);
        let [inlet, outlet] = plant.ripple(pump, &state.x, moved);
        if pump.inlet < plant.chambers {
            state.x[pump.inlet % NODES] += stopped * inlet;
        }
        if pump.outlet < plant.chambers {
            state.x[pump.outlet % NODES] += stopped * outlet;
        }
        // What the chambers lack of their means is in the cylinders.
        state.x[pump.content % NODES] += stopped * (moved[0] - moved[1]);
        state.memory[pump.memory % MEMORY] = running;
    }
}

/// All command paths, with what the drivers' common supply loses under their current.
#[inline(always)]
fn run_on_one_supply<R: Real>(plant: &Plant<R>, state: &mut State<R>, scratch: &mut Scratch<R>, inputs: &[R]) {
    let mut spread = false;
    for (path, samples) in plant.commands.iter().zip(&mut scratch.duties) {
        path.run_to_driver(inputs.get(path.input).copied().unwrap_or(R::splat(0.0)), &mut state.memory, samples);
        spread |= path.on_supply && samples.is_spread();
    }
    let mut last = 0;
    if spread {
        for (_, samples) in plant.commands.iter().zip(&mut scratch.duties).filter(|(path, _)| path.on_supply) {
            samples.spread();
            last = samples.instants();
        }
    }
    for k in 0..=last {
        let drawing = || plant.commands.iter().zip(&scratch.duties).filter(|(path, _)| path.on_supply);
        let total = drawing().fold(R::splat(0.0), |sum, (_, samples)| sum + samples.at(k));
        let left = plant.sags.iter().fold(R::splat(1.0), |factor, sag| factor * sag.left(total));
        for (_, samples) in plant.commands.iter().zip(&mut scratch.duties).filter(|(path, _)| path.on_supply) {
            samples.scale(k, left);
        }
    }
    for (path, samples) in plant.commands.iter().zip(&mut scratch.duties) {
        path.run_from_driver(&mut state.memory, samples);
    }
}

/// A step, or half of one: its length and where it lies in the table of instants.
#[derive(Clone, Copy)]
struct Span<R> {
    /// First instant.
    from: usize,
    /// Instants from the start to the middle.
    half: usize,
    /// Length in seconds.
    length: R,
}

/// Classical RK4 with constant step over the tick.
///
/// Where a check valve opens or shuts within a step the order is lost, and errors of such steps add up to 0.015 kPa
/// on the paper's rig. With [`Plant::refine`] those steps (one in 27) are taken again in two halves, which leaves a
/// third of that. Lanes that did not switch keep the whole step, so each lane has the bits it would have alone.
#[inline(always)]
fn steps<R: Real, const STATES: usize, const NODES: usize, const EXTENDED: bool>(
    plant: &Plant<R>,
    state: &mut State<R>,
    scratch: &Scratch<R>,
) {
    let whole = R::splat(plant.step_s);
    let halved = R::splat(0.5 * plant.step_s);
    let mut x: [R; NODES] = std::array::from_fn(|i| state.x[i % state.x.len()]);
    let mut gas = Gas {
        temperature: std::array::from_fn(|i| plant.temperature[i % plant.temperature.len()]),
        inverse_speed: std::array::from_fn(|i| plant.inverse_speed[i % plant.inverse_speed.len()]),
    };
    let lagging = plant.sensors.iter().any(|sensor| sensor.memory.is_some() || sensor.response.is_some());
    for step in 0..plant.steps {
        let first = INSTANTS_PER_STEP * step;
        let start = x;
        if EXTENDED {
            let instant = if plant.mean_duties { first + INSTANTS_PER_STEP / 2 } else { first };
            for vent in plant.shaped_vents.iter().filter(|vent| vent.held.is_some()) {
                let duty = scratch.duty(vent.command, instant);
                let pressures = [x[vent.up % NODES], x[vent.down % NODES]];
                let swing = plant.swing(vent.up, vent.down, &state.x, &state.memory);
                if let Some(slot) = vent.held.and_then(|slot| state.memory.get_mut(slot)) {
                    *slot = vent.held_at(*slot, duty, pressures, swing);
                }
            }
        }
        let mut span = Span { from: first, half: INSTANTS_PER_STEP / 2, length: whole };
        let mut unrefined = None;
        // One call site: the step is inlined once, whether it is taken whole or in halves.
        loop {
            let end = rk4::<R, STATES, NODES, EXTENDED>(plant, scratch, &state.memory, &mut gas, &x, span);
            match unrefined {
                None if plant.refine && switches::<R, NODES, EXTENDED>(plant, &start, &end) => {
                    unrefined = Some(end);
                    span = Span { from: first, half: INSTANTS_PER_STEP / 4, length: halved };
                }
                None => {
                    x = end;
                    break;
                }
                Some(_) if span.from == first => {
                    x = end;
                    span.from = first + INSTANTS_PER_STEP / 2;
                }
                Some(coarse) => {
                    x = switched_lanes::<R, NODES, EXTENDED>(plant, &start, &coarse, &end);
                    break;
                }
            }
        }
        if lagging {
            for sensor in &plant.sensors {
                sensor.follow([start[sensor.node % NODES], x[sensor.node % NODES]], &mut state.memory);
            }
        }
        if EXTENDED {
            for probe in plant.residuals.iter().flat_map(|residual| &residual.probes) {
                let Some(lagged) = probe.memory.and_then(|m| state.memory.get_mut(m)) else { continue };
                let before = probe.variable.at(scratch, plant.atmosphere_pa, &start, first);
                let after = probe.variable.at(scratch, plant.atmosphere_pa, &x, first + INSTANTS_PER_STEP);
                *lagged = lag::follow(*lagged, [before, after], probe.approach, probe.ahead);
            }
        }
    }
    for (kept, new) in state.x.iter_mut().zip(&x).take(STATES) {
        *kept = *new;
    }
}

#[inline(always)]
fn rk4<R: Real, const STATES: usize, const NODES: usize, const EXTENDED: bool>(
    plant: &Plant<R>,
    scratch: &Scratch<R>,
    memory: &[R; MEMORY],
    gas: &mut Gas<R, NODES>,
    x: &[R; NODES],
    span: Span<R>,
) -> [R; NODES] {
    let Span { from, half, length } = span;
    let (middle, sixth, two) = (length * R::splat(0.5), length * R::splat(1.0 / 6.0), R::splat(2.0));
    let mut y = *x;
    let (k1, k2, k3, k4);
    if EXTENDED {
        // In a loop, so that the larger balances are inlined once and not four times: half the build time of the crate,
        // and the same operations in the same order.
        let mut k = [[R::splat(0.0); STATES]; 4];
        for (stage, slope) in k.iter_mut().enumerate() {
            // A mean over the step stands at its middle.
            let middle_of_step = from / INSTANTS_PER_STEP * INSTANTS_PER_STEP + INSTANTS_PER_STEP / 2;
            let instant = if plant.mean_duties { middle_of_step } else { from + stage.div_ceil(2) * half };
            *slope = rates::<R, STATES, NODES, EXTENDED>(plant, scratch, memory, gas, &y, instant);
            let reach = if stage < 2 { middle } else { length };
            for i in 0..STATES {
                y[i] = slope[i].mul_add(reach, x[i]);
            }
        }
        [k1, k2, k3, k4] = k;
    } else {
        k1 = rates::<R, STATES, NODES, EXTENDED>(plant, scratch, memory, gas, x, from);
        for i in 0..STATES {
            y[i] = k1[i].mul_add(middle, x[i]);
        }
        k2 = rates::<R, STATES, NODES, EXTENDED>(plant, scratch, memory, gas, &y, from + half);
        for i in 0..STATES {
            y[i] = k2[i].mul_add(middle, x[i]);
        }
        k3 = rates::<R, STATES, NODES, EXTENDED>(plant, scratch, memory, gas, &y, from + half);
        for i in 0..STATES {
            y[i] = k3[i].mul_add(length, x[i]);
        }
        k4 = rates::<R, STATES, NODES, EXTENDED>(plant, scratch, memory, gas, &y, from + 2 * half);
    }
    for i in 0..STATES {
        y[i] = sixth.mul_add(two.mul_add(k2[i] + k3[i], k1[i] + k4[i]), x[i]);
    }
    y
}

/// Tells whether a one-way passage is open at one end of a step and shut at the other, in any lane.
#[inline(always)]
fn switches<R: Real, const NODES: usize, const EXTENDED: bool>(
    plant: &Plant<R>,
    start: &[R; NODES],
    end: &[R; NODES],
) -> bool {
    let mut any = false;
    for passage in &plant.passages {
        let (up, down) = (passage.up % NODES, passage.down % NODES);
        any |= (start[up] - start[down]).any_across_zero(end[up] - end[down]);
    }
    if EXTENDED {
        for check in &plant.spring_checks {
            let over = |x: &[R; NODES]| x[check.up % NODES] - x[check.down % NODES] - check.cracking;
            any |= over(start).any_across_zero(over(end));
        }
    }
    any
}

/// Takes the refined end in the lanes that switched and the coarse one in the others.
#[cold]
fn switched_lanes<R: Real, const NODES: usize, const EXTENDED: bool>(
    plant: &Plant<R>,
    start: &[R; NODES],
    coarse: &[R; NODES],
    refined: &[R; NODES],
) -> [R; NODES] {
    let open =
        |x: &[R; NODES], up: usize, down: usize, lane: usize| x[up % NODES].lane(lane) > x[down % NODES].lane(lane);
    let sprung = |x: &[R; NODES], check: &SpringCheck<R>, lane: usize| {
        (x[check.up % NODES] - x[check.down % NODES] - check.cracking).lane(lane) > 0.0
    };
    let switched = |lane: usize| {
        plant.passages.iter().any(|p| open(start, p.up, p.down, lane) != open(coarse, p.up, p.down, lane))
            || (EXTENDED && plant.spring_checks.iter().any(|c| sprung(start, c, lane) != sprung(coarse, c, lane)))
    };
    let mut x = *coarse;
    for lane in (0..R::LANES).filter(|lane| switched(*lane)) {
        for (slot, new) in x.iter_mut().zip(refined) {
            *slot = R::from_lanes(|l| if l == lane { new.lane(l) } else { slot.lane(l) });
        }
    }
    x
}
