//! The two elastic modes of the thesis plant, from its closed form.

use nalgebra::{Matrix2, Matrix3, SymmetricEigen};

use crate::arm::{Arm, PayloadProperties};
use crate::plant::Dynamics;
use crate::plant::thesis::Constants;
use crate::reference::Extension;

/// The two elastic modes of the thesis plant at rest and at a fixed length; the rigid rotation is
/// left out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ElasticModes {
    /// Angular frequencies, rising, rad/s.
    pub frequencies: [f64; 2],
    /// Shapes (theta, alpha, beta), one a mode, scaled to unit tip displacement
    /// R theta + 2 (alpha + beta) = 1 where that is not zero.
    pub shapes: [[f64; 3]; 2],
}

/// Mass and bending stiffness at rest, as matrices.
pub fn matrices_at_rest(
    arm: &Arm,
    payload: &PayloadProperties,
    extension: f64,
) -> (Matrix3<f64>, Matrix3<f64>) {
    let still = Extension {
        length: extension,
        rate: 0.0,
        accel: 0.0,
    };
    let m = Constants::new(arm, payload, &Dynamics::default()).matrices(&still, false, false);
    let dense = |rows: [[f64; 3]; 3]| Matrix3::from_fn(|i, j| rows[i][j]);
    (dense(m.mass), dense(m.stiffness))
}

/// Solves K x = w^2 M x of the free arm: theta has no stiffness and is eliminated.
pub fn elastic_modes(arm: &Arm, payload: &PayloadProperties, extension: f64) -> ElasticModes {
    let (m, k) = matrices_at_rest(arm, payload, extension);
    let elastic = |full: &Matrix3<f64>| full.fixed_view::<2, 2>(1, 1).into_owned();
    let coupling = nalgebra::Vector2::new(m[(0, 1)], m[(0, 2)]);
    let mass = elastic(&m) - coupling * coupling.transpose() / m[(0, 0)];
    let inverse_root = inverse_square_root(&mass);
    let eigen = SymmetricEigen::new(inverse_root * elastic(&k) * inverse_root);
    let mut order = [0, 1];
    if eigen.eigenvalues[0] > eigen.eigenvalues[1] {
        order = [1, 0];
    }
    let reach = arm.link1.length + extension;
    let shape = |column: usize| {
        let x = inverse_root * eigen.eigenvectors.column(column);
        let theta = -coupling.dot(&x) / m[(0, 0)];
        let tip = reach * theta + 2.0 * (x[0] + x[1]);
        let scale = if tip.abs() > 1e-12 { 1.0 / tip } else { 1.0 };
        [theta * scale, x[0] * scale, x[1] * scale]
    };
    ElasticModes {
        frequencies: order.map(|i| libm::sqrt(eigen.eigenvalues[i].max(0.0))),
        shapes: order.map(shape),
    }
}

/// Elastic angular frequencies at a length, rising, rad/s: the roots of det(K - w^2 M) = 0 with theta
/// eliminated.
pub fn elastic_frequencies(arm: &Arm, payload: &PayloadProperties, extension: f64) -> [f64; 2] {
    let (m, k) = matrices_at_rest(arm, payload, extension);
    let reduced = |i: usize, j: usize| m[(i, j)] - m[(0, i)] * m[(0, j)] / m[(0, 0)];
    let (maa, mab, mbb) = (reduced(1, 1), reduced(1, 2), reduced(2, 2));
    let (kaa, kab, kbb) = (k[(1, 1)], k[(1, 2)], k[(2, 2)]);
    let mass = maa * mbb - mab * mab;
    let mixed = kaa * mbb + kbb * maa - 2.0 * kab * mab;
    let stiffness = kaa * kbb - kab * kab;
    let spread = (mixed * mixed - 4.0 * mass * stiffness).max(0.0);
    let larger = libm::sqrt((mixed + libm::sqrt(spread)) / (2.0 * mass));
    // by the product of the roots: their difference would be lost in rounding
    [libm::sqrt(stiffness / mass) / larger, larger]
}

fn inverse_square_root(matrix: &Matrix2<f64>) -> Matrix2<f64> {
    let eigen = SymmetricEigen::new(*matrix);
    let roots = eigen.eigenvalues.map(|value| 1.0 / libm::sqrt(value));
    eigen.eigenvectors * Matrix2::from_diagonal(&roots) * eigen.eigenvectors.transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arm::PayloadInertia;
    use proptest::prelude::*;

    proptest! {
        /// The closed form against the eigenvalue problem.
        #[test]
        fn frequencies_are_the_roots_of_the_eigenvalues(
            mass in 0.0..3000.0_f64, length in 0.0..3.0_f64, extension in 1.0..8.0_f64,
        ) {
            let payload = PayloadProperties::new(mass, length, 0.5 * length, PayloadInertia::Full);
            let arm = Arm::default();
            let closed = elastic_frequencies(&arm, &payload, extension);
            let modes = elastic_modes(&arm, &payload, extension).frequencies;
            for (closed, mode) in closed.into_iter().zip(modes) {
                prop_assert!((closed - mode).abs() < 1e-8 * mode, "{closed} {mode}");
            }
        }
    }
}
