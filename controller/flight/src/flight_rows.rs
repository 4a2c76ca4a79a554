//! A flight's ticks on its time axis, with a row without a tick wherever some are missing.
//!
//! A line drawn over the rows then breaks where nothing was recorded, instead of running straight on.

use proto::recording::TickRecord;

use crate::flight_info::NoteTime;
use crate::statistics::{FlightStatistics, Pacing, Place, StatisticsOptions};

/// A tick with its place.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row<'a> {
    pub(crate) tick: &'a TickRecord,
    pub(crate) place: Place,
}

/// A flight, laid out for plots.
#[derive(Debug)]
pub(crate) struct Flight<'a> {
    pub(crate) statistics: FlightStatistics,
    // `None` is a hole; its time lies just after the row before.
    rows: Vec<(f64, Option<Row<'a>>)>,
}

impl<'a> Flight<'a> {
    pub(crate) fn new(ticks: &'a [TickRecord], options: StatisticsOptions) -> Self {
        let mut statistics = FlightStatistics::new(options);
        let mut rows: Vec<(f64, Option<Row<'a>>)> = Vec::with_capacity(ticks.len());
        for tick in ticks {
            let place = statistics.push(tick);
            if place.moment.step > 1 {
                rows.push((place.moment.time_s - 0.02, None));
            }
            rows.push((place.moment.time_s, Some(Row { tick, place })));
        }
        Self { statistics, rows }
    }

    /// Rows with a tick.
    pub(crate) fn rows(&self) -> impl Iterator<Item = Row<'a>> {
        self.rows.iter().filter_map(|(_, row)| *row)
    }

    /// Time of every row, holes included (s).
    pub(crate) fn time_s(&self) -> Vec<f64> {
        self.rows.iter().map(|(time_s, _)| *time_s).collect()
    }

    /// A column over [`Flight::time_s`]; NaN in holes.
    pub(crate) fn column(&self, value: impl Fn(&TickRecord) -> f64) -> Vec<f64> {
        self.rows.iter().map(|(_, row)| row.map_or(f64::NAN, |row| value(row.tick))).collect()
    }

    /// A column that holds only where a row passes; NaN elsewhere.
    pub(crate) fn column_where(
        &self,
        passes: impl Fn(&Row<'_>) -> bool,
        value: impl Fn(&TickRecord) -> f64,
    ) -> Vec<f64> {
        let cell = |row: &Option<Row<'_>>| row.filter(&passes).map_or(f64::NAN, |row| value(row.tick));
        self.rows.iter().map(|(_, row)| cell(row)).collect()
    }

    /// Rows that count for tracking.
    pub(crate) fn tracked(&self) -> Vec<bool> {
        self.rows.iter().map(|(_, row)| row.is_some_and(|row| row.place.tracked)).collect()
    }

    /// Stretches of neighbouring rows that pass: first and last time (s), rows in it.
    pub(crate) fn stretches(&self, passes: impl Fn(&Row<'a>) -> bool) -> Vec<Vec<Row<'a>>> {
        let mut stretches: Vec<Vec<Row<'a>>> = Vec::new();
        let mut within = false;
        for (_, row) in &self.rows {
            match row.filter(&passes) {
                Some(row) if within => {
                    if let Some(stretch) = stretches.last_mut() {
                        stretch.push(row);
                    }
                }
                Some(row) => stretches.push(vec![row]),
                None => {}
            }
            within = row.as_ref().is_some_and(&passes);
        }
        stretches
    }

    /// Place of something that was said on the time axis (s).
    pub(crate) fn time_of(&self, at: NoteTime) -> f64 {
        let at_ns = match at {
            NoteTime::FlightS(time_s) => return time_s.clamp(0.0, self.statistics.seconds()),
            NoteTime::MonotonicNs(at_ns) => at_ns,
        };
        let before = self.rows().take_while(|row| row.tick.receive_ns <= at_ns).last();
        before.map_or(0.0, |row| match self.statistics.options.pacing {
            Pacing::Realtime => row.place.moment.time_s + (at_ns - row.tick.receive_ns) as f64 / 1e9,
            Pacing::Lockstep => row.place.moment.time_s,
        })
    }
}
