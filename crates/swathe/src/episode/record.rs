//! Puts a step into the second that it belongs to.

use crate::drive::{self, Command, Navigator};
use crate::grid::Position;
use crate::sensor::{PenetrometerReading, Pose};
use crate::sim::{BodyState, World};

use super::fault::Taken;
use super::second::{CertaintyMap, CommandRows, Happening, HistogramRow, Second, status_code};

/// Seconds from one map, and from one histogram or row of movers, to the next.
const MAP_S: f64 = 1.0;
const HISTOGRAM_S: f64 = 0.5;

/// What the robot knew in a step.
pub(super) struct Told<'a> {
    pub time_s: f64,
    pub pose: &'a Pose,
    pub speed_mps: f64,
    pub turn_rate_radps: f64,
    pub arrived: &'a [Taken],
    /// The same of the sonar ring, with the number of the cone.
    pub echoes: &'a [(usize, Taken)],
    pub reading: Option<&'a PenetrometerReading>,
    pub command: Command,
    pub body: &'a BodyState,
}

/// What was recorded last of what is only recorded when it changes, and when rare rows are due.
#[derive(Clone, Debug, Default)]
pub(super) struct Recorder {
    way: Vec<Position>,
    route: Vec<Position>,
    maps: u64,
    histograms: u64,
}

impl Recorder {
    /// Puts a step into a second.
    pub fn step(&mut self, second: &mut Second, world: &World, navigator: &Navigator, told: &Told) {
        let (time_s, body) = (told.time_s, told.body);
        for (taken_s, scan) in told.arrived {
            second.scans.push(*taken_s, time_s, scan);
        }
        for (cone, (taken_s, scan)) in told.echoes {
            second.sonar.push(*taken_s, time_s, *cone, scan);
        }
        second
            .odometry
            .push(time_s, told.pose, told.speed_mps, told.turn_rate_radps);
        second
            .truth
            .push(time_s, &body.pose, body.speed_mps, body.turn_rate_radps);
        push_command(&mut second.commands, time_s, &told.command);
        if let Some(reading) = told.reading {
            second.readings.push((time_s, reading.clone()));
        }
        for event in navigator.events() {
            if let drive::Event::Navigability { grids, navigable, .. } = event {
                second.grids.times_s.push(time_s);
                second.grids.grids = grids.len();
                second.grids.answers.extend(grids);
                second.grids.navigable.push(*navigable);
            }
        }
        // The robot drives along its way, which loses its first points by that alone.
        let way = navigator.way();
        if !self.way.ends_with(way.get(1..).unwrap_or_default()) || way.is_empty() != self.way.is_empty() {
            second.ways.push((time_s, way.to_vec()));
            self.way.clear();
            self.way.extend_from_slice(way);
        }
        if due(&mut self.maps, time_s, MAP_S) {
            let window = navigator.certainty_window();
            second
                .maps
                .extend(window.map(|certainty| CertaintyMap { time_s, certainty }));
        }
        let route = navigator.global_route();
        if self.route != route {
            second.routes.push((time_s, route.to_vec()));
            self.route.clear();
            self.route.extend_from_slice(route);
        }
        if !due(&mut self.histograms, time_s, HISTOGRAM_S) {
            return;
        }
        let histogram = navigator.histogram();
        second
            .histograms
            .extend(histogram.map(|histogram| HistogramRow { time_s, histogram }));
        if !world.movers().is_empty() {
            second.movers.times_s.push(time_s);
            second
                .movers
                .positions
                .extend(world.movers().iter().map(|mover| mover.at(time_s)));
        }
    }
}

/// Whether the next of something that comes every so many seconds is due.
fn due(count: &mut u64, time_s: f64, every_s: f64) -> bool {
    let now = ((time_s + 1e-9) / every_s).floor() as u64 + 1;
    let is_due = now > *count;
    *count = now;
    is_due
}

fn push_command(rows: &mut CommandRows, time_s: f64, command: &Command) {
    rows.times_s.push(time_s);
    rows.speeds_mps.push(command.speed_mps);
    rows.turn_rates_radps.push(command.turn_rate_radps);
    rows.statuses.push(status_code(command.status));
}

/// The navigator's events that are told as such: what the grids say has rows of its own.
pub(super) fn happenings(navigator: &Navigator) -> impl Iterator<Item = Happening> + '_ {
    let told = |event: &&drive::Event| !matches!(event, drive::Event::Navigability { .. });
    navigator.events().iter().filter(told).cloned().map(Happening::Drive)
}
