//! Where a row of a channel lies in one long vector of readings.
//!
//! All readings of all recordings, simulated or recorded, are one `Vec<f64>`: recording after recording, in each
//! channel after channel (in the order of the rig's sensors), in each row after row. Residuals, Jacobians and
//! masks have the same layout, so they are combined by plain zips.

use std::ops::Range;

/// The shape of a vector of readings.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layout {
    channels: usize,
    rows: Vec<usize>,
    /// Where each recording starts, and the end of all.
    starts: Vec<usize>,
}

impl Layout {
    /// The layout of recordings with these numbers of rows.
    pub fn new(channels: usize, rows: Vec<usize>) -> Self {
        let mut starts = Vec::with_capacity(rows.len() + 1);
        let mut end = 0;
        starts.push(0);
        for rows in &rows {
            end += channels * rows;
            starts.push(end);
        }
        Layout { channels, rows, starts }
    }

    /// Channels per recording.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Recordings.
    pub fn records(&self) -> usize {
        self.rows.len()
    }

    /// Rows of recording `record`; 0 beyond the last.
    pub fn rows(&self, record: usize) -> usize {
        self.rows.get(record).copied().unwrap_or(0)
    }

    /// Numbers in a vector of this layout.
    pub fn len(&self) -> usize {
        self.starts.last().copied().unwrap_or(0)
    }

    /// Tells whether there are no numbers.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The indices of all rows of a channel of a recording; empty beyond the last.
    pub fn channel(&self, record: usize, channel: usize) -> Range<usize> {
        match (self.starts.get(record), self.rows.get(record)) {
            (Some(start), Some(rows)) if channel < self.channels => {
                start + channel * rows..start + (channel + 1) * rows
            }
            _ => 0..0,
        }
    }

    /// The indices of some rows of a channel of a recording, cut to those there are.
    pub fn stretch(&self, record: usize, channel: usize, rows: Range<usize>) -> Range<usize> {
        let all = self.channel(record, channel);
        (all.start + rows.start).min(all.end)..(all.start + rows.end).min(all.end)
    }

    /// Every (recording, channel) with its indices, in order.
    pub fn all(&self) -> impl Iterator<Item = (usize, usize, Range<usize>)> + '_ {
        (0..self.records())
            .flat_map(move |record| (0..self.channels).map(move |channel| (record, channel)))
            .map(|(record, channel)| (record, channel, self.channel(record, channel)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_tile_the_vector() {
        let layout = Layout::new(2, vec![3, 5]);
        let ranges: Vec<_> = layout.all().map(|(_, _, range)| range).collect();
        assert_eq!(ranges, [0..3, 3..6, 6..11, 11..16]);
        assert_eq!(layout.len(), 16);
        assert_eq!(layout.stretch(1, 1, 2..4), 13..15);
        assert_eq!(layout.stretch(1, 1, 4..9), 15..16, "cut to the rows there are");
        assert!(layout.channel(2, 0).is_empty() && layout.channel(0, 2).is_empty());
    }
}
