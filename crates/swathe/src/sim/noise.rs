//! Drawn disturbances: one seed, a stream for each purpose, and a counter in each stream.

use std::f64::consts::TAU;

use crate::random::{philox, unit};

/// What a draw is for; draws of different streams are independent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub(super) enum Stream {
    /// Slip of the running gear.
    Slip = 1,
    /// Beams of a scan.
    Beams = 2,
    /// Odometry.
    Odometry = 3,
    /// Fixes of the pose.
    Fix = 4,
    /// Probes of the soil.
    Probe = 5,
    /// Errors of the terrain against the map.
    Height = 6,
    /// Errors of the soil against the map.
    Soil = 7,
    /// Drawing of worlds.
    World = 8,
}

/// A source of drawn numbers: a seed, and nothing that changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Noise {
    seed: u64,
}

impl Noise {
    /// All draws from a seed.
    pub fn new(seed: u64) -> Self {
        Self { seed }
    }

    /// Four words for the place `index` of the draw number `count` of a stream.
    pub(super) fn words(self, stream: Stream, count: u64, index: u32) -> [u32; 4] {
        philox([stream as u32, count as u32, (count >> 32) as u32, index], self.seed)
    }

    /// Two independent standard normal numbers (Box and Muller 1958).
    pub(super) fn normals(self, stream: Stream, count: u64, index: u32) -> [f64; 2] {
        let words = self.words(stream, count, index);
        normals([words[0], words[1]])
    }

    /// Four numbers from 0 to below 1.
    pub(super) fn units(self, stream: Stream, count: u64, index: u32) -> [f64; 4] {
        self.words(stream, count, index).map(unit)
    }
}

/// Two standard normal numbers from two words.
pub(super) fn normals([first, second]: [u32; 2]) -> [f64; 2] {
    let radius = (-2.0 * (1.0 - unit(first)).ln()).sqrt();
    let (sin, cos) = (TAU * unit(second)).sin_cos();
    [radius * cos, radius * sin]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_draws_have_mean_0_and_deviation_1_and_streams_differ() {
        let noise = Noise::new(7);
        let draws: Vec<f64> = (0..20_000).flat_map(|n| noise.normals(Stream::Slip, n, 0)).collect();
        let mean = draws.iter().sum::<f64>() / draws.len() as f64;
        let variance = draws.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / draws.len() as f64;
        assert!(mean.abs() < 0.02 && (variance - 1.0).abs() < 0.03, "{mean} {variance}");
        assert_ne!(noise.units(Stream::Slip, 3, 0), noise.units(Stream::Fix, 3, 0));
        assert_ne!(noise.units(Stream::Slip, 3, 0), Noise::new(8).units(Stream::Slip, 3, 0));
        assert_eq!(noise.units(Stream::Slip, 3, 0), Noise::new(7).units(Stream::Slip, 3, 0));
    }
}
