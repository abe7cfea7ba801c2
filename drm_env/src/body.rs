//! The equations of motion of one episode, whichever plant they are of: state, outputs, energy, and
//! the flight over a leg of the timeline.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::actuator::{StepTorque, WheelState};
use crate::arm::PayloadProperties;
use crate::error::ConfigError;
use crate::implicit::GeneralizedAlpha;
use crate::integrator::{Stage, rk4_step};
use crate::lane::{Lane, Pack};
use crate::plant::consistent::{ConsistentPlant, ConsistentState};
use crate::plant::energy::{Energy, energy};
use crate::plant::thesis::{Constants, Prepared};
use crate::plant::{Extension, PlantModel, RigidInertia, Torques};
use crate::scenario::Scenario;
use crate::timeline::Piece;

/// Equations of motion of one episode.
#[derive(Debug, Clone)]
pub enum Body {
    /// The thesis' three degrees of freedom.
    Thesis(Constants<f64>),
    /// The slope-continuous arm with its integrator.
    Consistent(Arc<ConsistentPlant>, GeneralizedAlpha),
}

/// State of a [`Body`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Motion {
    /// theta, alpha, beta and their rates.
    Thesis([f64; 6]),
    /// Any number of modes.
    Consistent(Box<ConsistentState>),
}

/// What is seen of a [`Motion`]: each a value and its rate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Outputs {
    /// Slew angle, rad.
    pub slew: [f64; 2],
    /// Half the deflection of link 1's end, m.
    pub alpha: [f64; 2],
    /// Half the deflection of link 2's tip from link 1's end, m.
    pub beta: [f64; 2],
    /// Deflection of the arm's tip from the rotating axis, m.
    pub tip: [f64; 2],
}

impl Outputs {
    /// Whether every value is finite.
    pub fn is_finite(&self) -> bool {
        [self.slew, self.alpha, self.beta, self.tip]
            .as_flattened()
            .iter()
            .all(|value| value.is_finite())
    }
}

impl Body {
    /// The equations of a scenario, for the extensions that it passes through.
    ///
    /// # Errors
    /// Parameters that no arm has.
    pub fn new(scenario: &Scenario, payload: &PayloadProperties) -> Result<Self, ConfigError> {
        let (arm, dynamics) = (&scenario.arm, &scenario.dynamics);
        match scenario.plant {
            PlantModel::Thesis => Ok(Self::Thesis(Constants::new(arm, payload, dynamics))),
            PlantModel::Consistent => {
                let [link1, link2] = scenario.modes;
                let deployment = &scenario.deployment;
                let range = (deployment.start, deployment.final_extension());
                let plant = ConsistentPlant::new(arm, payload, dynamics, (link1, link2), range)?;
                let scheme = GeneralizedAlpha::new(dynamics.spectral_radius)
                    .map_err(|e| e.within("dynamics"))?;
                Ok(Self::Consistent(Arc::new(plant), scheme))
            }
        }
    }

    /// State at t = 0.
    pub fn start(&self, scenario: &Scenario) -> Motion {
        let start = &scenario.initial;
        match self {
            Self::Thesis(_) => Motion::Thesis([
                start.slew_angle,
                start.alpha,
                start.beta,
                start.slew_rate,
                start.alpha_rate,
                start.beta_rate,
            ]),
            Self::Consistent(plant, _) => Motion::Consistent(Box::new(plant.released(
                (start.slew_angle, start.slew_rate),
                (start.alpha, start.alpha_rate),
                (start.beta, start.beta_rate),
            ))),
        }
    }

    /// Whether a state is one of this body's.
    pub fn owns(&self, motion: &Motion) -> bool {
        matches!(
            (self, motion),
            (Self::Thesis(_), Motion::Thesis(_)) | (Self::Consistent(..), Motion::Consistent(_))
        )
    }

    /// What is seen of a state; not a number where the state is not this body's.
    pub fn outputs(&self, motion: &Motion, extension: &Extension<f64>) -> Outputs {
        match (self, motion) {
            (Self::Thesis(_), Motion::Thesis(motion)) => {
                let [theta, alpha, beta, theta_rate, alpha_rate, beta_rate] = *motion;
                Outputs {
                    slew: [theta, theta_rate],
                    alpha: [alpha, alpha_rate],
                    beta: [beta, beta_rate],
                    tip: [2.0 * (alpha + beta), 2.0 * (alpha_rate + beta_rate)],
                }
            }
            (Self::Consistent(plant, _), Motion::Consistent(state)) => {
                let half = |(value, rate): (f64, f64)| [0.5 * value, 0.5 * rate];
                Outputs {
                    slew: [state.q[0], state.v[0]],
                    alpha: half(plant.link1_deflection(state)),
                    beta: half(plant.link2_deflection(state)),
                    tip: plant.tip_deflection(state, extension).into(),
                }
            }
            _ => {
                let nan = [f64::NAN; 2];
                Outputs {
                    slew: nan,
                    alpha: nan,
                    beta: nan,
                    tip: nan,
                }
            }
        }
    }

    /// Kinetic and potential energy, J.
    pub fn energy(
        &self,
        motion: &Motion,
        extension: &Extension<f64>,
        scenario: &Scenario,
        payload: &PayloadProperties,
    ) -> Energy {
        match (self, motion) {
            (Self::Thesis(_), Motion::Thesis(motion)) => {
                let [theta, alpha, beta, theta_rate, alpha_rate, beta_rate] = *motion;
                energy(
                    &scenario.arm,
                    payload,
                    &scenario.dynamics,
                    extension,
                    [theta, alpha, beta],
                    [theta_rate, alpha_rate, beta_rate],
                )
            }
            (Self::Consistent(plant, _), Motion::Consistent(state)) => {
                plant.energy(state, extension)
            }
            _ => Energy {
                kinetic: f64::NAN,
                potential: f64::NAN,
            },
        }
    }

    /// Flies over a leg; `switches` are axial load and particle following. Returns the torques at
    /// the beginning.
    pub(crate) fn fly(
        &self,
        leg: &Leg<'_, f64>,
        switches: (bool, bool),
        motion: &mut Motion,
        root: &mut WheelState<f64>,
        tip: &mut WheelState<f64>,
    ) -> Torques<f64> {
        match (self, motion) {
            (Self::Thesis(constants), Motion::Thesis(motion)) => {
                let fly = match switches {
                    (true, false) => Leg::fly::<true, false>,
                    (false, false) => Leg::fly::<false, false>,
                    (true, true) => Leg::fly::<true, true>,
                    (false, true) => Leg::fly::<false, true>,
                };
                fly(leg, constants, motion, root, tip)
            }
            (Self::Consistent(plant, scheme), Motion::Consistent(state)) => {
                leg.fly_implicitly(plant, scheme, state, root, tip)
            }
            _ => Torques {
                slew: f64::NAN,
                root: f64::NAN,
                tip: f64::NAN,
            },
        }
    }
}

/// One wheel over a leg.
#[derive(Debug, Clone, Copy)]
pub(crate) struct WheelDrive<T> {
    pub(crate) command: T,
    /// 1 with a lag, 0 without.
    pub(crate) memory: T,
    /// What half a step leaves of a difference.
    pub(crate) decay: T,
    pub(crate) momentum_limit: T,
}

/// Equal integration steps within one piece of the timeline, under held commands.
pub(crate) struct Leg<'a, T> {
    pub(crate) inertia: &'a RigidInertia<T>,
    pub(crate) piece: &'a Piece<T>,
    pub(crate) slew: Option<T>,
    pub(crate) root: WheelDrive<T>,
    pub(crate) tip: WheelDrive<T>,
    /// Time since the piece's start, s.
    pub(crate) from: T,
    pub(crate) h: T,
    pub(crate) steps: usize,
}

impl<T: Lane> Leg<'_, T> {
    /// Torque of the slew motor `u` seconds after the piece's start: the agent's, or open loop.
    #[inline(always)]
    fn slew_torque(&self, u: T, extension: &Extension<T>) -> T {
        self.slew.unwrap_or_else(|| {
            let (accel, rate) = self.piece.motion(u);
            self.inertia.slew_torque(extension, rate, accel)
        })
    }

    /// Torque of a wheel over the next step.
    #[inline(always)]
    fn wheel(&self, state: &mut WheelState<T>, drive: &WheelDrive<T>) -> StepTorque<T> {
        state.step(
            drive.command,
            drive.memory,
            drive.decay,
            drive.momentum_limit,
            self.h,
        )
    }
}

/// The equations of motion at one instant of the prescribed motion.
#[derive(Clone, Copy)]
struct Instant<T> {
    prepared: Prepared<T>,
    slew: T,
}

impl<const N: usize> Instant<Pack<N>> {
    #[inline(always)]
    fn lane(&self, index: usize) -> Instant<f64> {
        Instant {
            prepared: self.prepared.lane(index),
            slew: self.slew.0[index],
        }
    }
}

impl<T: Lane> Instant<T> {
    #[inline(always)]
    fn new<const AXIAL: bool, const FOLLOW: bool>(
        leg: &Leg<'_, T>,
        constants: &Constants<T>,
        u: T,
    ) -> Self {
        let extension = leg.piece.extension(u);
        Self {
            prepared: Prepared::new(constants.matrices::<AXIAL, FOLLOW>(&extension)),
            slew: leg.slew_torque(u, &extension),
        }
    }

    #[inline(always)]
    fn torques(&self, root: T, tip: T) -> Torques<T> {
        Torques {
            slew: self.slew,
            root,
            tip,
        }
    }
}

impl<T: Lane> Leg<'_, T> {
    /// One Runge-Kutta step between three instants.
    #[inline(always)]
    fn step(
        &self,
        motion: &mut [T; 6],
        [start, middle, end]: [&Instant<T>; 3],
        root: &StepTorque<T>,
        tip: &StepTorque<T>,
    ) {
        *motion = rk4_step(motion, self.h, |stage, y| {
            let (instant, torques) = match stage {
                Stage::Start => (start, start.torques(root.start, tip.start)),
                Stage::Middle => (middle, middle.torques(root.middle, tip.middle)),
                Stage::End => (end, end.torques(root.end, tip.end)),
            };
            let [theta, alpha, beta, theta_rate, alpha_rate, beta_rate] = *y;
            let [a, b, c] = instant.prepared.acceleration(
                &[theta, alpha, beta],
                &[theta_rate, alpha_rate, beta_rate],
                &torques,
            );
            [theta_rate, alpha_rate, beta_rate, a, b, c]
        });
    }
}

/// Steps whose instants are prepared together, two instants a step: the length is prescribed, so
/// they can be known in advance and evaluated side by side.
const STEPS_AHEAD: usize = 4;
const INSTANTS: usize = 2 * STEPS_AHEAD;

impl Leg<'_, f64> {
    /// Advances the motion and the wheels; returns the torques at the beginning. Picks the widest
    /// instructions of the processor; the result does not depend on them.
    fn fly<const AXIAL: bool, const FOLLOW: bool>(
        &self,
        constants: &Constants<f64>,
        motion: &mut [f64; 6],
        root: &mut WheelState<f64>,
        tip: &mut WheelState<f64>,
    ) -> Torques<f64> {
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512vl")
            {
                // SAFETY: the processor has the features that the function is compiled for
                return unsafe { self.fly_avx512::<AXIAL, FOLLOW>(constants, motion, root, tip) };
            }
            if is_x86_feature_detected!("avx2") {
                // SAFETY: the processor has the feature that the function is compiled for
                return unsafe { self.fly_avx2::<AXIAL, FOLLOW>(constants, motion, root, tip) };
            }
        }
        self.fly_ahead::<AXIAL, FOLLOW>(constants, motion, root, tip)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512dq,avx512vl")]
    fn fly_avx512<const AXIAL: bool, const FOLLOW: bool>(
        &self,
        constants: &Constants<f64>,
        motion: &mut [f64; 6],
        root: &mut WheelState<f64>,
        tip: &mut WheelState<f64>,
    ) -> Torques<f64> {
        self.fly_ahead::<AXIAL, FOLLOW>(constants, motion, root, tip)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn fly_avx2<const AXIAL: bool, const FOLLOW: bool>(
        &self,
        constants: &Constants<f64>,
        motion: &mut [f64; 6],
        root: &mut WheelState<f64>,
        tip: &mut WheelState<f64>,
    ) -> Torques<f64> {
        self.fly_ahead::<AXIAL, FOLLOW>(constants, motion, root, tip)
    }

    #[inline(always)]
    fn fly_ahead<const AXIAL: bool, const FOLLOW: bool>(
        &self,
        constants: &Constants<f64>,
        motion: &mut [f64; 6],
        root: &mut WheelState<f64>,
        tip: &mut WheelState<f64>,
    ) -> Torques<f64> {
        let wide_constants = constants.spread::<INSTANTS>();
        let wide_piece = self.piece.spread::<INSTANTS>();
        let wide_inertia = self.inertia.spread::<INSTANTS>();
        let idle = WheelDrive {
            command: Pack::splat(0.0),
            memory: Pack::splat(0.0),
            decay: Pack::splat(0.0),
            momentum_limit: Pack::splat(0.0),
        };
        let wide = Leg {
            inertia: &wide_inertia,
            piece: &wide_piece,
            slew: self.slew.map(Pack::splat),
            root: idle,
            tip: idle,
            from: Pack::splat(self.from),
            h: Pack::splat(self.h),
            steps: self.steps,
        };
        let mut now = Instant::new::<AXIAL, FOLLOW>(self, constants, self.from);
        let first = now.slew;
        let mut begun = None;
        for chunk in (0..self.steps).step_by(STEPS_AHEAD) {
            let places: [f64; INSTANTS] = std::array::from_fn(|i| {
                let u = self.from + self.h * ((chunk + i / 2) as f64);
                if i % 2 == 0 {
                    u + self.h * 0.5
                } else {
                    u + self.h
                }
            });
            let ahead = Instant::new::<AXIAL, FOLLOW>(&wide, &wide_constants, Pack(places));
            for step in 0..STEPS_AHEAD.min(self.steps - chunk) {
                let middle = ahead.lane(2 * step);
                let end = ahead.lane(2 * step + 1);
                let root_torque = self.wheel(root, &self.root);
                let tip_torque = self.wheel(tip, &self.tip);
                begun.get_or_insert((root_torque.start, tip_torque.start));
                self.step(motion, [&now, &middle, &end], &root_torque, &tip_torque);
                now = end;
            }
        }
        let (root, tip) = begun.unwrap_or((0.0, 0.0));
        Torques {
            slew: first,
            root,
            tip,
        }
    }

    /// Advances the consistent plant and the wheels; returns the torques at the beginning.
    fn fly_implicitly(
        &self,
        plant: &ConsistentPlant,
        scheme: &GeneralizedAlpha,
        state: &mut ConsistentState,
        root: &mut WheelState<f64>,
        tip: &mut WheelState<f64>,
    ) -> Torques<f64> {
        let mut first = None;
        for step in 0..self.steps {
            let from = self.from + self.h * (step as f64);
            let root_torque = self.wheel(root, &self.root);
            let tip_torque = self.wheel(tip, &self.tip);
            let at = |u: f64, root: f64, tip: f64| Torques {
                slew: self.slew_torque(u, &self.piece.extension(u)),
                root,
                tip,
            };
            let torques = [
                at(from, root_torque.start, tip_torque.start),
                at(from + 0.5 * self.h, root_torque.middle, tip_torque.middle),
                at(from + self.h, root_torque.end, tip_torque.end),
            ];
            first.get_or_insert(torques[0]);
            plant.step(scheme, state, &torques, self.piece, from, self.h);
        }
        first.unwrap_or(Torques {
            slew: 0.0,
            root: 0.0,
            tip: 0.0,
        })
    }
}
