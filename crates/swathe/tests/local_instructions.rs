//! A gate on the speed of the local methods that no clock decides: instructions per update, counted by callgrind, for windows
//! that a histogram may find hard.
//!
//! The bounds are what was counted in the profile of tests, its checks included (122 000, and 162 000 with a turning circle), and a
//! tenth more. Optimised these are 69 000 and 109 000; an update must take 10 us at most.

mod callgrind;
mod local_windows;

use std::hint::black_box;

use local_windows::{BODY, CONTENTS, scan_of, window_of};
use rstest::rstest;
use swathe::local::{Body, PlayerParams, PlayerVfh, VfhPlus, VfhPlusParams};

const ROUNDS: u32 = 20;

/// Counted alone, under this name.
#[inline(never)]
fn local_job(mut job: impl FnMut()) {
    for _ in 0..ROUNDS {
        job();
    }
}

#[test]
#[ignore = "run by the test below, under callgrind"]
fn job() {
    let Ok(job) = std::env::var("SWATHE_LOCAL_JOB") else {
        return;
    };
    let (method, content) = job.split_once(' ').unwrap();
    if method == "player" {
        let scan = scan_of(content);
        let mut player = PlayerVfh::new(PlayerParams::default());
        black_box(player.update(&scan, 0.1, 0.1, 0.1));
        return local_job(|| {
            black_box(player.update(black_box(&scan), 0.1, 0.1, 0.1));
        });
    }
    let window = window_of(content);
    let turn_radius_m = if method == "car" { [0.8; 2] } else { [0.0; 2] };
    let body = Body { turn_radius_m, ..BODY };
    let mut plus = VfhPlus::new(VfhPlusParams::default());
    plus.update(&window, 0.3, &body);
    local_job(|| {
        black_box(plus.steer(black_box(&window), 0.3, 0.1, &body, None));
    });
}

/// Instructions per update.
fn instructions(job: &str) -> Option<f64> {
    Some(callgrind::instructions("local_job", "SWATHE_LOCAL_JOB", job)? / f64::from(ROUNDS))
}

#[rstest]
#[case("plus", 135_000.0)]
#[case("car", 178_000.0)]
fn instructions_per_update_stay_below_their_bound_whatever_the_window_holds(#[case] method: &str, #[case] bound: f64) {
    let mut counts = Vec::new();
    for content in CONTENTS {
        let Some(counted) = instructions(&format!("{method} {content}")) else {
            return;
        };
        println!("{method} {content}: {counted:.0}");
        assert!(
            counted <= bound,
            "{method} {content}: {counted:.0} instructions, above {bound}"
        );
        counts.push(counted);
    }
    let (least, most) = counts.iter().fold((f64::INFINITY, 0.0f64), |(least, most), &count| {
        (least.min(count), most.max(count))
    });
    assert!(
        most <= 1.5 * least,
        "{method}: {least:.0} to {most:.0} instructions by what the window holds"
    );
}
