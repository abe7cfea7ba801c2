//! What pictures are of: the manoeuvre, which stays, and an instant of it.

use crate::validity::{LARGEST_DEFLECTION, LARGEST_SLEW_ERROR};

use super::geometry::finite;

/// What stays through a manoeuvre. Lengths in metres, angles in radians, masses in kilograms.
///
/// Nothing is required to be finite: a part whose numbers are not is left out of the picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    /// Length of link 1.
    pub link1_length: f64,
    /// Length of link 2, whether inside link 1 or outside.
    pub link2_length: f64,
    /// Slew angle at the end of the manoeuvre.
    pub target_angle: f64,
    /// Reference angle and length of link 2 outside link 1 in the course of the manoeuvre: what the
    /// camera has to see.
    pub path: Vec<(f64, f64)>,
    /// Mass of the payload as it is.
    pub payload_mass: f64,
    /// Mass of the payload as laws and agents are told.
    pub reported_mass: f64,
    /// Torque limits, N m: slew motor, root wheel, tip wheel.
    pub torque_limits: [f64; 3],
    /// Momentum limits, N m s: root wheel, tip wheel; infinite where there is none.
    pub momentum_limits: [f64; 2],
    /// End of the reference slew, s.
    pub slew_end: f64,
    /// End of the manoeuvre, s.
    pub horizon: f64,
    /// Factor by which deflections are drawn larger than they are.
    pub magnification: f64,
}

/// One instant. SI units and radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Time since the start of the manoeuvre, s.
    pub time: f64,
    /// Slew angle of the rotating axis, rad.
    pub slew_angle: f64,
    /// Slew angle that the reference asks for, rad.
    pub reference_angle: f64,
    /// Length of link 2 outside link 1, m.
    pub extension: f64,
    /// Modal coordinate of link 1, m: y1(x) = alpha phi(x / L1), phi(u) = 3 u^2 - u^3.
    pub alpha: f64,
    /// Modal coordinate of link 2, m: y2(x) = beta phi(x / extension), on top of y1(L1).
    pub beta: f64,
    /// Deflection of the tip from the rotating axis, m; what it has beyond 2 (alpha + beta) is link 2
    /// turning with the end of link 1.
    pub tip_deflection: f64,
    /// Torques, N m: slew motor, root wheel, tip wheel.
    pub torques: [f64; 3],
    /// Momenta of the wheels, N m s: root wheel, tip wheel.
    pub momenta: [f64; 2],
    /// What the last step was paid, where somebody is paid.
    pub payment: Option<Payment>,
}

/// The reward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Payment {
    /// Terms of the last step: tip vibration, slew error, effort.
    pub terms: [f64; 3],
    /// Sum of all rewards of the episode so far.
    pub sum: f64,
}

impl Moment {
    /// Where the tip is beside where the reference has it, m, positive ahead.
    pub(super) fn tip_error(&self, stage: &Stage) -> f64 {
        self.reach(stage) * (self.slew_angle - self.reference_angle) + self.tip_deflection
    }

    /// Distance of the tip from the shoulder, m.
    fn reach(&self, stage: &Stage) -> f64 {
        stage.link1_length + self.extension
    }

    /// Whether an arm can be there: within the limits of [`crate::validity`].
    pub(super) fn is_possible(&self, stage: &Stage) -> bool {
        let reach = self.reach(stage);
        [self.slew_angle, self.alpha, self.beta, reach]
            .iter()
            .all(|value| value.is_finite())
            && self.tip_deflection.abs() <= LARGEST_DEFLECTION * reach
            && (self.slew_angle - self.reference_angle).abs() <= LARGEST_SLEW_ERROR
    }

    /// What curves and trail need of it.
    pub(super) fn sample(&self, stage: &Stage) -> Sample {
        Sample {
            time: self.time as f32,
            error: self.tip_error(stage) as f32,
            deflection: self.tip_deflection as f32,
            slew: self.slew_angle as f32,
            reach: self.reach(stage) as f32,
        }
    }
}

/// What is remembered of an instant that has passed; SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sample {
    pub(super) time: f32,
    pub(super) error: f32,
    pub(super) deflection: f32,
    pub(super) slew: f32,
    pub(super) reach: f32,
}

/// How a flight has ended, if it has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ending {
    /// Not yet, or at the horizon.
    None,
    /// It left what the equations describe, at this time (s).
    Diverged(f64),
    /// A limit of the structure was reached, at this time (s).
    Limit(f64),
}

/// Range that curves and camera must hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// Smallest and largest tip error, m.
    pub error: [f64; 2],
    /// Smallest and largest tip deflection, m.
    pub deflection: [f64; 2],
    /// Smallest and largest slew angle, rad.
    pub slew: [f64; 2],
    /// Largest magnitude of a term of the reward.
    pub payment: f64,
}

impl Extent {
    /// Of no instant at all.
    pub const NOTHING: Self = Self {
        error: [0.0; 2],
        deflection: [0.0; 2],
        slew: [0.0; 2],
        payment: 0.0,
    };

    /// The range with another one in it.
    #[must_use]
    pub fn with(self, other: &Self) -> Self {
        let wider = |a: [f64; 2], b: [f64; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        Self {
            error: wider(self.error, other.error),
            deflection: wider(self.deflection, other.deflection),
            slew: wider(self.slew, other.slew),
            payment: self.payment.max(other.payment),
        }
    }

    /// The range with an instant in it; numbers that are not finite are none.
    pub(super) fn take(&mut self, stage: &Stage, moment: &Moment) {
        let at = |value: f64| [finite(value, 0.0); 2];
        let terms = moment.payment.map_or([0.0; 3], |payment| payment.terms);
        *self = self.with(&Self {
            error: at(moment.tip_error(stage)),
            deflection: at(moment.tip_deflection),
            slew: at(moment.slew_angle),
            payment: terms
                .iter()
                .fold(0.0, |worst, term| worst.max(finite(term.abs(), 0.0))),
        });
    }
}

/// How pictures look.
#[derive(Clone, Debug, PartialEq)]
pub struct Look {
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// What stands above; the arm's name where it is empty.
    pub title: String,
    /// Colour of link 2, of the curves and of the trail: that of the policy that flies.
    pub colour: super::palette::Rgb,
}
