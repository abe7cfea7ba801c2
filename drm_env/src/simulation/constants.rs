//! What is fixed through an episode, as the sample loop needs it.

use crate::control::KnownInertia;
use crate::hardware::slew_motor::CurrentGains;
use crate::plant::RigidInertia;
use crate::simd::{Number, laned};
use crate::simulation::plan::Plan;
use crate::simulation::propagate_thesis::{Switches, WheelDrive};

/// A wheel's constants.
#[derive(Debug, Clone, Copy)]
pub(crate) struct WheelLimits<T> {
    /// Largest torque, N m, and its reciprocal.
    pub(crate) torque: T,
    pub(super) per_torque: T,
    pub(super) momentum: T,
    pub(super) lag: T,
}

laned!(WheelLimits {
    torque,
    per_torque,
    momentum,
    lag
});

impl<T: Number> WheelLimits<T> {
    /// The wheel over steps of length `h`; an ideal one needs no more than its command.
    #[inline(always)]
    pub(super) fn drive(&self, command: T, h: T, ideal: bool) -> WheelDrive<T> {
        let (mut memory, mut decay) = (T::splat(0.0), T::splat(0.0));
        if !ideal {
            for lane in 0..T::WIDTH {
                let lag = self.lag.lane(lane);
                if lag > 0.0 {
                    memory.set_lane(lane, 1.0);
                    decay.set_lane(lane, libm::exp(-0.5 * h.lane(lane) / lag));
                }
            }
        }
        WheelDrive {
            command,
            memory,
            decay,
            momentum_limit: self.momentum,
        }
    }
}

/// What is fixed through an episode, as the sample loop needs it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LaneConstants<T> {
    pub(crate) inertia: RigidInertia<T>,
    /// The reported payload's share of the inertia.
    pub(super) payload_inertia: RigidInertia<T>,
    pub(super) known: KnownInertia<T>,
    pub(crate) root: WheelLimits<T>,
    pub(crate) tip: WheelLimits<T>,
    pub(super) direction: T,
    pub(super) slew_end_time: T,
    pub(crate) current: CurrentGains<T>,
    /// Length of link 1, m.
    pub(crate) link1_length: T,
    /// Momentum that brakes or motor have taken from the base or given to it beside the plan, N m s: what
    /// the balance of angular momentum that laws know of has to leave out.
    pub(super) stored: T,
}

laned!(LaneConstants {
    inertia,
    payload_inertia,
    known,
    root,
    tip,
    direction,
    slew_end_time,
    current,
    link1_length,
    stored,
});

impl LaneConstants<f64> {
    pub(super) fn new(plan: &Plan) -> Self {
        let limits = |wheel: &crate::hardware::reaction_wheel::Wheel| WheelLimits {
            torque: wheel.torque_limit,
            per_torque: 1.0 / wheel.torque_limit,
            momentum: wheel.momentum_limit,
            lag: wheel.lag,
        };
        let arm = &plan.scenario.arm;
        Self {
            inertia: RigidInertia::new(arm, &plan.reported)
                .with_motor(plan.scenario.slew_motor.open_loop_limit),
            payload_inertia: RigidInertia::of_payload(arm, &plan.reported),
            known: KnownInertia::new(
                arm,
                &plan.reported,
                RigidInertia::new(arm, &plan.reported).coefficients(),
            ),
            root: limits(&plan.root),
            tip: limits(&plan.tip),
            direction: plan.direction(),
            slew_end_time: plan.slew_end_time,
            current: plan.scenario.slew_motor.gains(),
            link1_length: arm.link1.length,
            stored: 0.0,
        }
    }
}

/// What all lanes of a flight share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SharedConstants {
    pub(super) sample_period: f64,
    pub(super) integrator_step: f64,
    pub(super) steps: usize,
    /// 1 / steps
    pub(super) per_steps: f64,
    pub(super) axial_load: bool,
    pub(super) particle_following: bool,
}

impl SharedConstants {
    pub(super) fn new(plan: &Plan) -> Self {
        let scenario = &plan.scenario;
        Self {
            sample_period: scenario.sample_period,
            integrator_step: scenario.integrator_step,
            steps: plan.steps_per_sample(),
            per_steps: 1.0 / plan.steps_per_sample() as f64,
            axial_load: scenario.dynamics.axial_load,
            particle_following: scenario.dynamics.particle_following,
        }
    }
}

impl SharedConstants {
    /// Any dynamics, with any wheels.
    pub(super) fn switches(&self) -> Switches {
        Switches {
            axial_load: self.axial_load,
            particle_following: self.particle_following,
            ideal_wheels: false,
        }
    }
}
