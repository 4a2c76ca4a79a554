//! The unexplained residual: what the rig that is written is still off by on validation data, and where.

use fit::data::deviation;
use fit::wording::{MOST_TIMES, NO_NOISE_KPA};
use proto::diagnosis::Unexplained;

use crate::bench::Bench;
use crate::locate::region::{Region, Stretch, most_telling};
use crate::recordings::axes::axes;
use crate::report::figures::{Figures, held_out};

/// Rows over which errors are averaged before they are put into regions: 0.2 s.
const ROWS: usize = 10;
/// Multiples of the noise from which on a residual is worth its region.
const TIMES_NOISE: f64 = 1.0;

/// The unexplained residual of every channel with the rig of `figures`.
pub(crate) fn unexplained(bench: &Bench<'_>, figures: &Figures) -> Vec<Unexplained> {
    let of = |(channel, error): (usize, &fit::simulate::ChannelError)| {
        // Recordings need not be equally noisy: what counts is the noise of the rows that the error is measured on.
        let stated_kpa = bench.sigma_kpa().get(channel).copied().unwrap_or(0.0);
        let noise_kpa = stated_kpa.max(white_kpa(bench, &figures.trace, channel)).min(error.rmse_kpa.max(stated_kpa));
        let kpa = (error.rmse_kpa.powi(2) - noise_kpa.powi(2)).max(0.0).sqrt();
        let times_noise = (kpa / noise_kpa.max(NO_NOISE_KPA)).min(MOST_TIMES);
        let worth_it = times_noise > TIMES_NOISE;
        let sensor = bench.rig.sensors.values().nth(channel);
        Unexplained {
            channel: bench.records.sensors().get(channel).cloned().unwrap_or_default(),
            side: sensor.map(|sensor| sensor.volume.clone()).unwrap_or_default(),
            kpa,
            noise_kpa,
            times_noise,
            region: if worth_it { region(bench, &figures.trace, channel) } else { "down to the noise".to_owned() },
        }
    };
    figures.free.iter().enumerate().map(of).collect()
}

/// Standard deviation in kPa of what changes from row to row in a trace's error on validation data: by the median of second differences,
/// whose standard deviation is `√6` times that of white noise.
fn white_kpa(bench: &Bench<'_>, trace: &[f64], channel: usize) -> f64 {
    let weights = held_out(bench);
    let readings = bench.records.readings_kpa();
    let mut sizes = Vec::new();
    for record in 0..bench.records.layout().records() {
        let range = bench.records.layout().channel(record, channel);
        for i in range.start + 1..range.end.saturating_sub(1) {
            let rows = [i - 1, i, i + 1];
            let error = |i: usize| Some(trace.get(i)? - readings.get(i)?);
            let counted = rows.iter().all(|i| weights.get(*i).is_some_and(|w| *w != 0.0));
            let errors = rows.map(error);
            if let (true, [Some(a), Some(b), Some(c)]) = (counted, errors) {
                sizes.push((a - 2.0 * b + c).abs());
            }
        }
    }
    deviation(&mut sizes) / 6f64.sqrt()
}

/// The operating region in which a trace is off most in a channel.
fn region(bench: &Bench<'_>, trace: &[f64], channel: usize) -> String {
    let volume = bench.rig.sensors.values().nth(channel).map(|sensor| sensor.volume.as_str());
    let own = bench.rig.valves.values().find(|v| Some(v.from.as_str()) == volume || Some(v.to.as_str()) == volume);
    let found = off_most(bench, trace, &[channel], own.map(|valve| valve.command.as_str()));
    found.map_or_else(|| "everywhere alike".to_owned(), |region| region.in_words())
}

/// The operating region in which a trace is off most in some channels; `command` is the one that has to do with them.
pub(crate) fn off_most(bench: &Bench<'_>, trace: &[f64], channels: &[usize], command: Option<&str>) -> Option<Region> {
    let (records, layout) = (bench.records, bench.records.layout());
    let of_record = |record: usize| {
        let mut sum = vec![0.0; layout.rows(record)];
        for channel in channels {
            sum.iter_mut().zip(energy(bench, trace, record, *channel)).for_each(|(sum, energy)| *sum += energy);
        }
        sum
    };
    let energies: Vec<Vec<f64>> = (0..layout.records()).map(of_record).collect();
    let stretches: Vec<Stretch<'_>> = energies
        .iter()
        .enumerate()
        .filter_map(|(record, energy)| Some(Stretch { energy, time_s: &records.records().get(record)?.time_s }))
        .collect();
    most_telling(&stretches, &axes(bench, command, channels))
}

/// Squared error of a channel beyond the noise, row by row of a recording, averaged over [`ROWS`].
fn energy(bench: &Bench<'_>, trace: &[f64], record: usize, channel: usize) -> Vec<f64> {
    let range = bench.records.layout().channel(record, channel);
    let of = |values: &[f64]| values.get(range.clone()).unwrap_or_default().to_vec();
    let [simulated, recorded, counted] = [trace, bench.records.readings_kpa(), bench.counted()].map(of);
    let noise = bench.sigma_kpa().get(channel).map_or(0.0, |sigma| sigma * sigma) / ROWS as f64;
    let off: Vec<f64> =
        simulated.iter().zip(&recorded).zip(&counted).map(|((s, r), w)| if *w == 0.0 { 0.0 } else { s - r }).collect();
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len().max(1) as f64;
    off.chunks(ROWS).flat_map(|part| vec![(mean(part).powi(2) - noise).max(0.0); part.len()]).collect()
}

/// One sentence for the headline; `None` where nothing can be said.
pub(crate) fn in_words(all: &[Unexplained]) -> Option<String> {
    if all.is_empty() {
        return None;
    }
    let told: Vec<String> = all
        .iter()
        .filter(|u| u.times_noise > TIMES_NOISE)
        .map(|u| format!("{:.2} kPa ({}) in {}, {}", u.kpa, times_in_words(u), u.channel, most_of(&u.region)))
        .collect();
    Some(if told.is_empty() {
        "The unexplained residual on validation data is down to the noise.".to_owned()
    } else {
        format!("Unexplained on validation data: {}.", told.join("; "))
    })
}

fn most_of(region: &str) -> String {
    if region.starts_with("everywhere") { region.to_owned() } else { format!("most of it {}", at(region)) }
}

/// A region after "most of it".
fn at(region: &str) -> String {
    let begins = |word: &str| region.starts_with(word);
    if begins("within") || begins("from") || begins("between") { region.to_owned() } else { format!("at {region}") }
}

/// A residual in multiples of the noise.
fn times_in_words(left: &Unexplained) -> String {
    if left.noise_kpa <= NO_NOISE_KPA {
        "its noise cannot be told: most readings repeat the one before".to_owned()
    } else if left.times_noise >= MOST_TIMES {
        format!("more than {MOST_TIMES:.0} times the noise")
    } else {
        format!("{} times the noise", rounded(left.times_noise))
    }
}

/// Cells of a table for noise and multiples of it.
pub(crate) fn cells(left: &Unexplained) -> [String; 2] {
    if left.noise_kpa <= NO_NOISE_KPA {
        ["cannot be told".to_owned(), String::new()]
    } else if left.times_noise >= MOST_TIMES {
        [format!("{:.3}", left.noise_kpa), format!("more than {MOST_TIMES:.0}")]
    } else {
        [format!("{:.3}", left.noise_kpa), format!("{:.1}", left.times_noise)]
    }
}

fn rounded(times: f64) -> String {
    if times < 9.5 { format!("{times:.1}") } else { format!("{times:.0}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn left(kpa: f64, region: &str) -> Unexplained {
        Unexplained {
            channel: "p_pos_kpa".to_owned(),
            side: "positive".to_owned(),
            kpa,
            noise_kpa: 0.06,
            times_noise: kpa / 0.06,
            region: region.to_owned(),
        }
    }

    #[test]
    fn what_is_left_is_told_in_kpa_in_multiples_of_the_noise_and_where() {
        let said = in_words(&[left(0.75, "rising u_pos between 0.70 and 0.85"), left(0.02, "")]).unwrap();
        assert_eq!(
            said,
            "Unexplained on validation data: 0.75 kPa (12 times the noise) in p_pos_kpa, most of it at rising u_pos between \
             0.70 and 0.85."
        );
        assert!(in_words(&[left(0.02, "")]).unwrap().contains("down to the noise"));
        assert_eq!(in_words(&[]), None);
    }

    #[test]
    fn multiples_of_no_noise_are_not_told() {
        let frozen = Unexplained { noise_kpa: 1e-6, times_noise: 1000.0, ..left(7.263, "everywhere alike") };
        let said = in_words(std::slice::from_ref(&frozen)).unwrap();
        assert!(said.contains("7.26 kPa (its noise cannot be told") && !said.contains("times"), "{said}");
        assert_eq!(cells(&frozen), ["cannot be told", ""]);
        let steady = Unexplained { noise_kpa: 2e-4, times_noise: 1000.0, ..left(7.263, "everywhere alike") };
        assert!(in_words(&[steady]).unwrap().contains("(more than 1000 times the noise)"));
    }
}
