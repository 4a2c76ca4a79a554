//! The physics of the dual-pressure rig.
//!
//! | module | subject |
//! | --- | --- |
//! | [`real`] | one rig or many lanes: the scalar of all formulas |
//! | [`orifice`] | mass flow from standstill to choking, paper eq. (3) |
//! | [`rig`] | a rig as data: TOML, checked |
//! | [`mechanism`] | physics beyond the paper's, one file each |
//! | [`plant`] | a rig compiled into flat arrays; RK4; simulation |
//! | [`predict`] | MPObs: the model rolled ahead |
//! | [`observer`] | chambers estimated behind sensors that lag or swing |
//! | [`averaged`] | pumps averaged over a revolution, for fits |
//! | [`steady`] | the rig averaged over a revolution; feed-forward |
//! | [`shown_reference`] | what late sensors show of chambers that stand on a reference |
//! | [`valve_path`] | delay, lags and play between a duty and its flapper |
//! | [`observation`] | what a policy sees and answers |
//! | [`ports`] | names, units and ranges of that, as policy files carry them |
//!
//! SI units and absolute pressure inside; kPa gauge only where a name says so. This crate opens no files and
//! knows no clock, no thread and no global random numbers.

pub mod averaged;
pub mod mechanism;
pub mod observation;
pub mod observer;
pub mod orifice;
pub mod plant;
pub mod ports;
pub mod predict;
pub mod real;
pub mod rig;
pub mod shown_reference;
pub mod steady;
pub mod valve_path;
