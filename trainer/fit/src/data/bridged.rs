//! Straight lines in place of numbers that are missing or left out.

/// Puts straight lines in place of the numbers that are left out; before the first and behind the last of the others theirs.
pub(super) fn lines_over(values: &mut [f64], left_out: &[bool]) {
    let is_out = |row: &usize| left_out.get(*row) == Some(&true);
    let kept: Vec<usize> = (0..values.len()).filter(|row| !is_out(row)).collect();
    for row in (0..values.len()).filter(is_out) {
        let at = kept.partition_point(|other| *other < row);
        let before = at.checked_sub(1).and_then(|k| kept.get(k)).map(|k| (*k, values[*k]));
        let after = kept.get(at).map(|k| (*k, values[*k]));
        match (before, after) {
            (Some((a, x)), Some((b, y))) => values[row] = x + (y - x) * (row - a) as f64 / (b - a) as f64,
            (Some((_, x)), None) | (None, Some((_, x))) => values[row] = x,
            (None, None) => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::lines_over;

    #[test]
    fn lines_go_from_sound_to_sound_reading() {
        let mut values = [9e9, 1.0, 9e9, 9e9, 4.0, 9e9];
        lines_over(&mut values, &[true, false, true, true, false, true]);
        assert_eq!(values, [1.0, 1.0, 2.0, 3.0, 4.0, 4.0]);
    }
}
