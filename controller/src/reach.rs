//! Pressures that a rig can hold by its model, and places where a reference asks for others.
//!
//! A reference beyond them is no wrong use: it may pass through such a place for a moment, and the model may be wrong. So it
//! is told and not refused, by whatever checks, arms or follows one. The watch acts on what comes of it
//! ([`monitor::tracking`]).

use std::collections::BTreeMap;

use model::observation::{CHANNELS, Pair};
use model::steady::SteadyMap;
use monitor::tracking::{AWAY_KPA, TICKS_TO_REVERT, TICKS_TO_VENT};
use proto::recording::PERIOD_S;
use proto::reference::Reference;
use serde::{Deserialize, Serialize};

mod model_reach;

pub use model_reach::{KnownReach, ModelReach};

/// Between two places of a reference that are looked at, in s.
const EVERY_S: f64 = 0.25;
/// Places that are looked at, at most: 7 h, in which a duty is asked of the model in some 25 ms.
const MOST_LOOKS: f64 = 100_000.0;
/// Edge in kPa of the smallest cell of which one place is followed to rest: the pressures that a rig keeps differ by little within it.
const SMALLEST_CELL_KPA: f64 = 4.0;
/// Places that are followed to rest, at most: some tenths of a second, some seconds on a rig that hardly comes to rest.
const MOST_PLACES: usize = 100;
/// Distance from the reference that is told, in kPa: less is within what a model is off by.
const TOLD_KPA: f64 = 1.0;
/// Channels as they are called.
const NAMES: [&str; CHANNELS] = ["positive", "negative"];

/// Range of the pressures that a rig can hold while its pump runs, as its sensors read them, in kPa gauge.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Reach {
    /// Both pressures with both vents wide open. One alone goes nearer to the atmosphere only where the other is held further
    /// from it, for then the pump moves less.
    pub open_kpa: Pair,
    /// Each pressure with its own vent shut and the other one wide open: the furthest that the pump brings it. It ends where the model's
    /// map does, at 170 and −97.5 kPa.
    pub shut_kpa: Pair,
}

impl Reach {
    /// Reach of the rig that a map was made of; `None` where its numbers are none, or it comes to no rest.
    ///
    /// # Real-time
    /// Some milliseconds; not for the tick.
    pub fn of(map: &SteadyMap) -> Option<Self> {
        let rests = |duty| map.rests_at_kpa(duty).map(|kpa| map.readings_kpa(kpa));
        let shut_kpa = [rests([0.0, 1.0])?[0], rests([1.0, 0.0])?[1]];
        let reach = Reach { open_kpa: rests([1.0; CHANNELS])?, shut_kpa };
        reach.open_kpa.iter().chain(&reach.shut_kpa).all(|kpa| kpa.is_finite()).then_some(reach)
    }
}

/// In one clause, for a person.
impl std::fmt::Display for Reach {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ([pos, neg], [most, deepest]) = (self.open_kpa, self.shut_kpa);
        write!(f, "{pos:.1}/{neg:.1} kPa with both vents wide open, up to {most:.1}/{deepest:.1} kPa with a vent shut")
    }
}

/// End of a vent's way at which its chamber still does not come to its reference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Vent {
    WideOpen,
    Shut,
}

/// Place at which a reference asks one chamber for more than the rig may give.
#[derive(Debug, Clone, Copy)]
struct Place {
    channel: usize,
    vent: Vent,
    time_s: f64,
    asked_kpa: Pair,
}

impl Place {
    /// Tells whether it asks for more than another of the same end does.
    fn is_further(&self, other: &Place) -> bool {
        let (here, there) = (self.asked_kpa[self.channel].abs(), other.asked_kpa[other.channel].abs());
        match self.vent {
            Vent::WideOpen => here < there,
            Vent::Shut => here > there,
        }
    }

    /// The pressure that the rig keeps instead; `None` where it comes close enough all the same, or nobody knows.
    fn beyond(self, map: &SteadyMap) -> Option<Beyond> {
        let held = map.nearest_held_kpa(map.chamber_kpa(self.asked_kpa))?;
        let (asked, kept_kpa) = (self.asked_kpa[self.channel], map.readings_kpa(held)[self.channel]);
        let is_beyond = match self.vent {
            Vent::WideOpen => kept_kpa.abs() > asked.abs(),
            Vent::Shut => kept_kpa.abs() < asked.abs(),
        };
        let off_kpa = (kept_kpa - asked).abs();
        (is_beyond && off_kpa > TOLD_KPA).then_some(Beyond { place: self, kept_kpa, off_kpa })
    }
}

/// Place at which the rig stays away from a reference.
#[derive(Debug, Clone, Copy)]
struct Beyond {
    place: Place,
    kept_kpa: f64,
    off_kpa: f64,
}

/// In one clause, with what becomes of it.
impl std::fmt::Display for Beyond {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Beyond { place, kept_kpa, off_kpa } = *self;
        let (name, asked, time_s) = (NAMES[place.channel], place.asked_kpa[place.channel], place.time_s);
        let (with, comes) = match place.vent {
            Vent::WideOpen => ("wide open", "keeps"),
            Vent::Shut => ("shut", "comes to"),
        };
        write!(
            f,
            "the {name} one asks for {asked:.1} kPa (at {time_s:.2} s); with the {name} vent {with} this rig {comes} {kept_kpa:.1} kPa: "
        )?;
        let after_s = |ticks: u32| f64::from(ticks) * PERIOD_S;
        match place.vent {
            _ if off_kpa <= AWAY_KPA => write!(f, "it stays {off_kpa:.1} kPa away"),
            Vent::WideOpen => write!(f, "it is vented after {:.0} s of that", after_s(TICKS_TO_VENT)),
            Vent::Shut => write!(
                f,
                "the fallback takes over after {:.0} s of that where a policy controls, and comes no nearer itself",
                after_s(TICKS_TO_REVERT)
            ),
        }
    }
}

/// Places that stand for those near them: of each end and each cell of pressures the one that asks for most.
///
/// The pressure kept at one place follows from both that are asked for, and takes a millisecond or two to find. So cells grow until
/// there are few.
#[derive(Debug)]
struct Places {
    /// Edge of a cell in kPa.
    cell_kpa: f64,
    /// By channel, end and cell.
    furthest: BTreeMap<(usize, Vent, [i64; CHANNELS]), Place>,
}

impl Places {
    fn new() -> Self {
        Places { cell_kpa: SMALLEST_CELL_KPA, furthest: BTreeMap::new() }
    }

    fn add(&mut self, place: Place) {
        self.put(place);
        while self.furthest.len() > MOST_PLACES {
            self.cell_kpa *= 2.0;
            std::mem::take(&mut self.furthest).into_values().for_each(|place| self.put(place));
        }
    }

    fn put(&mut self, place: Place) {
        let cell = place.asked_kpa.map(|kpa| (kpa / self.cell_kpa).floor() as i64);
        let known = self.furthest.entry((place.channel, place.vent, cell)).or_insert(place);
        if place.is_further(known) {
            *known = place;
        }
    }

    /// Gives for each end the place from which the rig stays furthest away.
    fn worst(&self, map: &SteadyMap) -> Vec<Beyond> {
        let mut worst: BTreeMap<(usize, Vent), Beyond> = BTreeMap::new();
        for beyond in self.furthest.values().filter_map(|place| place.beyond(map)) {
            let known = worst.entry((beyond.place.channel, beyond.place.vent)).or_insert(beyond);
            if beyond.off_kpa > known.off_kpa {
                *known = beyond;
            }
        }
        worst.into_values().collect()
    }
}

/// One line about a reference that asks the rig for pressures that no duty holds, by the rig's map; `None` for one that does not.
///
/// # Real-time
/// Up to some tenths of a second, for a reference of hours; not for the tick.
pub fn beyond_reach(map: &SteadyMap, reference: &Reference) -> Option<String> {
    let looks = (reference.end_s() / EVERY_S).ceil().min(MOST_LOOKS);
    let mut places = Places::new();
    for look in 0..=looks as u32 {
        let time_s = f64::from(look) * EVERY_S;
        let asked_kpa = reference.at(time_s);
        let chamber_kpa = map.chamber_kpa(asked_kpa);
        let duty = map.duty_for(chamber_kpa, [0.0; CHANNELS]);
        let can = map.played(duty);
        // Whether the pump gets that far with the vent shut does not show in the duty. Beyond the map nothing is known of it.
        let shut = map.covers(chamber_kpa).then_some(Vent::Shut);
        for (channel, duty) in duty.into_iter().enumerate() {
            let open = (duty > can[channel]).then_some(Vent::WideOpen);
            open.into_iter().chain(shut).for_each(|vent| places.add(Place { channel, vent, time_s, asked_kpa }));
        }
    }
    let told: Vec<String> = places.worst(map).iter().map(Beyond::to_string).collect();
    (!told.is_empty()).then(|| format!("the reference is out of the rig's reach by its model: {}", told.join("; ")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::predict::DualPressureRig;
    use model::rig::Rig;

    fn rig() -> Rig {
        Rig::builtin("dual_pressure").unwrap()
    }

    /// Readings of the simulated rig after 40 s under constant duties, and what they swing by within a revolution, in kPa.
    fn simulated(duty: Pair) -> Pair {
        let mut plant = DualPressureRig::new(&rig()).unwrap();
        (0..2000).for_each(|_| plant.tick(duty, true));
        plant.readings_kpa()
    }
    const RIPPLE_KPA: f64 = 0.45;

    #[test]
    fn the_reach_is_the_simulated_rigs() {
        let reach = Reach::of(&SteadyMap::new(&rig()).unwrap()).unwrap();
        for (told, simulated) in reach.open_kpa.into_iter().zip(simulated([1.0; CHANNELS])) {
            assert!((told - simulated).abs() < RIPPLE_KPA, "{told} against {simulated}");
        }
        // Shut for 40 s they go beyond the map, and that is where the reach ends.
        assert!(simulated([0.0, 1.0])[0] > 170.0 && reach.shut_kpa[0] == 170.0, "{reach:?}");
        assert!(reach.shut_kpa[1] < -95.0, "{reach:?}");
        let line = reach.to_string();
        assert!(line.contains("82.8/-62.1 kPa with both vents wide open"), "{line}");
    }

    #[test]
    fn what_is_out_of_reach_is_told_with_what_the_rig_keeps_and_what_follows() {
        let map = SteadyMap::new(&rig()).unwrap();
        let told = |pos, neg| beyond_reach(&map, &Reference::constant(pos, neg));
        assert_eq!(told(90.0, -70.0), None);
        // Low only where the other chamber is deep enough for it, and so within reach.
        assert_eq!((told(78.0, -65.0), beyond_reach(&map, &Reference::paper())), (None, None));
        let bench = SteadyMap::new(&Rig::builtin("bench").unwrap()).unwrap();
        assert_eq!(beyond_reach(&bench, &Reference::paper()), None);
        assert_eq!(told(150.0, -90.0), None);
        // Lower than with both open, and still held: the pump moves little from so deep a vacuum.
        assert_eq!(told(40.0, -90.0), None);
        assert_eq!(told(180.0, -70.0), None, "beyond the map, of which nothing is known");
        for ((pos, neg), words) in [
            ((12.0, -70.0), &["the positive one asks for 12.0 kPa", "vent wide open", "it is vented after 5 s"][..]),
            ((78.0, -62.0), &["the positive one asks for 78.0 kPa", "keeps 82.8 kPa", "it stays 4.8 kPa away"]),
            ((85.0, -40.0), &["the negative one asks for -40.0 kPa", "keeps -62.1 kPa", "it is vented after 5 s"]),
            (
                (20.0, -20.0),
                &["positive one asks for 20.0", "keeps 82.8", "; the negative one asks for -20.0", "keeps -62.1"],
            ),
        ] {
            let line = told(pos, neg).unwrap();
            assert!(line.contains("out of the rig's reach") && !line.contains('\n'), "{line}");
            for word in words {
                assert!(line.contains(word), "`{word}` is not in {line}");
            }
        }
        // What is told to be kept is what the simulated rig keeps at the duties of there.
        let kept = map.nearest_held_kpa([12.0, -70.0]).unwrap();
        let duty = map.duty_for(kept, [0.0; CHANNELS]);
        assert!((simulated(duty)[0] - kept[0]).abs() < RIPPLE_KPA, "{kept:?} at {duty:?}");
    }

    #[test]
    fn the_place_that_asks_for_most_is_told_by_its_time() {
        let map = SteadyMap::new(&rig()).unwrap();
        let reference =
            Reference::parse("r", b"time_s,ref_pos_kpa,ref_neg_kpa\n0,90,-70\n10,60,-70\n20,90,-70\n").unwrap();
        let line = beyond_reach(&map, &reference).unwrap();
        assert!(line.contains("the positive one asks for 60.0 kPa (at 10.00 s)"), "{line}");
    }

    /// The place that asks for least may be held, as the other chamber is deep there, and one that asks for more not.
    #[test]
    fn the_place_from_which_the_rig_stays_furthest_is_told() {
        let map = SteadyMap::new(&rig()).unwrap();
        let reference = Reference::parse("r", b"time_s,ref_pos_kpa,ref_neg_kpa\n0,52,-85\n10,60,-62\n").unwrap();
        assert_eq!(beyond_reach(&map, &Reference::constant(52.0, -85.0)), None);
        let line = beyond_reach(&map, &reference).unwrap();
        assert!(line.contains("the positive one asks for") && line.contains("it is vented after 5 s"), "{line}");
    }

    /// Dead space keeps a pump from the vacuum that is asked for: its vent is shut, and the fallback is all that is left.
    #[test]
    fn a_pump_that_does_not_get_there_is_told() {
        let mut weak = rig();
        for pump in weak.pumps.values_mut() {
            if let model::rig::Pump::Piston(pump) = pump {
                pump.effective_length_mm += 12.0;
            }
        }
        let map = SteadyMap::new(&weak).unwrap();
        let reach = Reach::of(&map).unwrap();
        assert!((-85.0..-75.0).contains(&reach.shut_kpa[1]), "{reach:?}");
        let line = beyond_reach(&map, &Reference::constant(60.0, -95.0)).unwrap();
        assert!(line.contains("with the negative vent shut this rig comes to"), "{line}");
        assert!(line.contains("the fallback takes over after 5 s"), "{line}");
        // A place beyond the map, of which nothing is known, does not hide it.
        let reference = Reference::parse("r", b"time_s,ref_pos_kpa,ref_neg_kpa\n0,60,-95\n10,60,-99\n").unwrap();
        let line = beyond_reach(&map, &reference).unwrap();
        assert!(line.contains("with the negative vent shut this rig comes to"), "{line}");
    }
}
