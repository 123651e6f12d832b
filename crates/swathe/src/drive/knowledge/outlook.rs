//! What a reading is worth before it is taken: the saving of route cost that its outcomes promise.

use crate::belief::{CLASS_COUNT, CLASSES, Observation, PerClass, SoilBelief};
use crate::grid::{Cell, Position, disc};
use crate::planner::Ground;
use crate::sensor::PenetrometerReading;
use crate::soil::SoilClass;

use super::Knowledge;
use super::way::cost_along;

/// Strengths that stand for what may be measured on one class, in standard deviations of its logarithm: three of equal chance.
const STRENGTHS: [f64; 3] = [-1.2247, 0.0, 1.2247];

/// Outcomes less likely than this count for nothing.
const LEAST_CHANCE: f64 = 1e-5;

/// What an outcome must promise before the best way after it is searched, in seconds.
const LEAST_SAVING_S: f64 = 1.0;

/// How far behind the border of a polygon its first site lies, in metres.
const BEYOND_M: f64 = 0.5;

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
    /// Cells of the ways, as indices, that a reading here speaks for.
    near: Vec<u32>,
    /// Those of them that the robot is about to drive on.
    ahead: Vec<Cell>,
    /// What outcomes that were weighed make of those cells, and what they save.
    known: Vec<(Vec<(usize, u8)>, f64)>,
}

impl Outlook {
    /// Whether all outcomes are weighed.
    pub fn is_done(&self) -> bool {
        self.next >= CLASS_COUNT * STRENGTHS.len()
    }
}

/// The rest of a way from its place nearest to another on.
pub(in crate::drive) fn from_nearest(way: &[Position], at: Position) -> &[Position] {
    let nearest = (0..way.len()).min_by(|&a, &b| way[a].distance_m(at).total_cmp(&way[b].distance_m(at)));
    nearest.map_or(&[], |nearest| &way[nearest..])
}

impl Knowledge {
    /// Sites from a place on along a way: behind the borders of polygons, and every `spacing_m` metres, up to `reach_m`; none within
    /// three quarters of the spacing of a reading in the same polygon.
    pub fn probe_sites(&self, at: Position, way: &[Position], spacing_m: f64, reach_m: f64) -> Vec<ProbeSite> {
        let geometry = self.geometry();
        let unit = |place| geometry.cell_at(place).map(|cell| self.belief.unit_at(cell));
        let step_m = 0.5 * geometry.cell_size_m().min(2.0 * BEYOND_M);
        let mut sites: Vec<ProbeSite> = Vec::new();
        let (mut along_m, mut due_m) = (0.0, 0.0);
        let (mut before, mut last_unit) = (at, unit(at));
        for &place in from_nearest(way, at) {
            let piece_m = before.distance_m(place);
            let steps = (piece_m / step_m).ceil().max(1.0);
            for step in 1..=steps as usize {
                if due_m > reach_m {
                    return sites;
                }
                let here_m = along_m + piece_m * step as f64 / steps;
                let here = before.towards(place, step as f64 / steps);
                let unit_here = unit(here);
                if unit_here != last_unit {
                    // Another polygon: nothing that was read before speaks for it.
                    last_unit = unit_here;
                    due_m = due_m.min(here_m + BEYOND_M);
                }
                if here_m < due_m {
                    continue;
                }
                due_m = here_m + spacing_m;
                let is_near = |known: Position| known.distance_m(here) < 0.75 * spacing_m && unit(known) == unit_here;
                if let Some(cell) = geometry.cell_at(here)
                    && !self.belief.readings().any(|(_, known, _)| is_near(known))
                {
                    sites.push(ProbeSite { cell, at: here });
                }
            }
            along_m += piece_m;
            before = place;
        }
        sites
    }

    /// Begins to weigh a reading at a site on a way that the robot is about to drive, beside the global way.
    pub fn outlook(&self, site: ProbeSite, way: &[Position]) -> Outlook {
        let geometry = self.geometry();
        let reach_m = self.belief.reach_m();
        let is_near = |cell: &Cell| geometry.centre(*cell).distance_m(site.at) <= reach_m;
        let mut ahead: Vec<Cell> = way.iter().filter_map(|&place| geometry.cell_at(place)).collect();
        ahead.retain(is_near);
        ahead.sort_unstable();
        ahead.dedup();
        let mut near: Vec<Cell> = self.way.cells.iter().copied().filter(is_near).collect();
        near.extend(&ahead);
        near.sort_unstable();
        near.dedup();
        Outlook {
            site,
            saving: 0.0,
            next: 0,
            chances: self.belief.class_probabilities(site.cell),
            near: near.into_iter().map(|cell| geometry.index(cell) as u32).collect(),
            ahead,
            known: Vec::new(),
        }
    }

    /// Indices of the cells within a distance of a place.
    fn cells_around(&self, at: Position, reach_m: f64) -> Vec<u32> {
        let geometry = self.geometry();
        let Some(middle) = geometry.cell_at(at) else {
            return Vec::new();
        };
        let steps = disc(reach_m / geometry.cell_size_m());
        let cells = steps.into_iter().filter_map(|step| step.from(&geometry, middle));
        cells.map(|cell| geometry.index(cell) as u32).collect()
    }

    /// Weighs the next outcome: the class with its strength is taken to be measured, and what follows around the site as far as
    /// a reading speaks for itself is taken back again. Where that closes the present way, knowing it saves `dead_end_cost`;
    /// where it makes the way dearer, what the best way then saves. Outcomes that say the same of the way are worked out once,
    /// and those that change nothing on it save nothing.
    ///
    /// Returns how many cells were looked at, so that the work can be spread over steps.
    pub fn weigh(&mut self, outlook: &mut Outlook, dead_end_cost: f64) -> u64 {
        let (class, strength) = (outlook.next / STRENGTHS.len(), outlook.next % STRENGTHS.len());
        outlook.next += 1;
        let chance = outlook.chances[class] / STRENGTHS.len() as f64;
        if chance < LEAST_CHANCE {
            return 0;
        }
        let Some(belief) = self.foreseen(outlook.site, class, STRENGTHS[strength]) else {
            return 0;
        };
        let recoded = self.recoded(&belief, &outlook.near);
        let mut work = outlook.near.len() as u64;
        if recoded.is_empty() {
            return work;
        }
        if let Some((_, saving)) = outlook.known.iter().find(|(codes, _)| *codes == recoded) {
            outlook.saving += chance * saving;
            return work;
        }
        let done = self.apply(&recoded);
        let way = std::mem::take(&mut self.way.cells);
        let (kept, open) = self.with_ground(|ground| cost_along(ground, &way));
        self.way.cells = way;
        let open = open && outlook.ahead.iter().all(|&cell| self.ranks[cell] != 1);
        self.apply(&done.codes);
        work += 2 * done.touched.len() as u64;
        let before = self.way.cost.unwrap_or(kept);
        let mut saving = if open { (kept - before).max(0.0) } else { dead_end_cost };
        // No way is cheaper on worse ground than the best on the ground as it is: more than this is not saved.
        if open && chance * saving > LEAST_SAVING_S {
            let around = self.cells_around(outlook.site.at, self.belief.reach_m());
            let recoded = self.recoded(&belief, &around);
            let shown = self.way.shown();
            let done = self.apply(&recoded);
            let best = self.find(&done.touched).cost_after;
            work += around.len() as u64 + self.way.work();
            let undone = self.apply(&done.codes);
            self.find(&undone.touched);
            work += self.way.work();
            // Of ways that cost the same the one that was shown stays.
            self.way.show(shown);
            saving = best.map_or(dead_end_cost, |best| (kept - best).clamp(0.0, saving));
        }
        outlook.known.push((recoded, saving));
        outlook.saving += chance * saving;
        work
    }
    /// The belief after a reading of a class that is some standard deviations stronger than is expected of it today.
    fn foreseen(&self, site: ProbeSite, class: usize, deviations: f64) -> Option<SoilBelief> {
        let belief = &self.belief;
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
        belief.foreseen(&observation).ok()
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
