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
    /// Random visits in a row without news that end a swarm of so many cells and pellets; none for the other rules.
    ///
    /// If a share p of the cells were open, w visits would miss all of them with a probability below exp(-p w). The rule
    /// looks anew after every visit that met one, each time with fewer of them left, so the chances of all shares above
    /// `open_share` are summed: pellets x cells / w x exp(-`open_share` x w) is at most `doubt`. The plain -ln doubt / open
    /// share would hold for one series of visits that was fixed beforehand, and fails here.
    pub fn quiet_visits(self, cells: u64, pellet_max: u8) -> Option<u64> {
        let Self::Statistical { open_share, doubt } = self else {
            return None;
        };
        let looks = (cells.max(1) as f64 * f64::from(pellet_max) / doubt).ln();
        let mut low = -doubt.ln() / open_share;
        let mut high = low.max(looks / open_share);
        for _ in 0..64 {
            let middle = f64::midpoint(low, high);
            if open_share * middle + middle.ln() < looks {
                low = middle;
            } else {
                high = middle;
            }
        }
        Some(high.ceil().max(1.0) as u64)
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
    fn the_statistical_rule_counts_as_its_bound_says_and_refuses_shares_that_are_none() {
        // 100,000 / 0.05 looks: 0.001 w + ln w = 14.5.
        let visits = STATISTICAL.quiet_visits(100_000, 1).unwrap() as f64;
        approx::assert_relative_eq!(0.001 * visits + visits.ln(), 2e6f64.ln(), epsilon = 0.002);
        assert!(STATISTICAL.quiet_visits(100_000, 3) > STATISTICAL.quiet_visits(100_000, 1));
        // One cell is one look: the plain formula.
        assert_eq!(STATISTICAL.quiet_visits(1, 1), Some(2996));
        assert_eq!(StopRule::Finished.quiet_visits(9, 1), None);
        for (open_share, doubt) in [(0.0, 0.1), (1.0, 0.1), (0.1, 0.0), (0.1, 1.0), (f64::NAN, 0.1)] {
            assert!(StopRule::Statistical { open_share, doubt }.validate().is_err());
        }
        assert_eq!(STATISTICAL.validate(), Ok(()));
    }
}
