//! Implicit steps of the consistent plant, one environment or several side by side.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::ConsistentPlant;
use super::arm_tables::{ConsistentArm, PACKED, Slots};
use super::displacement::CAPACITY;
use super::modal_damping::{ModalDamping, place};
use super::terms::{Payload, Spin, Stiffness, Terms, Turned, Weights};
use crate::hardware::slew_motor::DriveShaft;
use crate::math::generalized_alpha::{Equations, GeneralizedAlpha, Jump, Motion, factorize, solve};
use crate::plant::Torques;
use crate::reference::Extension;
use crate::reference::timeline::Piece;
#[cfg(target_arch = "x86_64")]
use crate::simd::Instructions;
use crate::simd::{Lane, WIDEST};

/// What the plant was driven by at the end of its last step; all zero before the first.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Drive<T> {
    /// 1 after the first step, 0 before.
    started: T,
    slew: T,
    root: T,
    tip: T,
    extension_accel: T,
}

/// State of the consistent plant: coordinates (theta, link 1, link 2), rad and m, their rates, and
/// what the integrator remembers. Entries beyond the plant's size are zero.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ConsistentState<T = f64> {
    /// Coordinates.
    pub q: [T; CAPACITY],
    /// Rates, per second.
    pub v: [T; CAPACITY],
    /// The integrator's acceleration, per second squared.
    a: [T; CAPACITY],
    drive: Drive<T>,
}

impl<T: Lane> ConsistentState<T> {
    /// Lets the integrator begin anew, where what holds the shoulder changes at once.
    pub(crate) fn restart(&mut self) {
        *self = Self::new(self.q, self.v);
    }

    /// At the beginning of a flight.
    pub fn new(q: [T; CAPACITY], v: [T; CAPACITY]) -> Self {
        let zero = T::splat(0.0);
        Self {
            q,
            v,
            a: [zero; CAPACITY],
            drive: Drive {
                started: zero,
                slew: zero,
                root: zero,
                tip: zero,
                extension_accel: zero,
            },
        }
    }

    /// Every number of the state.
    #[inline(always)]
    fn numbers(&self) -> impl Iterator<Item = &T> {
        let Drive {
            started,
            slew,
            root,
            tip,
            extension_accel,
        } = &self.drive;
        let drive = [started, slew, root, tip, extension_accel];
        [&self.q, &self.v, &self.a]
            .into_iter()
            .flatten()
            .chain(drive)
    }

    #[inline(always)]
    fn numbers_mut(&mut self) -> impl Iterator<Item = &mut T> {
        let Drive {
            started,
            slew,
            root,
            tip,
            extension_accel,
        } = &mut self.drive;
        let drive = [started, slew, root, tip, extension_accel];
        [&mut self.q, &mut self.v, &mut self.a]
            .into_iter()
            .flatten()
            .chain(drive)
    }

    /// State of lane `index` alone.
    pub fn lane(&self, index: usize) -> ConsistentState<f64> {
        let mut one = ConsistentState::new([0.0; CAPACITY], [0.0; CAPACITY]);
        for (one, all) in one.numbers_mut().zip(self.numbers()) {
            *one = all.lane(index);
        }
        one
    }

    /// Replaces the state of lane `index`.
    pub fn set_lane(&mut self, index: usize, state: &ConsistentState<f64>) {
        for (all, one) in self.numbers_mut().zip(state.numbers()) {
            all.set_lane(index, *one);
        }
    }
}

impl ConsistentState<f64> {
    /// Whether every coordinate, rate and acceleration is finite.
    pub fn is_finite(&self) -> bool {
        [&self.q, &self.v, &self.a]
            .into_iter()
            .flatten()
            .all(|x| x.is_finite())
    }

    /// Whether it can be the state of a plant of so many coordinates that flies on.
    pub(crate) fn fits(&self, size: usize) -> bool {
        let beyond = |list: &[f64; CAPACITY]| list[size..].iter().all(|x| *x == 0.0);
        [&self.q, &self.v, &self.a].into_iter().all(beyond)
            && [0.0, 1.0].contains(&self.drive.started)
            && self.numbers().all(|x| x.is_finite())
    }
}

/// What is seen of a state, each a value and its rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConsistentOutputs<T> {
    /// Slew angle, rad.
    pub slew: [T; 2],
    /// Deflection of link 1's end, m.
    pub link1: [T; 2],
    /// Deflection of link 2's tip from the tangent at link 1's end, m.
    pub link2: [T; 2],
    /// Deflection of the arm's tip from the rotating axis, m.
    pub tip: [T; 2],
}

/// Equations of motion of several environments side by side: one arm, and a payload a lane.
#[derive(Debug, Clone, PartialEq)]
pub struct ConsistentLanes<T> {
    pub(super) arm: Arc<ConsistentArm>,
    pub(super) payload: Payload<T>,
    /// Damping by a ratio, a lane an entry; empty where no lane has it.
    pub(super) modal: Vec<Option<Arc<ModalDamping>>>,
    /// The drive shaft: in every lane, or in none.
    pub(super) shaft: Option<DriveShaft<T>>,
}

impl<T: Lane> ConsistentLanes<T> {
    /// The same plant in every lane.
    pub fn new(plant: &ConsistentPlant) -> Self {
        let Payload {
            mass,
            lever,
            inertia,
            offset,
            stiffness,
            damping,
            whole,
        } = plant.lanes.payload;
        Self {
            arm: plant.lanes.arm.clone(),
            payload: Payload {
                mass: T::splat(mass),
                lever: T::splat(lever),
                inertia: T::splat(inertia),
                offset: T::splat(offset),
                stiffness: stiffness.map(T::splat),
                damping: T::splat(damping),
                whole: T::splat(whole),
            },
            modal: match plant.lanes.modal.first() {
                Some(damping) => vec![damping.clone(); T::WIDTH],
                None => Vec::new(),
            },
            shaft: plant.lanes.shaft.map(|shaft| DriveShaft {
                rotor_inertia: T::splat(shaft.rotor_inertia),
                stiffness: T::splat(shaft.stiffness),
                damping: T::splat(shaft.damping),
            }),
        }
    }

    /// Whether a plant can fly beside the ones here: of the same arm, modes, shapes and axial load, and with a
    /// drive shaft or without like them.
    pub fn fits(&self, plant: &ConsistentPlant) -> bool {
        self.shaft.is_some() == plant.lanes.shaft.is_some()
            && (Arc::ptr_eq(&self.arm, &plant.lanes.arm) || self.arm == plant.lanes.arm)
    }

    /// Puts a plant into lane `index`; one that does not fit ([`ConsistentLanes::fits`]) is refused by
    /// `false`, and nothing has changed then.
    #[must_use]
    pub fn set_lane(&mut self, index: usize, plant: &ConsistentPlant) -> bool {
        if !self.fits(plant) {
            return false;
        }
        let (all, one) = (&mut self.payload, &plant.lanes.payload);
        all.mass.set_lane(index, one.mass);
        all.lever.set_lane(index, one.lever);
        all.inertia.set_lane(index, one.inertia);
        all.offset.set_lane(index, one.offset);
        for (all, one) in all.stiffness.iter_mut().zip(one.stiffness) {
            all.set_lane(index, one);
        }
        all.damping.set_lane(index, one.damping);
        all.whole.set_lane(index, one.whole);
        if let (Some(all), Some(one)) = (&mut self.shaft, &plant.lanes.shaft) {
            all.rotor_inertia.set_lane(index, one.rotor_inertia);
            all.stiffness.set_lane(index, one.stiffness);
            all.damping.set_lane(index, one.damping);
        }
        let damping = plant.lanes.modal.first().cloned().flatten();
        if damping.is_some() && self.modal.is_empty() {
            self.modal = vec![None; T::WIDTH];
        }
        if let Some(place) = self.modal.get_mut(index) {
            *place = damping;
        }
        if self.modal.iter().all(Option::is_none) {
            self.modal.clear();
        }
        true
    }

    /// Number of shapes of link 1 and link 2.
    pub fn modes(&self) -> (usize, usize) {
        self.arm.modes()
    }

    /// What is seen of a state at an extension.
    #[inline(always)]
    pub fn outputs(
        &self,
        state: &ConsistentState<T>,
        extension: &Extension<T>,
    ) -> ConsistentOutputs<T> {
        let (n, m) = self.arm.modes();
        let arm = &*self.arm;
        let (q, v) = (&state.q, &state.v);
        let (q1, v1) = (&q[1..1 + n], &v[1..1 + n]);
        let (q2, v2) = (&q[1 + n..1 + n + m], &v[1 + n..1 + n + m]);
        let link1 = [form(&arm.end[..n], q1), form(&arm.end[..n], v1)];
        let link2 = [form(&arm.tip[..m], q2), form(&arm.tip[..m], v2)];
        let turn = [form(&arm.turn[..n], q1), form(&arm.turn[..n], v1)];
        let a = extension.length;
        let rate = a.mul_add(turn[1], link1[1] + link2[1]);
        ConsistentOutputs {
            slew: [state.q[0], state.v[0]],
            link1,
            link2,
            tip: [
                a.mul_add(turn[0], link1[0] + link2[0]),
                extension.rate.mul_add(turn[0], rate),
            ],
        }
    }

    /// Rate at which the tip turns against the inertial frame, rad/s: what a torque of the tip wheel works on.
    #[inline(always)]
    pub fn tip_turn_rate(&self, state: &ConsistentState<T>, extension: &Extension<T>) -> T {
        let (n, m) = self.arm.modes();
        let arm = &*self.arm;
        let (q, v) = (&state.q, &state.v);
        let slope = [
            form(&arm.tip_slope[..m], &q[1 + n..1 + n + m]),
            form(&arm.tip_slope[..m], &v[1 + n..1 + n + m]),
        ];
        // a slope per unit of link 2's length, which grows
        let shrink = extension.length.recip();
        let own = (extension.rate * shrink).negated_mul_add(slope[0], slope[1]) * shrink;
        v[0] + form(&arm.turn[..n], &v[1..1 + n]) + own
    }

    /// Advances `state` by a step of length `h` (s), under torques at its beginning, middle and end
    /// (N m), where `active` is 1; where it is 0 a lane keeps its state. `extension` is that at the
    /// scheme's balance point, and its acceleration that of the whole step. Torques and extension
    /// acceleration may jump between steps: second order is kept. `held` is the angular acceleration (rad/s^2)
    /// at the beginning and at the balance point of a shoulder that is held, in the motor's stead.
    ///
    /// To be inlined into a function compiled for a processor with fused multiply-add; without, the
    /// bits are the same and the time is not.
    #[inline(always)]
    pub fn step(
        &self,
        scheme: &GeneralizedAlpha,
        state: &mut ConsistentState<T>,
        torques: &[Torques<T>; 3],
        extension: &Extension<T>,
        h: T,
        (active, held): (T, Option<[T; 2]>),
    ) {
        const S2: usize = Slots::new(2).count;
        const S4: usize = Slots::new(4).count;
        const S7: usize = Slots::new(7).count;
        const S8: usize = Slots::new(8).count;
        // the usual numbers of modes on their own, all others by the room that they need
        let modes = self.arm.modes();
        let shaft = self.shaft.as_ref();
        let args = (scheme, torques, extension, h, active, held);
        match (modes, shaft) {
            ((4, 4), None) => self.step_of::<9, S4, 10>((4, 4), state, args, None),
            ((2, 2), None) if T::WIDTH != 2 => {
                self.step_of::<5, S2, 3>((2, 2), state, args, None);
            }
            ((n, m), _) if n + m + usize::from(shaft.is_some()) < 9 => {
                self.step_of::<9, S7, 28>(modes, state, args, shaft);
            }
            _ => self.step_of::<CAPACITY, S8, PACKED>(modes, state, args, shaft),
        }
    }

    /// Writes the damping by a ratio at a length; false, and nothing written, where no lane has it.
    #[inline(always)]
    fn modal_damping<const N: usize>(&self, length: T, size: usize, all: &mut [[T; N]; N]) -> bool {
        if self.modal.is_empty() {
            return false;
        }
        // lane after lane, then entry after entry: a pack is not written a lane at a time
        let mut rows = [[[0.0; N]; N]; WIDEST];
        for (lane, damping) in self.modal.iter().enumerate().take(WIDEST) {
            if let Some(damping) = damping {
                damping.at(length.lane(lane), rows[lane].as_flattened_mut());
            }
        }
        for i in 1..size {
            for j in 1..=i {
                let entry = place(i - 1, j - 1);
                let mut values = [0.0; WIDEST];
                for lane in 0..T::WIDTH {
                    values[lane] = rows[lane][entry / N][entry % N];
                }
                all[i][j] = T::of_lanes(&values);
                all[j][i] = all[i][j];
            }
        }
        true
    }

    /// [`ConsistentLanes::step`] of `modes` shapes a link, at most N coordinates; S and P are the lengths
    /// of the tables that so many need.
    #[inline(always)]
    pub(super) fn step_of<const N: usize, const S: usize, const P: usize>(
        &self,
        modes: (usize, usize),
        state: &mut ConsistentState<T>,
        (scheme, torques, extension, h, active, held): Arguments<'_, T>,
        shaft: Option<&DriveShaft<T>>,
    ) {
        let size = (1 + modes.0 + modes.1 + usize::from(shaft.is_some())).min(N);
        let zero = T::splat(0.0);
        let (rate, accel) = (extension.rate, extension.accel);
        let started = state.drive.started;
        let change = (accel - state.drive.extension_accel).where_set(started, zero);
        let moving = any(rate) || any(accel) || any(change);
        let terms =
            Terms::<T, N, S, P>::new(&self.arm, &self.payload, modes, extension.length, moving);
        let mut motion = Motion::<T, N> {
            q: leading(&state.q),
            v: leading(&state.v),
            a: leading(&state.a),
        };
        let spin = terms.spin();
        let [turning_rate, _] = spin.of(&motion.v);
        let turned = terms.turned(&motion.q);
        let square = turning_rate * turning_rate;
        // the parabola through the three torques
        let point = scheme.balance_point();
        let weights = [
            (1.0 - point) * (1.0 - 2.0 * point),
            4.0 * point * (1.0 - point),
            point * (2.0 * point - 1.0),
        ];
        let [begin, middle, end] = torques;
        let mean = |begin: T, middle: T, end: T| {
            begin * weights[0] + middle * weights[1] + end * weights[2]
        };
        let tip = mean(begin.tip, middle.tip, end.tip);
        // behind a drive shaft the motor turns the rotor, and not the arm
        let (slew, rotor) = match shaft {
            None => {
                let [begin, middle, end] = [begin, middle, end].map(|all| all.slew + all.root);
                (mean(begin, middle, end), zero)
            }
            Some(_) => (
                mean(begin.root, middle.root, end.root),
                mean(begin.slew, middle.slew, end.slew),
            ),
        };
        let forces = |slew: T, tip: T, rotor: T| {
            let mut force = terms.force(slew, tip);
            if shaft.is_some() {
                force[size - 1] = rotor;
            }
            force
        };
        let mut modal = [[T::splat(0.0); N]; N];
        let damped = self.modal_damping(extension.length, size, &mut modal);
        // the terms with the whole arm's rate as at the beginning; what they miss is corrected
        let stiffness = terms.stiffness(-square, -accel, rate * rate);
        let off_axis = any(self.payload.offset);
        let driven = |mut force: [T; N], square: T, accel: T| {
            if off_axis {
                terms.add_lever(square, accel, &mut force);
            }
            force
        };
        let balance = Balance {
            terms: &terms,
            stiffness: &stiffness,
            force: driven(forces(slew, tip, rotor), square, accel),
            damping: self.payload.damping,
            modal: damped.then_some(&modal),
            position: T::splat(1.0),
            rate,
            accel,
            turning_rate,
            spin: &spin,
            turned: &turned,
            held: held.map(|[_, balanced]| balanced),
            shaft,
        };
        let last = &state.drive;
        let (new_slew, new_rotor) = match shaft {
            None => ((begin.slew - last.slew) + (begin.root - last.root), zero),
            Some(_) => (begin.root - last.root, begin.slew - last.slew),
        };
        let new_tip = begin.tip - last.tip;
        let start = T::splat(1.0) - started;
        let mut first;
        let jump = if any(change) || any(start) {
            // where the flight goes on, the change of the force and of what a'' multiplies; where it
            // starts, all of the equations
            let stiffness = terms.stiffness(
                zero.where_set(started, -square),
                (-change).where_set(started, -accel),
                zero.where_set(started, rate * rate),
            );
            let changed = Balance {
                terms: &terms,
                stiffness: &stiffness,
                force: driven(
                    forces(
                        new_slew.where_set(started, slew),
                        new_tip.where_set(started, tip),
                        new_rotor.where_set(started, rotor),
                    ),
                    zero.where_set(started, square),
                    change.where_set(started, accel),
                ),
                damping: self.payload.damping,
                modal: damped.then_some(&modal),
                position: start,
                rate: zero.where_set(started, rate),
                accel: change.where_set(started, accel),
                turning_rate: zero.where_set(started, turning_rate),
                spin: &spin,
                turned: &turned,
                held: held.map(|[begin, _]| zero.where_set(started, begin)),
                shaft,
            };
            let mut still = motion.v;
            for v in &mut still {
                *v = zero.where_set(started, *v);
            }
            first = changed.unbalanced(&motion.q, &still);
            Jump::Change {
                change: &first,
                started,
            }
        } else if any(new_slew) || any(new_tip) || any(new_rotor) {
            first = forces(new_slew, new_tip, new_rotor);
            if held.is_some() {
                first[0] = zero;
            }
            Jump::Change {
                change: &first,
                started,
            }
        } else {
            Jump::None
        };
        scheme.step(&mut motion, &balance, jump, h);
        // plus zero: no zero is negative, whatever a pack left out
        for i in 0..size {
            state.q[i] = (motion.q[i] + 0.0).where_set(active, state.q[i]);
            state.v[i] = (motion.v[i] + 0.0).where_set(active, state.v[i]);
            state.a[i] = (motion.a[i] + 0.0).where_set(active, state.a[i]);
        }
        let drive = &mut state.drive;
        drive.started = T::splat(1.0).where_set(active, drive.started);
        drive.slew = end.slew.where_set(active, drive.slew);
        drive.root = end.root.where_set(active, drive.root);
        drive.tip = end.tip.where_set(active, drive.tip);
        drive.extension_accel = accel.where_set(active, drive.extension_accel);
    }
}

/// Scheme, torques, extension, length of the step, active lanes, accelerations of a held shoulder.
type Arguments<'a, T> = (
    &'a GeneralizedAlpha,
    &'a [Torques<T>; 3],
    &'a Extension<T>,
    T,
    T,
    Option<[T; 2]>,
);

/// The equations of a step.
struct Balance<'a, T, const N: usize, const S: usize, const P: usize> {
    terms: &'a Terms<'a, T, N, S, P>,
    stiffness: &'a Stiffness<T, P>,
    force: [T; N],
    damping: T,
    /// Damping by a ratio between the elastic coordinates, those from the second on.
    modal: Option<&'a [[T; N]; N]>,
    /// What the bending of the position counts: 1, or 0 in a change.
    position: T,
    /// Of the extension.
    rate: T,
    accel: T,
    /// Of the whole arm, at the beginning.
    turning_rate: T,
    spin: &'a Spin<T, N>,
    /// At the beginning.
    turned: &'a Turned<T, N>,
    /// Angular acceleration of a shoulder that is held: its equation takes the place of the slew angle's.
    held: Option<T>,
    /// Whose motor's end is the last coordinate.
    shaft: Option<&'a DriveShaft<T>>,
}

impl<T: Lane, const N: usize, const S: usize, const P: usize> Equations<T, N>
    for Balance<'_, T, N, S, P>
{
    #[inline(always)]
    fn size(&self) -> usize {
        (self.terms.size() + usize::from(self.shaft.is_some())).min(N)
    }

    #[inline(always)]
    fn effective(&self, mass: T, velocity: T, stiffness: T, out: &mut [[T; N]; N]) {
        let column = velocity * self.rate * 2.0;
        let weights = Weights {
            mass,
            bending: velocity.mul_add(self.damping, stiffness),
            drift: stiffness.mul_add(self.accel, column),
            stiffness,
            column,
            growth: velocity * self.rate,
        };
        self.terms.sum(&weights, self.stiffness, out);
        if let Some(modal) = self.modal {
            for i in 1..self.size() {
                for j in 1..self.size() {
                    out[i][j] = velocity.mul_add(modal[i][j], out[i][j]);
                }
            }
        }
        // z g^T g q'' + 2 omega g^T (Z q)^T q' + a' [dz/da g^T g + z (g^T dg/da + dg/da^T g)] q'
        let (turned, spin, size) = (self.turned, self.spin, self.size());
        let of_spin = mass.mul_add(turned.inertia, weights.growth * turned.growth);
        let of_force = velocity * self.turning_rate * 2.0;
        let of_growth = weights.growth * turned.inertia;
        let mut row = [T::splat(0.0); N];
        for j in 0..size {
            let grown = of_growth.mul_add(spin.growth[j], of_spin * spin.row[j]);
            row[j] = of_force.mul_add(turned.force[j], grown);
        }
        for i in 0..size {
            for j in 0..size {
                out[i][j] = spin.row[i].mul_add(row[j], out[i][j]);
            }
        }
        if self.terms.moving() {
            for i in 1..size {
                let also = of_growth * spin.growth[i];
                for j in 0..size {
                    out[i][j] = also.mul_add(spin.row[j], out[i][j]);
                }
            }
        }
        if let Some(shaft) = self.shaft {
            let (last, coupling) = (size - 1, shaft.torque(stiffness, velocity));
            out[0][0] += coupling;
            out[0][last] -= coupling;
            out[last][0] -= coupling;
            out[last][last] = mass.mul_add(shaft.rotor_inertia, coupling);
        }
        if self.held.is_some() {
            out[0] = [T::splat(0.0); N];
            out[0][0] = mass;
        }
    }

    #[inline(always)]
    fn unbalanced(&self, q: &[T; N], v: &[T; N]) -> [T; N] {
        let size = self.size();
        let twice = self.rate * 2.0;
        let mut bent = [T::splat(0.0); N];
        let mut drifting = [T::splat(0.0); N];
        let mut turning = T::splat(0.0);
        for i in 1..size {
            bent[i] = self.damping.mul_add(v[i], q[i] * self.position);
            drifting[i] = self.accel.mul_add(q[i], twice * v[i]);
            turning = self.turned.force[i].mul_add(v[i], turning);
        }
        let column = twice * v[0];
        let mut rest = self
            .terms
            .product(self.stiffness, &bent, &drifting, q, column);
        rest[0] = (self.rate * self.terms.rigid_growth()).mul_add(v[0], rest[0]);
        if let Some(modal) = self.modal {
            for i in 1..size {
                for j in 1..size {
                    rest[i] = modal[i][j].mul_add(v[j], rest[i]);
                }
            }
        }
        let (turned, spin) = (self.turned, self.spin);
        let [turns, drifts] = spin.of(v);
        let growing = turned.growth.mul_add(turns, turned.inertia * drifts);
        let whole = self
            .rate
            .mul_add(growing, self.turning_rate * turning * 2.0);
        let grown = self.rate * turned.inertia * turns;
        for i in 0..size {
            rest[i] = spin.row[i].mul_add(whole, grown.mul_add(spin.growth[i], rest[i]));
        }
        if let Some(shaft) = self.shaft {
            let last = size - 1;
            let torque = shaft.torque((q[last] - q[0]) * self.position, v[last] - v[0]);
            rest[0] -= torque;
            rest[last] = torque;
        }
        for (rest, force) in rest.iter_mut().zip(&self.force).take(size) {
            *rest = *force - *rest;
        }
        if let Some(accel) = self.held {
            rest[0] = accel;
        }
        rest
    }

    #[inline(always)]
    fn beyond(&self, found: &Motion<T, N>) -> Option<[T; N]> {
        let Motion { q, v, a } = found;
        let (before, now) = (self.turned, self.terms.turned(q));
        let spin = self.spin;
        let [turns, drifts] = spin.of(v);
        let [accelerates, _] = spin.of(a);
        let faster = turns * turns - self.turning_rate * self.turning_rate;
        let (mut of_before, mut of_now) = (T::splat(0.0), T::splat(0.0));
        for i in 1..self.size() {
            of_before = before.force[i].mul_add(v[i], of_before);
            of_now = now.force[i].mul_add(v[i], of_now);
        }
        let less = before.inertia - now.inertia;
        let turning = self.turning_rate * of_before - turns * of_now;
        let growing = (before.growth - now.growth).mul_add(turns, less * drifts);
        let whole = less * accelerates + turning * 2.0 + self.rate * growing;
        let grown = self.rate * less * turns;
        let mut missed = [T::splat(0.0); N];
        for i in 0..self.size() {
            let own = grown.mul_add(spin.growth[i], faster * now.force[i]);
            missed[i] = spin.row[i].mul_add(whole, own);
        }
        if self.held.is_some() {
            missed[0] = T::splat(0.0);
        }
        Some(missed)
    }
}

impl ConsistentPlant {
    /// Advances `state` by a step of length `h` (s) that begins `from` seconds after the start of
    /// `piece` and does not leave it, under torques at the beginning, middle and end of the step
    /// (N m). Torques and extension acceleration may jump between steps: second order is kept.
    /// The extension must be one that the arm can have.
    pub fn step(
        &self,
        scheme: &GeneralizedAlpha,
        state: &mut ConsistentState,
        torques: &[Torques<f64>; 3],
        piece: &Piece<f64>,
        from: f64,
        h: f64,
    ) {
        let extension = piece.extension(from + scheme.balance_point() * h);
        self.step_at(scheme, state, torques, &extension, h, None);
    }

    /// [`ConsistentPlant::step`] with the extension at the scheme's balance point; see
    /// [`ConsistentLanes::step`] for `held`.
    pub(crate) fn step_at(
        &self,
        scheme: &GeneralizedAlpha,
        state: &mut ConsistentState,
        torques: &[Torques<f64>; 3],
        extension: &Extension<f64>,
        h: f64,
        held: Option<[f64; 2]>,
    ) {
        #[cfg(target_arch = "x86_64")]
        {
            if Instructions::detect() >= Instructions::Avx2 {
                // SAFETY: the processor has the features that the function is compiled for
                return unsafe { self.step_avx2(scheme, state, torques, extension, h, held) };
            }
        }
        self.lanes
            .step(scheme, state, torques, extension, h, (1.0, held));
    }

    /// What the equations say of a state under torques, whatever the integrator has made of it.
    pub(crate) fn instant(
        &self,
        state: &ConsistentState,
        torques: &Torques<f64>,
        extension: &Extension<f64>,
    ) -> Instant {
        #[cfg(target_arch = "x86_64")]
        {
            if Instructions::detect() >= Instructions::Avx2 {
                // SAFETY: the processor has the features that the function is compiled for
                return unsafe { self.instant_avx2(state, torques, extension) };
            }
        }
        self.lanes.instant(state, torques, extension)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma")]
    fn instant_avx2(
        &self,
        state: &ConsistentState,
        torques: &Torques<f64>,
        extension: &Extension<f64>,
    ) -> Instant {
        self.lanes.instant(state, torques, extension)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma")]
    fn step_avx2(
        &self,
        scheme: &GeneralizedAlpha,
        state: &mut ConsistentState,
        torques: &[Torques<f64>; 3],
        extension: &Extension<f64>,
        h: f64,
        held: Option<[f64; 2]>,
    ) {
        self.lanes
            .step(scheme, state, torques, extension, h, (1.0, held));
    }
}

/// What the equations say at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Instant {
    /// q''.
    pub accel: [f64; CAPACITY],
    /// What squares of the deflections add to the angular momentum, N m s.
    pub turned_momentum: f64,
}

impl ConsistentLanes<f64> {
    #[inline(always)]
    fn instant(
        &self,
        state: &ConsistentState,
        torques: &Torques<f64>,
        extension: &Extension<f64>,
    ) -> Instant {
        const S4: usize = Slots::new(4).count;
        const S8: usize = Slots::new(8).count;
        match self.arm.modes() {
            (4, 4) => self.instant_of::<9, S4, 10>(state, torques, extension),
            _ => self.instant_of::<CAPACITY, S8, PACKED>(state, torques, extension),
        }
    }

    #[inline(always)]
    fn instant_of<const N: usize, const S: usize, const P: usize>(
        &self,
        state: &ConsistentState,
        torques: &Torques<f64>,
        extension: &Extension<f64>,
    ) -> Instant {
        let modes = self.arm.modes();
        let size = (1 + modes.0 + modes.1).min(N);
        let (rate, accel) = (extension.rate, extension.accel);
        let moving = rate != 0.0 || accel != 0.0;
        let terms =
            Terms::<f64, N, S, P>::new(&self.arm, &self.payload, modes, extension.length, moving);
        let (q, v) = (leading::<f64, N>(&state.q), leading::<f64, N>(&state.v));
        let spin = terms.spin();
        let [turning_rate, _] = spin.of(&v);
        let turned = terms.turned(&q);
        let square = turning_rate * turning_rate;
        let mut force = terms.force(torques.slew + torques.root, torques.tip);
        if self.payload.offset != 0.0 {
            terms.add_lever(square, accel, &mut force);
        }
        let stiffness = terms.stiffness(-square, -accel, rate * rate);
        let mut modal = [[0.0; N]; N];
        let damped = self.modal_damping(extension.length, size, &mut modal);
        let balance = Balance {
            terms: &terms,
            stiffness: &stiffness,
            force,
            damping: self.payload.damping,
            modal: damped.then_some(&modal),
            position: 1.0,
            rate,
            accel,
            turning_rate,
            spin: &spin,
            turned: &turned,
            held: None,
            shaft: None,
        };
        let mut factors = [[0.0; N]; N];
        balance.effective(1.0, 0.0, 0.0, &mut factors);
        factorize(&mut factors, size);
        let mut found = balance.unbalanced(&q, &v);
        solve(&factors, size, &mut found);
        let mut accel = [0.0; CAPACITY];
        accel[..size].copy_from_slice(&found[..size]);
        Instant {
            accel,
            turned_momentum: turning_rate * turned.inertia,
        }
    }
}

#[inline(always)]
fn leading<T: Lane, const N: usize>(row: &[T; CAPACITY]) -> [T; N] {
    let mut leading = [T::splat(0.0); N];
    leading.copy_from_slice(&row[..N]);
    leading
}

/// Whether a value is not zero in any lane.
#[inline(always)]
fn any<T: Lane>(value: T) -> bool {
    value.bits() != 0
}

/// A linear form of coordinates, or of their rates.
#[inline(always)]
fn form<T: Lane>(row: &[f64], x: &[T]) -> T {
    let mut sum = T::splat(0.0);
    for i in 0..row.len().min(x.len()) {
        sum = T::splat(row[i]).mul_add(x[i], sum);
    }
    sum
}
