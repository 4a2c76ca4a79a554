//! Sensors, and the chambers that are read by a neighbour's.

use super::{Assembly, mechanisms_on};
use crate::mechanism::{Mechanism, Swing};
use crate::plant::lag::Share;
use crate::plant::sensor::SensorPath;
use crate::rig::{Line, RigError};

impl Assembly<'_> {
    pub(super) fn sensors(&mut self) -> Result<(), RigError> {
        for (name, sensor) in &self.rig.sensors {
            let node = self.node(&sensor.volume);
            let mut path = SensorPath::plain(node);
            for mechanism in mechanisms_on(self.rig, name) {
                match mechanism {
                    Mechanism::SensorLag(m) => {
                        let [first, second] = m.time_constants_s();
                        path.memory = Some(self.memory);
                        Share { approach: path.approach, ahead: path.ahead } = Share::of(first, self.plant.step_s);
                        self.memory += 1;
                        if second > 0.0 {
                            path.second = Some(self.memory);
                            Share { approach: path.second_approach, ahead: path.second_ahead } =
                                Share::of(second, self.plant.step_s);
                            self.memory += 1;
                        }
                    }
                    Mechanism::ResidualResponse(m) => {
                        path.response = Some(self.memory);
                        (path.natural, path.damping, path.share) = (m.natural_rad_s(), m.damping_ratio, m.share);
                        let Swing { keeps, turns, damps } = m.swing(self.plant.step_s);
                        (path.keeps, path.turns, path.damps) = (keeps, turns, damps);
                        path.keeps_up = 1.0 / (path.natural * self.plant.step_s);
                        self.memory += 2;
                    }
                    Mechanism::SensorGain(m) => path.gain = m.gain,
                    Mechanism::SensorBias(m) => path.bias = m.bias_kpa,
                    Mechanism::SensorDrift(m) => (path.drift, path.drift_end) = m.course(),
                    _ => {}
                }
            }
            self.plant.sensors.push(path);
        }
        self.plant.like = self.neighbours();
        Ok(())
    }

    /// Chambers without a sensor that lines join, over however many others, to one that has one: the nearest sensor.
    pub(super) fn neighbours(&self) -> Vec<(usize, usize)> {
        let joins: Vec<[usize; 2]> = self
            .rig
            .lines
            .values()
            .map(|line| match line {
                Line::Orifice { from, to, .. } | Line::Laminar { from, to, .. } => [self.node(from), self.node(to)],
            })
            .filter(|ends| ends.iter().all(|node| *node < self.plant.chambers))
            .collect();
        let mut known: Vec<(usize, usize)> =
            self.plant.sensors.iter().enumerate().map(|(sensor, path)| (path.node, sensor)).collect();
        let measured = known.len();
        // One more line away with each round.
        for _ in 0..self.plant.chambers {
            let is_known = |node: usize| known.iter().find(|(other, _)| *other == node).map(|(_, sensor)| *sensor);
            let next: Vec<(usize, usize)> = joins
                .iter()
                .flat_map(|[one, other]| [(*one, *other), (*other, *one)])
                .filter(|(to, _)| is_known(*to).is_none())
                .filter_map(|(to, from)| Some((to, is_known(from)?)))
                .collect();
            for (node, sensor) in next {
                if known.iter().all(|(other, _)| *other != node) {
                    known.push((node, sensor));
                }
            }
        }
        known.split_off(measured)
    }
}
