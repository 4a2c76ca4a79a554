//! `controller live`: a running daemon watched from beside, by a process of its own.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::Args;
use controller::config::{Config, Control};
use controller::operator::notice::fault_name;
use controller::state::State;
use flight::CodeNames;
use live::{Hub, Server};

use super::Failure;
use super::console::{say, tell};

/// A page, a Prometheus endpoint and a Foxglove websocket, from a running daemon's stream.
///
/// A process of its own: whatever becomes of it, the daemon's tick never notices, and nothing that a viewer sends reaches
/// the daemon. It waits for a daemon that is not there yet and goes on with the next one when that ends. In a browser:
/// http://127.0.0.1:8050/; Prometheus: /metrics; Foxglove, Lichtblick, PlotJuggler: ws://127.0.0.1:8050, layout at
/// /layout.json.
#[derive(Debug, Args)]
#[command(after_help = "Example:
  controller live --config controller.toml

Example for everyone who reaches this machine:
  controller live --listen 0.0.0.0:8050 --config controller.toml")]
pub(crate) struct LiveArgs {
    /// Address at which viewers connect; loopback unless told otherwise, for it has neither passwords nor encryption
    #[arg(long, default_value = "127.0.0.1:8050", value_name = "ADDR")]
    listen: String,
    /// The daemon's configuration file, to find its socket
    #[arg(long, value_name = "FILE", conflicts_with = "socket")]
    config: Option<PathBuf>,
    /// The daemon's operator socket; its stream is beside it [default: controller.sock here]
    #[arg(long, value_name = "PATH")]
    socket: Option<PathBuf>,
}

impl LiveArgs {
    pub(super) fn run(self) -> Result<(), Failure> {
        let control = match (self.socket, &self.config) {
            (Some(socket), _) => socket,
            (None, Some(config)) => Config::read(config)?.control.socket,
            (None, None) => Control::default().socket,
        };
        let hub = Arc::new(Hub::new(CodeNames { state: State::name, fault: fault_name }));
        let server = Server::bind(&self.listen, Arc::clone(&hub)).map_err(Failure::input)?;
        let address = server.local_addr().map_err(Failure::work)?;
        let stop = Arc::new(AtomicBool::new(false));
        for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
            signal_hook::flag::register(signal, Arc::clone(&stop)).map_err(Failure::work)?;
        }
        let socket = live::source::live_socket(&control);
        say(format_args!("http://{address}/  (Prometheus: /metrics, Foxglove: ws://{address})"));
        if !server.is_loopback() {
            tell("everyone who reaches that address can read along; nobody can change anything");
        }
        let (to, stopped) = (Arc::clone(&hub), Arc::clone(&stop));
        let source = std::thread::Builder::new()
            .name("source".to_owned())
            .spawn(move || live::source::follow(&socket, &to, &stopped, |line| tell(line)))
            .map_err(Failure::work)?;
        server.run(&stop);
        let _ = source.join();
        Ok(())
    }
}
