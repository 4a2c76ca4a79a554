//! State and disturbances, estimated: an extended Kalman filter a channel.
//!
//! ```text
//! P(k+1) = step(P, f, d) + w_P,    d(k+1) = d + w_d,    b(k+1) = b        y = P + v
//! ```
//!
//! `d` is the constant disturbance that makes the controller free of offset; `b` is the half width of the valve's play, which
//! moves the flapper `f` while it is pulled either way and not while it lies loose. Without excitation nothing would hold
//! `b`: a constant prior does, taken in like a reading in every tick.
//!
//! Sources: Pannocchia and Rawlings, *AIChE J.* 49 (2003), for the disturbance; Muntwiler, Köhler, Zeilinger, arXiv
//! 2312.14049, for the constant prior.

use law::TICK_S;
use model::observation::{CHANNELS, Pair};
use model::observer::ReadingNoise;
use nalgebra::{Matrix3, Vector3};

use super::reduced_model::{Acting, ReducedModel};

/// RMS of what the model's pressure errs by in a tick at random, as a share of the reading's noise; chosen.
const PRESSURE_STEP_SHARE: f64 = 0.3;
/// Bandwidth at which the disturbance is found, in rad/s: where the valves' timing is known, and where it is not, since what a delay makes
/// of a change looks like a disturbance.
const DISTURBANCE_BANDWIDTHS_PER_S: [f64; 2] = [6.0, 5.0];
/// Uncertainty of a half width before anything is seen (duty, one sigma): of one that nobody has told, and of one that
/// the rig file states, as a share of it (a few times the interval that a diagnosis gives it; with 0.15 what the model errs by on the
/// way from rest was taken for a width of half as much on two of nine rigs, told all of themselves).
const UNTOLD_SIGMA_DUTY: f64 = 0.03;
const TOLD_SIGMA_SHARE: f64 = 0.05;
const TOLD_LEAST_SIGMA_DUTY: f64 = 0.001;
/// The widest that is believed, in duty.
const WIDEST_DUTY: f64 = 0.06;
/// Standard deviations up to which a reading is off by chance.
const BY_CHANCE_SIGMA: f64 = 3.0;
/// Number of such ticks in a row after which the way from rest is over: a second (chosen; 10, 50 and 150 leave 0.169, 0.165 and 0.164 kPa in the
/// mean of `bench` and 20 rigs around it, 0.172 without).
const CALM_TICKS: u32 = 50;
/// Over how many ticks the prior counts once more.
const PRIOR_TICKS: f64 = 3000.0;
/// Noise before any has been seen, in kPa RMS.
const FIRST_NOISE_KPA: f64 = 0.03;
/// The most ticks of delay.
const MOST_DELAY: usize = 17;

/// One valve and its chamber.
#[derive(Debug, Clone)]
struct Channel {
    /// Duties sent, newest first.
    sent: [f64; MOST_DELAY],
    coil: f64,
    flapper: f64,
    /// +1 while the flapper is pulled up, −1 while down, 0 while it lies loose.
    pulled: f64,
    /// Pressure in kPa, disturbance in kPa/s, half width in duty.
    state: Vector3<f64>,
    covariance: Matrix3<f64>,
    prior: (f64, f64),
    noise: ReadingNoise<f64>,
    noise_kpa: f64,
    /// Ticks in a row in which the reading was off by no more than chance, and how many it takes for play to be learned.
    calm_ticks: u32,
    calm_ticks_needed: u32,
}

impl Channel {
    fn new(stated_half_width: f64, is_told: bool) -> Self {
        let sigma =
            if is_told { (TOLD_SIGMA_SHARE * stated_half_width).max(TOLD_LEAST_SIGMA_DUTY) } else { UNTOLD_SIGMA_DUTY };
        Channel {
            sent: [1.0; MOST_DELAY],
            coil: 1.0,
            flapper: 1.0,
            pulled: 0.0,
            state: Vector3::new(0.0, 0.0, stated_half_width),
            covariance: Matrix3::from_diagonal(&Vector3::new(1.0, 25.0, sigma * sigma)),
            prior: (stated_half_width, sigma * sigma * PRIOR_TICKS),
            noise: ReadingNoise::beginning_at(FIRST_NOISE_KPA),
            noise_kpa: FIRST_NOISE_KPA,
            calm_ticks: 0,
            calm_ticks_needed: if is_told { CALM_TICKS } else { 0 },
        }
    }

    /// Takes in a number of the state as if it had been read.
    fn take_in(&mut self, index: usize, value: f64, variance: f64) {
        let column: Vector3<f64> = self.covariance.column(index).into();
        let gain = column / (self.covariance[(index, index)] + variance);
        self.state += gain * (value - self.state[index]);
        let left = self.covariance - gain * column.transpose();
        self.covariance = (left + left.transpose()) * 0.5;
    }

    /// Takes in a reading. Until readings have been off by chance alone for a while, errors are the disturbance's, where a width is
    /// told: it is nearer to the truth than what the way from rest says of it.
    fn take_in_reading(&mut self, kpa: f64, variance: f64) {
        if self.calm_ticks < self.calm_ticks_needed {
            let off = kpa - self.state[0];
            let by_chance = off * off < BY_CHANCE_SIGMA * BY_CHANCE_SIGMA * (self.covariance[(0, 0)] + variance);
            self.calm_ticks = if by_chance { self.calm_ticks + 1 } else { 0 };
            for other in 0..2 {
                (self.covariance[(other, 2)], self.covariance[(2, other)]) = (0.0, 0.0);
            }
        }
        self.take_in(0, kpa, variance);
    }

    /// Moves coil and flapper through a tick; answers the flapper's mean.
    fn pull(&mut self, delay_ticks: f64, keeps: f64, mean_share: f64) -> f64 {
        let half_width = self.state[2].max(0.0);
        let whole = (delay_ticks as usize).min(MOST_DELAY - 2);
        let part = delay_ticks - whole as f64;
        let acting = (1.0 - part) * self.sent[whole] + part * self.sent[whole + 1];
        let mean = (1.0 - mean_share) * self.coil + mean_share * acting;
        self.coil = keeps * self.coil + (1.0 - keeps) * acting;
        let within = |flapper: f64, coil: f64| flapper.max(coil - half_width).min(coil + half_width);
        let flapper = within(self.flapper, mean);
        self.flapper = within(flapper, self.coil);
        let slack = self.coil - self.flapper;
        self.pulled = if slack >= half_width {
            1.0
        } else if slack <= -half_width {
            -1.0
        } else {
            0.0
        };
        flapper
    }
}

/// State of knowledge at a tick.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Estimate {
    /// Chambers in kPa gauge.
    pub(crate) pressures_kpa: Pair,
    /// Error of the model, in kPa/s.
    pub(crate) disturbance: Pair,
    /// The flappers' duties.
    pub(crate) flapper: Pair,
    /// Half widths of play, in duty.
    pub(crate) half_width: Pair,
}

/// The estimator of both channels.
#[derive(Debug, Clone)]
pub(crate) struct Estimator {
    /// Bandwidth at which disturbances are found, in rad/s.
    bandwidth_per_s: f64,
    channels: [Channel; CHANNELS],
}

impl Estimator {
    pub(crate) fn new(model: &ReducedModel) -> Self {
        let [known, unknown] = DISTURBANCE_BANDWIDTHS_PER_S;
        let bandwidth_per_s = if model.is_told { known } else { unknown };
        Estimator { bandwidth_per_s, channels: model.half_width.map(|width| Channel::new(width, model.is_told)) }
    }

    /// Begins anew with `duty` long in force and keeps what was learned of play.
    pub(crate) fn restart(&mut self, duty: Pair) {
        for (channel, duty) in self.channels.iter_mut().zip(duty) {
            channel.sent = [duty; MOST_DELAY];
            (channel.coil, channel.pulled) = (duty, 0.0);
            // Vents are opened: the flapper was pulled there from below.
            channel.flapper = duty - channel.state[2];
            (channel.state[0], channel.state[1]) = (f64::NAN, 0.0);
            let width = channel.covariance[(2, 2)];
            channel.covariance = Matrix3::from_diagonal(&Vector3::new(1.0, 25.0, width));
            channel.noise.restart();
            channel.calm_ticks = 0;
        }
    }

    /// Takes in the chambers' pressures as they are read, in kPa gauge.
    pub(crate) fn observe(&mut self, chambers_kpa: Pair) -> Estimate {
        for (channel, kpa) in self.channels.iter_mut().zip(chambers_kpa) {
            if channel.state[0].is_nan() {
                channel.state[0] = kpa;
            }
            let noise = channel.noise.follow(kpa);
            channel.noise_kpa = noise;
            channel.take_in_reading(kpa, noise * noise);
            let (width, variance) = channel.prior;
            channel.take_in(2, width, variance);
            channel.state[2] = channel.state[2].clamp(0.0, WIDEST_DUTY.max(1.5 * width));
        }
        let of = |value: &dyn Fn(&Channel) -> f64| self.channels.each_ref().map(value);
        Estimate {
            pressures_kpa: of(&|c| c.state[0]),
            disturbance: of(&|c| c.state[1]),
            flapper: of(&|c| c.flapper),
            half_width: of(&|c| c.state[2]),
        }
    }

    /// Moves on through the tick under the duties that were sent.
    pub(crate) fn advance(&mut self, model: &ReducedModel, duty: Pair, gas_k: Pair) {
        let mut flapper = [0.0; CHANNELS];
        for (c, channel) in self.channels.iter_mut().enumerate() {
            channel.sent.rotate_right(1);
            channel.sent[0] = duty[c];
            let timing = &model.timing[c];
            flapper[c] = channel.pull(timing.delay_ticks, timing.keeps, timing.mean_share);
        }
        let pressures_kpa = self.channels.each_ref().map(|c| c.state[0]);
        let acting = Acting { flapper, disturbance: self.channels.each_ref().map(|c| c.state[1]), gas_k };
        let slopes = model.slopes(pressures_kpa, &acting);
        let next = model.step(pressures_kpa, &acting);
        for (c, channel) in self.channels.iter_mut().enumerate() {
            let mut f = Matrix3::identity();
            (f[(0, 0)], f[(0, 1)]) = (slopes.by_pressure[c][c], TICK_S);
            f[(0, 2)] = -channel.pulled * slopes.by_flapper[c];
            channel.state[0] = next[c];
            let pressure_step = PRESSURE_STEP_SHARE * channel.noise_kpa;
            let disturbance_step = self.bandwidth_per_s.powi(2) * TICK_S * channel.noise_kpa;
            let process = Vector3::new(pressure_step.powi(2), disturbance_step.powi(2), 0.0);
            channel.covariance = f * channel.covariance * f.transpose() + Matrix3::from_diagonal(&process);
        }
    }
}
