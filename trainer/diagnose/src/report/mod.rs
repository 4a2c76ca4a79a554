//! The findings: figures before and after, sentences, where it lives, what remains, and the files of the answer.

pub mod figures;
pub(crate) mod files;
pub(crate) mod findings;
pub(crate) mod localization;
pub(crate) mod next_step;
pub(crate) mod page;
pub(crate) mod summary;
pub(crate) mod unexplained;
pub(crate) mod wording;
