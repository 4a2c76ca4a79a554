//! Relay of the rig's pump: what an experiment may ask for, and where it begins, hangs on it.

use proto::emulator::CrioConfig;

/// The relay between the cRIO and the pump.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PumpRelay {
    /// There is one: the pump stops when it is told to, and rest is the atmosphere's pressure.
    Fitted,
    /// There is none: the pump goes on, and rest is a balance somewhere.
    #[default]
    Absent,
}

impl PumpRelay {
    /// The relay of a rig, as its cRIO knows it.
    pub fn of(crio: &CrioConfig) -> Self {
        if crio.pump_relay { PumpRelay::Fitted } else { PumpRelay::Absent }
    }
}
