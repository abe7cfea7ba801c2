//! The eigenvalue problem K x = w^2 M x of a body that turns about the shoulder and deforms.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

use super::beam::{Root, TipBody};
use crate::math::quadrature::gauss_legendre;

/// How the coordinates move one point of the axis: rows over (slew angle, elastic coordinates).
pub(crate) struct Rows {
    /// Transverse displacement, m.
    pub value: DVector<f64>,
    /// Its derivative along the axis.
    pub slope: DVector<f64>,
    /// Second derivative of the elastic part, 1/m.
    pub curvature: DVector<f64>,
}

/// A family of displacement fields of the axis.
pub(crate) trait Field {
    /// Number of elastic coordinates.
    fn size(&self) -> usize;
    /// Rows at a distance (m) from the shoulder.
    fn at(&self, distance: f64) -> Rows;
}

/// A stretch of the axis over which field and properties are smooth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Stretch {
    /// Distance of its start from the shoulder, m.
    pub start: f64,
    /// Distance of its end, m.
    pub end: f64,
    /// kg/m.
    pub mass_per_length: f64,
    /// N m^2.
    pub bending_stiffness: f64,
}

/// One natural vibration: angular frequency (rad/s) and coordinates, the rotations first.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Eigenpair {
    pub frequency: f64,
    pub coordinates: DVector<f64>,
}

/// Mass and stiffness over (rotations about the shoulder, elastic coordinates); the rotations have no
/// stiffness.
pub(crate) struct Pencil {
    pub mass: DMatrix<f64>,
    pub stiffness: DMatrix<f64>,
    /// How many coordinates are rotations.
    pub rotations: usize,
    /// Whether the rotations are held.
    pub clamped: bool,
}

impl Pencil {
    /// Integrates kinetic and bending energy of a field with `points` Gauss points a stretch.
    pub fn assemble(
        field: &impl Field,
        stretches: &[Stretch],
        points: usize,
        root: &Root,
        tip: &TipBody,
        reach: f64,
    ) -> Self {
        let size = field.size() + 1;
        let mut mass = DMatrix::zeros(size, size);
        let mut stiffness = DMatrix::zeros(size, size);
        let rule = gauss_legendre(points);
        for s in stretches {
            let half = (s.end - s.start) / 2.0;
            for &(x, weight) in &rule {
                let rows = field.at(s.start + half * (1.0 + x));
                let weight = weight * half;
                mass.ger(weight * s.mass_per_length, &rows.value, &rows.value, 1.0);
                let bending = weight * s.bending_stiffness;
                stiffness.ger(bending, &rows.curvature, &rows.curvature, 1.0);
            }
        }
        if let Root::Hub { inertia, .. } = root {
            mass[(0, 0)] += inertia;
        }
        let end = field.at(reach);
        let centre = &end.value + &end.slope * tip.offset;
        mass.ger(tip.mass, &centre, &centre, 1.0);
        mass.ger(tip.inertia_centre, &end.slope, &end.slope, 1.0);
        Self {
            mass,
            stiffness,
            rotations: 1,
            clamped: matches!(root, Root::Clamped),
        }
    }

    /// Elastic vibrations by rising frequency, those lost in rounding left out.
    pub fn eigenpairs(&self) -> Vec<Eigenpair> {
        let r = self.rotations;
        let n = self.mass.nrows() - r;
        if n == 0 {
            return Vec::new();
        }
        let coupling = self.mass.view((r, 0), (n, r)).into_owned();
        let mut mass = self.mass.view((r, r), (n, n)).into_owned();
        let mut turn_per = DMatrix::zeros(r, n);
        if !self.clamped {
            // a free vibration has no angular momentum about the shoulder
            let Some(inertia) = self.mass.view((0, 0), (r, r)).into_owned().cholesky() else {
                return Vec::new();
            };
            turn_per = -inertia.solve(&coupling.transpose());
        }
        mass += &coupling * &turn_per;
        let stiffness = self.stiffness.view((r, r), (n, n)).into_owned();
        let Some(factor) = stiffness.cholesky() else {
            return Vec::new();
        };
        // 1/w^2 are the eigenvalues of L^-1 M L^-T: so the low frequencies are the accurate ones
        let lower = factor.l();
        let half = lower.solve_lower_triangular(&mass).unwrap_or_default();
        let mut scaled = lower
            .solve_lower_triangular(&half.transpose())
            .unwrap_or_default();
        scaled = (&scaled + scaled.transpose()) / 2.0;
        let eigen = SymmetricEigen::new(scaled);
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by(|&i, &j| eigen.eigenvalues[j].total_cmp(&eigen.eigenvalues[i]));
        let resolved = eigen.eigenvalues[order[0]] * f64::EPSILON * n as f64;
        order
            .into_iter()
            .filter(|&i| eigen.eigenvalues[i] > resolved)
            .map(|i| {
                let vector = eigen.eigenvectors.column(i).into_owned();
                let elastic = lower
                    .tr_solve_lower_triangular(&vector)
                    .unwrap_or_else(|| vector.clone());
                let mut coordinates = DVector::zeros(r + n);
                coordinates
                    .rows_mut(0, r)
                    .copy_from(&(&turn_per * &elastic));
                coordinates.rows_mut(r, n).copy_from(&elastic);
                Eigenpair {
                    frequency: 1.0 / libm::sqrt(eigen.eigenvalues[i]),
                    coordinates,
                }
            })
            .collect()
    }
}
