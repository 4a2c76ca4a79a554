//! The physics against closed forms, independent implementations and its own invariants.
//!
//! One program for all subjects: the plant is generic, so each test program would compile its own copy of it,
//! which takes longer than all these tests run.
//!
//! | file | subject |
//! | --- | --- |
//! | `golden` | traces of other implementations, row by row |
//! | `steady_table` | settled pressures for constant duties |
//! | `starts` | what a free run begins with that no recording tells |
//! | `closed_forms` | small rigs whose solution is a formula |
//! | `crank` | piston pumps whose limit is a formula |
//! | `thermal` | the first law in a chamber |
//! | `conservation` | mass and energy in closed rigs |
//! | `convergence` | order of the integrator |
//! | `mechanisms` | each mechanism off and on; hysteresis, lag, delay, leak, heat |
//! | `command_mechanisms` | what acts along a valve's command |
//! | `series` | what lies in series with a valve or a pump; outflow functions |
//! | `pump_mechanisms` | pumps |
//! | `volume_mechanisms` | volumes, muscles, sensors, tabled flows |
//! | `candidate_list` | what could be missing from a rig |
//! | `refusals` | what wrong mechanisms are told |
//! | `averaged` | pumps averaged over a revolution against pumps in full detail |
//! | `observer` | chambers behind sensors that lag or swing |
//! | `lanes` | many rigs at once against one at a time |
//! | `no_alloc` | a tick allocates nothing |
//! | `small_rigs` | what the small rigs share |

// The workspace's exemption covers test functions; here the helpers between them are tests as well.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod averaged;
mod candidate_list;
mod closed_forms;
mod command_mechanisms;
mod conservation;
mod convergence;
mod crank;
mod flapper_friction;
mod golden;
mod lanes;
mod mechanisms;
mod no_alloc;
mod observer;
mod pump_mechanisms;
mod refusals;
mod series;
mod small_rigs;
mod starts;
mod steady_table;
mod thermal;
mod volume_mechanisms;
