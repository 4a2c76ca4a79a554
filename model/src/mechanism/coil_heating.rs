//! `coil_heating`: a warm coil has more resistance, draws less current at the same duty and pulls less.
//!
//! ```text
//! τ θ̇ = u² − θ,        y = u / (1 + k θ)
//! ```
//!
//! with, where the winding warms before its body (`winding_share` s, `winding_time_constant_s` τ_w; two bodies in series,
//! as motors' windings and irons are taken, IEC 60034-11),
//!
//! ```text
//! τ_w θ̇_w = u² − θ_w,        y = u / (1 + k ((1 − s) θ + s θ_w))
//! ```
//!
//! Copper gains 0.39 % of resistance per kelvin (IEC 60028), and the heat put in goes with the square of the duty; `θ`
//! is the temperature rise as a share of that at full duty for ever, so `k` is the resistance gained there: 4 … 16 %
//! for rises of 10 … 40 K. A driver that sets voltage loses as much current (one that sets current loses nothing). `τ` is
//! minutes: grams of copper in still air. Even a winding alone, 20 g of copper (8 J/K) that its bobbin parts from the iron
//! by 2 K/W or more, takes 15 s; what is quicker is something else that follows the duty (moisture in a throat, say). Since
//! the paper's area is straight in `u`, this is `Ĉ_u / (1 + k θ)`. Writing `1 − k θ` instead leaves a tenth of the effect
//! where `k` is a tenth, which then looks like other physics.
//! It tells itself by being slow and one-sided: it follows the past duty, never the pressure.
//!
//! A run starts with `θ` = `initial_heat` (0: cold), whatever was commanded before; where recordings start
//! warm, fits free it ([`crate::plant::Simulation::set_unknown`]). A later part of a recording goes on from what was commanded in the
//! rows before it ([`crate::plant::Simulation::warm_coils`]).

use serde::{Deserialize, Serialize};

use super::{Form, Mechanism, Physics, Place, is_zero};
use crate::plant::{Samples, lanes_of};
use crate::real::Real;
use crate::rig::{Number, Rig, numbers};

/// A coil that weakens as it warms.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CoilHeating {
    /// k: share of its cold resistance that the coil gains at full duty for ever (0 … 10).
    pub resistance_rise: f64,
    /// τ: time constant of warming in s.
    pub time_constant_s: f64,
    /// θ at the start of a run, as a share of that at full duty for ever (0 … 1); absent means cold.
    #[serde(default)]
    pub initial_heat: f64,
    /// s: share of the rise that the winding has over its body (0 … 1); absent means that both are one.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub winding_share: f64,
    /// τ_w: time constant of that share in s.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub winding_time_constant_s: f64,
}

numbers!(CoilHeating {
    resistance_rise: Number::new("", 0.0, 10.0)
        .plausible(0.0, 0.4)
        .starts(&[0.02, 0.05, 0.1, 0.2])
        .hint("a share of the cold resistance"),
    time_constant_s: Number::new("s", 0.1, 1e5).plausible(15.0, 900.0).slow().starts(&[90.0, 30.0, 300.0]),
    initial_heat: Number::new("", 0.0, 1.0).starts(&[0.0]).hint("a share: 0 is cold").optional(),
    winding_share: Number::new("", 0.0, 1.0).plausible(0.02, 0.8).starts(&[0.3]).hint("a share of the rise").optional(),
    winding_time_constant_s: Number::new("s", 0.0, 1e5).plausible(1.0, 120.0).starts(&[10.0]).optional(),
});

impl Physics for CoilHeating {
    const ID: &'static str = "coil_heating";
    const PLACES: &'static [Place] = &[Place::Valve];
    const SETTLED: bool = true;

    fn forms(_rig: &Rig, _component: &str) -> Vec<Form> {
        let cold = CoilHeating {
            resistance_rise: 0.0,
            time_constant_s: 90.0,
            initial_heat: 0.0,
            winding_share: 0.0,
            winding_time_constant_s: 0.0,
        };
        let winding = Form::of("winding", Mechanism::CoilHeating(cold.clone()), &[0, 1, 3, 4]).refinement();
        // All recordings are taken to start as warm as each other: few who record one after the other let coils cool.
        let warm = Form::of("warm", Mechanism::CoilHeating(cold.clone()), &[0, 1, 2])
            .ranging(0, [0.0, 0.4], vec![0.1])
            .ranging(2, [0.0, 1.0], vec![0.3]);
        vec![Form::of("", Mechanism::CoilHeating(cold), &[0, 1]), warm, winding]
    }
}

impl CoilHeating {
    pub(crate) fn operator(&self, instant_s: f64) -> Heat<f64> {
        Heat {
            rise: self.resistance_rise,
            approach: -(-instant_s / self.time_constant_s).exp_m1(),
            share: self.winding_share,
            winding_approach: -(-instant_s / self.winding_time_constant_s).exp_m1(),
            initial: self.initial_heat,
        }
    }
}

/// The coil from one tabled instant to the next; its memory is `θ` and `θ_w`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Heat<R> {
    rise: R,
    /// 1 − e^(−s/τ) for the time between two instants.
    approach: R,
    /// s.
    share: R,
    /// 1 − e^(−s/τ_w).
    winding_approach: R,
    /// Both at the start of a run.
    pub(crate) initial: R,
}

impl<R: Real> Heat<R> {
    pub(crate) fn side_by_side(parts: &[Heat<f64>]) -> Self {
        Heat {
            rise: lanes_of(parts, |p| p.rise),
            approach: lanes_of(parts, |p| p.approach),
            share: lanes_of(parts, |p| p.share),
            winding_approach: lanes_of(parts, |p| p.winding_approach),
            initial: lanes_of(parts, |p| p.initial),
        }
    }

    /// Part of `duty` that acts at heat `heat`.
    #[inline(always)]
    pub(crate) fn at(&self, duty: R, heat: R) -> R {
        duty / self.rise.mul_add(heat, R::splat(1.0))
    }

    #[inline(always)]
    pub(crate) fn run(&self, memory: &mut [R], samples: &mut Samples<R>) {
        let [mut body, mut winding] = [0, 1].map(|k: usize| memory.get(k).copied().unwrap_or(self.initial));
        samples.spread();
        let mut before: Option<R> = None;
        for sample in samples.in_time() {
            let duty = *sample;
            // The duty of the interval that ends here; the first sample is the tick's own start.
            if let Some(duty) = before {
                body = self.approach.mul_add(duty * duty - body, body);
                winding = self.winding_approach.mul_add(duty * duty - winding, winding);
            }
            before = Some(duty);
            *sample = self.at(duty, self.share.mul_add(winding - body, body));
        }
        for (slot, heat) in memory.iter_mut().zip([body, winding]) {
            *slot = heat;
        }
    }

    /// Carries duties that are each held for `instants`, as far as they are there (0 … 1 of each).
    pub(crate) fn hold(&self, instants: usize, held: impl Iterator<Item = (R, R)>, memory: &mut [R]) {
        let over =
            |approach: R| approach.map(|part| 1.0 - (1.0 - part).powi(i32::try_from(instants).unwrap_or(i32::MAX)));
        let approaches = [over(self.approach), over(self.winding_approach)];
        for (duty, there) in held {
            for (heat, approach) in memory.iter_mut().zip(approaches) {
                *heat = (there * approach).mul_add(duty * duty - *heat, *heat);
            }
        }
    }
}

impl Heat<f64> {
    /// Numbers it remembers.
    pub(crate) const MEMORY: usize = 2;
}
