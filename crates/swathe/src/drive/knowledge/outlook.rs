//! What a reading is worth before it is taken: the saving of route cost that its outcomes promise.

use crate::belief::{CLASS_COUNT, CLASSES, Observation, PerClass, SoilBelief};
use crate::grid::{Cell, Position};
use crate::planner::Ground;
use crate::sensor::PenetrometerReading;
use crate::soil::SoilClass;

use super::Knowledge;
use super::way::cost_along;

/// Strengths that stand for what may be measured on one class, in standard deviations of its logarithm: three of equal chance.
const STRENGTHS: [f64; 3] = [-1.2247, 0.0, 1.2247];

/// Outcomes less likely than this count for nothing.
const LEAST_CHANCE: f64 = 1e-3;

/// Depths of the samples of a profile that is foreseen, in metres.
const DEPTHS_M: [f64; 3] = [0.05, 0.10, 0.15];

/// A place where a reading could be taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProbeSite {
    /// The cell.
    pub cell: Cell,
    /// Its place on the way.
    pub at: Position,
}

/// What a reading at a site is worth, worked out outcome by outcome.
#[derive(Clone, Debug, PartialEq)]
pub struct Outlook {
    /// Where.
    pub site: ProbeSite,
    /// Expected saving of route cost in seconds so far.
    pub saving: f64,
    next: usize,
    chances: PerClass,
}

impl Outlook {
    /// Whether all outcomes are weighed.
    pub fn is_done(&self) -> bool {
        self.next >= CLASS_COUNT * STRENGTHS.len()
    }
}

impl Knowledge {
    /// Sites along the way from a place on: every `spacing_m` metres up to `reach_m`, none within a spacing of a reading.
    pub fn probe_sites(&self, at: Position, spacing_m: f64, reach_m: f64) -> Vec<ProbeSite> {
        let geometry = self.geometry();
        let places = self.route();
        let nearest = (0..places.len()).min_by(|&a, &b| places[a].distance_m(at).total_cmp(&places[b].distance_m(at)));
        let rest = nearest.map_or(&[][..], |nearest| &places[nearest..]);
        let mut sites: Vec<ProbeSite> = Vec::new();
        let (mut along_m, mut due_m) = (0.0, 0.0);
        let mut before = at;
        for &place in rest {
            let piece_m = before.distance_m(place);
            while due_m <= along_m + piece_m && due_m <= reach_m {
                let share = if piece_m > 0.0 {
                    (due_m - along_m) / piece_m
                } else {
                    1.0
                };
                let site = before.towards(place, share);
                due_m += spacing_m;
                let is_near = |known: Position| known.distance_m(site) < spacing_m;
                if let Some(cell) = geometry.cell_at(site)
                    && !self.belief.readings().any(|(_, known, _)| is_near(known))
                {
                    sites.push(ProbeSite { cell, at: site });
                }
            }
            along_m += piece_m;
            before = place;
        }
        sites
    }

    /// Begins to weigh a reading at a site.
    pub fn outlook(&self, site: ProbeSite) -> Outlook {
        Outlook {
            site,
            saving: 0.0,
            next: 0,
            chances: self.belief.class_probabilities(site.cell),
        }
    }

    /// Weighs the next outcome: the class with its strength is taken to be measured, everything follows as after a real
    /// reading, and is taken back. The present way counts with what the new ground asks for it, plus `dead_end_cost` and the
    /// best way where it turns out closed. Codes that change nothing on the way and open nothing else cost no search.
    ///
    /// Returns how many cells were looked at, so that the work can be spread over steps.
    pub fn weigh(&mut self, outlook: &mut Outlook, dead_end_cost: f64) -> u64 {
        let (class, strength) = (outlook.next / STRENGTHS.len(), outlook.next % STRENGTHS.len());
        outlook.next += 1;
        let chance = outlook.chances[class] / STRENGTHS.len() as f64;
        if chance < LEAST_CHANCE {
            return 0;
        }
        let Some(after) = self.foreseen(outlook.site, class, STRENGTHS[strength]) else {
            return 0;
        };
        let (belief, cells) = after;
        let recoded = self.recoded(&belief, &cells);
        let mut work = cells.len() as u64;
        if recoded.is_empty() {
            return work;
        }
        let way = self.way.cells.clone();
        let before = self.way.cost;
        let done = self.apply(&recoded);
        let (kept, open) = self.with_ground(|ground| cost_along(ground, &way));
        let is_spoiled = !open || way.is_empty() || before.is_none_or(|before| (kept - before).abs() > 1e-9 * before);
        let is_better = done.gained > 0 || done.ranks.iter().any(|&(_, before, after)| after > before) || is_spoiled;
        if is_better {
            let kept_way = self.way.shown();
            let best = self.find(&done.touched).cost_after;
            outlook.saving += chance
                * match best {
                    Some(best) if open && !way.is_empty() => (kept - best).max(0.0),
                    // Closed on the way; or there was no way, and the reading may open one.
                    _ if !way.is_empty() || best.is_some() => dead_end_cost,
                    _ => 0.0,
                };
            work += self.way.work();
            let undone = self.apply(&done.codes);
            self.find(&undone.touched);
            work += self.way.work();
            // Of ways that cost the same the one that was shown stays.
            self.way.show(kept_way);
        } else {
            self.apply(&done.codes);
        }
        work + 2 * done.touched.len() as u64
    }

    /// The belief after a reading of a class that is some standard deviations stronger than is expected of it today, and
    /// the cells it touches.
    fn foreseen(&self, site: ProbeSite, class: usize, deviations: f64) -> Option<(SoilBelief, Vec<u32>)> {
        let mut belief = self.belief.clone();
        let at = site.at;
        let reading = |cone_indices_kpa: Vec<f64>, refusal_depth_m| {
            Observation::Reading(PenetrometerReading {
                x_m: at.x_m,
                y_m: at.y_m,
                depths_m: DEPTHS_M[..cone_indices_kpa.len()].to_vec(),
                cone_indices_kpa,
                refusal_depth_m,
                sleeve_frictions_kpa: None,
            })
        };
        let observation = match (
            belief.expected_cone_index_kpa(site.cell, class, &self.going),
            CLASSES[class],
        ) {
            (Some(usual_kpa), _) => {
                let params = belief.params();
                let middle_kpa = usual_kpa * (deviations * params.table_spread_ln).exp();
                let rise_kpa_per_m = params.types.0[class].gradient_kpa_per_m.mean;
                let sample = |depth: f64| (middle_kpa + rise_kpa_per_m * (depth - DEPTHS_M[1])).clamp(1.0, 1e5);
                reading(DEPTHS_M.map(sample).to_vec(), None)
            }
            (None, SoilClass::Rock) => reading(Vec::new(), Some(0.5 * DEPTHS_M[0])),
            (None, class) => Observation::Class { at, class },
        };
        let changed = belief.add(&observation).ok()?;
        Some((belief, changed.cells))
    }

    fn with_ground<T>(&mut self, work: impl FnOnce(&Ground) -> T) -> T {
        let headings = self.headings.take();
        let known = self.known();
        let ground = match headings {
            Some(headings) => known.ground(headings, self.geometry().centre(Cell::new(0, 0))),
            None => known.first_ground(),
        };
        let result = work(&ground);
        self.headings = Some(ground.into_headings());
        result
    }
}
