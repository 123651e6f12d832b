//! What arcs cost on the ground, forward and in reverse.

use crate::grid::{Layer, Position, pieces};
use crate::vehicle::Vehicle;

use super::curves::{CurveArc, Pose, Word, principal, words};
use super::{DrivableParams, DrivablePath, DrivenArc};
use crate::planner::ground::{Ground, SegmentFacts};
use crate::planner::route::add;
use crate::planner::search::StepGraph;

/// Turn of one chord that stands for an arc, in radians: its middle lies within 0.5 % of the radius from the arc.
const CHORD_RAD: f64 = 0.2;

/// Words tried from one pose to another, the cheapest on level ground first.
const MOST_WORDS: usize = 6;

/// Words this many times as dear as the cheapest are not tried.
const DEAREST: f64 = 3.0;

/// A curve from one pose to another, with its cost.
#[derive(Clone, Debug)]
pub(super) struct Step {
    pub(super) from: Pose,
    pub(super) to: Pose,
    pub(super) arcs: Vec<CurveArc>,
    /// Cost of the arcs and of the changes of direction between them.
    pub(super) cost: f64,
}

impl Step {
    /// Whether it begins in reverse; `None` when it has no arcs.
    pub(super) fn begins_reverse(&self) -> Option<bool> {
        self.arcs.first().map(|arc| arc.length_m < 0.0)
    }

    /// Whether it ends in reverse.
    pub(super) fn ends_reverse(&self) -> Option<bool> {
        self.arcs.last().map(|arc| arc.length_m < 0.0)
    }
}

/// A vehicle on its ground.
pub(super) struct Drive<'a, 'g> {
    pub(super) ground: &'a Ground<'g>,
    vehicle: &'a Vehicle,
    params: &'a DrivableParams,
    /// Cost of a change of direction.
    pub(super) cusp_cost: f64,
}

impl<'a, 'g> Drive<'a, 'g> {
    pub(super) fn new(ground: &'a Ground<'g>, vehicle: &'a Vehicle, params: &'a DrivableParams) -> Self {
        // A second of standing costs what a second at greatest speed costs, whatever the cost is made of.
        let cost_per_s = ground.least_cost_per_m() * vehicle.max_speed_mps;
        Self {
            ground,
            vehicle,
            params,
            cusp_cost: params.cusp_time_s * cost_per_s,
        }
    }

    pub(super) fn radius_m(&self) -> f64 {
        self.vehicle.min_turn_radius_m
    }

    pub(super) fn params(&self) -> &DrivableParams {
        self.params
    }

    /// What an arc costs; `None` where a limit or closed ground forbids it or it leaves the corridor.
    pub(super) fn arc(&self, from: Pose, arc: CurveArc, inside: Option<&Layer<bool>>) -> Option<SegmentFacts> {
        let turn_rad = (arc.curvature_per_m * arc.length_m).abs();
        let chords = (turn_rad / CHORD_RAD).ceil().max(1.0);
        let half = turn_rad / chords / 2.0;
        let stretch = if half > 0.0 { half / half.sin() } else { 1.0 };
        let reverse = arc.length_m < 0.0;
        let mut total = SegmentFacts::default();
        let mut here = from.position();
        for chord in 1..=chords as usize {
            let next = from.after(CurveArc {
                length_m: arc.length_m * chord as f64 / chords,
                ..arc
            });
            let there = next.position();
            if !inside.is_none_or(|inside| lies_inside(inside, here, there)) {
                return None;
            }
            let mut facts = self.ground.segment(here, there).ok()?;
            if reverse {
                // The nose points the other way, and its limits are those of the opposite direction.
                self.ground.segment(there, here).ok()?;
                self.slow_down(&mut facts);
            }
            lengthen(&mut facts, stretch);
            add(&mut total, &facts, chord == 1);
            here = there;
        }
        Some(total)
    }

    /// Time, cost and energy of driving in reverse.
    fn slow_down(&self, facts: &mut SegmentFacts) {
        let longer = self.params.reverse_factor;
        facts.energy_j += (longer - 1.0) * facts.time_s * self.vehicle.idle_power_w;
        facts.time_s *= longer;
        facts.risk_s *= longer;
        facts.cost *= longer;
    }

    /// What a sequence of arcs costs, changes of direction included.
    fn arcs(&self, from: Pose, arcs: &[CurveArc], inside: Option<&Layer<bool>>) -> Option<f64> {
        let (mut here, mut cost) = (from, 0.0);
        let mut before = 0.0;
        for &arc in arcs {
            if arc.length_m * before < 0.0 {
                cost += self.cusp_cost;
            }
            cost += self.arc(here, arc, inside)?.cost;
            here = here.after(arc);
            before = arc.length_m;
        }
        Some(cost)
    }

    /// A curve to one of some poses: the first that can be driven, the cheapest on level ground first.
    pub(super) fn shot(&self, from: Pose, goals: &[Pose], inside: Option<&Layer<bool>>) -> Option<Step> {
        let radius_m = self.radius_m();
        let mut found: Vec<(f64, Word, Pose)> = Vec::new();
        for &to in goals {
            for word in words(from, to, radius_m) {
                found.push((self.weighted(&word), word, to));
            }
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        let most = DEAREST * found.first()?.0;
        let mut before = f64::NEG_INFINITY;
        let mut tried = 0;
        for (weighted, word, to) in found {
            if tried == MOST_WORDS || weighted > most {
                break;
            }
            // One curve is often found by several formulas.
            if weighted - before < 1e-9 {
                continue;
            }
            (before, tried) = (weighted, tried + 1);
            let arcs: Vec<CurveArc> = word.arcs(radius_m).collect();
            if let Some(cost) = self.arcs(from, &arcs, inside) {
                return Some(Step { from, to, arcs, cost });
            }
        }
        None
    }

    /// Length of a word in turning radii, reversing and changes of direction counted at their cost.
    fn weighted(&self, word: &Word) -> f64 {
        let cusp = self.params.cusp_time_s * self.vehicle.max_speed_mps / self.radius_m();
        word.weighted(self.params.reverse_factor, cusp)
    }

    /// What the cheapest curve between two poses costs where the ground is at its best.
    pub(super) fn curve_cost(&self, from: Pose, to: Pose) -> f64 {
        let words = words(from, to, self.radius_m());
        let least = words
            .iter()
            .map(|word| self.weighted(word))
            .fold(f64::INFINITY, f64::min);
        least * self.radius_m() * self.ground.least_cost_per_m()
    }

    /// Puts steps together into a path; `None` when an arc cannot be driven, which the search has excluded.
    pub(super) fn path(&self, steps: &[Step], states: usize) -> Option<DrivablePath> {
        let mut path = DrivablePath::empty(self.radius_m());
        path.end = steps.last().map(|step| step.to);
        path.states = states;
        for step in steps {
            let mut from = step.from;
            for &arc in &step.arcs {
                let facts = self.arc(from, arc, None)?;
                match path.arcs.last().and_then(|last| self.joined(last, arc)) {
                    Some(joined) => *path.arcs.last_mut()? = joined,
                    None => path.arcs.push(DrivenArc { from, arc, facts }),
                }
                from = from.after(arc);
            }
        }
        for (index, DrivenArc { arc, facts, .. }) in path.arcs.iter().enumerate() {
            add(&mut path.total, facts, index == 0);
            path.reverse_m += (-arc.length_m).max(0.0);
        }
        let turns = path.arcs.windows(2);
        path.cusps = turns
            .filter(|pair| pair[0].arc.length_m * pair[1].arc.length_m < 0.0)
            .count();
        let cusps = path.cusps as f64;
        path.total.time_s += cusps * self.params.cusp_time_s;
        path.total.energy_j += cusps * self.params.cusp_time_s * self.vehicle.idle_power_w;
        path.total.cost += cusps * self.cusp_cost;
        Some(path)
    }

    /// Two arcs of one curvature and direction as one. Its chords lie a little otherwise, so it is looked at again.
    fn joined(&self, last: &DrivenArc, next: CurveArc) -> Option<DrivenArc> {
        let CurveArc {
            curvature_per_m,
            length_m,
        } = last.arc;
        if length_m * next.length_m <= 0.0 || (curvature_per_m - next.curvature_per_m).abs() > 1e-12 {
            return None;
        }
        let arc = CurveArc {
            curvature_per_m,
            length_m: length_m + next.length_m,
        };
        let facts = self.arc(last.from, arc, None)?;
        Some(DrivenArc { arc, facts, ..*last })
    }

    /// The route itself, for a vehicle that turns at each of its points.
    pub(super) fn turning_in_place(&self, route: &[Position]) -> Option<DrivablePath> {
        let mut path = DrivablePath::empty(0.0);
        for pair in route.windows(2).filter(|pair| pair[0] != pair[1]) {
            let heading = (pair[1].y_m - pair[0].y_m).atan2(pair[1].x_m - pair[0].x_m);
            let from = Pose::new(pair[0], principal(heading));
            let arc = CurveArc {
                curvature_per_m: 0.0,
                length_m: pair[0].distance_m(pair[1]),
            };
            let facts = self.ground.segment(pair[0], pair[1]).ok()?;
            add(&mut path.total, &facts, path.arcs.is_empty());
            path.arcs.push(DrivenArc { from, arc, facts });
            path.end = Some(Pose::new(pair[1], from.heading_rad));
        }
        Some(path)
    }

    /// A lower bound of the cost between two places.
    pub(super) fn least_cost(&self, from: Position, to: Position) -> f64 {
        self.ground.least_cost_per_m() * from.distance_m(to)
    }

    /// Side of a cell of the ground.
    pub(super) fn cell_size_m(&self) -> f64 {
        self.ground.geometry().cell_size_m()
    }
}

/// Makes the chord's figures those of its arc; climb and grades stay.
fn lengthen(facts: &mut SegmentFacts, stretch: f64) {
    facts.length_m *= stretch;
    facts.time_s *= stretch;
    facts.cost *= stretch;
    facts.energy_j *= stretch;
    facts.risk_s *= stretch;
    facts.bridged_m *= stretch;
    for metres in &mut facts.soil_m {
        *metres *= stretch;
    }
}

/// Whether all cells that a segment crosses are inside.
fn lies_inside(inside: &Layer<bool>, a: Position, b: Position) -> bool {
    pieces(&inside.geometry(), a, b, |piece| inside[piece.cell])
}
