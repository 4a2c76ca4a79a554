//! Finds the physics missing in a rig's model.

#![allow(dead_code)]

pub mod bench;
pub mod candidate;
pub mod diagnosis;
mod error;
pub mod evidence;
pub mod experiment;
pub mod figures;
pub mod judge;
pub mod locate;
mod page;
pub mod place;
mod run;
pub mod screen;
pub mod search;
pub mod unknown;
mod words;

pub use error::DiagnoseError;
pub use run::{NEXT_EXPERIMENT, Request, run};
