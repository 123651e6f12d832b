//! How long a step of the navigator takes, in a world of 30 by 30 m with 40 discs, 181 beams and map memory. Not run by
//! `cargo test`: `cargo test --release -p swathe --test navigator_step_time -- --ignored --nocapture`.

mod cluttered;

use std::time::Instant;

const MOST_STEPS: u32 = 3000;

/// Steps of every drive, each the least of some repetitions: what else the machine does is left out.
const REPEATS: usize = 5;

fn drive(seed: u64, has_map: bool) -> Vec<f64> {
    let mut times_us = Vec::new();
    cluttered::drive(seed, has_map, MOST_STEPS, |navigator, observation| {
        let started = Instant::now();
        let command = navigator.step(observation);
        times_us.push(started.elapsed().as_secs_f64() * 1e6);
        command
    });
    times_us
}

#[test]
#[ignore = "a measurement"]
fn step_time() {
    for has_map in [false, true] {
        let mut times_us = Vec::new();
        for seed in 0..12 {
            let mut least = drive(seed, has_map);
            for _ in 1..REPEATS {
                let again = drive(seed, has_map);
                assert_eq!(again.len(), least.len());
                least
                    .iter_mut()
                    .zip(again)
                    .for_each(|(least, again)| *least = least.min(again));
            }
            times_us.extend(least);
        }
        times_us.sort_by(f64::total_cmp);
        let at = |share: f64| times_us[(share * (times_us.len() - 1) as f64) as usize];
        println!(
            "{}: {} steps: median {:.0} us, 90 % {:.0} us, 99 % {:.0} us, most {:.0} us",
            if has_map { "with a map" } else { "without a map" },
            times_us.len(),
            at(0.5),
            at(0.9),
            at(0.99),
            at(1.0)
        );
    }
}
