//! How long an update of VFH+ and of Player's method takes, by what the window holds. Not run by `cargo test`:
//! `cargo test --release -p swathe --test local_update_time -- --ignored --nocapture`.

mod local_windows;

use std::hint::black_box;
use std::time::Instant;

use local_windows::{BODY, CONTENTS, scan_of, window_of};
use swathe::local::{PlayerParams, PlayerVfh, VfhPlus, VfhPlusParams};

const ROUNDS: u32 = 2000;

fn least_us(mut job: impl FnMut()) -> f64 {
    let mut least = f64::INFINITY;
    for _ in 0..7 {
        let started = Instant::now();
        for _ in 0..ROUNDS {
            job();
        }
        least = least.min(started.elapsed().as_secs_f64() * 1e6 / f64::from(ROUNDS));
    }
    least
}

#[test]
#[ignore = "a measurement"]
fn update_time() {
    for name in CONTENTS {
        let (window, scan) = (window_of(name), scan_of(name));
        for turn_radius_m in [0.0, 0.8] {
            let mut plus = VfhPlus::new(VfhPlusParams::default());
            let body = swathe::local::Body {
                turn_radius_m: [turn_radius_m; 2],
                ..BODY
            };
            let ours = least_us(|| {
                black_box(plus.steer(black_box(&window), 0.3, 0.1, &body, None));
            });
            let mut player = PlayerVfh::new(PlayerParams::default());
            let theirs = least_us(|| {
                black_box(player.update(black_box(&scan), turn_radius_m / 8.0, 0.1, 0.1));
            });
            println!(
                "{name:13} turn {turn_radius_m}: VFH+ {ours:5.2} us, Player {theirs:6.2} us, ratio {:.1}",
                theirs / ours
            );
        }
    }
}
