//! The global way over terrain cells: searched once, repaired when the ground is known better.

use crate::grid::{Cell, GridGeometry, Layer, Position, SIXTEEN, disc};
use crate::nest::BitRows;
use crate::planner::{Ground, Headings, Repair, Search, StepGraph, search};
use crate::progress::silent;

use super::nests::NestCells;
use super::{KnownMap, RouteChange};

/// How far start and goal are moved to reach a nest, in cells, as the planner does.
const SNAP_CELLS: f64 = 2.0;

/// How robot and goal stand to each other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Standing {
    /// Nobody has asked.
    #[default]
    Unasked,
    /// A way inside the nests leads to the goal.
    InNests,
    /// A way over ground that is not no-go, outside the nests in part.
    Outside,
    /// No way within the vehicle's limits is known, but unknown ground may hold one.
    Unknown,
    /// No-go ground lies all around the robot or the goal.
    CutOff,
}

/// The way with the search behind it.
#[derive(Clone, Debug, Default)]
pub(super) struct GlobalWay {
    /// Where the robot is and where it goes.
    ends: Option<(Position, Position)>,
    repair: Option<Repair>,
    pub cells: Vec<Cell>,
    pub places: Vec<Position>,
    pub cost: Option<f64>,
    pub standing: Standing,
    afresh: bool,
}

/// The way as others see it.
pub(super) type Shown = (Vec<Cell>, Vec<Position>, Option<f64>, Standing);

/// What a way is laid on.
pub(super) struct Known<'a> {
    pub map: &'a KnownMap,
    pub codes: &'a Layer<u8>,
    pub ranks: &'a Layer<u8>,
    pub nests: &'a NestCells,
    /// Whether ground outside the nests may be crossed where they do not lead to the goal.
    pub outside: bool,
}

impl<'a> Known<'a> {
    /// The ground of all nests, from what its cells allow.
    pub fn ground(&self, headings: Headings, goal: Position) -> Ground<'a> {
        let (map, codes) = (self.map, self.codes);
        let moisture = map.rank.moisture_percent;
        Ground::on(
            map.elevation_m.view(),
            Some(codes.view()),
            &map.vehicle,
            moisture,
            headings,
            goal,
        )
    }

    /// The ground of all nests, looked at for the first time.
    pub fn first_ground(&self) -> Ground<'a> {
        let (map, codes) = (self.map, self.codes);
        let moisture = map.rank.moisture_percent;
        let is_open = |index: usize| self.nests.holds_at(index);
        let goal = self.geometry().centre(Cell::new(0, 0));
        let heights = map.elevation_m.view();
        Ground::new(heights, Some(codes.view()), &map.vehicle, moisture, is_open, None, goal)
    }

    /// The ground of all cells that are not no-go; those outside nests cost more.
    fn wide_ground(&self, goal: Position) -> Ground<'a> {
        let (map, codes, ranks) = (self.map, self.codes, self.ranks);
        let moisture = map.rank.moisture_percent;
        let is_open = |index: usize| ranks.data()[index] >= 2;
        let bridged = BitRows::from_fn(self.geometry(), |row, column| {
            let cell = Cell::new(row, column);
            ranks[cell] >= 2 && !self.nests.holds(cell)
        });
        let heights = map.elevation_m.view();
        Ground::new(
            heights,
            Some(codes.view()),
            &map.vehicle,
            moisture,
            is_open,
            Some(bridged),
            goal,
        )
    }

    fn geometry(&self) -> GridGeometry {
        self.ranks.geometry()
    }

    /// The nest cell nearest to a place, at most two cells away.
    fn snapped(&self, at: Position) -> Option<Cell> {
        let geometry = self.geometry();
        let own = geometry.cell_at(at)?;
        if self.nests.holds(own) {
            return Some(own);
        }
        let near = disc(SNAP_CELLS)
            .into_iter()
            .filter_map(|step| step.from(&geometry, own));
        let away = |cell: &Cell| geometry.centre(*cell).distance_m(at);
        let near = near.filter(|&cell| self.nests.holds(cell));
        near.min_by(|a, b| away(a).total_cmp(&away(b)).then(a.cmp(b)))
    }

    /// Whether cells that are not no-go join two places, sides and corners counting.
    fn joins(&self, from: Position, to: Position) -> bool {
        let geometry = self.geometry();
        let (Some(from), Some(to)) = (geometry.cell_at(from), geometry.cell_at(to)) else {
            return true;
        };
        let mut seen = Layer::filled(geometry, false);
        let mut open = vec![from];
        seen[from] = true;
        while let Some(cell) = open.pop() {
            if cell == to {
                return true;
            }
            for step in crate::grid::EIGHT {
                if let Some(next) = step.from(&geometry, cell)
                    && !seen[next]
                    && self.ranks[next] != 1
                {
                    seen[next] = true;
                    open.push(next);
                }
            }
        }
        false
    }
}

impl GlobalWay {
    /// Sets where the robot is and where it goes.
    pub fn aim(&mut self, at: Position, goal: Position) {
        self.ends = Some((at, goal));
    }

    /// The way as others see it.
    pub fn shown(&self) -> Shown {
        (self.cells.clone(), self.places.clone(), self.cost, self.standing)
    }

    /// Shows a way again that still holds.
    pub fn show(&mut self, shown: Shown) {
        (self.cells, self.places, self.cost, self.standing) = shown;
    }

    /// Cells that the last search looked at.
    pub fn work(&self) -> u64 {
        self.repair.as_ref().map_or(0, |repair| repair.tally().work)
    }

    /// Takes in where the robot is.
    pub fn move_to(&mut self, at: Position) {
        if let Some(ends) = &mut self.ends {
            ends.0 = at;
        }
    }

    /// Finds the way after cells have changed; says what became of it.
    pub fn find(&mut self, known: &Known, ground: &Ground, changed: &[Cell]) -> RouteChange {
        let (before, was) = (self.cost, self.standing);
        let cells_before = std::mem::take(&mut self.cells);
        if let Some(repair) = &mut self.repair {
            repair.update(ground, changed.iter().copied());
        }
        self.places.clear();
        (self.cost, self.standing, self.afresh) = (None, Standing::Unasked, false);
        if let Some((at, goal)) = self.ends {
            self.search(known, ground, at, goal);
            self.places = places(known.geometry(), &self.cells, at, goal);
        }
        RouteChange {
            cost_before: before,
            cost_after: self.cost,
            standing_before: was,
            standing: self.standing,
            cells: self.cells.len(),
            // The way of before less what was driven is the same way.
            is_other: !cells_before.ends_with(&self.cells) || self.cells.is_empty() != cells_before.is_empty(),
            afresh: self.afresh,
        }
    }

    fn search(&mut self, known: &Known, ground: &Ground, at: Position, goal: Position) {
        if let (Some(first), Some(last)) = (known.snapped(at), known.snapped(goal)) {
            if self.repair.as_ref().is_none_or(|repair| repair.goal() != last) {
                self.repair = Repair::new(ground, first, last).ok();
            }
            if let Some(repair) = &mut self.repair
                && repair.move_to(first).is_ok()
                && let Search::Found { cells, cost } = repair.path(ground, &mut silent())
            {
                self.afresh = repair.tally().afresh;
                (self.cells, self.cost, self.standing) = (cells, Some(cost), Standing::InNests);
                return;
            }
        }
        self.afresh = true;
        let geometry = known.geometry();
        if known.outside
            && let (Some(first), Some(last)) = (geometry.cell_at(at), geometry.cell_at(goal))
            && let Search::Found { cells, cost } = search(&known.wide_ground(goal), first, last, &mut silent())
        {
            (self.cells, self.cost, self.standing) = (cells, Some(cost), Standing::Outside);
            return;
        }
        let cut_off = !known.outside || !known.joins(at, goal);
        self.standing = if cut_off { Standing::CutOff } else { Standing::Unknown };
    }
}

/// The places of a way: the robot's, cell centres, and the goal's where its own cell is the last.
fn places(geometry: GridGeometry, cells: &[Cell], at: Position, goal: Position) -> Vec<Position> {
    let mut places: Vec<Position> = cells.iter().map(|&cell| geometry.centre(cell)).collect();
    if let Some(first) = places.first_mut()
        && geometry.cell_at(at) == cells.first().copied()
    {
        *first = at;
    }
    if places.len() > 1
        && geometry.cell_at(goal) == cells.last().copied()
        && let Some(last) = places.last_mut()
    {
        *last = goal;
    }
    places
}

/// What the ground asks for a way of cells, and whether it is open to its end; else what it asks before it is closed.
pub(super) fn cost_along(ground: &Ground, cells: &[Cell]) -> (f64, bool) {
    let mut sum = 0.0;
    for pair in cells.windows(2) {
        let step = SIXTEEN.iter().position(|step| {
            pair[0].row as i64 + i64::from(step.rows) == pair[1].row as i64
                && pair[0].column as i64 + i64::from(step.columns) == pair[1].column as i64
        });
        let cost = step.map_or(f64::INFINITY, |step| ground.edge_cost(pair[0], step));
        if !cost.is_finite() {
            return (sum, false);
        }
        sum += cost;
    }
    (sum, true)
}
