//! Mechanisms that stick and slip, found in pieces.
//!
//! A slip that comes an instant late puts off all that follow: over a whole recording a band that is nearly right fits no better
//! than a wrong one, and gains in one stretch what it loses in another. Measured on a flapper that sticks over 0.0833 of duty: free
//! runs of the whole recordings are off by 1.4 kPa at 0.0800 and by 1.7 at 0.0833, where the other parameters are not yet right, by
//! 2.1 to 3.1 without friction. In pieces of four seconds, each from its own first pressures and with the flapper lying where it
//! fits best, the right band leaves 0.1 kPa and wrong ones 1.1 to 1.5; and there it is judged.

use fit::cores::side_by_side;

use super::stepped::{STEPS_IN_PIECES, Spot, scanned, sharpened};
use super::terms::is_open;
use super::worth::earns_its_place;
use super::{SearchSettings, cost, with};
use crate::bench::{Bench, Effort, Explanation};
use crate::error::DiagnoseError;
use crate::judge::evidence::evidence;
use crate::judge::{explains_most, left};
use crate::recordings::pieces::{pieces, taken};
use crate::search::candidate::Candidate;

/// The most mechanisms that are looked for.
const LOOKED_FOR: usize = 2;
/// Places that are fitted, of all that were looked at.
const FITTED: usize = 4;

/// Looks for what moves in steps on top of `base`, in pieces of the recordings: for those of `tried` that fitted best, or for that
/// of `top`, which the whole recordings put there, in any shape that it has. Fitted to these from where it was found; `None`
/// where nothing of the kind explains most of what the pieces show, or `top` does so better.
pub(super) fn in_pieces(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    base: &Explanation,
    settings: &SearchSettings,
    tried: &[Explanation],
    top: Option<&Explanation>,
    tell: &mut dyn FnMut(&str, f64),
) -> Result<Option<Explanation>, DiagnoseError> {
    let asked = |k: &usize| top.is_none_or(|top| top.terms == with(&base.terms, *k));
    let open = |k: &usize| candidates[*k].stepped() && is_open(bench, candidates, &base.terms, *k);
    let best_of = |k: usize| {
        let of_it = tried.iter().filter(|e| e.terms == with(&base.terms, k));
        of_it.map(|e| cost(bench, e)).min_by(f64::total_cmp)
    };
    let mut sticking: Vec<(usize, f64)> =
        (0..candidates.len()).filter(open).filter(asked).filter_map(|k| Some((k, best_of(k)?))).collect();
    sticking.sort_by(|a, b| a.1.total_cmp(&b.1));
    sticking.truncate(LOOKED_FOR);
    // Whole recordings do not tell either what it is that rubs there.
    let shaped = |k: &usize| sticking.iter().any(|(of, _)| of == k || candidates[*of].excludes(&candidates[*k]));
    let sticking: Vec<usize> = (0..candidates.len()).filter(open).filter(shaped).collect();
    if sticking.is_empty() {
        return Ok(None);
    }
    let (records, readings) = pieces(bench.records);
    let short = bench.over(&records, &taken(bench.counted(), &readings), bench.simulator.fidelity());
    let before = short.fit(candidates, &base.terms, std::slice::from_ref(&base.fitted.point), Effort::Polish)?;
    let mut places = Vec::new();
    for (done, k) in sticking.iter().enumerate() {
        tell("looking for what sticks", done as f64 / sticking.len() as f64);
        let middle = candidates[*k].middle_start();
        let found = scanned(&short, candidates, &before, (*k, &middle), STEPS_IN_PIECES);
        places.extend(found.into_iter().map(|place| (with(&base.terms, *k), place)));
    }
    places.sort_by(|a, b| b.1.gain.total_cmp(&a.1.gain));
    places.truncate(FITTED);
    let fit = |(terms, place): &(Vec<usize>, Spot)| {
        short.fit(candidates, terms, std::slice::from_ref(&place.start), Effort::Polish).ok()
    };
    let fitted = side_by_side(&places, fit).into_iter().flatten();
    let best = fitted.min_by(|a, b| cost(&short, a).total_cmp(&cost(&short, b)));
    let Some(found) = best else { return Ok(None) };
    let explained = explains_most(&left(&short, &before), &left(&short, &found));
    let earned = || {
        earns_its_place(&short, candidates, settings, &evidence(&short, &found, &before), [&found, &before, &before])
    };
    if !explained || !earned() {
        return Ok(None);
    }
    let found = sharpened(&short, candidates, found, &base.terms)?;
    // The pieces judge: over whole recordings a wrong band may be ahead of the right one.
    let as_it_is =
        top.map(|top| short.fit(candidates, &top.terms, std::slice::from_ref(&top.fitted.point), Effort::Polish));
    if as_it_is.is_some_and(|top| top.is_ok_and(|top| cost(&short, &top) <= cost(&short, &found))) {
        return Ok(None);
    }
    let whole = bench.fit(candidates, &found.terms, std::slice::from_ref(&found.fitted.point), Effort::Polish)?;
    Ok((cost(bench, &whole) < cost(bench, base)).then_some(whole))
}

#[cfg(test)]
mod tests {
    use fit::data::Records;

    use super::*;
    use crate::made::{self, made_after, moved};
    use crate::search::candidate::candidates;
    use crate::search::values_of;

    /// Only the plunger was tried for a flapper that sticks, over a band that is a third too small.
    #[test]
    fn what_rubs_is_told_in_pieces_whatever_was_tried() {
        let (rig, mut truth) = moved(&[("valves.valve_neg.input_area_mm2", 1.02), ("volumes.negative.volume_l", 0.97)]);
        let all = candidates(&rig);
        let of = |form: &str| all.iter().position(|c| c.name() == "valve_stiction:negative" && c.form == form).unwrap();
        let (plunger, flapper) = (of(""), of("flapper"));
        truth.mechanisms.push(all[flapper].attached(&[0.045, 0.15]));
        let records = Records::new(&rig, &made_after(150, 1500, &truth, 2, 5)).unwrap();
        let bench = made::bench(&rig, &records);
        let base = bench.fit(&all, &[], &[vec![0.0; bench.nominal.len()]], Effort::Polish).unwrap();
        let mut start = base.fitted.point.clone();
        start.extend(all[plunger].parameters(0).iter().zip([0.03, 0.0]).map(|(p, value)| p.coordinate(value)));
        let tried = bench.fit(&all, &[plunger], &[start], Effort::Polish).unwrap();
        let settings = made::for_what_stands_out();
        let found = in_pieces(&bench, &all, &base, &settings, &[tried], None, &mut |_, _| ()).unwrap().unwrap();
        assert_eq!(found.terms, [flapper]);
        let band = values_of(&bench, &all, &found, flapper).unwrap()[0];
        // Slips come at the right rows within about this.
        assert!((band / 0.045 - 1.0).abs() < 0.03, "{band}");
    }
}
