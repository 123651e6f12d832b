//! The route as the user gets it: legs with their facts and reasons.

use crate::grid::Position;
use crate::rank::{CellSource, SourceFault};
use crate::soil::SoilClass;

use super::clearance::Nearness;
use super::ground::{Ground, Obstacle, SegmentFacts};
use super::refusal::{describe_cell, is_no_go};
use super::search::StepGraph;

/// A straight part of a route.
#[derive(Clone, Debug, PartialEq)]
pub struct Leg {
    /// Where it starts.
    pub from: Position,
    /// Where it ends.
    pub to: Position,
    /// What it costs and asks.
    pub facts: SegmentFacts,
    /// The soil that most of it lies on.
    pub soil: SoilClass,
    /// The worst rank of the cells that it crosses.
    pub rank_min: u8,
    /// Why it is as it is: what slows the vehicle and why the way turns at its end.
    pub reason: String,
}

/// A way that the vehicle can drive.
#[derive(Clone, Debug, PartialEq)]
pub struct Route {
    /// Its legs in order; none when start and goal are the same place.
    pub legs: Vec<Leg>,
    /// Sum over the legs.
    pub total: SegmentFacts,
}

impl Route {
    /// Evaluates a way whose segments can all be driven.
    ///
    /// # Errors
    /// The [`Obstacle`] of the first segment that cannot.
    pub(super) fn evaluate(
        ground: &Ground,
        source: &impl CellSource,
        points: &[Position],
        max_speed_mps: f64,
    ) -> Result<Self, Obstacle> {
        let mut legs = Vec::new();
        let mut total = SegmentFacts::default();
        let near = Nearness::new(ground.geometry(), ground.risk_reach_m(), |cell| {
            is_no_go(source.cell_rank(cell))
        });
        let exposure = |cell| near.exposure(cell);
        for (index, pair) in points.windows(2).enumerate() {
            let facts = ground.segment_beside(pair[0], pair[1], Some(&exposure))?;
            add(&mut total, &facts, index == 0);
            let turn = points.get(index + 2).map(|&after| {
                let here = legs_cost(ground, pair[1], after).map(|next| facts.cost + next);
                turn_reason(ground, source, pair[0], after, here)
            });
            legs.push(Leg {
                from: pair[0],
                to: pair[1],
                soil: main_soil(&facts),
                rank_min: worst_rank(ground, source, pair[0], pair[1]),
                reason: reason(&facts, max_speed_mps, turn),
                facts,
            });
        }
        Ok(Self { legs, total })
    }

    /// The route's vertices.
    pub fn points(&self) -> Vec<Position> {
        let first = self.legs.first().map(|leg| leg.from);
        first.into_iter().chain(self.legs.iter().map(|leg| leg.to)).collect()
    }
}

pub(super) fn add(total: &mut SegmentFacts, leg: &SegmentFacts, first: bool) {
    total.length_m += leg.length_m;
    total.time_s += leg.time_s;
    total.cost += leg.cost;
    total.energy_j += leg.energy_j;
    total.risk_s += leg.risk_s;
    total.climb_m += leg.climb_m;
    total.descent_m += leg.descent_m;
    total.bridged_m += leg.bridged_m;
    total.side_slope_max = total.side_slope_max.max(leg.side_slope_max);
    total.grade_max = if first {
        leg.grade_max
    } else {
        total.grade_max.max(leg.grade_max)
    };
    total.grade_min = if first {
        leg.grade_min
    } else {
        total.grade_min.min(leg.grade_min)
    };
    for (sum, part) in total.soil_m.iter_mut().zip(leg.soil_m) {
        *sum += part;
    }
}

/// Has the source read the ground beside a way and where straight lines that leave a vertex out end, of which the route
/// tells.
///
/// # Errors
/// [`SourceFault`] when ground cannot be read.
pub(super) fn read_beside(ground: &Ground, source: &impl CellSource, points: &[Position]) -> Result<(), SourceFault> {
    let geometry = ground.geometry();
    let reach = (ground.risk_reach_m() / geometry.cell_size_m()).ceil() as usize;
    for pair in points.windows(2) {
        let mut cells = Vec::new();
        crate::grid::pieces(&geometry, pair[0], pair[1], |piece| {
            cells.push(piece.cell);
            true
        });
        source.prefetch(&mut cells.into_iter(), reach)?;
    }
    for ends in points.windows(3) {
        if let Err(Obstacle::Closed(cell)) = ground.segment(ends[0], ends[2]) {
            source.prefetch(&mut std::iter::once(cell), 0)?;
        }
    }
    Ok(())
}

fn legs_cost(ground: &Ground, a: Position, b: Position) -> Option<f64> {
    ground.segment(a, b).ok().map(|facts| facts.cost)
}

fn main_soil(facts: &SegmentFacts) -> SoilClass {
    let most = facts.soil_m.iter().copied().fold(0.0, f64::max);
    let code = facts.soil_m.iter().position(|&metres| metres == most).unwrap_or(0);
    SoilClass::ALL[code]
}

fn worst_rank(ground: &Ground, source: &impl CellSource, a: Position, b: Position) -> u8 {
    let mut worst = 10;
    crate::grid::pieces(&ground.geometry(), a, b, |piece| {
        worst = worst.min(source.cell_rank(piece.cell).rank());
        true
    });
    worst
}

/// What slows the vehicle on a leg, then why the way turns.
fn reason(facts: &SegmentFacts, max_speed_mps: f64, turn: Option<String>) -> String {
    let speed_mps = facts.length_m / facts.time_s;
    let percent = |grade: f64| (grade * 100.0).round();
    let pace = if facts.bridged_m > 0.0 {
        format!("leaves the nests for {:.0} m", facts.bridged_m)
    } else if speed_mps > 0.98 * max_speed_mps {
        "full speed".to_owned()
    } else if facts.grade_max >= 0.02 && facts.grade_max >= -facts.grade_min {
        format!(
            "slowed by {} soil and up to {} % uphill",
            main_soil(facts).name(),
            percent(facts.grade_max)
        )
    } else if facts.grade_min <= -0.02 {
        format!(
            "slowed by {} soil and up to {} % downhill",
            main_soil(facts).name(),
            percent(-facts.grade_min)
        )
    } else {
        format!("slowed by {} soil", main_soil(facts).name())
    };
    match turn {
        Some(turn) => format!("{pace}; then turns {turn}"),
        None => format!("{pace}; reaches the goal"),
    }
}

/// Why the straight line that leaves a vertex out is not taken.
fn turn_reason(
    ground: &Ground,
    source: &impl CellSource,
    before: Position,
    after: Position,
    cost: Option<f64>,
) -> String {
    match ground.segment(before, after) {
        Err(Obstacle::MapEdge) => "to stay on the map".to_owned(),
        Err(Obstacle::Closed(cell)) => format!("around {}", describe_cell(source, cell)),
        Err(Obstacle::Grade(_, grade)) if grade > 0.0 => {
            format!("to avoid {:.0} % uphill", grade * 100.0)
        }
        Err(Obstacle::Grade(_, grade)) => format!("to avoid {:.0} % downhill", -grade * 100.0),
        Err(Obstacle::SideSlope(_, slope)) => {
            format!("to avoid a side slope of {:.0} %", slope * 100.0)
        }
        Err(Obstacle::Traction(_, grade)) => {
            format!(
                "to avoid {:.0} % uphill on soil without the traction for it",
                grade * 100.0
            )
        }
        Err(Obstacle::Braking(_, grade)) => {
            format!(
                "to avoid {:.0} % downhill, where the brakes do not hold",
                -grade * 100.0
            )
        }
        Err(Obstacle::Rollover(_, slope)) => {
            format!("to avoid tipping over on a side slope of {:.0} %", slope * 100.0)
        }
        Ok(facts) => match cost {
            Some(cost) => format!("to save {:.0} s", (facts.cost - cost).max(0.0)) + ground.objective().weighing(),
            None => "to save time".to_owned() + ground.objective().weighing(),
        },
    }
}
