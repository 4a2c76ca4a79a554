//! Where the mismatch lives.

pub mod smoother;
