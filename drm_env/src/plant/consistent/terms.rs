//! The equations of motion at one length: tabulated functions of link 1's shapes, closed forms for
//! everything else, and the products with states that a step needs.
//!
//! With e and s the deflection of link 1's end and the turn of link 2 (the same rows for every length),
//! link 2 outside and the payload depend on link 1's coordinates p through e p and s p alone, so their
//! parts are of rank two; with u the fraction of link 2's length a, its own matrices are constants over
//! powers of a. Since the particles are followed, M' = a' (G + G^T) between elastic coordinates, so
//! that C there is 2 a' G, and with c the root of link 2, r its shapes there and f = e + a s the row of
//! its tip
//!
//! ```text
//! G + G^T = rho (f^T f - r^T r)        dG/da - H = rho (f^T s - r^T r_x - int w_x^2)
//! ```
//!
//! between the coordinates of link 1. The payload moves with b = (R + Lp/2, f + Lp/2 s, tip + ...),
//! which adds Mp b^T b, and turns with t = (1, s, slope of the tip).
//!
//! Whatever only a moving link 2 needs may be left out for a whole pack of lanes that do not move: it
//! is multiplied by zero there. That can change the sign of a zero on the way, and of nothing else; the
//! step ends by making every zero positive.

use super::arm_tables::{ConsistentArm, MOST, Slots, below, packed};
use crate::simd::Lane;

/// What tells one lane's payload and switches from another's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Payload<T> {
    /// Mass, kg.
    pub mass: T,
    /// Distance of the centre from the tip, m.
    pub lever: T,
    /// Moment of inertia about the point of the axis beside the centre, kg m^2.
    pub inertia: T,
    /// Distance of the centre from the axis, m.
    pub offset: T,
    /// Bending stiffness of the links' sections, N m^2.
    pub stiffness: [T; 2],
    /// Time constant of the structural damping, s.
    pub damping: T,
    /// 1 where the tip wheel works on the tip's whole turn, 0 where on link 2's slope alone.
    pub whole: T,
}

/// Weights of the matrices in a sum of them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Weights<T> {
    /// M.
    pub mass: T,
    /// Kb.
    pub bending: T,
    /// G.
    pub drift: T,
    /// K-like matrices, see [`Stiffness`].
    pub stiffness: T,
    /// int rho W in the column of the slew angle.
    pub column: T,
    /// dM/da in the entry of the slew angle.
    pub growth: T,
}

impl Weights<f64> {
    /// Of nothing.
    pub const NONE: Self = Self {
        mass: 0.0,
        bending: 0.0,
        drift: 0.0,
        stiffness: 0.0,
        column: 0.0,
        growth: 0.0,
    };
    /// Of M.
    pub const MASS: Self = Self {
        mass: 1.0,
        ..Self::NONE
    };
    /// Of Kb.
    pub const BENDING: Self = Self {
        bending: 1.0,
        ..Self::NONE
    };
}

/// A sum of those matrices that act on the deflections alone.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stiffness<T, const P: usize> {
    /// Weight of Z.
    pub turning: T,
    /// Weight of P0, and of int rho W in the row of the slew angle.
    pub thrust: T,
    /// Weight of dG/da - H less int rho D in the row of the slew angle.
    pub curl: T,
    /// Between the shapes of link 1, and of link 2, without what is of low rank; packed.
    link1: [T; P],
    link2: [T; P],
}

/// Rates that the velocity and acceleration of link 2 multiply.
#[derive(Debug, Clone, Copy)]
pub(super) struct Turned<T, const N: usize> {
    /// Z q.
    pub force: [T; N],
    /// q^T Z q.
    pub inertia: T,
    /// q^T dZ/da q; zero where link 2 does not move.
    pub growth: T,
}

/// The rate of the whole arm as a linear form of the rates: the angular momentum of the undeflected arm
/// over its moment of inertia, omega = g q'. The slew angle's entry is 1.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spin<T, const N: usize> {
    /// g.
    pub row: [T; N],
    /// dg/da; zero where link 2 does not move.
    pub growth: [T; N],
}

impl<T: Lane, const N: usize> Spin<T, N> {
    /// The form's value at rates, and that of its change per unit of extension.
    #[inline(always)]
    pub fn of(&self, rates: &[T; N]) -> [T; 2] {
        [dot(&self.row, rates), dot(&self.growth, rates)]
    }
}

/// Everything at one length. N holds the coordinates, S the tabulated functions, P a packed matrix.
#[derive(Debug, Clone, Copy)]
pub(super) struct Terms<'a, T, const N: usize, const S: usize, const P: usize> {
    arm: &'a ConsistentArm,
    payload: Payload<T>,
    modes: (usize, usize),
    slots: Slots,
    moving: bool,
    /// a, 1 / a and its square.
    length: T,
    shrink: T,
    shrink2: T,
    /// Distances of link 2's root, its tip and the payload's centre from the shoulder.
    start: T,
    reach: T,
    centre: T,
    /// Distance of the payload's centre from link 1's end, and its distance from the tip over a.
    arm_out: T,
    lever_part: T,
    /// Axial force of the payload per square of the slew rate, and per acceleration.
    payload_pull: T,
    payload_push: T,
    /// The same times the distance of the payload's centre from the tip: as the payload turns, its centre
    /// draws near.
    near_pull: T,
    near_push: T,
    /// Tabulated functions; that of Z with the payload's part.
    values: [T; S],
    /// Z between link 2's shapes, without what is of low rank.
    turning2: [T; P],
}

/// k x + y.
#[inline(always)]
fn plus<T: Lane>(k: f64, x: T, y: T) -> T {
    T::splat(k).mul_add(x, y)
}

/// Sum of a row of numbers times coordinates.
#[inline(always)]
fn along<T: Lane>(row: &[f64], x: &[T]) -> T {
    let mut sum = T::splat(0.0);
    for i in 0..row.len().min(x.len()) {
        sum = plus(row[i], x[i], sum);
    }
    sum
}

/// The same with a row that differs between lanes.
#[inline(always)]
fn dot<T: Lane>(row: &[T], x: &[T]) -> T {
    let mut sum = T::splat(0.0);
    for i in 0..row.len().min(x.len()) {
        sum = row[i].mul_add(x[i], sum);
    }
    sum
}

/// Adds a packed symmetric matrix times x.
#[inline(always)]
fn add_product<T: Lane>(matrix: &[T], x: &[T], sum: &mut [T]) {
    for i in 0..x.len() {
        for k in 0..x.len() {
            let at = if k <= i { packed(i, k) } else { packed(k, i) };
            sum[i] = matrix[at].mul_add(x[k], sum[i]);
        }
    }
}

/// x^T matrix x of a packed symmetric matrix.
#[inline(always)]
fn form<T: Lane>(matrix: &[T], x: &[T]) -> T {
    let mut sum = T::splat(0.0);
    for i in 0..x.len() {
        let mut row = T::splat(0.0);
        for k in 0..i {
            row = matrix[packed(i, k)].mul_add(x[k], row);
        }
        sum = x[i].mul_add(matrix[packed(i, i)].mul_add(x[i], row + row), sum);
    }
    sum
}

impl<'a, T: Lane, const N: usize, const S: usize, const P: usize> Terms<'a, T, N, S, P> {
    /// At the extension `length` (m), with as many `modes` as the arm has; without what only a moving
    /// link 2 needs unless `moving`.
    #[inline(always)]
    pub fn new(
        arm: &'a ConsistentArm,
        payload: &Payload<T>,
        modes: (usize, usize),
        length: T,
        moving: bool,
    ) -> Self {
        let (n, m) = modes;
        let slots = Slots::new(n);
        let shrink = length.recip();
        let reach = length + arm.lengths[0];
        let centre = reach + payload.lever;
        let payload_push = payload.mass * arm.load;
        let mut terms = Self {
            arm,
            payload: *payload,
            modes,
            slots,
            moving,
            length,
            shrink,
            shrink2: shrink * shrink,
            start: reach - arm.lengths[1],
            reach,
            centre,
            arm_out: length + payload.lever,
            lever_part: payload.lever * shrink,
            payload_pull: payload_push * centre,
            payload_push,
            near_pull: payload_push * centre * payload.lever,
            near_push: payload_push * payload.lever,
            values: [T::splat(0.0); S],
            turning2: [T::splat(0.0); P],
        };
        let values = &mut terms.values;
        let count = if moving { slots.count } else { slots.moving };
        arm.table.evaluate(length, &mut values[..count]);
        // int w_x^2 from the shoulder to the tip is that over link 1 and a s^T s
        let (pull1, pull2) = (-terms.payload_pull, -(terms.payload_pull * length));
        for i in 0..n {
            for k in 0..=i {
                let e = packed(i, k);
                let own = plus(arm.slope1[e], pull1, values[slots.turning + e]);
                values[slots.turning + e] = plus(arm.turn[i] * arm.turn[k], pull2, own);
                let [stiff1, stiff2] = payload.stiffness;
                let inside = stiff2 * values[slots.bending + e];
                values[slots.bending + e] = plus(arm.stiff1[e], stiff1, inside);
            }
        }
        let (root, tip) = (length * 0.5 + arm.lengths[0], length * 0.5);
        let whole = terms.payload_pull * shrink;
        for e in 0..m * (m + 1) / 2 {
            let own = plus(arm.pull[e], -root, length * arm.gram[e]);
            let own = plus(arm.pull_moment[e], -tip, own);
            terms.turning2[e] = plus(arm.slope[e], -whole, own);
        }
        terms
    }

    /// Number of coordinates.
    #[inline(always)]
    pub fn size(&self) -> usize {
        (1 + self.modes.0 + self.modes.1).min(N)
    }

    /// Whether link 2 moves in any lane.
    #[inline(always)]
    pub fn moving(&self) -> bool {
        self.moving
    }

    /// Coordinates of link 1 and of link 2.
    #[inline(always)]
    fn split<'x>(&self, q: &'x [T; N]) -> (&'x [T], &'x [T]) {
        let (n, m) = self.modes;
        (&q[1..1 + n], &q[1 + n..1 + n + m])
    }

    /// Rigid moment of inertia of arm and payload, and its change per unit of extension.
    #[inline(always)]
    fn rigid(&self) -> (T, T) {
        let (arm, load) = (self.arm, &self.payload);
        let (l2, r) = (arm.lengths[1], self.reach);
        let link2 = r.mul_add(r - l2, T::splat(l2 * l2 / 3.0));
        let own = plus(arm.density * l2, link2, load.inertia + arm.inertia);
        let moved = load.mass * self.centre;
        (
            moved.mul_add(self.centre, own),
            plus(arm.density * l2, r + r - l2, moved + moved),
        )
    }

    /// Rate of the whole arm. Without the axial load nothing shortens, every particle stays at its
    /// distance, and what turns is the axis: the slew rate itself.
    #[inline(always)]
    pub fn spin(&self) -> Spin<T, N> {
        let (n, m) = self.modes;
        let zero = T::splat(0.0);
        let (mut row, mut growth) = ([zero; N], [zero; N]);
        row[0] = T::splat(1.0);
        let (arm, values, slots, load) = (self.arm, &self.values, &self.slots, &self.payload);
        let (a, l1) = (self.length, arm.lengths[0]);
        let (rigid, rigid_growth) = self.rigid();
        // none of it without the axial load
        let share = rigid.recip() * arm.load;
        let moved = load.mass * self.centre;
        for i in 0..n {
            let (end, turn) = (arm.end[i], arm.turn[i]);
            let centre = plus(turn, self.arm_out, T::splat(end));
            let own = moved.mul_add(centre, plus(turn, load.inertia, values[slots.lead + i]));
            row[1 + i] = own * share;
            if self.moving {
                let root = values[slots.root + i];
                let tip = plus(turn, a, T::splat(end));
                let links = (self.reach * tip - self.start * root) * arm.density;
                let own = load.mass.mul_add(plus(turn, self.centre, centre), links);
                growth[1 + i] = (own - row[1 + i] * rigid_growth) * share;
            }
        }
        let spun = load.inertia * self.shrink;
        for j in 0..m {
            let (plain, moment) = (arm.plain[j], arm.moment[j]);
            let (tip, slope) = (arm.tip[j], arm.tip_slope[j]);
            let centre = plus(slope, self.lever_part, T::splat(tip));
            let own = plus(plain, a * l1, a * a * moment);
            let own = plus(slope, spun, moved.mul_add(centre, own));
            row[1 + n + j] = own * share;
            if self.moving {
                let own = plus(2.0 * moment, a, T::splat(l1 * plain));
                let own = load.mass.mul_add(centre, own);
                let shrunk = moved.mul_add(load.lever, load.inertia) * self.shrink2;
                let own = plus(-slope, shrunk, own);
                growth[1 + n + j] = (own - row[1 + n + j] * rigid_growth) * share;
            }
        }
        Spin { row, growth }
    }

    /// Z q and its forms; the slew angle is no part of it.
    #[inline(always)]
    pub fn turned(&self, q: &[T; N]) -> Turned<T, N> {
        let (n, m) = self.modes;
        let (arm, load, a) = (self.arm, &self.payload, self.length);
        let (p, r) = self.split(q);
        let (end, turn) = (along(&arm.end[..n], p), along(&arm.turn[..n], p));
        let (plain, moment) = (along(&arm.plain[..m], r), along(&arm.moment[..m], r));
        let (tip, slope) = (along(&arm.tip[..m], r), along(&arm.tip_slope[..m], r));
        let a2 = a * a;
        let offset = self
            .lever_part
            .mul_add(slope, tip + self.arm_out.mul_add(turn, end));
        let moved = load.mass * offset;
        // what the axial force in link 2 takes from the turning of its shapes with link 1
        let bound = plus(arm.lengths[0], plain, a * moment) * (a * arm.load);
        let of_end = a.mul_add(plain, moved);
        let of_turn = self.arm_out.mul_add(moved, a2 * moment) - bound;
        let of_turn = (-self.payload_pull).mul_add(tip, of_turn);
        let of_plain = a * plus(-arm.lengths[0] * arm.load, turn, end);
        let of_moment = a2 * turn * (1.0 - arm.load);
        let of_tip = (-self.payload_pull).mul_add(turn, moved);
        let nearer = self.near_pull * self.shrink.mul_add(slope, turn);
        let of_turn = of_turn - nearer;
        let of_slope = self.lever_part.mul_add(moved, -(self.shrink * nearer));
        let mut force = [T::splat(0.0); N];
        for i in 0..n {
            force[1 + i] = plus(arm.end[i], of_end, of_turn * arm.turn[i]);
        }
        for j in 0..m {
            let own = plus(arm.plain[j], of_plain, of_moment * arm.moment[j]);
            force[1 + n + j] = plus(arm.tip[j], of_tip, plus(arm.tip_slope[j], of_slope, own));
        }
        add_product(&self.values[self.slots.turning..], p, &mut force[1..1 + n]);
        add_product(&self.turning2, r, &mut force[1 + n..1 + n + m]);
        let mut inertia = T::splat(0.0);
        for i in 1..=n + m {
            inertia = force[i].mul_add(q[i], inertia);
        }
        let levers = (load.offset.bits() != 0).then(|| self.lever());
        if let Some([row, _]) = &levers {
            let mut lever = T::splat(0.0);
            for i in 1..=n + m {
                lever = row[i].mul_add(q[i], lever);
                force[i] += row[i];
            }
            inertia += lever + lever;
        }
        let growth = if self.moving {
            let l1 = arm.lengths[0];
            let out = a.mul_add(turn, end);
            let root = dot(&self.values[self.slots.root..][..n], p);
            // N: the cut at link 2's root, what passes link 1's end, the payload
            let through = (out * out - root * root) * arm.density;
            let drift = (-self.lever_part * self.shrink).mul_add(slope, turn);
            let growing = (moved + moved).mul_add(drift, through);
            let between = end * plain + a * turn * moment * 2.0;
            let growing = growing + between + between;
            // P2: link 2 beyond its root, all that hangs on link 1, the payload's way out and its turn
            let pulled = self.start
                * (arm.density * arm.load)
                * form(&self.values[self.slots.shortening..], p);
            let mut along = a * turn * turn;
            for i in 0..n {
                let mut row = T::splat(0.0);
                for k in 0..i {
                    row = plus(arm.slope1[packed(i, k)], p[k], row);
                }
                let row = plus(arm.slope1[packed(i, i)], p[i], row + row);
                along = p[i].mul_add(row, along);
            }
            let hanging = self.payload_push + arm.density * arm.load * arm.lengths[1];
            let pulled = hanging.mul_add(along, pulled);
            let pulled = self.payload_pull.mul_add(turn * turn, pulled);
            let whole_turn = self.shrink.mul_add(slope, turn);
            let slower = self.near_pull * whole_turn * (slope * self.shrink2);
            let nearer = self
                .near_push
                .mul_add(whole_turn * whole_turn, -(slower + slower));
            let pulled = pulled + nearer;
            let bound = plus(l1, plain, a * moment * 2.0) * arm.load;
            let bound = self.payload_push.mul_add(tip, bound) * turn;
            // between link 2's shapes
            let whole = self
                .payload_push
                .mul_add(self.shrink, -(self.payload_pull * self.shrink2));
            let mut own = [T::splat(0.0); P];
            for (e, own) in own.iter_mut().enumerate().take(m * (m + 1) / 2) {
                let fixed = arm.gram[e] - 0.5 * (arm.pull[e] + arm.pull_moment[e]);
                *own = plus(arm.slope[e], -whole, T::splat(fixed));
            }
            let growth = growing - pulled - bound - bound + form(&own, r);
            if let Some([_, row]) = &levers {
                let mut lever = T::splat(0.0);
                for i in 1..=n + m {
                    lever = row[i].mul_add(q[i], lever);
                }
                growth + (lever + lever)
            } else {
                growth
            }
        } else {
            T::splat(0.0)
        };
        Turned {
            force,
            inertia,
            growth,
        }
    }

    /// l, half of what a deflection adds to the inertia of a payload off the axis, and its change per unit of
    /// extension.
    #[inline(always)]
    pub fn lever(&self) -> [[T; N]; 2] {
        let (n, m) = self.modes;
        let (arm, load) = (self.arm, &self.payload);
        let moment = load.mass * load.offset;
        let zero = T::splat(0.0);
        let (mut row, mut growth) = ([zero; N], [zero; N]);
        for i in 0..n {
            let (end, turn) = (arm.end[i], arm.turn[i]);
            let centre = plus(turn, self.arm_out, T::splat(end));
            // the change of b less that of X t: t does not change
            row[1 + i] = moment * plus(-turn, self.centre, centre);
        }
        for j in 0..m {
            let (tip, slope) = (arm.tip[j], arm.tip_slope[j]);
            let centre = plus(slope, self.lever_part, T::splat(tip));
            row[1 + n + j] = moment * plus(-slope, self.centre * self.shrink, centre);
            let nearer = (self.centre * self.shrink - 1.0) * self.shrink;
            let turned = nearer - self.lever_part * self.shrink;
            growth[1 + n + j] = moment * (turned * slope);
        }
        [row, growth]
    }

    /// The sum of K-like matrices with these weights of Z, of P0 and of dG/da - H.
    #[inline(always)]
    pub fn stiffness(&self, turning: T, thrust: T, curl: T) -> Stiffness<T, P> {
        let (n, m) = self.modes;
        let (arm, values, slots) = (self.arm, &self.values, &self.slots);
        let mut link1 = [T::splat(0.0); P];
        let shortening = curl * -arm.density;
        let (push1, push2) = (
            thrust * self.payload_push,
            thrust * self.payload_push * self.length,
        );
        for i in 0..n {
            for k in 0..=i {
                let e = packed(i, k);
                let mut sum = turning * values[slots.turning + e];
                if self.moving {
                    sum = thrust.mul_add(values[slots.thrust + e], sum);
                    sum = shortening.mul_add(values[slots.shortening + e], sum);
                    sum = plus(arm.slope1[e], push1, sum);
                    sum = plus(arm.turn[i] * arm.turn[k], push2, sum);
                }
                link1[e] = sum;
            }
        }
        let mut link2 = [T::splat(0.0); P];
        let (slide, slope) = (
            -(curl * self.shrink),
            thrust * self.payload_push * self.shrink,
        );
        for (e, sum) in link2.iter_mut().enumerate().take(m * (m + 1) / 2) {
            *sum = turning * self.turning2[e];
            if self.moving {
                *sum = plus(arm.pull[e], thrust, *sum);
                *sum = plus(arm.slope[e], slope, *sum);
                *sum = plus(arm.slide[e], slide, *sum);
            }
        }
        Stiffness {
            turning,
            thrust,
            curl,
            link1,
            link2,
        }
    }

    /// Writes a sum of all matrices.
    #[inline(always)]
    pub fn sum(&self, weights: &Weights<T>, stiffness: &Stiffness<T, P>, out: &mut [[T; N]; N]) {
        let (n, m) = self.modes;
        let (arm, values, slots, load) = (self.arm, &self.values, &self.slots, &self.payload);
        let (a, density, l1) = (self.length, arm.density, arm.lengths[0]);
        let a2 = a * a;
        let Weights {
            mass,
            bending,
            drift,
            stiffness: of_stiffness,
            column,
            growth,
        } = *weights;
        let turning = of_stiffness * stiffness.turning;
        let thrust = of_stiffness * stiffness.thrust;
        let curl = of_stiffness * stiffness.curl;
        // M and Z have the same N
        let both = mass + turning;
        let (line, spin) = (load.mass * both, load.inertia * mass);
        let pushed = drift * load.mass;
        // the payload's drift with link 2's own slope
        let slides = (curl * self.shrink * 2.0 - drift) * self.shrink2;
        let slides_mass = slides * load.mass * load.lever;
        let slides_spin = load.inertia * mass.mul_add(self.shrink, slides);
        let (pull, push) = (turning * arm.load, thrust * arm.load);
        // between deflections the payload's turn also brings its centre near
        let near = thrust.mul_add(self.near_push, -(turning * self.near_pull));
        let bent_spin = spin + near;
        // between the shapes of the two links, what the axial force takes
        let bound_plain = a * plus(-l1, pull, push);
        let bound_tip = thrust.mul_add(self.payload_push, -(turning * self.payload_pull));

        let mut p_end = [T::splat(0.0); MOST];
        let mut p_turn = [T::splat(0.0); MOST];
        let mut p_root = [T::splat(0.0); MOST];
        let half = drift * 0.5;
        for k in 0..n {
            let (end, turn) = (arm.end[k], arm.turn[k]);
            let centre = plus(turn, self.arm_out, T::splat(end));
            let x = line.mul_add(centre, pushed * turn);
            let tip = plus(turn, a, T::splat(end));
            let g = half.mul_add(tip, curl * turn) * density;
            p_end[k] = x + g;
            p_turn[k] = a.mul_add(g, plus(turn, bent_spin, self.arm_out * x));
            if self.moving {
                let (root, slope) = (values[slots.root + k], values[slots.root_slope + k]);
                p_root[k] = half.mul_add(root, curl * slope) * -density;
            }
        }
        for i in 0..n {
            for k in 0..n {
                let e = if k <= i { packed(i, k) } else { packed(k, i) };
                let mut sum = mass * values[slots.mass + e];
                sum = bending.mul_add(values[slots.bending + e], sum);
                sum = of_stiffness.mul_add(stiffness.link1[e], sum);
                sum = plus(arm.end[i], p_end[k], sum);
                sum = plus(arm.turn[i], p_turn[k], sum);
                if self.moving {
                    if k < i {
                        sum = drift.mul_add(values[slots.skew + below(i, k)], sum);
                    } else if k > i {
                        sum = (-drift).mul_add(values[slots.skew + below(k, i)], sum);
                    }
                    sum = values[slots.root + i].mul_add(p_root[k], sum);
                }
                out[1 + i][1 + k] = sum;
            }
        }

        // columns of link 2: the payload's part is b^T r_mass + t^T r_spin
        let mut r_mass = [T::splat(0.0); MOST];
        let mut r_spin = [T::splat(0.0); MOST];
        let mut centre2 = [T::splat(0.0); MOST];
        let of_plain = both.mul_add(a, drift);
        let drifting = drift.mul_add(a, curl + curl);
        let turn_plain = bound_plain - drifting;
        let turn_moment = a2.mul_add(both - pull, drifting + drift * a);
        let back_plain = a * both;
        let row_turn_plain = drift.mul_add(a, bound_plain);
        let row_turn_moment = a2 * (both - pull);
        let row_turn_mass = load.mass * both.mul_add(self.arm_out, drift);
        let spin_part = spin * self.shrink;
        let bent_part = bent_spin * self.shrink;
        let slides_bent = near.mul_add(self.shrink, slides_spin);
        for j in 0..m {
            let (plain, moment) = (arm.plain[j], arm.moment[j]);
            let (tip, slope) = (arm.tip[j], arm.tip_slope[j]);
            let centre = plus(slope, self.lever_part, T::splat(tip));
            centre2[j] = centre;
            let x = line.mul_add(centre, slides_mass * slope);
            let y = slides_bent * slope;
            (r_mass[j], r_spin[j]) = (x, y);
            let of_end = plus(plain, of_plain, x);
            let of_turn = plus(plain, turn_plain, turn_moment * moment);
            let of_turn = plus(tip, bound_tip, of_turn);
            let of_turn = self.arm_out.mul_add(x, of_turn + y);
            let back_end = plus(plain, back_plain, line * centre);
            let back_turn = plus(plain, row_turn_plain, row_turn_moment * moment);
            let back_turn = plus(tip, bound_tip, back_turn);
            let back_turn = plus(slope, bent_part, row_turn_mass.mul_add(centre, back_turn));
            for i in 0..n {
                let (end, turn) = (arm.end[i], arm.turn[i]);
                out[1 + i][1 + n + j] = plus(end, of_end, of_turn * turn);
                out[1 + n + j][1 + i] = plus(end, back_end, back_turn * turn);
            }
        }
        let of_gram = mass.mul_add(a, drift * 0.5);
        let of_stiff = bending * self.shrink * self.shrink2 * load.stiffness[1];
        for j in 0..m {
            for k in 0..m {
                let e = if k <= j { packed(j, k) } else { packed(k, j) };
                let skew = 0.5 * (arm.stretch[j][k] - arm.stretch[k][j]);
                let mut sum = of_gram * arm.gram[e];
                sum = plus(arm.stiff[e], of_stiff, sum);
                sum = of_stiffness.mul_add(stiffness.link2[e], sum);
                sum = plus(skew, drift, sum);
                sum = centre2[j].mul_add(r_mass[k], sum);
                sum = (self.shrink * arm.tip_slope[j]).mul_add(r_spin[k], sum);
                out[1 + n + j][1 + n + k] = sum;
            }
        }

        // row and column of the slew angle
        let (rigid, rigid_growth) = self.rigid();
        out[0][0] = mass.mul_add(rigid, growth * rigid_growth);
        let of_line = thrust - drift;
        let moved = load.mass * mass;
        for i in 0..n {
            let (end, turn) = (arm.end[i], arm.turn[i]);
            let centre = plus(turn, self.arm_out, T::splat(end));
            let still = mass.mul_add(values[slots.lead + i], spin * turn);
            let still = (moved * centre).mul_add(self.centre, still);
            let mut row = (pushed * turn).mul_add(self.centre, still);
            row = (thrust * load.mass).mul_add(centre, row);
            let mut down = (column * load.mass).mul_add(centre, still);
            if self.moving {
                let (root, slope) = (values[slots.root + i], values[slots.root_slope + i]);
                let tip = plus(turn, a, T::splat(end));
                let drifted = self.reach * tip - self.start * root;
                let curled = root - self.start * slope + (l1 * turn - end);
                row = of_line.mul_add(values[slots.line + i], row);
                row = (drift.mul_add(drifted, curl * curled)).mul_add(T::splat(density), row);
                down = column.mul_add(values[slots.line + i], down);
            }
            (out[0][1 + i], out[1 + i][0]) = (row, down);
        }
        let twice = curl + curl;
        let still_plain = mass * a * l1;
        let still_moment = mass * a2;
        let row_plain = thrust.mul_add(a, still_plain) - twice - drift * (a - l1);
        let row_moment = still_moment + twice + drift * (a + a);
        let row_mass = load.mass * (thrust + self.centre * mass);
        let row_slope = self.centre.mul_add(slides_mass, slides_spin);
        let down_plain = column.mul_add(a, still_plain);
        let down_mass = load.mass * (column + self.centre * mass);
        for j in 0..m {
            let (plain, moment, slope) = (arm.plain[j], arm.moment[j], arm.tip_slope[j]);
            let row = plus(plain, row_plain, row_moment * moment);
            let row = row_mass.mul_add(centre2[j], row);
            out[0][1 + n + j] = plus(slope, row_slope, row);
            let down = plus(plain, down_plain, still_moment * moment);
            let down = down_mass.mul_add(centre2[j], down);
            out[1 + n + j][0] = plus(slope, spin_part, down);
        }
    }

    /// Kb `bent` + G `drifting` + a K-like sum times `q` + `column` times int rho W, with what these
    /// matrices have in the row of the slew angle.
    #[inline(always)]
    pub fn product(
        &self,
        stiffness: &Stiffness<T, P>,
        bent: &[T; N],
        drifting: &[T; N],
        q: &[T; N],
        column: T,
    ) -> [T; N] {
        let (n, m) = self.modes;
        let (arm, values, slots, load) = (self.arm, &self.values, &self.slots, &self.payload);
        let (a, l1) = (self.length, arm.lengths[0]);
        let Stiffness {
            turning,
            thrust,
            curl,
            ..
        } = *stiffness;
        let (p, r) = self.split(q);
        let (p_bent, r_bent) = self.split(bent);
        let (p_drift, r_drift) = self.split(drifting);
        let (end, turn) = (along(&arm.end[..n], p), along(&arm.turn[..n], p));
        let (plain, moment) = (along(&arm.plain[..m], r), along(&arm.moment[..m], r));
        let (tip, slope) = (along(&arm.tip[..m], r), along(&arm.tip_slope[..m], r));
        let offset = self
            .lever_part
            .mul_add(slope, tip + self.arm_out.mul_add(turn, end));

        // coefficients of the rows of low rank: end, turn, root; plain, moment, tip, slope
        let bound = plus(l1, plain, a * moment) * arm.load;
        let push = thrust * arm.load;
        let mut of_end = turning * a * plain;
        let mut of_turn = turning * (a * (a * moment - bound) - self.payload_pull * tip);
        let mut of_plain = turning * a * plus(-l1 * arm.load, turn, end);
        let of_moment = turning * a * a * turn * (1.0 - arm.load);
        let mut of_tip = -(turning * self.payload_pull * turn);
        let mut of_mass = turning * offset;
        let near = thrust.mul_add(self.near_push, -(turning * self.near_pull));
        let nearer = near * self.shrink.mul_add(slope, turn);
        let mut of_slope = self.shrink * nearer;
        of_turn += nearer;
        let mut of_root = T::splat(0.0);
        let mut row = T::splat(0.0);
        if self.moving {
            let density = arm.density;
            let (end_g, turn_g) = (
                along(&arm.end[..n], p_drift),
                along(&arm.turn[..n], p_drift),
            );
            let plain_g = along(&arm.plain[..m], r_drift);
            let moment_g = along(&arm.moment[..m], r_drift);
            let slope_g = along(&arm.tip_slope[..m], r_drift);
            let out_g = a.mul_add(turn_g, end_g);
            let (root, root_slope) = (&values[slots.root..][..n], &values[slots.root_slope..][..n]);
            let line = &values[slots.line..][..n];
            let (root_q, root_g, slope_q) = (dot(root, p), dot(root, p_drift), dot(root_slope, p));
            let slid = (slope_g - curl * self.shrink * slope * 2.0) * self.shrink2;
            of_mass += turn_g + column - load.lever * slid;
            let out = curl.mul_add(turn, out_g * 0.5) * density;
            let stretched = a * (moment_g + moment_g - plain_g);
            let curled = (moment - plain) * 2.0;
            let spun = load.inertia * slid;
            of_end += out + plain_g;
            of_turn += a.mul_add(out, curl.mul_add(curled, stretched)) - spun
                + thrust * self.payload_push * tip
                + push * a * plain;
            of_root = curl.mul_add(slope_q, root_g * 0.5) * -density;
            of_plain += a * (turn_g + column + push * turn);
            of_tip += thrust * self.payload_push * turn;
            of_slope += -(self.shrink * spun);
            let drifted = self.reach * out_g - self.start * root_g;
            let at_root = plus(l1, turn, root_q - end) - self.start * slope_q;
            row = curl.mul_add(at_root, drifted) * density
                + plus(l1, plain_g, stretched)
                + curl * curled
                - dot(line, p_drift)
                + load.mass * self.centre * (turn_g - load.lever * slid)
                - spun
                + thrust * (dot(line, p) + a * plain + load.mass * offset);
        }
        of_mass = load.mass * of_mass;
        of_end += of_mass;
        of_turn = self.arm_out.mul_add(of_mass, of_turn);
        of_tip += of_mass;
        of_slope = self.lever_part.mul_add(of_mass, of_slope);

        let mut sum = [T::splat(0.0); N];
        sum[0] = row;
        for i in 0..n {
            let own = plus(arm.end[i], of_end, of_turn * arm.turn[i]);
            sum[1 + i] = own;
            if self.moving {
                let own = values[slots.root + i].mul_add(of_root, own);
                let mut own = values[slots.line + i].mul_add(column, own);
                for k in 0..i {
                    own = values[slots.skew + below(i, k)].mul_add(p_drift[k], own);
                }
                for k in i + 1..n {
                    own = (-values[slots.skew + below(k, i)]).mul_add(p_drift[k], own);
                }
                sum[1 + i] = own;
            }
        }
        add_product(&stiffness.link1, p, &mut sum[1..1 + n]);
        add_product(&values[slots.bending..], p_bent, &mut sum[1..1 + n]);
        let stiff = self.shrink * self.shrink2 * load.stiffness[1];
        for j in 0..m {
            let own = plus(arm.plain[j], of_plain, of_moment * arm.moment[j]);
            let own = plus(arm.tip[j], of_tip, own);
            let mut own = plus(arm.tip_slope[j], of_slope, own);
            let mut bending = T::splat(0.0);
            for (k, bent) in r_bent.iter().enumerate() {
                let e = if k <= j { packed(j, k) } else { packed(k, j) };
                bending = plus(arm.stiff[e], *bent, bending);
            }
            own = stiff.mul_add(bending, own);
            if self.moving {
                for (stretch, drifting) in arm.stretch[j].iter().zip(r_drift) {
                    own = plus(*stretch, *drifting, own);
                }
            }
            sum[1 + n + j] = own;
        }
        add_product(&stiffness.link2, r, &mut sum[1 + n..1 + n + m]);
        sum
    }

    /// dM/da of the slew angle's entry.
    #[inline(always)]
    pub fn rigid_growth(&self) -> T {
        self.rigid().1
    }

    /// Adds what a payload off the axis gives: the pull of an arm that turns at the square root of `square`, and
    /// the push of the extension's acceleration.
    #[inline(always)]
    pub fn add_lever(&self, square: T, accel: T, force: &mut [T; N]) {
        let (n, m) = self.modes;
        let load = &self.payload;
        let [row, _] = self.lever();
        let push = load.mass * load.offset * accel;
        force[0] += push;
        for i in 0..n {
            force[1 + i] = plus(
                self.arm.turn[i],
                push,
                square.mul_add(row[1 + i], force[1 + i]),
            );
        }
        for j in 0..m {
            let (at, slope) = (1 + n + j, self.arm.tip_slope[j]);
            force[at] = plus(
                slope,
                push * self.shrink,
                square.mul_add(row[at], force[at]),
            );
        }
    }

    /// Generalised force of torques on the slew angle and on the tip.
    #[inline(always)]
    pub fn force(&self, slew: T, tip: T) -> [T; N] {
        let (n, m) = self.modes;
        let whole = self.payload.whole * tip;
        let own = tip * self.shrink;
        let mut force = [T::splat(0.0); N];
        force[0] = slew + whole;
        for i in 0..n {
            force[1 + i] = whole * self.arm.turn[i];
        }
        for j in 0..m {
            force[1 + n + j] = own * self.arm.tip_slope[j];
        }
        force
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;

    use super::super::displacement::{CAPACITY, Field, Integrals};
    use super::super::{Arm, ConsistentPlant, Dynamics, Kinematics, PayloadProperties};
    use super::*;
    use crate::arm::PayloadInertia;
    use crate::arm::mode_shape::ShapeFamily;

    const NONE: Weights<f64> = Weights::NONE;

    /// Between its nodes a table has the integrals' values to rounding, and its rates of change are
    /// their differences.
    #[test]
    fn tables_are_exact_to_rounding() {
        let payload = PayloadProperties::new(500.0, 2.0, 1.0, PayloadInertia::Full);
        for (family, modes) in [
            (ShapeFamily::Mono, (1, 1)),
            (ShapeFamily::Mono, (4, 4)),
            (ShapeFamily::Mono, (8, 8)),
            (ShapeFamily::B9, (3, 4)),
        ] {
            let kinematics = Kinematics {
                shapes: family,
                slope_turning: true,
            };
            let plant = ConsistentPlant::with_kinematics(
                &Arm::default(),
                &payload,
                &Dynamics::default(),
                modes,
                (1.0, 8.0),
                kinematics,
            )
            .expect("the plant exists");
            let field = Field::new(&Arm::default(), family, modes, true);
            let size = field.size();
            let sections =
                [Arm::default().link1, Arm::default().link2].map(|link| link.bending_stiffness);
            let slope = |f: &dyn Fn(&Integrals) -> DMatrix<f64>, a: f64| {
                let h = 1e-4;
                (f(&Integrals::new(&field, &payload, a + h))
                    - f(&Integrals::new(&field, &payload, a - h)))
                    / (2.0 * h)
            };
            // table, exact, what rounding is measured by
            type Case = (DMatrix<f64>, DMatrix<f64>, DMatrix<f64>);
            let cases = |a: f64| -> [Case; 5] {
                let sums = Integrals::new(&field, &payload, a);
                let terms = plant.terms(a);
                let read = |weights: Weights<f64>, turning: f64, curl: f64| {
                    let mut out = [[0.0; CAPACITY]; CAPACITY];
                    terms.sum(&weights, &terms.stiffness(turning, 0.0, curl), &mut out);
                    DMatrix::from_fn(size, size, |i, j| out[i][j])
                };
                let stiffness = Weights {
                    stiffness: 1.0,
                    ..NONE
                };
                // the quadratic form's matrix, by its values
                let growing = |i: usize, j: usize| {
                    let mut q = [0.0; CAPACITY];
                    (q[i], q[j]) = (1.0, 1.0);
                    terms.turned(&q).growth
                };
                let growth = DMatrix::from_fn(size, size, |i, j| match (i, j) {
                    (0, _) | (_, 0) => 0.0,
                    _ if i == j => growing(i, i),
                    _ => 0.5 * (growing(i, j) - growing(i, i) - growing(j, j)),
                });
                let turning = |s: &Integrals| &s.offset - &s.centrifugal;
                // terms that cancel are as exact as they are large
                let growth_of_drift = slope(&|s| s.drift.clone(), a);
                let mut squared = &growth_of_drift - &sums.drift_square;
                for i in 1..size {
                    squared[(0, i)] -= sums.drift_line[i];
                }
                let same = |table, exact: DMatrix<f64>| (table, exact.clone(), exact);
                let mass = Weights { mass: 1.0, ..NONE };
                let bending = Weights {
                    bending: 1.0,
                    ..NONE
                };
                [
                    same(read(mass, 0.0, 0.0), sums.mass.clone()),
                    same(read(bending, 0.0, 0.0), sums.stiffness(sections)),
                    same(read(stiffness, 1.0, 0.0), turning(&sums)),
                    same(growth, slope(&turning, a)),
                    (
                        read(stiffness, 0.0, 1.0),
                        squared,
                        growth_of_drift.abs() + sums.drift_square.abs(),
                    ),
                ]
            };
            let all = [1.0, 1.37, 2.9, 5.1, 7.77, 8.0].map(cases);
            // the last two against differences
            for (kind, tolerance) in [1e-11, 1e-11, 1e-11, 1e-6, 1e-6].into_iter().enumerate() {
                let largest = |i: usize, j: usize| {
                    all.iter().fold(0.0, |most: f64, cases| {
                        most.max(cases[kind].2[(i, j)].abs())
                    })
                };
                let sizes = DMatrix::from_fn(size, size, largest);
                for cases in &all {
                    let difference = &cases[kind].0 - &cases[kind].1;
                    for i in 0..size {
                        for j in 0..size {
                            let scale = libm::sqrt(sizes.row(i).max() * sizes.column(j).max());
                            let error = difference[(i, j)].abs();
                            assert!(
                                error <= tolerance * scale,
                                "{family:?} {modes:?} matrix {kind} {i} {j}: {error:e} of {scale:e}"
                            );
                        }
                    }
                }
            }
        }
    }
}
