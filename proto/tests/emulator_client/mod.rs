//! A small daemon by hand and a first-order rig, for the tests of the emulator on real sockets.

// Each test program uses its own part of this.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::io::Write;
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

use proto::emulator::{EmulatedPlant, Emulator, EmulatorConfig, EmulatorHandle, FaultScript, Pace};
use proto::wire::{Bye, Command, Frame, FrameReader, Hello, Mode, Sense, SequenceCounter};

pub const SESSION: u32 = 0xC0FF_EE01;

/// Each pressure goes to `top × (1 − duty)` with its time constant, or to 0 without the pump.
#[derive(Debug, Clone, Default)]
pub struct FirstOrderRig {
    pub kpa: [f64; 2],
}

impl FirstOrderRig {
    pub const TOP_KPA: [f64; 2] = [200.0, -90.0];
    pub const TAU_S: f64 = 0.25;
}

impl EmulatedPlant for FirstOrderRig {
    fn tick(&mut self, duty: [f64; 2], pump_on: bool) {
        let stay = (-0.02 / Self::TAU_S).exp();
        for ((kpa, duty), top) in self.kpa.iter_mut().zip(duty).zip(Self::TOP_KPA) {
            let target = if pump_on { top * (1.0 - duty) } else { 0.0 };
            *kpa = target + (*kpa - target) * stay;
        }
    }

    fn pressures_gauge_kpa(&self) -> [f64; 2] {
        self.kpa
    }
}

/// Lockstep without noise; tests change what they need.
pub fn lockstep() -> EmulatorConfig {
    EmulatorConfig { pace: Pace::LOCKSTEP, noise_v_rms: 0.0, ..EmulatorConfig::default() }
}

pub fn real_time() -> EmulatorConfig {
    EmulatorConfig { pace: Pace::RealTime, ..lockstep() }
}

pub fn with_faults(config: EmulatorConfig, toml: &str) -> EmulatorConfig {
    EmulatorConfig { faults: FaultScript::from_toml(toml, "test.toml").unwrap(), ..config }
}

pub fn start(config: EmulatorConfig) -> EmulatorHandle {
    Emulator::bind("127.0.0.1:0", config, Box::new(FirstOrderRig::default())).unwrap().start().unwrap()
}

/// Finding of a read where no frame came.
#[derive(Debug, PartialEq)]
pub enum Nothing {
    Closed,
    Silence,
    Damaged,
}

pub struct Client {
    pub stream: TcpStream,
    pub reader: FrameReader,
    pub sequence: SequenceCounter,
    pub session: u32,
}

impl Client {
    pub fn connect(address: SocketAddr) -> Self {
        let stream = TcpStream::connect(address).unwrap();
        stream.set_nodelay(true).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        Self { stream, reader: FrameReader::new(), sequence: SequenceCounter::new(), session: SESSION }
    }

    /// Connects and shakes hands.
    pub fn open(address: SocketAddr) -> Self {
        Self::open_session(address, SESSION)
    }

    pub fn open_session(address: SocketAddr, session: u32) -> Self {
        let mut client = Self::connect(address);
        client.session = session;
        let answer = client.shake();
        assert_eq!(answer.session, session);
        client
    }

    /// Sends HELLO and takes the answer.
    pub fn shake(&mut self) -> Hello {
        let hello = Hello::new(self.sequence.advance(), 1, self.session, "test client");
        self.send(&hello.encode());
        match self.frame().unwrap() {
            Frame::Hello(answer) => answer,
            other => panic!("no HELLO but {other:?}"),
        }
    }

    pub fn send(&mut self, bytes: &[u8]) {
        assert_eq!(self.stream.write(bytes).unwrap(), bytes.len());
    }

    /// The next frame, waiting up to 5 s (or what the stream's read timeout says).
    pub fn frame(&mut self) -> Result<Frame, Nothing> {
        loop {
            match self.reader.next_frame() {
                Ok(Some(received)) => return Ok(received.frame),
                Ok(None) => {}
                Err(_) => return Err(Nothing::Damaged),
            }
            match self.reader.read_from(&mut self.stream) {
                Ok(0) => return Err(Nothing::Closed),
                Ok(_) => {}
                Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => return Err(Nothing::Silence),
                Err(_) => return Err(Nothing::Closed),
            }
        }
    }

    pub fn sense(&mut self) -> Sense {
        match self.frame() {
            Ok(Frame::Sense(sense)) => sense,
            other => panic!("no SENSE but {other:?}"),
        }
    }

    pub fn bye(&mut self) -> Bye {
        loop {
            match self.frame() {
                Ok(Frame::Bye(bye)) => return bye,
                Ok(Frame::Sense(_)) => {}
                other => panic!("no BYE but {other:?}"),
            }
        }
    }

    /// A sound COMMAND in mode run that answers this tick.
    pub fn run_command(&mut self, tick: u32, duty: [f32; 2]) -> Command {
        Command {
            sequence: self.sequence.advance(),
            clock_ns: 1,
            session: self.session,
            tick,
            duty,
            mode: Mode::Run,
            ttl_ticks: 2,
            digital_outputs: Command::PUMP_ON,
        }
    }

    pub fn run(&mut self, tick: u32, duty: [f32; 2]) -> Command {
        let command = self.run_command(tick, duty);
        self.send(&command.encode());
        command
    }
}
