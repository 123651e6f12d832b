//! Where the robot thinks it is: dead reckoning that drifts, corrected by fixes.

use crate::sensor::{Pose, wrap};

use super::noise::{Noise, Stream};
use super::{BodyState, SimError, require};

/// Errors of odometry and fixes. Zeros give the truth.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LocaliserParams {
    /// Relative error of distances, drawn once for a run.
    pub scale_error: f64,
    /// Standard deviation of a distance in metres, per root of a metre driven.
    pub distance_noise_m: f64,
    /// Standard deviation of the heading in rad, per root of a metre driven.
    pub heading_noise_rad: f64,
    /// Constant drift of the heading in rad/s, drawn once for a run with this deviation.
    pub heading_drift_radps: f64,
    /// Fixes of place and heading per second; 0 for none.
    pub fix_rate_hz: f64,
    /// Standard deviation of a fix east and north in metres.
    pub fix_noise_m: f64,
    /// Standard deviation of a fix of the heading in rad.
    pub fix_heading_noise_rad: f64,
    /// Whether slip is invisible to odometry (wheel encoders) or measured (visual odometry).
    pub blind_to_slip: bool,
    /// Whether a fix is weighed against dead reckoning by their variances (Kalman 1960), rather than replacing it.
    pub fuses_fixes: bool,
}

impl LocaliserParams {
    /// Checks every figure.
    ///
    /// # Errors
    /// [`SimError::Figure`] naming the first figure outside its range.
    pub fn validate(&self) -> Result<(), SimError> {
        for (name, given) in [
            ("error of the odometry's scale", self.scale_error),
            ("noise of distances", self.distance_noise_m),
            ("noise of the heading", self.heading_noise_rad),
            ("drift of the heading", self.heading_drift_radps),
            ("rate of fixes", self.fix_rate_hz),
            ("noise of fixes", self.fix_noise_m),
            ("noise of fixes of the heading", self.fix_heading_noise_rad),
        ] {
            require(name, given, given >= 0.0, "it must not be below 0")?;
        }
        Ok(())
    }
}

/// Dead reckoning with fixes.
#[derive(Clone, Debug)]
pub struct Localiser {
    params: LocaliserParams,
    noise: Noise,
    scale: f64,
    drift_radps: f64,
    estimate: Pose,
    before: BodyState,
    steps: u64,
    fixes: u64,
    /// Variances of place (in one direction) and heading at the last fix, and what was driven and passed since then.
    variances: [f64; 2],
    since: (f64, f64),
}

impl Localiser {
    /// Begins at the truth.
    ///
    /// # Errors
    /// [`SimError::Figure`] when a parameter is not usable.
    pub fn new(params: LocaliserParams, start: &BodyState, noise: Noise) -> Result<Self, SimError> {
        params.validate()?;
        // The last counter of the stream, which no step reaches.
        let [scale, drift] = noise.normals(Stream::Odometry, u64::MAX, 0);
        Ok(Self {
            params,
            noise,
            scale: 1.0 + params.scale_error * scale,
            drift_radps: params.heading_drift_radps * drift,
            estimate: start.pose,
            before: *start,
            steps: 0,
            fixes: 0,
            variances: [0.0; 2],
            since: (0.0, 0.0),
        })
    }

    /// The estimate. Attitude is taken to be measured without error.
    pub fn estimate(&self) -> Pose {
        self.estimate
    }

    /// Shares of a fix in place and heading, and what they make of the variances.
    fn weights(&mut self) -> [f64; 2] {
        let params = &self.params;
        let (driven_m, passed_s) = std::mem::take(&mut self.since);
        if !params.fuses_fixes {
            return [1.0; 2];
        }
        let turned = params.heading_noise_rad.powi(2) * driven_m + (params.heading_drift_radps * passed_s).powi(2);
        let moved = (params.scale_error * driven_m).powi(2)
            + params.distance_noise_m.powi(2) * driven_m
            + (self.variances[1] + turned) * driven_m * driven_m;
        let grown = [self.variances[0] + moved, self.variances[1] + turned];
        let fixes = [params.fix_noise_m.powi(2), params.fix_heading_noise_rad.powi(2)];
        let mut weights = [1.0; 2];
        for (number, weight) in weights.iter_mut().enumerate() {
            if grown[number] + fixes[number] > 0.0 {
                *weight = grown[number] / (grown[number] + fixes[number]);
            }
            self.variances[number] = (1.0 - *weight) * grown[number];
        }
        weights
    }

    /// Takes in the motion since the last call.
    pub fn update(&mut self, body: &BodyState) -> Pose {
        let before = std::mem::replace(&mut self.before, *body);
        let dt_s = body.time_s - before.time_s;
        let heading = wrap(body.pose.heading_rad - before.pose.heading_rad);
        // True motion in the body's frame of the time before.
        let (sin, cos) = before.pose.heading_rad.sin_cos();
        let (dx, dy) = (body.pose.x_m - before.pose.x_m, body.pose.y_m - before.pose.y_m);
        let (mut ahead_m, mut left_m) = (cos * dx + sin * dy, cos * dy - sin * dx);
        if self.params.blind_to_slip {
            // Wheels turn by speed / (1 - slip); what stalls or spins on the spot is seen through their speed alone.
            let wheel_m = before.wheel_speed_mps.midpoint(body.wheel_speed_mps) * dt_s;
            let (sin, cos) = (heading / 2.0).sin_cos();
            (ahead_m, left_m) = (wheel_m * cos, wheel_m * sin);
        }
        let driven_m = ahead_m.hypot(left_m);
        let [along, turned] = self.noise.normals(Stream::Odometry, self.steps, 0);
        self.steps += 1;
        let root = driven_m.sqrt();
        self.since = (self.since.0 + driven_m, self.since.1 + dt_s);
        let stretch = if driven_m > 0.0 {
            self.scale + self.params.distance_noise_m * root * along / driven_m
        } else {
            1.0
        };
        let (sin, cos) = self.estimate.heading_rad.sin_cos();
        let (ahead_m, left_m) = (ahead_m * stretch, left_m * stretch);
        self.estimate = Pose {
            x_m: self.estimate.x_m + cos * ahead_m - sin * left_m,
            y_m: self.estimate.y_m + sin * ahead_m + cos * left_m,
            heading_rad: wrap(
                self.estimate.heading_rad
                    + heading
                    + self.drift_radps * dt_s
                    + self.params.heading_noise_rad * root * turned,
            ),
            pitch_rad: body.pose.pitch_rad,
            roll_rad: body.pose.roll_rad,
        };
        let due = (body.time_s * self.params.fix_rate_hz + 1e-9).floor() as u64;
        if due > self.fixes {
            self.fixes = due;
            let [east, north] = self.noise.normals(Stream::Fix, due, 0);
            let [heading, _] = self.noise.normals(Stream::Fix, due, 1);
            let [place, turn] = self.weights();
            let off_m = [
                body.pose.x_m + self.params.fix_noise_m * east - self.estimate.x_m,
                body.pose.y_m + self.params.fix_noise_m * north - self.estimate.y_m,
            ];
            self.estimate.x_m += place * off_m[0];
            self.estimate.y_m += place * off_m[1];
            let fix_rad = body.pose.heading_rad + self.params.fix_heading_noise_rad * heading;
            let off_rad = wrap(fix_rad - self.estimate.heading_rad);
            self.estimate.heading_rad = wrap(self.estimate.heading_rad + turn * off_rad);
        }
        self.estimate
    }
}

#[cfg(test)]
#[path = "localiser_tests.rs"]
mod tests;
