//! The pose that the drive goes by, beside one that is told and corrected.

use std::f64::consts::PI;

use proptest::prelude::*;

use crate::drive::odometry::Odometry;
use crate::sensor::{Pose, Scan, wrap};

const STEP_S: f64 = 1.0 / 35.0;

/// What a second of driving an arc does: every pose that was told, and the one to go by.
fn drive(
    odometry: &mut Odometry,
    told: &mut Pose,
    (from_s, to_s): (usize, usize),
    (speed_mps, turn_radps): (f64, f64),
) -> Vec<(Pose, Pose)> {
    (from_s * 35..to_s * 35)
        .map(|k| {
            let step_s = if k == 0 { 0.0 } else { STEP_S };
            let middle_rad = told.heading_rad + turn_radps * step_s / 2.0;
            *told = Pose::level(
                told.x_m + speed_mps * step_s * middle_rad.cos(),
                told.y_m + speed_mps * step_s * middle_rad.sin(),
                wrap(told.heading_rad + turn_radps * step_s),
            );
            let own = odometry.roll(k as f64 * STEP_S, told, (speed_mps, turn_radps), step_s);
            (*told, own)
        })
        .collect()
}

fn off(one: &Pose, other: &Pose) -> (f64, f64) {
    (one.distance_m(other), wrap(one.heading_rad - other.heading_rad).abs())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn a_correction_makes_no_jump_and_is_come_to_while_driving(
        speed_mps in 0.2..2.0_f64, turn_radps in -1.0..1.0_f64, east_m in 0.1..0.4_f64, turn_rad in -PI / 8.0..PI / 8.0,
    ) {
        let (mut odometry, mut told) = (Odometry::default(), Pose::level(3.0, -2.0, 1.0));
        for (told, own) in drive(&mut odometry, &mut told, (0, 1), (speed_mps, turn_radps)) {
            prop_assert_eq!(told, own);
        }
        prop_assert_eq!(odometry.doubt().place_m, 0.0);
        let last = told;
        (told.x_m, told.heading_rad) = (told.x_m + east_m, wrap(told.heading_rad + turn_rad));
        let after = drive(&mut odometry, &mut told, (1, 3), (speed_mps, turn_radps));
        let step_m = speed_mps * STEP_S;
        let mut before = last;
        for &(_, own) in &after {
            // A step of the way, and what a metre pulls.
            prop_assert!(own.distance_m(&before) <= step_m * (1.0 + 0.1 + 4.0 * turn_rad.abs()) + 1e-9);
            before = own;
        }
        let doubt = odometry.doubt();
        // The first step after it leads elsewhere too.
        let aside_m = step_m * turn_rad.abs();
        let expected_m = 0.8 * (east_m - aside_m)..=east_m + aside_m + 1e-9;
        prop_assert!(expected_m.contains(&doubt.place_m), "{:?}", doubt);
        prop_assert!((0.8 * turn_rad.abs()..=turn_rad.abs() + 1e-9).contains(&doubt.heading_rad));
        let (away_m, away_rad) = off(&after[1].0, &after[1].1);
        prop_assert!(away_m > 0.6 * east_m && away_rad >= 0.6 * turn_rad.abs());
        // At rest nothing changes; a hundred metres on all of it is gone.
        let stood = drive(&mut odometry, &mut told, (3, 5), (0.0, 0.0));
        prop_assert!(stood.iter().all(|(_, own)| off(own, &stood[0].1) < (1e-9, 1e-9)));
        let seconds = (120.0 / speed_mps).ceil() as usize;
        let (told, own) = *drive(&mut odometry, &mut told, (5, 5 + seconds), (speed_mps, turn_radps)).last().unwrap();
        prop_assert_eq!(told, own);
    }

    #[test]
    fn spinning_wheels_do_not_carry_it_away(wheels_mps in 1.5..3.0_f64, seconds in 1..5_usize) {
        let mut odometry = Odometry::default();
        let told = Pose::level(1.0, 1.0, 0.5);
        for k in 0..seconds * 35 {
            let own = odometry.roll(k as f64 * STEP_S, &told, (wheels_mps, 0.0), STEP_S);
            prop_assert!(own.distance_m(&told) <= wheels_mps * STEP_S + 1e-9);
        }
    }

    #[test]
    fn a_late_scan_is_put_to_where_its_sensor_was(
        east_m in 0.1..0.4_f64, turn_rad in -PI / 8.0..PI / 8.0, late in 0..10_usize,
    ) {
        let (mut odometry, mut told) = (Odometry::default(), Pose::default());
        let mut own_way = Vec::new();
        let mut told_way: Vec<Pose> = Vec::new();
        for k in 0..70 {
            if k == 35 {
                (told.x_m, told.heading_rad) = (told.x_m + east_m, wrap(told.heading_rad + turn_rad));
            }
            let (sin, cos) = told.heading_rad.sin_cos();
            told = Pose::level(told.x_m + STEP_S * cos, told.y_m + STEP_S * sin, told.heading_rad);
            let own = odometry.roll(f64::from(k) * STEP_S, &told, (1.0, 0.0), if k == 0 { 0.0 } else { STEP_S });
            own_way.push(own);
            told_way.push(told);
            let then = told_way.len().saturating_sub(1 + late);
            // Where the sensor was then, as told then, beside where the robot is told to be now.
            let mount = told.mount_of(&told_way[then]);
            let scan = Scan {
                ranges_m: vec![1.0],
                angle_min_rad: 0.0,
                angle_increment_rad: 0.0,
                range_min_m: 0.0,
                range_max_m: 8.0,
                mount,
            };
            let placed = odometry.place(&told, &scan);
            let (away_m, away_rad) = off(&own.of_mount(&placed.mount), &own_way[then]);
            prop_assert!(away_m < 0.03 && away_rad < 0.03, "{k}: {away_m} {away_rad}");
        }
    }
}
