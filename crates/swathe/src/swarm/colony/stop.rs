//! When a colony stops: its rule, its budget, and which of them ended it.

use crate::grid::Cell;
use crate::rank::{CellSource, SourceFault};
use crate::swarm::{Budget, StopRule, SwarmError};

use super::{Colony, Ending};

impl<Source: CellSource> Colony<Source> {
    /// Forgets whether the watched cells were connected and watches others.
    pub(crate) fn watch_instead(&mut self, a: Cell, b: Cell) {
        self.tally.connected_at = None;
        self.watch(a, b);
    }

    /// Sets when the swarm stops and what it may spend in all, ticks and evaluations of the past included. Never a cell more
    /// than the budget allows is evaluated.
    ///
    /// # Errors
    /// [`SwarmError::Parameter`] when the rule's numbers are not usable.
    pub fn stop_by(&mut self, rule: StopRule, budget: Budget) -> Result<(), SwarmError> {
        rule.validate()?;
        (self.rule, self.budget, self.quiet_visits) = (rule, budget, 0);
        Ok(())
    }

    /// Which budget is spent, or why there is nothing to go on with: ground that was needed last could not be read.
    pub fn spent(&self) -> Option<Ending> {
        match self.fault {
            None => {}
            Some(SourceFault::Stopped) => return Some(Ending::Stopped),
            Some(fault) => return Some(Ending::Unread(fault)),
        }
        if self
            .budget
            .evaluations
            .is_some_and(|most| self.tally.cells_evaluated >= most)
        {
            Some(Ending::EvaluationsSpent)
        } else if self.budget.ticks.is_some_and(|most| self.tally.ticks >= most) {
            Some(Ending::TicksSpent)
        } else {
            None
        }
    }

    /// Random visits in a row without news that end this swarm, where its rule is the statistical one.
    pub fn quiet_visits_needed(&self) -> Option<u64> {
        self.rule.quiet_visits(self.ground_cells, self.params.pellet_max)
    }

    /// Why no further tick is due.
    pub(super) fn over(&self) -> Option<Ending> {
        let by_rule = match self.rule {
            StopRule::Finished => None,
            StopRule::Good | StopRule::Connected => self.tally.connected_at.map(|_| Ending::Connected),
            StopRule::Statistical { .. } => self
                .quiet_visits_needed()
                .filter(|&needed| self.quiet_visits >= needed)
                .map(|_| Ending::Statistical),
        };
        if self.open == 0 {
            Some(Ending::Finished)
        } else {
            by_rule.or_else(|| self.spent())
        }
    }
}
