//! A learner that begins where another policy or another learner stands.

use crate::learner::{Learner, LearnerError};
use crate::network::{Network, NetworkError};
use crate::parameters::{Kind, Plain, gather};
use crate::settings::SettingsError;
use crate::workers::{Temperature, read, write};

/// Parts of a critic that go over: its weights and their slow copy. The optimiser begins anew.
const OF_A_CRITIC: [Kind; 2] = [Kind::Value, Kind::Target];

impl Learner {
    /// Starts the actor from these weights, its optimiser anew; without a layer for the standard deviation that
    /// starts as [`crate::Settings::initial_log_std`] says.
    ///
    /// # Errors
    /// A network of other widths or features, or one that does not fit together.
    pub fn warm_start(&mut self, network: &Network) -> Result<(), LearnerError> {
        network.check()?;
        let frame = &self.shared.frame;
        if network.features != frame.features {
            return Err(NetworkError::Features.into());
        }
        let actions = frame.shape.actions;
        let mut expected = frame.actor_widths();
        expected.pop();
        expected.push(actions);
        if network.widths() != expected {
            return Err(NetworkError::Widths { found: network.widths(), expected }.into());
        }
        let last = network.layers.len() - 1;
        for part in &self.shared.actor {
            let mut part = write(part);
            for (l, slab) in part.iter_mut().enumerate() {
                let layer = &network.layers[l];
                let rows = if l == last { 2 * actions } else { layer.outputs };
                let mut plain = Plain {
                    inputs: layer.inputs,
                    weights: vec![0.0; rows * layer.inputs],
                    bias: vec![frame.settings.initial_log_std; rows],
                };
                layer.write_to(&mut plain, 0);
                if let Some(log_std) = network.log_std.as_ref().filter(|_| l == last) {
                    log_std.write_to(&mut plain, actions);
                }
                slab.read_from(Kind::Value, &plain);
                slab.forget_moments();
            }
        }
        Ok(())
    }

    /// Starts critics and temperature from another learner's, their optimisers anew: what it has learned of the worth of
    /// actions, and how much it still tried. The actor stays, and so do the settings and what is remembered.
    ///
    /// Beside a policy that is trained, fresh critics and a first temperature of 1 (the paper's) undo it before they have
    /// learned anything: what the actor follows is then its own entropy and noise.
    ///
    /// # Errors
    /// A learner of another problem, other features or other widths.
    pub fn warm_start_critics(&mut self, other: &Learner) -> Result<(), LearnerError> {
        let (frame, others) = (&self.shared.frame, &other.shared.frame);
        if frame.shape != others.shape {
            return Err(SettingsError { key: "shape", rule: "must be that of the learner it begins from" }.into());
        }
        if frame.features != others.features {
            return Err(NetworkError::Features.into());
        }
        let (found, expected) = (others.critic_widths(), frame.critic_widths());
        if found != expected {
            return Err(NetworkError::Widths { found, expected }.into());
        }
        let others: Vec<_> = other.shared.critics.iter().map(read).collect();
        for pair in &self.shared.critics {
            let mut pair = write(pair);
            for (c, part) in pair.iter_mut().enumerate() {
                for kind in OF_A_CRITIC {
                    let layers = gather(others.iter().map(|other| &other[c]), kind);
                    part.iter_mut().zip(&layers).for_each(|(slab, layer)| slab.read_from(kind, layer));
                }
                part.iter_mut().for_each(crate::parameters::Slab::forget_moments);
            }
        }
        let log = read(&other.shared.temperature).log;
        *write(&self.shared.temperature) = Temperature { log, mean: 0.0, square: 0.0 };
        Ok(())
    }
}
