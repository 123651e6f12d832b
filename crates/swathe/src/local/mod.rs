//! Local avoidance: a certainty grid and a wanted direction in, a steering direction out.
//!
//! The family of the vector field histogram, one file each with the symbols of its paper: [`Vfh`] (Borenstein and Koren
//! 1991), [`VfhPlus`] (Ulrich and Borenstein 1998), [`VfhStar`] (Ulrich and Borenstein 2000), and [`PlayerVfh`], a set of
//! parameters by the names of Player's `vfh` driver that behaves as that driver does; [`PlayerDriver`] is the driver around it.
//!
//! Directions are counter-clockwise from east, as everywhere; windows are squares of certainties (0 to 15), row by row from
//! the north-west, with the robot in the cell in the middle.

mod certainty;
mod player;
mod player_driver;
mod polar;
#[cfg(test)]
mod tests;
mod vfh;
mod vfh_plus;
mod vfh_star;

pub use certainty::{CERTAINTY_MAX, CertaintyGrid, CertaintyParams, Evidence, PoseDoubt};
pub use player::{PlayerParams, PlayerSteering, PlayerVfh};
pub use player_driver::{PlayerDriver, PlayerState};
/// What a map says of the ground in a direction (counter-clockwise from east): its mean expected goodness, 1 to 5, over the
/// first metres.
pub type Goodness<'a> = &'a dyn Fn(f64) -> f64;

/// Goodness of the best ground.
const GOODNESS_MAX: f64 = 5.0;

/// What a map tells a method that looks beyond the robot's place.
pub trait Ground {
    /// Sets the cells of a window (row by row from the north-west) around a place that must not be driven on to
    /// [`CERTAINTY_MAX`].
    fn close(&self, x_m: f64, y_m: f64, window: &mut [u8]);

    /// Mean expected goodness, 1 to 5, over the first metres in a direction from a place.
    fn goodness(&self, x_m: f64, y_m: f64, direction_rad: f64) -> f64;
}

pub use polar::{Opening, PolarHistogram, Steering, openings, sector_gap, threshold};
pub use vfh::{Vfh, VfhParams};
pub use vfh_plus::{Body, TooClose, VfhPlus, VfhPlusParams};
pub use vfh_star::{VfhStar, VfhStarParams};
