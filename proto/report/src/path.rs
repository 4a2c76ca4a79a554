//! Paths of curves: the parts between holes, and their points in tenths of a pixel.

use std::fmt::Write;

/// Runs of points without a hole; `sound` says whether the y of an index can be drawn.
pub(crate) fn parts(x: &[f64], sound: impl Fn(usize) -> bool) -> Vec<std::ops::Range<usize>> {
    let mut parts = Vec::new();
    let mut start = None;
    for (index, value) in x.iter().enumerate() {
        match (value.is_finite() && sound(index), start) {
            (true, None) => start = Some(index),
            (false, Some(from)) => {
                parts.push(from..index);
                start = None;
            }
            _ => {}
        }
    }
    if let Some(from) = start {
        parts.push(from..x.len());
    }
    parts
}

/// An SVG path in whole tenths of a pixel, each point relative to the one before.
#[derive(Default)]
pub(crate) struct Path {
    pub(crate) text: String,
    at: (i64, i64),
}

impl Path {
    pub(crate) fn jump(&mut self, x: f64, y: f64) {
        self.at = tenths(x, y);
        let _ = write!(self.text, "M{} {}", self.at.0, self.at.1);
    }

    pub(crate) fn go(&mut self, x: f64, y: f64) {
        let to = tenths(x, y);
        let (dx, dy) = (to.0 - self.at.0, to.1 - self.at.1);
        // Differences of rounded points: no error adds up along the path.
        let _ = match (dx, dy) {
            (0, 0) => return,
            (_, 0) => write!(self.text, "h{dx}"),
            (0, _) => write!(self.text, "v{dy}"),
            (_, 0..) => write!(self.text, "l{dx} {dy}"),
            _ => write!(self.text, "l{dx}{dy}"),
        };
        self.at = to;
    }

    pub(crate) fn dot(&mut self) {
        self.text.push_str("h0");
    }
}

fn tenths(x: f64, y: f64) -> (i64, i64) {
    ((x * 10.0).round() as i64, (y * 10.0).round() as i64)
}
