//! The observation layouts that this program flies, in the words of the policy loader.

pub use admission::signatures::offered;
