//! The sample loop: commands, wheels, integration, sensors.

use super::Flight;
use crate::hardware::reaction_wheel::{WheelState, WheelTorques};
use crate::hardware::sensors::{INSTRUMENTS, OUTPUTS};
use crate::interruption;
use crate::reference::timeline::SAME_INSTANT;
use crate::simd::dispatch::Vector;
use crate::simd::mask::{everyone, lanes_of};
use crate::simd::{Laned, Number};
use crate::simulation::any_plant::{AnyPlant, Motion};
use crate::simulation::clock::Clock;
use crate::simulation::controller::Controller;
use crate::simulation::metrics::Sample;
use crate::simulation::plan::steps_within;
use crate::simulation::propagate_consistent::Implicit;
use crate::simulation::propagate_thesis::{FsalCache, General, Segment, Switches};
use crate::simulation::span::Span;

impl<T: Number> Flight<T> {
    /// Samples after which it is time to look whether the work shall stop.
    pub(crate) fn samples_between_polls(&self) -> usize {
        (STEPS_BETWEEN_POLLS / self.shared.steps).max(1)
    }

    /// Flies up to so many samples.
    #[inline(always)]
    pub(crate) fn fly<P: Controller<T>>(&mut self, samples: usize, controller: &mut P)
    where
        T: Vector,
    {
        let mut carried = FsalCache::nothing();
        let mut steps = 0;
        for _ in 0..samples {
            steps += self.shared.steps;
            if steps > STEPS_BETWEEN_POLLS {
                interruption::poll();
                steps = 0;
            }
            let resting = self.resting;
            let before = (resting != 0).then(|| (self.common, self.motion.clone(), self.clock));
            let (command, slew) = controller.command(self);
            self.sample(&command, slew, &mut carried);
            if let Some((common, motion, clock)) = before {
                for lane in lanes_of(resting) {
                    self.common.put_lane(lane, &common.lane_of(lane));
                    self.motion.put(lane, &motion.one(lane));
                    self.clock.put_lane(lane, &clock.lane_of(lane));
                }
                carried.valid = false;
            }
            if !controller.flown(self) {
                break;
            }
        }
    }

    /// Flies one sample period under held wheel commands; `slew` replaces the open-loop torque of
    /// the slew motor. `carried` is what the last sample of the same call has left to the next.
    #[inline(always)]
    pub(super) fn sample(
        &mut self,
        command: &WheelTorques<T>,
        slew: Option<T>,
        carried: &mut FsalCache<T>,
    ) where
        T: Vector,
    {
        let (root, tip) = (self.fixed.root.torque, self.fixed.tip.torque);
        let mut command = *command;
        if self.handled != 0 {
            self.overrule(&mut command);
        }
        command.root = command.root.limited(-root, root);
        command.tip = command.tip.limited(-tip, tip);
        if !self.plain {
            self.send(&mut command);
        }
        let one = T::splat(1.0);
        let saturated = one - (command.root.abs().below(root)) * (command.tip.abs().below(tip));

        let (now_rate, now_accel) = (self.clock.reference.rate, self.clock.reference.accel);
        self.integrate(&command, slew, carried);
        let [slew_torque, root_torque, tip_torque] = self.common.torques;
        let mut power = self.fixed.current.power(slew_torque, now_rate, now_accel);
        if self.handled != 0 {
            self.rest_motor(&mut power);
        }

        self.common.sample += one;
        if self.tick() {
            // what the last sample has left is of the piece before
            carried.valid = false;
        }
        self.body.look(&mut self.motion, &self.clock.extension);
        if !self.plain {
            self.sense(slew);
        }
        self.hear();
        let outputs = self.outputs();

        let of_root = root_torque * self.fixed.root.per_torque;
        let of_tip = tip_torque * self.fixed.tip.per_torque;
        self.effort = of_root.mul_add(of_root, of_tip * of_tip);
        let sample = Sample {
            slew_angle: outputs.slew[0],
            slew_error: self.slew_error(),
            reach: self.reach(),
            deflection: outputs.tip[0],
            after_slew: one - self.clock.time.below(self.fixed.slew_end_time),
            effort: self.effort,
            saturated,
            power,
        };
        let void = self.void();
        if void == 0 {
            self.common.metrics.take(&sample, self.fixed.direction);
        } else {
            let kept = self.common.metrics;
            self.common.metrics.take(&sample, self.fixed.direction);
            for lane in lanes_of(void) {
                self.common.metrics.put_lane(lane, &kept.lane_of(lane));
            }
        }
    }

    /// Integrates over one sample period. Lanes in which reference or extension switch within it, or whose
    /// leg does more than its manoeuvre, fly alone.
    #[inline(always)]
    pub(super) fn integrate(
        &mut self,
        command: &WheelTorques<T>,
        slew: Option<T>,
        carried: &mut FsalCache<T>,
    ) where
        T: Vector,
    {
        let end = (self.common.sample + 1.0) * self.shared.sample_period;
        let alone = (self.clock.piece_end.below(end).bits() | self.handled) & !self.resting;
        let mut cuts = Vec::new();
        for lane in lanes_of(alone) {
            let command = WheelTorques {
                root: command.root.lane(lane),
                tip: command.tip.lane(lane),
            };
            let slew = slew.map(|torque| torque.lane(lane));
            let cut = match self.handling_of(lane) {
                None => self.fly_alone(lane, self.motion.one(lane), &command, slew),
                Some(handling) => self.fly_handled(lane, handling, &command, slew),
            };
            cuts.push((lane, cut));
        }
        if alone != everyone::<T>() {
            let start = self.clock.time;
            let h = (end - start) * self.shared.per_steps;
            let piece = &self.clock.piece;
            let zero = T::splat(0.0);
            let span = Span {
                from: (start - piece.start).max(zero),
                until: (end - piece.start).max(zero),
                h,
                steps: self.shared.steps,
            };
            let (root, tip) = (&mut self.common.root, &mut self.common.tip);
            self.common.torques = match (&self.body, &mut self.motion) {
                (AnyPlant::Thesis(constants), Motion::Thesis(motion)) => {
                    let leg = Segment {
                        constants,
                        inertia: &self.fixed.inertia,
                        piece,
                        slew,
                        root: self.fixed.root.drive(command.root, h, self.ideal),
                        tip: self.fixed.tip.drive(command.tip, h, self.ideal),
                        from: span.from,
                        until: span.until,
                        h,
                        steps: span.steps,
                        still: self.still,
                    };
                    let torques = if self.ideal
                        && self.shared.axial_load
                        && !self.shared.particle_following
                    {
                        leg.fly(Switches::USUAL, motion, root, tip, carried)
                    } else {
                        T::enter(General {
                            leg: &leg,
                            switches: self.shared.switches(),
                            motion,
                            root,
                            tip,
                            carried,
                        })
                    };
                    [torques.slew, torques.root, torques.tip]
                }
                (AnyPlant::Consistent(body), Motion::Consistent(seen)) => T::enter(Implicit {
                    body,
                    inertia: &self.fixed.inertia,
                    piece,
                    slew,
                    drives: [
                        self.fixed.root.drive(command.root, h, self.ideal),
                        self.fixed.tip.drive(command.tip, h, self.ideal),
                    ],
                    span,
                    seen,
                    wheels: [root, tip],
                }),
                _ => [T::splat(f64::NAN); 3],
            };
        }
        if alone != 0 {
            carried.valid = false;
            for (lane, cut) in &cuts {
                self.motion.put(*lane, &cut.motion);
                self.common.root.put_lane(*lane, &cut.root);
                self.common.tip.put_lane(*lane, &cut.tip);
                self.common.torques.put_lane(*lane, &cut.torques);
            }
        }
    }

    /// One lane over one sample period from a motion on, cut where reference or extension switch.
    #[inline(never)]
    pub(super) fn fly_alone(
        &self,
        lane: usize,
        motion: Motion<f64>,
        command: &WheelTorques<f64>,
        slew: Option<f64>,
    ) -> Cut {
        let manoeuvre = &self.manoeuvres[lane];
        let timeline = &manoeuvre.timeline;
        let sample = self.common.sample.lane(lane);
        let fixed = self.fixed.lane_of(lane);
        let body = self.body.one(lane);
        let mut result = Cut {
            motion,
            root: self.common.root.lane_of(lane),
            tip: self.common.tip.lane_of(lane),
            torques: [0.0; 3],
        };
        let end = (sample + 1.0) * self.shared.sample_period;
        let mut time = self.clock.time.lane(lane);
        let mut index = manoeuvre.piece as usize;
        let mut first = None;
        while time < end {
            let piece = timeline.piece(index);
            let until = end.min(timeline.end(index));
            let steps = steps_within(until - time, self.shared.integrator_step);
            let h = (until - time) / steps as f64;
            let span = Span {
                from: (time - piece.start).max(0.0),
                until: (until - piece.start).max(0.0),
                h,
                steps,
            };
            let (root, tip) = (&mut result.root, &mut result.tip);
            let torques = match (&body, &mut result.motion) {
                (AnyPlant::Thesis(constants), Motion::Thesis(motion)) => {
                    let leg = Segment {
                        constants,
                        inertia: &fixed.inertia,
                        piece,
                        slew,
                        root: fixed.root.drive(command.root, h, false),
                        tip: fixed.tip.drive(command.tip, h, false),
                        from: span.from,
                        until: span.until,
                        h,
                        steps,
                        still: piece.is_still(),
                    };
                    let torques = f64::enter(General {
                        leg: &leg,
                        switches: self.shared.switches(),
                        motion,
                        root,
                        tip,
                        carried: &mut FsalCache::nothing(),
                    });
                    [torques.slew, torques.root, torques.tip]
                }
                (AnyPlant::Consistent(body), Motion::Consistent(seen)) => f64::enter(Implicit {
                    body,
                    inertia: &fixed.inertia,
                    piece,
                    slew,
                    drives: [
                        fixed.root.drive(command.root, h, false),
                        fixed.tip.drive(command.tip, h, false),
                    ],
                    span,
                    seen,
                    wheels: [root, tip],
                }),
                _ => [f64::NAN; 3],
            };
            first.get_or_insert(torques);
            time = until;
            index += 1;
        }
        result.torques = first.unwrap_or([0.0; 3]);
        result
    }

    /// Moves clock and pieces on to the present sample; whether a piece has begun in any lane.
    #[inline(always)]
    pub(super) fn tick(&mut self) -> bool {
        let time = self.common.sample * self.shared.sample_period;
        let reached = T::splat(1.0) - (time + SAME_INSTANT).below(self.clock.piece_end);
        let switched = reached.bits() & !self.resting;
        for lane in lanes_of(switched) {
            let manoeuvre = &mut self.manoeuvres[lane];
            let piece = manoeuvre.piece_at(time.lane(lane));
            manoeuvre.piece = piece as u32;
            let clock = Clock::new(&manoeuvre.timeline, piece, time.lane(lane));
            self.clock.put_lane(lane, &clock);
        }
        if switched != 0 {
            self.look_at_pieces();
        }
        let piece = &self.clock.piece;
        let u = (time - piece.start).max(T::splat(0.0));
        self.clock.time = time;
        self.clock.reference = piece.reference(u);
        self.clock.extension = piece.extension(u);
        switched != 0
    }

    /// Passes commands through the dead time of each lane that has one.
    #[inline(never)]
    pub(super) fn send(&mut self, command: &mut WheelTorques<T>) {
        for (lane, manoeuvre) in self.manoeuvres.iter_mut().enumerate() {
            if let Some(lines) = &mut manoeuvre.lines
                && self.resting >> lane & 1 == 0
            {
                let arriving = lines.command(WheelTorques {
                    root: command.root.lane(lane),
                    tip: command.tip.lane(lane),
                });
                command.root.set_lane(lane, arriving.root);
                command.tip.set_lane(lane, arriving.tip);
            }
        }
    }

    /// Reads the sensors of each lane at the present instant; `slew` has replaced the open-loop torque of the
    /// slew motor until now.
    #[inline(never)]
    pub(super) fn sense(&mut self, slew: Option<T>) {
        let truth = self.measurable();
        let period = self.shared.sample_period;
        for lane in lanes_of(everyone::<T>() & !self.resting) {
            let mut seen = truth.lane_of(lane);
            if let Some(read) = self.readings(lane, slew.map(|torque| torque.lane(lane))) {
                seen[OUTPUTS - INSTRUMENTS..].copy_from_slice(&read);
            }
            if let Some(lines) = &mut self.manoeuvres[lane].lines {
                seen = lines.sense(seen, period);
            }
            if let Some(measured) = &mut self.measured {
                measured.put_lane(lane, &seen);
            }
        }
    }
}

/// A lane after a sample that it has flown alone.
pub(super) struct Cut {
    pub(super) motion: Motion<f64>,
    pub(super) root: WheelState<f64>,
    pub(super) tip: WheelState<f64>,
    pub(super) torques: [f64; 3],
}

/// Integration steps after which it is time to look whether the work shall stop: some milliseconds.
const STEPS_BETWEEN_POLLS: usize = 4096;
