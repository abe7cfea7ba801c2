//! A servo for the flexible arm: the angle of the arm as a whole is brought home in nearly the least time that
//! the wheels allow, and the vibration is damped mode by mode.
//!
//! Three parts, all driven by what is measured at the shoulder (angle and rate) and by the wheels' momentum:
//!
//! **Whole arm.** The torques at the shoulder make its angular momentum, whatever it does in between:
//! H = J_r w_ref - h, of the open-loop motor for the reported inertia J_r and of the wheels' stored momentum h.
//! The arm as a whole turns at w = H / J. A Kalman filter with two states follows the error of its angle,
//! e' = w - w_ref, and the true payload's mass, which is in J; it is corrected by the measured angle less
//! what the arm is bent by its acceleration. So neither vibration nor the tangent at the shoulder, which turns with
//! every mode, is taken for the arm.
//!
//! **Servo.** A proximate time-optimal servomechanism (Workman, Kosut and Franklin 1987): the wanted rate of the
//! error is that of a parabola on which a part of the wheels' torque stops the arm, and near its end
//! proportional to the error; the known lack of motor torque is added.
//!
//! **Modes.** An observer for each of the lowest modes, with the model's frequency at the present length and
//! identified mass, driven by the known torques and corrected by the measured rate less w; the root wheel feeds the
//! modes' rates back. Since the observers are narrow, the modes that they leave out hardly see the wheel.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Measurement, finite_gain};
use crate::check::{non_negative, positive};
use crate::error::ConfigError;
use crate::hardware::reaction_wheel::WheelTorques;
use crate::simd::functions::{cos_sin, exp};
use crate::simd::{Lane, laned};

/// Modes that are observed.
pub const MODES: usize = 3;
/// Largest error of the reported mass that the servo believes, as a part of it.
pub const LARGEST_MASS_ERROR: f64 = 0.25;
/// Nodes over the lengths and over the masses, and functions of the model.
pub const LENGTHS: usize = 8;
/// See [`LENGTHS`].
pub const MASSES: usize = 4;
const FUNCTIONS: usize = 3 * MODES + 2;

/// The servo with modal damping.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ServoLaw {
    /// Rate at which a small error decays, 1/s.
    pub bandwidth: f64,
    /// Rate at which the wanted rate is followed, 1/s.
    pub rate_bandwidth: f64,
    /// Part of the wheels' torque that the parabola counts on.
    pub torque_share: f64,
    /// Damping ratio that the root wheel adds to each of the three lowest modes.
    pub damping: [f64; MODES],
    /// Root wheel's torque that damping may take from the slew, N m; it may take all that the slew leaves.
    pub damping_torque: f64,
    /// Rate at which the observer of each mode forgets, as a part of its angular frequency.
    pub observer_ratio: [f64; MODES],
    /// Standard deviation of the slew angle as the filter believes it, rad: of noise and what vibration is left.
    pub angle_deviation: f64,
    /// What the whole arm's angle may drift as the filter believes it, rad/s^(1/2).
    pub angle_drift: f64,
    /// Standard deviation of the reported mass as the filter believes it, as a part of it.
    pub mass_deviation: f64,
    /// What the mass may drift as the filter believes it, as a part of it, 1/s^(1/2): the dimensions of a payload are
    /// reported wrong with its mass, and what that makes of its inertia depends on the length.
    pub mass_drift: f64,
    /// Bending stiffness of the links as the law believes it, N m^2.
    pub bending_stiffness: [f64; 2],
    /// Damping ratio of the modes as the law believes it.
    pub damping_ratio: f64,
    /// Delay of the measurements as the law believes it, s: up to half a sample none, else one sample.
    pub delay: f64,
    /// Part of the wheels' torque that a plan counts on, by which the arm leans out before the wheels run out of
    /// torque; null is none. The plan takes the place of the servomechanism, and has to know the manoeuvre ahead.
    pub lean: Option<f64>,
}

impl Default for ServoLaw {
    fn default() -> Self {
        let arm = crate::arm::Arm::default();
        Self {
            bandwidth: 2.0,
            rate_bandwidth: 3.0,
            torque_share: 0.9,
            // stable with the stiffness wrong by a tenth either way (`drm stability --stiffness 0.9`)
            damping: [0.1, 0.01, 0.001],
            damping_torque: 40.0,
            observer_ratio: [0.1, 0.15, 0.15],
            angle_deviation: 3e-3,
            angle_drift: 1e-4,
            mass_deviation: 0.09,
            mass_drift: 3e-3,
            bending_stiffness: [arm.link1.bending_stiffness, arm.link2.bending_stiffness],
            damping_ratio: 0.005,
            delay: 0.002,
            lean: None,
        }
    }
}

impl ServoLaw {
    pub(super) fn validate(&self) -> Result<(), ConfigError> {
        positive("bandwidth", self.bandwidth)?;
        positive("rate_bandwidth", self.rate_bandwidth)?;
        positive("torque_share", self.torque_share)?;
        for (i, gain) in self.damping.iter().enumerate() {
            finite_gain(&format!("damping[{i}]"), *gain)?;
        }
        non_negative("damping_torque", self.damping_torque)?;
        for (i, ratio) in self.observer_ratio.iter().enumerate() {
            non_negative(&format!("observer_ratio[{i}]"), *ratio)?;
        }
        positive("angle_deviation", self.angle_deviation)?;
        non_negative("angle_drift", self.angle_drift)?;
        non_negative("mass_deviation", self.mass_deviation)?;
        non_negative("mass_drift", self.mass_drift)?;
        for (i, stiffness) in self.bending_stiffness.iter().enumerate() {
            positive(&format!("bending_stiffness[{i}]"), *stiffness)?;
        }
        non_negative("damping_ratio", self.damping_ratio)?;
        non_negative("delay", self.delay)?;
        match self.lean {
            Some(share) if !(share > 0.0 && share <= 1.0) => Err(ConfigError::value(
                "lean",
                "must be above 0 and at most 1",
                share,
            )),
            _ => Ok(()),
        }
    }
}

/// A mode at one length and mass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mode {
    /// Angular frequency, rad/s.
    pub frequency: f64,
    /// Turn of the shoulder's tangent and of the tip in a mode of unit modal mass, rad.
    pub root: f64,
    /// See `root`.
    pub tip: f64,
}

/// What the servo's model is at one length and mass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Node {
    /// The lowest modes; frequency and turns are zero where there are none.
    pub modes: [Mode; MODES],
    /// Turn of the shoulder's tangent against the arm as a whole per angular acceleration, s^2.
    pub tilt: f64,
    /// Way of the tip from the arm as a whole per angular acceleration, m s^2.
    pub tip: f64,
}

/// The arm as the servo knows it, with the reported payload: functions of the length and of the payload's mass,
/// as products of Chebyshev polynomials.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ServoModel<T> {
    coefficients: [[[T; MASSES]; LENGTHS]; FUNCTIONS],
    /// Middle of the lengths, m, and 1 over half their range.
    middle: T,
    per_half: T,
    /// Moment of inertia of the arm alone and of the reported payload, polynomials of the extension.
    arm: [T; 3],
    payload: [T; 3],
    /// Length of link 1, m.
    link1: T,
    /// Torque limits of root and tip wheel, N m.
    limits: [T; 2],
}

laned!(ServoModel {
    coefficients,
    middle,
    per_half,
    arm,
    payload,
    link1,
    limits,
});

/// Chebyshev nodes of the first kind, from 1 down to -1.
fn nodes<const N: usize>() -> [f64; N] {
    std::array::from_fn(|i| libm::cos(std::f64::consts::PI * (i as f64 + 0.5) / N as f64))
}

/// Values of the Chebyshev polynomials.
#[inline(always)]
fn chebyshev<T: Lane, const N: usize>(x: T) -> [T; N] {
    let mut values = [T::splat(0.0); N];
    let (mut before, mut now) = (x, T::splat(1.0));
    for value in &mut values {
        *value = now;
        (before, now) = (now, (x + x).mul_add(now, -before));
    }
    values
}

impl ServoModel<f64> {
    /// From the shortest to the longest extension (m); `node` is the model at an extension and at a part of the
    /// reported mass.
    ///
    /// # Errors
    /// Those of `node`.
    pub fn new(
        (low, high): (f64, f64),
        link1: f64,
        (arm, payload): ([f64; 3], [f64; 3]),
        limits: [f64; 2],
        mut node: impl FnMut(f64, f64) -> Result<Node, ConfigError>,
    ) -> Result<Self, ConfigError> {
        let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0);
        let mut coefficients = [[[0.0; MASSES]; LENGTHS]; FUNCTIONS];
        for y in nodes::<MASSES>() {
            for x in nodes::<LENGTHS>() {
                let found = node(middle + half * x, 1.0 + LARGEST_MASS_ERROR * y)?;
                let mut values = [0.0; FUNCTIONS];
                for (mode, values) in found.modes.iter().zip(values.chunks_exact_mut(3)) {
                    values.copy_from_slice(&[mode.frequency, mode.root, mode.tip]);
                }
                values[FUNCTIONS - 2..].copy_from_slice(&[found.tilt, found.tip]);
                let (over_length, over_mass) =
                    (chebyshev::<f64, LENGTHS>(x), chebyshev::<f64, MASSES>(y));
                for (function, value) in coefficients.iter_mut().zip(values) {
                    for i in 0..LENGTHS {
                        for k in 0..MASSES {
                            let twice = |order: usize| if order == 0 { 1.0 } else { 2.0 };
                            let weight = twice(i) * twice(k) / (LENGTHS * MASSES) as f64;
                            function[i][k] += weight * value * over_length[i] * over_mass[k];
                        }
                    }
                }
            }
        }
        Ok(Self {
            coefficients,
            middle,
            per_half: 1.0 / half,
            arm,
            payload,
            link1,
            limits,
        })
    }
}

impl ServoModel<f64> {
    /// The model at an extension (m) and an error of the reported mass, as a part of it.
    pub fn node(&self, extension: f64, mass_error: f64) -> Node {
        let found: [f64; FUNCTIONS] = self.functions(0, extension, mass_error);
        Node {
            modes: std::array::from_fn(|k| Mode {
                frequency: found[3 * k],
                root: found[3 * k + 1],
                tip: found[3 * k + 2],
            }),
            tilt: found[FUNCTIONS - 2],
            tip: found[FUNCTIONS - 1],
        }
    }
}

impl ServoModel<f64> {
    /// Torque of both wheels, N m.
    pub(super) fn torque_limit(&self) -> f64 {
        let [root, tip] = self.limits;
        root + tip
    }

    /// Distance of the tip from the shoulder at an extension (m), m.
    pub(super) fn reach(&self, extension: f64) -> f64 {
        self.link1 + extension
    }

    /// Moment of inertia at an extension (m) and an error of the reported mass, kg m^2.
    pub(super) fn inertia(&self, extension: f64, mass_error: f64) -> f64 {
        let payload = extension.polynomial(&self.payload);
        payload.mul_add(mass_error, payload + extension.polynomial(&self.arm))
    }

    /// Torque that lacks per error of the reported mass, N m, as the servo adds it: at an extension (m) and its rate, a
    /// rate of the slew and its acceleration.
    pub(super) fn lack(&self, [length, extending]: [f64; 2], [rate, accel]: [f64; 2]) -> f64 {
        let slope = (self.payload[2] * 2.0).mul_add(length, self.payload[1]);
        length.polynomial(&self.payload) * accel + slope * extending * rate
    }
}

impl<T: Lane> ServoModel<T> {
    /// Way of the tip from where the shoulder's tangent points, per angular acceleration of the arm as a whole
    /// (m s^2), of the arm that only bends and does not vibrate.
    #[inline(always)]
    pub(crate) fn still_deflection(&self, extension: T, mass_error: T) -> T {
        let limit = T::splat(LARGEST_MASS_ERROR);
        let mass_error = mass_error.limited(-limit, limit);
        let [tilt, tip] = self.functions(FUNCTIONS - 2, extension, mass_error);
        tip - (self.link1 + extension) * tilt
    }

    /// The model's functions from the `first` on.
    #[inline(always)]
    fn functions<const N: usize>(&self, first: usize, extension: T, mass_error: T) -> [T; N] {
        let over_length = chebyshev::<T, LENGTHS>((extension - self.middle) * self.per_half);
        let over_mass = chebyshev::<T, MASSES>(mass_error * (1.0 / LARGEST_MASS_ERROR));
        let mut found = [T::splat(0.0); N];
        for (value, function) in found.iter_mut().zip(&self.coefficients[first..]) {
            for i in 0..LENGTHS {
                let mut sum = T::splat(0.0);
                for k in 0..MASSES {
                    sum = function[i][k].mul_add(over_mass[k], sum);
                }
                *value = sum.mul_add(over_length[i], *value);
            }
        }
        found
    }
}

/// What the servo remembers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ServoMemory<T> {
    /// Error of the whole arm's angle, rad.
    error: T,
    /// True mass over the reported one, less 1.
    mass: T,
    /// Covariance of the two: of the error, of both, of the mass.
    covariance: [T; 3],
    /// Modal coordinates and rates.
    modes: [[T; 2]; MODES],
    /// Rate of the tangent against the whole arm that the modes make, rad/s, at the last sample.
    rate: T,
    /// Momentum of both wheels at the last sample, N m s.
    momentum: [T; 2],
    /// Torque of both wheels by the last plan, N m, where the servo plans.
    planned: T,
}

/// Numbers of a [`ServoMemory`].
pub const SERVO_MEMORY: usize = 9 + 2 * MODES;

laned!(ServoMemory {
    error,
    mass,
    covariance,
    modes,
    rate,
    momentum,
    planned,
});

impl<T: Lane> ServoMemory<T> {
    /// Before the first sample.
    pub fn fresh() -> Self {
        let zero = T::splat(0.0);
        Self {
            error: zero,
            mass: zero,
            covariance: [zero; 3],
            modes: [[zero; 2]; MODES],
            rate: zero,
            momentum: [zero; 2],
            planned: zero,
        }
    }
}

impl ServoMemory<f64> {
    /// As a row of numbers.
    pub fn numbers(&self) -> [f64; SERVO_MEMORY] {
        let mut row = [0.0; SERVO_MEMORY];
        let [[a, b], [c, d], [e, f]] = self.modes;
        let [p, q, r] = self.covariance;
        let [root, tip] = self.momentum;
        row.copy_from_slice(&[
            self.error,
            self.mass,
            p,
            q,
            r,
            a,
            b,
            c,
            d,
            e,
            f,
            self.rate,
            root,
            tip,
            self.planned,
        ]);
        row
    }

    /// What is still true where another payload is held: nothing is known of its mass.
    pub(super) fn with_other_payload(self) -> Self {
        Self {
            mass: 0.0,
            covariance: [0.0; 3],
            ..self
        }
    }

    /// The same knowledge told from another reported mass: `part` is the one before over it.
    pub(super) fn with_report(self, part: f64) -> Self {
        let [error, both, mass] = self.covariance;
        Self {
            mass: (1.0 + self.mass).mul_add(part, -1.0),
            covariance: [error, both * part, mass * part * part],
            ..self
        }
    }

    /// From a row of numbers.
    pub fn from_numbers(row: &[f64; SERVO_MEMORY]) -> Self {
        let &[
            error,
            mass,
            p,
            q,
            r,
            a,
            b,
            c,
            d,
            e,
            f,
            rate,
            root,
            tip,
            planned,
        ] = row;
        Self {
            error,
            mass,
            covariance: [p, q, r],
            modes: [[a, b], [c, d], [e, f]],
            rate,
            momentum: [root, tip],
            planned,
        }
    }

    /// Error of the reported mass, as far as it is known, and error of the tip as an angle (rad) with its rate (rad/s).
    pub(crate) fn state(
        &self,
        measured: &Measurement<f64>,
        model: &ServoModel<f64>,
    ) -> (f64, [f64; 2]) {
        let (a, rate) = (measured.extension, measured.reference_rate);
        let wheels = measured.root_momentum + measured.tip_momentum;
        let momentum = model.inertia(a, 0.0) * rate - wheels;
        let [_, tip_way] = model.functions(FUNCTIONS - 2, a, self.mass);
        let still = tip_way * measured.reference_accel / model.reach(a);
        let error_rate = momentum / model.inertia(a, self.mass) - rate;
        (self.mass, [self.error + still, error_rate])
    }

    /// Takes a new plan's torque, N m.
    pub(crate) fn plan(&mut self, torque: f64) {
        self.planned = torque;
    }
}

/// Variance of the error of the angle at the start, rad^2.
const START_VARIANCE: f64 = 1e-10;
/// Smallest argument of the parabola's root, rad^2/s^2.
const SMALLEST_SQUARE: f64 = 1e-12;

/// `a` where `condition` is 1, `b` where it is 0.
#[inline(always)]
fn choose<T: Lane>(condition: T, a: T, b: T) -> T {
    a.where_set(condition, b)
}

impl ServoLaw {
    /// Wheel torques of one sample, `period` seconds after the last; `started` is 0 at the first sample, 1
    /// afterwards.
    #[inline(always)]
    pub(super) fn torques<T: Lane>(
        &self,
        measured: &Measurement<T>,
        model: &ServoModel<T>,
        memory: &mut ServoMemory<T>,
        started: T,
        period: f64,
    ) -> WheelTorques<T> {
        let (zero, one) = (T::splat(0.0), T::splat(1.0));
        let h = T::splat(period) * started;
        let a = measured.extension;
        let (rate, accel) = (measured.reference_rate, measured.reference_accel);
        let wheels = measured.root_momentum + measured.tip_momentum;
        let arm = a.polynomial(&model.arm);
        let payload = a.polynomial(&model.payload);
        let slope = |c: &[T; 3]| (c[2] * 2.0).mul_add(a, c[1]);
        let payload_slope = slope(&model.payload);
        let reported = arm + payload;
        let momentum = reported * rate - wheels;

        // the model at the mass believed so far
        let found: [T; FUNCTIONS] = model.functions(0, a, memory.mass);
        let (tilt, tip_way) = (found[FUNCTIONS - 2], found[FUNCTIONS - 1]);

        // the whole arm: prediction and correction
        let believed = payload.mul_add(memory.mass, reported);
        let whole = momentum / believed;
        let [p, q, r] = memory.covariance;
        let p = choose(started, p, T::splat(START_VARIANCE));
        let q = q * started;
        let r = choose(
            started,
            r,
            T::splat(self.mass_deviation * self.mass_deviation),
        );
        let r = h.mul_add(T::splat(self.mass_drift * self.mass_drift), r);
        let error = (whole - rate).mul_add(h, memory.error);
        let of_mass = -(whole * payload / believed * h);
        let drift = h * (self.angle_drift * self.angle_drift);
        let p = (of_mass * of_mass).mul_add(r, (of_mass + of_mass).mul_add(q, p + drift));
        let q = of_mass.mul_add(r, q);
        let bent = tilt * accel * reported / believed;
        let surprise = measured.slew_error - bent - error;
        let per_variance = (p + self.angle_deviation * self.angle_deviation).recip();
        let (gain, mass_gain) = (p * per_variance, q * per_variance);
        let error = gain.mul_add(surprise, error);
        let limit = T::splat(LARGEST_MASS_ERROR);
        let mass = mass_gain
            .mul_add(surprise, memory.mass)
            .limited(-limit, limit);
        memory.covariance = [p - gain * p, q - gain * q, r - mass_gain * q];
        (memory.error, memory.mass) = (error, mass);

        // the servo on the tip's error taken as an angle
        let inertia = payload.mul_add(mass, reported);
        let whole = momentum / inertia;
        let reach = model.link1 + a;
        let error = (tip_way * accel / reach) + error;
        let error_rate = whole - rate;
        let [root_limit, tip_limit] = model.limits;
        let most = (root_limit + tip_limit) * self.torque_share / inertia;
        let size = error.abs();
        let sign = one - error.below(zero) * 2.0;
        let linear = most * (1.0 / (self.bandwidth * self.bandwidth));
        let square = (most + most) * (size - linear * 0.5);
        let parabola = square.max(T::splat(SMALLEST_SQUARE)).sqrt();
        let near = size.below(linear);
        let wanted = choose(near, error * -self.bandwidth, -(sign * parabola));
        let wanted_rate = choose(
            near,
            error_rate * -self.bandwidth,
            -(error_rate * most / parabola),
        );
        let follow = (wanted - error_rate).mul_add(T::splat(self.rate_bandwidth), wanted_rate);
        let lack = (payload * accel + payload_slope * measured.extension_rate * rate) * mass;
        let moving = if self.lean.is_some() {
            memory.planned
        } else {
            inertia.mul_add(follow, lack)
        };

        // the modes: forward by the torques that have worked, then corrected
        let seen = measured.slew_error_rate + rate - whole;
        let given = [measured.root_momentum, measured.tip_momentum];
        let per_sample = T::splat(-1.0 / period) * started;
        let root_torque = (given[0] - memory.momentum[0]) * per_sample;
        let tip_torque = (given[1] - memory.momentum[1]) * per_sample;
        memory.momentum = given;
        let at_root = measured.slew_torque * started + root_torque;
        let late = self.delay > 0.5 * period;
        let mut states = memory.modes;
        let mut present = zero;
        for (k, state) in states.iter_mut().enumerate() {
            let [frequency, root, tip] = [found[3 * k], found[3 * k + 1], found[3 * k + 2]];
            let exists = zero.below(frequency);
            let frequency = choose(exists, frequency, one);
            let angle = frequency * h;
            let (cos, sin) = cos_sin(angle);
            let decay = exp(angle * -self.damping_ratio);
            let rest = root.mul_add(at_root, tip * tip_torque) / (frequency * frequency);
            let [position, speed] = *state;
            let out = position - rest;
            *state = [
                decay.mul_add(out * cos + speed / frequency * sin, rest) * exists,
                decay * (speed * cos - out * frequency * sin) * exists,
            ];
            present = root.mul_add(state[1], present);
        }
        let surprise = seen - if late { memory.rate } else { present };
        let mut damping = zero;
        let mut present = zero;
        for (k, state) in states.iter_mut().enumerate() {
            let [frequency, root] = [found[3 * k], found[3 * k + 1]];
            let exists = zero.below(root.abs());
            let per_root = choose(exists, root, one).recip() * exists;
            let gain = h * frequency * (2.0 * self.observer_ratio[k]);
            state[1] = (gain * per_root).mul_add(surprise, state[1]);
            present = root.mul_add(state[1], present);
            let wanted = frequency * per_root * (-2.0 * self.damping[k]);
            damping = wanted.mul_add(state[1], damping);
        }
        memory.modes = states;
        memory.rate = present;

        // what the slew leaves, and never less than its own
        let left = (root_limit - moving.abs()).max(T::splat(self.damping_torque));
        let most = left.min(root_limit);
        let damping = damping.limited(-most, most);
        let room = root_limit - damping.abs();
        let of_root = moving.limited(-room, room);
        WheelTorques {
            root: of_root + damping,
            tip: (moving - of_root).limited(-tip_limit, tip_limit),
        }
    }
}
