//! Forces and moments within the arm and on its base: the inertia of what is beyond a section, from
//! the positions of the particles along the motion, whichever plant the motion comes from.
//!
//! With xi the distance from the shoulder along the rotating axis and w the deflection from it, a
//! particle at (xi, w) has the acceleration
//!
//! ```text
//! along the axis    xi'' - 2 theta' w' - theta'' w - theta'^2 xi
//! across it         w'' + 2 theta' xi' + theta'' xi - theta'^2 w
//! ```
//!
//! with ' the rate following it: xi' = a' for link 2 and the payload, else 0, and w = W(a) q gives
//! w' = W q' + a' D q and w'' = W q'' + a' (2 D q') + a'' D q + a'^2 D_a q, D the change of W per unit of
//! extension following the particle, D_a that of D. The force on a section is the sum of mass times
//! acceleration of all that is beyond it, the moment the sum of their moments and of the payload's own
//! turning, less the tip wheel's torque. Curvature times bending stiffness would be another way; it
//! converges slowly with the number of assumed shapes, while the balance holds for any number.
//!
//! What drives link 2 out is the force that works on the extension alone,
//! F = sum m r'' . dr/da + dV/da - T2 ds/da, V the bending energy and s the slope of the tip: then torques
//! and F give the power by which the energy of motion and bending changes. Drawing near (u in
//! [`crate::plant::consistent`]) is left out of positions: of second order in the deflection.

use crate::arm::mode_shape::{ShapeFamily, ShapeValue};
use crate::arm::{Arm, LINK_END_DEFLECTION, PayloadProperties};
use crate::math::quadrature::gauss_legendre;
use crate::plant::consistent::{CAPACITY, ConsistentPlant, Field};
use crate::reference::Extension;

/// A motion at one instant: coordinates of the plant, their rates and accelerations.
#[derive(Debug, Clone, Copy)]
pub struct Moving<'a> {
    /// Coordinates, rad and m; entries beyond the plant's size are zero.
    pub q: &'a [f64; CAPACITY],
    /// Their rates.
    pub v: &'a [f64; CAPACITY],
    /// Their accelerations.
    pub accel: &'a [f64; CAPACITY],
    /// Length of link 2 outside link 1.
    pub extension: &'a Extension<f64>,
    /// Torque of the tip wheel, N m.
    pub tip_torque: f64,
}

/// What follows from inertia at one instant; N, N m, m/s^2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InertiaLoads {
    /// Force of the base on the arm along its rotating axis and across it.
    pub base: [f64; 2],
    /// Force on link 2 where it leaves link 1, across the tangent there.
    pub shear: f64,
    /// Moment on link 2 where it leaves link 1.
    pub moment: f64,
    /// Force that drives link 2 out of link 1, positive outward.
    pub deployment: f64,
    /// Acceleration of the payload's centre of mass, its magnitude.
    pub payload_acceleration: f64,
    /// Acceleration of the tip, where link 2 carries tip wheel and payload, across the link there.
    pub tip_acceleration: f64,
    /// Angular momentum about the shoulder as far as it is linear in the rates of the undeflected arm,
    /// N m s: what the drawing near takes, and squares of deflections, are added by who knows them.
    pub momentum: f64,
    /// Deflection of the tip from the rotating axis, m.
    pub tip: f64,
}

/// Shapes of link 2 at one place outside link 1.
#[derive(Debug, Clone)]
struct Node {
    /// Fraction of the length outside, and of it what the node stands for.
    u: f64,
    weight: f64,
    shapes: Vec<ShapeValue>,
}

/// An arm with its payload, to be asked for its loads.
#[derive(Debug, Clone)]
pub struct LoadModel {
    field: Field,
    payload: PayloadProperties,
    /// Coordinates of the field per coordinate of the plant, link 1 and link 2.
    scale: [f64; 2],
    /// Whether the plant's velocities are those of the particles.
    follows: bool,
    /// Nodes and weights on [-1, 1] for the part of link 2 inside link 1.
    rule: Vec<(f64, f64)>,
    outside: Vec<Node>,
    /// int W dxi and int xi W dxi over link 1, a number a shape.
    link1: [Vec<f64>; 2],
}

/// Rates of the rotating axis and of what moves along it.
#[derive(Clone, Copy)]
struct Frame {
    rate: f64,
    accel: f64,
}

/// Where a particle is in the rotating frame, with its rates following it.
#[derive(Clone, Copy)]
struct Particle {
    along: [f64; 3],
    across: [f64; 3],
}

impl Frame {
    /// Acceleration along the axis and across it.
    fn acceleration(&self, particle: &Particle) -> [f64; 2] {
        let ([x, xd, xdd], [y, yd, ydd]) = (particle.along, particle.across);
        let square = self.rate * self.rate;
        [
            xdd - 2.0 * self.rate * yd - self.accel * y - square * x,
            ydd + 2.0 * self.rate * xd + self.accel * x - square * y,
        ]
    }
}

/// Forms of coordinates, rates and accelerations: W q, W q', W q''.
type Forms = [f64; 3];

impl LoadModel {
    /// Of the thesis' plant; `follows` is its switch of the same meaning.
    pub fn thesis(arm: &Arm, payload: &PayloadProperties, follows: bool) -> Self {
        let field = Field::new(arm, ShapeFamily::B8, (1, 1), false);
        let scale = [1, 2].map(|i| LINK_END_DEFLECTION / field.end_deflection[i]);
        Self::new(field, payload, scale, follows)
    }

    /// Of the consistent plant.
    pub fn consistent(plant: &ConsistentPlant) -> Self {
        Self::new(plant.field().clone(), plant.payload(), [1.0; 2], true)
    }

    fn new(field: Field, payload: &PayloadProperties, scale: [f64; 2], follows: bool) -> Self {
        let rule = gauss_legendre(field.points());
        let length = field.arm.link1.length;
        let mut link1 = [0, 1].map(|_| vec![0.0; field.link1.len()]);
        let mut outside = Vec::with_capacity(rule.len());
        for &(node, weight) in &rule {
            let (u, weight) = ((1.0 + node) / 2.0, weight / 2.0);
            for (i, [value, ..]) in field.link1.at(u).into_iter().enumerate() {
                link1[0][i] += weight * length * value;
                link1[1][i] += weight * length * (u * length) * value;
            }
            let shapes = field.link2.at(u);
            outside.push(Node { u, weight, shapes });
        }
        Self {
            field,
            payload: *payload,
            scale,
            follows,
            rule,
            outside,
            link1,
        }
    }

    /// Memory of it beside itself, bytes, about.
    pub(crate) fn bytes(&self) -> usize {
        let shapes = self.field.size() * size_of::<ShapeValue>();
        self.rule.len() * size_of::<(f64, f64)>()
            + self.outside.len() * (size_of::<Node>() + shapes)
            + shapes
    }

    /// The loads of a motion.
    pub fn at(&self, motion: &Moving<'_>) -> InertiaLoads {
        let arm = &self.field.arm;
        let (l1, l2) = (arm.link1.length, arm.link2.length);
        let (rho1, rho2) = (arm.link1.mass_per_length, arm.link2.mass_per_length);
        let Extension {
            length: a,
            rate: ad,
            accel: add,
        } = *motion.extension;
        let n = self.field.link1.len();
        let size = self.field.size();
        let frame = Frame {
            rate: motion.v[0],
            accel: motion.accel[0],
        };
        let all = [motion.q, motion.v, motion.accel];
        let one = all.map(|x| scaled(&x[1..=n], self.scale[0]));
        let two = all.map(|x| scaled(&x[1 + n..size], self.scale[1]));
        let of_one = |row: &[f64]| -> Forms { [0, 1, 2].map(|i| dot(row, &one[i])) };
        let of_two = |row: &[f64]| -> Forms { [0, 1, 2].map(|i| dot(row, &two[i])) };

        // link 1 turns and bends
        let bent = of_one(&self.link1[0]).map(|x| rho1 * x);
        let [force_r, force_t] = frame.acceleration(&Particle {
            along: [rho1 * l1 * l1 / 2.0, 0.0, 0.0],
            across: bent,
        });
        let mut sums = Sums {
            force: [force_r, force_t],
            momentum: rho1 * (dot(&self.link1[1], &one[1]) + frame.rate * (l1 * l1 * l1 / 3.0)),
            ..Sums::default()
        };
        let shifted = if self.follows { ad } else { 0.0 };

        // the part of link 2 inside link 1
        let start = l1 + a - l2;
        let (middle, half) = ((l1 + start) / 2.0, (l1 - start) / 2.0);
        for &(node, weight) in &self.rule {
            let xi = middle + half * node;
            let mass = rho2 * half * weight;
            let (mut w, mut d, mut curl) = ([0.0; 3], [0.0; 2], 0.0);
            for (i, [value, slope, bend]) in self.field.link1.at(xi / l1).into_iter().enumerate() {
                for (w, x) in w.iter_mut().zip(&one) {
                    *w += value * x[i];
                }
                for (d, x) in d.iter_mut().zip(&one) {
                    *d += slope / l1 * x[i];
                }
                curl += bend / (l1 * l1) * one[0][i];
            }
            let particle = moved(xi, [ad, add], w, d, curl);
            let drift = if self.follows { d[0] } else { 0.0 };
            sums.take(mass, &frame.acceleration(&particle), d[0]);
            sums.momentum += mass * (xi * (w[1] + xi * frame.rate + ad * drift) - shifted * w[0]);
        }
        let root = self.field.link1.at((start / l1).clamp(0.0, 1.0));
        let root_curvature: f64 = root
            .iter()
            .zip(&one[0])
            .map(|(s, q)| s[2] / (l1 * l1) * q)
            .sum();

        // where link 2 leaves link 1
        let end = of_one(&self.field.end_deflection[1..=n]);
        let end_slope = of_one(&self.field.end_slope[1..=n]);
        let turn = if self.field.slope_turning {
            end_slope
        } else {
            // a link 2 that does not turn with link 1 has a kink there, which particles pass
            let push = -rho2 * ad * ad * end_slope[0];
            sums.force[1] += push;
            sums.deployment += 0.5 * push * end_slope[0];
            [0.0; 3]
        };

        // link 2 outside
        let mut bending = 0.0;
        for node in &self.outside {
            let Node { u, weight, shapes } = node;
            let (x, mass, rest) = (u * a, rho2 * a * weight, 1.0 - u);
            let (mut w, mut slope, mut bend) = ([0.0; 3], [0.0; 2], 0.0);
            for (j, [value, first, second]) in shapes.iter().enumerate() {
                for (w, y) in w.iter_mut().zip(&two) {
                    *w += value * y[j];
                }
                for (slope, y) in slope.iter_mut().zip(&two) {
                    *slope += first * y[j];
                }
                bend += second * two[0][j];
            }
            for i in 0..3 {
                w[i] += end[i] + x * turn[i];
            }
            // the particle moves out by one and the shape stretches with the length
            let d = [0, 1].map(|i| turn[i] + slope[i] * rest / a);
            let curl = (bend * rest - 2.0 * slope[0]) * rest / (a * a);
            let particle = moved(l1 + x, [ad, add], w, d, curl);
            let acceleration = frame.acceleration(&particle);
            let drift = if self.follows {
                d[0]
            } else {
                -u * slope[0] / a
            };
            sums.take(mass, &acceleration, d[0]);
            sums.take_beyond(mass, &acceleration, [x, w[0] - end[0]]);
            let xi = l1 + x;
            sums.momentum += mass * (xi * (w[1] + xi * frame.rate + ad * drift) - shifted * w[0]);
            bending += weight * bend * bend;
        }
        let stiff = arm.link2.bending_stiffness;
        sums.deployment -=
            0.5 * stiff * (3.0 * bending / (a * a * a * a) + root_curvature * root_curvature);

        // the payload turns with the tip
        let load = &self.payload;
        let (lever, off) = (load.length / 2.0, load.offset);
        let own = of_two(&self.field.end_deflection[1 + n..size]);
        let own_slope = of_two(&self.field.end_slope[1 + n..size]);
        let tip = [0, 1, 2].map(|i| end[i] + a * turn[i] + own[i]);
        let slope = [0, 1, 2].map(|i| turn[i] + own_slope[i] / a);
        let slope_drift = [0, 1].map(|i| -own_slope[i] / (a * a));
        let slope_curl = 2.0 * own_slope[0] / (a * a * a);
        let turning = moved(0.0, [ad, add], slope, slope_drift, slope_curl).across;
        let centre = [0, 1, 2].map(|i| tip[i] + lever * slope[i]);
        let centre_drift = [0, 1].map(|i| turn[i] + lever * slope_drift[i]);
        let distance = l1 + a + lever;
        let mut particle = moved(
            distance,
            [ad, add],
            centre,
            centre_drift,
            lever * slope_curl,
        );
        particle.across[0] += off;
        for (along, turned) in particle.along.iter_mut().zip(turning) {
            *along -= off * turned;
        }
        let acceleration = frame.acceleration(&particle);
        let mass = load.mass;
        let couple = load.inertia_centre * (frame.accel + turning[2]);
        sums.take(mass, &acceleration, centre_drift[0]);
        sums.deployment +=
            slope_drift[0] * (couple - off * mass * acceleration[0] - motion.tip_torque);
        sums.take_beyond(
            mass,
            &acceleration,
            [particle.along[0] - l1, particle.across[0] - end[0]],
        );
        sums.moment += couple;
        sums.momentum += mass
            * (distance * (centre[1] + distance * frame.rate + ad * centre_drift[0])
                - shifted * (centre[0] + off));
        sums.momentum += load.inertia_on_axis() * (frame.rate + slope[1] + ad * slope_drift[0]);
        let mount = frame.acceleration(&moved(l1 + a, [ad, add], tip, [turn[0], turn[1]], 0.0));
        let tangent = turn[0];
        InertiaLoads {
            base: sums.force,
            shear: sums.beyond[1] * libm::cos(tangent) - sums.beyond[0] * libm::sin(tangent),
            moment: sums.moment - motion.tip_torque,
            deployment: sums.deployment,
            payload_acceleration: libm::hypot(acceleration[0], acceleration[1]),
            tip_acceleration: mount[1] * libm::cos(slope[0]) - mount[0] * libm::sin(slope[0]),
            momentum: sums.momentum,
            tip: tip[0],
        }
    }
}

/// Position and its rates of what is at xi and moves out with the extension.
fn moved(xi: f64, [ad, add]: [f64; 2], w: Forms, drift: [f64; 2], curl: f64) -> Particle {
    Particle {
        along: [xi, ad, add],
        across: [
            w[0],
            w[1] + ad * drift[0],
            w[2] + 2.0 * ad * drift[1] + add * drift[0] + ad * ad * curl,
        ],
    }
}

#[derive(Default)]
struct Sums {
    /// On everything, along and across.
    force: [f64; 2],
    /// On what is outside link 1.
    beyond: [f64; 2],
    moment: f64,
    deployment: f64,
    momentum: f64,
}

impl Sums {
    /// A mass of link 2 or the payload; `drift` is its way across per unit of extension.
    fn take(&mut self, mass: f64, acceleration: &[f64; 2], drift: f64) {
        let [along, across] = acceleration.map(|x| mass * x);
        self.force[0] += along;
        self.force[1] += across;
        self.deployment += along + across * drift;
    }

    /// A mass outside link 1 at a place from where link 2 leaves it.
    fn take_beyond(&mut self, mass: f64, acceleration: &[f64; 2], [x, y]: [f64; 2]) {
        let [along, across] = acceleration.map(|x| mass * x);
        self.beyond[0] += along;
        self.beyond[1] += across;
        self.moment += x * across - y * along;
    }
}

fn dot(row: &[f64], x: &[f64]) -> f64 {
    row.iter().zip(x).map(|(row, x)| row * x).sum()
}

fn scaled(x: &[f64], scale: f64) -> [f64; CAPACITY] {
    let mut result = [0.0; CAPACITY];
    for (result, x) in result.iter_mut().zip(x) {
        *result = scale * x;
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arm::PayloadInertia;
    use crate::math::quadrature::integrate;
    use crate::plant::Dynamics;

    /// A motion as polynomials of time, and the arm's particles in space by it.
    struct Path {
        field: Field,
        payload: PayloadProperties,
        q: [[f64; CAPACITY]; 3],
        a: [f64; 3],
    }

    impl Path {
        fn now(&self, t: f64) -> ([f64; CAPACITY], f64) {
            let along = |x: [f64; 3]| x[0] + t * (x[1] + t * x[2] / 2.0);
            let q = std::array::from_fn(|i| along([self.q[0][i], self.q[1][i], self.q[2][i]]));
            (q, along(self.a))
        }

        fn space(q: &[f64; CAPACITY], [x, y]: [f64; 2]) -> [f64; 2] {
            let (sin, cos) = (q[0].sin(), q[0].cos());
            [x * cos - y * sin, x * sin + y * cos]
        }

        fn value(row: &[f64; CAPACITY], q: &[f64; CAPACITY]) -> f64 {
            (1..CAPACITY).map(|i| row[i] * q[i]).sum()
        }

        /// Of link 1 at xi.
        fn fixed(&self, t: f64, xi: f64) -> [f64; 2] {
            let (q, a) = self.now(t);
            let w = Self::value(&self.field.place(a, xi).deflection, &q);
            Self::space(&q, [xi, w])
        }

        /// Of link 2 at a distance from its own root.
        fn slides(&self, t: f64, own: f64) -> [f64; 2] {
            let (_, a) = self.now(t);
            let arm = &self.field.arm;
            self.fixed(t, arm.link1.length + a - arm.link2.length + own)
        }

        /// Where link 2 ends.
        fn tip(&self, t: f64) -> [f64; 2] {
            let (q, a) = self.now(t);
            let w = Self::value(&self.field.tip(a).deflection, &q);
            Self::space(&q, [self.field.arm.link1.length + a, w])
        }

        fn payload(&self, t: f64) -> [f64; 2] {
            let (q, a) = self.now(t);
            let tip = self.field.tip(a);
            let (w, s) = (
                Self::value(&tip.deflection, &q),
                Self::value(&tip.slope, &q),
            );
            let (lever, off) = (self.payload.length / 2.0, self.payload.offset);
            let reach = self.field.arm.link1.length + a;
            Self::space(&q, [reach + lever - off * s, w + lever * s + off])
        }

        fn turn(&self, t: f64) -> f64 {
            let (q, a) = self.now(t);
            q[0] + Self::value(&self.field.tip(a).slope, &q)
        }
    }

    /// Second derivative at t = 0, of fourth order.
    fn accelerates(at: impl Fn(f64) -> f64) -> f64 {
        let h = 2e-3;
        (16.0 * (at(h) + at(-h)) - at(2.0 * h) - at(-2.0 * h) - 30.0 * at(0.0)) / (12.0 * h * h)
    }

    fn path(offset: f64) -> (Path, ConsistentPlant) {
        let payload = PayloadProperties {
            offset,
            ..PayloadProperties::new(300.0, 1.4, 0.7, PayloadInertia::Full)
        };
        let dynamics = Dynamics::default();
        let arm = Arm::default();
        let plant = ConsistentPlant::new(&arm, &payload, &dynamics, (3, 2), (2.0, 5.0))
            .expect("the plant exists");
        let mut q = [[0.0; CAPACITY]; 3];
        for (order, row) in q.iter_mut().enumerate() {
            for (i, x) in row.iter_mut().enumerate().take(6) {
                *x = 0.01 * (1.0 + order as f64) * libm::sin(1.7 * i as f64 + order as f64);
            }
        }
        (q[0][0], q[1][0], q[2][0]) = (0.4, 0.3, -0.05);
        let path = Path {
            field: plant.field().clone(),
            payload,
            q,
            a: [3.3, 0.7, -0.2],
        };
        (path, plant)
    }

    /// Forces and moments are those of particles whose places in space are differentiated.
    #[test]
    fn loads_are_the_inertia_of_particles_in_space() {
        for offset in [0.0, 0.08] {
            let (path, plant) = path(offset);
            let tip_torque = 4.0;
            let found = LoadModel::consistent(&plant).at(&Moving {
                q: &path.q[0],
                v: &path.q[1],
                accel: &path.q[2],
                extension: &Extension {
                    length: path.a[0],
                    rate: path.a[1],
                    accel: path.a[2],
                },
                tip_torque,
            });
            let rule = gauss_legendre(14);
            let arm = &path.field.arm;
            let (l1, l2, a) = (arm.link1.length, arm.link2.length, path.a[0]);
            let (rho1, rho2) = (arm.link1.mass_per_length, arm.link2.mass_per_length);
            let mp = path.payload.mass;
            let accel = |at: &dyn Fn(f64) -> [f64; 2]| [0, 1].map(|i| accelerates(|t| at(t)[i]));
            let mouth = path.fixed(0.0, l1);
            let couple = path.payload.inertia_centre * accelerates(|t| path.turn(t));
            // x, y and moment about the mouth of a particle
            let of = |at: &dyn Fn(f64) -> [f64; 2]| {
                let ([x, y], [ax, ay]) = (at(0.0), accel(at));
                [ax, ay, (x - mouth[0]) * ay - (y - mouth[1]) * ax]
            };
            let sum = |low: f64, high: f64, part: usize, fixed: bool| {
                integrate(&rule, low, high, |s| {
                    if fixed {
                        of(&|t| path.fixed(t, s))[part]
                    } else {
                        of(&|t| path.slides(t, s))[part]
                    }
                })
            };
            let load = of(&|t| path.payload(t));
            let beyond = [0, 1, 2].map(|i| rho2 * sum(l2 - a, l2, i, false) + mp * load[i]);
            let all = [0, 1].map(|i| {
                rho1 * sum(0.0, l1, i, true) + rho2 * sum(0.0, l2 - a, i, false) + beyond[i]
            });
            let theta = path.q[0][0];
            let [along, across] = found.base;
            let base = Path::space(&path.q[0], [along, across]);
            for i in 0..2 {
                assert!(
                    (base[i] - all[i]).abs() < 1e-5,
                    "{i}: {} {}",
                    base[i],
                    all[i]
                );
            }
            let moment = beyond[2] + couple - tip_torque;
            assert!(
                (found.moment - moment).abs() < 1e-5,
                "{} {moment}",
                found.moment
            );
            let slope = Path::value(&path.field.place(a, l1).slope, &path.q[0]);
            let normal = theta + slope;
            let shear = beyond[1] * normal.cos() - beyond[0] * normal.sin();
            assert!(
                (found.shear - shear).abs() < 1e-5,
                "{} {shear}",
                found.shear
            );
            let payload = libm::hypot(load[0], load[1]);
            assert!((found.payload_acceleration - payload).abs() < 1e-7);
            let [ax, ay] = accel(&|t| path.tip(t));
            let turned = path.turn(0.0);
            let across = ay * turned.cos() - ax * turned.sin();
            assert!((found.tip_acceleration - across).abs() < 1e-7);
            // the work of all inertia forces along a small extension, and what the bending takes
            let h = 1e-4;
            let ahead = |sign: f64| Path {
                field: path.field.clone(),
                payload: path.payload,
                q: [path.q[0], [0.0; CAPACITY], [0.0; CAPACITY]],
                a: [a + sign * h, 0.0, 0.0],
            };
            let (on, back) = (ahead(1.0), ahead(-1.0));
            let way = |at: &dyn Fn(&Path) -> [f64; 2]| {
                let (on, back) = (at(&on), at(&back));
                [0, 1].map(|i| (on[i] - back[i]) / (2.0 * h))
            };
            let work = |at: &dyn Fn(&Path, f64) -> [f64; 2]| {
                let ([ax, ay], [wx, wy]) = (accel(&|t| at(&path, t)), way(&|p| at(p, 0.0)));
                ax * wx + ay * wy
            };
            let slid = |low, high| integrate(&rule, low, high, |s| work(&|p, t| p.slides(t, s)));
            let bending = |path: &Path| {
                let (q, a) = path.now(0.0);
                let bend = |xi| Path::value(&path.field.place(a, xi).curvature, &q).powi(2);
                let (ei1, ei2) = (arm.link1.bending_stiffness, arm.link2.bending_stiffness);
                0.5 * (ei1 * integrate(&rule, 0.0, l1, bend)
                    + ei2 * integrate(&rule, l1 + a - l2, l1, bend)
                    + ei2 * integrate(&rule, l1 * (1.0 + 1e-12), l1 + a, bend))
            };
            let slope_way = (on.turn(0.0) - back.turn(0.0)) / (2.0 * h);
            let force = rho2 * (slid(0.0, l2 - a) + slid(l2 - a, l2))
                + mp * work(&|p, t| p.payload(t))
                + (couple - tip_torque) * slope_way
                + (bending(&on) - bending(&back)) / (2.0 * h);
            assert!(
                (found.deployment - force).abs() < 1e-3 * force.abs(),
                "{} {force}",
                found.deployment
            );
        }
    }

    /// With what squares of deflections add, the momentum is that of the plant.
    #[test]
    fn momentum_is_that_of_the_plant() {
        for offset in [0.0, 0.08] {
            let (path, plant) = path(offset);
            let [q, v, accel] = path.q;
            let extension = Extension {
                length: path.a[0],
                rate: path.a[1],
                accel: path.a[2],
            };
            let found = LoadModel::consistent(&plant).at(&Moving {
                q: &q,
                v: &v,
                accel: &accel,
                extension: &extension,
                tip_torque: 0.0,
            });
            let state = crate::plant::consistent::ConsistentState::new(q, v);
            let none = crate::plant::Torques {
                slew: 0.0,
                root: 0.0,
                tip: 0.0,
            };
            let turned = plant.instant(&state, &none, &extension).turned_momentum;
            let momentum = plant.angular_momentum(&state, &extension);
            let difference = found.momentum + turned - momentum;
            assert!(
                difference.abs() < 1e-9 * momentum.abs(),
                "{difference} of {momentum}"
            );
        }
    }
}
