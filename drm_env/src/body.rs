//! The equations of motion of a flight, whichever plant they are of: state, outputs, energy, and the
//! consistent plant over a span of the timeline.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::actuator::WheelState;
use crate::arm::PayloadProperties;
use crate::error::ConfigError;
use crate::flight::Span;
use crate::implicit::GeneralizedAlpha;
use crate::lane::{Laned, Number, laned};
use crate::leg::{WheelDrive, slew_torque};
use crate::plant::consistent::{ConsistentPlant, ConsistentState};
use crate::plant::energy::{Energy, energy};
use crate::plant::thesis::Constants;
use crate::plant::{Extension, PlantModel, RigidInertia, Torques};
use crate::scenario::Scenario;
use crate::timeline::Piece;

/// Equations of motion, a manoeuvre a lane.
#[derive(Debug, Clone)]
pub(crate) enum Body<T> {
    /// The thesis' three degrees of freedom.
    Thesis(Constants<T>),
    /// The slope-continuous arm with its integrator.
    Consistent(Vec<Arc<ConsistentPlant>>, GeneralizedAlpha),
}

/// State of a [`Body`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) enum Motion<T> {
    /// theta, alpha, beta and their rates.
    Thesis([T; 6]),
    /// Any number of modes.
    Consistent(Vec<ConsistentState>),
}

/// What is seen of a [`Motion`]: each a value and its rate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Outputs<T> {
    /// Slew angle, rad.
    pub slew: [T; 2],
    /// Half the deflection of link 1's end, m.
    pub alpha: [T; 2],
    /// Half the deflection of link 2's tip from link 1's end, m.
    pub beta: [T; 2],
    /// Deflection of the arm's tip from the rotating axis, m.
    pub tip: [T; 2],
}

laned!(Outputs {
    slew,
    alpha,
    beta,
    tip
});

impl<T: Number> Outputs<T> {
    /// Not zero where a value is not finite.
    #[inline(always)]
    pub fn not_finite(&self) -> T {
        // 0 x is 0 for finite numbers and not a number for all others
        let zero = T::splat(0.0);
        let mut sum = zero;
        let seen = [&self.slew, &self.alpha, &self.beta, &self.tip];
        for i in 0..seen.len() {
            sum = seen[i][0].mul_add(zero, seen[i][1].mul_add(zero, sum));
        }
        sum
    }

    /// Slew angle and rate, link-2 tip deflection 2 beta and its rate.
    #[inline(always)]
    pub fn measurable(&self) -> [T; 4] {
        let Self { slew, beta, .. } = self;
        [slew[0], slew[1], beta[0] * 2.0, beta[1] * 2.0]
    }
}

impl<T: Number> Motion<T> {
    /// The same in every lane.
    pub fn spread(single: &Motion<f64>) -> Self {
        match single {
            Motion::Thesis(motion) => Self::Thesis(Laned::spread(motion)),
            Motion::Consistent(states) => Self::Consistent(vec![states[0]; T::WIDTH]),
        }
    }

    /// One lane.
    pub fn one(&self, lane: usize) -> Motion<f64> {
        match self {
            Self::Thesis(motion) => Motion::Thesis(motion.lane_of(lane)),
            Self::Consistent(states) => Motion::Consistent(vec![states[lane]]),
        }
    }

    /// Replaces one lane by one of the same plant.
    pub fn put(&mut self, lane: usize, single: &Motion<f64>) {
        match (self, single) {
            (Self::Thesis(motion), Motion::Thesis(single)) => motion.put_lane(lane, single),
            (Self::Consistent(states), Motion::Consistent(single)) => states[lane] = single[0],
            _ => {}
        }
    }
}

impl Body<f64> {
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
                Ok(Self::Consistent(vec![Arc::new(plant)], scheme))
            }
        }
    }

    /// State at t = 0.
    pub fn start(&self, scenario: &Scenario) -> Motion<f64> {
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
            Self::Consistent(plants, _) => Motion::Consistent(vec![plants[0].released(
                (start.slew_angle, start.slew_rate),
                (start.alpha, start.alpha_rate),
                (start.beta, start.beta_rate),
            )]),
        }
    }

    /// Whether a state is one of this body's.
    pub fn owns(&self, motion: &Motion<f64>) -> bool {
        match (self, motion) {
            (Self::Thesis(_), Motion::Thesis(_)) => true,
            (Self::Consistent(..), Motion::Consistent(states)) => states.len() == 1,
            _ => false,
        }
    }

    /// Kinetic and potential energy, J.
    pub fn energy(
        &self,
        motion: &Motion<f64>,
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
            (Self::Consistent(plants, _), Motion::Consistent(states)) => {
                plants[0].energy(&states[0], extension)
            }
            _ => Energy {
                kinetic: f64::NAN,
                potential: f64::NAN,
            },
        }
    }
}

impl<T: Number> Body<T> {
    /// The same in every lane.
    pub fn spread(single: &Body<f64>) -> Self {
        match single {
            Body::Thesis(constants) => Self::Thesis(Constants::spread(constants)),
            Body::Consistent(plants, scheme) => {
                Self::Consistent(vec![Arc::clone(&plants[0]); T::WIDTH], *scheme)
            }
        }
    }

    /// One lane.
    pub fn one(&self, lane: usize) -> Body<f64> {
        match self {
            Self::Thesis(constants) => Body::Thesis(constants.lane_of(lane)),
            Self::Consistent(plants, scheme) => {
                Body::Consistent(vec![Arc::clone(&plants[lane])], *scheme)
            }
        }
    }

    /// Whether another body can be a lane of this one.
    pub fn accepts(&self, single: &Body<f64>) -> bool {
        match (self, single) {
            (Self::Thesis(_), Body::Thesis(_)) => true,
            (Self::Consistent(_, scheme), Body::Consistent(_, other)) => scheme == other,
            _ => false,
        }
    }

    /// Replaces one lane by a body that [`Body::accepts`].
    pub fn put(&mut self, lane: usize, single: &Body<f64>) {
        match (self, single) {
            (Self::Thesis(constants), Body::Thesis(single)) => constants.put_lane(lane, single),
            (Self::Consistent(plants, _), Body::Consistent(single, _)) => {
                plants[lane] = Arc::clone(&single[0]);
            }
            _ => {}
        }
    }

    /// What is seen of a state; not a number where the state is not this body's.
    #[inline(always)]
    pub fn outputs(&self, motion: &Motion<T>, extension: &Extension<T>) -> Outputs<T> {
        match (self, motion) {
            (Self::Thesis(_), Motion::Thesis(motion)) => {
                let [theta, alpha, beta, theta_rate, alpha_rate, beta_rate] = *motion;
                Outputs {
                    slew: [theta, theta_rate],
                    alpha: [alpha, alpha_rate],
                    beta: [beta, beta_rate],
                    tip: [(alpha + beta) * 2.0, (alpha_rate + beta_rate) * 2.0],
                }
            }
            (body, motion) => body.consistent_outputs(motion, extension),
        }
    }

    #[inline(never)]
    fn consistent_outputs(&self, motion: &Motion<T>, extension: &Extension<T>) -> Outputs<T> {
        let nan = [T::splat(f64::NAN); 2];
        let mut outputs = Outputs {
            slew: nan,
            alpha: nan,
            beta: nan,
            tip: nan,
        };
        if let (Self::Consistent(plants, _), Motion::Consistent(states)) = (self, motion) {
            let half = |(value, rate): (f64, f64)| [0.5 * value, 0.5 * rate];
            for (lane, (plant, state)) in plants.iter().zip(states).enumerate() {
                let extension = extension.lane_of(lane);
                let single = Outputs {
                    slew: [state.q[0], state.v[0]],
                    alpha: half(plant.link1_deflection(state)),
                    beta: half(plant.link2_deflection(state)),
                    tip: plant.tip_deflection(state, &extension).into(),
                };
                outputs.put_lane(lane, &single);
            }
        }
        outputs
    }

    /// Advances the consistent plant and the wheels over a span; returns slew, root and tip torque
    /// at the beginning.
    #[inline(never)]
    #[allow(clippy::too_many_arguments)]
    pub fn fly_implicitly(
        &self,
        inertia: &RigidInertia<T>,
        piece: &Piece<T>,
        slew: Option<T>,
        (root, tip): (WheelDrive<T>, WheelDrive<T>),
        span: &Span<T>,
        motion: &mut Motion<T>,
        (root_state, tip_state): (&mut WheelState<T>, &mut WheelState<T>),
    ) -> [T; 3] {
        let (Self::Consistent(plants, scheme), Motion::Consistent(states)) = (self, motion) else {
            return [T::splat(f64::NAN); 3];
        };
        let mut first = None;
        for step in 0..span.steps {
            let place = |part: f64| span.h.mul_add(T::splat(step as f64 + part), span.from);
            let root_torque = root.step::<false>(root_state, span.h);
            let tip_torque = tip.step::<false>(tip_state, span.h);
            let at = |u: T, root: T, tip: T| Torques {
                slew: slew.unwrap_or_else(|| slew_torque(inertia, piece, &piece.extension(u), u)),
                root,
                tip,
            };
            let torques = [
                at(place(0.0), root_torque.start, tip_torque.start),
                at(place(0.5), root_torque.middle, tip_torque.middle),
                at(place(1.0), root_torque.end, tip_torque.end),
            ];
            let [begin, ..] = &torques;
            first.get_or_insert([begin.slew, begin.root, begin.tip]);
            for (lane, (plant, state)) in plants.iter().zip(states.iter_mut()).enumerate() {
                plant.step(
                    scheme,
                    state,
                    &[0, 1, 2].map(|i: usize| torques[i].lane_of(lane)),
                    &piece.lane_of(lane),
                    place(0.0).lane(lane),
                    span.h.lane(lane),
                );
            }
        }
        first.unwrap_or([T::splat(0.0); 3])
    }
}
