//! The learning curve as it comes: one JSON object a line, and TensorBoard's event file.

use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Write};
use std::path::Path;

use environment::Score;
use serde::{Deserialize, Serialize};

use crate::TrainingError;
use crate::event_file::EventWriter;

/// One point of the learning curve.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Environment steps so far.
    pub step: u64,
    /// Seconds of work so far, over all sittings.
    pub wall_s: f64,
    /// Steps per second since the last point.
    pub steps_per_s: f64,
    /// Share of the time since the last point that went into the environment.
    pub environment_share: f64,
    /// Mean reward per step while acting.
    pub reward: f64,
    /// RMSE while acting, explored actions and drawn references included, in kPa.
    pub acting_rmse_kpa: [f64; 2],
    /// Rigs that left their envelope since the last point.
    pub tripped: u64,
    /// Loss of the critics.
    pub critic_loss: f64,
    /// Loss of the actor.
    pub actor_loss: f64,
    /// Mean value of the actions taken.
    pub mean_q: f64,
    /// Temperature α.
    pub temperature: f64,
    /// Entropy of the policy.
    pub entropy: f64,
    /// Temporal term of CAPS.
    pub caps_temporal: f64,
    /// Spatial term of CAPS.
    pub caps_spatial: f64,
    /// Score by which the best policy is kept, in kPa, where it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub selection_kpa: Option<f64>,
    /// Evaluations with the mean action on the paper's reference, by rig.
    pub evaluated: Vec<Evaluated>,
}

/// One evaluation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evaluated {
    /// The rig.
    pub rig: String,
    /// RMSE of the measured pressures after the first 5 s, in kPa.
    pub rmse_kpa: [f64; 2],
    /// Mean error in kPa.
    pub offset_kpa: [f64; 2],
    /// RMS of the duty's change per tick.
    pub duty_change_rms: [f64; 2],
}

impl Evaluated {
    /// A score under a rig's name.
    pub fn of(rig: &str, score: &Score) -> Self {
        Evaluated {
            rig: rig.to_owned(),
            rmse_kpa: score.rmse_kpa,
            offset_kpa: score.offset_kpa,
            duty_change_rms: score.duty_change_rms,
        }
    }
}

/// Where points go.
#[derive(Debug)]
pub struct Metrics {
    lines: File,
    events: EventWriter<BufWriter<File>>,
    lines_path: String,
}

impl Metrics {
    /// Opens both files for appending.
    ///
    /// # Errors
    /// Names the file that cannot be opened.
    pub fn open(lines: &Path, events: &Path, unix_s: f64) -> Result<Self, TrainingError> {
        let append = |path: &Path| {
            OpenOptions::new().create(true).append(true).open(path).map_err(|error| TrainingError::File {
                file: path.display().to_string(),
                problem: format!("cannot be written: {error}"),
            })
        };
        let failed = |error: std::io::Error| TrainingError::File {
            file: events.display().to_string(),
            problem: format!("cannot be written: {error}"),
        };
        let begun = std::fs::metadata(events).is_ok_and(|m| m.len() > 0);
        let out = BufWriter::new(append(events)?);
        let events = if begun { EventWriter::resume(out) } else { EventWriter::new(out, unix_s).map_err(failed)? };
        Ok(Metrics { lines: append(lines)?, events, lines_path: lines.display().to_string() })
    }

    /// Adds a point.
    ///
    /// # Errors
    /// If the disk is full, by file.
    pub fn add(&mut self, unix_s: f64, point: &Point) -> Result<(), TrainingError> {
        let full = |error: std::io::Error| TrainingError::File {
            file: self.lines_path.clone(),
            problem: format!("cannot be written: {error}; what was written before is kept"),
        };
        let mut line = serde_json::to_string(point).map_err(|error| full(error.into()))?;
        line.push('\n');
        self.lines.write_all(line.as_bytes()).map_err(full)?;
        let mut scalars = vec![
            ("train/reward".to_owned(), point.reward),
            ("train/rmse_pos_kpa".to_owned(), point.acting_rmse_kpa[0]),
            ("train/rmse_neg_kpa".to_owned(), point.acting_rmse_kpa[1]),
            ("speed/steps_per_s".to_owned(), point.steps_per_s),
            ("speed/environment_share".to_owned(), point.environment_share),
            ("loss/critic".to_owned(), point.critic_loss),
            ("loss/actor".to_owned(), point.actor_loss),
            ("loss/mean_q".to_owned(), point.mean_q),
            ("loss/caps_temporal".to_owned(), point.caps_temporal),
            ("loss/caps_spatial".to_owned(), point.caps_spatial),
            ("policy/temperature".to_owned(), point.temperature),
            ("policy/entropy".to_owned(), point.entropy),
        ];
        scalars.extend(point.selection_kpa.map(|score| ("evaluation/selection_kpa".to_owned(), score)));
        for e in &point.evaluated {
            scalars.push((format!("evaluation/{}/rmse_pos_kpa", e.rig), e.rmse_kpa[0]));
            scalars.push((format!("evaluation/{}/rmse_neg_kpa", e.rig), e.rmse_kpa[1]));
        }
        let scalars: Vec<(&str, f64)> = scalars.iter().map(|(tag, value)| (tag.as_str(), *value)).collect();
        self.events.scalars(unix_s, point.step, &scalars).map_err(full)
    }
}

/// Reads the points of a run, up to a step: what a checkpoint goes on from.
///
/// # Errors
/// Names the file and the line that is no point.
pub fn read(lines: &Path, up_to_step: u64) -> Result<Vec<Point>, TrainingError> {
    let file = lines.display().to_string();
    let text = std::fs::read_to_string(lines)
        .map_err(|error| TrainingError::File { file: file.clone(), problem: format!("cannot be read: {error}") })?;
    let mut points = Vec::new();
    for (n, line) in text.lines().enumerate() {
        let point: Point = serde_json::from_str(line)
            .map_err(|error| TrainingError::File { file: file.clone(), problem: format!("line {}: {error}", n + 1) })?;
        if point.step <= up_to_step {
            points.push(point);
        }
    }
    Ok(points)
}
