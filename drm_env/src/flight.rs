//! Manoeuvres in flight, one a lane: state, and the sample loop of sensors, wheels and integration
//! that laws and agents drive.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::actuator::WheelState;
use crate::body::{Body, Implicit, Motion, Outputs};
use crate::control::{KnownInertia, LawMemory, Measurement, WheelTorques};
use crate::distribution::Setting;
use crate::error::{ConfigError, SnapshotError};
use crate::interruption;
use crate::lane::{Laned, Number, laned};
use crate::leg::{Carried, Leg, Switches, WheelDrive};
use crate::lines::Lines;
use crate::metrics::{Accumulator, Metrics, Sample};
use crate::motor::CurrentGains;
use crate::plan::{Kept, steps_within};
use crate::plant::energy::Energy;
use crate::plant::{Extension, RigidInertia};
use crate::rng::Stream;
use crate::scenario::Scenario;
use crate::timeline::{Piece, Reference, SAME_INSTANT, Timeline};
use crate::vector::{Vector, Work, variants};

pub use crate::plan::Plan;

/// What changes through an episode and is the same for every manoeuvre.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Common<T> {
    /// Samples flown.
    pub(crate) sample: T,
    pub(crate) root: WheelState<T>,
    pub(crate) tip: WheelState<T>,
    pub(crate) memory: LawMemory<T>,
    pub(crate) metrics: Accumulator<T>,
    /// Torques at the beginning of the last sample, N m: slew, root, tip.
    pub(crate) torques: [T; 3],
}

laned!(Common {
    sample,
    root,
    tip,
    memory,
    metrics,
    torques,
});

/// What changes through one episode, for a snapshot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FlightState {
    common: Common<f64>,
    motion: Motion<f64>,
    measured: [f64; 4],
    lines: Option<Box<Lines>>,
}

/// Integration steps after which it is time to look whether the work shall stop: some milliseconds.
const STEPS_BETWEEN_POLLS: usize = 4096;

/// Slew rate below which a payload is not identified, rad/s: a tenth of a second at 0.02 rad/s^2.
const SLOWEST_IDENTIFICATION: f64 = 2e-3;

/// Largest mass error that is taken for one.
const LARGEST_IDENTIFIED_ERROR: f64 = 0.5;

/// A wheel's constants.
#[derive(Debug, Clone, Copy)]
pub(crate) struct WheelLimits<T> {
    /// Largest torque, N m, and its reciprocal.
    pub(crate) torque: T,
    per_torque: T,
    momentum: T,
    lag: T,
}

laned!(WheelLimits {
    torque,
    per_torque,
    momentum,
    lag
});

/// What is fixed through an episode, as the sample loop needs it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fixed<T> {
    pub(crate) inertia: RigidInertia<T>,
    /// The reported payload's share of the inertia.
    payload_inertia: RigidInertia<T>,
    known: KnownInertia<T>,
    pub(crate) root: WheelLimits<T>,
    pub(crate) tip: WheelLimits<T>,
    direction: T,
    slew_end_time: T,
    pub(crate) current: CurrentGains<T>,
    /// Length of link 1, m.
    pub(crate) link1_length: T,
}

laned!(Fixed {
    inertia,
    payload_inertia,
    known,
    root,
    tip,
    direction,
    slew_end_time,
    current,
    link1_length,
});

impl Fixed<f64> {
    fn new(plan: &Plan) -> Self {
        let limits = |wheel: &crate::actuator::Wheel| WheelLimits {
            torque: wheel.torque_limit,
            per_torque: 1.0 / wheel.torque_limit,
            momentum: wheel.momentum_limit,
            lag: wheel.lag,
        };
        let arm = &plan.scenario.arm;
        Self {
            inertia: RigidInertia::new(arm, &plan.reported),
            payload_inertia: RigidInertia::of_payload(arm, &plan.reported),
            known: KnownInertia::new(arm, &plan.reported),
            root: limits(&plan.root),
            tip: limits(&plan.tip),
            direction: plan.direction(),
            slew_end_time: plan.slew_end_time,
            current: plan.scenario.slew_motor.constants.gains(),
            link1_length: arm.link1.length,
        }
    }
}

/// Where the manoeuvres are in their timelines. Derived from sample and plan.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Clock<T> {
    piece: Piece<T>,
    /// Where the next piece starts, s.
    piece_end: T,
    pub(crate) time: T,
    pub(crate) reference: Reference<T>,
    pub(crate) extension: Extension<T>,
}

laned!(Clock {
    piece,
    piece_end,
    time,
    reference,
    extension,
});

impl Clock<f64> {
    fn new(timeline: &Timeline, index: usize, time: f64) -> Self {
        let piece = *timeline.piece(index);
        let u = (time - piece.start).max(0.0);
        Self {
            piece,
            piece_end: timeline.end(index),
            time,
            reference: piece.reference(u),
            extension: piece.extension(u),
        }
    }
}

/// What only one lane has.
#[derive(Debug, Clone)]
struct Manoeuvre {
    scenario: Kept,
    timeline: Arc<Timeline>,
    /// Piece of the timeline in force.
    piece: u32,
    ideal_wheels: bool,
    /// Delay lines and noise where there are any.
    lines: Option<Box<Lines>>,
}

impl Manoeuvre {
    /// Index of the piece in force, which is not before the present one.
    #[inline(always)]
    fn piece_at(&self, time: f64) -> usize {
        self.timeline.index_from(self.piece as usize, time)
    }

    fn is_still(&self) -> bool {
        self.timeline.piece(self.piece as usize).is_still()
    }
}

/// What all lanes of a flight share.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Shared {
    sample_period: f64,
    integrator_step: f64,
    steps: usize,
    /// 1 / steps
    per_steps: f64,
    axial_load: bool,
    particle_following: bool,
}

impl Shared {
    fn new(plan: &Plan) -> Self {
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

impl Shared {
    /// Any dynamics, with any wheels.
    fn switches(&self) -> Switches {
        Switches {
            axial_load: self.axial_load,
            particle_following: self.particle_following,
            ideal_wheels: false,
        }
    }
}

/// Who flies: asked for commands before each sample and told of it afterwards.
pub(crate) trait Pilot<T: Number> {
    /// Wheel torques (N m, before saturation), and the torque of the slew motor where it is not the
    /// open-loop one.
    fn command(&mut self, flight: &mut Flight<T>) -> (WheelTorques<T>, Option<T>);
    /// After each sample: whether to fly on.
    fn flown(&mut self, flight: &mut Flight<T>) -> bool;
}

/// `T::WIDTH` manoeuvres in flight, which share their sample period, steps and equations of motion.
#[derive(Debug, Clone)]
pub struct Flight<T: Number = f64> {
    /// What the scenarios are told by their differences from.
    base: Arc<Scenario>,
    manoeuvres: Vec<Manoeuvre>,
    shared: Shared,
    fixed: Fixed<T>,
    body: Body<T>,
    clock: Clock<T>,
    pub(crate) common: Common<T>,
    motion: Motion<T>,
    /// Slew angle and rate, link-2 tip deflection and its rate as measured, where that is not what they
    /// are.
    measured: Option<Box<[T; 4]>>,
    /// Squared torque fractions of both wheels over the last sample.
    effort: T,
    /// Lanes that stay as they are, a bit each.
    resting: u32,
    /// Whether commands and outputs pass as they are in every lane.
    plain: bool,
    /// Whether every wheel is ideal.
    ideal: bool,
    /// Whether the length is fixed in every lane, in the present piece.
    still: bool,
}

impl<T: Number> Flight<T> {
    /// The same manoeuvre in every lane.
    pub(crate) fn spread(single: &Flight<f64>) -> Self {
        let mut manoeuvre = single.manoeuvres[0].clone();
        manoeuvre.scenario = Kept::Differences(Box::new([]));
        let mut flight = Self {
            base: Arc::new(single.scenario_of(0)),
            manoeuvres: vec![manoeuvre; T::WIDTH],
            shared: single.shared,
            fixed: Fixed::spread(&single.fixed),
            body: Body::spread(&single.body),
            clock: Clock::spread(&single.clock),
            common: Common::spread(&single.common),
            motion: Motion::spread(&single.motion),
            measured: None,
            effort: T::splat(0.0),
            resting: 0,
            plain: true,
            ideal: true,
            still: false,
        };
        flight.take_stock();
        if let (Some(measured), Some(single)) = (&mut flight.measured, &single.measured) {
            **measured = Laned::spread(&**single);
        }
        flight
    }

    /// Whether a manoeuvre can fly beside the others.
    pub(crate) fn accepts(&self, single: &Flight<f64>) -> bool {
        self.shared == single.shared && self.body.accepts(&single.body)
    }

    /// Replaces the manoeuvre of one lane by one that [`Flight::accepts`].
    pub(crate) fn put(&mut self, lane: usize, single: &Flight<f64>) {
        let mut manoeuvre = single.manoeuvres[0].clone();
        manoeuvre.scenario = Kept::beside(&self.base, &single.scenario_of(0));
        // most lanes have the same timeline
        if let Some(same) = self
            .manoeuvres
            .iter()
            .find(|other| other.timeline == manoeuvre.timeline)
        {
            manoeuvre.timeline = Arc::clone(&same.timeline);
        }
        self.manoeuvres[lane] = manoeuvre;
        self.fixed.put_lane(lane, &single.fixed);
        self.body.put(lane, &single.body);
        self.clock.put_lane(lane, &single.clock);
        self.common.put_lane(lane, &single.common);
        self.motion.put(lane, &single.motion);
        self.take_stock();
        let measured = single.measured();
        if let Some(all) = &mut self.measured {
            all.put_lane(lane, &measured);
        }
    }

    /// The manoeuvre of one lane.
    pub(crate) fn one(&self, lane: usize) -> Flight<f64> {
        let scenario = self.scenario_of(lane);
        let mut manoeuvre = self.manoeuvres[lane].clone();
        manoeuvre.scenario = Kept::Whole(Box::new(scenario));
        Flight {
            base: Arc::clone(&self.base),
            shared: self.shared,
            fixed: self.fixed.lane_of(lane),
            body: self.body.one(lane),
            clock: self.clock.lane_of(lane),
            common: self.common.lane_of(lane),
            motion: self.motion.one(lane),
            measured: match (&self.measured, &manoeuvre.lines) {
                (Some(measured), Some(_)) => Some(Box::new(measured.lane_of(lane))),
                _ => None,
            },
            effort: self.effort.lane(lane),
            resting: 0,
            plain: manoeuvre.lines.is_none(),
            ideal: manoeuvre.ideal_wheels,
            still: manoeuvre.is_still(),
            manoeuvres: vec![manoeuvre],
        }
    }

    fn take_stock(&mut self) {
        self.plain = self.manoeuvres.iter().all(|m| m.lines.is_none());
        self.ideal = self.manoeuvres.iter().all(|m| m.ideal_wheels);
        self.look_at_pieces();
        if self.plain {
            self.measured = None;
        } else if self.measured.is_none() {
            self.measured = Some(Box::new(self.outputs().measurable()));
        }
    }

    fn look_at_pieces(&mut self) {
        self.still = self.manoeuvres.iter().all(Manoeuvre::is_still);
    }

    /// Puts every lane where a flight of the same manoeuvre is.
    pub(crate) fn begin_at(&mut self, single: &Flight<f64>) {
        self.clock = Clock::spread(&single.clock);
        self.common = Common::spread(&single.common);
        self.motion = Motion::spread(&single.motion);
        for manoeuvre in &mut self.manoeuvres {
            manoeuvre.piece = single.manoeuvres[0].piece;
        }
        self.look_at_pieces();
    }

    /// Replaces the motion of one lane.
    pub(crate) fn deviate(&mut self, lane: usize, motion: &Motion<f64>) {
        self.motion.put(lane, motion);
    }

    /// Lanes that do not fly until told otherwise, a bit each.
    pub(crate) fn rest(&mut self, lanes: u32) {
        self.resting = lanes & everyone::<T>();
    }

    /// Lanes that do not fly.
    pub(crate) fn resting(&self) -> u32 {
        self.resting
    }

    /// Scenario of one lane.
    pub(crate) fn scenario_of(&self, lane: usize) -> Scenario {
        self.manoeuvres[lane].scenario.scenario(&self.base)
    }

    /// Timeline of one lane.
    #[inline(always)]
    pub(crate) fn timeline_of(&self, lane: usize) -> &Timeline {
        &self.manoeuvres[lane].timeline
    }

    /// Piece of the timeline in force in one lane.
    #[inline(always)]
    pub(crate) fn piece_of(&self, lane: usize) -> usize {
        self.manoeuvres[lane].piece as usize
    }

    /// What is seen of the motion.
    #[inline(always)]
    pub(crate) fn outputs(&self) -> Outputs<T> {
        self.motion.outputs()
    }

    /// Slew angle (rad) and rate (rad/s), link-2 tip deflection (m) and its rate (m/s) as measured.
    #[inline(always)]
    pub fn measured(&self) -> [T; 4] {
        match &self.measured {
            Some(measured) => **measured,
            None => self.outputs().measurable(),
        }
    }

    pub(crate) fn fixed(&self) -> &Fixed<T> {
        &self.fixed
    }

    pub(crate) fn clock(&self) -> &Clock<T> {
        &self.clock
    }

    pub(crate) fn sample_period(&self) -> f64 {
        self.shared.sample_period
    }

    /// End of the slew profile, s.
    pub(crate) fn slew_end_time(&self) -> T {
        self.fixed.slew_end_time
    }

    /// Squared torque fractions of both wheels over the last sample.
    #[inline(always)]
    pub(crate) fn effort(&self) -> T {
        self.effort
    }

    /// Slew angle minus its reference, rad.
    #[inline(always)]
    pub(crate) fn slew_error(&self) -> T {
        self.outputs().slew[0] - self.clock.reference.angle
    }

    /// Distance of the tip from the shoulder, m.
    #[inline(always)]
    pub(crate) fn reach(&self) -> T {
        self.fixed.link1_length + self.clock.extension.length
    }

    /// Error of the reported mass, true / reported - 1, as the balance of angular momentum tells it: what
    /// the motor was told to give for the reported arm and what the wheels have taken up is the true
    /// arm's inertia times its measured rate. Right up to the vibration, for an open-loop slew; 0 while
    /// the arm hardly turns and without a reported payload.
    #[inline(always)]
    pub(crate) fn identified_mass_error(&self) -> T {
        let a = self.clock.extension.length;
        let [_, rate, ..] = self.measured();
        let reported = self.fixed.inertia.at(a);
        let payload = self.fixed.payload_inertia.at(a);
        let wheels = self.common.root.momentum + self.common.tip.momentum;
        let momentum = reported.mul_add(self.clock.reference.rate, -wheels);
        let one = T::splat(1.0);
        let turning = one - rate.abs().below(T::splat(SLOWEST_IDENTIFICATION));
        let known = one - payload.below(T::splat(1.0));
        let seen = turning * known;
        // where nothing is seen the quotient is that of ones
        let rate = rate * seen + (one - seen);
        let payload = payload * seen + (one - seen);
        let limit = T::splat(LARGEST_IDENTIFIED_ERROR);
        let error = (momentum / rate - reported) / payload * seen;
        error.limited(-limit, limit)
    }

    /// What a law is told now.
    #[inline(always)]
    pub fn measurement(&self) -> Measurement<T> {
        let [angle, rate, deflection, deflection_rate] = self.measured();
        Measurement {
            slew_error: angle - self.clock.reference.angle,
            slew_error_rate: rate - self.clock.reference.rate,
            link2_deflection: deflection,
            link2_deflection_rate: deflection_rate,
            extension: self.clock.extension.length,
        }
    }

    /// Torques that a law asks for now, N m, before saturation.
    #[inline(always)]
    pub fn law_torques(&mut self, law: &crate::control::Law) -> WheelTorques<T> {
        let measurement = self.measurement();
        law.torques(
            &measurement,
            &self.fixed.known,
            &mut self.common.memory,
            self.shared.sample_period,
        )
    }

    /// Samples after which it is time to look whether the work shall stop.
    pub(crate) fn samples_between_polls(&self) -> usize {
        (STEPS_BETWEEN_POLLS / self.shared.steps).max(1)
    }

    /// Memory of it, bytes, about: less where lanes have the same.
    pub(crate) fn bytes(&self) -> usize {
        let lines = |lane: &Manoeuvre| lane.lines.as_ref().map_or(0, |lines| lines.bytes());
        let lanes: usize = self.manoeuvres.iter().map(lines).sum();
        size_of::<Self>()
            + size_of::<Scenario>()
            + self.manoeuvres.len() * (size_of::<Manoeuvre>() + size_of::<[Setting; 4]>())
            + lanes
            + self.body.bytes()
    }

    /// Flies up to so many samples.
    #[inline(always)]
    pub(crate) fn fly<P: Pilot<T>>(&mut self, samples: usize, pilot: &mut P)
    where
        T: Vector,
    {
        let mut carried = Carried::nothing();
        let mut steps = 0;
        for _ in 0..samples {
            steps += self.shared.steps;
            if steps > STEPS_BETWEEN_POLLS {
                interruption::poll();
                steps = 0;
            }
            let resting = self.resting;
            let before = (resting != 0).then(|| (self.common, self.motion.clone(), self.clock));
            let (command, slew) = pilot.command(self);
            self.sample(&command, slew, &mut carried);
            if let Some((common, motion, clock)) = before {
                for lane in lanes_of(resting) {
                    self.common.put_lane(lane, &common.lane_of(lane));
                    self.motion.put(lane, &motion.one(lane));
                    self.clock.put_lane(lane, &clock.lane_of(lane));
                }
                carried.valid = false;
            }
            if !pilot.flown(self) {
                break;
            }
        }
    }

    /// Flies one sample period under held wheel commands; `slew` replaces the open-loop torque of
    /// the slew motor. `carried` is what the last sample of the same call has left to the next.
    #[inline(always)]
    fn sample(&mut self, command: &WheelTorques<T>, slew: Option<T>, carried: &mut Carried<T>)
    where
        T: Vector,
    {
        let (root, tip) = (self.fixed.root.torque, self.fixed.tip.torque);
        let mut command = WheelTorques {
            root: command.root.limited(-root, root),
            tip: command.tip.limited(-tip, tip),
        };
        if !self.plain {
            self.send(&mut command);
        }
        let one = T::splat(1.0);
        let saturated = one - (command.root.abs().below(root)) * (command.tip.abs().below(tip));

        let (now_rate, now_accel) = (self.clock.reference.rate, self.clock.reference.accel);
        self.integrate(&command, slew, carried);
        let [slew_torque, root_torque, tip_torque] = self.common.torques;
        let power = self.fixed.current.power(slew_torque, now_rate, now_accel);

        self.common.sample += one;
        self.tick();
        self.body.look(&mut self.motion, &self.clock.extension);
        if !self.plain {
            self.sense();
        }
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

    /// Integrates over one sample period. Lanes in which reference or extension switch within it fly
    /// alone, cut there.
    #[inline(always)]
    fn integrate(&mut self, command: &WheelTorques<T>, slew: Option<T>, carried: &mut Carried<T>)
    where
        T: Vector,
    {
        let end = (self.common.sample + 1.0) * self.shared.sample_period;
        let alone = self.clock.piece_end.below(end).bits() & !self.resting;
        let mut cuts = Vec::new();
        for lane in lanes_of(alone) {
            let command = WheelTorques {
                root: command.root.lane(lane),
                tip: command.tip.lane(lane),
            };
            let slew = slew.map(|torque| torque.lane(lane));
            cuts.push((lane, self.fly_alone(lane, &command, slew)));
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
                (Body::Thesis(constants), Motion::Thesis(motion)) => {
                    let leg = Leg {
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
                (Body::Consistent(body), Motion::Consistent(seen)) => T::enter(Implicit {
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

    /// One lane over one sample period, cut where reference or extension switch.
    #[inline(never)]
    fn fly_alone(&self, lane: usize, command: &WheelTorques<f64>, slew: Option<f64>) -> Cut {
        let manoeuvre = &self.manoeuvres[lane];
        let timeline = &manoeuvre.timeline;
        let sample = self.common.sample.lane(lane);
        let fixed = self.fixed.lane_of(lane);
        let body = self.body.one(lane);
        let mut result = Cut {
            motion: self.motion.one(lane),
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
                (Body::Thesis(constants), Motion::Thesis(motion)) => {
                    let leg = Leg {
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
                        carried: &mut Carried::nothing(),
                    });
                    [torques.slew, torques.root, torques.tip]
                }
                (Body::Consistent(body), Motion::Consistent(seen)) => f64::enter(Implicit {
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

    /// Moves clock and pieces on to the present sample.
    #[inline(always)]
    fn tick(&mut self) {
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
    }

    /// Passes commands through the dead time of each lane that has one.
    #[inline(never)]
    fn send(&mut self, command: &mut WheelTorques<T>) {
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

    /// Reads the sensors of each lane at the present instant.
    #[inline(never)]
    fn sense(&mut self) {
        let truth = self.outputs().measurable();
        let Some(measured) = &mut self.measured else {
            return;
        };
        for (lane, manoeuvre) in self.manoeuvres.iter_mut().enumerate() {
            if self.resting >> lane & 1 == 1 {
                continue;
            }
            let mut seen = truth.lane_of(lane);
            if let Some(lines) = &mut manoeuvre.lines {
                seen = lines.sense(seen);
            }
            measured.put_lane(lane, &seen);
        }
    }
}

/// A bit for each lane.
#[inline(always)]
pub(crate) fn everyone<T: Number>() -> u32 {
    u32::MAX >> (32 - T::WIDTH)
}

/// Indices of the bits that are set.
#[inline(always)]
pub(crate) fn lanes_of(mut bits: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        (bits != 0).then(|| {
            let lane = bits.trailing_zeros() as usize;
            bits &= bits - 1;
            lane
        })
    })
}

/// Part of a sample that is integrated in equal steps within one piece of the timeline, in time since
/// the piece's start, s.
pub(crate) struct Span<T> {
    pub(crate) from: T,
    pub(crate) until: T,
    pub(crate) h: T,
    pub(crate) steps: usize,
}

/// A lane after a sample that it has flown alone.
struct Cut {
    motion: Motion<f64>,
    root: WheelState<f64>,
    tip: WheelState<f64>,
    torques: [f64; 3],
}

impl<T: Number> WheelLimits<T> {
    /// The wheel over steps of length `h`; an ideal one needs no more than its command.
    #[inline(always)]
    fn drive(&self, command: T, h: T, ideal: bool) -> WheelDrive<T> {
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

/// A leg of the thesis plant with any switches and wheels.
struct General<'a, 'b, T: Number> {
    leg: &'a Leg<'b, T>,
    switches: Switches,
    motion: &'a mut [T; 6],
    root: &'a mut WheelState<T>,
    tip: &'a mut WheelState<T>,
    carried: &'a mut Carried<T>,
}

variants!(general);

impl<T: Number> Work for General<'_, '_, T> {
    type Output = crate::plant::Torques<T>;
    type Variants = general::Here;

    #[inline(always)]
    fn run(self) -> Self::Output {
        let Self {
            leg,
            switches,
            motion,
            root,
            tip,
            carried,
        } = self;
        leg.fly(switches, motion, root, tip, carried)
    }
}

/// One sample under given commands.
struct Held<T> {
    command: WheelTorques<T>,
    slew: Option<T>,
}

impl<T: Number> Pilot<T> for Held<T> {
    #[inline(always)]
    fn command(&mut self, _flight: &mut Flight<T>) -> (WheelTorques<T>, Option<T>) {
        (self.command, self.slew)
    }

    #[inline(always)]
    fn flown(&mut self, _flight: &mut Flight<T>) -> bool {
        true
    }
}

/// [`Flight::fly`] where the instructions are chosen.
pub(crate) struct Fly<'a, T: Number, P> {
    pub(crate) flight: &'a mut Flight<T>,
    pub(crate) samples: usize,
    pub(crate) pilot: &'a mut P,
}

variants!(fly);

impl<T: Vector, P: Pilot<T>> Work for Fly<'_, T, P> {
    type Output = ();
    type Variants = fly::Here;

    #[inline(always)]
    fn run(self) {
        self.flight.fly(self.samples, self.pilot);
    }
}

impl Flight<f64> {
    /// At t = 0; `noise` feeds the sensors.
    ///
    /// # Errors
    /// Parameters that no arm has.
    pub fn new(plan: Plan, noise: Stream) -> Result<Self, ConfigError> {
        let body = Body::new(&plan.scenario, &plan.payload)?;
        let index = plan.timeline.index(0.0);
        let clock = Clock::new(&plan.timeline, index, 0.0);
        let motion = body.start(&plan.scenario, &clock.extension);
        let outputs = motion.outputs();
        let lines = (!plan.is_plain()).then(|| {
            let sensors = plan.scenario.sensors;
            Box::new(Lines::new(
                plan.delays,
                outputs.measurable(),
                sensors,
                noise,
            ))
        });
        let mut flight = Self {
            base: Arc::new(Scenario::default()),
            shared: Shared::new(&plan),
            fixed: Fixed::new(&plan),
            body,
            clock,
            common: Common {
                sample: 0.0,
                root: WheelState::rest(),
                tip: WheelState::rest(),
                memory: LawMemory::fresh(),
                metrics: Accumulator::new(plan.direction() * outputs.slew[0], outputs.tip[0]),
                torques: [0.0; 3],
            },
            motion,
            measured: None,
            effort: 0.0,
            resting: 0,
            plain: true,
            ideal: true,
            still: false,
            manoeuvres: vec![Manoeuvre {
                scenario: Kept::Whole(Box::new(plan.scenario)),
                piece: index as u32,
                ideal_wheels: plan.has_ideal_wheels(),
                timeline: plan.timeline,
                lines,
            }],
        };
        flight.take_stock();
        if !flight.plain {
            flight.sense();
        }
        Ok(flight)
    }

    /// The manoeuvre.
    pub fn scenario(&self) -> Scenario {
        self.scenario_of(0)
    }

    /// Reference and extension.
    pub fn timeline(&self) -> &Timeline {
        self.timeline_of(0)
    }

    /// Open-loop torque of the slew motor now, N m.
    pub fn slew_torque(&self) -> f64 {
        let Reference { rate, accel, .. } = self.clock.reference;
        self.fixed
            .inertia
            .slew_torque(&self.clock.extension, rate, accel)
    }

    /// Electrical power of the slew motor, W, at a slew torque (N m) now.
    pub fn motor_power(&self, slew_torque: f64) -> f64 {
        let Reference { rate, accel, .. } = self.clock.reference;
        self.fixed.current.power(slew_torque, rate, accel)
    }

    /// End of the slew profile, s.
    pub fn slew_end(&self) -> f64 {
        self.fixed.slew_end_time
    }

    /// The state, for a snapshot.
    pub fn state(&self) -> FlightState {
        FlightState {
            common: self.common,
            motion: self.motion.clone(),
            measured: self.measured(),
            lines: self.manoeuvres[0].lines.clone(),
        }
    }

    /// Replaces the state by one taken from a flight of the same plan; only a flight that is over may be
    /// beyond the limits of [`crate::validity`].
    ///
    /// # Errors
    /// A state of another plant, with other delays, or with numbers that no flight has; nothing has
    /// changed then.
    pub fn set_state(&mut self, state: FlightState, over: bool) -> Result<(), SnapshotError> {
        let damaged = |what: &str| Err(SnapshotError::Damaged(what.into()));
        let fits = match (&state.lines, self.plain) {
            (None, plain) => plain,
            (Some(lines), _) => {
                let own = self.manoeuvres[0].lines.as_ref();
                own.is_some_and(|own| lines.fits(own))
            }
        };
        if !fits {
            return damaged("it holds delay lines of another length");
        }
        let sample = state.common.sample;
        if !(0.0..=9.0e15).contains(&sample) || sample.fract() != 0.0 {
            return damaged("its sample is not a whole number");
        }
        let time = sample * self.shared.sample_period;
        let piece = self.timeline().index(time);
        let clock = Clock::new(self.timeline(), piece, time);
        let mut next = Self {
            clock,
            common: state.common,
            motion: state.motion,
            measured: (!self.plain).then(|| Box::new(state.measured)),
            ..self.clone()
        };
        next.manoeuvres[0].piece = piece as u32;
        next.manoeuvres[0].lines = state.lines;
        next.look_at_pieces();
        let void = next.void() != 0;
        if void && !over {
            return damaged("it holds a flight that is over");
        }
        if !next.body.owns(&next.motion, &clock.extension, !void) {
            return damaged("it holds the state of another plant");
        }
        if !next.is_plausible(void) {
            return damaged("it holds numbers that no flight has");
        }
        *self = next;
        Ok(())
    }

    /// Whether a flight can have left these numbers in wheels, laws, metrics and lines; what follows the
    /// motion need not be finite where that is `void`.
    fn is_plausible(&self, void: bool) -> bool {
        let Common {
            sample,
            root,
            tip,
            memory,
            metrics,
            torques,
        } = &self.common;
        let finite = |values: &[f64]| values.iter().all(|value| value.is_finite());
        // a lag's torque is rounded on the way to its command
        let within = |values: &[f64], wheel: &WheelLimits<f64>| {
            let limit = wheel.torque * (1.0 + 1e-9);
            values.iter().all(|value| value.abs() <= limit)
        };
        let LawMemory {
            slew_error_rate,
            link2_deflection_rate,
            started,
        } = *memory;
        let lines = &self.manoeuvres[0].lines;
        let [to_root, to_tip, seen] = lines
            .as_ref()
            .map_or_else(Default::default, |lines| lines.numbers());
        let following = [
            &[slew_error_rate, link2_deflection_rate][..],
            &self.measured(),
            &seen,
        ];
        within(&[root.torque], &self.fixed.root)
            && within(&to_root, &self.fixed.root)
            && within(&[tip.torque], &self.fixed.tip)
            && within(&to_tip, &self.fixed.tip)
            && finite(&[root.applied, root.momentum, tip.applied, tip.momentum])
            && finite(torques)
            && [0.0, 1.0].contains(&started)
            && metrics.fits(*sample)
            && (void || following.into_iter().all(finite))
    }

    /// Puts a flight without lines at the beginning of a sample, with this deviation from the
    /// reference.
    pub(crate) fn place(&mut self, sample: f64, deviation: &[f64]) {
        let time = sample * self.shared.sample_period;
        let piece = self.timeline().index(time);
        self.clock = Clock::new(self.timeline(), piece, time);
        self.manoeuvres[0].piece = piece as u32;
        self.look_at_pieces();
        self.common.sample = sample;
        self.motion = self.motion_at(deviation);
    }

    /// Equations of motion.
    pub(crate) fn body(&self) -> &Body<f64> {
        &self.body
    }

    /// State of the equations of motion.
    pub(crate) fn motion(&self) -> &Motion<f64> {
        &self.motion
    }

    /// Time, s.
    pub fn time(&self) -> f64 {
        self.clock.time
    }

    /// Slew angle (rad) and half the deflections of the links' ends (m): theta, alpha, beta.
    pub fn position(&self) -> [f64; 3] {
        let Outputs {
            slew, alpha, beta, ..
        } = self.outputs();
        [slew[0], alpha[0], beta[0]]
    }

    /// Rates of theta, alpha, beta.
    pub fn velocity(&self) -> [f64; 3] {
        let Outputs {
            slew, alpha, beta, ..
        } = self.outputs();
        [slew[1], alpha[1], beta[1]]
    }

    /// Slew reference now.
    pub fn reference(&self) -> Reference<f64> {
        self.clock.reference
    }

    /// Extension now.
    pub fn extension(&self) -> Extension<f64> {
        self.clock.extension
    }

    /// Deflection of the arm's tip from the rotating axis, m, and its rate, m/s; in the thesis plant
    /// 2 (alpha + beta).
    pub fn tip_deflection(&self) -> (f64, f64) {
        self.outputs().tip.into()
    }

    /// Torques at the beginning of the last sample, N m: slew motor, root wheel, tip wheel.
    pub fn last_torques(&self) -> [f64; 3] {
        self.common.torques
    }

    /// Stored momentum of root and tip wheel, N m s.
    pub fn wheel_momentum(&self) -> [f64; 2] {
        [self.common.root.momentum, self.common.tip.momentum]
    }

    /// Whether every coordinate and rate is finite.
    pub fn is_finite(&self) -> bool {
        self.outputs().not_finite() == 0.0
    }

    /// Kinetic and potential energy now, J.
    pub fn energy(&self) -> Energy {
        let scenario = self.scenario();
        let Ok(payload) = scenario.true_payload() else {
            // it has been flown with one
            return Energy {
                kinetic: f64::NAN,
                potential: f64::NAN,
            };
        };
        let extension = &self.clock.extension;
        self.body
            .energy(&self.motion, extension, &scenario, &payload)
    }

    /// Metrics of the flight so far; see [`Metrics`] for those of one that has left the limits of
    /// [`crate::validity`].
    pub fn metrics(&self, diverged: bool, episode_return: f64) -> Metrics {
        self.metrics_with(self.energy().total(), diverged, episode_return)
    }

    /// [`Flight::metrics`] with NaN for the energy, which costs as much as a control period.
    pub(crate) fn metrics_under_way(&self, diverged: bool, episode_return: f64) -> Metrics {
        self.metrics_with(f64::NAN, diverged, episode_return)
    }

    fn metrics_with(&self, energy: f64, diverged: bool, episode_return: f64) -> Metrics {
        let found = self.common.metrics.metrics(
            self.shared.sample_period,
            self.slew_end(),
            self.scenario().slew.angle.abs(),
            energy,
            diverged,
            episode_return,
        );
        if self.void() == 0 {
            found
        } else {
            found.of_void()
        }
    }

    /// Flies one sample period under held wheel commands (N m, before saturation); `slew` replaces
    /// the open-loop torque of the slew motor (N m).
    pub fn advance(&mut self, command: &WheelTorques<f64>, slew: Option<f64>) {
        f64::enter(Fly {
            flight: self,
            samples: 1,
            pilot: &mut Held {
                command: *command,
                slew,
            },
        });
    }
}
