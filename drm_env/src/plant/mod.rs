//! Equations of motion of the deploying arm. Not torque limits, randomness or reward.

pub mod consistent;
pub mod energy;
pub mod loads;
pub mod thesis;
pub mod thesis_modes;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::arm::{Arm, PayloadProperties};
use crate::check::non_negative;
use crate::error::ConfigError;
use crate::math::generalized_alpha::GeneralizedAlpha;
use crate::reference::Extension;
use crate::simd::{Lane, laned};

/// Which equations of motion are integrated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PlantModel {
    /// The thesis' three degrees of freedom in closed form (appendix C).
    #[default]
    Thesis,
    /// The slope-continuous arm with any number of modes and followed particles (not in the thesis).
    Consistent,
}

/// Which coordinates the tip wheel's torque does work on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TipTorque {
    /// Virtual work of a torque on the tip: the slew angle and link 2's tip slope.
    #[default]
    SlewAndTip,
    /// Link 2's coordinate alone.
    TipOnly,
}

/// Switches and additions of the equations of motion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Dynamics {
    /// Stiffening by the axial load (thesis section 2.2.2).
    pub axial_load: bool,
    /// Follow the moving particles of link 2 in the thesis plant, with the full Coriolis load of the
    /// payload (not in the thesis); the consistent plant always does.
    pub particle_following: bool,
    /// Generalised force of the tip wheel.
    pub tip_torque: TipTorque,
    /// Kelvin-Voigt time constant of the links' bending, s: a mode of angular frequency w gets the
    /// damping ratio w/2 times this. The thesis has none.
    pub structural_damping: f64,
    /// Damping ratio of every natural mode of the arm as it is at each length, in the consistent plant.
    pub damping_ratio: f64,
    /// Spectral radius at infinite frequency of the consistent plant's implicit integrator: 1 damps
    /// nothing, smaller values damp what the step cannot resolve.
    pub spectral_radius: f64,
}

impl Default for Dynamics {
    fn default() -> Self {
        Self {
            axial_load: true,
            particle_following: false,
            tip_torque: TipTorque::SlewAndTip,
            structural_damping: 0.0,
            damping_ratio: 0.0,
            spectral_radius: 0.8,
        }
    }
}

impl Dynamics {
    /// Refuses what no structure has.
    ///
    /// # Errors
    /// A negative damping, a damping ratio of 1 or more, a spectral radius outside 0 to 1.
    pub fn validate(&self) -> Result<(), ConfigError> {
        non_negative("structural_damping", self.structural_damping)?;
        non_negative("damping_ratio", self.damping_ratio)?;
        if self.damping_ratio >= 1.0 {
            let requirement = "must be below 1: the arm vibrates";
            return Err(ConfigError::value(
                "damping_ratio",
                requirement,
                self.damping_ratio,
            ));
        }
        GeneralizedAlpha::new(self.spectral_radius).map(|_| ())
    }
}

/// External torques at one instant, N m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Torques<T> {
    /// Slew motor.
    pub slew: T,
    /// Root reaction wheel.
    pub root: T,
    /// Tip reaction wheel.
    pub tip: T,
}

laned!(Torques { slew, root, tip });

/// Rigid moment of inertia about the shoulder as a polynomial of the extension a:
/// I(a) = c0 + c1 a + c2 a^2, kg m^2 (exact: the cubes of the two ends of link 2 cancel).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidInertia<T> {
    coefficients: [T; 3],
    /// Largest torque of the inverse dynamics, N m; infinite without a limit.
    limit: T,
}

impl RigidInertia<f64> {
    /// From the arm and a payload, true or reported.
    pub fn new(arm: &Arm, payload: &PayloadProperties) -> Self {
        let (l1, l2) = (arm.link1.length, arm.link2.length);
        let (rho1, rho2) = (arm.link1.mass_per_length, arm.link2.mass_per_length);
        let (mp, lp) = (payload.mass, payload.length);
        // ((l1 + a)^3 - (l1 + a - l2)^3) / 3 = l2 (r^2 - r l2 + l2^2 / 3), r = l1 + a
        let link2 = [
            l2 * (l1 * l1 - l1 * l2 + l2 * l2 / 3.0),
            l2 * (2.0 * l1 - l2),
            l2,
        ];
        Self {
            coefficients: [
                rho1 * l1 * l1 * l1 / 3.0
                    + rho2 * link2[0]
                    + mp * l1 * (l1 + lp)
                    + payload.inertia_attachment,
                rho2 * link2[1] + mp * (2.0 * l1 + lp),
                rho2 * link2[2] + mp,
            ],
            limit: f64::INFINITY,
        }
    }

    /// The payload's share of it.
    pub fn of_payload(arm: &Arm, payload: &PayloadProperties) -> Self {
        let l1 = arm.link1.length;
        let (mp, lp) = (payload.mass, payload.length);
        Self {
            coefficients: [
                mp * l1 * (l1 + lp) + payload.inertia_attachment,
                mp * (2.0 * l1 + lp),
                mp,
            ],
            limit: f64::INFINITY,
        }
    }

    /// The same for a motor that gives so much at most, N m.
    #[must_use]
    pub fn with_motor(self, limit: Option<f64>) -> Self {
        Self {
            limit: limit.unwrap_or(f64::INFINITY),
            ..self
        }
    }
}

laned!(RigidInertia {
    coefficients,
    limit
});

impl RigidInertia<f64> {
    /// c0, c1 and c2.
    pub fn coefficients(&self) -> [f64; 3] {
        self.coefficients
    }
}

impl<T: Lane> RigidInertia<T> {
    /// I(a), kg m^2.
    #[inline(always)]
    pub fn at(&self, a: T) -> T {
        a.polynomial(&self.coefficients)
    }

    /// dI/da, kg m.
    #[inline(always)]
    pub fn slope(&self, a: T) -> T {
        let [_, c1, c2] = self.coefficients;
        (c2 * 2.0).mul_add(a, c1)
    }

    /// Rigid inverse dynamics S = I th'' + (dI/da) a' th' (thesis equation 3.2.1), N m, as far as the motor
    /// gives it.
    #[inline(always)]
    pub fn slew_torque(&self, extension: &Extension<T>, rate: T, accel: T) -> T {
        self.wanted_torque(extension, rate, accel)
            .limited(-self.limit, self.limit)
    }

    /// What the motor gives of a torque that is wanted, N m.
    #[inline(always)]
    pub fn given(&self, wanted: T) -> T {
        wanted.limited(-self.limit, self.limit)
    }

    /// [`RigidInertia::slew_torque`] of a motor without a limit.
    #[inline(always)]
    pub fn wanted_torque(&self, extension: &Extension<T>, rate: T, accel: T) -> T {
        let a = extension.length;
        self.at(a)
            .mul_add(accel, self.slope(a) * (extension.rate * rate))
    }
}
