//! The observation contracts of [`model::ports`], in the words of the policy loader.

use model::observation::ObservationLayout;
use model::ports::{Port, Ports};
use policy::{Channel, PolicySignature};

/// All that this program flies, the paper's first.
pub fn offered() -> [PolicySignature; 2] {
    [ObservationLayout::Paper, ObservationLayout::Correction].map(contract)
}

fn contract(which: ObservationLayout) -> PolicySignature {
    let Ports { contract, rate_hz, inputs, outputs } = Ports::of(which);
    let channels = |ports: Vec<Port>| ports.into_iter().map(channel).collect();
    PolicySignature { version: contract, rate_hz, inputs: channels(inputs), outputs: channels(outputs) }
}

fn channel(port: Port) -> Channel {
    Channel { name: port.name, unit: port.unit.to_owned(), low: port.low, high: port.high }
}
