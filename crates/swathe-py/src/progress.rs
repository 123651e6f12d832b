//! Progress reports to a Python callable, and Ctrl-C.

use pyo3::prelude::*;

/// Calls Python's `report(stage, done, total) -> bool` and remembers what it raised.
pub(crate) struct PythonReport {
    report: Option<Py<PyAny>>,
    raised: Option<PyErr>,
}

impl PythonReport {
    pub(crate) fn new(report: Option<Py<PyAny>>) -> Self {
        Self { report, raised: None }
    }

    /// Reports and returns whether to go on.
    pub(crate) fn tell(&mut self, stage: &str, done: u64, total: u64) -> bool {
        let answer = Python::attach(|py| {
            py.check_signals()?;
            match &self.report {
                None => Ok(true),
                Some(report) => report.call1(py, (stage, done, total))?.is_truthy(py),
            }
        });
        answer.unwrap_or_else(|error| {
            self.raised = Some(error);
            false
        })
    }

    /// What Python raised goes before what the core made of the stop.
    pub(crate) fn settle<T>(self, result: Result<T, PyErr>) -> PyResult<T> {
        match self.raised {
            Some(error) => Err(error),
            None => result,
        }
    }
}
