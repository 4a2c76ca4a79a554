//! Orders to the tick, each kept where the run is recorded before the next one is given.

use std::sync::{Arc, Mutex};

use handover::{Candidate, Command, Haste, StoreEnd};
use proto::recording::TickOrder;

use crate::desk::locked;

/// Keeps an order with the bytes of the policy it speaks of.
pub type KeepOrder = Box<dyn FnMut(&TickOrder, Option<&Arc<[u8]>>) + Send>;

/// The way of orders into the tick; cheap to clone.
#[derive(Clone)]
pub(crate) struct Orders {
    end: StoreEnd,
    /// Locked from giving an order until it is kept, so that they are kept in the order in which the tick takes them.
    keep: Arc<Mutex<KeepOrder>>,
}

impl Orders {
    pub(crate) fn new(end: StoreEnd, keep: KeepOrder) -> Self {
        Orders { end, keep: Arc::new(Mutex::new(keep)) }
    }

    /// Has the tick try a policy; `file` holds its SHA-256 and bytes, nothing for the fallback.
    ///
    /// # Errors
    /// Too many orders wait.
    pub(crate) fn send(
        &self,
        candidate: Box<Candidate>,
        haste: Haste,
        file: Option<(String, Arc<[u8]>)>,
    ) -> Result<(), String> {
        let (sha256, bytes) = file.unzip();
        let order = match haste {
            Haste::Proving => TickOrder::Prove { sha256 },
            Haste::Straight => TickOrder::Resume { sha256 },
        };
        self.give(Command::Try(candidate, haste), &order, bytes.as_ref())
    }

    /// Has the tick go back.
    ///
    /// # Errors
    /// Too many orders wait.
    pub(crate) fn roll_back(&self) -> Result<(), String> {
        self.give(Command::Rollback, &TickOrder::Rollback, None)
    }

    fn give(&self, command: Command, order: &TickOrder, bytes: Option<&Arc<[u8]>>) -> Result<(), String> {
        let mut keep = locked(&self.keep);
        self.end.sweep();
        self.end.ask(command).map_err(|_| "too many requests wait; is the cRIO there?".to_owned())?;
        keep(order, bytes);
        Ok(())
    }
}
