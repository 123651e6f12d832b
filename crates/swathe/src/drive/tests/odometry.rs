//! Dead reckoning beside a pose that is corrected.

use std::f64::consts::PI;

use proptest::prelude::*;

use crate::drive::odometry::Odometry;
use crate::sensor::{Pose, wrap};

const STEP_S: f64 = 1.0 / 35.0;

/// Drives an arc for some seconds; after a second the pose is moved and turned by a correction.
fn drive(seconds: usize, (speed_mps, turn_radps): (f64, f64), [east_m, turn_rad]: [f64; 2]) -> Odometry {
    let mut odometry = Odometry::default();
    let mut pose = Pose::default();
    for k in 0..seconds * 35 {
        if k == 35 {
            pose = Pose::level(pose.x_m + east_m, pose.y_m, wrap(pose.heading_rad + turn_rad));
        }
        odometry.roll(k as f64 * STEP_S, &pose, (speed_mps, turn_radps), STEP_S);
        let middle_rad = pose.heading_rad + turn_radps * STEP_S / 2.0;
        pose = Pose::level(
            pose.x_m + speed_mps * STEP_S * middle_rad.cos(),
            pose.y_m + speed_mps * STEP_S * middle_rad.sin(),
            wrap(pose.heading_rad + turn_radps * STEP_S),
        );
    }
    odometry
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn the_doubt_of_a_pose_is_its_correction_and_fades(
        speed_mps in 0.0..2.0_f64, turn_radps in -1.0..1.0_f64, east_m in 0.1..0.4_f64, turn_rad in -PI / 8.0..PI / 8.0,
    ) {
        let sure = drive(3, (speed_mps, turn_radps), [0.0; 2]).doubt();
        prop_assert_eq!((sure.place_m, sure.heading_rad), (0.0, 0.0));
        let doubt = drive(2, (speed_mps, turn_radps), [east_m, turn_rad]).doubt();
        prop_assert!((0.85 * east_m..=east_m + 0.01).contains(&doubt.place_m));
        prop_assert!((0.85 * turn_rad.abs()..=turn_rad.abs() + 0.01).contains(&doubt.heading_rad));
        let later = drive(32, (speed_mps, turn_radps), [east_m, turn_rad]).doubt();
        prop_assert!((later.place_m / doubt.place_m - (-3.0_f64).exp()).abs() < 0.01);
    }
}
