//! Rules and budgets that end a swarm. The clock is read here: the core has none.

use std::time::{Duration, Instant};

use pyo3::prelude::*;
use pyo3::types::PyDict;
use swathe::swarm::{Budget, StopRule};

use crate::convert::{entry, word};

/// The time that a swarm has.
pub(crate) struct Deadline {
    end: Option<Instant>,
}

impl Deadline {
    /// So many seconds from now; for ever without them, or with more than a clock can hold.
    fn new(seconds: Option<f64>) -> Self {
        let seconds = seconds.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
        Self {
            end: seconds.and_then(|seconds| Instant::now().checked_add(seconds)),
        }
    }

    pub(crate) fn is_over(&self) -> bool {
        self.end.is_some_and(|end| Instant::now() >= end)
    }
}

/// What ends a swarm, from the entries of Python's `StopParams`.
pub(crate) fn stop_params(dict: &Bound<PyDict>) -> PyResult<(Option<StopRule>, Budget, Deadline)> {
    let statistical = StopRule::Statistical {
        open_share: entry(dict, "open_share")?,
        doubt: entry(dict, "doubt")?,
    };
    let rules = [
        ("good", StopRule::Good),
        ("connected", StopRule::Connected),
        ("finished", StopRule::Finished),
        ("statistical", statistical),
    ];
    let rule: Option<String> = entry(dict, "rule")?;
    let rule = rule.map(|rule| word("stop rule", &rule, &rules)).transpose()?;
    let budget = Budget {
        ticks: entry(dict, "max_ticks")?,
        evaluations: entry(dict, "max_evaluations")?,
    };
    Ok((rule, budget, Deadline::new(entry(dict, "max_seconds")?)))
}
