//! The swarm in a swathe around an arc that stays: widened until start and goal connect, or the route is certified.

use std::cell::Cell as Shared;

use crate::corridor::{ArcKind, Corridor};
use crate::grid::{Cell, Layer};
use crate::rank::Ranker;
use crate::swarm::{Budget, Colony, Ending, StopRule};

use super::PlannerError;
use super::answer::{Plan, Stage, SwarmReport};
use super::guided::{Hope, Paces};
use super::plan::{MOST_TICKS, Planner, Searched};
use super::search::Search;
use super::spine::{coarse_count, spine};
use super::stop::StoppedBy;
use super::watch::{Scene, Watch};

/// Ticks after which a connected swarm is asked for the first time again whether its route is good enough.
const FIRST_RUN: u64 = 16;

/// A way is good when it costs at most so many times what may be hoped for.
const GOOD_COST: f64 = 1.05;

impl Planner<'_> {
    /// Runs the swarm in a swathe that is widened until start and goal connect, or the route is certified.
    pub(super) fn with_swarm(&self, mut answer: Plan, watch: &mut Watch) -> Result<Plan, PlannerError> {
        let geometry = self.geometry();
        watch.tell(Stage::Corridor, 0, 1)?;
        let [start, goal] = self.places();
        let mut coarse_cells = 0;
        let mut points = None;
        if matches!(self.request.arc, ArcKind::Spine | ArcKind::Relaid) {
            coarse_cells = coarse_count(geometry);
            if self.request.budget.after(coarse_cells).is_none() {
                return self.nothing_seen(answer, watch);
            }
            points = spine(self.terrain, self.vehicle, self.params, [start, goal])?;
        }
        let (arc, width_m) = (self.request.arc, self.request.width_m);
        let mut corridor = Corridor::lay(geometry, start, goal, arc, width_m, || points)?;
        let mut inside = corridor.cells(geometry);
        let mut colony = Colony::deploy(self.ranker, &inside, self.request.swarm)?;
        let budget = self.request.budget.after(coarse_cells).unwrap_or_default();
        colony.stop_by(self.rule(), budget)?;
        colony.watch(self.ends[0], self.ends[1]);
        if matches!(self.rule(), StopRule::Good | StopRule::Connected) {
            self.watch_standing(&mut colony, watch)?;
        }
        let mut widened = 0;
        loop {
            let by = self.search_swathe(&mut colony, &corridor, budget, watch)?;
            let tally = colony.tally();
            answer.swarm = Some(SwarmReport { tally, widened });
            answer.cells_evaluated = tally.cells_evaluated + coarse_cells;
            answer.corridor = Some(corridor.clone());
            let nests = colony.take_nests()?;
            if by.is_budget() {
                answer = self.finish(answer, nests, Searched::Early(by), watch)?;
                answer.note_stop(&colony, by);
                return Ok(answer);
            }
            let whole = inside.data().iter().all(|&inside| inside);
            let searched = match by {
                StoppedBy::Finished if whole => Searched::Whole,
                StoppedBy::Finished => Searched::Swathe(&inside),
                _ => Searched::Early(by),
            };
            let ends = self.snap(&nests, searched.is_whole());
            let refused =
                by == StoppedBy::Finished && ends.is_err() && corridor.width_m() >= 2.0 * self.settled_radius_m();
            let connected = ends.is_ok_and(|ends| ends.connected);
            if refused || connected || whole {
                answer = self.finish(answer, nests, searched, watch)?;
                let certify = self.request.certify && !answer.optimal;
                // Nests that connect but hold no route say little while more can be found.
                let unfinished = matches!(by, StoppedBy::Good | StoppedBy::Connected);
                let again = (!whole || unfinished) && (answer.answer.is_err() || certify);
                if refused || !again {
                    answer.note_stop(&colony, by);
                    return Ok(answer);
                }
                let nests = answer.nests.take();
                let Some(nests) = nests else { return Ok(answer) };
                colony.give_nests(&nests);
                if unfinished {
                    colony.stop_by(StopRule::Finished, budget)?;
                    continue;
                }
            } else {
                colony.give_nests(&nests);
            }
            corridor = corridor.widened();
            widened += 1;
            inside = corridor.cells(geometry);
            colony.widen(&inside)?;
        }
    }

    /// The refusal of a budget that does not even allow the coarse look at the map.
    fn nothing_seen(&self, mut answer: Plan, watch: &mut Watch) -> Result<Plan, PlannerError> {
        let nowhere = Layer::filled(self.geometry(), false);
        let mut colony = Colony::deploy(self.ranker, &nowhere, self.request.swarm)?;
        answer.note(&colony.tally());
        let nests = colony.take_nests()?;
        answer = self.finish(answer, nests, Searched::Early(StoppedBy::Evaluations), watch)?;
        answer.note_stop(&colony, StoppedBy::Evaluations);
        Ok(answer)
    }

    /// Watches the cells on which the vehicle will stand at start and goal, where the swathe is wide enough to tell.
    fn watch_standing(&self, colony: &mut Colony<&Ranker<'_>>, watch: &mut Watch) -> Result<(), PlannerError> {
        self.settle_ends(colony, &mut Paces::none(), watch);
        let nests = colony.take_nests()?;
        colony.give_nests(&nests);
        if let Ok(ends) = self.snap(&nests, false) {
            colony.watch_instead(ends.start.0, ends.goal.0);
        }
        Ok(())
    }

    /// Runs the swarm in its present swathe until its rule ends it.
    fn search_swathe(
        &self,
        colony: &mut Colony<&Ranker<'_>>,
        corridor: &Corridor,
        budget: Budget,
        watch: &mut Watch,
    ) -> Result<StoppedBy, PlannerError> {
        let mut by = Self::run(colony, MOST_TICKS, Some(corridor), watch)?;
        if self.rule() != StopRule::Good || by != StoppedBy::Connected {
            return Ok(by);
        }
        // Connected: from here on it counts how good the route is.
        let mut ticks = FIRST_RUN;
        colony.stop_by(StopRule::Finished, budget)?;
        let way = loop {
            if let Some(way) = self.good_way(colony)? {
                break way;
            }
            by = Self::run(colony, ticks, Some(corridor), watch)?;
            let is_pause = by == StoppedBy::Ticks && colony.spent().is_none();
            if !is_pause {
                return Ok(by);
            }
            ticks *= 2;
        };
        let (_, by) = self.polish(colony, way, watch)?;
        Ok(by.unwrap_or(StoppedBy::Good))
    }

    /// The cheapest way through the nests that are known, if hardly a cheaper one is left to hope for.
    fn good_way(&self, colony: &mut Colony<&Ranker<'_>>) -> Result<Option<Vec<Cell>>, PlannerError> {
        let nests = colony.take_nests()?;
        colony.give_nests(&nests);
        let Ok(ends) = self.snap(&nests, false) else {
            return Ok(None);
        };
        drop(nests);
        let mut paces = self.paces();
        let seen: Vec<Cell> = self
            .geometry()
            .cells()
            .filter(|&cell| colony.is_evaluated(cell))
            .collect();
        self.see(colony, &mut paces, &seen);
        let known = Hope::new(colony, &paces, ends.goal.0, true).search(ends.start.0);
        let hoped = Hope::new(colony, &paces, ends.goal.0, false).search(ends.start.0);
        Ok(match (known, hoped) {
            (Search::Found { cells, cost }, Search::Found { cost: hoped, .. }) if cost <= GOOD_COST * hoped => {
                Some(cells)
            }
            _ => None,
        })
    }

    /// [`Colony::run`] with pictures, for at most so many ticks.
    pub(super) fn run(
        colony: &mut Colony<&Ranker<'_>>,
        ticks: u64,
        corridor: Option<&Corridor>,
        watch: &mut Watch,
    ) -> Result<StoppedBy, PlannerError> {
        let last = colony.tally().ticks.saturating_add(ticks);
        let scene = Scene {
            arc: corridor.map_or(&[], Corridor::arc),
            width_m: corridor.map(Corridor::width_m),
            is_route: false,
            sent: None,
        };
        loop {
            watch.picture(colony, &scene, false);
            let now = colony.tally().ticks;
            let until = watch.next_frame().map_or(last, |tick| tick.max(now + 1).min(last));
            let late = Shared::new(false);
            let ending = colony.run(until - now, &mut watch.regions(&late));
            let is_pause = ending == Ending::TicksSpent && colony.tally().ticks < last && colony.spent().is_none();
            if is_pause {
                continue;
            }
            if ending == Ending::Stopped && !late.get() {
                return Err(PlannerError::Stopped);
            }
            watch.picture(colony, &scene, true);
            return Ok(StoppedBy::from_ending(ending));
        }
    }
}
