//! The whole update, seen from inside: against definitions in f64, against torch, against itself.

mod case;
mod definition;
mod learning;
mod same_bytes;
mod torch;
