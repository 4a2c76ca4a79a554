//! A daemon that holds pressures on a rig behind a cRIO that a test can spoil tick by tick.
//!
//! In lockstep, so that nothing hangs on how busy the machine is. Everything here fails by panicking with what the daemon said.

use std::path::PathBuf;
use std::process::Command;
use std::time::{Duration, Instant};

use controller::operator::socket::{Ask, ask};
use controller::state::State;
use model::rig::Rig;
use proto::wire::{Mode, Sense};

use crate::Stream::Err;
use crate::coarse_rigs::{believed, coarse};
use crate::raw_crio::{Answer, RawCrio};
use crate::{Folder, RunStatus, Running, finish, program};

/// Time that anything may take on a machine that does other things as well.
pub const SOON: Duration = Duration::from_secs(60);
/// Ticks under control before anything is spoilt: 3.4 s, the soft start is over.
pub const UNDER_CONTROL: u32 = 170;
/// Time that a state may take to be shown; below the time after which a silent cRIO counts as gone in lockstep.
const SHOWN_WITHIN: Duration = Duration::from_secs(3);

/// Further lines of the rig `dual_pressure`: a leak through which it gets to some 60 kPa and no further, so that the fallback takes over
/// where 90 are asked for.
pub const LEAK: &str =
    "\n[[mechanisms]]\nid = \"chamber_leak\"\ncomponent = \"positive\"\nconductance_kg_per_s_pa2 = 5e-14\n";

/// A daemon, its cRIO, and the folder that both live in.
pub struct Scene {
    /// The cRIO.
    pub crio: RawCrio,
    /// The daemon.
    pub daemon: Running,
    /// File of its configuration.
    pub config: PathBuf,
    /// Place where all of it lies.
    pub folder: Folder,
}

impl Scene {
    /// A daemon that holds 90/−70 kPa on a built-in rig and arms itself.
    pub fn start(rig: &str, more: &str) -> Self {
        Scene::on(&coarse(rig), &format!("control.auto_arm = true\n{more}"))
    }

    /// A daemon that holds 90/−70 kPa on a rig; further lines of its configuration, as `table.key = value`. What it believes of the rig is
    /// `dual_pressure` ([`coarse`]) unless they say another; the rig's own file lies beside, as `rig.toml`.
    ///
    /// # Panics
    /// If the rig is not sound, or no session comes.
    pub fn on(rig: &Rig, more: &str) -> Self {
        Scene::paced(rig, "lockstep", more)
    }

    /// Scene in real time, where the test has to keep it; without the rights that this asks for.
    ///
    /// # Panics
    /// As [`Scene::on`].
    pub fn in_real_time(rig: &Rig, more: &str) -> Self {
        Scene::paced(rig, "realtime", &format!("realtime.enforce = false\n{more}"))
    }

    fn paced(rig: &Rig, pacing: &str, more: &str) -> Self {
        let crio = RawCrio::with_rig(rig);
        let folder = Folder::new();
        folder.write("hold.csv", "time_s,ref_pos_kpa,ref_neg_kpa\n0,90,-70\n1,90,-70\n");
        folder.write("rig.toml", rig.to_toml().expect("a rig that can be written"));
        let believed = believed(&folder, more);
        let config = folder.write(
            "controller.toml",
            format!(
                "{believed}link.address = \"{}\"\nlink.pacing = \"{pacing}\"\npolicy.active = \"fallback\"\n\
                 reference.file = \"hold.csv\"\nrecord.directory = \"runs\"\ncontrol.socket = \"s\"\n{more}\n",
                crio.address()
            ),
        );
        let daemon = Running::start(Command::new(program("controller")).args(["run", "--config"]).arg(&config));
        let mut scene = Scene { crio, daemon, config, folder };
        scene.crio.open();
        scene
    }

    /// Scene that is armed and settled.
    pub fn under_control(rig: &str) -> Self {
        let mut scene = Scene::start(rig, "");
        scene.control(UNDER_CONTROL);
        scene
    }

    /// Steps until so many ticks in a row were answered with duties.
    ///
    /// # Panics
    /// If that does not come.
    pub fn control(&mut self, ticks: u32) {
        let mut run = 0;
        for _ in 0..ticks + 200 {
            run = if self.step() == Some(Mode::Run) { run + 1 } else { 0 };
            if run == ticks {
                return;
            }
        }
        panic!("not under control: {}", self.daemon.said(Err));
    }

    /// A sound step; the mode that was answered.
    pub fn step(&mut self) -> Option<Mode> {
        self.spoilt(|_| ())
    }

    /// A step whose SENSE is spoilt on its way; the mode that was answered.
    ///
    /// # Panics
    /// If vents are commanded that are not open.
    pub fn spoilt(&mut self, spoil: impl FnOnce(&mut Sense)) -> Option<Mode> {
        match self.crio.step(spoil) {
            Answer::Command(command) => {
                // Whatever is wrong, vented means open.
                if command.mode == Mode::Vent {
                    assert_eq!((command.duty, command.digital_outputs), ([1.0, 1.0], 0));
                }
                Some(command.mode)
            }
            _ => None,
        }
    }

    /// Ticks of a fault until the vents are commanded open.
    ///
    /// # Panics
    /// If they are not.
    pub fn ticks_to_vent(&mut self, most: u32, mut spoil: impl FnMut(u32, &mut Sense)) -> u32 {
        for tick in 0..most {
            if self.spoilt(|sense| spoil(tick, sense)) == Some(Mode::Vent) {
                return tick;
            }
        }
        panic!("not vented within {most} ticks: {}", self.daemon.said(Err));
    }

    /// The state that the daemon shows; without a frame nothing changes it, so it is waited for a little.
    ///
    /// # Panics
    /// If it does not come.
    pub fn wait_for_state(&self, wanted: State) {
        let socket = self.folder.join("s");
        let until = Instant::now() + SHOWN_WITHIN;
        loop {
            let shown = ask(&socket, &Ask::Status {}).map(|reply| reply.state);
            if matches!(shown, Ok(state) if state == wanted) {
                return;
            }
            assert!(Instant::now() < until, "{shown:?} instead of {wanted:?}: {}", self.daemon.said(Err));
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Asks with a command of the program.
    pub fn ask(&self, question: &str) -> RunStatus {
        finish(Command::new(program("controller")).args([question, "--config"]).arg(&self.config))
    }

    /// Asks while the cRIO goes on: requests are answered by the tick.
    pub fn ask_while_stepping(&mut self, question: &str) -> RunStatus {
        let asking = Running::start(Command::new(program("controller")).args([question, "--config"]).arg(&self.config));
        for _ in 0..100 {
            self.step();
            std::thread::sleep(Duration::from_millis(2));
        }
        asking.wait(SOON)
    }

    /// Asks something that takes its time; the cRIO goes on until it is answered.
    pub fn ask_at_length(&mut self, arguments: &[&str]) -> RunStatus {
        let mut command = Command::new(program("controller"));
        let asking = std::thread::spawn({
            command.args(arguments).arg("--config").arg(&self.config);
            move || finish(&mut command)
        });
        while !asking.is_finished() {
            self.step();
            std::thread::sleep(Duration::from_millis(1));
        }
        asking.join().unwrap()
    }

    /// Goes on until `status` has a line that begins so.
    ///
    /// # Panics
    /// If that does not come.
    pub fn wait_for_status(&mut self, words: &str, what: &str) {
        let mut last = None;
        for _ in 0..50 {
            let status = self.ask_while_stepping("status");
            if status.stdout.lines().any(|line| line.starts_with(words)) {
                return;
            }
            last = Some(status);
        }
        panic!("`{words}` is not {what}: {last:?}");
    }

    /// Waits until it has said this.
    pub fn told(&self, words: &str) {
        self.daemon.line(Err, words, SOON);
    }

    /// Holds that it has not said this.
    ///
    /// # Panics
    /// If it has.
    pub fn silent_about(&self, words: &str) {
        let said = self.daemon.said(Err);
        assert!(!said.contains(words), "`{words}` in: {said}");
    }

    /// Ends the daemon; what it said.
    ///
    /// # Panics
    /// If it does not end well.
    pub fn end(self) -> String {
        self.daemon.terminate();
        let Scene { mut crio, daemon, folder, .. } = self;
        // It may wait for a frame.
        for _ in 0..3 {
            if let Some(sense) = crio.sense() {
                crio.write(&sense.encode());
            }
        }
        let ended = daemon.wait(SOON);
        assert_eq!(ended.status, Some(0), "{ended:?}");
        drop(folder);
        ended.stderr
    }

    /// Waits for a person: never armed again by itself, and refused to who arms without having acknowledged.
    ///
    /// # Panics
    /// If it is armed.
    pub fn check_waits_for_a_person(&mut self) {
        self.check_latched();
        let refused = self.ask_while_stepping("arm");
        assert!(refused.status == Some(1) && refused.stderr.contains("acknowledge"), "{refused:?}");
    }

    /// Never armed again by itself, however long all is sound.
    ///
    /// # Panics
    /// If it is.
    pub fn check_latched(&mut self) {
        for _ in 0..300 {
            assert_eq!(self.step(), Some(Mode::Vent), "armed again by itself: {}", self.daemon.said(Err));
        }
    }
}
