//! The hidden rig behind the emulated cRIO: another maker's plant, which the programs under test know nothing of.

use hidden_rig::run::{Precision, Rig, Run};
use proto::emulator::EmulatedPlant;

/// A hidden rig at rest with both vents open, advanced by one 20 ms tick per call.
///
/// It hands over what its sensors' elements say: their lag, gain and drift are in it; noise and steps are the
/// emulated converter's.
pub struct HiddenPlant {
    run: Run<'static>,
}

impl HiddenPlant {
    /// A rig at the atmosphere, vents open, the pump turning.
    ///
    /// The rig lives as long as the program: a run borrows it, and a test or an emulator makes one or a few.
    pub fn at_rest(rig: Rig) -> Self {
        let rig: &'static Rig = Box::leak(Box::new(rig));
        HiddenPlant { run: Run::from_rest(rig, [1.0, 1.0], Precision::Fine) }
    }

    /// The pressures in the chambers, kPa gauge, whatever the sensors say of them.
    pub fn chambers_kpa(&self) -> [f64; 2] {
        self.run.chamber_kpa()
    }
}

impl EmulatedPlant for HiddenPlant {
    fn tick(&mut self, duty: [f64; 2], pump_on: bool) {
        self.run.tick(duty, pump_on);
    }

    fn pressures_gauge_kpa(&self) -> [f64; 2] {
        self.run.clean_kpa()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hidden_rig::build_sheet::BuildSheet;
    use hidden_rig::effects::Mechanism;
    use hidden_rig::effects::Place;
    use hidden_rig::effects::drive::Delay;

    fn settled(rig: Rig) -> HiddenPlant {
        let mut plant = HiddenPlant::at_rest(rig);
        (0..400).for_each(|_| plant.tick([0.8, 0.8], true));
        plant
    }

    /// The paper's plant settles where both formulations meet, to what thirteen parameters leave (`hidden_rig`'s README).
    #[test]
    fn the_papers_sheet_settles_near_our_own_plant() {
        let hidden = settled(BuildSheet::paper().rig());
        let mut own =
            model::predict::DualPressureRig::new(&model::rig::Rig::builtin("dual_pressure").unwrap()).unwrap();
        (0..400).for_each(|_| own.tick([0.8, 0.8], true));
        let (hidden, own) = (hidden.pressures_gauge_kpa(), own.readings_kpa());
        assert!((hidden[0] - own[0]).abs() < 2.0 && (hidden[1] - own[1]).abs() < 1.0, "{hidden:?} {own:?}");
    }

    /// A concealed delay of three ticks: nothing moves for three ticks after a step that moves the rig without it at once.
    #[test]
    fn a_concealed_delay_shows_from_outside() {
        let mut late = BuildSheet::paper().rig();
        let mut delay = Delay { delay_s: 0.06 };
        delay.set_strength(0.06);
        delay.install(Place::Both, &mut late);
        let moved = |rig: Rig, ticks: usize| {
            let mut plant = settled(rig);
            let before = plant.pressures_gauge_kpa()[0];
            (0..ticks).for_each(|_| plant.tick([0.9, 0.8], true));
            (plant.pressures_gauge_kpa()[0] - before).abs()
        };
        assert!(moved(late.clone(), 3) < 0.3 * moved(BuildSheet::paper().rig(), 3));
        assert!(moved(late, 6) > 1.0);
    }
}
