//! Damping by a ratio: every natural mode of the arm, as it is at each length, loses the same part of its
//! energy in a cycle.
//!
//! With M and K of the elastic coordinates at a fixed length, M less what the rigid rotation takes
//! (m m^T / J, m the first column of M and J its first entry), the matrix is
//!
//! ```text
//! C = 2 zeta M (M^-1 K)^(1/2)
//! ```
//!
//! of which the modes make 2 zeta times their angular frequencies. It has no row of the slew angle: turning as
//! a whole is not damped. The root is smooth in the length, also where frequencies cross, so that it is
//! tabulated over the logarithm of the length and interpolated by cubics.

use nalgebra::{DMatrix, DVector, Dyn, SymmetricEigen};

use super::arm_tables::packed;

/// At least so many nodes for each doubling of the length; every mode's damping is then within 0.5 % of its ratio.
const PER_OCTAVE: f64 = 10.0;

/// C over the lengths of a flight.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ModalDamping {
    shortest: f64,
    /// Nodes for each doubling of the length.
    per_octave: f64,
    entries: usize,
    nodes: usize,
    /// A node's packed matrix after the other.
    values: Vec<f64>,
}

impl ModalDamping {
    /// For lengths from `low` to `high` (m) and the damping ratio; `matrices` gives M and K of all
    /// coordinates at a length. None where a mass matrix is not one.
    pub fn new(
        (low, high): (f64, f64),
        ratio: f64,
        matrices: impl Fn(f64) -> (DMatrix<f64>, DMatrix<f64>),
    ) -> Option<Self> {
        let octaves = libm::log2(high / low);
        let nodes = (libm::ceil(octaves * PER_OCTAVE) as usize + 1).max(4);
        let per_octave = (nodes - 1) as f64 / octaves;
        let (mut values, mut entries) = (Vec::new(), 0);
        for node in 0..nodes {
            let (mass, stiffness) = matrices(low * libm::exp2(node as f64 / per_octave));
            let root = root(&mass, &stiffness)?;
            for i in 0..root.nrows() {
                for k in 0..=i {
                    values.push(ratio * (root[(i, k)] + root[(k, i)]));
                }
            }
            entries = values.len() / (node + 1);
        }
        Some(Self {
            shortest: low,
            per_octave,
            entries,
            nodes,
            values,
        })
    }

    /// Writes the packed matrix at a length.
    #[inline(always)]
    pub fn at(&self, length: f64, out: &mut [f64]) {
        let place = libm::log2(length / self.shortest) * self.per_octave;
        let first = ((place - 1.0).max(0.0) as usize).min(self.nodes - 4);
        // Lagrange's polynomials on four nodes, x from the second
        let x = place - first as f64 - 1.0;
        let (below, above, beyond) = (x + 1.0, x - 1.0, x - 2.0);
        let weights = [
            -x * above * beyond / 6.0,
            below * above * beyond / 2.0,
            -below * x * beyond / 2.0,
            below * x * above / 6.0,
        ];
        // four rows by name and no closure, so that this is compiled for the instructions of its caller
        let (first, n) = (first * self.entries, self.entries);
        let rows = &self.values[first..first + 4 * n];
        let (row0, rows) = rows.split_at(n);
        let (row1, rows) = rows.split_at(n);
        let (row2, row3) = rows.split_at(n);
        let out = &mut out[..n];
        for e in 0..n {
            let sum = weights[0].mul_add(row0[e], 0.0);
            let sum = weights[1].mul_add(row1[e], sum);
            let sum = weights[2].mul_add(row2[e], sum);
            out[e] = weights[3].mul_add(row3[e], sum);
        }
    }

    /// Size of the tables, bytes.
    pub fn bytes(&self) -> usize {
        self.values.len() * size_of::<f64>()
    }
}

/// M (M^-1 K)^(1/2) of the elastic coordinates.
fn root(mass: &DMatrix<f64>, stiffness: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let (lower, eigen) = eigen(mass, stiffness)?;
    let shapes = lower * eigen.eigenvectors;
    let frequencies = eigen.eigenvalues.map(|square| libm::sqrt(square.max(0.0)));
    Some(&shapes * DMatrix::from_diagonal(&frequencies) * shapes.transpose())
}

/// Natural angular frequencies (rad/s, rising) of an arm at rest, and shapes of the elastic coordinates of
/// unit modal mass. None where the mass matrix is not one.
pub(super) fn modes(
    mass: &DMatrix<f64>,
    stiffness: &DMatrix<f64>,
) -> Option<Vec<(f64, DVector<f64>)>> {
    let (lower, eigen) = eigen(mass, stiffness)?;
    let shapes = lower
        .transpose()
        .solve_upper_triangular(&eigen.eigenvectors)?;
    let squares = eigen.eigenvalues.iter();
    let mut found: Vec<_> = squares
        .zip(shapes.column_iter())
        .map(|(square, shape)| (libm::sqrt(square.max(0.0)), shape.into_owned()))
        .collect();
    found.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    Some(found)
}

/// L and the eigenvalues of L^-1 K L^-T, where L L^T is M of the elastic coordinates less what the rigid
/// rotation takes.
fn eigen(
    mass: &DMatrix<f64>,
    stiffness: &DMatrix<f64>,
) -> Option<(DMatrix<f64>, SymmetricEigen<f64, Dyn>)> {
    let elastic = mass.nrows() - 1;
    let coupling = mass.view((1, 0), (elastic, 1));
    let own =
        mass.view((1, 1), (elastic, elastic)) - coupling * coupling.transpose() / mass[(0, 0)];
    let lower = own.cholesky()?.l();
    let half = lower.solve_lower_triangular(&stiffness.view((1, 1), (elastic, elastic)))?;
    let reduced = lower.solve_lower_triangular(&half.transpose())?;
    let eigen = ((&reduced + reduced.transpose()) * 0.5).symmetric_eigen();
    Some((lower, eigen))
}

/// Place of the entry (i, k) of a symmetric matrix.
#[inline(always)]
pub(super) fn place(i: usize, k: usize) -> usize {
    if k <= i { packed(i, k) } else { packed(k, i) }
}
