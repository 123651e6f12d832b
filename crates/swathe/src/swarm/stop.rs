//! When a swarm stops, and what it may spend until then.

use super::SwarmError;

/// Share of the swathe that the statistical rule leaves open, and how sure it is of that.
pub const STATISTICAL: StopRule = StopRule::Statistical {
    open_share: 1e-3,
    doubt: 0.05,
};

/// When looking for ground is over. Whatever the rule, a swarm that cannot find more ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StopRule {
    /// Start and goal are connected and the route is good enough for what is known; a swarm by itself, which knows no
    /// routes, takes it as [`StopRule::Connected`].
    Good,
    /// The two watched cells lie in one nest.
    Connected,
    /// No cell can become a core any more: exactly finished.
    Finished,
    /// So many visits to random cells in a row met no suitable cell that lacks pellets, that the share of such cells is
    /// below `open_share` with the confidence 1 - `doubt`.
    Statistical {
        /// Share of the swathe's cells, above 0 and below 1.
        open_share: f64,
        /// Above 0 and below 1.
        doubt: f64,
    },
}

impl StopRule {
    /// Random visits in a row without news that end a swarm: ceil(-ln doubt / open share). If the share were greater, so
    /// many would miss all such cells with a probability below `doubt`. Infinite for the other rules.
    pub fn quiet_visits(self) -> u64 {
        match self {
            Self::Statistical { open_share, doubt } => (-doubt.ln() / open_share).ceil() as u64,
            _ => u64::MAX,
        }
    }

    /// Checks the numbers of the rule.
    ///
    /// # Errors
    /// [`SwarmError::Parameter`] for a share or doubt that is not between 0 and 1.
    pub fn validate(self) -> Result<(), SwarmError> {
        let Self::Statistical { open_share, doubt } = self else {
            return Ok(());
        };
        for (name, given) in [("share left open", open_share), ("doubt", doubt)] {
            if !(given > 0.0 && given < 1.0) {
                let allowed = "it must be above 0 and below 1";
                return Err(SwarmError::Parameter { name, given, allowed });
            }
        }
        Ok(())
    }
}

/// What a swarm may spend; nothing given is no limit, 0 is nothing at all.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Budget {
    /// Ticks.
    pub ticks: Option<u64>,
    /// Cells whose rank is asked for.
    pub evaluations: Option<u64>,
}

impl Budget {
    /// What is left when some evaluations were spent elsewhere; `None` when they were too many.
    #[must_use]
    pub fn after(self, evaluations: u64) -> Option<Self> {
        let left = match self.evaluations {
            None => None,
            Some(most) => Some(most.checked_sub(evaluations)?),
        };
        Some(Self {
            evaluations: left,
            ..self
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_statistical_rule_counts_as_the_formula_says_and_refuses_shares_that_are_none() {
        assert_eq!(STATISTICAL.quiet_visits(), 2996);
        assert_eq!(StopRule::Finished.quiet_visits(), u64::MAX);
        for (open_share, doubt) in [(0.0, 0.1), (1.0, 0.1), (0.1, 0.0), (0.1, 1.0), (f64::NAN, 0.1)] {
            assert!(StopRule::Statistical { open_share, doubt }.validate().is_err());
        }
        assert_eq!(STATISTICAL.validate(), Ok(()));
    }
}
