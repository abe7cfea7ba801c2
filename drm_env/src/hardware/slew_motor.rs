//! The slew motor's current, electrical power and energy (thesis section 4.3).

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::check::{non_negative, positive};
use crate::error::ConfigError;
use crate::simd::{Lane, laned};

/// Which drag and inertia constants the motor model uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MotorConstants {
    /// Inertia and drag fitted to the published energies 185.5 J and 85.9 J.
    #[default]
    Fitted,
    /// As printed: inertia 2.67e-4 kg m^2, drag 2 % of kb kt / Ra. Gives 139.4 J and 67.6 J.
    Printed,
}

/// Gear ratio Ng.
pub const GEAR_RATIO: f64 = 1845.0;
/// Armature resistance Ra, Ohm.
pub const ARMATURE_RESISTANCE: f64 = 5.16;
/// Torque constant kt, N m/A.
#[allow(clippy::approx_constant)] // a printed value that only looks like 1/pi
pub const TORQUE_CONSTANT: f64 = 0.318;
/// Back-EMF constant kb, V s/rad.
#[allow(clippy::approx_constant)] // equal to the torque constant in SI
pub const BACK_EMF_CONSTANT: f64 = 0.318;

impl MotorConstants {
    /// Rotor inertia Im, kg m^2.
    pub fn rotor_inertia(self) -> f64 {
        match self {
            // ten times the printed value reproduces both published energies
            Self::Fitted => 2.67e-3,
            Self::Printed => 2.67e-4,
        }
    }

    /// Viscous drag cv on the rotor, N m s.
    pub fn drag(self) -> f64 {
        match self {
            Self::Fitted => 1.65e-4,
            Self::Printed => 0.02 * BACK_EMF_CONSTANT * TORQUE_CONSTANT / ARMATURE_RESISTANCE,
        }
    }

    /// What the current is made of with the thesis' gear.
    pub fn gains(self) -> CurrentGains<f64> {
        self.geared(GEAR_RATIO)
    }

    /// What the current is made of with any gear.
    pub fn geared(self, gear_ratio: f64) -> CurrentGains<f64> {
        CurrentGains {
            torque: 1.0 / (gear_ratio * TORQUE_CONSTANT),
            rate: self.drag() * gear_ratio / TORQUE_CONSTANT,
            accel: self.rotor_inertia() * gear_ratio / TORQUE_CONSTANT,
        }
    }

    /// Electrical power Ra i^2, W; see [`CurrentGains::power`].
    pub fn power(self, slew_torque: f64, rate: f64, accel: f64) -> f64 {
        self.gains().power(slew_torque, rate, accel)
    }
}

/// Current per slew torque, slew rate and slew acceleration of the arm: A/(N m), A s/rad, A s^2/rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurrentGains<T> {
    torque: T,
    rate: T,
    accel: T,
}

laned!(CurrentGains {
    torque,
    rate,
    accel
});

impl<T: Lane> CurrentGains<T> {
    /// Electrical power Ra i^2, W, at a slew torque (N m) with the *reference* rate (rad/s) and
    /// acceleration (rad/s^2) of the arm: with the simulated ones the rotor inertia amplifies the
    /// vibration.
    #[inline(always)]
    pub fn power(&self, slew_torque: T, rate: T, accel: T) -> T {
        let current = self.current(slew_torque, rate, accel);
        current * current * ARMATURE_RESISTANCE
    }

    /// Current, A, at a slew torque (N m) with the reference's rate (rad/s) and acceleration (rad/s^2).
    #[inline(always)]
    pub fn current(&self, slew_torque: T, rate: T, accel: T) -> T {
        self.torque
            .mul_add(slew_torque, self.rate.mul_add(rate, self.accel * accel))
    }
}

/// The slew motor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SlewMotor {
    /// Drag and inertia of the motor model.
    pub constants: MotorConstants,
    /// Largest torque at the shoulder, N m, when an agent drives the motor.
    pub torque_limit: f64,
    /// Largest torque at the shoulder, N m, that the motor gives of what the open loop asks for; null is
    /// no limit. What is missing leaves the arm behind its reference, or beyond it.
    pub open_loop_limit: Option<f64>,
    /// Gear ratio Ng between motor and shoulder (thesis table 4-1: 1845).
    pub gear_ratio: f64,
    /// Stiffness of the drive shaft between gear and shoulder, N m/rad; null is none: the motor's torque is
    /// the arm's, as in the thesis. With a shaft the rotor has an inertia of its own, Ng^2 Im at the shoulder.
    pub shaft_stiffness: Option<f64>,
    /// Damping of the drive shaft, N m s/rad.
    pub shaft_damping: f64,
}

/// The drive shaft and what turns at its motor's end, told at the shoulder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveShaft<T = f64> {
    /// Inertia Ng^2 Im of rotor and gear, kg m^2.
    pub rotor_inertia: T,
    /// N m/rad.
    pub stiffness: T,
    /// N m s/rad.
    pub damping: T,
}

impl<T: Lane> DriveShaft<T> {
    /// Torque on the arm, N m, that the shaft's twist (rad) and its rate (rad/s) make, rotor before arm.
    #[inline(always)]
    pub fn torque(&self, twist: T, rate: T) -> T {
        self.stiffness.mul_add(twist, self.damping * rate)
    }
}

/// Bounds of a gear ratio.
const GEAR_RATIOS: (f64, f64) = (1.0, 1e5);
/// Bounds of a drive shaft's stiffness, N m/rad: from a spring that holds nothing to what no step tells from a
/// rigid shaft.
const SHAFT_STIFFNESSES: (f64, f64) = (1.0, 1e10);

impl SlewMotor {
    /// Refuses what no motor has.
    ///
    /// # Errors
    /// A limit, ratio, stiffness or damping out of its range.
    pub(crate) fn validate(&self) -> Result<(), ConfigError> {
        positive("torque_limit", self.torque_limit)?;
        if let Some(limit) = self.open_loop_limit {
            positive("open_loop_limit", limit)?;
        }
        let within = |name: &str, value: f64, (least, most): (f64, f64)| {
            if (least..=most).contains(&value) {
                return Ok(());
            }
            let requirement = format!("must be within {least} to {most:e}");
            Err(ConfigError::value(name, requirement, value))
        };
        within("gear_ratio", self.gear_ratio, GEAR_RATIOS)?;
        if let Some(stiffness) = self.shaft_stiffness {
            within("shaft_stiffness", stiffness, SHAFT_STIFFNESSES)?;
        }
        non_negative("shaft_damping", self.shaft_damping)?;
        if self.shaft_stiffness.is_none() && self.shaft_damping != 0.0 {
            let requirement = "must be 0 without a shaft; shaft_stiffness gives one";
            return Err(ConfigError::value(
                "shaft_damping",
                requirement,
                self.shaft_damping,
            ));
        }
        Ok(())
    }

    /// What the current is made of.
    pub(crate) fn gains(&self) -> CurrentGains<f64> {
        self.constants.geared(self.gear_ratio)
    }

    /// The drive shaft, if there is one.
    pub fn shaft(&self) -> Option<DriveShaft> {
        self.shaft_stiffness.map(|stiffness| DriveShaft {
            rotor_inertia: self.gear_ratio * self.gear_ratio * self.constants.rotor_inertia(),
            stiffness,
            damping: self.shaft_damping,
        })
    }
}

impl Default for SlewMotor {
    /// 5,000 N m: Payload 3 needs about 3,600.
    fn default() -> Self {
        Self {
            constants: MotorConstants::Fitted,
            torque_limit: 5000.0,
            open_loop_limit: None,
            gear_ratio: GEAR_RATIO,
            shaft_stiffness: None,
            shaft_damping: 0.0,
        }
    }
}
