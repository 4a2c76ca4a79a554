//! A sound recording of the paper's rig, for tests that spoil it.

use model::predict::DualPressureRig;
use model::rig::Rig;

/// Time, duties, pressures.
pub type Row = [f64; 5];

/// Recorded for so long, after ten seconds that are not.
pub const ROWS: usize = 2500;

/// Numbers in [0, 1) that look random: Knuth's 64-bit congruential generator.
pub struct Dice(pub u64);

impl Dice {
    pub fn throw(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// A sound recording of the paper's rig: steps of both duties, noise, and the steps of a 16-bit converter.
pub fn sound() -> Vec<Row> {
    let mut rig = DualPressureRig::new(&Rig::builtin("dual_pressure").unwrap()).unwrap();
    let mut dice = Dice(7);
    let mut duty = [0.8, 0.8];
    let mut rows = Vec::new();
    for row in 0..ROWS + 500 {
        for (channel, every) in [(0, 45), (1, 60)] {
            if row % every == 0 {
                duty[channel] = 0.66 + 0.32 * dice.throw();
            }
        }
        if row >= 500 {
            // Sum of four uniform numbers: nearly normal, σ = 0.12 kPa; steps of 0.03 kPa.
            let mut read = |kpa: f64| {
                let noise = 0.2 * ((0..4).map(|_| dice.throw()).sum::<f64>() - 2.0);
                ((kpa + noise) / 0.03).round() * 0.03
            };
            let [pos, neg] = rig.readings_kpa();
            rows.push([(row - 500) as f64 * 0.02, duty[0], duty[1], read(pos), read(neg)]);
        }
        rig.tick(duty, true);
    }
    rows
}

pub fn csv(rows: &[Row]) -> String {
    let line = |[t, a, b, p, n]: &Row| format!("{t},{a:.5},{b:.5},{p},{n}\n");
    "time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa\n".to_owned() + &rows.iter().map(line).collect::<String>()
}

/// Change that is made to every row.
pub type Spoil = fn(&mut Row);

pub fn scaled(row: &mut Row, factor: f64) {
    (row[3], row[4]) = (row[3] * factor, row[4] * factor);
}

pub fn absolute(row: &mut Row, factor: f64) {
    (row[3], row[4]) = ((row[3] + 101.325) * factor, (row[4] + 101.325) * factor);
}

/// The key of a complaint.
#[track_caller]
pub fn told_key(complaint: &str) -> &str {
    let key = complaint.split("[recording] ").nth(1).and_then(|rest| rest.split([';', '\n']).next());
    key.unwrap_or_else(|| panic!("no key in {complaint}"))
}
