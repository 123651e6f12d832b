//! Stopping early: what ended the search for ground, what is not known yet, and a refusal that claims no more than that.

use crate::grid::GridGeometry;
use crate::rank::{CellSource, Ranker, SourceFault};
use crate::swarm::{Budget, Colony, Ending};

use super::answer::Plan;
use super::refusal::{Refusal, Status, unread};

/// What ended the search for ground.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoppedBy {
    /// The route is good enough for what is known.
    Good,
    /// Start and goal are connected.
    Connected,
    /// Nothing more can be found.
    Finished,
    /// Little can be left to find.
    Statistical,
    /// The budget of ticks is spent.
    Ticks,
    /// The budget of evaluations is spent.
    Evaluations,
    /// The time is over.
    Seconds,
    /// Ground that was needed next cannot be read.
    Unread(SourceFault),
}

impl StoppedBy {
    /// A stable word for files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Connected => "connected",
            Self::Finished => "finished",
            Self::Statistical => "statistical",
            Self::Ticks => "max_ticks",
            Self::Evaluations => "max_evaluations",
            Self::Seconds => "max_seconds",
            Self::Unread(_) => "unread",
        }
    }

    /// Why a swarm's run ended; a caller that stops it because of the time says so itself.
    pub(super) fn from_ending(ending: Ending) -> Self {
        match ending {
            Ending::Finished => Self::Finished,
            Ending::Connected => Self::Connected,
            Ending::Statistical => Self::Statistical,
            Ending::TicksSpent => Self::Ticks,
            Ending::EvaluationsSpent => Self::Evaluations,
            Ending::Stopped => Self::Seconds,
            Ending::Unread(fault) => Self::Unread(fault),
        }
    }

    /// Whether nothing more may or can be looked at: a budget ended the search, or ground that cannot be read.
    pub(super) fn is_budget(self) -> bool {
        matches!(self, Self::Ticks | Self::Evaluations | Self::Seconds | Self::Unread(_))
    }
}

/// How the search for ground ended and what it left unseen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StopReport {
    /// What ended it.
    pub by: StoppedBy,
    /// Cells of the swathe that nobody has looked at. The swathe is the one that the answer names, else the whole map.
    pub unknown_cells: u64,
    /// Cells of that swathe.
    pub swathe_cells: u64,
    /// Random visits in a row without news that end the search by the statistical rule, if that is the rule.
    pub quiet_visits: Option<u64>,
}

impl Plan {
    /// Ground that was wanted and could not be read: the answer holds for what was known by then.
    pub fn fault(&self) -> Option<SourceFault> {
        match self.stopped.map(|stopped| stopped.by) {
            Some(StoppedBy::Unread(fault)) => Some(fault),
            _ => self.unread,
        }
    }

    /// Notes what ended the search and what of the answer's swathe is unseen.
    pub(super) fn note_stop(&mut self, colony: &Colony<&Ranker<'_>>, by: StoppedBy) {
        let geometry: GridGeometry = colony.source().geometry();
        let inside = self.corridor.as_ref().map(|corridor| corridor.cells(geometry));
        let (mut swathe_cells, mut unknown_cells) = (0, 0);
        for cell in geometry.cells() {
            if inside.as_ref().is_none_or(|inside| inside[cell]) {
                swathe_cells += 1;
                unknown_cells += u64::from(!colony.is_evaluated(cell));
            }
        }
        self.stopped = Some(StopReport {
            by,
            unknown_cells,
            swathe_cells,
            quiet_visits: colony.quiet_visits_needed(),
        });
    }
}

/// Refuses without a claim about the ground: the search was ended before it could tell.
pub(super) fn stopped_early(by: StoppedBy, budget: Budget) -> Refusal {
    let (what, option) = match by {
        StoppedBy::Ticks => (spent(budget.ticks, "tick"), "a larger `--max-ticks`"),
        StoppedBy::Evaluations => (spent(budget.evaluations, "evaluation"), "a larger `--max-evaluations`"),
        StoppedBy::Seconds => ("the time given was over".to_owned(), "a larger `--max-seconds`"),
        StoppedBy::Unread(_) => return unread(),
        _ => ("the statistical rule ended the search".to_owned(), "`--stop finished`"),
    };
    Refusal {
        status: Status::NoRoute,
        reason: format!(
            "Stopped early: {what} before start and goal were known to be connected. Whether there is a way is not known."
        ),
        place: None,
        remedy: format!("Give {option}: more ground will be looked at."),
    }
}

fn spent(most: Option<u64>, unit: &str) -> String {
    let count = most.unwrap_or(super::plan::MOST_TICKS);
    let plural = if count == 1 { "" } else { "s" };
    format!("the budget of {count} {unit}{plural} was spent")
}
