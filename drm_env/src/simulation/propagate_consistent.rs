//! The consistent plant over a span of the timeline, by implicit steps.

use crate::hardware::reaction_wheel::WheelState;
use crate::interruption;
use crate::plant::{RigidInertia, Torques};
use crate::reference::timeline::Piece;
use crate::simd::dispatch::{Work, variants};
use crate::simd::{Laned, Number};
use crate::simulation::any_plant::{Consistent, Seen};
use crate::simulation::propagate_thesis::{WheelDrive, slew_torque};
use crate::simulation::span::Span;

/// Steps within a sample after which it is time to look whether the work shall stop.
const STEPS_BETWEEN_POLLS: usize = 512;

/// The consistent plant over a span of the timeline.
pub(crate) struct Implicit<'a, T: Number> {
    pub(crate) body: &'a Consistent<T>,
    pub(crate) inertia: &'a RigidInertia<T>,
    pub(crate) piece: &'a Piece<T>,
    /// Torque of the slew motor where it is not the open-loop one.
    pub(crate) slew: Option<T>,
    /// Root and tip wheel.
    pub(crate) drives: [WheelDrive<T>; 2],
    pub(crate) span: Span<T>,
    pub(crate) seen: &'a mut Seen<T>,
    pub(crate) wheels: [&'a mut WheelState<T>; 2],
}

impl<T: Number> Implicit<'_, T> {
    /// Slew torque and the extension `u` seconds after the piece's start.
    #[inline(always)]
    fn at(&self, u: T) -> T {
        match self.slew {
            Some(torque) => torque,
            None => slew_torque(self.inertia, self.piece, &self.piece.extension(u), u),
        }
    }
}

impl<T: Number> Implicit<'_, T> {
    /// Adds what the open loop gives for the rotor's own acceleration before a drive shaft, as the reference has
    /// it. An agent's torque is what it says.
    #[inline(never)]
    fn turn_rotor(&self, inertia: T, places: &[T; 3], torques: &mut [Torques<T>; 3]) {
        if self.slew.is_some() {
            return;
        }
        for (torques, u) in torques.iter_mut().zip(places) {
            let (accel, _) = self.piece.motion(*u);
            torques.slew = inertia.mul_add(accel, torques.slew);
        }
    }
}

variants!(implicit_steps);

impl<T: Number> Work for Implicit<'_, T> {
    /// Slew, root and tip torque at the beginning.
    type Output = [T; 3];
    type Variants = implicit_steps::Here;

    #[inline(always)]
    fn run(self) -> [T; 3] {
        let zero = T::splat(0.0);
        let mut first = [zero; 3];
        let Consistent {
            lanes,
            together,
            plants,
            scheme,
            rotor_inertia: _,
        } = self.body;
        let (from, h) = (self.span.from, self.span.h);
        let balance = scheme.balance_point();
        let mut begin = from;
        for step in 0..self.span.steps {
            if step % STEPS_BETWEEN_POLLS == STEPS_BETWEEN_POLLS - 1 {
                interruption::poll();
            }
            let root = self.drives[0].step(false, self.wheels[0], h);
            let tip = self.drives[1].step(false, self.wheels[1], h);
            let end = if step + 1 == self.span.steps {
                self.span.until
            } else {
                h.mul_add(T::splat(step as f64 + 1.0), from)
            };
            let mut torques = [
                Torques {
                    slew: self.at(begin),
                    root: root.start,
                    tip: tip.start,
                },
                Torques {
                    slew: self.at(h.mul_add(T::splat(0.5), begin)),
                    root: root.middle,
                    tip: tip.middle,
                },
                Torques {
                    slew: self.at(end),
                    root: root.end,
                    tip: tip.end,
                },
            ];
            if step == 0 {
                first = [torques[0].slew, torques[0].root, torques[0].tip];
            }
            if let Some(inertia) = self.body.rotor_inertia {
                let places = [begin, h.mul_add(T::splat(0.5), begin), end];
                self.turn_rotor(inertia, &places, &mut torques);
            }
            let extension = self.piece.extension(h.mul_add(T::splat(balance), begin));
            // one environment alone chooses its instructions itself
            if T::WIDTH > 1 && *together {
                let active = T::splat(1.0);
                lanes.step(
                    scheme,
                    &mut self.seen.state,
                    &torques,
                    &extension,
                    h,
                    (active, None),
                );
            } else {
                for (lane, plant) in plants.iter().enumerate() {
                    let mut one = self.seen.state.lane(lane);
                    let torques = torques.lane_of(lane);
                    let extension = extension.lane_of(lane);
                    plant.step_at(scheme, &mut one, &torques, &extension, h.lane(lane), None);
                    self.seen.state.set_lane(lane, &one);
                }
            }
            begin = end;
        }
        first
    }
}
