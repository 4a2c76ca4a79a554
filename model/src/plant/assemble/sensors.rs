//! Sensors, and the chambers that are read by a neighbour's.

use super::{Assembly, mechanisms_on};
use crate::plant::sensor::SensorPath;
use crate::rig::{Line, RigError};

impl Assembly<'_> {
    pub(super) fn sensors(&mut self) -> Result<(), RigError> {
        for (name, sensor) in &self.rig.sensors {
            let node = self.node(&sensor.volume);
            let mechanisms = mechanisms_on(self.rig, name);
            let path = SensorPath::with(node, mechanisms, self.plant.step_s, &mut self.memory);
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
