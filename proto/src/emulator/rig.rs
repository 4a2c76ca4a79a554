//! What stands behind the emulated cRIO: a rig that two duties and a pump switch drive.

/// A rig advanced by one 20 ms tick per call.
pub trait RigBehind: Send {
    /// Advances by one tick with these duties, 0 (closed) to 1 (open), positive and negative valve.
    fn tick(&mut self, duty: [f64; 2], pump_on: bool);

    /// The true pressures at the current edge: positive and negative chamber, kPa gauge.
    fn pressures_gauge_kpa(&self) -> [f64; 2];
}

impl<R: RigBehind + ?Sized> RigBehind for Box<R> {
    fn tick(&mut self, duty: [f64; 2], pump_on: bool) {
        (**self).tick(duty, pump_on);
    }

    fn pressures_gauge_kpa(&self) -> [f64; 2] {
        (**self).pressures_gauge_kpa()
    }
}
