//! The swarm guided by an arc that is laid anew whenever more is known: it looks at little, and stops when the route is
//! good enough.
//!
//! Every tick the arc is the cheapest way over cells that are nests or may still become nests, unseen cells counted at the
//! mean cost of those seen. Agents are deployed around the part of it that is not settled. When all of it lies in nests the
//! ends are connected by a way no dearer than what was hoped for; then everything near the route is settled and the route is
//! planned again until that gains next to nothing. Not optimal: a cheaper way that never looked cheaper than the mean
//! stays unseen. A refusal is certain: no cell that may still be ground connects the ends.

use std::cell::Cell as Shared;
use std::f64::consts::SQRT_2;

use crate::corridor::Corridor;
use crate::grid::{Cell, EIGHT, GridGeometry, Position, Step, disc};
use crate::progress::silent;
use crate::random::{philox, unit};
use crate::soil::{SoilClass, Trafficability};
use crate::swarm::{Colony, Ending};
use crate::terrain::gradient_at;

use super::PlannerError;
use super::answer::{Plan, Stage, StageReport};
use super::plan::{MOST_TICKS, Planner, Searched};
use super::search::{Search, StepGraph, search};

/// Mean distance of agents from the arc along each axis, in cells.
const SPREAD_CELLS: f64 = 1.5;

/// Every cell this near to the best route is settled before the answer, in cells.
const POLISH_CELLS: f64 = 8.0;

/// The route is planned again until it gains less than this share.
const POLISH_GAIN: f64 = 0.005;

/// Rounds of polishing before the route is taken as it is.
const MOST_POLISH: u32 = 12;

/// Ticks without news after which the open cells of the arc are visited one by one.
const PATIENCE: u32 = 4;

/// Ticks for which an arc is kept while nothing known closes it.
const KEEP_TICKS: u32 = 4;

/// Share of the mean cost that the search for the arc takes as its bound: nearly blind to detours that would be cheaper
/// than the mean, and quick.
const HOPE: f64 = 1.0;

/// Tells the draws of deployments from all others.
const DRAW: u32 = 0x5377_6174;

/// Costs per metre as seen by the swarm, on a logarithmic scale of one byte; 0 is not seen.
struct Paces {
    codes: Vec<Shared<u8>>,
    sum: f64,
    count: f64,
    least: f64,
}

impl Paces {
    const STEPS: f64 = 32.0;

    fn new(cells: usize, least: f64) -> Self {
        Self {
            codes: vec![Shared::new(0); cells],
            sum: 0.0,
            count: 0.0,
            least,
        }
    }

    fn learn(&mut self, index: usize, pace: f64) {
        if self.codes[index].get() == 0 {
            let code = 1.0 + Self::STEPS * (pace / self.least).max(1.0).ln();
            self.codes[index].set(code.min(255.0) as u8);
            self.sum += pace;
            self.count += 1.0;
        }
    }

    fn mean(&self) -> f64 {
        if self.count > 0.0 {
            self.sum / self.count
        } else {
            1.2 * self.least
        }
    }

    /// The cost that each code stands for.
    fn table(&self) -> [f64; 256] {
        std::array::from_fn(|code| match code {
            0 => self.mean(),
            code => self.least * ((code as f64 - 1.0) / Self::STEPS).exp(),
        })
    }
}

/// The map as hoped for: what is no nest is closed, what is not seen costs the mean.
struct Hope<'a, 'b> {
    colony: &'a Colony<&'b crate::rank::Ranker<'b>>,
    codes: &'a [Shared<u8>],
    table: [f64; 256],
    geometry: GridGeometry,
    goal: Cell,
}

impl StepGraph for Hope<'_, '_> {
    fn geometry(&self) -> GridGeometry {
        self.geometry
    }

    fn steps(&self) -> &[Step] {
        &EIGHT
    }

    fn edge_cost(&self, from: Cell, step: usize) -> f64 {
        let Step { rows, columns } = EIGHT[step];
        let open = |rows, columns| {
            self.geometry
                .offset(from, rows, columns)
                .filter(|&near| self.colony.may_be_nest(near))
        };
        let Some(to) = open(rows, columns) else {
            return f64::INFINITY;
        };
        if rows != 0 && columns != 0 && (open(rows, 0).is_none() || open(0, columns).is_none()) {
            return f64::INFINITY;
        }
        let pace = |cell| self.table[usize::from(self.codes[self.geometry.index(cell)].get())];
        let paces = pace(from) + pace(to);
        EIGHT[step].length_cells() * self.geometry.cell_size_m() * paces / 2.0
    }

    fn bound(&self, cell: Cell) -> f64 {
        // The length of the shortest way over eight neighbours.
        let (rows, columns) = (cell.row.abs_diff(self.goal.row), cell.column.abs_diff(self.goal.column));
        let (short, long) = (rows.min(columns) as f64, rows.max(columns) as f64);
        let length_m = self.geometry.cell_size_m() * (long + (SQRT_2 - 1.0) * short);
        HOPE * self.table[0] * length_m
    }
}

impl Planner<'_> {
    /// Plans with agents deployed around an arc that is laid anew whenever more is known.
    pub(super) fn with_guided_swarm(&self, mut answer: Plan, report: &mut StageReport) -> Result<Plan, PlannerError> {
        if !report(Stage::Corridor, 0, 1) {
            return Err(PlannerError::Stopped);
        }
        let geometry = self.geometry();
        let everywhere = crate::grid::Layer::filled(geometry, true);
        let mut colony = Colony::deploy(self.ranker, &everywhere, self.request.swarm)?;
        drop(everywhere);
        colony.watch(self.ends[0], self.ends[1]);
        let mut paces = Paces::new(geometry.cell_count(), self.least_pace());
        let reach = (self.settled_radius_m() / geometry.cell_size_m()).ceil();
        for end in self.ends {
            self.settle_around(&mut colony, &mut paces, &[end], reach);
        }
        let nests = colony.take_nests()?;
        let Ok(ends) = self.snap(&nests, false) else {
            // Everything that decides whether the vehicle can stand there is settled.
            answer.note(&colony.tally());
            return self.finish(answer, nests, Searched::Part, report);
        };
        colony.give_nests(&nests);
        drop(nests);
        let (start, goal) = (ends.start.0, ends.goal.0);
        let Some(arc) = self.connect(&mut colony, &mut paces, start, goal, report)? else {
            return self.give_up(answer, colony, report);
        };
        drop(paces.codes.split_off(0));
        let way = self.polish(&mut colony, arc, report)?;
        let points: Vec<Position> = way.iter().map(|&cell| geometry.centre(cell)).collect();
        answer.corridor = Some(Corridor::around(
            geometry,
            &points,
            2.0 * POLISH_CELLS * geometry.cell_size_m(),
        ));
        answer.note(&colony.tally());
        let nests = colony.take_nests()?;
        answer = self.finish(answer, nests, Searched::Part, report)?;
        if answer.answer.is_ok() {
            return Ok(answer);
        }
        // The nests connect, but the vehicle's limits do not let it through here: everything else is tried.
        if let Some(nests) = answer.nests.take() {
            colony.give_nests(&nests);
        }
        answer.corridor = None;
        self.give_up(answer, colony, report)
    }

    /// Settles the whole map and answers from that.
    fn give_up(
        &self,
        mut answer: Plan,
        mut colony: Colony<&crate::rank::Ranker<'_>>,
        report: &mut StageReport,
    ) -> Result<Plan, PlannerError> {
        let ending = colony.run(MOST_TICKS, &mut |done, total| report(Stage::Regions, done, total));
        if ending == Ending::Stopped {
            return Err(PlannerError::Stopped);
        }
        answer.note(&colony.tally());
        let nests = colony.take_nests()?;
        self.finish(answer, nests, Searched::Whole, report)
    }

    /// Lays arcs and deploys agents around them until one lies in nests from end to end; `None` when no way is left.
    fn connect(
        &self,
        colony: &mut Colony<&crate::rank::Ranker<'_>>,
        paces: &mut Paces,
        start: Cell,
        goal: Cell,
        report: &mut StageReport,
    ) -> Result<Option<Vec<Cell>>, PlannerError> {
        let geometry = self.geometry();
        let total = geometry.centre(start).distance_m(geometry.centre(goal));
        let (mut tick, mut idle) = (0u32, 0);
        let mut arc: Vec<Cell> = Vec::new();
        loop {
            let broken = !arc.iter().all(|&cell| colony.may_be_nest(cell));
            if broken || tick.is_multiple_of(KEEP_TICKS) {
                let hope = Hope {
                    colony,
                    codes: &paces.codes,
                    table: paces.table(),
                    geometry,
                    goal,
                };
                let Search::Found { cells, .. } = search(&hope, start, goal, &mut silent()) else {
                    return Ok(None);
                };
                arc = cells;
            }
            let unsettled: Vec<Cell> = arc.iter().copied().filter(|&cell| !colony.is_nest(cell)).collect();
            let settled = 1.0 - unsettled.len() as f64 / arc.len() as f64;
            if !report(Stage::Regions, (settled * total) as u64, total as u64) {
                return Err(PlannerError::Stopped);
            }
            if unsettled.is_empty() {
                return Ok(Some(arc));
            }
            let before = colony.open_count();
            let sent = if idle >= PATIENCE {
                unsettled.iter().flat_map(|&cell| colony.open_cores(cell)).collect()
            } else {
                self.deployment(&unsettled, tick)
            };
            colony.send(&sent);
            self.see(colony, paces, &sent);
            tick += 1;
            idle = if colony.open_count() < before { 0 } else { idle + 1 };
        }
    }

    /// Where agents are deployed in a tick: around random cells of the arc, ever rarer with the distance.
    fn deployment(&self, arc: &[Cell], tick: u32) -> Vec<Cell> {
        let geometry = self.geometry();
        let agents = self.request.swarm.agents;
        // More agents than cells near the arc would only meet each other.
        let most = (arc.len() as u32).saturating_mul(4).max(16);
        let place = |agent: u32| {
            let draw = philox([agent, tick, DRAW, 0], self.request.swarm.seed);
            let cell = arc[(unit(draw[0]) * arc.len() as f64) as usize];
            let offset = |word: u32| {
                let share = 2.0 * unit(word) - 1.0;
                (-(1.0 - share.abs()).ln() * SPREAD_CELLS)
                    .min(1e6)
                    .round()
                    .copysign(share) as i32
            };
            geometry.offset(cell, offset(draw[1]), offset(draw[2])).unwrap_or(cell)
        };
        (0..agents.min(most)).map(place).collect()
    }

    /// Settles every cell within a distance of some cells.
    fn settle_around(
        &self,
        colony: &mut Colony<&crate::rank::Ranker<'_>>,
        paces: &mut Paces,
        cells: &[Cell],
        radius_cells: f64,
    ) {
        let geometry = self.geometry();
        let steps = disc(radius_cells);
        loop {
            let near = cells
                .iter()
                .flat_map(|&cell| steps.iter().filter_map(move |step| step.from(&geometry, cell)));
            let mut open: Vec<Cell> = near.filter(|&cell| colony.is_open(cell)).collect();
            if open.is_empty() {
                return;
            }
            open.sort_unstable();
            open.dedup();
            colony.send(&open);
            if !paces.codes.is_empty() {
                self.see(colony, paces, &open);
            }
        }
    }

    /// Learns the costs of cells that turned out suitable.
    fn see(&self, colony: &Colony<&crate::rank::Ranker<'_>>, paces: &mut Paces, cells: &[Cell]) {
        let geometry = self.geometry();
        for &cell in cells {
            let index = geometry.index(cell);
            if colony.is_suitable(cell) && paces.codes[index].get() == 0 {
                paces.learn(index, self.pace(cell));
            }
        }
    }

    /// Cost of a metre over a cell when the heading is not known: the mean of up and down half its slope. Risk is left
    /// out, since what lies beside a cell that was just seen is not known; polishing counts it.
    fn pace(&self, cell: Cell) -> f64 {
        let slope = gradient_at(self.terrain.elevation_m, cell).map_or(0.0, crate::terrain::Gradient::slope);
        let code = self.terrain.soil.map_or(0, |soil| soil[cell]);
        let class = SoilClass::ALL[usize::from(code)];
        let traffic = Trafficability::of(self.vehicle, class, self.params.moisture_percent);
        let objective = &self.request.objective;
        let cost = |grade| super::ground::cost_per_m(self.vehicle, &traffic, grade, objective).unwrap_or(0.0);
        let mean = f64::midpoint(cost(slope / 2.0), cost(-slope / 2.0));
        let factor = self.terrain.cost_factor.map_or(1.0, |factor| f64::from(factor[cell]));
        mean * factor
    }

    /// The least cost of a metre that the swarm tells from others: at most a thousandth of the greatest of the user's
    /// factors, where there are factors.
    fn least_pace(&self) -> f64 {
        let objective = &self.request.objective;
        let idle = objective.energy * self.vehicle.idle_power_w / self.vehicle.power_w;
        let flat = ((objective.time + idle) / self.vehicle.max_speed_mps).max(1e-9);
        let Some(factors) = self.terrain.cost_factor else {
            return flat;
        };
        let finite = factors.data().iter().copied().filter(|factor| factor.is_finite());
        let (least, most) = finite.fold((f32::INFINITY, 0.0f32), |(least, most), factor| {
            (least.min(factor), most.max(factor))
        });
        if most > 0.0 {
            flat * f64::from(least).max(1e-3 * f64::from(most))
        } else {
            flat
        }
    }

    /// Settles everything near the best route and plans again until that gains next to nothing; returns the way.
    fn polish(
        &self,
        colony: &mut Colony<&crate::rank::Ranker<'_>>,
        arc: Vec<Cell>,
        report: &mut StageReport,
    ) -> Result<Vec<Cell>, PlannerError> {
        let mut way = arc;
        let mut best = f64::INFINITY;
        let mut none = Paces::new(0, 1.0);
        for round in 0..MOST_POLISH {
            if !report(Stage::Route, u64::from(round), u64::from(MOST_POLISH)) {
                return Err(PlannerError::Stopped);
            }
            self.settle_around(colony, &mut none, &way, POLISH_CELLS);
            let nests = colony.take_nests()?;
            let found = match self.snap(&nests, false) {
                Ok(ends) if ends.connected => {
                    let ground = self.ground(&nests, &ends, false, &mut 0);
                    search(&ground, ends.start.0, ends.goal.0, &mut silent())
                }
                _ => Search::Unreachable,
            };
            colony.give_nests(&nests);
            let Search::Found { cells, cost } = found else { break };
            let gained = best - cost >= POLISH_GAIN * cost;
            best = best.min(cost);
            way = cells;
            if !gained {
                break;
            }
        }
        Ok(way)
    }
}
