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
use crate::grid::{Cell, EIGHT, GridGeometry, Layer, Position, Step, disc};
use crate::progress::silent;
use crate::random::{philox, unit};
use crate::rank::{CellSource, Ranker};
use crate::soil::{SoilClass, Trafficability};
use crate::swarm::{Colony, Ending, StopRule};
use crate::terrain::gradient_at;

use super::PlannerError;
use super::answer::{Plan, Stage};
use super::plan::{MOST_TICKS, Planner, Searched};
use super::refusal::beyond;
use super::search::{Search, StepGraph, search};
use super::stop::StoppedBy;
use super::watch::{Scene, Watch, centres};

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
pub(super) struct Paces {
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

    /// For those who do not ask.
    pub(super) fn none() -> Self {
        Self::new(0, 1.0)
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
pub(super) struct Hope<'a, 'b> {
    colony: &'a Colony<&'b Ranker<'b>>,
    codes: &'a [Shared<u8>],
    table: [f64; 256],
    geometry: GridGeometry,
    goal: Cell,
    /// Whether only what is known to be a nest is open.
    known_only: bool,
}

impl<'a, 'b> Hope<'a, 'b> {
    pub(super) fn new(colony: &'a Colony<&'b Ranker<'b>>, paces: &'a Paces, goal: Cell, known_only: bool) -> Self {
        Self {
            colony,
            codes: &paces.codes,
            table: paces.table(),
            geometry: colony.source().geometry(),
            goal,
            known_only,
        }
    }

    /// The cheapest way to the goal.
    pub(super) fn search(&self, start: Cell) -> Search {
        search(self, start, self.goal, &mut silent())
    }

    fn is_open(&self, cell: Cell) -> bool {
        if self.known_only {
            self.colony.is_nest(cell)
        } else {
            self.colony.may_be_nest(cell)
        }
    }
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
                .filter(|&near| self.is_open(near))
        };
        let Some(to) = open(rows, columns) else {
            return f64::INFINITY;
        };
        if rows != 0 && columns != 0 && (open(rows, 0).is_none() || open(0, columns).is_none()) {
            return f64::INFINITY;
        }
        self.least_step(from, to, step)
    }

    /// What the step costs if it is open, which takes longer to tell.
    fn least_step(&self, from: Cell, to: Cell, step: usize) -> f64 {
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

/// How laying arcs ended.
enum Laid {
    /// This one lies in nests from end to end.
    Through(Vec<Cell>),
    /// No way is left.
    Nothing,
    /// A budget is spent.
    Spent(StoppedBy),
}

impl Planner<'_> {
    /// Plans with agents deployed around an arc that is laid anew whenever more is known.
    pub(super) fn with_guided_swarm(&self, mut answer: Plan, watch: &mut Watch) -> Result<Plan, PlannerError> {
        watch.tell(Stage::Corridor, 0, 1)?;
        let geometry = self.geometry();
        let everywhere = Layer::filled(geometry, true);
        let mut colony = Colony::deploy(self.ranker, &everywhere, self.request.swarm)?;
        drop(everywhere);
        colony.stop_by(StopRule::Finished, self.request.budget)?;
        colony.watch(self.ends[0], self.ends[1]);
        let mut paces = self.paces();
        if let Some(by) = self.settle_ends(&mut colony, &mut paces, watch) {
            return self.answer_early(answer, colony, by, watch);
        }
        let nests = colony.take_nests()?;
        let Ok(ends) = self.snap(&nests, false) else {
            // Everything that decides whether the vehicle can stand there is settled.
            answer.note(&colony.tally());
            answer = self.finish(answer, nests, Searched::Part, watch)?;
            answer.note_stop(&colony, StoppedBy::Finished);
            return Ok(answer);
        };
        colony.give_nests(&nests);
        drop(nests);
        let (start, goal) = (ends.start.0, ends.goal.0);
        let arc = match self.connect(&mut colony, &mut paces, start, goal, watch)? {
            Laid::Through(arc) => arc,
            Laid::Nothing => return self.nothing_left(answer, colony, watch),
            Laid::Spent(by) => return self.answer_early(answer, colony, by, watch),
        };
        drop(paces);
        let (way, by) = match self.rule() {
            StopRule::Good => self.polish(&mut colony, arc, watch)?,
            StopRule::Connected => (arc, Some(StoppedBy::Connected)),
            rule @ (StopRule::Finished | StopRule::Statistical { .. }) => {
                return self.go_on(answer, colony, rule, watch);
            }
        };
        let by = by.unwrap_or(StoppedBy::Good);
        if by.is_budget() {
            return self.answer_early(answer, colony, by, watch);
        }
        answer.corridor = Some(self.corridor_around(&way));
        answer.note(&colony.tally());
        let nests = colony.take_nests()?;
        answer = self.finish(answer, nests, Searched::Part, watch)?;
        if answer.answer.is_ok() {
            answer.note_stop(&colony, by);
            return Ok(answer);
        }
        // The nests connect, but the vehicle's limits do not let it through here: everything else is tried.
        if let Some(nests) = answer.nests.take() {
            colony.give_nests(&nests);
        }
        answer.corridor = None;
        self.nothing_left(answer, colony, watch)
    }

    /// Tries everything else when no arc is left, and says why there is no way. Of a part of a map that is read when it is
    /// needed nothing more is read: a larger part is what is needed.
    fn nothing_left(
        &self,
        mut answer: Plan,
        mut colony: Colony<&Ranker<'_>>,
        watch: &mut Watch,
    ) -> Result<Plan, PlannerError> {
        if !(self.ranker.reads_when_needed() && self.terrain.map_continues) {
            return self.go_on(answer, colony, StopRule::Finished, watch);
        }
        answer.note(&colony.tally());
        answer.nests = Some(colony.take_nests()?);
        answer.note_stop(&colony, StoppedBy::Finished);
        Ok(answer.refused(beyond()))
    }

    /// Goes on all over the map until a rule ends that, and answers from what is known then.
    fn go_on(
        &self,
        mut answer: Plan,
        mut colony: Colony<&Ranker<'_>>,
        rule: StopRule,
        watch: &mut Watch,
    ) -> Result<Plan, PlannerError> {
        colony.stop_by(rule, self.request.budget)?;
        let by = Self::run(&mut colony, MOST_TICKS, None, watch)?;
        if by != StoppedBy::Finished {
            return self.answer_early(answer, colony, by, watch);
        }
        answer.note(&colony.tally());
        let nests = colony.take_nests()?;
        answer = self.finish(answer, nests, Searched::Whole, watch)?;
        answer.note_stop(&colony, by);
        Ok(answer)
    }

    /// Answers from what is known when the search was ended.
    fn answer_early(
        &self,
        mut answer: Plan,
        mut colony: Colony<&Ranker<'_>>,
        by: StoppedBy,
        watch: &mut Watch,
    ) -> Result<Plan, PlannerError> {
        if colony.spent() == Some(Ending::Stopped) {
            // The caller stopped the reading of ground, not the clock the work.
            return Err(PlannerError::Stopped);
        }
        answer.note(&colony.tally());
        let nests = colony.take_nests()?;
        answer = self.finish(answer, nests, Searched::Early(by), watch)?;
        if answer.answer.is_ok() {
            answer.corridor = Some(self.corridor_around(&answer.path));
        }
        answer.note_stop(&colony, by);
        Ok(answer)
    }

    fn corridor_around(&self, way: &[Cell]) -> Corridor {
        let geometry = self.geometry();
        let width_m = 2.0 * POLISH_CELLS * geometry.cell_size_m();
        Corridor::around(geometry, &centres(geometry, way), width_m)
    }

    pub(super) fn paces(&self) -> Paces {
        Paces::new(self.geometry().cell_count(), self.least_pace())
    }

    /// Which budget is spent.
    fn spent(colony: &Colony<&Ranker<'_>>, watch: &mut Watch) -> Option<StoppedBy> {
        let spent = colony.spent().map(StoppedBy::from_ending);
        spent.or_else(|| watch.time_is_over().then_some(StoppedBy::Seconds))
    }

    /// Settles everything that decides where the vehicle stands at start and goal, or returns which budget is spent.
    pub(super) fn settle_ends(
        &self,
        colony: &mut Colony<&Ranker<'_>>,
        paces: &mut Paces,
        watch: &mut Watch,
    ) -> Option<StoppedBy> {
        let reach = (self.settled_radius_m() / self.geometry().cell_size_m()).ceil();
        self.ends
            .iter()
            .find_map(|&end| self.settle_around(colony, paces, &[end], reach, watch))
    }

    /// Lays arcs and deploys agents around them until one lies in nests from end to end.
    fn connect(
        &self,
        colony: &mut Colony<&Ranker<'_>>,
        paces: &mut Paces,
        start: Cell,
        goal: Cell,
        watch: &mut Watch,
    ) -> Result<Laid, PlannerError> {
        let geometry = self.geometry();
        let total = geometry.centre(start).distance_m(geometry.centre(goal));
        let (mut tick, mut idle) = (0u32, 0);
        let mut arc: Vec<Cell> = Vec::new();
        let mut line: Vec<Position> = Vec::new();
        loop {
            let broken = !arc.iter().all(|&cell| colony.may_be_nest(cell));
            if broken || tick.is_multiple_of(KEEP_TICKS) {
                let Search::Found { cells, .. } = Hope::new(colony, paces, goal, false).search(start) else {
                    return Ok(Laid::Nothing);
                };
                arc = cells;
                line = centres(geometry, &arc);
            }
            let unsettled: Vec<Cell> = arc.iter().copied().filter(|&cell| !colony.is_nest(cell)).collect();
            let settled = 1.0 - unsettled.len() as f64 / arc.len() as f64;
            watch.tell(Stage::Regions, (settled * total) as u64, total as u64)?;
            if unsettled.is_empty() {
                return Ok(Laid::Through(arc));
            }
            if let Some(by) = Self::spent(colony, watch) {
                return Ok(Laid::Spent(by));
            }
            let before = colony.open_count();
            let sent = if idle >= PATIENCE {
                unsettled.iter().flat_map(|&cell| colony.open_cores(cell)).collect()
            } else {
                self.deployment(&unsettled, tick)
            };
            colony.send(&sent);
            self.see(colony, paces, &sent);
            let scene = Scene {
                arc: &line,
                width_m: None,
                is_route: false,
                sent: Some(&sent),
            };
            watch.picture(colony, &scene, false);
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

    /// Settles every cell within a distance of some cells, or returns which budget is spent.
    fn settle_around(
        &self,
        colony: &mut Colony<&Ranker<'_>>,
        paces: &mut Paces,
        cells: &[Cell],
        radius_cells: f64,
        watch: &mut Watch,
    ) -> Option<StoppedBy> {
        let geometry = self.geometry();
        let steps = disc(radius_cells);
        loop {
            let near = cells
                .iter()
                .flat_map(|&cell| steps.iter().filter_map(move |step| step.from(&geometry, cell)));
            let mut open: Vec<Cell> = near.filter(|&cell| colony.is_open(cell)).collect();
            if open.is_empty() {
                return None;
            }
            let spent = Self::spent(colony, watch);
            if spent.is_some() {
                return spent;
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
    pub(super) fn see(&self, colony: &Colony<&Ranker<'_>>, paces: &mut Paces, cells: &[Cell]) {
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

    /// Settles everything near the best route and plans again until that gains next to nothing; returns the way, and the
    /// budget that ended it early.
    pub(super) fn polish(
        &self,
        colony: &mut Colony<&Ranker<'_>>,
        arc: Vec<Cell>,
        watch: &mut Watch,
    ) -> Result<(Vec<Cell>, Option<StoppedBy>), PlannerError> {
        let mut way = arc;
        let mut best = f64::INFINITY;
        for round in 0..MOST_POLISH {
            watch.tell(Stage::Route, u64::from(round), u64::from(MOST_POLISH))?;
            let spent = self.settle_around(colony, &mut Paces::none(), &way, POLISH_CELLS, watch);
            let scene = Scene {
                arc: &centres(self.geometry(), &way),
                width_m: None,
                is_route: true,
                sent: None,
            };
            watch.picture(colony, &scene, true);
            if spent.is_some() {
                return Ok((way, spent));
            }
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
        Ok((way, None))
    }
}
