//! The consistent plant at a fixed length against another model of the same arm: a chain of rigid pieces
//! with springs in between, whose positions are exact. Nothing is linearised there, no shape is assumed,
//! and the shortening of the bent arm is geometry instead of an axial load.

// the measured figures, with --nocapture
#![allow(clippy::print_stdout)]

use drm_env::arm::{Arm, PayloadInertia, PayloadProperties};
use drm_env::math::generalized_alpha::GeneralizedAlpha;
use drm_env::plant::consistent::ConsistentPlant;
use drm_env::plant::{Dynamics, RigidInertia, Torques};
use drm_env::reference::Extension;
use drm_env::reference::timeline::Piece;
use nalgebra::{DMatrix, DVector};

/// A flight at a fixed extension that begins straight and turning; the motor's torque gives a rigid arm
/// `accel` for half of the time and takes it away in the other half.
#[derive(Clone, Copy, Debug)]
struct Case {
    mass: f64,
    extension: f64,
    /// rad/s.
    rate: f64,
    /// rad/s^2.
    accel: f64,
    /// s.
    duration: f64,
    /// Of the payload's centre of mass from the axis, m.
    offset: f64,
}

const SAMPLE: f64 = 0.01;

/// What is seen of a flight, a sample each: the angle under which the tip is seen from the shoulder less that
/// of a rigid arm, and how far link 1's end is seen ahead of the tip.
const BEND: usize = 1;

impl Case {
    fn payload(&self) -> PayloadProperties {
        PayloadProperties {
            offset: self.offset,
            ..PayloadProperties::new(self.mass, 1.5, 0.75, PayloadInertia::Full)
        }
    }

    fn samples(&self) -> usize {
        (self.duration / SAMPLE).round() as usize
    }

    fn torque(&self, sample: usize) -> f64 {
        let inertia = RigidInertia::new(&Arm::default(), &self.payload()).at(self.extension);
        let sign = if 2 * sample < self.samples() {
            1.0
        } else {
            -1.0
        };
        sign * self.accel * inertia
    }

    /// Angle of a rigid arm after so many samples.
    fn rigid(&self, sample: usize) -> f64 {
        let (t, half) = (sample as f64 * SAMPLE, self.duration / 2.0);
        let late = (t - half).max(0.0);
        self.rate * t + self.accel * (t * t / 2.0 - late * late)
    }
}

/// Rigid pieces by their absolute angles: half a length at both ends of the arm, so that every spring
/// stands in the middle of what it replaces.
struct Chain {
    /// Sum over all masses of the products of their distances along the pieces.
    coupling: DMatrix<f64>,
    /// Moments of inertia of the pieces about their centres.
    spin: DVector<f64>,
    springs: Vec<f64>,
    lengths: Vec<f64>,
    /// Mass of the payload and its distance from the last piece's line.
    off_axis: (f64, f64),
    /// Its distance along each piece.
    levers: DVector<f64>,
}

impl Chain {
    fn new(case: &Case, springs: usize) -> Self {
        let arm = Arm::default();
        let (l1, reach) = (arm.link1.length, arm.link1.length + case.extension);
        let start = reach - arm.link2.length;
        // density and stiffness between the ends of the links
        let along = |low: f64, high: f64, of: &dyn Fn(f64, f64, [f64; 2])| {
            let mut edges = vec![low, high];
            edges.extend([start, l1].into_iter().filter(|x| *x > low && *x < high));
            edges.sort_by(f64::total_cmp);
            edges.dedup();
            for pair in edges.windows(2) {
                let middle = (pair[0] + pair[1]) / 2.0;
                let mut sum = [0.0; 2];
                if middle < l1 {
                    sum = [arm.link1.mass_per_length, arm.link1.bending_stiffness];
                }
                if middle > start {
                    sum[0] += arm.link2.mass_per_length;
                    sum[1] += arm.link2.bending_stiffness;
                }
                of(pair[0], pair[1], sum);
            }
        };
        let h = reach / springs as f64;
        let count = springs + 1;
        let edge = |k: usize| if k == 0 { 0.0 } else { (k as f64 - 0.5) * h }.min(reach);
        let lengths: Vec<f64> = (0..count).map(|k| edge(k + 1) - edge(k)).collect();
        let mut coupling = DMatrix::zeros(count, count);
        let mut spin = DVector::zeros(count);
        let mut add = |piece: usize, mass: f64, along: f64, inertia: f64| {
            let lever = |k: usize| if k < piece { lengths[k] } else { along };
            for i in 0..=piece {
                for k in 0..=piece {
                    coupling[(i, k)] += mass * lever(i) * lever(k);
                }
            }
            spin[piece] += inertia;
        };
        let parts = std::cell::RefCell::new(Vec::new());
        for k in 0..count {
            along(edge(k), edge(k + 1), &|low, high, [density, _]| {
                let (mass, size) = (density * (high - low), high - low);
                let centre = (low + high) / 2.0 - edge(k);
                parts
                    .borrow_mut()
                    .push((k, mass, centre, mass * size * size / 12.0));
            });
        }
        for (piece, mass, centre, inertia) in parts.into_inner() {
            add(piece, mass, centre, inertia);
        }
        let payload = case.payload();
        let last = count - 1;
        let centre = lengths[last] + payload.length / 2.0;
        add(last, payload.mass, centre, payload.inertia_centre);
        let mut levers = DVector::from_column_slice(&lengths);
        levers[last] = centre;
        let springs = (0..springs)
            .map(|k| {
                let soft = std::cell::Cell::new(0.0);
                along(
                    k as f64 * h,
                    (k + 1) as f64 * h,
                    &|low, high, [_, stiff]| {
                        soft.set(soft.get() + (high - low) / stiff);
                    },
                );
                1.0 / soft.get()
            })
            .collect();
        Self {
            coupling,
            spin,
            springs,
            lengths,
            off_axis: (payload.mass, payload.offset),
            levers,
        }
    }

    /// Angular accelerations.
    fn accelerations(
        &self,
        angles: &DVector<f64>,
        rates: &DVector<f64>,
        torque: f64,
    ) -> DVector<f64> {
        let count = angles.len();
        let mut force = DVector::zeros(count);
        force[0] = torque;
        for (k, spring) in self.springs.iter().enumerate() {
            let moment = spring * (angles[k + 1] - angles[k]);
            force[k] += moment;
            force[k + 1] -= moment;
        }
        let turned: Vec<(f64, f64)> = angles.iter().map(|angle| angle.sin_cos()).collect();
        let mut mass = DMatrix::from_diagonal(&self.spin);
        for (i, (sin, cos)) in turned.iter().enumerate() {
            for (k, (sin_k, cos_k)) in turned.iter().enumerate() {
                // of the difference of the two angles
                mass[(i, k)] += self.coupling[(i, k)] * (cos * cos_k + sin * sin_k);
                let across = sin * cos_k - cos * sin_k;
                force[i] -= self.coupling[(i, k)] * across * rates[k] * rates[k];
            }
        }
        // the payload's way from the line, at a right angle to the last piece
        let (payload, offset) = self.off_axis;
        let last = count - 1;
        mass[(last, last)] += payload * offset * offset;
        for (k, (sin, cos)) in turned.iter().enumerate() {
            let (sin_last, cos_last) = turned[last];
            let coupling = payload * offset * self.levers[k];
            let along = coupling * (cos * sin_last - sin * cos_last);
            let across = coupling * (cos * cos_last + sin * sin_last);
            mass[(k, last)] -= along;
            mass[(last, k)] -= along;
            force[k] += across * rates[last] * rates[last];
            force[last] -= across * rates[k] * rates[k];
        }
        mass.cholesky()
            .expect("M is positive definite")
            .solve(&force)
    }

    /// What is seen of it.
    fn fly(&self, case: &Case, steps: usize) -> Vec<[f64; 2]> {
        let count = self.lengths.len();
        let mut x = DVector::zeros(count);
        let mut v = DVector::from_element(count, case.rate);
        let h = SAMPLE / steps as f64;
        let mut seen = Vec::new();
        for sample in 0..case.samples() {
            let torque = case.torque(sample);
            for _ in 0..steps {
                let k1 = self.accelerations(&x, &v, torque);
                let v2 = &v + &k1 * (h / 2.0);
                let k2 = self.accelerations(&(&x + &v * (h / 2.0)), &v2, torque);
                let v3 = &v + &k2 * (h / 2.0);
                let k3 = self.accelerations(&(&x + &v2 * (h / 2.0)), &v3, torque);
                let v4 = &v + &k3 * h;
                let k4 = self.accelerations(&(&x + &v3 * h), &v4, torque);
                x += (&v + &v2 * 2.0 + &v3 * 2.0 + &v4) * (h / 6.0);
                v += (k1 + k2 * 2.0 + k3 * 2.0 + k4) * (h / 6.0);
            }
            // about the rigid arm's angle, so that nothing wraps around
            let rigid = case.rigid(sample + 1);
            let angle_of = |until: f64| {
                let (mut along, mut across, mut left) = (0.0, 0.0, until);
                for (length, angle) in self.lengths.iter().zip(x.iter()) {
                    let (sin, cos) = (angle - rigid).sin_cos();
                    along += length.min(left) * cos;
                    across += length.min(left) * sin;
                    left = (left - length).max(0.0);
                }
                across.atan2(along)
            };
            let tip = angle_of(1e9);
            seen.push([tip, angle_of(Arm::default().link1.length) - tip]);
        }
        seen
    }
}

fn fly_plant(case: &Case, dynamics: &Dynamics, modes: usize, step: f64) -> Vec<[f64; 2]> {
    let a = case.extension;
    let plant = ConsistentPlant::new(
        &Arm::default(),
        &case.payload(),
        dynamics,
        (modes, modes),
        (a, a),
    )
    .expect("the plant exists");
    let scheme = GeneralizedAlpha::default();
    let piece = Piece {
        start: 0.0,
        angle: 0.0,
        rate: 0.0,
        accel: [0.0; 4],
        extension: a,
        extension_rate: 0.0,
        extension_accel: 0.0,
    };
    let extension = Extension {
        length: a,
        rate: 0.0,
        accel: 0.0,
    };
    let mut state = plant.released((0.0, case.rate), (0.0, 0.0), (0.0, 0.0));
    let steps = (SAMPLE / step).round() as usize;
    let reach = Arm::default().link1.length + a;
    (0..case.samples())
        .map(|sample| {
            let torques = Torques {
                slew: case.torque(sample),
                root: 0.0,
                tip: 0.0,
            };
            for _ in 0..steps {
                plant.step(&scheme, &mut state, &[torques; 3], &piece, 0.0, step);
            }
            let [l1, w1] = [
                Arm::default().link1.length,
                plant.link1_deflection(&state).0,
            ];
            let tip = (plant.tip_deflection(&state, &extension).0 / reach).atan();
            [
                state.q[0] + tip - case.rigid(sample + 1),
                (w1 / l1).atan() - tip,
            ]
        })
        .collect()
}

/// Root mean square of a signal.
fn rms(x: &[f64]) -> f64 {
    (x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64).sqrt()
}

fn signal(flown: &[[f64; 2]], which: usize) -> Vec<f64> {
    flown.iter().map(|row| row[which]).collect()
}

fn apart(x: &[f64], y: &[f64]) -> f64 {
    rms(&x.iter().zip(y).map(|(x, y)| x - y).collect::<Vec<_>>()) / rms(y)
}

/// Where the chain goes as its pieces become short: it converges with the square of their length.
fn limit(case: &Case, which: usize) -> Vec<f64> {
    let [coarse, fine] = [(15, 90), (30, 360)].map(|(pieces, steps)| {
        let flown = Chain::new(case, pieces).fly(case, steps);
        signal(&flown, which)
    });
    let third = |(coarse, fine): (&f64, &f64)| fine + (fine - coarse) / 3.0;
    coarse.iter().zip(&fine).map(third).collect()
}

/// Fast turning arms and heavy payloads, bent by little: the arm bends as the chain does. Without the axial
/// load, or with one that begins at the root of link 2 instead of the shoulder, they have nothing in common.
#[test]
fn bending_of_a_turning_arm_is_that_of_a_chain_of_rigid_pieces() {
    let cases = [
        (450.0, 8.0, 2.0, 0.002, 3.0),
        // the shapes know little of where link 2 begins inside link 1: 1 % of the frequency, soon out of step
        (450.0, 4.0, 4.0, 0.002, 0.6),
        (3000.0, 8.0, 1.0, 0.0005, 3.0),
        (30_000.0, 8.0, 0.3, 0.00005, 3.0),
    ];
    for (mass, extension, rate, accel, duration) in cases {
        let case = Case {
            mass,
            extension,
            rate,
            accel,
            duration,
            offset: 0.0,
        };
        let limit = limit(&case, BEND);
        let of = |axial_load: bool| {
            let dynamics = Dynamics {
                axial_load,
                ..Dynamics::default()
            };
            apart(
                &signal(&fly_plant(&case, &dynamics, 6, 2.5e-4), BEND),
                &limit,
            )
        };
        let (with, without) = (of(true), of(false));
        println!(
            "{case:?}: {with:.4} of {:.3e} rad, without axial load {without:.3e}",
            rms(&limit)
        );
        assert!(with < 0.05, "{case:?}: {with}");
        assert!(
            without.is_nan() || without > 5.0 * with,
            "{case:?}: {without}"
        );
    }
}

/// What the plant leaves out: a bent arm draws its payload near, and at the rate of the vibration that
/// takes a force, too. It grows with the payload and the square of the deflection.
#[test]
fn what_is_left_out_shrinks_with_the_square_of_the_deflection() {
    let apart_at = |accel: f64| {
        let case = Case {
            mass: 3000.0,
            extension: 8.0,
            rate: 0.0,
            accel,
            duration: 1.0,
            offset: 0.0,
        };
        let limit = limit(&case, BEND);
        let found = signal(&fly_plant(&case, &Dynamics::default(), 6, 2.5e-4), BEND);
        (apart(&found, &limit), rms(&limit))
    };
    let [(large, bend), (half, half_bend)] = [0.01, 0.005].map(apart_at);
    println!("{large:.4} of {bend:.3e} rad, {half:.4} of {half_bend:.3e} rad");
    assert!(large > 2.5 * half && large < 0.2, "{large} {half}");
}

/// A payload whose centre of mass is off the axis bends the arm as it is pulled outwards, and turns with the
/// tip.
#[test]
fn a_payload_off_the_axis_bends_the_arm_as_it_bends_the_chain() {
    for (mass, extension, rate, accel, duration, offset) in [
        (200.0, 8.0, 0.5, 0.002, 2.0, 0.2),
        (450.0, 3.0, 1.0, 0.0, 1.0, -0.3),
    ] {
        let case = Case {
            mass,
            extension,
            rate,
            accel,
            duration,
            offset,
        };
        let limit = limit(&case, BEND);
        let found = signal(&fly_plant(&case, &Dynamics::default(), 6, 2.5e-4), BEND);
        let on_axis = Case {
            offset: 0.0,
            ..case
        };
        let without = signal(&fly_plant(&on_axis, &Dynamics::default(), 6, 2.5e-4), BEND);
        let (with, without) = (apart(&found, &limit), apart(&without, &limit));
        println!(
            "{case:?}: {with:.4} of {:.3e} rad, on the axis {without:.3e}",
            rms(&limit)
        );
        assert!(
            with < 0.05 && without > 5.0 * with,
            "{case:?}: {with} {without}"
        );
    }
}
