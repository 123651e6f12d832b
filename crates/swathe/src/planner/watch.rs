//! Who watches a planner at work: progress, the end of the time given, and pictures.

use std::cell::Cell as Shared;

use crate::grid::{Cell, GridGeometry, Position};
use crate::rank::CellSource;
use crate::swarm::{Colony, Frame};

use super::PlannerError;
use super::answer::{Stage, StageReport};

/// The swarm and the arc at one tick.
#[derive(Clone, Debug, PartialEq)]
pub struct ArcFrame {
    /// The swarm; its agents are those that were sent in this tick.
    pub swarm: Frame,
    /// The arc from start to goal.
    pub arc: Vec<Position>,
    /// Width of the swathe around it in metres; `None` where the whole map is open to the swarm.
    pub width_m: Option<f64>,
    /// Whether the arc is a route through nests that is being improved.
    pub is_route: bool,
}

/// Pictures of a planner at work: never more than asked for, spread evenly over the ticks.
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    step: usize,
    most: usize,
    every: u64,
    frames: Vec<ArcFrame>,
}

impl Film {
    /// A film of at most `most` frames (at least 2) in blocks of `step` x `step` cells (0 counts as 1).
    pub fn new(most: usize, step: usize) -> Self {
        Self {
            step,
            most: most.max(2),
            every: 1,
            frames: Vec::new(),
        }
    }

    /// The frames in order of time.
    pub fn frames(self) -> Vec<ArcFrame> {
        self.frames
    }

    /// The first tick at which another frame is wanted.
    fn due(&self) -> u64 {
        self.frames
            .last()
            .map_or(0, |frame| frame.swarm.tally.ticks + self.every)
    }

    fn take(&mut self, frame: ArcFrame) {
        if self.frames.len() >= self.most {
            let mut index = 0;
            self.frames.retain(|_| {
                index += 1;
                index % 2 == 1
            });
            self.every *= 2;
        }
        self.frames.push(frame);
    }
}

/// What the planner asks and tells on its way. None of it changes what is found, but that work may be cut short.
pub struct Watch<'a> {
    report: &'a mut StageReport<'a>,
    time_is_over: &'a mut dyn FnMut() -> bool,
    film: Option<&'a mut Film>,
}

impl<'a> Watch<'a> {
    /// `report` is told of progress and may stop the work; when `time_is_over` the best that is known is answered.
    pub fn new(
        report: &'a mut StageReport<'a>,
        time_is_over: &'a mut dyn FnMut() -> bool,
        film: Option<&'a mut Film>,
    ) -> Self {
        Self {
            report,
            time_is_over,
            film,
        }
    }

    /// Tells of progress.
    ///
    /// # Errors
    /// [`PlannerError::Stopped`] when the caller asks to stop.
    pub(super) fn tell(&mut self, stage: Stage, done: u64, total: u64) -> Result<(), PlannerError> {
        if (self.report)(stage, done, total) {
            Ok(())
        } else {
            Err(PlannerError::Stopped)
        }
    }

    pub(super) fn ask(&mut self, stage: Stage, done: u64, total: u64) -> bool {
        (self.report)(stage, done, total)
    }

    pub(super) fn time_is_over(&mut self) -> bool {
        (self.time_is_over)()
    }

    /// A report for a swarm's run that ends it when the time is over, and notes in `late` that this was the reason.
    pub(super) fn regions<'b>(&'b mut self, late: &'b Shared<bool>) -> impl FnMut(u64, u64) -> bool + 'b {
        move |done, total| {
            if (self.time_is_over)() {
                late.set(true);
                return false;
            }
            (self.report)(Stage::Regions, done, total)
        }
    }

    /// The tick up to which the swarm may run before the next picture.
    pub(super) fn next_frame(&self) -> Option<u64> {
        self.film.as_ref().map(|film| film.due())
    }

    /// Takes a picture if one is due, or if it is the `last`.
    pub(super) fn picture<Source: CellSource>(&mut self, colony: &Colony<Source>, scene: &Scene, last: bool) {
        let Some(film) = &mut self.film else { return };
        let ticks = colony.tally().ticks;
        let is_new = film.frames.last().is_none_or(|frame| frame.swarm.tally.ticks < ticks);
        if ticks < film.due() && !(last && is_new) {
            return;
        }
        let mut swarm = colony.frame(film.step);
        if let Some(sent) = scene.sent {
            let step = swarm.step;
            swarm.agents = sent
                .iter()
                .map(|cell| [(cell.row / step) as u32, (cell.column / step) as u32])
                .collect();
        }
        film.take(ArcFrame {
            swarm,
            arc: scene.arc.to_vec(),
            width_m: scene.width_m,
            is_route: scene.is_route,
        });
    }
}

/// What a picture shows besides the swarm.
pub(super) struct Scene<'a> {
    pub arc: &'a [Position],
    pub width_m: Option<f64>,
    pub is_route: bool,
    /// Cells of the agents that were sent in this tick; those of all agents where not given.
    pub sent: Option<&'a [Cell]>,
}

/// The centres of cells.
pub(super) fn centres(geometry: GridGeometry, cells: &[Cell]) -> Vec<Position> {
    cells.iter().map(|&cell| geometry.centre(cell)).collect()
}
