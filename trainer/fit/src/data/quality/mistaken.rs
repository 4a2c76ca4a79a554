//! Exchanged columns, commands that are turned round, and pressures that are an atmosphere off, on rigs of any number of actuators
//! and sensors.
//!
//! Each is told where a free run of the rig as given comes close to the recording with the fault mended, and is several times as far off
//! as it stands. A rig that is some tens of percent off its file is off in either case, and is left alone.

use model::rig::{Pump, Rig};

use super::duties::{Is, inverted};
use super::excitation::deviation;
use super::meaning::{AS_WRITTEN, Meaning, RIGHT};
use super::mend::{exchanged_keys, pressure_key, shifted_key};
use super::trials::{Outcome, Taken, tried};
use super::{Finding, Severity, Trouble, is_of_commands};
use crate::data::Records;
use crate::data::record::is_on;

/// Share of what pressures move through by which a rig that follows a recording is off at least, to ask why …
pub(super) const LEAST_OFF: f64 = 0.05;
/// … and at most, where the fault is mended.
const FOLLOWS: f64 = 0.25;
/// Share of what it is off as the recording stands that it is then off at most …
pub(super) const MUCH_BETTER: f64 = 1.0 / 3.0;
/// … and where only an atmosphere is taken away or added, which a rig that is off by a tenth of a high pressure comes near to as well.
const SHIFTED_BETTER: f64 = 0.15;
/// Share by which another explanation of several is off more that cannot be told from the best.
const RIVAL: f64 = 0.5;
/// Standard deviation from which on a command moves.
const MOVES: f64 = 0.02;
/// Commands of which every combination is turned round; of more each alone, and all.
const COMBINED: usize = 4;
/// Most trials of a recording, and most recordings that are tried.
const MOST_TRIALS: usize = 60;
const MOST_RECORDINGS: usize = 4;
/// Share of an atmosphere within which something said is one …
const ATMOSPHERE: f64 = 0.3;
/// … and below the lowest that a rig does at which no reading is.
const BELOW: f64 = 0.1;
/// Share of an atmosphere above the air outside to which a rig goes down at least for an atmosphere too much to be told for certain: at
/// high pressures a supply that is off by an atmosphere looks the same.
const NEAR_AIR: f64 = 0.3;

/// A command that may be exchanged or inverted, or a relay that may be inverted.
struct Command<'a> {
    input: usize,
    column: &'a str,
    is: Is,
}

/// Adds what free runs tell of commands and sensors.
pub(super) fn check(rig: &Rig, records: &Records, findings: &mut Vec<Finding>) {
    let commands = commands(rig, records);
    let told = not_followed(rig, records).into_iter();
    told.for_each(|record| findings.extend(found(rig, records, record, &commands)));
}

/// The first recordings that the rig does not follow as they stand.
pub(super) fn not_followed(rig: &Rig, records: &Records) -> Vec<usize> {
    let all: Vec<usize> = (0..records.sensors().len()).collect();
    let is_off = |record: &usize| {
        let alone = tried(rig, records, *record, &[Taken::AsItStands]);
        alone.and_then(|outcomes| Some(outcomes.first()?.off(&all) > LEAST_OFF)).unwrap_or(false)
    };
    (0..records.records().len()).filter(is_off).take(MOST_RECORDINGS).collect()
}

/// Puts what free runs tell of commands in the place of findings of a kind that such commands look like, where they tell something.
pub(super) fn instead(rig: &Rig, records: &Records, of: Trouble, findings: &mut Vec<Finding>) {
    let mut closer = Vec::new();
    check(rig, records, &mut closer);
    closer.retain(|finding| is_of_commands(finding.trouble));
    put_instead(closer, of, findings);
}

/// Puts closer findings in the place of those of a kind in the same files; what is told already is not told again.
fn put_instead(closer: Vec<Finding>, of: Trouble, findings: &mut Vec<Finding>) {
    findings.retain(|finding| finding.trouble != of || closer.iter().all(|one| one.source != finding.source));
    for finding in closer {
        if !findings.contains(&finding) {
            findings.push(finding);
        }
    }
}

/// Finds what is wrong with one recording that the rig does not follow; nothing where nothing explains it.
fn found(rig: &Rig, records: &Records, record: usize, commands: &[Command<'_>]) -> Vec<Finding> {
    let channels = records.sensors().len();
    let trials = trials(rig, records, record, commands);
    let outcomes = tried(rig, records, record, &trials).unwrap_or_default();
    let Some(as_it_stands) = outcomes.first() else { return Vec::new() };
    let everywhere: Vec<usize> = (0..channels).collect();
    let mut explaining: Vec<(f64, &Taken, &Outcome)> = trials
        .iter()
        .zip(&outcomes)
        .skip(1)
        .filter(|(taken, outcome)| explains(rig, taken, as_it_stands, outcome, channels))
        .map(|(taken, outcome)| (outcome.off(&everywhere), taken, outcome))
        .collect();
    explaining.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some((off, best, mended)) = explaining.first() else { return Vec::new() };
    let severity = if is_off_the_air(rig, best, mended) { Severity::Doubtful } else { Severity::Unusable };
    let of = Told { rig, records, record, commands, severity };
    let mut findings = of.findings(best);
    let rival = explaining.get(1).filter(|(other, ..)| *other < (1.0 + RIVAL) * off);
    if let (Some((_, rival, _)), Some(last)) = (rival, findings.last_mut()) {
        let others: Vec<String> = of.findings(rival).iter().map(ToString::to_string).collect();
        last.text += &format!("; or, which cannot be told from it here, {}", others.join("; "));
    }
    findings
}

/// Says whether a recording is as one would have it with a fault mended, and far from it as it stands.
fn explains(rig: &Rig, taken: &Taken, as_it_stands: &Outcome, mended: &Outcome, channels: usize) -> bool {
    let of = taken.channels(channels);
    let share = if matches!(taken, Taken::SensorsShifted(..)) { SHIFTED_BETTER } else { MUCH_BETTER };
    let (before, after) = (as_it_stands.off(&of), mended.off(&of));
    before > LEAST_OFF && after < FOLLOWS && after < share * before && !is_below_all(rig, taken, as_it_stands, mended)
}

/// Says whether readings, less an atmosphere, would be where nothing in the rig draws them: a chamber that reads nothing at first
/// was open to the air.
fn is_below_all(rig: &Rig, taken: &Taken, as_it_stands: &Outcome, mended: &Outcome) -> bool {
    let Taken::SensorsShifted(channels, _) = taken else { return false };
    let margin = BELOW * rig.atmosphere.pressure_kpa_abs;
    channels.iter().any(|channel| {
        let of = |outcome: &Outcome| outcome.lowest_kpa.get(*channel).copied();
        let lowest = of(as_it_stands).zip(of(mended));
        lowest.is_some_and(|([_, simulated], [read, _])| read < simulated.min(0.0) - margin)
    })
}

/// Says whether nothing tells readings that are an atmosphere too high from a supply that is: the rig, as it is with the fault mended, never
/// comes near the air outside.
fn is_off_the_air(rig: &Rig, taken: &Taken, mended: &Outcome) -> bool {
    let Taken::SensorsShifted(channels, kpa) = taken else { return false };
    let near_kpa = NEAR_AIR * rig.atmosphere.pressure_kpa_abs;
    let is_far = |channel: &usize| mended.lowest_kpa.get(*channel).is_none_or(|[_, simulated]| *simulated > near_kpa);
    *kpa < 0.0 && channels.iter().all(is_far)
}

/// All ways to take a recording that are tried, as it stands first.
fn trials(rig: &Rig, records: &Records, record: usize, commands: &[Command<'_>]) -> Vec<Taken> {
    let numbers = |command: &Command<'_>| records.input(record, command.column).unwrap_or_default();
    let moves = |command: &&Command<'_>| deviation(numbers(command).iter().copied()) > MOVES;
    let is_share = |command: &&Command<'_>| numbers(command).iter().all(|u| (0.0..=1.0).contains(u));
    // A relay that is off throughout says as much as one that switches.
    let is_off = |command: &&Command<'_>| command.is == Is::Relay && numbers(command).iter().all(|u| !is_on(*u));
    let may_turn = |command: &&Command<'_>| moves(command) || is_off(command);
    let turning: Vec<usize> = commands.iter().filter(may_turn).filter(is_share).map(|command| command.input).collect();
    let mut all = vec![Taken::AsItStands];
    let pairs = |of: &[usize]| -> Vec<[usize; 2]> {
        of.iter().enumerate().flat_map(|(k, one)| of.iter().skip(k + 1).map(|other| [*one, *other])).collect()
    };
    if turning.len() <= COMBINED {
        for combination in 1..1_usize << turning.len() {
            let inputs =
                turning.iter().enumerate().filter(|(k, _)| (combination >> k) & 1 == 1).map(|(_, input)| *input);
            all.push(Taken::CommandsInverted(inputs.collect()));
        }
    } else {
        all.extend(turning.iter().map(|input| Taken::CommandsInverted(vec![*input])));
        all.push(Taken::CommandsInverted(turning));
    }
    let moving = commands.iter().filter(moves).map(|command| command.input).collect::<Vec<_>>();
    // Nobody takes a relay for a duty.
    let duties = commands.iter().filter(|command| command.is != Is::Relay);
    let inputs: Vec<usize> = duties.map(|command| command.input).collect();
    let with_one_that_moves = pairs(&inputs).into_iter().filter(|pair| pair.iter().any(|input| moving.contains(input)));
    all.extend(with_one_that_moves.map(Taken::CommandsExchanged));
    let channels: Vec<usize> = (0..records.sensors().len()).collect();
    all.extend(shifts(rig, records, record, &channels));
    all.extend(pairs(&channels).into_iter().map(Taken::SensorsExchanged));
    all.truncate(MOST_TRIALS);
    all
}

/// An atmosphere taken away from each sensor and from all, and added to those that something is taken away from already.
fn shifts(rig: &Rig, records: &Records, record: usize, channels: &[usize]) -> Vec<Taken> {
    let atmosphere_kpa = rig.atmosphere.pressure_kpa_abs;
    let is_taken_away = |channel: &usize| zero_kpa(rig, records, record, *channel).is_some();
    let (lowered, plain): (Vec<usize>, Vec<usize>) = channels.iter().copied().partition(is_taken_away);
    let mut all = Vec::new();
    for (of, kpa) in [(plain, -atmosphere_kpa), (lowered, atmosphere_kpa)] {
        all.extend(of.iter().map(|channel| Taken::SensorsShifted(vec![*channel], kpa)));
        if of.len() > 1 {
            all.push(Taken::SensorsShifted(of, kpa));
        }
    }
    all
}

/// The reading of a channel at zero (kPa), where its file or map takes an atmosphere away.
fn zero_kpa(rig: &Rig, records: &Records, record: usize, channel: usize) -> Option<f64> {
    let column = records.sensors().get(channel)?;
    let said = records.records().get(record)?.file_unit(column).map(|unit| unit.zero);
    let terms = rig.recording.as_ref().and_then(|map| map.columns.get(column));
    let offset: f64 = terms.map_or(0.0, |terms| terms.0.iter().map(|term| term.offset).sum());
    let zero = said.filter(|zero| *zero != 0.0).unwrap_or(offset);
    let atmosphere_kpa = rig.atmosphere.pressure_kpa_abs;
    ((zero + atmosphere_kpa).abs() < ATMOSPHERE * atmosphere_kpa).then_some(zero)
}

/// Duties of valves and pumps of a rig, and relays of its pumps.
fn commands<'r>(rig: &'r Rig, records: &Records) -> Vec<Command<'r>> {
    let valves = rig.valves.values().map(|valve| (valve.command.as_str(), Is::Valve));
    let pumps = rig.pumps.values().filter_map(|pump| match pump {
        Pump::Flow(pump) => pump.command.as_deref().map(|command| (command, Is::Pump)),
        Pump::Piston(pump) => pump.relay.as_deref().map(|relay| (relay, Is::Relay)),
    });
    let mut commands: Vec<Command<'r>> = Vec::new();
    for (column, is) in valves.chain(pumps) {
        let input = records.inputs().iter().position(|input| input.column == column);
        // Several valves may follow one command.
        if let Some(input) = input.filter(|input| commands.iter().all(|command| command.input != *input)) {
            commands.push(Command { input, column, is });
        }
    }
    commands
}

/// Findings of one recording.
struct Told<'a> {
    rig: &'a Rig,
    records: &'a Records,
    record: usize,
    commands: &'a [Command<'a>],
    severity: Severity,
}

impl Told<'_> {
    /// Says what is wrong where this explains the recording.
    fn findings(&self, taken: &Taken) -> Vec<Finding> {
        let command = |input: &usize| self.commands.iter().find(|command| command.input == *input);
        match taken {
            Taken::CommandsInverted(inputs) => {
                let of = |command: &Command<'_>| inverted(self.rig, &self.source(), command.column, command.is);
                inputs.iter().filter_map(command).map(of).collect()
            }
            Taken::CommandsExchanged([one, other]) => {
                let pair = command(one).zip(command(other));
                let of = |(one, other): (&Command<'_>, &Command<'_>)| {
                    self.exchanged(Trouble::SwappedDuties, one.column, other.column)
                };
                pair.map(of).into_iter().collect()
            }
            Taken::SensorsExchanged([one, other]) => {
                let pair = self.records.sensors().get(*one).zip(self.records.sensors().get(*other));
                pair.map(|(one, other)| self.exchanged(Trouble::SwappedPressures, one, other)).into_iter().collect()
            }
            Taken::SensorsShifted(channels, kpa) => {
                channels.iter().filter_map(|channel| self.shifted(*channel, *kpa)).collect()
            }
            Taken::AsItStands | Taken::SensorsMeant(..) => Vec::new(),
        }
    }

    fn source(&self) -> String {
        self.records.records().get(self.record).map_or_else(String::new, |record| record.source.clone())
    }

    fn exchanged(&self, trouble: Trouble, one: &str, other: &str) -> Finding {
        let which = if trouble == Trouble::SwappedDuties { "commands" } else { "columns" };
        let keys = exchanged_keys(self.rig, one, other);
        Finding {
            source: self.source(),
            column: format!("{one}, {other}"),
            severity: Severity::Unusable,
            trouble,
            text: format!(
                "the {which} {one} and {other} seem to be swapped: exchanged, they are what the rig would do, and as they stand they are not: \
                 {keys}"
            ),
        }
    }

    /// An atmosphere too much (`kpa` below zero) or too little in a channel.
    fn shifted(&self, channel: usize, kpa: f64) -> Option<Finding> {
        let column = self.records.sensors().get(channel)?;
        let atmosphere_kpa = self.rig.atmosphere.pressure_kpa_abs;
        let file_unit = self.records.records().get(self.record)?.file_unit(column);
        let scale = |meaning: Meaning| meaning.line(None, file_unit, atmosphere_kpa).map(|[scale, _]| scale);
        let read = scale(RIGHT)?;
        let as_read = |meaning: &Meaning| scale(*meaning).is_some_and(|scale| (scale / read - 1.0).abs() < 1e-3);
        let (words, meaning) = if kpa < 0.0 {
            let absolute = Meaning::wrong().filter(|meaning| matches!(meaning, Meaning::Absolute(..))).find(as_read);
            (format!("the pressure seems to be absolute; subtract the atmosphere's {atmosphere_kpa:.1} kPa"), absolute)
        } else {
            let gauge = Meaning::wrong().filter(|meaning| matches!(meaning, Meaning::Gauge(..))).chain([AS_WRITTEN]);
            let said = "the pressure seems to be gauge already, and an atmosphere is taken away from it".to_owned();
            (said, file_unit.and_then(|_| gauge.into_iter().find(as_read)))
        };
        let key = meaning.map_or_else(
            || shifted_key(self.rig, column, kpa),
            |meaning| pressure_key(self.rig, column, meaning, file_unit),
        );
        Some(Finding {
            source: self.source(),
            column: column.clone(),
            severity: self.severity,
            trouble: if kpa < 0.0 { Trouble::Absolute } else { Trouble::WrongUnit },
            text: format!("{words}: that is what the rig would do, and as it stands it is not: {key}"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_told_already_is_not_told_again() {
        let finding = |source: &str, trouble| Finding {
            source: source.to_owned(),
            column: "u".to_owned(),
            severity: Severity::Unusable,
            trouble,
            text: String::new(),
        };
        let (a, b) = (finding("a.csv", Trouble::InvertedDuty), finding("b.csv", Trouble::WrongUnit));
        let mut findings = vec![a.clone(), b.clone()];
        put_instead(vec![a.clone()], Trouble::WrongUnit, &mut findings);
        assert_eq!(findings, [a.clone(), b]);
        // Another unit in the same file is what an inverted command looks like.
        let mut findings = vec![finding("a.csv", Trouble::WrongUnit)];
        put_instead(vec![a.clone()], Trouble::WrongUnit, &mut findings);
        assert_eq!(findings, [a]);
    }
}
