//! Local avoidance: a certainty grid and a wanted direction in, a steering direction out.
//!
//! The family of the vector field histogram, one file each with the symbols of its paper: [`Vfh`] (Borenstein and Koren
//! 1991), [`VfhPlus`] (Ulrich and Borenstein 1998), [`VfhStar`] (Ulrich and Borenstein 2000), and [`PlayerVfh`], a set of
//! parameters by the names of Player's `vfh` driver that behaves as that driver does.
//!
//! Directions are counter-clockwise from east, as everywhere; windows are squares of certainties (0 to 15), row by row from
//! the north-west, with the robot in the cell in the middle.

mod certainty;
mod player;
mod polar;
mod vfh;
mod vfh_plus;
mod vfh_star;

pub use certainty::{CERTAINTY_MAX, CertaintyGrid, CertaintyParams, Evidence};
pub use player::{PlayerParams, PlayerSteering, PlayerVfh};
pub use polar::{Opening, PolarHistogram, Steering, openings, sector_gap, threshold};
pub use vfh::{Vfh, VfhParams};
pub use vfh_plus::{Body, TooClose, VfhPlus, VfhPlusParams};
pub use vfh_star::{VfhStar, VfhStarParams};
