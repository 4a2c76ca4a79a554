//! Chambers estimated behind sensors that lag or swing.
//!
//! A sensor that reads what is there tells its chamber's pressure; setting the model's to it is all there is to do. Behind a
//! lag the reading tells where the chamber *was*: set to it, a model predicts the lag twice. There the innovation, what was
//! read less what the model's sensor says, moves three things by the gains of a steady Kalman filter (`gains`): the chamber,
//! the sensor's memory, and a rate by which the model errs, which is what leaves no offset where the model is wrong.
//!
//! ```text
//! P += K_P e        m += K_m e        d += K_d e        then in every tick  P += d
//! ```
//!
//! The noise that the gains trade against is found from the readings ([`ReadingNoise`]). A perfect model has no innovation, and
//! predicts what comes. The pump's ripple is shown by a late sensor otherwise than by one that is not (`ripple`).
//!
//! Source: Kalman, *J. Basic Eng.* 82 (1960); the constant disturbance as in offset-free control, Pannocchia and Rawlings,
//! *AIChE J.* 49 (2003).

mod gains;
mod noise;
mod ripple;

pub use noise::ReadingNoise;

use crate::observation::CHANNELS;
use crate::plant::{Plant, Simulated, Simulation};
use crate::real::Real;

use gains::{Gains, Ladder, NOISES_KPA};
use ripple::Ripple;

/// Noise that is taken for a reading before any has come, in kPa RMS: between both sensors of the paper's rig.
const FIRST_NOISE_KPA: f64 = 0.024;

/// One sensor that lags or swings.
#[derive(Debug, Clone)]
struct Channel<R> {
    ladder: Ladder<R>,
    /// Reading per pressure.
    gain: R,
    noise: ReadingNoise<R>,
    /// Error of the model, in Pa per tick.
    disturbance_pa: R,
    ripple: Ripple<R>,
}

impl<R: Real> Channel<R> {
    /// The gains at a noise (kPa RMS), between two of the ladder.
    fn at(&self, noise_kpa: R) -> Gains<R> {
        let place = noise_kpa.map(|noise| {
            let above = NOISES_KPA.iter().position(|rung| *rung >= noise).unwrap_or(NOISES_KPA.len() - 1);
            let below = above.saturating_sub(1);
            let (low, high) = (NOISES_KPA[below], NOISES_KPA[above]);
            let between = if high > low { ((noise - low) / (high - low)).clamp(0.0, 1.0) } else { 0.0 };
            below as f64 + between
        });
        let mix = |of: &dyn Fn(&Gains<R>) -> R| {
            R::from_lanes(|lane| {
                let at = place.lane(lane);
                let below = (at as usize).min(NOISES_KPA.len() - 2);
                let share = at - below as f64;
                (1.0 - share) * of(&self.ladder[below]).lane(lane) + share * of(&self.ladder[below + 1]).lane(lane)
            })
        };
        Gains {
            pressure: mix(&|g| g.pressure),
            disturbance: mix(&|g| g.disturbance),
            memory: std::array::from_fn(|m| mix(&|g| g.memory[m])),
        }
    }
}

/// The observer of both chambers.
#[derive(Debug, Clone)]
pub(crate) struct Observer<R> {
    /// `None` for a sensor that reads what is there.
    channels: [Option<Channel<R>>; CHANNELS],
    /// Sensor of each channel in the plant.
    sensors: [usize; CHANNELS],
    /// Correction that the last reading made to each chamber beyond the model, in kPa as its sensor reads it.
    added_kpa: [R; CHANNELS],
}

impl<R: Simulated> Observer<R> {
    /// The observer of a compiled rig whose channels are read by `sensors`.
    pub(crate) fn of(plant: &Plant<R>, sensors: [usize; CHANNELS]) -> Self {
        let channels = sensors.map(|index| {
            let system = plant.sensor_system(index)?;
            Some(Channel {
                ladder: gains::ladder(&system),
                gain: system.gain,
                noise: ReadingNoise::beginning_at(FIRST_NOISE_KPA),
                disturbance_pa: R::splat(0.0),
                ripple: Ripple::behind(system),
            })
        });
        Observer { channels, sensors, added_kpa: [R::splat(0.0); CHANNELS] }
    }

    /// Forgets by what the model errs: the rig has been started anew.
    pub(crate) fn restart(&mut self) {
        for channel in self.channels.iter_mut().flatten() {
            channel.disturbance_pa = R::splat(0.0);
            channel.noise.restart();
            channel.ripple.restart();
        }
    }

    /// As `restart`, for one lane.
    pub(crate) fn restart_lane(&mut self, lane: usize) {
        for channel in self.channels.iter_mut().flatten() {
            let kept = channel.disturbance_pa;
            channel.disturbance_pa = R::from_lanes(|l| if l == lane { 0.0 } else { kept.lane(l) });
            channel.noise.restart_lane(lane);
            channel.ripple.restart_lane(lane);
        }
    }

    /// Takes in what was measured at this tick, in kPa gauge.
    ///
    /// # Real-time
    /// Bounded and allocation-free: it may run in the tick.
    pub(crate) fn correct(&mut self, simulation: &mut Simulation<R>, measured_kpa: [R; CHANNELS]) {
        for (c, channel) in self.channels.iter_mut().enumerate() {
            let (sensor, measured) = (self.sensors[c], measured_kpa[c]);
            let Some(channel) = channel else {
                self.added_kpa[c] = measured - simulation.reading_kpa(sensor);
                simulation.correct(&[sensor], &[measured]);
                continue;
            };
            let noise_kpa = channel.noise.follow(measured);
            let gains = channel.at(noise_kpa / channel.gain.map(f64::abs));
            let shown_kpa = simulation.reading_kpa(sensor);
            channel.ripple.follow(shown_kpa, simulation.undelayed_kpa(sensor));
            let innovation_pa = (measured - shown_kpa) / channel.gain * R::splat(1e3);
            // The disturbance was added after the tick before this reading; it is no work of the model's either.
            self.added_kpa[c] =
                (channel.disturbance_pa + gains.pressure * innovation_pa) * channel.gain * R::splat(1e-3);
            simulation.move_sensed_pressure(sensor, gains.pressure * innovation_pa);
            let memory_pa = gains.memory.map(|gain| gain * innovation_pa);
            simulation.move_sensor_memory(sensor, &memory_pa);
            let as_read = channel.gain * R::splat(1e-3);
            channel.ripple.corrected(gains.pressure * innovation_pa * as_read, &memory_pa.map(|by| by * as_read));
            channel.disturbance_pa += gains.disturbance * innovation_pa;
        }
    }

    /// Correction that the last reading made to each chamber beyond the model's own motion, in kPa as its sensor reads it.
    ///
    /// # Real-time
    /// May run in the tick.
    pub(crate) fn added_kpa(&self) -> [R; CHANNELS] {
        self.added_kpa
    }

    /// Adds, after a tick of the model, what it errs by in one.
    ///
    /// # Real-time
    /// May run in the tick.
    pub(crate) fn disturb(&self, simulation: &mut Simulation<R>) {
        for (channel, sensor) in self.channels.iter().zip(self.sensors) {
            if let Some(channel) = channel {
                simulation.move_sensed_pressure(sensor, channel.disturbance_pa);
            }
        }
    }

    /// Readings of the sensors now if none lagged or swung, in kPa gauge, with the pump's ripple as they show it; what was
    /// measured where none does.
    ///
    /// # Real-time
    /// May run in the tick.
    pub(crate) fn undelayed_kpa(&self, simulation: &Simulation<R>, measured_kpa: [R; CHANNELS]) -> [R; CHANNELS] {
        std::array::from_fn(|c| match &self.channels[c] {
            Some(channel) => simulation.undelayed_kpa(self.sensors[c]) + channel.ripple.mean_kpa(),
            None => measured_kpa[c],
        })
    }
}
