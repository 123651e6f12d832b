//! What the ground is at a place, and how it may differ from what a map says.

use crate::grid::{GridGeometry, Layer};
use crate::soil::SoilClass;

use super::noise::{Noise, Stream};
use super::{SimError, require};

/// The ground under a vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ground {
    /// What it is made of.
    pub soil: SoilClass,
    /// Height under the vehicle's middle in metres.
    pub height_m: f64,
    /// Nose up is positive.
    pub pitch_rad: f64,
    /// Right side down is positive.
    pub roll_rad: f64,
}

/// Why a vehicle must not be where it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoGo {
    /// It covers a part of an obstacle.
    Obstacle,
    /// The soil is too weak for it, or there is no ground.
    Soil,
    /// The grade along its heading is beyond its limit.
    Grade,
    /// The side slope is beyond its limit.
    SideSlope,
    /// The height under a wheel is not known.
    Unknown,
    /// It is outside the map.
    Outside,
}

/// How the truth differs from a map: smooth errors of height, and patches of another soil.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TruthErrors {
    /// Standard deviation of the height in metres (SRTM is quoted with about 4 m; a lidar survey with 0.1 m).
    pub height_m: f64,
    /// Distance in metres over which errors keep together.
    pub patch_m: f64,
    /// Share of patches, 0 to 1, whose soil is another one.
    pub soil_share: f64,
}

impl TruthErrors {
    /// Checks every figure.
    ///
    /// # Errors
    /// [`SimError::Figure`] naming the first figure outside its range.
    pub fn validate(&self) -> Result<(), SimError> {
        require(
            "error of the height",
            self.height_m,
            self.height_m >= 0.0,
            "it must not be below 0 m",
        )?;
        require(
            "size of patches",
            self.patch_m,
            self.patch_m > 0.0,
            "it must be above 0 m",
        )?;
        let share = self.soil_share;
        require(
            "share of other soil",
            share,
            (0.0..=1.0).contains(&share),
            "it must be from 0 to 1",
        )
    }

    /// The truth behind a map's heights: normal errors at the corners of patches, linear between them. What is unknown
    /// stays unknown.
    pub(super) fn heights(&self, map: &Layer<f32>, noise: Noise) -> Layer<f32> {
        let mut truth = map.clone();
        if self.height_m == 0.0 {
            return truth;
        }
        let geometry = map.geometry();
        let error = |row: f64, column: f64| {
            // Two normals to a draw: even and odd columns share it.
            let [even, odd] = noise.normals(Stream::Height, row as u64, column as u32 / 2);
            if (column as u32).is_multiple_of(2) { even } else { odd }
        };
        for (cell, height) in geometry.cells().zip(truth.data_mut()) {
            let (v, u) = self.patch_of(geometry, cell.row, cell.column);
            let (row, column, fv, fu) = (v.floor(), u.floor(), v.fract(), u.fract());
            let north = error(row, column) * (1.0 - fu) + error(row, column + 1.0) * fu;
            let south = error(row + 1.0, column) * (1.0 - fu) + error(row + 1.0, column + 1.0) * fu;
            *height += (self.height_m * (north * (1.0 - fv) + south * fv)) as f32;
        }
        truth
    }

    /// The truth behind a map's soil: in some patches known ground is another of gravel, sand, clay, silt and rock.
    pub(super) fn soil(&self, map: &Layer<u8>, noise: Noise) -> Layer<u8> {
        let geometry = map.geometry();
        let mut truth = map.clone();
        for (cell, code) in geometry.cells().zip(truth.data_mut()) {
            let (v, u) = self.patch_of(geometry, cell.row, cell.column);
            let [chance, pick, ..] = noise.units(Stream::Soil, v as u64, u as u32);
            if chance < self.soil_share && (1..=5).contains(code) {
                let others = 1 + (pick * 4.0) as u8;
                *code = if others >= *code { others + 1 } else { others };
            }
        }
        truth
    }

    fn patch_of(&self, geometry: GridGeometry, row: usize, column: usize) -> (f64, f64) {
        let cells = (self.patch_m / geometry.cell_size_m()).max(1.0);
        (row as f64 / cells, column as f64 / cells)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_as_large_and_as_many_as_asked_and_repeat_by_seed() {
        let geometry = GridGeometry::new(200, 200, 1.0, 0.0, 0.0).unwrap();
        let mut map = Layer::filled(geometry, 10.0f32);
        map.data_mut()[7] = f32::NAN;
        let errors = TruthErrors {
            height_m: 2.0,
            patch_m: 1.0,
            soil_share: 0.25,
        };
        errors.validate().unwrap();
        let truth = errors.heights(&map, Noise::new(3));
        assert!(truth.data()[7].is_nan());
        let known: Vec<f64> = truth
            .data()
            .iter()
            .filter(|h| !h.is_nan())
            .map(|h| f64::from(*h) - 10.0)
            .collect();
        let deviation = (known.iter().map(|error| error * error).sum::<f64>() / known.len() as f64).sqrt();
        assert!((deviation - 2.0).abs() < 0.1, "{deviation}");
        let soil = Layer::filled(geometry, SoilClass::Clay as u8);
        let other = errors.soil(&soil, Noise::new(3));
        let changed = other
            .data()
            .iter()
            .filter(|code| **code != SoilClass::Clay as u8)
            .count();
        assert!((changed as f64 / 40_000.0 - 0.25).abs() < 0.02, "{changed}");
        assert!(other.data().iter().all(|code| (1..=5).contains(code)));
        assert_eq!(errors.soil(&soil, Noise::new(3)), other);
        assert_ne!(errors.soil(&soil, Noise::new(4)), other);
    }
}
