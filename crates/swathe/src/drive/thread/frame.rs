//! The frame in which a search of poses reckons: a place of the world is its (0, 0), a heading its direction of zero.

use crate::sensor::{Pose, wrap};

use super::Leg;

/// The frame of a field: a place of the world that is its (0, 0), and a heading that is its direction of zero.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    at: (f64, f64),
    heading_rad: f64,
    sin: f64,
    cos: f64,
}

impl Frame {
    pub fn of(pose: &Pose) -> Self {
        let (sin, cos) = pose.heading_rad.sin_cos();
        Self {
            at: (pose.x_m, pose.y_m),
            heading_rad: pose.heading_rad,
            sin,
            cos,
        }
    }

    /// A place of the world.
    pub fn inside(&self, (x_m, y_m): (f64, f64)) -> (f64, f64) {
        let (dx, dy) = (x_m - self.at.0, y_m - self.at.1);
        (self.cos * dx + self.sin * dy, self.cos * dy - self.sin * dx)
    }

    /// A place of the frame, in the world.
    pub fn outside(&self, (x_m, y_m): (f64, f64)) -> (f64, f64) {
        (
            self.at.0 + self.cos * x_m - self.sin * y_m,
            self.at.1 + self.sin * x_m + self.cos * y_m,
        )
    }

    /// A pose of the world.
    pub fn pose(&self, pose: &Pose) -> Pose {
        let (x_m, y_m) = self.inside((pose.x_m, pose.y_m));
        Pose::level(x_m, y_m, wrap(pose.heading_rad - self.heading_rad))
    }

    /// A leg of the frame, in the world.
    pub fn leg(&self, leg: Leg) -> Leg {
        match leg {
            Leg::Turn { to_rad } => Leg::Turn {
                to_rad: wrap(to_rad + self.heading_rad),
            },
            Leg::Run {
                from: (x_m, y_m, heading_rad),
                curvature_per_m,
                length_m,
            } => {
                let (x_m, y_m) = self.outside((x_m, y_m));
                Leg::Run {
                    from: (x_m, y_m, wrap(heading_rad + self.heading_rad)),
                    curvature_per_m,
                    length_m,
                }
            }
        }
    }
}
