//! The complete state as bytes: a learner goes on from them as if it had never stopped.
//!
//! ```text
//! magic (8)  version u32  body …  CRC-32 of everything before (u32)
//! ```
//! Little endian. The body holds shape, features, settings, counters, temperature, every number of every network,
//! layer by layer and row by row (so that it does not matter how many threads wrote or read it), and the filled part
//! of the replay. The noise needs no state but the counters.

use std::io::{self, Read, Write};

use crate::bytes::{Malformed, Sink, Source};
use crate::feature_map::{Feature, FeatureMap};
use crate::learner::{Learner, LearnerError, Machine};
use crate::network::{Dense, Network, NetworkError};
use crate::parameters::{Kind, gather};
use crate::settings::{Settings, SettingsError, Shape, TemperatureRule};
use crate::workers::{Temperature, read, write};

const LEARNER: &[u8; 8] = b"SACLEARN";
const CORE: &[u8; 8] = b"SACCORE1";
const POLICY: &[u8; 8] = b"SACPOLIC";
const VERSION: u32 = 1;

/// Why bytes are no checkpoint.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// The bytes could not be read or written.
    #[error("checkpoint: {0}")]
    Io(#[from] io::Error),
    /// Something else than a checkpoint, or another kind of one.
    #[error("not a {0} file: its first bytes are others")]
    Kind(&'static str),
    /// Written by another version.
    #[error("checkpoint has version {found}, this program reads {VERSION}; use the program that wrote it")]
    Version {
        /// The version it has.
        found: u32,
    },
    /// Cut short, changed, or contradicting itself.
    #[error("checkpoint is damaged ({0}); use an earlier one")]
    Damaged(&'static str),
    /// A learner could not be made of it.
    #[error(transparent)]
    Learner(#[from] LearnerError),
}

impl From<Malformed> for CheckpointError {
    fn from(malformed: Malformed) -> Self {
        match malformed {
            Malformed::Io(error) if error.kind() == io::ErrorKind::UnexpectedEof => Self::Damaged("it ends too early"),
            Malformed::Io(error) => Self::Io(error),
            Malformed::Size => Self::Damaged("a size is out of its range"),
            Malformed::Sum => Self::Damaged("its check sum is another"),
        }
    }
}

impl From<SettingsError> for CheckpointError {
    fn from(error: SettingsError) -> Self {
        Self::Learner(error.into())
    }
}

impl From<NetworkError> for CheckpointError {
    fn from(error: NetworkError) -> Self {
        Self::Learner(error.into())
    }
}

/// Largest number of items in a list, beyond which a size is damage.
const MOST: u64 = 1 << 26;
const KINDS: [Kind; 3] = [Kind::Value, Kind::Mean, Kind::Square];

impl Learner {
    /// The complete state; the filled part of the replay is most of it.
    pub fn save(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        // Writing to memory cannot fail.
        drop(self.save_to(&mut bytes));
        bytes
    }

    /// As [`Self::save`], without a second copy in memory.
    ///
    /// # Errors
    /// Whatever the writer says.
    pub fn save_to(&self, writer: impl Write) -> io::Result<()> {
        let mut sink = Sink::new(writer);
        sink.header(LEARNER, VERSION)?;
        self.write_core(&mut sink)?;
        sink.floats(read(&self.shared.replay).filled())?;
        sink.finish()
    }

    /// The state but for the replay's rows, of which only the number ever written is kept: small, and quick to save.
    /// Rows come out by [`Self::copy_replay_rows`] and go back in by [`Self::restore_replay_rows`].
    pub fn save_core(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut sink = Sink::new(&mut bytes);
        // Writing to memory cannot fail.
        drop(sink.header(CORE, VERSION).and_then(|()| self.write_core(&mut sink)).and_then(|()| sink.finish()));
        bytes
    }

    /// A learner of a core, and the number of rows that its replay had ever been given; the replay is empty until they
    /// are put back.
    ///
    /// # Errors
    /// Bytes that are no core, of another version or damaged.
    pub fn restore_core(bytes: &[u8], machine: Machine) -> Result<(Self, u64), CheckpointError> {
        let mut source = Source::new(bytes);
        check_header(&mut source, CORE, "learner")?;
        let read = Self::read_core(&mut source, machine)?;
        source.finish()?;
        Ok(read)
    }

    fn write_core<W: Write>(&self, sink: &mut Sink<W>) -> io::Result<()> {
        let frame = &self.shared.frame;
        write_shape(sink, &frame.shape)?;
        write_features(sink, &frame.features)?;
        write_settings(sink, &frame.settings)?;
        sink.u64(self.updates)?;
        sink.u64(self.explorations)?;
        sink.floats(&[self.smoothness.temporal, self.smoothness.spatial])?;
        let temperature = *read(&self.shared.temperature);
        sink.floats(&[temperature.log, temperature.mean, temperature.square])?;
        let actor: Vec<_> = self.shared.actor.iter().map(read).collect();
        for kind in KINDS {
            for layer in gather(actor.iter().map(|part| &**part), kind) {
                sink.floats(&layer.weights)?;
                sink.floats(&layer.bias)?;
            }
        }
        let critics: Vec<_> = self.shared.critics.iter().map(read).collect();
        for c in 0..2 {
            for kind in KINDS.into_iter().chain([Kind::Target]) {
                for layer in gather(critics.iter().map(|part| &part[c]), kind) {
                    sink.floats(&layer.weights)?;
                    sink.floats(&layer.bias)?;
                }
            }
        }
        sink.u64(read(&self.shared.replay).written())
    }

    /// A learner that goes on where these bytes were saved, on whatever machine.
    ///
    /// # Errors
    /// Bytes that are no checkpoint, of another version or damaged.
    pub fn restore(bytes: &[u8], machine: Machine) -> Result<Self, CheckpointError> {
        Self::restore_from(bytes, machine)
    }

    /// As [`Self::restore`], without a copy in memory.
    ///
    /// # Errors
    /// As there, and whatever the reader says.
    pub fn restore_from(reader: impl Read, machine: Machine) -> Result<Self, CheckpointError> {
        let mut source = Source::new(reader);
        check_header(&mut source, LEARNER, "learner")?;
        let (learner, written) = Self::read_core(&mut source, machine)?;
        source.floats(write(&learner.shared.replay).refill(written))?;
        source.finish()?;
        Ok(learner)
    }

    fn read_core<R: Read>(source: &mut Source<R>, machine: Machine) -> Result<(Self, u64), CheckpointError> {
        let shape = read_shape(source)?;
        let features = read_features(source)?;
        let settings = read_settings(source)?;
        let mut learner = Self::new(shape, features, settings, machine)?;
        learner.updates = source.u64()?;
        learner.explorations = source.u64()?;
        [learner.smoothness.temporal, learner.smoothness.spatial] = source.array()?;
        let [log, mean, square] = source.array()?;
        *write(&learner.shared.temperature) = Temperature { log, mean, square };
        let mut actor: Vec<_> = learner.shared.actor.iter().map(write).collect();
        for kind in KINDS {
            let layers = gather(actor.iter().map(|part| &**part), kind);
            for (l, mut layer) in layers.into_iter().enumerate() {
                source.floats(&mut layer.weights)?;
                source.floats(&mut layer.bias)?;
                actor.iter_mut().for_each(|part| part[l].read_from(kind, &layer));
            }
        }
        drop(actor);
        let mut critics: Vec<_> = learner.shared.critics.iter().map(write).collect();
        for c in 0..2 {
            for kind in KINDS.into_iter().chain([Kind::Target]) {
                let layers = gather(critics.iter().map(|part| &part[c]), kind);
                for (l, mut layer) in layers.into_iter().enumerate() {
                    source.floats(&mut layer.weights)?;
                    source.floats(&mut layer.bias)?;
                    critics.iter_mut().for_each(|part| part[c][l].read_from(kind, &layer));
                }
            }
        }
        drop(critics);
        let written = source.u64()?;
        Ok((learner, written))
    }
}

impl Network {
    /// The policy as a small file of its own.
    pub fn save(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut sink = Sink::new(&mut bytes);
        // Writing to memory cannot fail.
        drop(self.write_to(&mut sink));
        bytes
    }

    fn write_to(&self, sink: &mut Sink<&mut Vec<u8>>) -> io::Result<()> {
        sink.header(POLICY, VERSION)?;
        write_features(sink, &self.features)?;
        sink.u64(self.layers.len() as u64)?;
        sink.u64(u64::from(self.log_std.is_some()))?;
        for layer in self.layers.iter().chain(&self.log_std) {
            sink.u64(layer.inputs as u64)?;
            sink.u64(layer.outputs as u64)?;
            sink.floats(&layer.weights)?;
            sink.floats(&layer.bias)?;
        }
        sink.finish()
    }

    /// The policy of a file.
    ///
    /// # Errors
    /// Bytes that are no policy, of another version or damaged.
    pub fn restore(bytes: &[u8]) -> Result<Self, CheckpointError> {
        let mut source = Source::new(bytes);
        check_header(&mut source, POLICY, "policy")?;
        let features = read_features(&mut source)?;
        let depth = source.size(64)?;
        let with_log_std = source.size(1)? == 1;
        let mut layers = Vec::new();
        for _ in 0..depth + usize::from(with_log_std) {
            let (inputs, outputs) = (source.size(4096)?, source.size(4096)?);
            let (weights, bias) = (source.some_floats(inputs * outputs)?, source.some_floats(outputs)?);
            layers.push(Dense { inputs, outputs, weights, bias });
        }
        source.finish()?;
        let log_std = if with_log_std { layers.pop() } else { None };
        let network = Self { features, layers, log_std };
        network.check()?;
        Ok(network)
    }
}

fn check_header<R: Read>(source: &mut Source<R>, magic: &[u8; 8], kind: &'static str) -> Result<(), CheckpointError> {
    let (found, version) = source.header().map_err(|_| CheckpointError::Kind(kind))?;
    if &found != magic {
        return Err(CheckpointError::Kind(kind));
    }
    if version != VERSION {
        return Err(CheckpointError::Version { found: version });
    }
    Ok(())
}

fn write_shape<W: Write>(sink: &mut Sink<W>, shape: &Shape) -> io::Result<()> {
    [shape.observations, shape.goal.start, shape.goal.end, shape.actions].iter().try_for_each(|&n| sink.u64(n as u64))
}

fn read_shape<R: Read>(source: &mut Source<R>) -> Result<Shape, CheckpointError> {
    let [observations, start, end, actions] =
        [source.size(MOST)?, source.size(MOST)?, source.size(MOST)?, source.size(MOST)?];
    Ok(Shape { observations, goal: start..end, actions })
}

fn write_features<W: Write>(sink: &mut Sink<W>, map: &FeatureMap) -> io::Result<()> {
    sink.u64(map.observations() as u64)?;
    sink.u64(map.features().len() as u64)?;
    for feature in map.features() {
        sink.u64(feature.plus as u64)?;
        sink.u64(feature.minus.map_or(0, |m| m as u64 + 1))?;
        sink.floats(&[feature.offset, feature.scale])?;
    }
    Ok(())
}

fn read_features<R: Read>(source: &mut Source<R>) -> Result<FeatureMap, CheckpointError> {
    let (observations, count) = (source.size(MOST)?, source.size(4096)?);
    let mut features = Vec::new();
    for _ in 0..count {
        let (plus, minus) = (source.size(MOST)?, source.size(MOST)?);
        let [offset, scale] = source.array()?;
        features.push(Feature { plus, minus: minus.checked_sub(1), offset, scale });
    }
    Ok(FeatureMap::new(observations, features)?)
}

fn write_settings<W: Write>(sink: &mut Sink<W>, settings: &Settings) -> io::Result<()> {
    sink.u64(settings.hidden.len() as u64)?;
    settings.hidden.iter().try_for_each(|&width| sink.u64(width as u64))?;
    sink.u64(settings.batch as u64)?;
    sink.u64(settings.replay_capacity as u64)?;
    sink.u64(settings.seed)?;
    let (learned, temperature) = match settings.temperature {
        TemperatureRule::Learned(start) => (1, start),
        TemperatureRule::Fixed(value) => (0, value),
    };
    sink.u64(learned)?;
    sink.floats(&[
        temperature,
        settings.learning_rate,
        settings.discount,
        settings.soft_update,
        settings.lambda_temporal,
        settings.lambda_spatial,
        settings.target_entropy,
        settings.log_std[0],
        settings.log_std[1],
        settings.last_layer_scale,
        settings.initial_log_std,
    ])?;
    sink.u64(settings.spatial_sigma.len() as u64)?;
    sink.floats(&settings.spatial_sigma)
}

fn read_settings<R: Read>(source: &mut Source<R>) -> Result<Settings, CheckpointError> {
    let mut hidden = Vec::new();
    for _ in 0..source.size(64)? {
        hidden.push(source.size(MOST)?);
    }
    let (batch, replay_capacity) = (source.size(MOST)?, source.size(u64::from(u32::MAX))?);
    let seed = source.u64()?;
    let learned = source.size(1)? == 1;
    let [
        temperature,
        learning_rate,
        discount,
        soft_update,
        lambda_temporal,
        lambda_spatial,
        target_entropy,
        lowest,
        highest,
        last_layer_scale,
        initial_log_std,
    ] = source.array()?;
    let sigmas = source.size(4096)?;
    let spatial_sigma = source.some_floats(sigmas)?;
    let rule = if learned { TemperatureRule::Learned } else { TemperatureRule::Fixed };
    Ok(Settings {
        hidden,
        batch,
        learning_rate,
        discount,
        soft_update,
        lambda_temporal,
        lambda_spatial,
        spatial_sigma,
        target_entropy,
        temperature: rule(temperature),
        log_std: [lowest, highest],
        replay_capacity,
        seed,
        last_layer_scale,
        initial_log_std,
    })
}
