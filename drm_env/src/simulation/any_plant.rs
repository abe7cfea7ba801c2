//! The equations of motion of a flight, whichever plant they are of: state, outputs, energy, and the
//! consistent plant over a span of the timeline.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::arm::{LINK_END_DEFLECTION, PayloadProperties};
use crate::config::scenario::Scenario;
use crate::error::ConfigError;
use crate::hardware::sensors::OUTPUTS;
use crate::math::generalized_alpha::GeneralizedAlpha;
use crate::plant::PlantModel;
use crate::plant::consistent::{CAPACITY, ConsistentLanes, ConsistentPlant, ConsistentState};
use crate::plant::energy::{Energy, angular_momentum, energy};
use crate::plant::thesis::Constants;
use crate::reference::Extension;
use crate::simd::{Laned, Number, laned};

/// Coordinate per unit of a link's end deflection.
const COORDINATE: f64 = 1.0 / LINK_END_DEFLECTION;

/// Equations of motion, a manoeuvre a lane.
#[derive(Debug, Clone)]
pub(crate) enum AnyPlant<T> {
    /// The thesis' three degrees of freedom.
    Thesis(Constants<T>),
    /// The slope-continuous arm with its integrator.
    Consistent(Box<Consistent<T>>),
}

/// The slope-continuous arm, a payload a lane.
#[derive(Debug, Clone)]
pub(crate) struct Consistent<T> {
    /// All of them side by side, as long as they are of one arm.
    pub(super) lanes: ConsistentLanes<T>,
    /// Whether they are.
    pub(super) together: bool,
    /// Each alone.
    pub(super) plants: Vec<Arc<ConsistentPlant>>,
    pub(super) scheme: GeneralizedAlpha,
    /// Inertia of the rotor before a drive shaft, kg m^2, a lane an entry; nothing where no lane has a shaft.
    pub(super) rotor_inertia: Option<T>,
}

impl<T: Number> Consistent<T> {
    fn of(plants: Vec<Arc<ConsistentPlant>>, scheme: GeneralizedAlpha) -> Self {
        let mut lanes = ConsistentLanes::new(&plants[0]);
        let mut together = true;
        for (lane, plant) in plants.iter().enumerate() {
            together &= lanes.set_lane(lane, plant);
        }
        let mut body = Self {
            lanes,
            together,
            plants,
            scheme,
            rotor_inertia: None,
        };
        body.find_rotors();
        body
    }

    fn find_rotors(&mut self) {
        let inertias = self.plants.iter().map(|plant| plant.shaft());
        let inertias: Vec<f64> = inertias
            .map(|shaft| shaft.map_or(0.0, |shaft| shaft.rotor_inertia))
            .collect();
        self.rotor_inertia = inertias.iter().any(|x| *x > 0.0).then(|| {
            let mut all = T::splat(0.0);
            for (lane, inertia) in inertias.iter().enumerate() {
                all.set_lane(lane, *inertia);
            }
            all
        });
    }
}

/// State of a [`AnyPlant`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) enum Motion<T> {
    /// theta, alpha, beta and their rates.
    Thesis([T; 6]),
    /// Any number of modes.
    Consistent(Box<Seen<T>>),
}

/// State of the consistent plant and what is seen of it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Seen<T> {
    pub(super) state: ConsistentState<T>,
    pub(super) outputs: Outputs<T>,
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

    /// Slew angle and rate, link-2 tip deflection 2 beta and its rate, and the rate at which the tip turns; what
    /// instruments read follows from accelerations, which are not known here.
    #[inline(always)]
    pub fn measurable(&self, tip_turn_rate: T) -> [T; OUTPUTS] {
        let Self { slew, beta, .. } = self;
        [
            slew[0],
            slew[1],
            beta[0] * LINK_END_DEFLECTION,
            beta[1] * LINK_END_DEFLECTION,
            tip_turn_rate,
            T::splat(0.0),
            T::splat(0.0),
            T::splat(0.0),
        ]
    }
}

impl<T: Number> Motion<T> {
    /// The same in every lane.
    pub fn spread(single: &Motion<f64>) -> Self {
        match single {
            Motion::Thesis(motion) => Self::Thesis(Laned::spread(motion)),
            Motion::Consistent(seen) => {
                let none = [T::splat(0.0); CAPACITY];
                let mut state = ConsistentState::new(none, none);
                for lane in 0..T::WIDTH {
                    state.set_lane(lane, &seen.state);
                }
                Self::Consistent(Box::new(Seen {
                    state,
                    outputs: Outputs::spread(&seen.outputs),
                }))
            }
        }
    }

    /// One lane.
    pub fn one(&self, lane: usize) -> Motion<f64> {
        match self {
            Self::Thesis(motion) => Motion::Thesis(motion.lane_of(lane)),
            Self::Consistent(seen) => Motion::Consistent(Box::new(Seen {
                state: seen.state.lane(lane),
                outputs: seen.outputs.lane_of(lane),
            })),
        }
    }

    /// Replaces slew angle and rate (rad, rad/s); what is seen follows when it is looked at.
    pub fn set_slew(&mut self, angle: T, rate: T) {
        let (q, v) = self.slew_mut();
        *q = angle;
        *v = rate;
    }

    fn slew_mut(&mut self) -> (&mut T, &mut T) {
        match self {
            Self::Thesis([theta, _, _, theta_rate, _, _]) => (theta, theta_rate),
            Self::Consistent(seen) => (&mut seen.state.q[0], &mut seen.state.v[0]),
        }
    }

    /// Turns the slew angle and its rate on by so much (rad, rad/s); what is seen follows when it is looked at.
    pub fn turn(&mut self, angle: T, rate: T) {
        let (q, v) = self.slew_mut();
        *q += angle;
        *v += rate;
    }

    /// Replaces one lane by one of the same plant.
    pub fn put(&mut self, lane: usize, single: &Motion<f64>) {
        match (self, single) {
            (Self::Thesis(motion), Motion::Thesis(single)) => motion.put_lane(lane, single),
            (Self::Consistent(seen), Motion::Consistent(single)) => {
                seen.state.set_lane(lane, &single.state);
                seen.outputs.put_lane(lane, &single.outputs);
            }
            _ => {}
        }
    }

    /// What is seen of the motion.
    #[inline(always)]
    pub fn outputs(&self) -> Outputs<T> {
        match self {
            Self::Thesis(motion) => {
                let [theta, alpha, beta, theta_rate, alpha_rate, beta_rate] = *motion;
                Outputs {
                    slew: [theta, theta_rate],
                    alpha: [alpha, alpha_rate],
                    beta: [beta, beta_rate],
                    tip: [
                        (alpha + beta) * LINK_END_DEFLECTION,
                        (alpha_rate + beta_rate) * LINK_END_DEFLECTION,
                    ],
                }
            }
            Self::Consistent(seen) => seen.outputs,
        }
    }
}

impl AnyPlant<f64> {
    /// The equations of a scenario, for the extensions of a range (m).
    ///
    /// # Errors
    /// Parameters that no arm has.
    pub fn new(
        scenario: &Scenario,
        payload: &PayloadProperties,
        range: (f64, f64),
    ) -> Result<Self, ConfigError> {
        let (arm, dynamics) = (&scenario.arm, &scenario.dynamics);
        match scenario.plant {
            PlantModel::Thesis => Ok(Self::Thesis(Constants::new(arm, payload, dynamics))),
            PlantModel::Consistent => {
                let [link1, link2] = scenario.modes;
                let plant = ConsistentPlant::new(arm, payload, dynamics, (link1, link2), range)?
                    .with_shaft(scenario.slew_motor.shaft())?;
                let scheme = GeneralizedAlpha::new(dynamics.spectral_radius)
                    .map_err(|e| e.within("dynamics"))?;
                let plants = vec![Arc::new(plant)];
                Ok(Self::Consistent(Box::new(Consistent::of(plants, scheme))))
            }
        }
    }

    /// State at t = 0, at the extension there.
    pub fn start(&self, scenario: &Scenario, extension: &Extension<f64>) -> Motion<f64> {
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
            Self::Consistent(body) => {
                let state = body.plants[0].released(
                    (start.slew_angle, start.slew_rate),
                    (start.alpha, start.alpha_rate),
                    (start.beta, start.beta_rate),
                );
                let outputs = body.outputs(&state, extension);
                Motion::Consistent(Box::new(Seen { state, outputs }))
            }
        }
    }

    /// Number of coordinates.
    pub fn coordinates(&self) -> usize {
        match self {
            Self::Thesis(_) => 3,
            Self::Consistent(body) => body.plants[0].coordinates(),
        }
    }

    /// Coordinates and rates of a motion; the first coordinate is the slew angle.
    pub fn state_of(&self, motion: &Motion<f64>) -> (Vec<f64>, Vec<f64>) {
        match motion {
            Motion::Thesis(motion) => (motion[..3].to_vec(), motion[3..].to_vec()),
            Motion::Consistent(seen) => {
                let size = self.coordinates();
                (seen.state.q[..size].to_vec(), seen.state.v[..size].to_vec())
            }
        }
    }

    /// The motion with these coordinates and rates, as many as [`AnyPlant::coordinates`] says.
    pub fn motion_of(&self, q: &[f64], v: &[f64], extension: &Extension<f64>) -> Motion<f64> {
        match self {
            Self::Thesis(_) => Motion::Thesis([q[0], q[1], q[2], v[0], v[1], v[2]]),
            Self::Consistent(body) => {
                let (mut all_q, mut all_v) = ([0.0; CAPACITY], [0.0; CAPACITY]);
                all_q[..q.len()].copy_from_slice(q);
                all_v[..v.len()].copy_from_slice(v);
                let state = ConsistentState::new(all_q, all_v);
                let outputs = body.outputs(&state, extension);
                Motion::Consistent(Box::new(Seen { state, outputs }))
            }
        }
    }

    /// A motion with its slew angle told from another zero, `angle` further on (rad). `restart` lets the
    /// integrator forget its accelerations, after a change of the arm or of what holds it.
    pub fn turned(
        &self,
        motion: &Motion<f64>,
        angle: f64,
        restart: bool,
        extension: &Extension<f64>,
    ) -> Motion<f64> {
        match (self, motion) {
            (Self::Consistent(body), Motion::Consistent(seen)) => {
                let mut state = if restart {
                    ConsistentState::new(seen.state.q, seen.state.v)
                } else {
                    seen.state
                };
                body.plants[0].turn_back(&mut state, angle);
                let outputs = body.outputs(&state, extension);
                Motion::Consistent(Box::new(Seen { state, outputs }))
            }
            (_, Motion::Thesis(motion)) => {
                let mut motion = *motion;
                motion[0] -= angle;
                Motion::Thesis(motion)
            }
            (_, other) => other.clone(),
        }
    }

    /// Whether a motion is one of this body's at an extension; one that flies on has finite numbers, and
    /// shows what its coordinates make of them.
    pub fn owns(&self, motion: &Motion<f64>, extension: &Extension<f64>, flies_on: bool) -> bool {
        match (self, motion) {
            (Self::Thesis(_), Motion::Thesis(motion)) => {
                !flies_on || motion.iter().all(|x| x.is_finite())
            }
            (Self::Consistent(body), Motion::Consistent(seen)) => {
                !flies_on
                    || seen.state.fits(self.coordinates())
                        && seen.outputs == body.outputs(&seen.state, extension)
            }
            _ => false,
        }
    }

    /// What is said of a motion: of slew angle and links' coordinates with their rates, or of the consistent
    /// plant's state; nothing of a motion of the other plant.
    fn say<R>(
        &self,
        motion: &Motion<f64>,
        thesis: impl FnOnce([f64; 3], [f64; 3]) -> R,
        consistent: impl FnOnce(&ConsistentPlant, &ConsistentState<f64>) -> R,
    ) -> Option<R> {
        match (self, motion) {
            (Self::Thesis(_), Motion::Thesis([theta, alpha, beta, rates @ ..])) => {
                Some(thesis([*theta, *alpha, *beta], *rates))
            }
            (Self::Consistent(body), Motion::Consistent(seen)) => {
                Some(consistent(&body.plants[0], &seen.state))
            }
            _ => None,
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
        let Scenario { arm, dynamics, .. } = scenario;
        let found = self.say(
            motion,
            |q, rates| energy(arm, payload, dynamics, extension, q, rates),
            |plant, state| plant.energy(state, extension),
        );
        found.unwrap_or(Energy {
            kinetic: f64::NAN,
            potential: f64::NAN,
        })
    }

    /// Angular momentum of arm and payload about the shoulder, N m s.
    pub fn arm_momentum(
        &self,
        motion: &Motion<f64>,
        extension: &Extension<f64>,
        scenario: &Scenario,
        payload: &PayloadProperties,
    ) -> f64 {
        let Scenario { arm, dynamics, .. } = scenario;
        let found = self.say(
            motion,
            |q, rates| angular_momentum(arm, payload, dynamics, extension, q, rates),
            |plant, state| plant.angular_momentum(state, extension),
        );
        found.unwrap_or(f64::NAN)
    }
}

impl<T: Number> AnyPlant<T> {
    /// The same in every lane.
    pub fn spread(single: &AnyPlant<f64>) -> Self {
        match single {
            AnyPlant::Thesis(constants) => Self::Thesis(Constants::spread(constants)),
            AnyPlant::Consistent(body) => {
                let plants = vec![Arc::clone(&body.plants[0]); T::WIDTH];
                Self::Consistent(Box::new(Consistent::of(plants, body.scheme)))
            }
        }
    }

    /// One lane.
    pub fn one(&self, lane: usize) -> AnyPlant<f64> {
        match self {
            Self::Thesis(constants) => AnyPlant::Thesis(constants.lane_of(lane)),
            Self::Consistent(body) => {
                let plants = vec![Arc::clone(&body.plants[lane])];
                AnyPlant::Consistent(Box::new(Consistent::of(plants, body.scheme)))
            }
        }
    }

    /// Memory of it and of its motion beside what they are themselves, bytes.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Thesis(_) => 0,
            Self::Consistent(body) => {
                size_of::<Consistent<T>>()
                    + size_of::<Seen<T>>()
                    + body
                        .plants
                        .iter()
                        .map(|plant| size_of::<ConsistentPlant>() + plant.bytes())
                        .sum::<usize>()
            }
        }
    }

    /// Whether another body can be a lane of this one.
    pub fn accepts(&self, single: &AnyPlant<f64>) -> bool {
        match (self, single) {
            (Self::Thesis(_), AnyPlant::Thesis(_)) => true,
            (Self::Consistent(body), AnyPlant::Consistent(single)) => {
                body.scheme == single.scheme && body.lanes.fits(&single.plants[0])
            }
            _ => false,
        }
    }

    /// Replaces one lane by a body of the same plant.
    pub fn put(&mut self, lane: usize, single: &AnyPlant<f64>) {
        match (self, single) {
            (Self::Thesis(constants), AnyPlant::Thesis(single)) => constants.put_lane(lane, single),
            (Self::Consistent(body), AnyPlant::Consistent(single)) => {
                body.plants[lane] = Arc::clone(&single.plants[0]);
                if body.together {
                    body.together = body.lanes.set_lane(lane, &single.plants[0]);
                    body.find_rotors();
                } else {
                    // the others may be of this arm again
                    **body = Consistent::of(std::mem::take(&mut body.plants), body.scheme);
                }
            }
            _ => {}
        }
    }

    /// Looks at a motion that has been integrated up to an extension.
    #[inline(always)]
    pub fn look(&self, motion: &mut Motion<T>, extension: &Extension<T>) {
        if let (Self::Consistent(body), Motion::Consistent(seen)) = (self, motion) {
            seen.outputs = body.outputs(&seen.state, extension);
        }
    }

    /// Rate at which the tip turns, rad/s: what a torque of the tip wheel works on.
    #[inline(always)]
    pub fn tip_turn_rate(&self, motion: &Motion<T>, extension: &Extension<T>) -> T {
        match (self, motion) {
            (Self::Thesis(constants), Motion::Thesis(motion)) => {
                let [_, _, _, slew_rate, _, beta_rate] = *motion;
                constants.tip_turn_rate(slew_rate, beta_rate, extension.length)
            }
            (Self::Consistent(body), Motion::Consistent(seen)) => {
                body.tip_turn_rate(&seen.state, extension)
            }
            _ => T::splat(f64::NAN),
        }
    }
}

impl<T: Number> Consistent<T> {
    #[inline(always)]
    fn tip_turn_rate(&self, state: &ConsistentState<T>, extension: &Extension<T>) -> T {
        let mut rate = self.lanes.tip_turn_rate(state, extension);
        if !self.together {
            for (lane, plant) in self.plants.iter().enumerate() {
                let one = ConsistentLanes::new(plant)
                    .tip_turn_rate(&state.lane(lane), &extension.lane_of(lane));
                rate.set_lane(lane, one);
            }
        }
        rate
    }

    #[inline(always)]
    fn outputs(&self, state: &ConsistentState<T>, extension: &Extension<T>) -> Outputs<T> {
        let mut seen = self.lanes.outputs(state, extension);
        if !self.together {
            for (lane, plant) in self.plants.iter().enumerate() {
                let one = ConsistentLanes::new(plant)
                    .outputs(&state.lane(lane), &extension.lane_of(lane));
                seen.link1.put_lane(lane, &one.link1);
                seen.link2.put_lane(lane, &one.link2);
                seen.tip.put_lane(lane, &one.tip);
            }
        }
        Outputs {
            slew: seen.slew,
            alpha: [seen.link1[0] * COORDINATE, seen.link1[1] * COORDINATE],
            beta: [seen.link2[0] * COORDINATE, seen.link2[1] * COORDINATE],
            tip: seen.tip,
        }
    }
}
