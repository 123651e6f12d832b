//! Ways for the footprint itself, where the circle around it finds none or leads into trouble.
//!
//! A search of poses on what was met, place by place rather than cell by cell: A* with a weighted bound over places and headings
//! as in Hybrid A* (Dolgov, Thrun, Montemerlo and Diebel, "Path planning for autonomous vehicles in unknown semi-structured
//! environments", International Journal of Robotics Research 29, 2010). A vehicle that turns in place goes along sixteen
//! directions and turns between them; one with a turning circle drives arcs and straights, forwards and backwards. The bound is
//! the way of a disc that fits into the footprint. The search goes on from step to step while the robot stands.

mod arcs;
mod field;
mod frame;
mod walk;

use std::collections::HashMap;
use std::f64::consts::{PI, TAU};

use crate::grid::Position;
use crate::local::CertaintyGrid;
use crate::sensor::{Pose, wrap};

use super::memory::Memory;
use super::params::Shape;
use arcs::Arcs;
use field::{Field, MARGIN_M, MOST_CELLS};
use frame::Frame;
use walk::Walk;

/// The parts of cells in which something was met, by cell of the certainty grid's lattice.
pub(super) type Met = HashMap<(i64, i64), u64>;

/// Weight of the bound.
const WEIGHT: f64 = 1.5;

/// Cost of a metre backwards, near to what was met, and on ground that was never seen, as multiples of a plain one.
const BACK_FACTOR: f64 = 1.5;
const NEAR_FACTOR: f64 = 1.4;
const UNSEEN_FACTOR: f64 = 1.5;

/// Cells that a search looks at beyond robot and goal: at first, and when that is closed.
const AROUND_CELLS: i64 = 128;
const WIDE_CELLS: i64 = 384;

/// Cells of the field that are laid in one step of the navigator.
const LAID_PER_STEP: usize = 40_000;

/// What is known: where things were met, what was seen, and the grid whose cells these are.
pub(super) type Known<'a> = (&'a Met, &'a Memory, &'a CertaintyGrid);

/// A part of a way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Leg {
    /// Turn in place to a heading.
    Turn { to_rad: f64 },
    /// Drive an arc; backwards with a negative length.
    Run {
        from: (f64, f64, f64),
        curvature_per_m: f64,
        length_m: f64,
    },
}

impl Leg {
    /// Metres that are driven.
    pub fn length_m(&self) -> f64 {
        match self {
            Self::Turn { .. } => 0.0,
            Self::Run { length_m, .. } => length_m.abs(),
        }
    }
}

/// How hard a search tries.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Effort {
    /// Around robot and goal.
    #[default]
    Usual,
    /// Farther away too.
    Wide,
    /// With less free room on each side.
    Tight,
}

/// How a search stands.
pub(super) enum Threading {
    On,
    Found(Vec<Leg>),
    /// There is none in what is known; told is whether that closes the goal in.
    Nothing {
        goal_closed: bool,
    },
}

/// A search of poses that goes on from step to step.
pub(super) struct Search {
    field: Field,
    is_laid: bool,
    kind: Kind,
}

/// How the search on a field stands.
enum Progress {
    On,
    Found(Vec<Leg>),
    Exhausted,
}

enum Kind {
    Walk(Walk),
    Arcs(Arcs),
}

impl std::fmt::Debug for Search {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        to.debug_struct("Search")
            .field("field", &self.field)
            .finish_non_exhaustive()
    }
}

impl Search {
    /// A search from a pose to within some metres of a goal.
    pub fn new(known: Known, shape: &Shape, pose: &Pose, (goal, near_goal_m): (Position, f64), effort: Effort) -> Self {
        let size_m = known.2.params().cell_size_m;
        let away_m = Position::new(pose.x_m, pose.y_m).distance_m(goal);
        let most_m = (MOST_CELLS - 2 * WIDE_CELLS) as f64 * size_m;
        let (goal, near_goal_m) = if away_m > most_m {
            let nearer = Position::new(pose.x_m, pose.y_m).towards(goal, most_m / away_m);
            (nearer, near_goal_m.max(size_m))
        } else {
            (goal, near_goal_m.max(size_m))
        };
        let (closes_m, around_cells) = match effort {
            Effort::Usual => (MARGIN_M, AROUND_CELLS),
            Effort::Wide => (MARGIN_M, WIDE_CELLS),
            Effort::Tight => (0.5 * MARGIN_M, WIDE_CELLS),
        };
        // Along the robot's own heading it leaves what it has driven into.
        let frame = if shape.turns_in_place() && effort == Effort::Tight {
            Frame::of(pose)
        } else {
            Frame::of(&Pose::default())
        };
        let field = Field::new(known, shape, pose, (goal, near_goal_m), (closes_m, around_cells), frame);
        let inside = frame.pose(pose);
        let start = (inside.x_m, inside.y_m, inside.heading_rad);
        let (x_m, y_m) = frame.inside((goal.x_m, goal.y_m));
        let goal = Position::new(x_m, y_m);
        let kind = if shape.turns_in_place() {
            Kind::Walk(Walk::new(&field, start, goal, near_goal_m))
        } else {
            Kind::Arcs(Arcs::new(
                &field,
                start,
                (goal, near_goal_m),
                shape.turn_radius_m,
                effort,
            ))
        };
        Self {
            field,
            is_laid: false,
            kind,
        }
    }

    /// Goes on.
    pub fn go_on(&mut self) -> Threading {
        if !self.is_laid {
            self.is_laid = self.field.lay_on(LAID_PER_STEP);
            if self.is_laid {
                match &mut self.kind {
                    Kind::Walk(walk) => walk.begin(&self.field),
                    Kind::Arcs(arcs) => arcs.begin(&self.field),
                }
            }
            return Threading::On;
        }
        let found = match &mut self.kind {
            Kind::Walk(walk) => walk.go_on(&self.field),
            Kind::Arcs(arcs) => arcs.go_on(&self.field),
        };
        match found {
            Progress::On => Threading::On,
            Progress::Found(legs) => {
                let frame = self.field.frame;
                Threading::Found(legs.into_iter().map(|leg| frame.leg(leg)).collect())
            }
            Progress::Exhausted => Threading::Nothing {
                goal_closed: self.field.closes_goal_in(),
            },
        }
    }
}

/// The pose after some metres of an arc, negative ones backwards.
pub(super) fn after((x_m, y_m, heading_rad): (f64, f64, f64), curvature_per_m: f64, way_m: f64) -> (f64, f64, f64) {
    let (ahead, left, turn) = super::safety::along(curvature_per_m, way_m);
    let (sin, cos) = heading_rad.sin_cos();
    (
        x_m + cos * ahead - sin * left,
        y_m + sin * ahead + cos * left,
        wrap(heading_rad + turn),
    )
}

/// Where a robot is on an arc: metres along it in the direction of travel, metres to its left and how far its heading is off.
pub(super) fn on_run(pose: &Pose, from: (f64, f64, f64), curvature_per_m: f64, backs: bool) -> (f64, f64, f64) {
    let (dx, dy) = (pose.x_m - from.0, pose.y_m - from.1);
    let (sin, cos) = from.2.sin_cos();
    let (ahead, left) = (cos * dx + sin * dy, cos * dy - sin * dx);
    let (way_m, left_m) = if curvature_per_m.abs() < 1e-9 {
        (ahead, left)
    } else {
        let radius_m = 1.0 / curvature_per_m;
        let side = radius_m.signum();
        // Around the circle's middle, which lies at (0, radius).
        let angle = (side * ahead).atan2(side * (radius_m - left));
        let angle = if backs && side * angle > PI / 2.0 {
            angle - side * TAU
        } else {
            angle
        };
        let angle = if !backs && side * angle < -PI / 2.0 {
            angle + side * TAU
        } else {
            angle
        };
        (angle * radius_m, side * (radius_m.abs() - ahead.hypot(radius_m - left)))
    };
    let heading_rad = from.2 + curvature_per_m * way_m;
    let along_m = if backs { -way_m } else { way_m };
    (along_m, left_m, wrap(heading_rad - pose.heading_rad))
}
