//! Control laws: measured outputs and reference in, wheel torques out. They know neither the
//! environment nor the reward, and the payload only as it is reported.

pub mod collocated;
pub mod lean;
pub mod linear;
pub mod low_pass;
pub mod lyapunov;
pub mod mlp;
pub mod scheduled;
pub mod servo;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::arm::{Arm, PayloadProperties};
use crate::error::ConfigError;
use crate::hardware::reaction_wheel::WheelTorques;
use crate::simd::{Lane, laned};

pub use collocated::CollocatedLaw;
pub use linear::LinearLaw;
pub use low_pass::LowPass;
pub use lyapunov::LyapunovLaw;
pub use scheduled::ScheduledLaw;
pub use servo::{ServoLaw, ServoMemory, ServoModel};

/// Sampling period that the thesis' gains were chosen for (thesis section 4.1), s.
pub const LAW_PERIOD: f64 = 2e-3;

/// Numbers that a law remembers from one sample to the next, see [`LawMemory`].
pub const MEMORY_SIZE: usize = 3 + servo::SERVO_MEMORY + 4;

/// No feedback: the open-loop manoeuvre.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct OpenLoop {}

/// A control law with its parameters; as data, `{"name": "linear", ...}` or the bare name.
// the tables of the scheduled law make it large; there is one in a flight and it is not moved
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "name", rename_all = "snake_case")]
pub enum Law {
    /// No feedback.
    #[schemars(title = "OpenLoop")]
    None(OpenLoop),
    /// Rate and position feedback (thesis section 3.4).
    #[schemars(title = "LinearLaw")]
    Linear(LinearLaw),
    /// Feedback from a Lyapunov function (thesis section 3.5).
    #[schemars(title = "LyapunovLaw")]
    Lyapunov(LyapunovLaw),
    /// Output feedback with gains scheduled over extension and reported mass. Without gains it is
    /// the open loop.
    #[schemars(title = "ScheduledLaw")]
    Scheduled(ScheduledLaw),
    /// Time-optimal servo for the whole arm on the balance of angular momentum, with modal damping (not in the
    /// thesis).
    #[schemars(title = "ServoLaw")]
    Servo(ServoLaw),
    /// Positive-real feedback of what each wheel turns with, scheduled over extension and reported mass (not in
    /// the thesis).
    #[schemars(title = "CollocatedLaw")]
    Collocated(CollocatedLaw),
}

impl Default for Law {
    fn default() -> Self {
        Self::None(OpenLoop {})
    }
}

/// Names of the laws, as in [`Law`]'s data form.
pub const LAW_NAMES: [&str; 6] = [
    "none",
    "linear",
    "lyapunov",
    "scheduled",
    "servo",
    "collocated",
];

impl Law {
    /// The law of this name with the thesis' gains; the scheduled law has none of its own.
    ///
    /// # Errors
    /// A name that no law has.
    pub fn named(name: &str) -> Result<Self, ConfigError> {
        match name {
            "none" => Ok(Self::default()),
            "linear" => Ok(Self::Linear(LinearLaw::default())),
            "lyapunov" => Ok(Self::Lyapunov(LyapunovLaw::default())),
            "scheduled" => Ok(Self::Scheduled(ScheduledLaw::default())),
            "servo" => Ok(Self::Servo(ServoLaw::default())),
            "collocated" => Ok(Self::Collocated(CollocatedLaw::default())),
            other => Err(ConfigError::value(
                "name",
                format!("must be one of {}", LAW_NAMES.join(", ")),
                other,
            )),
        }
    }

    /// The law's name in its data form.
    pub fn name(&self) -> &'static str {
        match self {
            Self::None(_) => "none",
            Self::Linear(_) => "linear",
            Self::Lyapunov(_) => "lyapunov",
            Self::Scheduled(_) => "scheduled",
            Self::Servo(_) => "servo",
            Self::Collocated(_) => "collocated",
        }
    }

    /// Refuses gains that are not finite.
    ///
    /// # Errors
    /// A gain that is not finite, with its path.
    pub fn validate(&self) -> Result<(), ConfigError> {
        match self {
            Self::None(_) => Ok(()),
            Self::Linear(law) => law.validate(),
            Self::Lyapunov(law) => law.validate(),
            Self::Scheduled(law) => law.validate(),
            Self::Servo(law) => law.validate(),
            Self::Collocated(law) => law.validate(),
        }
    }

    /// Wheel torques (N m, before saturation) of one sample, `period` seconds after the last. A law that
    /// [`Law::needs_model`] is off without `model`.
    #[inline(always)]
    pub fn torques<T: Lane>(
        &self,
        measured: &Measurement<T>,
        known: &KnownInertia<T>,
        model: Option<&ServoModel<T>>,
        memory: &mut LawMemory<T>,
        period: f64,
    ) -> WheelTorques<T> {
        let off = WheelTorques {
            root: T::splat(0.0),
            tip: T::splat(0.0),
        };
        match self {
            Self::None(_) => off,
            Self::Linear(law) => law.torques(measured, memory, period),
            Self::Lyapunov(law) => law.torques(measured, known, memory, period),
            Self::Scheduled(law) => law.torques(measured, known),
            Self::Servo(law) => {
                let Some(model) = model else { return off };
                let started = memory.started;
                memory.started = T::splat(1.0);
                law.torques(measured, model, &mut memory.servo, started, period)
            }
            Self::Collocated(law) => law.torques(measured, known, memory, period),
        }
    }

    /// Whether it wants [`Measurement::tip_turn_rate`].
    #[inline(always)]
    pub fn needs_tip_rate(&self) -> bool {
        match self {
            Self::Linear(law) => law.tip.is_some_and(|tip| tip.turn_gain != 0.0),
            Self::Collocated(_) => true,
            _ => false,
        }
    }

    /// The servo, which wants a [`ServoModel`].
    pub fn needs_model(&self) -> Option<&ServoLaw> {
        match self {
            Self::Servo(law) => Some(law),
            _ => None,
        }
    }
}

/// What a law is told at a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measurement<T> {
    /// Slew angle minus its reference, rad.
    pub slew_error: T,
    /// Slew rate minus its reference, rad/s.
    pub slew_error_rate: T,
    /// Deflection of link 2's tip from link 1's end, 2 beta, m.
    pub link2_deflection: T,
    /// Its rate, m/s.
    pub link2_deflection_rate: T,
    /// Extension of link 2, m.
    pub extension: T,
    /// Its rate, m/s.
    pub extension_rate: T,
    /// Reference of the slew rate, rad/s, and of the acceleration, rad/s^2.
    pub reference_rate: T,
    /// See `reference_rate`.
    pub reference_accel: T,
    /// Torque of the slew motor at the last sample, N m.
    pub slew_torque: T,
    /// Momentum that the wheels have taken up, N m s.
    pub root_momentum: T,
    /// See `root_momentum`.
    pub tip_momentum: T,
    /// Rate at which the tip turns against the inertial frame, rad/s, as the gyro at the tip wheel measures it;
    /// only for a law that [`Law::needs_tip_rate`].
    pub tip_turn_rate: T,
}

laned!(Measurement {
    slew_error,
    slew_error_rate,
    link2_deflection,
    link2_deflection_rate,
    extension,
    extension_rate,
    reference_rate,
    reference_accel,
    slew_torque,
    root_momentum,
    tip_momentum,
    tip_turn_rate,
});

/// What a law keeps from one sample to the next.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LawMemory<T> {
    /// Slew error rate of the last sample, rad/s.
    pub slew_error_rate: T,
    /// Deflection rate of the last sample, m/s.
    pub link2_deflection_rate: T,
    /// 1 once a sample has been taken, 0 before.
    pub started: T,
    /// Of the servo.
    pub servo: ServoMemory<T>,
    /// Of the filters of root and tip wheel: what passes, and its rate.
    pub filters: [[T; 2]; 2],
}

laned!(LawMemory {
    slew_error_rate,
    link2_deflection_rate,
    started,
    servo,
    filters,
});

impl<T: Lane> LawMemory<T> {
    /// Before the first sample.
    pub fn fresh() -> Self {
        Self {
            slew_error_rate: T::splat(0.0),
            link2_deflection_rate: T::splat(0.0),
            started: T::splat(0.0),
            servo: ServoMemory::fresh(),
            filters: [[T::splat(0.0); 2]; 2],
        }
    }
}

impl LawMemory<f64> {
    /// What is still true where another payload is held: the error of the angle and the vibration, not
    /// what has been learnt of the payload.
    pub(crate) fn with_other_payload(self) -> Self {
        Self {
            started: 0.0,
            servo: self.servo.with_other_payload(),
            ..self
        }
    }

    /// The same knowledge where the reported mass is another one: `part` is the one before over it.
    pub(crate) fn with_report(self, part: f64) -> Self {
        Self {
            servo: self.servo.with_report(part),
            ..self
        }
    }
}

/// Inertia of the arm and the *reported* payload as laws use it (constant in an episode).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownInertia<T> {
    pub(crate) l1: T,
    pub(crate) rho2: T,
    pub(crate) mass: T,
    pub(crate) inertia_attachment: T,
    /// Of the whole arm about the shoulder, a polynomial of the extension.
    pub(crate) whole: [T; 3],
}

laned!(KnownInertia {
    l1,
    rho2,
    mass,
    inertia_attachment,
    whole,
});

impl KnownInertia<f64> {
    /// From the arm, the reported payload and the moment of inertia of both, a polynomial of the extension
    /// (kg m^2).
    pub fn new(arm: &Arm, reported: &PayloadProperties, whole: [f64; 3]) -> Self {
        Self {
            l1: arm.link1.length,
            rho2: arm.link2.mass_per_length,
            mass: reported.mass,
            inertia_attachment: reported.inertia_attachment,
            whole,
        }
    }
}

pub(crate) fn finite_gain(path: &str, value: f64) -> Result<(), ConfigError> {
    crate::check::finite(path, value)
}
