//! The exact characteristic problem of a uniform Euler-Bernoulli beam, clamped or on a hub, with a
//! rigid body at its tip: thesis section 2.3 for the arm with rigid link 1.
//!
//! With z = k a, w^2 = k^4 EI / rho and a the beam's length, frequencies are found in two ways.
//! The problem as it should be is self-adjoint: the number of frequencies below z is known
//! exactly (W. H. Wittrick and F. W. Williams, Q. J. Mech. Appl. Math. 24, 1971), and bisection
//! on that number neither misses nor doubles one. The thesis' printed conditions are not
//! self-adjoint: there the roots of the determinant are bracketed on a grid much finer than their
//! asymptotic spacing pi.

use std::f64::consts::PI;

use nalgebra::{Matrix4, Vector4};

use super::beam::{Root, UniformBeam};
use super::{ModeShapes, normalised, places};

/// Which boundary conditions are solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Conditions {
    /// Those of a rigid body at the tip.
    #[default]
    Correct,
    /// Without the tip slope's share in the shear condition, and with the hub's angle in place of
    /// it in the angular momentum: what the published figures of Tables 2-4 and 2-8 solve.
    AsPublished,
}

/// Grid points per asymptotic root spacing when roots are bracketed.
const GRID: f64 = 64.0;

/// Nearness to a pole of the dynamic stiffness at which its pivots lose their signs in rounding.
const POLE: f64 = 1e-9;

/// A uniform beam in numbers without dimension: lengths over a, masses over rho a.
#[derive(Debug, Clone, Copy)]
struct Scaled {
    clamped: bool,
    radius: f64,
    hub: f64,
    mass: f64,
    /// mass times offset of the body's centre
    moment: f64,
    /// about the tip of the beam
    inertia: f64,
}

impl Scaled {
    fn new(beam: &UniformBeam) -> Self {
        let a = beam.segment.length;
        let unit = beam.segment.mass_per_length * a;
        let (clamped, radius, hub) = match beam.root {
            Root::Clamped => (true, 0.0, 0.0),
            Root::Hub { radius, inertia } => (false, radius / a, inertia / (unit * a * a)),
        };
        Self {
            clamped,
            radius,
            hub,
            mass: beam.tip.mass / unit,
            moment: beam.tip.mass * beam.tip.offset / (unit * a),
            inertia: beam.tip.inertia_attachment() / (unit * a * a),
        }
    }

    /// The four boundary conditions (rows, each of unit length) on the coefficients of
    /// sin zu, cos zu, exp(-zu), exp(-z(1-u)): all four stay below 1 for every z.
    fn boundary_matrix(&self, z: f64, conditions: Conditions) -> Matrix4<f64> {
        let e = libm::exp(-z);
        // displacement and its derivatives over k, k^2, k^3 at u = 0 and u = 1
        let at = |s: f64, c: f64, decaying: f64, growing: f64| {
            [
                Vector4::new(s, c, decaying, growing),
                Vector4::new(c, -s, -decaying, growing),
                Vector4::new(-s, -c, decaying, growing),
                Vector4::new(-c, s, -decaying, growing),
            ]
        };
        let root = at(0.0, 1.0, 1.0, e);
        let tip = at(libm::sin(z), libm::cos(z), e, 1.0);
        let (mut hub, mut shear_from_slope) = (self.hub, z * z * self.moment);
        if conditions == Conditions::AsPublished {
            hub += self.moment * (self.radius + 1.0);
            shear_from_slope = 0.0;
        }
        let (first, second) = if self.clamped {
            (root[0], root[1])
        } else {
            let arm = self.radius * z;
            (
                root[0] - root[1] * arm,
                root[2] - root[3] * arm + root[1] * (z * z * z * hub),
            )
        };
        let bending = tip[2] - tip[1] * (z * z * z * self.inertia) - tip[0] * (z * z * self.moment);
        let shear = tip[3] + tip[0] * (z * self.mass) + tip[1] * shear_from_slope;
        let rows = [first, second, bending, shear].map(|row| row.normalize().transpose());
        Matrix4::from_rows(&rows)
    }

    fn determinant(&self, z: f64, conditions: Conditions) -> f64 {
        self.boundary_matrix(z, conditions).determinant()
    }

    /// Number of natural frequencies below z, a free rotation included: those of the beam held at
    /// both ends, and the negative pivots of the dynamic stiffness of its ends.
    fn count_below(&self, z: f64) -> usize {
        // 1 - cosh z cos z over cosh z: zero at the frequencies of the beam held at both ends, at
        // which the dynamic stiffness is infinite; it is looked at just beyond them
        let held = |z: f64| 2.0 * libm::exp(-z) / (1.0 + libm::exp(-2.0 * z)) - libm::cos(z);
        let z = if held(z).abs() < POLE {
            z + 2.0 * POLE
        } else {
            z
        };
        let held = held(z);
        let sech = 1.0 / libm::cosh(z);
        let tanh = libm::tanh(z);
        let (s, c) = (libm::sin(z), libm::cos(z));
        let half_waves = (z / PI).floor();
        let even = half_waves % 2.0 == 0.0;
        let held_count = if even == (held > 0.0) {
            half_waves
        } else {
            half_waves - 1.0
        };
        let shear = z * z * z * (s + c * tanh) / held;
        let mixed = z * z * s * tanh / held;
        let bending = z * (s - c * tanh) / held;
        let far_shear = -z * z * z * (s * sech + tanh) / held;
        let far_mixed = z * z * (1.0 - c * sech) / held;
        let far_bending = z * (tanh - s * sech) / held;
        let z4 = z * z * z * z;
        let r = self.radius;
        // over (hub angle, tip displacement, tip slope)
        let stiffness = [
            [
                r * r * shear + 2.0 * r * mixed + bending - z4 * self.hub,
                r * far_shear - far_mixed,
                r * far_mixed + far_bending,
            ],
            [0.0, shear - z4 * self.mass, -mixed - z4 * self.moment],
            [0.0, 0.0, bending - z4 * self.inertia],
        ];
        held_count as usize + negative_pivots(stiffness, usize::from(self.clamped))
    }
}

/// Number of negative pivots when a symmetric matrix, given by its upper triangle, is eliminated
/// from row `first` on.
fn negative_pivots(mut upper: [[f64; 3]; 3], first: usize) -> usize {
    let mut negative = 0;
    for k in first..3 {
        let row = upper[k];
        negative += usize::from(row[k] < 0.0);
        for i in k + 1..3 {
            for j in i..3 {
                upper[i][j] -= row[i] * row[j] / row[k];
            }
        }
    }
    negative
}

/// Wave numbers z = k a of the first `count` elastic vibrations, rising.
fn wave_numbers(beam: &UniformBeam, conditions: Conditions, count: usize) -> Vec<f64> {
    let scaled = Scaled::new(beam);
    match conditions {
        Conditions::Correct => {
            let rigid = usize::from(!scaled.clamped);
            let near = (1..=count).map(|i| by_count(&scaled, rigid + i));
            near.map(|z| polished(&scaled, z)).collect()
        }
        Conditions::AsPublished => by_determinant(&scaled, conditions, count),
    }
}

/// The smallest z with `target` frequencies below or at it, to rounding.
fn by_count(scaled: &Scaled, target: usize) -> f64 {
    let (mut low, mut high) = (0.0, PI * target as f64);
    while scaled.count_below(high) < target {
        (low, high) = (high, high + PI);
    }
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return high;
        }
        if scaled.count_below(middle) < target {
            low = middle;
        } else {
            high = middle;
        }
    }
}

/// The count is uncertain where a frequency nearly coincides with one of the beam held at both
/// ends ([`POLE`]); the determinant is not.
fn polished(scaled: &Scaled, z: f64) -> f64 {
    let f = |z: f64| scaled.determinant(z, Conditions::Correct);
    let (low, high) = (z * (1.0 - 10.0 * POLE), z * (1.0 + 10.0 * POLE));
    if (f(low) > 0.0) == (f(high) > 0.0) {
        return z;
    }
    root_between(low, high, f)
}

/// A root where f changes its sign, to rounding.
fn root_between(mut low: f64, mut high: f64, f: impl Fn(f64) -> f64) -> f64 {
    let positive = f(low) > 0.0;
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return high;
        }
        if (f(middle) > 0.0) == positive {
            low = middle;
        } else {
            high = middle;
        }
    }
}

/// Roots of the determinant. Between grid points it may dip through zero and back: wherever its
/// magnitude has a minimum on the grid without a change of sign, the minimum is searched too.
fn by_determinant(scaled: &Scaled, conditions: Conditions, count: usize) -> Vec<f64> {
    let step = PI / GRID;
    let f = |z: f64| scaled.determinant(z, conditions);
    let root = |low: f64, high: f64| root_between(low, high, f);
    let mut roots = Vec::new();
    let mut z = [step, 2.0 * step, 3.0 * step];
    let mut values = z.map(f);
    if (values[0] > 0.0) != (values[1] > 0.0) {
        roots.push(root(z[0], z[1]));
    }
    // far beyond the roots: an end for numbers that are not finite
    let end = PI * (2 * count + 64) as f64;
    while roots.len() < count && z[2] < end {
        let signs = values.map(|value| value > 0.0);
        if signs[1] != signs[2] {
            roots.push(root(z[1], z[2]));
        } else if signs[0] == signs[1]
            && values[1].abs() < values[0].abs()
            && values[1].abs() < values[2].abs()
        {
            let dip = smallest(z[0], z[2], |z| f(z).abs(), |z| (f(z) > 0.0) != signs[0]);
            if (f(dip) > 0.0) != signs[0] {
                roots.push(root(z[0], dip));
                roots.push(root(dip, z[2]));
            }
        }
        let next = z[2] + step;
        z = [z[1], z[2], next];
        values = [values[1], values[2], f(next)];
    }
    roots.truncate(count);
    roots
}

/// Ternary search of a minimum, which ends early where `done` holds.
fn smallest(
    mut low: f64,
    mut high: f64,
    f: impl Fn(f64) -> f64,
    done: impl Fn(f64) -> bool,
) -> f64 {
    for _ in 0..60 {
        let third = (high - low) / 3.0;
        let (a, b) = (low + third, high - third);
        for z in [a, b] {
            if done(z) {
                return z;
            }
        }
        if f(a) < f(b) {
            high = b;
        } else {
            low = a;
        }
    }
    0.5 * (low + high)
}

/// The first `count` elastic angular frequencies, rising, rad/s.
pub fn frequencies(beam: &UniformBeam, conditions: Conditions, count: usize) -> Vec<f64> {
    let numbers = wave_numbers(beam, conditions, count);
    numbers.into_iter().map(|z| frequency(beam, z)).collect()
}

fn frequency(beam: &UniformBeam, z: f64) -> f64 {
    let segment = &beam.segment;
    let k = z / segment.length;
    k * k * libm::sqrt(segment.bending_stiffness / segment.mass_per_length)
}

/// The first `count` elastic mode shapes under the correct conditions, from the axis of rotation
/// to the tip, at `points` places.
pub fn mode_shapes(beam: &UniformBeam, count: usize, points: usize) -> ModeShapes {
    let scaled = Scaled::new(beam);
    let numbers = wave_numbers(beam, Conditions::Correct, count);
    let positions = places(beam.root.radius() + beam.segment.length, points);
    let shape = |&z: &f64| {
        let matrix = scaled.boundary_matrix(z, Conditions::Correct);
        // the coefficients that the conditions send to zero
        let svd = matrix.svd(false, true);
        let null = svd.singular_values.imin();
        let c = svd.v_t.unwrap_or_default().row(null).transpose();
        let displacement = |&x: &f64| {
            let u = (x - beam.root.radius()) / beam.segment.length;
            if u <= 0.0 {
                // the hub turns by the slope at the root
                let slope = z * (c[0] - c[2] + c[3] * libm::exp(-z));
                return slope * x / beam.segment.length;
            }
            c[0] * libm::sin(z * u)
                + c[1] * libm::cos(z * u)
                + c[2] * libm::exp(-z * u)
                + c[3] * libm::exp(-z * (1.0 - u))
        };
        normalised(positions.iter().map(displacement).collect())
    };
    ModeShapes {
        displacements: numbers.iter().map(shape).collect(),
        frequencies: numbers.iter().map(|&z| frequency(beam, z)).collect(),
        positions,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arm::{Arm, PayloadInertia, PayloadProperties, TABLE_2_7};

    #[test]
    fn count_and_determinant_find_the_same_roots() {
        let arm = Arm::default();
        for (mass, length, width) in TABLE_2_7 {
            let payload = PayloadProperties::new(mass, length, width, PayloadInertia::Full);
            for extension in [1.0, 2.5, 4.0, 6.3, 8.0] {
                let beam = UniformBeam::rigid_link1(&arm, &payload, extension);
                let counted = wave_numbers(&beam, Conditions::Correct, 40);
                let bracketed = by_determinant(&Scaled::new(&beam), Conditions::Correct, 40);
                for (i, (a, b)) in counted.iter().zip(&bracketed).enumerate() {
                    assert!((a - b).abs() < 1e-11 * a, "{mass} {extension} {i}: {a} {b}");
                }
            }
        }
    }

    #[test]
    fn long_waves_stay_finite_and_follow_their_asymptote() {
        let beam = UniformBeam {
            root: Root::Clamped,
            segment: crate::analysis::modal::Segment {
                length: 1.0,
                mass_per_length: 1.0,
                bending_stiffness: 1.0,
            },
            tip: crate::analysis::modal::TipBody::default(),
        };
        let z = wave_numbers(&beam, Conditions::Correct, 400);
        for (i, z) in z.iter().enumerate().skip(10) {
            assert!((z - PI * (i as f64 + 0.5)).abs() < 1e-10 * z, "{i}: {z}");
        }
    }
}
