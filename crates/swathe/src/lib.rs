//! The core of Swathe: off-road route planning for ground robots.
//!
//! Pure functions over grids: no files, network, clock, global state or Python. One module per stage of the flow
//!
//! ```text
//! elevation + soil -> terrain, soil -> rank -> corridor -> swarm -> nest -> planner -> Route
//! ```
//!
//! Conventions, kept everywhere: metres in a projected, north-up frame; row 0 is the north edge; headings
//! counter-clockwise from east in radians; grades are rise over run; unknown elevation is NaN. Public functions check
//! shapes and ranges once and return an error; kernels below them assume what was checked.

pub mod belief;
pub mod corridor;
pub mod drive;
pub mod episode;
pub mod grid;
pub mod local;
pub mod nest;
pub mod planner;
pub mod progress;
pub mod random;
pub mod rank;
pub mod sensor;
pub mod sim;
pub mod soil;
pub mod swarm;
pub mod terrain;
pub mod vehicle;
