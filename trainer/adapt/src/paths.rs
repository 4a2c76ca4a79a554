//! Places of files and folders in the folder of an adaptation.

use std::path::PathBuf;

use crate::run::Adaptation;

/// Name of the reference that goes back and forth.
pub(crate) const BACK_AND_FORTH: &str = "back-and-forth.csv";

impl Adaptation {
    /// Folder of what was there before anything was changed.
    pub(crate) fn before_folder(&self) -> PathBuf {
        self.out.join("before")
    }

    /// File of the model that was in force before.
    pub(crate) fn model_before(&self) -> PathBuf {
        self.before_folder().join("model.toml")
    }

    /// File of the operator's reference as it was recorded.
    pub(crate) fn recorded_reference(&self) -> PathBuf {
        self.before_folder().join("reference.csv")
    }

    /// File of the policy that controlled before, where one did.
    pub(crate) fn policy_before(&self) -> PathBuf {
        self.before_folder().join("policy.onnx")
    }

    /// File of the reference that goes back and forth.
    pub(crate) fn back_and_forth_file(&self) -> PathBuf {
        self.out.join(BACK_AND_FORTH)
    }

    /// Folder of the recordings that diagnosis reads.
    pub(crate) fn recordings_folder(&self) -> PathBuf {
        self.out.join("recordings")
    }

    /// File of the experiment of a number, counted from 1.
    pub(crate) fn excitation_file(&self, number: usize) -> PathBuf {
        self.out.join(format!("excitation-{number}.csv"))
    }

    /// Folder of the diagnosis of a round, counted from 1.
    pub(crate) fn found_folder(&self, round: usize) -> PathBuf {
        self.out.join(if round == 1 { "found".to_owned() } else { format!("found-{round}") })
    }

    /// File of the rig that was found last.
    pub(crate) fn found_rig(&self) -> PathBuf {
        self.journal.found.clone().unwrap_or_default().join("rig.toml")
    }

    /// Folder of the optimum on the model.
    pub(crate) fn optimum_folder(&self) -> PathBuf {
        self.out.join("optimum")
    }

    /// Folder of the training's run.
    pub(crate) fn training_folder(&self) -> PathBuf {
        self.out.join("run")
    }

    /// File of the policy that was trained.
    pub(crate) fn trained_policy(&self) -> PathBuf {
        self.out.join("adapted.onnx")
    }
}
