//! Finds the physics missing in a rig's model.

#![allow(dead_code)]

pub mod bench;
pub mod candidate;
mod error;
pub mod diagnosis;
pub mod evidence;
pub mod experiment;
pub mod locate;
pub mod place;
pub mod search;

pub use error::DiagnoseError;
