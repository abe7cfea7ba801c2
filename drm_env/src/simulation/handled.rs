//! Legs of missions that do something beside their manoeuvre: brakes that hold the shoulder, a base that
//! turns, wheels that are run down while the motor holds the arm.
//!
//! A base that turns about the shoulder's axis has no force on a free arm but through the shoulder: the
//! equations of motion are integrated in space, where they hold as they are, and the slew angle is told
//! from the base between the samples.

use super::Flight;
use crate::config::handling::Handling;
use crate::hardware::reaction_wheel::{WheelState, WheelTorques};
use crate::math::runge_kutta::{Stage, rk4_step};
use crate::plant::Torques;
use crate::plant::consistent::CAPACITY;
use crate::plant::thesis::{Constants, Prepared};
use crate::reference::Extension;
use crate::simd::dispatch::{Vector, Work, variants};
use crate::simd::mask::lanes_of;
use crate::simd::{Laned, Number};
use crate::simulation::any_plant::{AnyPlant, Consistent, Motion, Seen};
use crate::simulation::plan::steps_within;
use crate::simulation::propagate_thesis::WheelDrive;
use crate::simulation::sample::Cut;

/// Rate at which the slew motor brings the shoulder to its reference while the wheels are run down, 1/s: a
/// shoulder that turns at v swings out by v / 5.4, and takes two seconds to stand.
const HOLDING_RATE: f64 = 2.0;

/// How a held shoulder moves over one sample: with the base, or to the reference as the motor's controller
/// brings it there, critically damped. The motor's gear is not driven back, so that it is a constraint,
/// too, and needs no sensor but its own.
#[derive(Debug, Clone, Copy)]
enum Guide {
    /// With the base.
    Base,
    /// The slew error (rad) and its rate (rad/s) at a time (s).
    Reference { time: f64, error: f64, rate: f64 },
}

impl Guide {
    /// Slew error (rad), its rate and its acceleration at a later time, s; nothing of a base.
    fn at(&self, time: f64) -> (f64, f64, f64) {
        let Self::Reference {
            time: start,
            error,
            rate,
        } = *self
        else {
            return (0.0, 0.0, 0.0);
        };
        // e = (e0 + c t) exp(-w t)
        let (passed, w) = (time - start, HOLDING_RATE);
        let slope = w.mul_add(error, rate);
        let decay = libm::exp(-w * passed);
        let now = slope.mul_add(passed, error) * decay;
        let now_rate = slope.mul_add(decay, -w * now);
        (now, now_rate, -w * slope.mul_add(decay, now_rate))
    }
}

impl<T: Number> Flight<T> {
    /// What the leg in a lane does beside its manoeuvre.
    #[inline(always)]
    pub(super) fn handling_of(&self, lane: usize) -> Option<&Handling> {
        self.manoeuvres[lane].handling.as_deref()
    }

    /// Whether brakes hold the shoulder in a lane: then the motor rests, and what acts on the arm there is
    /// what they bear.
    pub(crate) fn is_braked(&self, lane: usize) -> bool {
        self.handling_of(lane)
            .is_some_and(|handling| handling.locked)
    }

    /// Whether brakes or motor hold the shoulder in a lane, whatever plan or agent want.
    pub(crate) fn is_held(&self, lane: usize) -> bool {
        self.handling_of(lane).is_some_and(Handling::holds)
    }

    /// Torque that holds the shoulder of a lane now (N m) under those of root and tip wheel, where something holds
    /// it.
    pub(super) fn held_torque(
        &self,
        lane: usize,
        extension: &Extension<f64>,
        [root, tip]: [f64; 2],
    ) -> Option<f64> {
        let handling = self.handling_of(lane).filter(|handling| handling.holds())?;
        let accel = if handling.locked {
            let time = self.clock.time.lane(lane);
            handling.motion(time).at(time).2
        } else {
            let [angle, rate] = self.outputs().slew.map(|value| value.lane(lane));
            let reference = self.clock.reference.lane_of(lane);
            let guide = Guide::Reference {
                time: 0.0,
                error: angle - reference.angle,
                rate: rate - reference.rate,
            };
            guide.at(0.0).2
        };
        let (body, motion) = (self.body.one(lane), self.in_space(lane));
        let switches = [self.shared.axial_load, self.shared.particle_following];
        let [idle, pushed] = [0.0, 1.0].map(|slew| {
            let torques = Torques { slew, root, tip };
            accelerations(&body, &motion, extension, &torques, switches)
        });
        let (idle, pushed) = (idle?, pushed?);
        Some((accel - idle[0]) / (pushed[0] - idle[0]))
    }

    /// Gives the wheels that are run down their torques, and none to the others of a braked arm.
    #[inline(never)]
    pub(super) fn overrule(&self, command: &mut WheelTorques<T>) {
        for lane in lanes_of(self.handled) {
            let Some(handling) = self.handling_of(lane) else {
                continue;
            };
            let [root, tip] = match &handling.unload {
                Some(unload) => unload.torques([
                    self.common.root.momentum.lane(lane),
                    self.common.tip.momentum.lane(lane),
                ]),
                None if handling.locked => [0.0; 2],
                None => continue,
            };
            command.root.set_lane(lane, root);
            command.tip.set_lane(lane, tip);
        }
    }

    /// A motor takes no power where brakes hold the shoulder.
    #[inline(never)]
    pub(super) fn rest_motor(&self, power: &mut T) {
        for lane in lanes_of(self.handled) {
            if self.is_braked(lane) {
                power.set_lane(lane, 0.0);
            }
        }
    }

    /// The motion of a lane as it is in space, not told from the base.
    pub(super) fn in_space(&self, lane: usize) -> Motion<f64> {
        let mut motion = self.motion.one(lane);
        if let Some(handling) = self.handling_of(lane)
            && handling.turns()
        {
            let time = self.clock.time.lane(lane);
            let (angle, rate, _) = handling.motion(time).at(time);
            motion.turn(angle, rate);
        }
        motion
    }

    /// One lane over one sample period in a leg that does something beside its manoeuvre.
    #[inline(never)]
    pub(super) fn fly_handled(
        &self,
        lane: usize,
        handling: &Handling,
        command: &WheelTorques<f64>,
        slew: Option<f64>,
    ) -> Cut
    where
        T: Vector,
    {
        let motion = self.in_space(lane);
        let end = (self.common.sample.lane(lane) + 1.0) * self.shared.sample_period;
        if !handling.holds() {
            let mut cut = self.fly_alone(lane, motion, command, slew);
            let (angle, rate, _) = handling.motion(end).at(end);
            cut.motion.turn(-angle, -rate);
            return cut;
        }
        let [angle, rate] = self.outputs().slew.map(|value| value.lane(lane));
        let guide = if handling.locked {
            Guide::Base
        } else {
            let reference = self.clock.reference.lane_of(lane);
            Guide::Reference {
                time: self.clock.time.lane(lane),
                error: angle - reference.angle,
                rate: rate - reference.rate,
            }
        };
        let mut cut = self.fly_held(lane, motion, (handling, guide), command);
        // the shoulder is where it is held, whatever rounding says
        let (before, _, _) = guide.at(self.clock.time.lane(lane));
        let (after, after_rate, _) = guide.at(end);
        cut.motion.set_slew(angle + (after - before), after_rate);
        cut
    }

    /// One lane whose shoulder is held, over one sample period from a motion in space on, cut where
    /// extension or the base's motion switch.
    fn fly_held(
        &self,
        lane: usize,
        motion: Motion<f64>,
        (handling, guide): (&Handling, Guide),
        command: &WheelTorques<f64>,
    ) -> Cut {
        let manoeuvre = &self.manoeuvres[lane];
        let timeline = &manoeuvre.timeline;
        let fixed = self.fixed.lane_of(lane);
        let body = self.body.one(lane);
        let mut result = Cut {
            motion,
            root: self.common.root.lane_of(lane),
            tip: self.common.tip.lane_of(lane),
            torques: [0.0; 3],
        };
        let end = (self.common.sample.lane(lane) + 1.0) * self.shared.sample_period;
        let mut time = self.clock.time.lane(lane);
        let mut index = manoeuvre.piece as usize;
        let mut first = None;
        let mut before = None;
        while time < end {
            let piece = timeline.piece(index);
            let until = end.min(timeline.end(index));
            let steps = steps_within(until - time, self.shared.integrator_step);
            let h = (until - time) / steps as f64;
            let base = handling.motion(time);
            let accel = |time: f64| match guide {
                Guide::Base => base.at(time).2,
                Guide::Reference { .. } => guide.at(time).2,
            };
            if before.is_some_and(|before| before != accel(time))
                && let Motion::Consistent(seen) = &mut result.motion
            {
                seen.state.restart();
            }
            let held = Held {
                body: &body,
                switches: [self.shared.axial_load, self.shared.particle_following],
                extension: |time: f64| piece.extension((time - piece.start).max(0.0)),
                accel,
                drives: [
                    fixed.root.drive(command.root, h, false),
                    fixed.tip.drive(command.tip, h, false),
                ],
                from: time,
                until,
                h,
                steps,
                motion: &mut result.motion,
                wheels: [&mut result.root, &mut result.tip],
            };
            let torques = f64::enter(held);
            first.get_or_insert(torques);
            before = Some(accel(until));
            time = until;
            index += 1;
        }
        result.torques = first.unwrap_or([0.0; 3]);
        result
    }
}

impl Flight<f64> {
    /// Stops a shoulder that turns, at once, as brakes do that close: the links keep the velocity that
    /// they had as far as their shapes let them.
    pub(super) fn brake(&mut self) {
        let scenario = self.scenario();
        let extension = self.clock.extension;
        let (q, mut v) = self.body.state_of(&self.motion);
        let switches = [
            scenario.dynamics.axial_load,
            scenario.dynamics.particle_following,
        ];
        let [idle, pushed] = [0.0, 1.0].map(|slew| {
            let torques = Torques {
                slew,
                root: 0.0,
                tip: 0.0,
            };
            accelerations(&self.body, &self.motion, &extension, &torques, switches)
        });
        let (Some(idle), Some(pushed)) = (idle, pushed) else {
            return;
        };
        let impulse = -v[0] / (pushed[0] - idle[0]);
        for (i, rate) in v.iter_mut().enumerate() {
            *rate += impulse * (pushed[i] - idle[i]);
        }
        v[0] = 0.0;
        self.motion = self.body.motion_of(&q, &v, &extension);
    }

    /// The momentum that the wheels and the arm have together, N m s: after a leg in which brakes or motor
    /// have held the shoulder, what laws no longer count.
    pub(super) fn whole_momentum(&self) -> f64 {
        let [root, tip] = self.wheel_momenta();
        self.arm_momentum() + root + tip
    }

    /// Tells laws of a momentum that came from outside, N m s.
    pub(super) fn store(&mut self, momentum: f64) {
        self.fixed.stored = momentum;
    }
}

/// Accelerations of all coordinates under torques; nothing of a motion of another plant.
fn accelerations(
    body: &AnyPlant<f64>,
    motion: &Motion<f64>,
    extension: &Extension<f64>,
    torques: &Torques<f64>,
    [axial_load, following]: [bool; 2],
) -> Option<[f64; CAPACITY]> {
    match (body, motion) {
        (AnyPlant::Thesis(constants), Motion::Thesis([theta, alpha, beta, rates @ ..])) => {
            let matrices = constants.matrices(extension, axial_load, following);
            let q = [*theta, *alpha, *beta];
            let found = Prepared::new(matrices).acceleration(&q, rates, torques, following);
            let mut all = [0.0; CAPACITY];
            all[..3].copy_from_slice(&found);
            Some(all)
        }
        (AnyPlant::Consistent(body), Motion::Consistent(seen)) => {
            let found = body.plants[0].instant(&seen.state, torques, extension);
            Some(found.accel)
        }
        _ => None,
    }
}

/// One lane with a held shoulder over equal steps, within one piece of everything that is prescribed.
struct Held<'a, E, A> {
    body: &'a AnyPlant<f64>,
    /// Axial load and the following of particles.
    switches: [bool; 2],
    /// Extension and angular acceleration of the shoulder (rad/s^2) at a time, s.
    extension: E,
    accel: A,
    drives: [WheelDrive<f64>; 2],
    from: f64,
    until: f64,
    h: f64,
    steps: usize,
    motion: &'a mut Motion<f64>,
    wheels: [&'a mut WheelState<f64>; 2],
}

variants!(held);

impl<E: Fn(f64) -> Extension<f64>, A: Fn(f64) -> f64> Work for Held<'_, E, A> {
    /// What holds the shoulder, root and tip torque at the beginning.
    type Output = [f64; 3];
    type Variants = held::Here;

    #[inline(always)]
    fn run(self) -> [f64; 3] {
        let mut first = [0.0; 3];
        for step in 0..self.steps {
            let begin = self.h.mul_add(step as f64, self.from);
            let end = if step + 1 == self.steps {
                self.until
            } else {
                self.h.mul_add(step as f64 + 1.0, self.from)
            };
            let root = self.drives[0].step(false, self.wheels[0], self.h);
            let tip = self.drives[1].step(false, self.wheels[1], self.h);
            let torques = [
                (root.start, tip.start),
                (root.middle, tip.middle),
                (root.end, tip.end),
            ]
            .map(|(root, tip)| Torques {
                slew: 0.0,
                root,
                tip,
            });
            let holding = match (self.body, &mut *self.motion) {
                (AnyPlant::Thesis(constants), Motion::Thesis(motion)) => {
                    let times = [begin, f64::midpoint(begin, end), end];
                    let extensions = times.map(&self.extension);
                    let accels = times.map(&self.accel);
                    step_thesis(
                        constants,
                        motion,
                        (&torques, &extensions, accels),
                        self.switches,
                        self.h,
                    )
                }
                (AnyPlant::Consistent(body), Motion::Consistent(seen)) => {
                    let holding = if step == 0 {
                        let accel = (self.accel)(begin);
                        reaction(body, seen, &torques[0], &(self.extension)(begin), accel)
                    } else {
                        0.0
                    };
                    let balance = self.h.mul_add(body.scheme.balance_point(), begin);
                    let held = [(self.accel)(begin), (self.accel)(balance)];
                    let extension = (self.extension)(balance);
                    let plant = &body.plants[0];
                    plant.step_at(
                        &body.scheme,
                        &mut seen.state,
                        &torques,
                        &extension,
                        self.h,
                        Some(held),
                    );
                    holding
                }
                _ => f64::NAN,
            };
            if step == 0 {
                first = [holding, torques[0].root, torques[0].tip];
            }
        }
        first
    }
}

/// A Runge-Kutta step of the thesis plant with a held shoulder, under torques, lengths and angular
/// accelerations (rad/s^2) at its beginning, middle and end; returns what holds the shoulder at the
/// beginning, N m.
#[inline(always)]
fn step_thesis(
    constants: &Constants<f64>,
    motion: &mut [f64; 6],
    (torques, extensions, accels): (&[Torques<f64>; 3], &[Extension<f64>; 3], [f64; 3]),
    [axial_load, following]: [bool; 2],
    h: f64,
) -> f64 {
    let prepared = extensions
        .map(|extension| Prepared::new(constants.matrices(&extension, axial_load, following)));
    let mut holding = 0.0;
    *motion = rk4_step(motion, h, |stage: Stage, y: &[f64; 6]| {
        let i = match stage {
            Stage::Start => 0,
            Stage::Middle => 1,
            Stage::End => 2,
        };
        let [theta, alpha, beta, theta_rate, alpha_rate, beta_rate] = *y;
        let v = [theta_rate, alpha_rate, beta_rate];
        let q = [theta, alpha, beta];
        let ([a, b, c], torque) =
            prepared[i].held_acceleration(&q, &v, &torques[i], following, accels[i]);
        if stage == Stage::Start {
            holding = torque;
        }
        [theta_rate, alpha_rate, beta_rate, a, b, c]
    });
    holding
}

/// Torque at the shoulder of the consistent arm that lets it accelerate by `accel` (rad/s^2), N m: the
/// acceleration is linear in it.
#[inline(always)]
fn reaction(
    body: &Consistent<f64>,
    seen: &Seen<f64>,
    torques: &Torques<f64>,
    extension: &Extension<f64>,
    accel: f64,
) -> f64 {
    let [idle, pushed] = [0.0, 1.0].map(|slew| {
        let torques = Torques { slew, ..*torques };
        body.plants[0]
            .instant(&seen.state, &torques, extension)
            .accel[0]
    });
    (accel - idle) / (pushed - idle)
}
