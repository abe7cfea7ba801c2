//! The consistent plant: link 2 turns with the end slope of link 1 and its particles are followed
//! (not in the thesis, whose link 2 is carried along without turning).
//!
//! With xi the distance from the shoulder O1 along the rotating axis, link 2 occupies c to R = L1 + a,
//! c = R - L2. The deflection from the axis is
//!
//! ```text
//! w(xi) = y1(xi)                                        0 <= xi <= L1
//! w(xi) = y1(L1) + (xi - L1) y1_x(L1) + y2(xi - L1)     L1 <= xi <= R
//! ```
//!
//! with y1 and y2 sums of n and m assumed shapes, so that q = (theta, n coordinates of link 1, m of
//! link 2). A particle has the transverse velocity B q' + a' D q and the axial velocity a' - theta' W q
//! (in link 1 without a'), where w = W q, B = W with xi as the entry of theta, and D is the change of
//! w per unit of extension, following the particle. The payload is a rigid body centred Lp / 2 beyond
//! the tip. With
//!
//! ```text
//! M = int rho B^T B    G = int rho B^T D    H = int rho D^T D    N = int rho W^T W    (payload included)
//! w1 = int rho W       d1 = int rho D       over link 2 and the payload alone
//! Kb bending,   int P w_x^2 = q^T (theta'^2 P2 - a'' P0) q,   P the axial force,   Z = N - P2
//! ```
//!
//! Lagrange's equations are, with ' the rate following the particles,
//!
//! ```text
//! M q'' + [M' + a' (G - G^T) + damping Kb] q' + [Kb + a'' (G - P0) + a'^2 (dG/da - H)] q = Q
//!   theta:    - a' w1 q' - (a'' w1 + a'^2 d1) q + d/dt (theta' q^T Z q)
//!   elastic:  + a' w1^T theta' - theta'^2 Z q           (all on the left-hand side)
//! ```
//!
//! The axial force of link 2 and payload, P(xi) = int_xi^R rho2 (eta theta'^2 - a'') d eta +
//! Mp ((R + Lp/2) theta'^2 - a''), runs through link 2 from its root c on; link 1 carries its own,
//! int_xi^L1 rho1 eta theta'^2 d eta. Without the axial load P0 and P2 are zero.
//! Damping acts on the rates of the coordinates.
//!
//! Every integral is tabulated over the extensions of a manoeuvre as Chebyshev series exact to rounding;
//! a step evaluates polynomials.

mod equations;
mod field;
mod motion;
mod table;

use nalgebra::{DMatrix, DVector};

use crate::arm::{Arm, PayloadProperties};
use crate::error::ConfigError;
use crate::plant::energy::Energy;
use crate::plant::{Dynamics, Extension, TipTorque, Torques};
use crate::quadrature::gauss_legendre;
use crate::shape::{ShapeBasis, ShapeFamily};

pub use field::CAPACITY;
pub use motion::ConsistentState;

use equations::tabulate;
use field::{Field, Integrals, Row};
use table::Table;

/// Part of a length by which tables reach beyond the extensions of a manoeuvre.
const MARGIN: f64 = 0.01;

/// What the deflections are made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Kinematics {
    /// Assumed shapes of both links. The default is u^(i+1): link 1 carries a moment at its end, so
    /// shapes without curvature there converge slowly.
    pub shapes: ShapeFamily,
    /// Whether link 2 turns with the end slope of link 1; without it, one B.8 shape a link and
    /// theta'^2 left out this is the thesis' model with particle following.
    pub slope_turning: bool,
}

impl Default for Kinematics {
    fn default() -> Self {
        Self {
            shapes: ShapeFamily::Mono,
            slope_turning: true,
        }
    }
}

/// Mass, velocity and stiffness matrix of the equations at one length.
#[derive(Debug, Clone, PartialEq)]
pub struct ConsistentMatrices {
    /// M (symmetric): kg m^2, kg m, kg.
    pub mass: DMatrix<f64>,
    /// Velocity matrix C about the undeflected arm.
    pub velocity: DMatrix<f64>,
    /// Stiffness K: bending, deployment, axial load and turning.
    pub stiffness: DMatrix<f64>,
}

/// Equations of motion of the slope-continuous arm for one payload.
#[derive(Debug, Clone, PartialEq)]
pub struct ConsistentPlant {
    field: Field,
    dynamics: Dynamics,
    /// M, Kb and Z.
    still: Table,
    /// Factors of a' in C, of a'' and a'^2 in K, and dZ/da.
    moving: Table,
    /// Bounds of the tables, m.
    range: (f64, f64),
    /// Slope shapes of link 1 and link 2 at their ends, per m of the first and per u of the second.
    tip_slope: Row,
}

impl ConsistentPlant {
    /// Tabulates the equations for extensions within `extension_range` (m, in either order) with
    /// `modes` shapes for link 1 and link 2. `dynamics.particle_following` has no influence: the
    /// particles are always followed.
    ///
    /// # Errors
    /// Parameters that no arm has, an extension outside the arm, no mode or too many.
    pub fn new(
        arm: &Arm,
        payload: &PayloadProperties,
        dynamics: &Dynamics,
        modes: (usize, usize),
        extension_range: (f64, f64),
    ) -> Result<Self, ConfigError> {
        let kinematics = Kinematics::default();
        Self::with_kinematics(arm, payload, dynamics, modes, extension_range, kinematics)
    }

    /// As [`ConsistentPlant::new`], with other shapes or without the turning of link 2.
    ///
    /// # Errors
    /// As [`ConsistentPlant::new`].
    pub fn with_kinematics(
        arm: &Arm,
        payload: &PayloadProperties,
        dynamics: &Dynamics,
        modes: (usize, usize),
        extension_range: (f64, f64),
        kinematics: Kinematics,
    ) -> Result<Self, ConfigError> {
        arm.validate().map_err(|e| e.within("arm"))?;
        dynamics.validate().map_err(|e| e.within("dynamics"))?;
        let most = (CAPACITY - 1) / 2;
        for (name, count) in [("link1", modes.0), ("link2", modes.1)] {
            if !(1..=most).contains(&count) {
                let requirement = format!("must be within 1 to {most}");
                return Err(ConfigError::value(name, requirement, count).within("modes"));
            }
        }
        let (low, high) = (
            extension_range.0.min(extension_range.1),
            extension_range.0.max(extension_range.1),
        );
        arm.validate_extension("extension_range", extension_range.0)?;
        arm.validate_extension("extension_range", extension_range.1)?;
        let range = (low * (1.0 - MARGIN), high * (1.0 + MARGIN));
        let field = Field::new(
            arm,
            payload,
            kinematics.shapes,
            modes,
            kinematics.slope_turning,
        );
        let (still, moving) = tabulate(&field, dynamics, range);
        // at a unit length the slopes of link 2 are those per u
        let tip_slope = field.tip(1.0).slope;
        Ok(Self {
            field,
            dynamics: *dynamics,
            still,
            moving,
            range,
            tip_slope,
        })
    }

    /// Number of coordinates, 1 + n + m.
    pub fn size(&self) -> usize {
        self.field.size()
    }

    /// Number of shapes of link 1 and link 2.
    pub fn modes(&self) -> (usize, usize) {
        (self.field.link1.len(), self.field.link2.len())
    }

    /// M, C and K about the undeflected arm that turns at `slew_rate` (rad/s), from the tables.
    ///
    /// # Errors
    /// An extension outside the range of the tables.
    pub fn matrices(
        &self,
        extension: &Extension<f64>,
        slew_rate: f64,
    ) -> Result<ConsistentMatrices, ConfigError> {
        let a = extension.length;
        if !(self.range.0..=self.range.1).contains(&a) {
            let requirement = format!("must be within {} m to {} m", self.range.0, self.range.1);
            return Err(ConfigError::value("extension", requirement, a));
        }
        let size = self.size();
        let read = |table: &Table, count: usize| -> Vec<DMatrix<f64>> {
            let mut flat = vec![0.0; count * size * size];
            table.evaluate(a, &mut flat);
            flat.chunks(size * size)
                .map(|m| DMatrix::from_row_slice(size, size, m))
                .collect()
        };
        let (still, moving) = (read(&self.still, 3), read(&self.moving, 4));
        let (ad, add) = (extension.rate, extension.accel);
        Ok(ConsistentMatrices {
            mass: still[0].clone(),
            velocity: &moving[0] * ad + &still[1] * self.dynamics.structural_damping,
            stiffness: &still[1] + &moving[1] * add + &moving[2] * (ad * ad)
                - &still[2] * (slew_rate * slew_rate),
        })
    }

    /// Generalised force of the torques at the extension `a` (m): the motor and the root wheel work
    /// on theta; the tip wheel on the tip's turn theta + w_x(R), or on link 2's slope alone.
    pub fn force(&self, torques: &Torques<f64>, a: f64) -> DVector<f64> {
        let force = self.load(torques, a);
        DVector::from_column_slice(&force[..self.size()])
    }

    #[inline(always)]
    fn load(&self, torques: &Torques<f64>, a: f64) -> Row {
        let first = 1 + self.field.link1.len();
        let whole = match self.dynamics.tip_torque {
            TipTorque::SlewAndTip => torques.tip,
            TipTorque::TipOnly => 0.0,
        };
        let mut force: Row = std::array::from_fn(|i| {
            let share = if i < first { whole } else { torques.tip / a };
            share * self.tip_slope[i]
        });
        force[0] = torques.slew + torques.root + whole;
        force
    }

    /// Energy of a state, J: at a fixed length the Jacobi integral, which without torques is
    /// conserved. The centrifugal part of the axial load counts as negative kinetic energy; the
    /// constant part of the axial velocity's square is left out.
    pub fn energy(&self, state: &ConsistentState, extension: &Extension<f64>) -> Energy {
        let sums = Integrals::new(&self.field, extension.length);
        let (q, v) = self.columns(state);
        let (rate, ad) = (v[0], extension.rate);
        let form = |m: &DMatrix<f64>, x: &DVector<f64>, y: &DVector<f64>| x.dot(&(m * y));
        let load = if self.dynamics.axial_load { 1.0 } else { 0.0 };
        let line = self.value(&sums.offset_line, &state.q);
        Energy {
            kinetic: 0.5 * form(&sums.mass, &v, &v)
                + ad * form(&sums.drift, &v, &q)
                + 0.5 * ad * ad * form(&sums.drift_square, &q, &q)
                - ad * rate * line
                + 0.5
                    * rate
                    * rate
                    * (form(&sums.offset, &q, &q) - load * form(&sums.centrifugal, &q, &q)),
            potential: 0.5 * form(&sums.bending, &q, &q)
                - 0.5 * load * extension.accel * form(&sums.thrust, &q, &q),
        }
    }

    /// Angular momentum about the shoulder, dL/d(theta'), N m s; the torques alone change it.
    pub fn angular_momentum(&self, state: &ConsistentState, extension: &Extension<f64>) -> f64 {
        let sums = Integrals::new(&self.field, extension.length);
        let (q, v) = self.columns(state);
        let load = if self.dynamics.axial_load { 1.0 } else { 0.0 };
        let turning = &sums.offset - &sums.centrifugal * load;
        sums.mass.row(0).transpose().dot(&v)
            + extension.rate
                * (sums.drift.row(0).transpose().dot(&q) - self.value(&sums.offset_line, &state.q))
            + v[0] * q.dot(&(turning * &q))
    }

    /// Angular frequencies (rad/s, rising) of the free arm at rest at the extension `a` (m); the
    /// rigid rotation is left out.
    ///
    /// # Errors
    /// An extension outside the arm.
    pub fn natural_frequencies(&self, a: f64) -> Result<Vec<f64>, ConfigError> {
        self.field.arm.validate_extension("extension", a)?;
        let sums = Integrals::new(&self.field, a);
        let elastic = self.size() - 1;
        let coupling = sums.mass.view((1, 0), (elastic, 1)).into_owned();
        let mass = sums.mass.view((1, 1), (elastic, elastic))
            - &coupling * coupling.transpose() / sums.mass[(0, 0)];
        let stiffness = sums.bending.view((1, 1), (elastic, elastic)).into_owned();
        let singular = || ConfigError::value("extension", "gives a singular mass matrix", a);
        let root = mass.cholesky().ok_or_else(singular)?.l();
        let half = root
            .solve_lower_triangular(&stiffness)
            .ok_or_else(singular)?;
        let reduced = root
            .solve_lower_triangular(&half.transpose())
            .ok_or_else(singular)?;
        let mut squares: Vec<f64> = reduced.symmetric_eigenvalues().iter().copied().collect();
        squares.sort_by(f64::total_cmp);
        Ok(squares
            .into_iter()
            .map(|square| libm::sqrt(square.max(0.0)))
            .collect())
    }

    /// State with link 1 and link 2 bent like cantilevers under a force at their ends, the first
    /// thesis shape 3 u^2 - u^3, with the coordinates `alpha` and `beta` (m; the deflections of the
    /// links' ends are twice as large) and their rates.
    pub fn released(
        &self,
        slew: (f64, f64),
        alpha: (f64, f64),
        beta: (f64, f64),
    ) -> ConsistentState {
        let (mut q, mut v) = ([0.0; CAPACITY], [0.0; CAPACITY]);
        (q[0], v[0]) = slew;
        let bent = cantilever(&self.field.link1)
            .into_iter()
            .map(|c| (c * alpha.0, c * alpha.1))
            .chain(
                cantilever(&self.field.link2)
                    .into_iter()
                    .map(|c| (c * beta.0, c * beta.1)),
            );
        for (i, (position, rate)) in bent.enumerate() {
            (q[1 + i], v[1 + i]) = (position, rate);
        }
        ConsistentState::new(q, v)
    }

    /// Deflection of the tip from the rotating axis, w(R), m, and its rate, m/s.
    pub fn tip_deflection(
        &self,
        state: &ConsistentState,
        extension: &Extension<f64>,
    ) -> (f64, f64) {
        let tip = self.field.tip(extension.length);
        (
            self.value(&tip.deflection, &state.q),
            self.value(&tip.deflection, &state.v)
                + extension.rate * self.value(&tip.drift, &state.q),
        )
    }

    /// Slope of the tip against the rotating axis, w_x(R), rad, and its rate, rad/s.
    pub fn tip_slope(&self, state: &ConsistentState, extension: &Extension<f64>) -> (f64, f64) {
        let tip = self.field.tip(extension.length);
        (
            self.value(&tip.slope, &state.q),
            self.value(&tip.slope, &state.v)
                + extension.rate * self.value(&tip.slope_drift, &state.q),
        )
    }

    /// Deflection of link 2's tip from the tangent at link 1's end, y2(a), m, and its rate, m/s:
    /// what the laws know as 2 beta.
    pub fn link2_deflection(&self, state: &ConsistentState) -> (f64, f64) {
        let own = self.field.link2_end();
        (self.value(&own, &state.q), self.value(&own, &state.v))
    }

    /// Deflection of link 1's end, m, and its rate, m/s: what the thesis knows as 2 alpha.
    pub fn link1_deflection(&self, state: &ConsistentState) -> (f64, f64) {
        let [deflection, _] = self.field.link1_end();
        (
            self.value(&deflection, &state.q),
            self.value(&deflection, &state.v),
        )
    }

    /// Deflection (m) and slope (rad) of link 1's end against the rotating axis.
    pub fn link1_end(&self, state: &ConsistentState) -> (f64, f64) {
        let [deflection, slope] = self.field.link1_end();
        (
            self.value(&deflection, &state.q),
            self.value(&slope, &state.q),
        )
    }

    /// Deflection w (m) from the rotating axis at the distance `xi` (m) from the shoulder.
    pub fn deflection(&self, state: &ConsistentState, extension: f64, xi: f64) -> f64 {
        self.value(&self.field.place(extension, xi).deflection, &state.q)
    }

    fn value(&self, row: &Row, coordinates: &Row) -> f64 {
        row.iter()
            .zip(coordinates)
            .skip(1)
            .map(|(form, x)| form * x)
            .sum()
    }

    fn columns(&self, state: &ConsistentState) -> (DVector<f64>, DVector<f64>) {
        let column = |x: &Row| DVector::from_column_slice(&x[..self.size()]);
        (column(&state.q), column(&state.v))
    }
}

/// Coordinates of 3 u^2 - u^3, or of what comes nearest to it in curvature, with its deflection of 2
/// at the end.
fn cantilever(basis: &ShapeBasis) -> Vec<f64> {
    let count = basis.len();
    let (mut gram, mut right) = (DMatrix::zeros(count, count), DVector::zeros(count));
    for (node, weight) in gauss_legendre(basis.quadrature_points() + 2) {
        let u = (1.0 + node) / 2.0;
        let curvatures = DVector::from_iterator(count, basis.at(u).into_iter().map(|s| s[2]));
        gram += &curvatures * curvatures.transpose() * weight;
        right += &curvatures * (weight * (6.0 - 6.0 * u));
    }
    let nearest = gram.lu().solve(&right).unwrap_or(right);
    let end: f64 = basis
        .at(1.0)
        .iter()
        .zip(nearest.iter())
        .map(|(s, c)| s[0] * c)
        .sum();
    nearest.iter().map(|c| c * 2.0 / end).collect()
}
