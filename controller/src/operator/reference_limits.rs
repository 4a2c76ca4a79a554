//! Distance that a reference must keep from the safety envelope.
//!
//! A controller does not hold a pressure to the last pascal: around its reference it ripples, and a reference nearer to a
//! limit than that ripple opens the vents by itself. So a reference is refused within [`RIPPLE_KPA`] of a limit and
//! remarked on within [`ROOM_KPA`].

use law::course::SHORTEST_REPEATED_S;
use proto::reference::Reference;

use crate::config::{ReferenceChoice, Safety};

/// Nearer to a limit than this the ripple of a settled controller alone trips it, in kPa. Measured: the largest error of
/// the fallback after 5 s on the paper's reference, rig `bench`, is 1.45 kPa (`controller demo --fast --policy fallback`).
pub const RIPPLE_KPA: f64 = 1.5;
/// Nearer than this an overshoot after a step may trip it, in kPa: chosen, twice the ripple.
pub const ROOM_KPA: f64 = 3.0;

/// A change of the reference from its end to its beginning that is remarked on, in kPa: chosen, what a controller needs a second for.
const STEP_KPA: f64 = 0.5;

/// Examines a reference before it is followed, in the same way wherever it comes from: the start, `controller check`, an
/// operator, a configuration that was read again. Answers what a person should know of it, each in one clause.
///
/// # Errors
/// Why it is not to be followed, in one clause.
pub fn examine(reference: &Reference, safety: &Safety, choice: &ReferenceChoice) -> Result<Vec<String>, String> {
    let close = match margin(reference, safety) {
        Margin::Wide => None,
        Margin::Close(remark) => Some(remark),
        Margin::Beyond(why) => return Err(why),
    };
    match too_short_to_repeat(reference, choice) {
        Some(why) => Err(why),
        None => Ok(close.into_iter().chain(step_at_end(reference, choice)).collect()),
    }
}

/// Judgement of a reference by its distance from the safety envelope.
#[derive(Debug, Clone, PartialEq)]
enum Margin {
    /// Far enough.
    Wide,
    /// Near enough to be remarked on: the remark.
    Close(String),
    /// Not to be followed: why, in one clause.
    Beyond(String),
}

/// Judges a reference by the limits.
fn margin(reference: &Reference, safety: &Safety) -> Margin {
    let [[_, highest], [lowest, _]] = reference.range_kpa();
    let sides = [
        (safety.max_pos_kpa - highest, highest, "max_pos_kpa", safety.max_pos_kpa),
        (lowest - safety.min_neg_kpa, lowest, "min_neg_kpa", safety.min_neg_kpa),
    ];
    // The nearer side is the one to tell.
    let (room, worst, key, limit) = sides.into_iter().reduce(|a, b| if b.0 < a.0 { b } else { a }).unwrap_or(sides[0]);
    let at = format!("it goes to {worst:.1} kPa");
    if room < 0.0 {
        Margin::Beyond(format!(
            "it leaves the safety envelope: {at}, beyond safety.{key} = {limit} kPa; change the one or the other"
        ))
    } else if room < RIPPLE_KPA {
        Margin::Beyond(format!(
            "{at}, only {room:.1} kPa inside the safety envelope (safety.{key} = {limit} kPa): the ripple of a settled controller, up to {RIPPLE_KPA} kPa, would trip it; change the one or the other"
        ))
    } else if room < ROOM_KPA {
        Margin::Close(format!(
            "{at}, {room:.1} kPa inside the safety envelope (safety.{key} = {limit} kPa): an overshoot may trip it; leave {ROOM_KPA} kPa"
        ))
    } else {
        Margin::Wide
    }
}

/// Reason why a reference cannot be repeated although that is asked for, in one clause.
fn too_short_to_repeat(reference: &Reference, choice: &ReferenceChoice) -> Option<String> {
    (choice.repeat && reference.end_s() < SHORTEST_REPEATED_S).then(|| {
        format!(
            "it lasts {:.1} s, and reference.repeat needs {SHORTEST_REPEATED_S} s at least; write a longer period, or leave reference.repeat out to hold its last row",
            reference.end_s()
        )
    })
}

/// Remark on a reference that is repeated and does not end where it begins.
fn step_at_end(reference: &Reference, choice: &ReferenceChoice) -> Option<String> {
    let ([pos, neg], [pos_first, neg_first]) = (reference.at(reference.end_s()), reference.at(0.0));
    let steps = (pos - pos_first).abs() > STEP_KPA || (neg - neg_first).abs() > STEP_KPA;
    (choice.repeat && steps).then(|| {
        format!(
            "it ends at {pos:.1}/{neg:.1} kPa and begins again at {pos_first:.1}/{neg_first:.1} kPa, a step each time; let it end where it begins for none"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn room_decides_on_the_nearer_side() {
        let safety = Safety { max_pos_kpa: 160.0, min_neg_kpa: -95.0 };
        let judged = |pos, neg| margin(&Reference::constant(pos, neg), &safety);
        assert_eq!(judged(100.0, -75.0), Margin::Wide);
        for (pos, neg, words) in [
            (161.0, -75.0, "safety.max_pos_kpa = 160"),
            (100.0, -95.1, "safety.min_neg_kpa = -95"),
            (100.0, -94.5, "only 0.5 kPa inside"),
            (159.5, -75.0, "only 0.5 kPa inside"),
        ] {
            let Margin::Beyond(why) = judged(pos, neg) else { panic!("{pos}/{neg}: {:?}", judged(pos, neg)) };
            assert!(why.contains(words), "{why}");
        }
        let Margin::Close(why) = judged(158.0, -75.0) else { panic!("{:?}", judged(158.0, -75.0)) };
        assert!(why.contains("2.0 kPa inside"), "{why}");
    }

    #[test]
    fn a_repeated_reference_needs_its_length_and_is_told_its_step() {
        let parse =
            |rows: &str| Reference::parse("r", format!("time_s,ref_pos_kpa,ref_neg_kpa\n{rows}").as_bytes()).unwrap();
        let examined = |reference: &Reference, repeat| {
            examine(reference, &Safety::default(), &ReferenceChoice { repeat, ..ReferenceChoice::default() })
        };
        let short = parse("0,85,-70\n0.1,85,-70\n");
        assert_eq!(examined(&short, false), Ok(Vec::new()));
        assert!(examined(&short, true).unwrap_err().contains("it lasts 0.1 s"));
        let steps = parse("0,85,-70\n10,158,-70\n");
        assert_eq!(examined(&steps, false).unwrap().len(), 1, "only that it is close");
        let told = examined(&steps, true).unwrap();
        assert!(told.len() == 2 && told[0].contains("2.0 kPa inside") && told[1].contains("a step"), "{told:?}");
    }
}
