//! Finds the physics missing in a rig's model.

pub mod locate;
