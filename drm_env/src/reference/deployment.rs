//! The prescribed deployment of link 2 (thesis section 2.2.2): bang-bang acceleration, either as
//! long as the slew or with a limited force.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::arm::Arm;
use crate::check::positive;
use crate::error::ConfigError;

/// How the length of the arm changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DeploymentMode {
    /// Starts and ends with the slew.
    #[default]
    Coincident,
    /// Starts with the slew and pushes with a constant force.
    ForceLimited,
    /// The length stays at `start`.
    None,
}

/// The deployment as a user states it. Extension when `end > start`, retraction when `end < start`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Deployment {
    /// Length of link 2 outside link 1 at the beginning, m.
    pub start: f64,
    /// Length of link 2 outside link 1 at the end, m.
    pub end: f64,
    /// How the length changes.
    pub mode: DeploymentMode,
    /// Force of the force-limited mode, N: mass times acceleration, without the centrifugal pull.
    pub force: f64,
}

impl Default for Deployment {
    /// 1 m to 8 m, coincident with the slew; 200 N when force limited.
    fn default() -> Self {
        Self {
            start: 1.0,
            end: 8.0,
            mode: DeploymentMode::Coincident,
            force: 200.0,
        }
    }
}

/// One quadratic piece of the extension.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeploymentPiece {
    /// Start, s.
    pub start: f64,
    /// Extension at the start, m.
    pub extension: f64,
    /// Rate at the start, m/s.
    pub rate: f64,
    /// Acceleration, m/s^2.
    pub accel: f64,
}

impl DeploymentPiece {
    /// Extension, rate and acceleration `u` seconds after the piece's start.
    pub fn at(&self, u: f64) -> (f64, f64, f64) {
        (
            self.extension + u * (self.rate + u * (0.5 * self.accel)),
            self.rate + u * self.accel,
            self.accel,
        )
    }
}

impl Deployment {
    /// The length at which the arm comes to rest, m.
    pub fn final_extension(&self) -> f64 {
        match self.mode {
            DeploymentMode::None => self.start,
            DeploymentMode::Coincident | DeploymentMode::ForceLimited => self.end,
        }
    }

    /// Refuses lengths outside the arm, forces that are not positive and a deployment that has to
    /// coincide with a slew of no duration.
    ///
    /// # Errors
    /// Lengths that the arm cannot have, a force that does not deploy, a deployment longer than the slew.
    pub fn validate(&self, arm: &Arm, slew_time: f64) -> Result<(), ConfigError> {
        arm.validate_extension("start", self.start)?;
        if self.mode != DeploymentMode::None {
            arm.validate_extension("end", self.end)?;
        }
        positive("force", self.force)?;
        let moves = self.final_extension().total_cmp(&self.start).is_ne();
        if self.mode == DeploymentMode::Coincident && slew_time <= 0.0 && moves {
            return Err(ConfigError::value(
                "mode",
                "must not be coincident with a slew of 0 rad when the length changes",
                "coincident",
            ));
        }
        Ok(())
    }

    /// Duration T, s; `moving_mass` is link 2 and the payload as the planner knows it, kg.
    pub fn duration(&self, slew_time: f64, moving_mass: f64) -> f64 {
        match self.mode {
            DeploymentMode::None => 0.0,
            DeploymentMode::Coincident => slew_time,
            DeploymentMode::ForceLimited => {
                2.0 * libm::sqrt((self.end - self.start).abs() * moving_mass / self.force)
            }
        }
    }

    /// The pieces from t = 0, the last of which (at rest) has no end.
    pub fn pieces(&self, duration: f64) -> Vec<DeploymentPiece> {
        let distance = self.final_extension() - self.start;
        let rest = |start: f64, extension: f64| DeploymentPiece {
            start,
            extension,
            rate: 0.0,
            accel: 0.0,
        };
        if duration <= 0.0 || distance == 0.0 {
            return vec![rest(0.0, self.start)];
        }
        let accel = 4.0 * distance / (duration * duration);
        vec![
            DeploymentPiece {
                accel,
                ..rest(0.0, self.start)
            },
            DeploymentPiece {
                start: duration / 2.0,
                extension: self.start + distance / 2.0,
                rate: accel * duration / 2.0,
                accel: -accel,
            },
            rest(duration, self.end),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// T = 2 sqrt(distance x moving mass / force), 1 m to 8 m at 200 N with Payloads 0, 1 and 3.
    #[test]
    fn force_limited_durations_of_the_payloads() {
        let deployment = Deployment {
            mode: DeploymentMode::ForceLimited,
            ..Deployment::default()
        };
        for (mass, expected) in [(50.0, 4.183), (200.0, 6.205), (500.0, 8.972)] {
            let duration = deployment.duration(13.0, 75.0 + mass);
            assert!((duration - expected).abs() < 5e-4, "{mass} kg: {duration}");
        }
    }

    #[test]
    fn pieces_meet_and_end_at_the_final_length() {
        let deployment = Deployment {
            start: 8.0,
            end: 2.5,
            ..Deployment::default()
        };
        let pieces = deployment.pieces(11.0);
        for pair in pieces.windows(2) {
            let (extension, rate, _) = pair[0].at(pair[1].start - pair[0].start);
            assert!((extension - pair[1].extension).abs() < 1e-12);
            assert!((rate - pair[1].rate).abs() < 1e-12);
        }
    }
}
