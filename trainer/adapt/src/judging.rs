//! Choice of the yardstick that all flights of an adaptation are judged by.

use proto::recording::TickRecord;
use proto::rig_file;

use crate::AdaptError;
use crate::guard::squares_by_second;
use crate::journal::{BEFORE, TickSpan};
use crate::programs::Console;
use crate::recorded;
use crate::run::Adaptation;
use crate::tracking::Tracking;
use crate::yardstick::{JUDGED_BEHIND_LATE_SENSORS, Yardstick};

/// Squares by late sensors; none where no sensor is late.
pub(crate) fn late_squares(ticks: &[TickRecord], start: u32, yardstick: &Yardstick) -> Vec<Option<f64>> {
    if yardstick.has_late_sensors() { squares_by_second(ticks, start, yardstick) } else { Vec::new() }
}

/// Figures of a run in words.
pub(crate) fn told(tracking: &Tracking) -> String {
    let [pos, neg] = tracking.judged_kpa();
    match tracking.late_rmse_kpa {
        None => format!("{pos:.3}/{neg:.3} kPa"),
        Some(_) => {
            let [pos_read, neg_read] = tracking.rmse_kpa;
            format!("{pos:.3}/{neg:.3} kPa (readings less reference: {pos_read:.3}/{neg_read:.3})")
        }
    }
}

impl Adaptation {
    /// Yardstick of the flight that is next: the found rig's, once the flight before has been judged by it.
    pub(crate) fn yardstick(&self) -> Result<Yardstick, AdaptError> {
        let is_judged_so = self.journal.flown(BEFORE).is_some_and(|before| before.late_rmse_kpa.is_some());
        if is_judged_so { self.yardstick_of_the_found_rig() } else { Ok(Yardstick::default()) }
    }

    fn yardstick_of_the_found_rig(&self) -> Result<Yardstick, AdaptError> {
        let path = self.found_rig();
        let rig = rig_file::load(&path.to_string_lossy())?;
        Ok(Yardstick::of(&rig))
    }

    /// Judges the flight before by the found rig's sensors as well, once the daemon has taken that rig and before another
    /// flight is compared with it. Where none of them is late, or that flight is no longer recorded, all flights are judged by
    /// their readings less the reference.
    pub(crate) fn judge_before_again(&mut self, console: &mut dyn Console) -> Result<(), AdaptError> {
        let yardstick = self.yardstick_of_the_found_rig()?;
        let is_compared_already = self.journal.flown.iter().any(|flown| flown.what != BEFORE);
        if !yardstick.has_late_sensors() || is_compared_already {
            return Ok(());
        }
        let Some(before) = self.journal.flown.iter_mut().find(|flown| flown.what == BEFORE) else { return Ok(()) };
        let judged = match before.recorded {
            Some(TickSpan { session, start, until }) => {
                let ticks = recorded::between(&self.folders.recordings, session, start..until)?;
                let tracking = Tracking::of(&ticks, &yardstick).filter(|again| again.ticks == before.tracking.ticks);
                tracking.map(|tracking| (tracking, late_squares(&ticks, start, &yardstick)))
            }
            None => None,
        };
        match judged {
            Some((tracking, squares)) => {
                (before.tracking, before.late_squares) = (tracking, squares);
                console.say(JUDGED_BEHIND_LATE_SENSORS);
                console.say(&format!("{BEFORE}: {}", told(&tracking)));
            }
            None => console.say(
                "the sensors of the model that was found show pressures late, but the run before is not recorded any more: all runs are judged by their readings less the reference, by which a chamber on the reference errs",
            ),
        }
        self.journal.keep(&self.out)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::journal::Flown;
    use crate::programs::Programs;
    use crate::recorded::RUN;
    use crate::run::{GoesOn, WITH_MODEL};
    use crate::settings::AdaptSettings;
    use model::observation::TICKS_PER_S;
    use proto::recording::{RecordingInfo, RecordingWriter};
    use std::path::PathBuf;
    use std::time::Duration;

    /// A console that keeps what is said, and stops everything once a file is there.
    #[derive(Default)]
    pub(crate) struct Said {
        lines: Vec<String>,
        stops_behind: Option<PathBuf>,
    }

    impl Said {
        /// One of an operator who stops everything once this file is there.
        pub(crate) fn stops_behind(file: PathBuf) -> Self {
            Said { stops_behind: Some(file), ..Said::default() }
        }
    }

    impl Console for Said {
        fn step(&mut self, _number: usize, _of: usize, _what: &str) {}
        fn command(&mut self, _command: &str) {}
        fn say(&mut self, text: &str) {
            self.lines.push(text.to_owned());
        }
        fn waiting(&mut self, _what: &str, _elapsed: Duration, _most: Option<Duration>) {}
        fn stop(&self) -> bool {
            self.stops_behind.as_ref().is_some_and(|file| file.exists())
        }
        fn ask(&mut self, _question: &str) -> bool {
            false
        }
    }

    pub(crate) const START: u32 = 700;
    pub(crate) const UNTIL: u32 = 2200;
    /// Rate of the reference in kPa/s, and the lag of the sensor in s.
    const RATE: f64 = 2.0;
    const LAG_S: f64 = 0.2;

    /// An adaptation that has flown before, with the reading on a reference that rises, and has found the rig `found`.
    pub(crate) fn flown_before(name: &str, found: &str) -> Adaptation {
        let folder = std::env::temp_dir().join(format!("adapt-judging-{}-{name}", std::process::id()));
        std::fs::create_dir_all(folder.join("recordings")).unwrap();
        std::fs::create_dir_all(folder.join("out/found")).unwrap();
        let mut writer =
            RecordingWriter::create(&folder.join("recordings/run-1.mcap"), &RecordingInfo::new("test", 0), &[])
                .unwrap();
        let ramp = |tick: u32| 70.0 + RATE * f64::from(tick) / TICKS_PER_S;
        let ticks: Vec<TickRecord> = (500..2500)
            .map(|tick| TickRecord {
                session: 5,
                tick,
                state: RUN,
                p_pos_kpa: ramp(tick),
                ref_pos_kpa: ramp(tick),
                p_neg_kpa: -70.0,
                ref_neg_kpa: -70.3,
                ..TickRecord::default()
            })
            .collect();
        ticks.iter().for_each(|tick| writer.write(tick).unwrap());
        writer.finish().unwrap();
        let config = folder.join("c.toml");
        std::fs::write(&config, "[link]\naddress = \"127.0.0.1:1\"\n").unwrap();
        let out = folder.join("out");
        std::fs::write(out.join("found/rig.toml"), format!("{}\n{found}", model::rig::DUAL_PRESSURE)).unwrap();
        let programs = Programs { controller: "controller".into(), trainer: "trainer".into() };
        let mut adaptation = Adaptation::begin(AdaptSettings::new(config), &out, programs, Box::new(GoesOn)).unwrap();
        let ticks = &ticks[(START - 500) as usize..(UNTIL - 500) as usize];
        let yardstick = Yardstick::default();
        adaptation.journal.found = Some(out.join("found"));
        adaptation.journal.flown.push(Flown {
            what: BEFORE.to_owned(),
            tracking: Tracking::of(ticks, &yardstick).unwrap(),
            rig_minutes: Some(0.5),
            recorded: Some(TickSpan { session: 5, start: START, until: UNTIL }),
            ended_after_s: None,
            squares: squares_by_second(ticks, START, &yardstick),
            late_squares: Vec::new(),
        });
        adaptation
    }

    pub(crate) fn forget(adaptation: &Adaptation) {
        std::fs::remove_dir_all(adaptation.out.parent().unwrap()).unwrap();
    }

    const LATE: &str = "[[mechanisms]]\nid = \"sensor_lag\"\ncomponent = \"sensor_pos\"\ntime_constant_ms = 200.0\n";

    /// With a late sensor the readings of a ramp are to be late by its lag; the other channel stays as it was.
    #[test]
    fn the_flight_before_is_judged_again_by_the_sensors_that_were_found() {
        let mut adaptation = flown_before("late", LATE);
        let mut console = Said::default();
        assert!(!adaptation.yardstick().unwrap().has_late_sensors(), "not before the daemon has taken the model");
        adaptation.judge_before_again(&mut console).unwrap();
        let before = adaptation.journal.flight(BEFORE).unwrap().clone();
        let [pos, neg] = before.tracking.judged_kpa();
        assert!((pos - RATE * LAG_S).abs() < 1e-3 && (neg - 0.3).abs() < 1e-9, "{before:?}");
        assert_eq!(before.tracking.rmse_kpa[0], 0.0, "readings less reference are told as ever");
        let squares = before.judged_squares();
        let expected = (RATE * LAG_S).powi(2) + 0.09;
        assert!(squares.len() == 25 && squares.iter().flatten().all(|s| (s - expected).abs() < 1e-3), "{squares:?}");
        let said = console.lines.join("\n");
        assert!(
            said.contains(JUDGED_BEHIND_LATE_SENSORS) && said.contains("readings less reference: 0.000/0.300"),
            "{said}"
        );
        assert!(adaptation.yardstick().unwrap().has_late_sensors());
        let kept = std::fs::read_to_string(adaptation.out.join("journal.json")).unwrap();
        assert_eq!(serde_json::from_str::<crate::journal::Journal>(&kept).unwrap(), adaptation.journal);
        forget(&adaptation);
    }

    /// Where no sensor is late nothing changes; nor where the flight before cannot be judged so, which is told.
    #[test]
    fn all_flights_are_judged_by_one_yardstick() {
        let mut adaptation = flown_before("as-read", "");
        let before = adaptation.journal.clone();
        adaptation.judge_before_again(&mut Said::default()).unwrap();
        assert_eq!(adaptation.journal, before);
        forget(&adaptation);
        for (name, recorded) in [("older", None), ("gone", Some(TickSpan { session: 4, start: START, until: UNTIL }))] {
            let mut adaptation = flown_before(name, LATE);
            adaptation.journal.flown[0].recorded = recorded;
            let before = adaptation.journal.clone();
            let mut console = Said::default();
            adaptation.judge_before_again(&mut console).unwrap();
            assert_eq!(adaptation.journal, before);
            assert!(console.lines.iter().any(|said| said.contains("is not recorded any more")), "{:?}", console.lines);
            assert!(!adaptation.yardstick().unwrap().has_late_sensors());
            forget(&adaptation);
        }
        // One that was resumed after a flight on the model, of an older program.
        let mut adaptation = flown_before("compared", LATE);
        let flown = Flown { what: WITH_MODEL.to_owned(), ..adaptation.journal.flown[0].clone() };
        adaptation.journal.flown.push(flown);
        adaptation.judge_before_again(&mut Said::default()).unwrap();
        assert!(!adaptation.yardstick().unwrap().has_late_sensors());
        forget(&adaptation);
    }
}
