//! The score card of `trainer diagnose` on concealed cases.
//!
//! The program is a black box: it is run by its path, sees recordings and a rig file, and answers by the files of its
//! own interface (`diagnosis.json`, `rig.toml`, `next_experiment.csv`). Only here are the truths opened. Where the
//! answer is `undecided`, the proposed experiment is run on the hidden rig and the program asked again.
//!
//! | module | subject |
//! | --- | --- |
//! | [`diagnosis`] | what `diagnosis.json` says, read leniently |
//! | [`trainer`] | running the program, its time, its limit |
//! | [`judge`] | an answer beside the truth |
//! | [`numbers`] | parameters found beside parameters concealed |
//! | [`free_run`] | errors of free runs on the held-out recording |
//! | [`case`] | one case from start to end, as a line of JSON |
//! | [`worth`] | what an answer is worth: by what is said, how often it is so |
//! | [`card`], [`markdown`] | what all lines come to, and how it is written |

pub mod card;
pub mod case;
pub mod diagnosis;
pub mod free_run;
pub mod judge;
pub mod markdown;
pub mod numbers;
pub mod trainer;
pub mod worth;
