//! Messages of the daemon to a service manager: ready, alive with every tick, stopping.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::os::unix::net::UnixDatagram;
use std::time::{Duration, Instant};

use model::rig::Rig;
use proto::emulator::{Emulator, EmulatorConfig, Pace, rig_and_crio};

mod process;
use process::{Folder, Running, SOON, alone, controller, without_real_time_rights};

/// Messages that are heard within this time.
fn heard(socket: &UnixDatagram, time: Duration) -> Vec<String> {
    let until = Instant::now() + time;
    let mut heard = Vec::new();
    let mut bytes = [0; 256];
    while Instant::now() < until {
        socket.set_read_timeout(Some(Duration::from_millis(50))).unwrap();
        if let Ok(length) = socket.recv(&mut bytes) {
            heard.push(String::from_utf8_lossy(&bytes[..length]).into_owned());
        }
    }
    heard
}

#[test]
fn a_service_manager_hears_that_it_is_ready_alive_and_stopping() {
    let _alone = alone();
    for (pacing, pace) in [("realtime", Pace::RealTime), ("lockstep", Pace::LOCKSTEP)] {
        let (behind, crio) = rig_and_crio(&Rig::builtin("dual_pressure").unwrap()).unwrap();
        let config = EmulatorConfig { crio, pace, ..EmulatorConfig::default() };
        let rig = Emulator::bind("127.0.0.1:0", config, Box::new(behind)).and_then(Emulator::start).unwrap();
        let folder = Folder::new();
        let text = format!(
            "[link]\naddress = \"{}\"\npacing = \"{pacing}\"\n[control]\nsocket = \"s\"\n[realtime]\nenforce = false\n\
             [record]\ndirectory = \"r\"\nmin_free_mib = 16\n",
            rig.local_addr()
        );
        let config = folder.write("controller.toml", text);
        let socket = UnixDatagram::bind(folder.join("n")).unwrap();
        let mut command = controller(&["run", "--config"], &config);
        let daemon = Running::start(command.env("NOTIFY_SOCKET", folder.join("n")));
        daemon.line("opened");
        let said = heard(&socket, Duration::from_secs(2));
        assert_eq!(said.iter().filter(|word| *word == "READY=1").count(), 1, "{pacing}: {said:?}");
        let alive = said.iter().filter(|word| *word == "WATCHDOG=1").count();
        assert!(alive >= 4, "{pacing}: {said:?}");
        daemon.signal("TERM");
        let until = Instant::now() + SOON;
        let mut last = Vec::new();
        while !last.iter().any(|word| word == "STOPPING=1") {
            assert!(Instant::now() < until, "{pacing}: it did not say that it stops: {last:?}");
            last.extend(heard(&socket, Duration::from_millis(100)));
        }
        let ended = daemon.wait();
        assert_eq!(ended.status, Some(0), "{pacing}: {ended:?}");
        rig.stop();
        rig.join().unwrap();
    }
}

/// A daemon that stands still no longer beats; systemd ends it after `WatchdogSec`.
#[test]
fn a_daemon_that_stands_still_is_not_alive() {
    let _alone = alone();
    let folder = Folder::new();
    let text = "[link]\naddress = \"127.0.0.1:9\"\n[control]\nsocket = \"s\"\n[realtime]\nenforce = false\n[record]\ndirectory = \"r\"\n";
    let config = folder.write("controller.toml", text);
    let socket = UnixDatagram::bind(folder.join("n")).unwrap();
    let mut command = controller(&["run", "--config"], &config);
    let daemon = Running::start(command.env("NOTIFY_SOCKET", folder.join("n")));
    let until = Instant::now() + SOON;
    while !heard(&socket, Duration::from_millis(200)).iter().any(|word| word == "WATCHDOG=1") {
        assert!(Instant::now() < until, "it never was alive: {}", daemon.stderr());
    }
    daemon.signal("STOP");
    heard(&socket, Duration::from_millis(300));
    assert_eq!(heard(&socket, Duration::from_millis(700)), Vec::<String>::new());
    daemon.signal("CONT");
    daemon.signal("TERM");
    let ended = daemon.wait();
    assert!(ended.status.is_some(), "{ended:?}");
}

/// A user without real-time rights: the daemon starts and says which limit to raise, and nothing is armed.
#[test]
fn without_real_time_rights_nothing_is_armed() {
    let _alone = alone();
    let Some(mut command) = without_real_time_rights() else { return };
    let (behind, crio) = rig_and_crio(&Rig::builtin("dual_pressure").unwrap()).unwrap();
    let config = EmulatorConfig { crio, pace: Pace::RealTime, ..EmulatorConfig::default() };
    let rig = Emulator::bind("127.0.0.1:0", config, Box::new(behind)).and_then(Emulator::start).unwrap();
    let folder = Folder::new();
    let text = format!(
        "[link]\naddress = \"{}\"\n[control]\nsocket = \"s\"\n[record]\ndirectory = \"r\"\nmin_free_mib = 16\n",
        rig.local_addr()
    );
    let config = folder.write("controller.toml", text);
    command.arg(env!("CARGO_BIN_EXE_controller")).args(["run", "--config"]).arg(&config);
    let daemon = Running::start(&mut command);
    daemon.line("opened");
    std::thread::sleep(Duration::from_secs(1));
    let refused = process::finish(&mut controller(&["arm", "--config"], &config));
    // On a busy machine something else may stand in the way as well, and be named first.
    assert_eq!(refused.status, Some(1), "{refused:?} {}", daemon.stderr());
    let said = daemon.stderr();
    assert!(said.contains("NOTHING WILL BE ARMED") && said.contains("LimitRTPRIO"), "{said}");
    daemon.signal("TERM");
    assert_eq!(daemon.wait().status, Some(0));
    rig.stop();
    rig.join().unwrap();
}
