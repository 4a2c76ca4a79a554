//! Policies of a folder of runs, grouped for the tables: runs that differ in nothing but their seed are one row.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use training::{TrainedPolicy, TrainingError, TrainingSettings, Variant};

use crate::failure::{Failure, tell};

/// Tells whether two policies of one row are no two seeds: the same seed, or the same weights under another number.
fn is_same_run(one: &TrainedPolicy, other: &TrainedPolicy) -> bool {
    one.settings().run.seed == other.settings().run.seed || one.network() == other.network()
}

fn twin_of(other: &Path, policy: &TrainedPolicy) -> String {
    format!(
        "is the run of {} once more (seed {}), and a spread over seeds would count it twice; take one of the two folders away",
        other.display(),
        policy.settings().run.seed
    )
}

/// Rows of policies by sorting key: their label, and one policy for each seed.
pub(crate) type Groups = BTreeMap<String, (String, Vec<Arc<TrainedPolicy>>)>;

/// The name of a run that was kept without its policy, where it would be in the table.
fn without_policy(folder: &Path, shown: &dyn Fn(Variant) -> bool) -> Option<String> {
    let file = folder.join("settings.toml");
    let settings = std::fs::read_to_string(&file).ok()?;
    let settings = TrainingSettings::parse(&file.display().to_string(), &settings).ok()?;
    shown(settings.policy.variant).then(|| Some(folder.file_name()?.to_string_lossy().into_owned()))?
}

/// Tells of runs that were kept without their policies, and how one is had again.
fn tell_lacking(folder: &Path, names: &[String]) {
    if !names.is_empty() {
        let folder = folder.display();
        tell(&format!(
            "{folder}: runs kept without their policies and not in the table ({}); `trainer train --config {folder}/NAME/settings.toml \
             --out runs/NAME` trains one anew",
            names.join(", ")
        ));
    }
}

/// Policies of a folder of runs, and a line on each group's length of training.
pub(crate) fn groups(folder: &Path, shown: &dyn Fn(Variant) -> bool) -> Result<(Groups, Vec<String>), Failure> {
    let unreadable = |error: std::io::Error| TrainingError::File {
        file: folder.display().to_string(),
        problem: format!("cannot be read: {error}; --runs takes the folder that holds the runs' folders"),
    };
    let (mut paths, mut lacking): (Vec<PathBuf>, Vec<String>) = (Vec::new(), Vec::new());
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if TrainedPolicy::is_in(&path) {
            paths.push(path);
        } else if let Some(name) = without_policy(&path, shown) {
            lacking.push(name);
        }
    }
    paths.sort();
    lacking.sort();
    tell_lacking(folder, &lacking);
    if paths.is_empty() {
        return Err(TrainingError::File {
            file: folder.display().to_string(),
            problem: "holds no run with a policy.bin, or a policy.onnx and its settings.toml; train some first, or leave out --runs".into(),
        }
        .into());
    }
    let mut groups = Groups::new();
    let mut counted: Vec<(String, PathBuf, Arc<TrainedPolicy>)> = Vec::new();
    for path in paths {
        let policy = Arc::new(TrainedPolicy::load(&path)?);
        let settings = policy.settings();
        if !shown(settings.policy.variant) {
            continue;
        }
        // The same but for the seed: the same settings with the seed taken out.
        let mut common = settings.clone();
        common.run.seed = 0;
        let drawn = if settings.environment.mechanisms.is_empty() { "" } else { " randomised around" };
        let order = Variant::ALL.iter().position(|v| *v == settings.policy.variant).unwrap_or(0);
        let label = format!(
            "RL {} (layout v{}, {} steps,{drawn} {})",
            settings.policy.variant.name(),
            settings.policy.contract,
            policy.steps(),
            settings.rig.trained_on,
        );
        let key = format!("{}{drawn}{order}{}", settings.policy.contract, common.to_toml()?);
        if let Some((_, other, _)) =
            counted.iter().find(|(group, _, other)| *group == key && is_same_run(other, &policy))
        {
            return Err(
                TrainingError::File { file: path.display().to_string(), problem: twin_of(other, &policy) }.into()
            );
        }
        counted.push((key.clone(), path, Arc::clone(&policy)));
        groups.entry(key).or_insert((label, Vec::new())).1.push(policy);
    }
    let notes = groups
        .values()
        .map(|(label, policies)| {
            let seeds: Vec<String> = policies.iter().map(|p| p.settings().run.seed.to_string()).collect();
            format!("{label}: seeds {}.", seeds.join(", "))
        })
        .collect();
    Ok((groups, notes))
}
