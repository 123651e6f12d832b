//! Shortcuts by curves: two steps are replaced by one curve where that is allowed and costs no more.

use crate::progress::Report;

use super::drive::{Drive, Step};
use super::field::Field;

/// Passes over the path before it is taken as it is.
const MOST_PASSES: usize = 40;

/// Replaces pairs of steps by single curves while that lowers the cost; `None` when asked to stop.
///
/// As with straight shortcuts each pass looks at every second pose that is left, so a curve grows by doubling.
pub(super) fn smooth(drive: &Drive, field: &Field, mut steps: Vec<Step>, report: &mut Report) -> Option<Vec<Step>> {
    let inside = field.inside.as_ref();
    for pass in 0..MOST_PASSES {
        if !report(pass as u64, MOST_PASSES as u64) {
            return None;
        }
        let mut kept: Vec<Step> = Vec::with_capacity(steps.len());
        let mut here = 0;
        while here < steps.len() {
            let before = kept.last().and_then(Step::ends_reverse);
            let after = steps.get(here + 2).and_then(Step::begins_reverse);
            let one = (here + 1 < steps.len())
                .then(|| {
                    let [first, second] = [&steps[here], &steps[here + 1]];
                    let one = drive.shot(first.from, &[second.to], inside)?;
                    let old = first.cost
                        + second.cost
                        + cusps(drive, [before, first.begins_reverse()])
                        + cusps(drive, [first.ends_reverse(), second.begins_reverse()])
                        + cusps(drive, [second.ends_reverse(), after]);
                    let new = one.cost
                        + cusps(drive, [before, one.begins_reverse()])
                        + cusps(drive, [one.ends_reverse(), after]);
                    (new <= old * (1.0 + 1e-12)).then_some(one)
                })
                .flatten();
            here += if one.is_some() { 2 } else { 1 };
            kept.push(one.unwrap_or_else(|| steps[here - 1].clone()));
        }
        let done = kept.len() == steps.len();
        steps = kept;
        if done {
            break;
        }
    }
    Some(steps)
}

/// Cost of the change of direction between two steps.
fn cusps(drive: &Drive, [before, after]: [Option<bool>; 2]) -> f64 {
    match (before, after) {
        (Some(before), Some(after)) if before != after => drive.cusp_cost,
        _ => 0.0,
    }
}
