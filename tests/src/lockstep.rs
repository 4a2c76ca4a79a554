//! A cycle flown in lockstep on an emulated rig: no socket, no thread, no clock, as fast as it computes.

use controller::cycle::Cycle;
use controller::cycle::duty_source::{ActuatorCommand, DutySource};
use controller::cycle::running_source::RunningSource;
use controller::operator::notice::Notice;
use model::rig::Rig;
use proto::emulator::{Crio, EmulatedPlant, SensorFault, Sensors, rig_and_crio};
use proto::recording::TickRecord;
use proto::wire::{Command, Hello, Sense, TICK_NS, TripBits};

/// Results of a tick.
#[derive(Debug, Clone, PartialEq)]
pub struct Flown {
    /// Command that was sent.
    pub command: ActuatorCommand,
    /// Notices of the tick.
    pub told: Vec<Notice>,
}

/// A cRIO, the rig behind it and the daemon's cycle.
pub struct Flight<H = RunningSource> {
    /// The cycle.
    pub cycle: Cycle<H>,
    crio: Crio,
    plant: Box<dyn EmulatedPlant>,
    sensors: Sensors,
    session: u32,
    sequence: u32,
    /// Ticks since the start.
    pub ticks: u64,
    /// Faults of the two sensors.
    pub faults: [Vec<SensorFault>; 2],
}

impl<H: DutySource> Flight<H> {
    /// A rig at rest and a session that has just been opened; `seed` is the converter's noise.
    ///
    /// # Panics
    /// If the rig cannot stand behind a cRIO.
    pub fn new(rig: &Rig, cycle: Cycle<H>, seed: u64) -> Self {
        let (plant, config) = rig_and_crio(rig).expect("a sound rig");
        let sensors = Sensors::new(config.scales, Sensors::ADC_NOISE_V_RMS, seed);
        let mut flight = Flight {
            cycle,
            crio: Crio::new(config),
            plant: Box::new(plant),
            sensors,
            session: 0,
            sequence: 0,
            ticks: 0,
            faults: [Vec::new(), Vec::new()],
        };
        flight.open();
        flight
    }

    /// Another converter's noise, in V root mean square.
    ///
    /// # Panics
    /// If the rig cannot stand behind a cRIO.
    #[must_use]
    pub fn with_noise(self, rig: &Rig, noise_v_rms: f64, seed: u64) -> Self {
        let (_, config) = rig_and_crio(rig).expect("a sound rig");
        Flight { sensors: Sensors::new(config.scales, noise_v_rms, seed), ..self }
    }

    /// Opens a new session, as after a lost link.
    ///
    /// # Panics
    /// If the cRIO refuses the HELLO, which it has no reason for.
    pub fn open(&mut self) {
        (self.session, self.sequence) = (self.session + 1, self.sequence + 1);
        let hello = Hello::new(self.sequence, self.clock_ns(), self.session, "lockstep");
        self.crio.hello(&hello, self.sequence, self.clock_ns()).expect("a HELLO that fits");
        self.cycle.session_opened();
    }

    /// Readings of the sensors without noise or fault, kPa gauge.
    pub fn true_kpa(&self) -> [f64; 2] {
        self.plant.pressures_gauge_kpa()
    }

    /// Duties that the cRIO applies now.
    pub fn applied(&self) -> [f32; 2] {
        self.crio.actuation().duty
    }

    /// Trips the cRIO, as its operator's button does.
    pub fn trip(&mut self, bits: TripBits) {
        self.crio.trip(bits);
    }

    /// A tick whose frame and command both arrive.
    pub fn step(&mut self) -> Flown {
        self.spoilt(|_| ())
    }

    /// A tick whose frame is spoilt on its way.
    ///
    /// # Panics
    /// Without a session.
    pub fn spoilt(&mut self, spoil: impl FnOnce(&mut Sense)) -> Flown {
        let mut sense = self.edge().expect("a session");
        spoil(&mut sense);
        let flown = self.answer(&sense);
        self.take(sense.tick, &flown.command);
        self.advance();
        flown
    }

    fn answer(&mut self, sense: &Sense) -> Flown {
        let (mut record, mut told) = (TickRecord::default(), Vec::new());
        self.cycle.observe(sense, &mut record, &mut |notice| told.push(notice));
        self.cycle.predict(&mut record);
        let command = self.cycle.decide(&mut record, &mut |notice| told.push(notice));
        self.settle();
        Flown { command, told }
    }

    /// A tick whose frame arrives and whose command is lost.
    pub fn unheard(&mut self) -> Flown {
        let mut flown = Flown { command: ActuatorCommand::VENT, told: Vec::new() };
        if let Some(sense) = self.edge() {
            flown = self.answer(&sense);
        }
        self.advance();
        flown
    }

    /// A tick whose frame is lost; the answer to it arrives.
    pub fn missing(&mut self) -> Flown {
        let sense = self.edge();
        let (mut record, mut told) = (TickRecord::default(), Vec::new());
        let command = self.cycle.frame_missing(26.0, &mut record, &mut |notice| told.push(notice));
        self.settle();
        if let Some(sense) = sense {
            self.take(sense.tick, &command);
        }
        self.advance();
        Flown { command, told }
    }

    /// A tick in which nothing goes through: the cRIO samples alone, the daemon waits in vain.
    pub fn cut(&mut self) -> Flown {
        let _ = self.edge();
        let (mut record, mut told) = (TickRecord::default(), Vec::new());
        let command = self.cycle.frame_missing(26.0, &mut record, &mut |notice| told.push(notice));
        self.settle();
        self.advance();
        Flown { command, told }
    }

    fn edge(&mut self) -> Option<Sense> {
        let volts = self.sensors.sample(self.true_kpa(), [&self.faults[0], &self.faults[1]]);
        self.sequence += 1;
        self.crio.edge(volts, self.sequence, self.clock_ns())
    }

    fn settle(&mut self) {
        self.sequence += 1;
        self.cycle.sent(self.sequence);
        self.cycle.settle();
    }

    /// The cRIO takes a command, as the wire carries it: in single precision.
    fn take(&mut self, tick: u32, command: &ActuatorCommand) {
        // One that is tripped takes none; that is its business.
        let _ = self.crio.command(&Command {
            sequence: self.sequence,
            clock_ns: self.clock_ns(),
            session: self.session,
            tick,
            duty: command.duty.map(|duty| duty as f32),
            mode: command.mode,
            ttl_ticks: proto::wire::DEFAULT_TTL_TICKS,
            digital_outputs: if command.pump_on { Command::PUMP_ON } else { 0 },
        });
    }

    fn advance(&mut self) {
        let actuation = self.crio.actuation();
        self.plant.tick(actuation.duty.map(f64::from), actuation.pump_on);
        self.ticks += 1;
    }

    fn clock_ns(&self) -> u64 {
        1_000_000 + self.ticks * TICK_NS
    }
}
