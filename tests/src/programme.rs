//! Programmes for experiments, as rows and as the file that holds them.

/// Duties of both vents, and whether the pump is on.
pub type ProgrammeRow = (f64, f64, u8);

/// Commands with every digit in use, and the pump off for a second in the middle.
pub fn programme(rows: usize) -> Vec<ProgrammeRow> {
    let row = |k: usize| {
        let t = k as f64 * 0.02;
        let pump = u8::from(!(200..250).contains(&k));
        (0.82 + 0.06 * (1.1 * t).sin(), 0.80 + 0.05 * (0.7 * t).cos(), pump)
    };
    (0..rows).map(row).collect()
}

/// The file, a row every 20 ms.
pub fn csv(rows: &[ProgrammeRow]) -> String {
    let line = |(k, (pos, neg, pump)): (usize, &ProgrammeRow)| format!("{:.2},{pos},{neg},{pump}\n", 0.02 * k as f64);
    format!("time_s,u_pos,u_neg,pump_on\n{}", rows.iter().enumerate().map(line).collect::<String>())
}
