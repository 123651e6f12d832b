//! Progress reports and stop requests of long loops.

/// Called now and then by a long loop with the work done and the work expected (0 when not known).
/// Returning `false` asks the loop to stop.
pub type Report<'a> = dyn FnMut(u64, u64) -> bool + 'a;

/// A report that never asks to stop.
pub fn silent() -> impl FnMut(u64, u64) -> bool {
    |_, _| true
}
