//! The course that matches best.

use std::ops::Range;

use super::laid::{Laid, WINDOWS};
use crate::cores::side_by_side;
use crate::simulate::course::{BESIDES, BESIDES_STEP, Course, Droop, Warming, besides, coarse_droops};
use crate::simulate::windows::Piece;

/// Rows of a window in which speeds are told half as well as in the shortest of [`WINDOWS`].
const SHORT: usize = 25;
/// Share of the ripple's energy that a course with one number more must gain.
const WORTH: f64 = 0.02;

impl Laid {
    /// The best of each plain kind refined; more numbers must be worth it. With it, the product that any course has by chance,
    /// by recording: most of a grid is wrong.
    pub(super) fn best_course(&self) -> (Course, Vec<f64>) {
        let mut products: Vec<Vec<f64>> = vec![Vec::new(); self.pieces.len()];
        let mut of_kind = |courses: Vec<Course>| {
            let mut most: Option<(f64, Course)> = None;
            let all_matched = side_by_side(&courses, |course| self.matches(*course, WINDOWS[0]));
            for (course, matched) in courses.into_iter().zip(all_matched) {
                let gain = matched.iter().map(|m| m.gain).sum();
                for (all, m) in products.iter_mut().zip(&matched) {
                    all.push(m.product);
                }
                if most.is_none_or(|(best, _)| gain > best) {
                    most = Some((gain, course));
                }
            }
            most
        };
        let kinds = Course::grid().map(&mut of_kind);
        let energy: f64 = self.pieces.iter().map(|p| self.matched(p, Course::constant(0.1), WINDOWS[2]).energy).sum();
        let mut best: Option<(f64, Course)> = None;
        for (_, course) in kinds.into_iter().flatten() {
            let refined = self.refined(self.slid(course));
            let gain = self.gain(refined, WINDOWS[2]);
            if best.is_none_or(|(most, _)| gain > most + WORTH * energy) {
                best = Some((gain, refined));
            }
        }
        let chance = products.iter_mut().map(|of| {
            of.sort_by(f64::total_cmp);
            of.get(of.len() / 2).copied().unwrap_or(0.0)
        });
        (best.map_or(Course::default(), |(_, course)| course), chance.collect())
    }

    /// The best of the courses that turn as fast under the mean load as one that droops from the stated speed: a pump that is slow and
    /// droops little goes that way too, and a climb from there is long.
    fn slid(&self, course: Course) -> Course {
        let load_bar = mean_load_bar(&self.pieces);
        let Some(droop) = course.droop.filter(|_| load_bar > 0.0) else { return course };
        let under_load = 1.0 - droop.per_bar * load_bar;
        let slides = besides().into_iter().filter_map(|share| {
            let per_bar = (1.0 - under_load / (1.0 + share)) / load_bar;
            (per_bar > 0.0).then_some(Course { share, droop: Some(Droop { per_bar, ..droop }), ..course })
        });
        let all: Vec<Course> = std::iter::once(course).chain(slides).collect();
        best_of(&all, |course| self.gain(course, WINDOWS[0])).map_or(course, |(_, course)| course)
    }

    /// The best course of a pump that droops and turns at another speed besides, be it all the time or as it warms.
    ///
    /// That has five numbers, too many for a grid. But in a window of half a second a pump that warms turns at one speed: how each
    /// window of the longest recording is matched with each droop and each share is worked out once, and every course then is a path
    /// through those. The best is refined over all recordings.
    pub(super) fn best_of_both(&self) -> Option<Course> {
        let lasts = |piece: &&Piece| piece.lasts_s();
        let longest = self.pieces.iter().max_by(|a, b| lasts(a).total_cmp(&lasts(b)))?;
        let middle = |window: Range<usize>| longest.time_s.get((window.start + window.end) / 2).copied().unwrap_or(0.0);
        let middles_s: Vec<f64> = longest.windows(SHORT, SHORT).map(middle).collect();
        let (shares, paths) = (besides(), Course::besides());
        let nearest = |share: f64| {
            let at = ((share + BESIDES) / BESIDES_STEP).round().max(0.0) as usize;
            at.min(shares.len().saturating_sub(1))
        };
        let through: Vec<Vec<usize>> =
            paths.iter().map(|path| path.shares(&middles_s, &[]).into_iter().map(nearest).collect()).collect();
        let tried = side_by_side(&coarse_droops(), |droop| {
            let with = |share: &f64| Course { share: *share, droop: Some(*droop), warming: None };
            let gains: Vec<Vec<f64>> = shares.iter().map(|share| self.gains(longest, with(share), SHORT)).collect();
            let along = |way: &Vec<usize>| -> f64 {
                way.iter().enumerate().filter_map(|(window, share)| gains.get(*share)?.get(window)).sum()
            };
            let of = |(path, way): (&Course, &Vec<usize>)| (along(way), Course { droop: Some(*droop), ..*path });
            paths.iter().zip(&through).map(of).max_by(|a, b| a.0.total_cmp(&b.0))
        });
        let best = tried.into_iter().flatten().max_by(|a, b| a.0.total_cmp(&b.0));
        let load_bar = mean_load_bar(&self.pieces);
        let near =
            |course| climb(course, load_bar, [(SHORT, [1.0, 0.5, 0.25])], |course, rows| self.gain(course, rows));
        best.map(|(_, course)| self.refined(near(course)))
    }

    /// Climbs from a course over all recordings, windows growing as its steps shrink.
    fn refined(&self, course: Course) -> Course {
        let steps = WINDOWS.into_iter().zip([[0.5, 0.25, 0.12], [0.12, 0.06, 0.03], [0.03, 0.015, 0.007]]);
        climb(course, mean_load_bar(&self.pieces), steps, |course, rows| self.gain(course, rows))
    }

    /// The course as each recording by itself tells it, all its numbers: a faster pump that droops more is nearly the same.
    fn by_recording(&self, course: Course) -> Vec<Course> {
        let steps = [(WINDOWS[1], [0.25, 0.06, 0.015]), (WINDOWS[2], [0.06, 0.015, 0.004])];
        let own = |piece: &Piece| {
            let load_bar = mean_load_bar(std::slice::from_ref(piece));
            climb(course, load_bar, steps, |course, rows| self.matched(piece, course, rows).gain)
        };
        side_by_side(&self.pieces, own)
    }

    /// Standard errors of a course's numbers, in their places, from the scatter between recordings.
    pub(super) fn errors(&self, course: Course) -> Course {
        let all = self.by_recording(course);
        let error = |number: &dyn Fn(&Course) -> f64| scatter(&all, number).unwrap_or(ALONE * number(&course).abs());
        let droop = |number: fn(&Droop) -> f64| error(&move |course| course.droop.as_ref().map_or(0.0, number));
        let warming = |number: fn(&Warming) -> f64| error(&move |course| course.warming.as_ref().map_or(0.0, number));
        Course {
            share: error(&|course| course.share),
            droop: course.droop.map(|_| Droop { per_bar: droop(|d| d.per_bar), lag_s: droop(|d| d.lag_s) }),
            warming: course.warming.map(|_| Warming { share: warming(|w| w.share), time_s: warming(|w| w.time_s) }),
        }
    }
}

/// Share of a number that a single recording is taken to be off by: it has nothing to be compared with.
const ALONE: f64 = 0.02;

/// Standard error of the mean of a number of some courses; `None` of fewer than two.
fn scatter(courses: &[Course], number: impl Fn(&Course) -> f64) -> Option<f64> {
    let n = courses.len() as f64;
    let mean = courses.iter().map(&number).sum::<f64>() / n.max(1.0);
    let variance = courses.iter().map(|course| (number(course) - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    (courses.len() > 1).then(|| (variance / n).sqrt())
}

/// Load averaged over some recordings, in bar.
fn mean_load_bar(pieces: &[Piece]) -> f64 {
    let loads = || pieces.iter().flat_map(|piece| &piece.load_bar);
    loads().sum::<f64>() / loads().count().max(1) as f64
}

/// The one of some courses that gains most, and what it gains.
fn best_of(courses: &[Course], gain_of: impl Fn(Course) -> f64 + Sync) -> Option<(f64, Course)> {
    let gains = side_by_side(courses, |course| gain_of(*course));
    gains.into_iter().zip(courses.iter().copied()).max_by(|a, b| a.0.total_cmp(&b.0))
}

/// Steps of one size at most: along a valley as many as a few steps of the size before.
const STEPS: usize = 12;

/// Climbs from a course by steps of these sizes, each with windows of so many rows.
fn climb(
    course: Course,
    load_bar: f64,
    steps: impl IntoIterator<Item = (usize, [f64; 3])>,
    gain_of: impl Fn(Course, usize) -> f64 + Sync,
) -> Course {
    let mut here = course;
    for (rows, sizes) in steps {
        let mut gain = gain_of(here, rows);
        for size in sizes {
            for _ in 0..STEPS {
                match best_of(&here.neighbours(size, load_bar), |course| gain_of(course, rows)) {
                    Some((better, course)) if better > gain => (gain, here) = (better, course),
                    _ => break,
                }
            }
        }
    }
    here
}
