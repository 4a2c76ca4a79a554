//! A sensor whose gain is wrong from the start, on rigs of which no part is as the model says.
//!
//! `wrong_gain GAIN [CHANNEL] [SPREAD] [RIGS] [SECONDS]`: the sensor of `CHANNEL` (0 positive, 1 negative) shows `GAIN` of the
//! gauge pressure; every part of `RIGS` rigs around `dual_pressure` and `bench` is up to `SPREAD` off. 1 as `GAIN` shows what
//! trips without a cause. 90/-70 kPa are asked for. A line for each rig: when it was vented and why, and how far the true
//! pressure went.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use controller::config::Safety;
use controller::cycle::Cycle;
use controller::operator::notice::Notice;
use model::rig::Rig;
use proto::emulator::SensorFault;
use proto::reference::Reference;
use supervisor::Arming;
use tests::dice::Dice;
use tests::lockstep::Flight;
use tests::strange_rigs::with_other_parts;

fn main() {
    let number = |n: usize, otherwise: f64| std::env::args().nth(n).map_or(otherwise, |word| word.parse().unwrap());
    let (gain, channel, spread) = (number(1, 0.5), number(2, 0.0) as usize, number(3, 0.2));
    let (rigs, seconds) = (number(4, 20.0) as u64, number(5, 20.0));
    let nominal = Rig::builtin("dual_pressure").unwrap();
    let mut vented = 0;
    for n in 0..rigs {
        let base = Rig::builtin(if n % 2 == 0 { "dual_pressure" } else { "bench" }).unwrap();
        let rig = with_other_parts(&base, spread, &mut Dice::new(n + 1));
        let reference = Reference::constant(90.0, -70.0);
        let cycle = Cycle::new(&nominal, None, reference, Safety::default(), Arming::Automatic).unwrap();
        let mut flight = Flight::new(&rig, cycle, n + 1);
        let (mut most_kpa, mut cause) = (0.0_f64, None);
        for _ in 0..(seconds * 50.0) as u64 {
            let true_kpa = flight.true_kpa()[channel];
            most_kpa = most_kpa.max(true_kpa.abs());
            flight.faults[channel] = vec![SensorFault::Offset((gain - 1.0) * true_kpa)];
            cause = flight.step().told.into_iter().find(|notice| matches!(notice, Notice::Vented { .. }));
            if cause.is_some() {
                break;
            }
        }
        vented += u32::from(cause.is_some());
        println!("{} #{n}: true pressure up to {most_kpa:.0} kPa, {cause:?}", rig.name);
    }
    println!("gain {gain}, parts up to {:.0} % off: {vented} of {rigs} vented", 100.0 * spread);
}
