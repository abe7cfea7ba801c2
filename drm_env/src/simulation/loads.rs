//! Loads of a flight: what arm, base, wheels and motor bear at one instant, and their peaks. Computed
//! beside the flight for who asks; neither episodes nor snapshots know of them.

use super::Flight;
use crate::hardware::sensors::INSTRUMENTS;
use crate::hardware::slew_motor::{ARMATURE_RESISTANCE, BACK_EMF_CONSTANT, CurrentGains};
use crate::plant::consistent::{CAPACITY, ConsistentPlant};
use crate::plant::loads::{InertiaLoads, LoadModel, Moving};
use crate::plant::thesis::{Constants, Prepared};
use crate::plant::{RigidInertia, Torques};
use crate::reference::Extension;
use crate::reference::timeline::Reference;
use crate::simd::{Laned, Number};
use crate::simulation::any_plant::{AnyPlant, Motion};
use std::sync::Arc;

/// Names of the loads, in the order of [`Loads`]; N m, N, N m s, m, m/s^2, rad/s, A, V, W and J. See
/// docs/loads.md for what they are.
pub const LOAD_NAMES: [&str; 22] = [
    "root_bending_moment_link1",
    "root_bending_moment_link2",
    "root_shear_link1",
    "root_shear_link2",
    "payload_acceleration",
    "deployment_force",
    "base_force_x",
    "base_force_y",
    "base_torque",
    "angular_momentum",
    "root_wheel_momentum",
    "tip_wheel_momentum",
    "tip_x",
    "tip_y",
    "motor_torque",
    "motor_speed",
    "motor_current",
    "motor_voltage",
    "motor_power",
    "motor_energy",
    "motor_input_power",
    "motor_excess",
];

/// Where the pairs of components along x and y begin, and what adds up over the legs of a mission.
const BASE_FORCE_X: usize = 6;
const TIP_X: usize = 12;
const MOTOR_ENERGY: usize = 19;

/// Every load at one instant, in the order of [`LOAD_NAMES`].
pub type Loads = [f64; LOAD_NAMES.len()];

/// Equations of motion of one manoeuvre.
#[derive(Debug, Clone)]
enum Body {
    Thesis {
        constants: Box<Constants<f64>>,
        axial_load: bool,
        following: bool,
    },
    Consistent(Arc<ConsistentPlant>),
}

/// Tells the loads of a leg from the beginning of its mission on, which has begun `angle` (rad) before it
/// and has cost the motor `energy` (J) until then.
pub(crate) fn move_loads(loads: &mut Loads, angle: f64, energy: f64) {
    let (sin, cos) = (libm::sin(angle), libm::cos(angle));
    for x in [BASE_FORCE_X, TIP_X] {
        let (along, across) = (loads[x], loads[x + 1]);
        loads[x] = cos * along - sin * across;
        loads[x + 1] = sin * along + cos * across;
    }
    loads[MOTOR_ENERGY] += energy;
}

/// One manoeuvre, to be asked for its loads.
#[derive(Debug, Clone)]
pub(crate) struct LoadMeter {
    model: LoadModel,
    body: Body,
    current: CurrentGains<f64>,
    gear_ratio: f64,
    inertia: RigidInertia<f64>,
    link1_length: f64,
    sample_period: f64,
    /// Whether brakes hold the shoulder in the motor's stead.
    braked: bool,
    /// Whether either holds it, whatever the plan wants.
    held: bool,
}

/// A manoeuvre at one instant, before its torques are known.
#[derive(Debug, Clone)]
pub(crate) struct Before {
    motion: Motion<f64>,
    extension: Extension<f64>,
    reference: Reference<f64>,
    momenta: [f64; 2],
    energy: f64,
}

impl LoadMeter {
    /// Of the manoeuvre in a lane; nothing if its payload cannot be, with which it would not fly.
    pub(crate) fn of<T: Number>(flight: &Flight<T>, lane: usize) -> Option<Self> {
        let scenario = flight.scenario_of(lane);
        let payload = scenario.true_payload().ok()?;
        let dynamics = scenario.dynamics;
        let (model, body) = match flight.body.one(lane) {
            AnyPlant::Thesis(constants) => {
                let following = dynamics.particle_following;
                let body = Body::Thesis {
                    constants: Box::new(constants),
                    axial_load: dynamics.axial_load,
                    following,
                };
                (LoadModel::thesis(&scenario.arm, &payload, following), body)
            }
            AnyPlant::Consistent(body) => {
                let plant = body.plants.into_iter().next()?;
                (LoadModel::consistent(&plant), Body::Consistent(plant))
            }
        };
        Some(Self {
            model,
            body,
            current: flight.fixed.current.lane_of(lane),
            gear_ratio: scenario.slew_motor.gear_ratio,
            inertia: flight.fixed.inertia.lane_of(lane),
            link1_length: scenario.arm.link1.length,
            sample_period: flight.sample_period(),
            braked: flight.is_braked(lane),
            held: flight.is_held(lane),
        })
    }

    /// Memory of it, bytes, about; an arm that others have too is not counted.
    pub(super) fn bytes(&self) -> usize {
        size_of::<Self>() + size_of::<Constants<f64>>() + self.model.bytes()
    }

    /// The present instant of the manoeuvre in a lane.
    pub(crate) fn look<T: Number>(&self, flight: &Flight<T>, lane: usize) -> Before {
        let clock = flight.clock.lane_of(lane);
        let power = flight.common.metrics.summed_power().lane(lane);
        Before {
            motion: flight.in_space(lane),
            extension: clock.extension,
            reference: clock.reference,
            momenta: [
                flight.common.root.momentum.lane(lane),
                flight.common.tip.momentum.lane(lane),
            ],
            energy: power * self.sample_period,
        }
    }

    /// Torque on the arm at the shoulder, N m: that of the drive shaft if there is one, that of the slew motor (or
    /// brakes) if not.
    fn on_arm(&self, motion: &Motion<f64>, slew: f64) -> f64 {
        match (&self.body, motion) {
            (Body::Consistent(plant), Motion::Consistent(seen)) => {
                plant.shaft_torque(&seen.state).unwrap_or(slew)
            }
            _ => slew,
        }
    }

    /// What follows from inertia under the torques of slew motor (or brakes), root and tip wheel (N m), the slew
    /// angle (rad), and what squares of deflections add to the angular momentum (N m s); nothing of a motion of
    /// another plant.
    fn inertia_loads(
        &self,
        motion: &Motion<f64>,
        extension: &Extension<f64>,
        [slew, root, tip]: [f64; 3],
    ) -> Option<(InertiaLoads, f64, f64)> {
        let all = Torques { slew, root, tip };
        let (mut q, mut v, mut accel) = ([0.0; CAPACITY], [0.0; CAPACITY], [0.0; CAPACITY]);
        let turned = match (&self.body, motion) {
            (
                Body::Thesis {
                    constants,
                    axial_load,
                    following,
                },
                Motion::Thesis(motion),
            ) => {
                let matrices = constants.matrices(extension, *axial_load, *following);
                let [theta, alpha, beta, rates @ ..] = *motion;
                let axial = matrices.axial;
                let turned = -(axial.a2 * alpha * alpha + axial.b2 * beta * beta) * rates[0];
                let found = Prepared::new(matrices).acceleration(
                    &[theta, alpha, beta],
                    &rates,
                    &all,
                    *following,
                );
                q[..3].copy_from_slice(&motion[..3]);
                v[..3].copy_from_slice(&rates);
                accel[..3].copy_from_slice(&found);
                turned
            }
            (Body::Consistent(plant), Motion::Consistent(seen)) => {
                let found = plant.instant(&seen.state, &all, extension);
                (q, v, accel) = (seen.state.q, seen.state.v, found.accel);
                found.turned_momentum
            }
            _ => return None,
        };
        let found = self.model.at(&Moving {
            q: &q,
            v: &v,
            accel: &accel,
            extension,
            tip_torque: tip,
        });
        Some((found, q[0], turned))
    }

    /// What strain gauges at the roots of link 1 and link 2 (bending moments, N m) and an accelerometer at the
    /// tip (m/s^2) read under torques, which are those of [`LoadMeter::at`].
    pub(super) fn readings(
        &self,
        motion: &Motion<f64>,
        extension: &Extension<f64>,
        torques: [f64; 3],
    ) -> [f64; INSTRUMENTS] {
        let [slew, root, tip] = torques;
        let slew = self.on_arm(motion, slew);
        self.inertia_loads(motion, extension, [slew, root, tip])
            .map_or([f64::NAN; INSTRUMENTS], |(found, ..)| {
                [slew + root, found.moment, found.tip_acceleration]
            })
    }

    /// The loads then, under the torques of slew motor (or brakes), root and tip wheel (N m).
    pub(crate) fn at(&self, before: &Before, torques: [f64; 3]) -> Loads {
        let Before {
            motion,
            extension,
            reference,
            momenta,
            energy,
        } = before;
        let [driving, root, tip] = torques;
        let slew = self.on_arm(motion, driving);
        let Some((found, angle, turned)) = self.inertia_loads(motion, extension, [slew, root, tip])
        else {
            return [f64::NAN; LOAD_NAMES.len()];
        };
        let (sin, cos) = (libm::sin(angle), libm::cos(angle));
        let turn =
            |[along, across]: [f64; 2]| [along * cos - across * sin, along * sin + across * cos];
        let [base_x, base_y] = turn(found.base);
        let [tip_x, tip_y] = turn([self.link1_length + extension.length, found.tip]);
        let motor = if self.braked { 0.0 } else { driving };
        let (rate, accel) = (reference.rate, reference.accel);
        let wanted = if self.held {
            motor
        } else {
            self.inertia.wanted_torque(extension, rate, accel)
        };
        let given = self.inertia.given(wanted);
        let current = self.current.current(motor, reference.rate, reference.accel);
        let voltage =
            ARMATURE_RESISTANCE * current + BACK_EMF_CONSTANT * self.gear_ratio * reference.rate;
        [
            // what turns the hub has no inertia of its own
            slew + root,
            found.moment,
            found.base[1],
            found.shear,
            found.payload_acceleration,
            found.deployment,
            base_x,
            base_y,
            slew,
            found.momentum + turned + momenta[0] + momenta[1],
            momenta[0],
            momenta[1],
            tip_x,
            tip_y,
            motor,
            reference.rate,
            current,
            voltage,
            ARMATURE_RESISTANCE * current * current,
            *energy,
            voltage * current,
            (wanted - given).abs(),
        ]
    }
}

/// Largest magnitude and root mean square of every load over a manoeuvre, in the order of
/// [`LOAD_NAMES`]; NaN of one that has left the limits of [`crate::validity`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoadMetrics {
    /// Largest magnitudes.
    pub peak: Loads,
    /// Root mean squares over the samples, the first and the last included.
    pub rms: Loads,
}

impl LoadMetrics {
    /// Of a manoeuvre without any.
    pub const VOID: Self = Self {
        peak: [f64::NAN; LOAD_NAMES.len()],
        rms: [f64::NAN; LOAD_NAMES.len()],
    };
}

/// What [`LoadMetrics`] are made of.
#[derive(Debug, Clone)]
pub(crate) struct LoadSums {
    count: f64,
    peak: Loads,
    squares: Loads,
}

impl LoadSums {
    pub(crate) const NONE: Self = Self {
        count: 0.0,
        peak: [0.0; LOAD_NAMES.len()],
        squares: [0.0; LOAD_NAMES.len()],
    };

    pub(crate) fn take(&mut self, loads: &Loads) {
        self.count += 1.0;
        for (i, load) in loads.iter().enumerate() {
            self.peak[i] = self.peak[i].max(load.abs());
            self.squares[i] += load * load;
        }
    }

    pub(crate) fn metrics(&self) -> LoadMetrics {
        LoadMetrics {
            peak: self.peak,
            rms: self.squares.map(|sum| libm::sqrt(sum / self.count)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_missions_move_is_where_it_is_named() {
        let named = [
            BASE_FORCE_X,
            BASE_FORCE_X + 1,
            TIP_X,
            TIP_X + 1,
            MOTOR_ENERGY,
        ];
        let names = named.map(|i| LOAD_NAMES[i]);
        assert_eq!(
            names,
            [
                "base_force_x",
                "base_force_y",
                "tip_x",
                "tip_y",
                "motor_energy"
            ]
        );
    }
}
