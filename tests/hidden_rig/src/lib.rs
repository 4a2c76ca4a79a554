//! A rig of its own, with effects concealed in it: recordings to test the diagnosis with.
//!
//! The diagnosis is judged on data that its own model did not make. This crate depends on nothing of the workspace; it
//! has other equations (air kept by mass and energy, ISO 6358, a flapper that moves, relays for hysteresis), another
//! integrator (adaptive, with the check valves as events), other parameters (each off by 2 to 10 %), small nuisances,
//! and sensors with coloured noise and a converter. With nothing concealed it can be explained by the paper's model to
//! about 0.01 kPa, after a refit of that model's parameters (`tests/paper_distance.rs`): otherwise a null would mean
//! nothing.
//!
//! | module | subject |
//! | --- | --- |
//! | [`gas`], [`orifice`] | air by mass and energy; ISO 6358, lines, gaps |
//! | [`pump`], [`chamber`], [`valve`], [`series`], [`sensor`] | the parts |
//! | [`preisach`], [`actuation`] | hysteresis; what happens between a command and a coil |
//! | [`state`], [`plant`], [`rates`], [`integrate`], [`run`] | the whole, in motion |
//! | [`build_sheet`] | the parameters of one hidden rig |
//! | [`effects`] | what can be concealed, one type each |
//! | [`excitation`], [`recording`] | what drives it, what is written |
//! | [`sizing`] | how large an effect is, raw and after the best refit |
//! | [`oracle`] | what could be told from a case's recordings at best |
//! | [`case`], [`suite`], [`truth`] | cases, suites, and what is told to the scorer alone |
//! | [`rng`] | draws that a seed fixes |

pub mod actuation;
pub mod build_sheet;
pub mod case;
pub mod chamber;
pub mod effects;
pub mod excitation;
pub mod gas;
pub mod integrate;
pub mod oracle;
pub mod orifice;
pub mod plant;
pub mod preisach;
pub mod pump;
pub mod rates;
pub mod recording;
pub mod rng;
pub mod run;
pub mod sensor;
pub mod series;
pub mod sizing;
pub mod state;
pub mod suite;
pub mod truth;
pub mod valve;
