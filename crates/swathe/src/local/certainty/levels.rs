//! The steps in which evidence is counted.

use super::{CERTAINTY_MAX, Evidence};

/// Log-odds are counted in this many steps per natural unit.
const STEPS: f64 = 256.0;

/// Steps of evidence and what they mean.
#[derive(Clone, Debug)]
pub(super) struct Levels {
    pub hit: i16,
    pub miss: i16,
    pub low: i16,
    pub high: i16,
    /// Certainty of every step from low to high.
    certainty: Vec<u8>,
}

impl Levels {
    pub fn of(evidence: Evidence) -> Self {
        let (hit, miss, low, high) = match evidence {
            Evidence::Himm { hit, miss } => (hit, miss, 0, i16::from(CERTAINTY_MAX)),
            Evidence::LogOdds { hit, miss, clamp } => {
                let steps = |p: f64| {
                    let p = p.clamp(1e-6, 1.0 - 1e-6);
                    (STEPS * (p / (1.0 - p)).ln()).round() as i16
                };
                (steps(hit), -steps(miss), steps(clamp[0]), steps(clamp[1]))
            }
        };
        let certainty = |level: i16| match evidence {
            Evidence::Himm { .. } => level as u8,
            // 15 max(0, 2p - 1), and 2p - 1 is tanh(l / 2).
            Evidence::LogOdds { .. } => {
                let excess = (f64::from(level) / STEPS / 2.0).tanh().max(0.0);
                (f64::from(CERTAINTY_MAX) * excess).round() as u8
            }
        };
        Self {
            hit: hit.max(0),
            miss: miss.max(0),
            low: low.min(0),
            high: high.max(0),
            certainty: (low.min(0)..=high.max(0)).map(certainty).collect(),
        }
    }

    pub fn certainty(&self, level: i16) -> u8 {
        self.certainty[(level - self.low) as usize]
    }
}
