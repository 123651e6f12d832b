//! On hills a laser that tilts with the body sees the ground. With elevation and attitude these returns are ground, without them
//! they are obstacles; what stands on the ground must be seen all the same.
//!
//! The table of `docs/drive.md` is made by
//! `SWATHE_HILL=hill.asc cargo test --release -p swathe --test drive_hills -- --ignored --nocapture`, where `hill.asc` is the map of
//! a real hill as an Arc ASCII grid, which `gdal_translate -of AAIGrid` makes of it.

mod driving;

use driving::{Drive, crates, ground, jackal, map_of};
use swathe::drive::Status;
use swathe::grid::{GridGeometry, Layer, Position};
use swathe::random::{philox, unit};
use swathe::sensor::Pose;
use swathe::sim::{BodyState, Laser, World};
use swathe::soil::SoilClass;

/// What a drive over a hill came to.
#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    drives: u32,
    reached: u32,
    collisions: u32,
    metres: f64,
    seconds: f64,
    /// Times that the robot stood or backed for at least half a second with nothing standing near.
    false_stops: u32,
    /// Crates that at least three beams met within 3.5 m in at least ten scans, and those that were never taken for obstacles.
    met: u32,
    missed: u32,
}

const STANDS_STEPS: u32 = 17;
const NEAR_M: f64 = 3.5;

/// The hill without and with crates, and where they stand.
struct Hill {
    bare: World,
    strewn: World,
    places: Vec<(f64, f64)>,
}

impl Hill {
    fn new(bare: World, places: Vec<(f64, f64)>) -> Self {
        let mut strewn = bare.clone();
        strewn.place(crates(&places)).unwrap();
        Self { bare, strewn, places }
    }

    /// Beams that meet each crate.
    fn shown(&self, laser: &Laser, truth: &BodyState) -> Vec<u32> {
        let ranges = |world| laser.true_ranges_m(world, &truth.pose, truth.height_m, truth.time_s);
        let sensor = truth.pose.of_mount(&laser.mount);
        let mut shown = vec![0; self.places.len()];
        for (beam, (with, without)) in ranges(&self.strewn).into_iter().zip(ranges(&self.bare)).enumerate() {
            if with >= without {
                continue;
            }
            let (sin, cos) =
                (sensor.heading_rad + laser.angle_min_rad + laser.angle_increment_rad * beam as f64).sin_cos();
            for (shown, place) in shown.iter_mut().zip(&self.places) {
                let off_m = (sensor.x_m + with * cos - place.0).hypot(sensor.y_m + with * sin - place.1);
                *shown += u32::from(off_m < 0.7);
            }
        }
        shown
    }
}

fn drive(hill: &Hill, start: Pose, goal: (f64, f64), corrected: bool, tally: &mut Tally) {
    let mut drive = Drive::new(&hill.strewn, jackal(), goal);
    drive.start = start;
    drive.seconds = 150.0;
    if corrected {
        drive.region = Some(map_of(&hill.strewn));
    }
    let laser = drive.robot.laser.clone();
    let places = &hill.places;
    let (mut slow, mut scans, mut seen) = (0, vec![0; places.len()], vec![false; places.len()]);
    let mut stops = 0;
    let outcome = drive.run_with(
        |_, _| {},
        |moment| {
            let pose = &moment.truth.pose;
            let away_m = |&(x, y): &(f64, f64)| (pose.x_m - x).hypot(pose.y_m - y);
            let is_alone = places.iter().all(|place| away_m(place) > 4.0);
            let status = moment.command.status;
            let is_busy = matches!(status, Status::Driving | Status::Recovering | Status::NoRoute);
            let is_slow = moment.command.speed_mps < 0.05 && is_busy;
            slow = if is_slow && is_alone { slow + 1 } else { 0 };
            stops += u32::from(slow == STANDS_STEPS);
            if !places.iter().any(|place| away_m(place) < NEAR_M) {
                return;
            }
            let shown = hill.shown(&laser, moment.truth);
            for (crate_index, place) in places.iter().enumerate().filter(|(_, place)| away_m(place) < NEAR_M) {
                scans[crate_index] += u32::from(shown[crate_index] >= 3);
                let grid = moment.navigator.certainty();
                grid.each_sure(grid.cell_of(place.0, place.1), 6, 6, |_| seen[crate_index] = true);
            }
        },
    );
    tally.drives += 1;
    tally.reached += u32::from(outcome.status == Status::Reached);
    tally.collisions += outcome.collisions;
    tally.metres += outcome.metres;
    tally.seconds += outcome.seconds;
    tally.false_stops += stops;
    for (&scans, &seen) in scans.iter().zip(&seen) {
        tally.met += u32::from(scans >= 10);
        tally.missed += u32::from(scans >= 10 && !seen);
    }
}

/// Rolling ground with grades up to about 25 %.
fn rolling(x: f64, y: f64) -> f64 {
    0.9 * (x / 5.0).sin() + 0.6 * ((x + 2.0 * y) / 7.0).cos() + 0.03 * x
}

fn drawn(seed: u64, has_crates: bool) -> Hill {
    let places: Vec<(f64, f64)> = (0..if has_crates { 8 } else { 0 })
        .map(|i| {
            let draw = philox([i, 0, 0, 0], seed).map(unit);
            (6.0 + 4.0 * f64::from(i) + 2.0 * draw[0], 4.0 * (draw[1] - 0.5))
        })
        .collect();
    Hill::new(ground(rolling), places)
}

fn over_the_drawn_hill(seeds: u64, has_crates: bool, corrected: bool) -> Tally {
    let mut tally = Tally::default();
    for seed in 0..seeds {
        let hill = drawn(seed, has_crates);
        drive(&hill, Pose::default(), (42.0, 0.0), corrected, &mut tally);
    }
    tally
}

#[test]
fn with_elevation_and_attitude_hills_are_driven_over_and_crates_are_seen() {
    let bare = over_the_drawn_hill(1, false, true);
    assert_eq!((bare.reached, bare.false_stops), (1, 0), "{bare:?}");
    let blind = over_the_drawn_hill(1, false, false);
    assert!(
        blind.false_stops > 0 || blind.seconds > 1.5 * bare.seconds,
        "{blind:?} {bare:?}"
    );
    let strewn = over_the_drawn_hill(3, true, true);
    assert_eq!(
        (strewn.collisions, strewn.missed, strewn.reached),
        (0, 0, 3),
        "{strewn:?}"
    );
    assert!(strewn.met > 2, "{strewn:?}");
}

/// Heights of an Arc ASCII grid, its south-west corner at the origin.
fn arc_ascii(text: &str) -> Layer<f32> {
    let mut words = text.split_whitespace();
    let mut header = |name: &str| -> f64 {
        assert!(
            words.next().is_some_and(|word| word.eq_ignore_ascii_case(name)),
            "{name} is missing"
        );
        words.next().unwrap().parse().unwrap()
    };
    let (columns, rows) = (header("ncols") as usize, header("nrows") as usize);
    let (_, _, size) = (header("xllcorner"), header("yllcorner"), header("cellsize"));
    let words: Vec<&str> = words.collect();
    let values: Vec<f32> = words[words.len() - rows * columns..]
        .iter()
        .map(|word| word.parse().unwrap())
        .collect();
    let geometry = GridGeometry::new(rows, columns, size, 0.0, rows as f64 * size).unwrap();
    Layer::new(geometry, values, "the heights").unwrap()
}

fn over_a_real_hill(heights: &Layer<f32>, seeds: u64, has_crates: bool, corrected: bool) -> Tally {
    let geometry = heights.geometry();
    let size_m = (
        geometry.columns() as f64 * geometry.cell_size_m(),
        geometry.rows() as f64 * geometry.cell_size_m(),
    );
    let mut tally = Tally::default();
    for seed in 0..seeds {
        let draw = philox([0, 0, 0, 1], seed).map(unit);
        let start = Position::new(60.0 + draw[0] * (size_m.0 - 120.0), 60.0 + draw[1] * (size_m.1 - 120.0));
        let heading_rad = draw[2] * std::f64::consts::TAU;
        let along = |metres: f64, aside: f64| {
            let (sin, cos) = heading_rad.sin_cos();
            (
                start.x_m + metres * cos - aside * sin,
                start.y_m + metres * sin + aside * cos,
            )
        };
        let places: Vec<(f64, f64)> = (0..if has_crates { 8 } else { 0 })
            .map(|i| {
                let draw = philox([i, 1, 0, 1], seed).map(unit);
                along(6.0 + 4.5 * f64::from(i) + 2.0 * draw[0], 4.0 * (draw[1] - 0.5))
            })
            .collect();
        let soil = Layer::filled(geometry, SoilClass::Gravel as u8);
        let hill = Hill::new(World::new(heights.clone(), soil, 10.0).unwrap(), places);
        let start = Pose::level(start.x_m, start.y_m, heading_rad);
        drive(&hill, start, along(45.0, 0.0), corrected, &mut tally);
    }
    tally
}

#[test]
#[ignore = "a measurement"]
fn table() {
    let row = |name: &str, corrected: bool, bare: Tally, strewn: Tally| {
        println!(
            "| {name} | {} | {:.1} | {} of {} | {} of {} | {} | {} of {} | {:.2} |",
            if corrected { "yes" } else { "no" },
            1000.0 * f64::from(bare.false_stops) / bare.metres,
            bare.reached,
            bare.drives,
            strewn.missed,
            strewn.met,
            strewn.collisions,
            strewn.reached,
            strewn.drives,
            bare.metres / bare.seconds,
        );
    };
    println!(
        "| hill | explained | false stops per km | reached, bare | crates missed | collisions | reached, crates | m/s, bare |"
    );
    for corrected in [true, false] {
        let (bare, strewn) = (
            over_the_drawn_hill(1, false, corrected),
            over_the_drawn_hill(10, true, corrected),
        );
        row("drawn", corrected, bare, strewn);
    }
    let Ok(path) = std::env::var("SWATHE_HILL") else { return };
    let heights = arc_ascii(&std::fs::read_to_string(path).expect("a readable hill"));
    for corrected in [true, false] {
        let (bare, strewn) = (
            over_a_real_hill(&heights, 10, false, corrected),
            over_a_real_hill(&heights, 10, true, corrected),
        );
        row("Fort Bragg", corrected, bare, strewn);
    }
}
