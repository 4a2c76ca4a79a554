//! The unexplained residual: what the rig that is written is still off by on validation data, and where; and the recording
//! that it is off by much more in, in rows that are no validation data.

use fit::data::{Role, deviation};
use fit::simulate::{ChannelError, errors};
use fit::wording::{MOST_TIMES, NO_NOISE_KPA};
use proto::diagnosis::{FurtherOff, Unexplained};

use crate::bench::Bench;
use crate::locate::region::{Region, Stretch, most_telling};
use crate::recordings::axes::axes;
use crate::report::figures::{Figures, held_out};

/// Rows over which errors are averaged before they are put into regions: 0.2 s.
const ROWS: usize = 10;
/// Multiples of the noise from which on a residual is worth its region.
pub(crate) const TIMES_NOISE: f64 = 1.0;

/// Factor over the error on validation data, and over the noise, from which on the error in rows that are no validation data is
/// told: one that is not more is what the figures on validation data say.
const FURTHER: f64 = 2.0;

/// The unexplained residual of every channel with the rig of `figures`.
pub(crate) fn unexplained(bench: &Bench<'_>, figures: &Figures) -> Vec<Unexplained> {
    let kept_back = held_out(bench);
    let of = |(channel, error): (usize, &ChannelError)| {
        let noise_kpa = noise_kpa(bench, &figures.trace, (channel, error), &kept_back);
        let (kpa, times_noise) = beyond(error, noise_kpa);
        let worth_it = times_noise > TIMES_NOISE;
        let sensor = bench.rig.sensors.values().nth(channel);
        Unexplained {
            channel: bench.records.sensors().get(channel).cloned().unwrap_or_default(),
            side: sensor.map(|sensor| sensor.volume.clone()).unwrap_or_default(),
            kpa,
            noise_kpa,
            times_noise,
            region: if worth_it { region(bench, &figures.trace, channel) } else { "down to the noise".to_owned() },
            further_off: further_off(bench, &figures.trace, (channel, error)),
        }
    };
    figures.free.iter().enumerate().map(of).collect()
}

/// An error beyond a noise, in kPa and as a multiple of it.
fn beyond(error: &ChannelError, noise_kpa: f64) -> (f64, f64) {
    let kpa = (error.rmse_kpa.powi(2) - noise_kpa.powi(2)).max(0.0).sqrt();
    (kpa, (kpa / noise_kpa.max(NO_NOISE_KPA)).min(MOST_TIMES))
}

/// The recording whose rows that were fitted or chose a trace is furthest off in, where that is much more than the error on validation
/// data. Where recordings come in pieces beside whole ones nothing of the pieces is validation data, so that no figure on it shows them.
fn further_off(bench: &Bench<'_>, trace: &[f64], (channel, validation): (usize, &ChannelError)) -> Option<FurtherOff> {
    let (records, layout) = (bench.records.records(), bench.records.layout());
    let [fitted, chose] = [Role::Fit, Role::Select].map(|role| bench.split.weights(layout, role));
    let seen: Vec<f64> = fitted
        .iter()
        .zip(&chose)
        .zip(bench.counted())
        .map(|((fit, select), counted)| (fit + select) * counted)
        .collect();
    let mut sources: Vec<&str> = records.iter().map(|r| r.source.as_str()).collect();
    sources.sort_unstable();
    sources.dedup();
    let of = |source: &str| {
        let mut weights = vec![0.0; layout.len()];
        for record in (0..records.len()).filter(|record| records.get(*record).is_some_and(|r| r.source == source)) {
            let places = layout.channel(record, channel);
            if let (Some(own), Some(seen)) = (weights.get_mut(places.clone()), seen.get(places)) {
                own.copy_from_slice(seen);
            }
        }
        let error = errors(&bench.simulator, trace, &weights).into_iter().nth(channel)?;
        let noise_kpa = noise_kpa(bench, trace, (channel, &error), &weights);
        let is_further = error.rmse_kpa > FURTHER * validation.rmse_kpa.max(noise_kpa);
        let (kpa, times_noise) = beyond(&error, noise_kpa);
        is_further.then(|| FurtherOff { recording: source.to_owned(), kpa, noise_kpa, times_noise })
    };
    sources.into_iter().filter_map(of).max_by(|a, b| a.kpa.total_cmp(&b.kpa))
}

/// Noise in kPa of the rows that an error is measured on: recordings need not be equally noisy.
fn noise_kpa(bench: &Bench<'_>, trace: &[f64], (channel, error): (usize, &ChannelError), weights: &[f64]) -> f64 {
    let stated_kpa = bench.sigma_kpa().get(channel).copied().unwrap_or(0.0);
    stated_kpa.max(white_kpa(bench, trace, channel, weights)).min(error.rmse_kpa.max(stated_kpa))
}

/// Standard deviation in kPa of what changes from row to row in a trace's error where `weights` are not 0: by the median of second
/// differences, whose standard deviation is `√6` times that of white noise.
fn white_kpa(bench: &Bench<'_>, trace: &[f64], channel: usize, weights: &[f64]) -> f64 {
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

/// One sentence for the headline; `None` where nothing can be said. `shown` names a recording for a reader.
pub(crate) fn in_words(all: &[Unexplained], shown: impl Fn(&str) -> String) -> Option<String> {
    if all.is_empty() {
        return None;
    }
    let told: Vec<String> = all
        .iter()
        .filter(|u| u.times_noise > TIMES_NOISE)
        .map(|u| {
            let times = times_in_words(u.noise_kpa, u.times_noise);
            format!("{:.2} kPa ({times}) in {}, {}", u.kpa, u.channel, most_of(&u.region))
        })
        .collect();
    let fitted: Vec<String> = all
        .iter()
        .filter_map(|u| Some((u, u.further_off.as_ref()?)))
        .map(|(u, further)| {
            let times = times_in_words(further.noise_kpa, further.times_noise);
            let file = shown(&further.recording);
            format!(
                "{:.2} kPa ({times}) in {} in the rows of {file} that are no validation data",
                further.kpa, u.channel
            )
        })
        .collect();
    let fitted = fitted.join("; ");
    Some(match (told.is_empty(), fitted.is_empty()) {
        (true, true) => "The unexplained residual on validation data is down to the noise.".to_owned(),
        (true, false) => {
            format!("The unexplained residual on validation data is down to the noise, yet it is {fitted}.")
        }
        (false, true) => format!("Unexplained on validation data: {}.", told.join("; ")),
        (false, false) => format!("Unexplained on validation data: {}; and {fitted}.", told.join("; ")),
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
fn times_in_words(noise_kpa: f64, times_noise: f64) -> String {
    if noise_kpa <= NO_NOISE_KPA {
        "its noise cannot be told: most readings repeat the one before".to_owned()
    } else if times_noise >= MOST_TIMES {
        format!("more than {MOST_TIMES:.0} times the noise")
    } else {
        format!("{} times the noise", rounded(times_noise))
    }
}

/// Cells of a table for noise and multiples of it.
pub(crate) fn cells(noise_kpa: f64, times_noise: f64) -> [String; 2] {
    if noise_kpa <= NO_NOISE_KPA {
        ["cannot be told".to_owned(), String::new()]
    } else if times_noise >= MOST_TIMES {
        [format!("{noise_kpa:.3}"), format!("more than {MOST_TIMES:.0}")]
    } else {
        [format!("{noise_kpa:.3}"), format!("{times_noise:.1}")]
    }
}

fn rounded(times: f64) -> String {
    if times < 9.5 { format!("{times:.1}") } else { format!("{times:.0}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::made::{duties, flown, made, moved};
    use crate::report::figures::figures;
    use fit::data::Records;
    use fit::data::switched::BehindChanges;
    use fit::simulate::Fidelity;
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    fn left(kpa: f64, region: &str) -> Unexplained {
        Unexplained {
            channel: "p_pos_kpa".to_owned(),
            side: "positive".to_owned(),
            kpa,
            noise_kpa: 0.06,
            times_noise: kpa / 0.06,
            region: region.to_owned(),
            further_off: None,
        }
    }

    fn said(all: &[Unexplained]) -> Option<String> {
        in_words(all, str::to_owned)
    }

    #[test]
    fn what_is_left_is_told_in_kpa_in_multiples_of_the_noise_and_where() {
        let told = said(&[left(0.75, "rising u_pos between 0.70 and 0.85"), left(0.02, "")]).unwrap();
        assert_eq!(
            told,
            "Unexplained on validation data: 0.75 kPa (12 times the noise) in p_pos_kpa, most of it at rising u_pos between \
             0.70 and 0.85."
        );
        assert!(said(&[left(0.02, "")]).unwrap().contains("down to the noise"));
        assert_eq!(said(&[]), None);
    }

    #[test]
    fn multiples_of_no_noise_are_not_told() {
        let frozen = Unexplained { noise_kpa: 1e-6, times_noise: 1000.0, ..left(7.263, "everywhere alike") };
        let told = said(std::slice::from_ref(&frozen)).unwrap();
        assert!(told.contains("7.26 kPa (its noise cannot be told") && !told.contains("times"), "{told}");
        assert_eq!(cells(frozen.noise_kpa, frozen.times_noise), ["cannot be told", ""]);
        let steady = Unexplained { noise_kpa: 2e-4, times_noise: 1000.0, ..left(7.263, "everywhere alike") };
        assert!(said(&[steady]).unwrap().contains("(more than 1000 times the noise)"));
    }

    /// An experiment beside whole recordings gives no validation data: a sensor's zero that is 1 kPa off in it alone would be told nowhere.
    #[test]
    fn an_experiment_that_was_fitted_and_is_far_off_is_told() {
        const BEFORE: usize = 200;
        let (rig, truth) = moved(&[]);
        let mut random = Pcg64Mcg::seed_from_u64(8);
        let duty = duties(1500 + BEFORE, &mut random);
        let off = BEFORE + 900..BEFORE + 1100;
        let pump_on: Vec<f64> = (0..1500 + BEFORE).map(|row| if off.contains(&row) { 0.0 } else { 1.0 }).collect();
        let experiment = flown("data/experiment.csv", BEFORE, &truth, &duty, Some(&pump_on), &mut random);
        let told = |zero_kpa: f64| {
            let column = experiment.column("p_neg_kpa").unwrap();
            let shifted: Vec<f64> = column.iter().map(|kpa| kpa + zero_kpa).collect();
            let mut recordings = made(&truth, 2, 3);
            recordings.push(experiment.clone().with_numbers("p_neg_kpa", &shifted));
            let cut = BehindChanges::of(&rig, &Records::new(&rig, &recordings).unwrap()).unwrap().records;
            let usable = vec![1.0; cut.layout().len()];
            let bench = Bench::new(&rig, &cut, &usable, Fidelity::Averaged);
            unexplained(&bench, &figures(&bench, &rig, Fidelity::Averaged, false).unwrap())
        };
        let sound = told(0.0);
        assert!(sound.iter().all(|left| left.further_off.is_none()), "{sound:?}");
        let all = told(1.0);
        assert_eq!(all[0].further_off, None);
        // On validation data, which has nothing of it, the noise of 0.08 kPa is what is left.
        assert!(all[1].times_noise < 2.0, "{all:?}");
        let further = all[1].further_off.as_ref().unwrap();
        // Each piece begins at its own reading, and takes about a second to come to where the rig is.
        assert!(further.recording == "data/experiment.csv" && (0.75..1.1).contains(&further.kpa), "{further:?}");
        assert_eq!(all[1].most_times_noise(), further.times_noise);
        let said = in_words(&all, |source| source.rsplit('/').next().unwrap().to_owned()).unwrap();
        assert!(said.ends_with("in p_neg_kpa in the rows of experiment.csv that are no validation data."), "{said}");
    }
}
