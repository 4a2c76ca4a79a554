//! A run watched live, by a process of its own: whatever happens here never touches the tick.
//!
//! ```text
//!  daemon, off its tick          this process
//!  controller.live.sock ──────►  source ──► hub ──┬─► GET /          a page that moves
//!  (ticks, events, state, one way)                ├─► GET /events    server-sent events behind it
//!                                                 ├─► GET /metrics   Prometheus
//!                                                 └─► websocket      Foxglove, Lichtblick, PlotJuggler
//! ```
//!
//! | module | subject |
//! | --- | --- |
//! | [`source`] | the daemon's stream, connected again and again |
//! | [`hub`] | what is known now, and who waits for more |
//! | [`server`] | connections, one thread each, a bounded number |
//! | `places` | who has a place, and who gives it up |
//! | `deadline` | a time within which something must be read or written |
//! | `http` | the little of HTTP/1.1 that this needs |
//! | `websocket` | RFC 6455: handshake and frames |
//! | `foxglove` | the Foxglove websocket protocol |
//! | `metrics` | the Prometheus text format |
//! | `state_json` | what the page is sent |
//!
//! Read-only: nothing that a viewer sends reaches the daemon. Not encrypted and without passwords, hence loopback
//! unless an address is given.

mod deadline;
mod foxglove;
mod http;
pub mod hub;
mod metrics;
mod places;
pub mod server;
pub mod source;
mod state_json;
mod websocket;

pub use hub::Hub;
pub use server::{LiveError, Server};
