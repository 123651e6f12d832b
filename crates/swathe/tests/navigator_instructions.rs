//! A gate on the speed of the navigator that no clock decides: instructions per step, counted by callgrind.
//!
//! The bounds are what was counted in the profile of tests, its checks included (2.27 million without a map and 2.50 with one), and a
//! tenth more.

mod callgrind;
mod cluttered;

use rstest::rstest;
use swathe::drive::{Command, Navigator, Observation};

const STEPS: u32 = 350;

/// Counted alone, under this name.
#[inline(never)]
fn navigator_job(navigator: &mut Navigator, observation: &Observation) -> Command {
    navigator.step(observation)
}

#[test]
#[ignore = "run by the test below, under callgrind"]
fn job() {
    if let Ok(job) = std::env::var("SWATHE_NAVIGATOR_JOB") {
        // By a closure: the name of the world's function must not hold that of the job.
        let taken = cluttered::drive(1, job == "map", STEPS, |navigator, observation| {
            navigator_job(navigator, observation)
        });
        assert_eq!(taken, STEPS);
    }
}

#[rstest]
#[case("plain", 2_500_000.0)]
#[case("map", 2_750_000.0)]
fn instructions_per_step_stay_below_their_bound(#[case] job: &str, #[case] bound: f64) {
    let Some(counted) = callgrind::instructions("navigator_job", "SWATHE_NAVIGATOR_JOB", job) else {
        return;
    };
    let counted = counted / f64::from(STEPS);
    println!("{job}: {counted:.0}");
    assert!(
        counted <= bound,
        "{job}: {counted:.0} instructions a step, above {bound}"
    );
}
