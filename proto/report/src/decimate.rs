//! Fewer points for the same picture.
//!
//! A line 840 pixels wide cannot show 15,000 points, but it can show each peak among them. The points
//! are sorted into columns of equal width; of each column the first, the lowest, the highest and the
//! last are kept, in their order. What is drawn then covers the same pixels as the full line.

/// Indices of the points to draw, in order.
///
/// `x` must not decrease and hold no NaN; points where `y` is not finite must not be in it (break the
/// line there and call this for each part). Everything is kept when there are no more than
/// `4 · columns` points.
///
/// The first and last point are always kept, and so are the lowest and highest of every column.
pub fn decimate(x: &[f64], y: &[f64], columns: usize) -> Vec<usize> {
    let points = x.len().min(y.len());
    let (Some(first), Some(last)) = (x.first(), x.get(points.saturating_sub(1))) else { return Vec::new() };
    if points <= 4 * columns || columns == 0 || last <= first {
        return (0..points).collect();
    }
    let width = (last - first) / columns as f64;
    let column_of = |x: f64| (((x - first) / width) as usize).min(columns - 1);

    let mut kept = Vec::with_capacity(4 * columns);
    let mut column = Column::at(0);
    let mut current = 0;
    for (index, (x, value)) in x.iter().zip(y).enumerate() {
        if column_of(*x) != current {
            column.push_to(&mut kept);
            column = Column::at(index);
            current = column_of(*x);
        }
        column.last = index;
        if y.get(column.lowest).is_some_and(|lowest| value < lowest) {
            column.lowest = index;
        }
        if y.get(column.highest).is_some_and(|highest| value > highest) {
            column.highest = index;
        }
    }
    column.push_to(&mut kept);
    kept
}

/// The indices that stand for a column of points.
struct Column {
    first: usize,
    lowest: usize,
    highest: usize,
    last: usize,
}

impl Column {
    fn at(index: usize) -> Self {
        Self { first: index, lowest: index, highest: index, last: index }
    }

    fn push_to(&self, kept: &mut Vec<usize>) {
        let (early, late) = (self.lowest.min(self.highest), self.lowest.max(self.highest));
        for index in [self.first, early, late, self.last] {
            if kept.last() != Some(&index) {
                kept.push(index);
            }
        }
    }
}
