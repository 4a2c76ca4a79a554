//! Orders to the tick, each kept where the run is recorded before the next one is given.

use std::sync::{Arc, Mutex};

use handover::{Candidate, Command, Haste, StoreEnd};
use proto::recording::TickOrder;

use crate::board::Board;
use crate::flying::Asked;
use crate::locked;

/// Keeps an order with the bytes of the policy it speaks of.
pub type KeepOrder = Box<dyn FnMut(&TickOrder, Option<&Arc<[u8]>>) + Send>;

/// An order, with what is kept of it.
pub(crate) struct Order {
    command: Command,
    asked: Asked,
    kept: TickOrder,
    bytes: Option<Arc<[u8]>>,
}

impl Order {
    /// To try a policy; `file` holds its SHA-256 and bytes, nothing for the fallback.
    pub(crate) fn to_try(candidate: Box<Candidate>, haste: Haste, file: Option<(String, Arc<[u8]>)>) -> Self {
        let (sha256, bytes) = file.unzip();
        let kept = match haste {
            Haste::Proving => TickOrder::Prove { sha256 },
            Haste::Straight => TickOrder::Resume { sha256 },
        };
        let asked = Asked::Try(candidate.tag);
        Order { command: Command::Try(candidate, haste), asked, kept, bytes }
    }

    /// To go back.
    pub(crate) fn to_go_back() -> Self {
        Order { command: Command::Rollback, asked: Asked::Rollback, kept: TickOrder::Rollback, bytes: None }
    }
}

/// The way of orders into the tick; cheap to clone.
#[derive(Clone)]
pub(crate) struct Orders {
    end: StoreEnd,
    /// Locked from giving an order until it is kept, so that they are kept in the order in which the tick takes them.
    giving: Arc<Mutex<Giving>>,
}

struct Giving {
    keep: KeepOrder,
    /// Number of the last order.
    last: u32,
}

impl Orders {
    pub(crate) fn new(end: StoreEnd, keep: KeepOrder) -> Self {
        Orders { end, giving: Arc::new(Mutex::new(Giving { keep, last: 0 })) }
    }

    /// Gives the order that `decide` makes of what flies and what is asked for already; its number.
    ///
    /// # Errors
    /// Those of `decide`, or too many orders wait.
    pub(crate) fn give(
        &self,
        board: &Mutex<Board>,
        decide: impl FnOnce(&mut Board) -> Result<Order, String>,
    ) -> Result<u32, String> {
        let mut giving = locked(&self.giving);
        self.end.sweep();
        let number = giving.last.wrapping_add(1);
        let (kept, bytes) = {
            let mut board = locked(board);
            let Order { command, asked, kept, bytes } = decide(&mut board)?;
            self.end.ask(command).map_err(|_| "too many requests wait; is the cRIO there?".to_owned())?;
            board.given(number, asked);
            (kept, bytes)
        };
        giving.last = number;
        (giving.keep)(&kept, bytes.as_ref());
        Ok(number)
    }
}
