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
//! link 2). A particle has the transverse velocity B q' + a' D q, where w = W q, B = W with xi as the entry
//! of theta, and D is the change of w per unit of extension, following the particle. The arm keeps its
//! length: bent, it draws its particles near by u = -1/2 int_0^xi w_x^2. The payload is a rigid body centred
//! Lp / 2 beyond the tip, which draws near by Lp / 4 w_x^2 more as it turns with the tip. With
//!
//! ```text
//! M = int rho B^T B    G = int rho B^T D    H = int rho D^T D    N = int rho W^T W    (payload included)
//! w1 = int rho W       d1 = int rho D       over link 2 and the payload alone
//! Kb bending,   -2 int rho (xi omega^2 - a'') u = q^T (omega^2 P2 - a'' P0) q,   Z = N - P2
//! ```
//!
//! (a'' for what moves out), the arm's inertia is that of the straight one and q^T Z q, which the bending
//! has added and the drawing near has taken. What turns it is the rate of the whole arm,
//!
//! ```text
//! omega = g q',   g = (first row of M) / (its first entry J)
//! ```
//!
//! its angular momentum over its inertia, and not the rate theta' of the tangent at the shoulder. The two
//! are one for a rigid arm; but the tangent has next to no inertia of its own (1.6 kg m^2 with four modes a
//! link, of 2.7e5), swings with every mode, and particles far away know nothing of it: their distance from
//! the tangent changes by as much the other way. Z holds nothing of such a turn (Z q = 0 for w = xi),
//! so that it has to be taken out of the rate as well. With theta' in the place of omega a heavy payload takes more from the tangent's
//! inertia than there is, and M + z e e^T, e the slew angle's unit, is not positive definite: the flight
//! explodes. M + z g^T g is positive definite if and only if J + z > 0, z = q^T Z q: if the bent arm has an inertia.
//!
//! Lagrange's equations are, with ' the rate following the particles,
//!
//! ```text
//! M q'' + [M' + a' (G - G^T) + damping Kb] q' + [Kb + a'' (G - P0) + a'^2 (dG/da - H)] q = Q
//!   theta:    - a' w1 q' - (a'' w1 + a'^2 d1) q
//!   elastic:  + a' w1^T theta' - omega^2 Z q
//!   all:      + d/dt (omega z g^T)                      (all on the left-hand side)
//! ```
//!
//! By parts -2 int rho xi u = int P w_x^2 with P(xi) the force that pulls at xi: that of link 2 beyond xi and
//! of the payload, from the root c of link 2 back to the shoulder carried by link 1, and link 1's own.
//! Left out are the axial velocities of drawing near, so that a bent arm does not push and pull its payload
//! at the rate of the vibration: of second order in the deflection, and of account for payloads of tonnes.
//! Without the axial load nothing draws near: P0 and P2 are zero, and what turns is theta'.
//! Damping acts on the rates of the coordinates.
//!
//! A payload whose centre of mass is off the arm's axis by h (positive where w is) turns with the tip: with t
//! the row of the tip's turn and b that of the centre's deflection, X its distance from the shoulder,
//! it moves along the arm by -h t q. That adds Mp h^2 t^T t to M, the force Mp h a'' t on the right, and
//! 2 l q, l = Mp h (b - X t), to what turns, z, whose pull bends the arm by omega^2 l. Terms of second order
//! in the deflection that are proportional to h are left out.
//!
//! A drive shaft between the slew motor and the shoulder adds one coordinate, phi of the rotor, after all others:
//! J phi'' = S - k (phi - theta) - d (phi' - theta'), and the arm gets k (phi - theta) + d (phi' - theta') in the
//! place of S.
//!
//! What depends on the arm alone is made once and shared by all flights of that arm: integrals between
//! the shapes of link 1 as Chebyshev series over all lengths, exact to rounding, and constants of
//! link 2's shapes. The payload, closed forms of the length and the rest follow in the step, which is
//! written over lanes: environments with different payloads side by side.

mod arm_tables;
mod chebyshev;
mod displacement;
mod modal_damping;
mod step;
mod terms;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use crate::arm::mode_shape::ShapeFamily;
use crate::arm::{Arm, PayloadProperties};
use crate::error::ConfigError;
use crate::hardware::slew_motor::DriveShaft;
use crate::plant::energy::Energy;
use crate::plant::{Dynamics, TipTorque, Torques};
use crate::reference::Extension;

pub use arm_tables::ConsistentArm;
pub use displacement::CAPACITY;
pub(crate) use displacement::Field;
pub use step::{ConsistentLanes, ConsistentOutputs, ConsistentState};

use arm_tables::{MOST, MOST_ELASTIC, PACKED, Slots};
use displacement::{Integrals, Row};
use modal_damping::ModalDamping;
use terms::{Payload, Terms, Weights};

/// Part of a length by which a plant may be asked beyond its extensions.
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

/// The lowest modes at one length, and what an angular acceleration of the arm as a whole bends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LowModes<const N: usize> {
    /// Of each mode of unit modal mass the angular frequency (rad/s) and the turn of the shoulder's tangent and
    /// of the tip; those of the tangent are positive. Zero where there are no more modes.
    pub modes: [[f64; 3]; N],
    /// Turn of the shoulder's tangent against the arm as a whole per angular acceleration, s^2.
    pub tilt: f64,
    /// Way of the tip from the arm as a whole per angular acceleration, m s^2.
    pub tip: f64,
}

/// Equations of motion of the slope-continuous arm for one payload.
#[derive(Debug, Clone, PartialEq)]
pub struct ConsistentPlant {
    payload: PayloadProperties,
    dynamics: Dynamics,
    /// Arm and payload as the step takes them.
    lanes: ConsistentLanes<f64>,
    /// Bounds of the extensions, m.
    range: (f64, f64),
}

impl ConsistentPlant {
    /// The equations for extensions within `extension_range` (m, in either order) with
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
        let stiffness = [arm.link1.bending_stiffness, arm.link2.bending_stiffness];
        let arm = ConsistentArm::shared(arm, modes, kinematics, dynamics.axial_load);
        let whole = match dynamics.tip_torque {
            TipTorque::SlewAndTip => 1.0,
            TipTorque::TipOnly => 0.0,
        };
        let mut plant = Self {
            payload: *payload,
            dynamics: *dynamics,
            lanes: ConsistentLanes {
                arm,
                payload: Payload {
                    mass: payload.mass,
                    lever: payload.length / 2.0,
                    inertia: payload.inertia_on_axis(),
                    offset: payload.offset,
                    stiffness,
                    damping: dynamics.structural_damping,
                    whole,
                },
                modal: Vec::new(),
                shaft: None,
            },
            range,
        };
        if dynamics.damping_ratio > 0.0 {
            let damping = ModalDamping::new(range, dynamics.damping_ratio, |a| {
                let terms = plant.terms(a);
                (
                    plant.matrix(&terms, Weights::MASS),
                    plant.matrix(&terms, Weights::BENDING),
                )
            });
            let singular =
                || ConfigError::value("payload.mass", "gives a singular mass matrix", payload.mass);
            plant.lanes.modal = vec![Some(Arc::new(damping.ok_or_else(singular)?))];
        }
        Ok(plant)
    }

    /// The same arm behind a drive shaft, or behind none.
    ///
    /// # Errors
    /// Too many modes: the rotor's angle takes the place of one.
    pub fn with_shaft(mut self, shaft: Option<DriveShaft>) -> Result<Self, ConfigError> {
        self.lanes.shaft = shaft;
        if self.coordinates() > CAPACITY {
            let requirement = format!(
                "must be at most {} in all before a drive shaft",
                CAPACITY - 2
            );
            return Err(ConfigError::value("modes", requirement, self.size() - 1));
        }
        Ok(self)
    }

    /// The drive shaft, if there is one.
    pub fn shaft(&self) -> Option<DriveShaft> {
        self.lanes.shaft
    }

    /// Torque of the drive shaft on the arm, N m, if there is one.
    pub fn shaft_torque(&self, state: &ConsistentState) -> Option<f64> {
        // without a shaft there may be no place for a rotor
        self.lanes.shaft.map(|shaft| {
            let [angle, rate] = [state.q, state.v].map(|x| x[self.size()] - x[0]);
            shaft.torque(angle, rate)
        })
    }

    /// Tells the angles of a state from another zero, `angle` further on (rad).
    pub(crate) fn turn_back(&self, state: &mut ConsistentState, angle: f64) {
        state.q[0] -= angle;
        if self.lanes.shaft.is_some() {
            state.q[self.size()] -= angle;
        }
    }

    /// One of the matrices at rest.
    fn matrix(
        &self,
        terms: &Terms<'_, f64, CAPACITY, { Slots::new(MOST).count }, PACKED>,
        weights: Weights<f64>,
    ) -> DMatrix<f64> {
        let mut out = [[0.0; CAPACITY]; CAPACITY];
        terms.sum(&weights, &terms.stiffness(0.0, 0.0, 0.0), &mut out);
        DMatrix::from_fn(self.size(), self.size(), |i, j| out[i][j])
    }

    /// Memory of what belongs to this payload alone beside the plant itself, bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.lanes
            .modal
            .iter()
            .flatten()
            .map(|damping| damping.bytes())
            .sum()
    }

    /// What the equations share with those of other payloads at the same arm.
    pub fn arm(&self) -> &Arc<ConsistentArm> {
        &self.lanes.arm
    }

    /// Deflections as forms of the coordinates.
    pub(crate) fn field(&self) -> &Field {
        &self.lanes.arm.field
    }

    /// The payload as it is.
    pub(crate) fn payload(&self) -> &PayloadProperties {
        &self.payload
    }

    fn sums(&self, a: f64) -> Integrals {
        Integrals::new(self.field(), &self.payload, a)
    }

    fn terms(&self, a: f64) -> Terms<'_, f64, CAPACITY, { Slots::new(MOST).count }, PACKED> {
        Terms::new(&self.lanes.arm, &self.lanes.payload, self.modes(), a, true)
    }

    /// Number of coordinates of the arm, 1 + n + m.
    pub fn size(&self) -> usize {
        self.field().size()
    }

    /// Number of all coordinates: those of the arm, and the rotor's angle before a drive shaft.
    pub fn coordinates(&self) -> usize {
        self.size() + usize::from(self.lanes.shaft.is_some())
    }

    /// Number of shapes of link 1 and link 2.
    pub fn modes(&self) -> (usize, usize) {
        self.lanes.modes()
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
        let terms = self.terms(a);
        let (ad, add) = (extension.rate, extension.accel);
        let damping = self.dynamics.structural_damping;
        let none = Weights::NONE;
        let sum = |weights: Weights<f64>| {
            let stiffness = terms.stiffness(-(slew_rate * slew_rate), -add, ad * ad);
            let mut out = [[0.0; CAPACITY]; CAPACITY];
            terms.sum(&weights, &stiffness, &mut out);
            DMatrix::from_fn(size, size, |i, j| out[i][j])
        };
        let mut velocity = sum(Weights {
            bending: damping,
            drift: 2.0 * ad,
            column: 2.0 * ad,
            growth: ad,
            ..none
        });
        if let Some(Some(modal)) = self.lanes.modal.first() {
            let mut damping = [0.0; MOST_ELASTIC];
            modal.at(a, &mut damping);
            for i in 1..size {
                for k in 1..size {
                    velocity[(i, k)] += damping[modal_damping::place(i - 1, k - 1)];
                }
            }
        }
        Ok(ConsistentMatrices {
            mass: sum(Weights::MASS),
            velocity,
            stiffness: sum(Weights {
                bending: 1.0,
                drift: add,
                stiffness: 1.0,
                ..none
            }),
        })
    }

    /// Generalised force of the torques at the extension `a` (m): the motor and the root wheel work
    /// on theta; the tip wheel on the tip's turn theta + w_x(R), or on link 2's slope alone.
    pub fn force(&self, torques: &Torques<f64>, a: f64) -> DVector<f64> {
        let force = self
            .terms(a)
            .force(torques.slew + torques.root, torques.tip);
        DVector::from_column_slice(&force[..self.size()])
    }

    /// Energy of a state, J: at a fixed length the Jacobi integral, which without torques is
    /// conserved. What the drawing near takes from the inertia counts as negative kinetic energy; the
    /// constant part of the axial velocity's square is left out.
    pub fn energy(&self, state: &ConsistentState, extension: &Extension<f64>) -> Energy {
        let sums = self.sums(extension.length);
        let (q, v) = self.columns(state);
        let (rate, ad) = (v[0], extension.rate);
        let whole = self.whole_rate(state, extension.length);
        let form = |m: &DMatrix<f64>, x: &DVector<f64>, y: &DVector<f64>| x.dot(&(m * y));
        let load = if self.dynamics.axial_load { 1.0 } else { 0.0 };
        let line = self.value(&sums.offset_line, &state.q);
        let (moment, lever) = self.off_axis(state, extension);
        let turn_rate = rate + self.tip_slope(state, extension).1;
        let shaft = self.lanes.shaft.map_or([0.0; 2], |shaft| {
            let [angle, rate] = [state.q, state.v].map(|x| x[self.size()]);
            let twist = angle - state.q[0];
            [
                0.5 * shaft.rotor_inertia * rate * rate,
                0.5 * shaft.stiffness * twist * twist,
            ]
        });
        Energy {
            kinetic: shaft[0]
                + 0.5 * form(&sums.mass, &v, &v)
                + ad * form(&sums.drift, &v, &q)
                + 0.5 * ad * ad * form(&sums.drift_square, &q, &q)
                - ad * (rate * line + moment * turn_rate)
                + 0.5
                    * whole
                    * whole
                    * (form(&sums.offset, &q, &q) - load * form(&sums.centrifugal, &q, &q)
                        + 2.0 * lever),
            potential: shaft[1] + 0.5 * form(&sums.stiffness(self.lanes.payload.stiffness), &q, &q)
                - 0.5 * load * extension.accel * form(&sums.thrust, &q, &q),
        }
    }

    /// Angular momentum about the shoulder, dL/d(theta'), N m s; the torques alone change it.
    pub fn angular_momentum(&self, state: &ConsistentState, extension: &Extension<f64>) -> f64 {
        let sums = self.sums(extension.length);
        let (q, v) = self.columns(state);
        let load = if self.dynamics.axial_load { 1.0 } else { 0.0 };
        let turning = &sums.offset - &sums.centrifugal * load;
        let (moment, lever) = self.off_axis(state, extension);
        sums.mass.row(0).transpose().dot(&v)
            + extension.rate
                * (sums.drift.row(0).transpose().dot(&q)
                    - self.value(&sums.offset_line, &state.q)
                    - moment)
            + self.whole_rate(state, extension.length) * (q.dot(&(turning * &q)) + 2.0 * lever)
    }

    /// Mass times distance from the axis of a payload off it, kg m, and l q of the equations, kg m^2.
    fn off_axis(&self, state: &ConsistentState, extension: &Extension<f64>) -> (f64, f64) {
        let moment = self.payload.mass * self.payload.offset;
        let lever = self.lanes.payload.lever;
        let centre = self.field().arm.link1.length + extension.length + lever;
        let (deflection, _) = self.tip_deflection(state, extension);
        let (slope, _) = self.tip_slope(state, extension);
        (moment, moment * (deflection + (lever - centre) * slope))
    }

    /// Rate at which the arm turns as a whole, rad/s: with the axial load the angular momentum of the
    /// undeflected arm over its moment of inertia, without it the slew rate.
    pub fn whole_rate(&self, state: &ConsistentState, length: f64) -> f64 {
        if !self.dynamics.axial_load {
            return state.v[0];
        }
        let mass = self.sums(length).mass;
        let (_, v) = self.columns(state);
        mass.row(0).transpose().dot(&v) / mass[(0, 0)]
    }

    /// Angular frequencies (rad/s, rising) of the free arm at rest at the extension `a` (m); the
    /// rigid rotation is left out.
    ///
    /// # Errors
    /// An extension outside the arm.
    pub fn natural_frequencies(&self, a: f64) -> Result<Vec<f64>, ConfigError> {
        self.field().arm.validate_extension("extension", a)?;
        let sums = self.sums(a);
        let stiffness = sums.stiffness(self.lanes.payload.stiffness);
        let found = modal_damping::modes(&sums.mass, &stiffness)
            .ok_or_else(|| ConfigError::value("extension", "gives a singular mass matrix", a))?;
        Ok(found.into_iter().map(|(frequency, _)| frequency).collect())
    }

    /// The lowest modes at the extension `a` (m), and how a steady angular acceleration bends the arm.
    ///
    /// # Errors
    /// An extension outside the arm.
    pub fn low_modes<const N: usize>(&self, a: f64) -> Result<LowModes<N>, ConfigError> {
        self.field().arm.validate_extension("extension", a)?;
        let singular = || ConfigError::value("extension", "gives a singular mass matrix", a);
        let terms = self.terms(a);
        let mass = self.matrix(&terms, Weights::MASS);
        let stiffness = self.matrix(&terms, Weights::BENDING);
        let elastic = self.size() - 1;
        let inertia = mass[(0, 0)];
        let coupling = mass.view((1, 0), (elastic, 1)).into_owned();
        let found = modal_damping::modes(&mass, &stiffness).ok_or_else(singular)?;
        let tip = self.field().tip(a);
        let row = |of: &Row| DVector::from_column_slice(&of[1..=elastic]);
        let (deflection, slope) = (row(&tip.deflection), row(&tip.slope));
        let mut modes = [[0.0; 3]; N];
        for ((frequency, shape), mode) in found.iter().zip(&mut modes) {
            let root = -coupling.dot(shape) / inertia;
            let sign = root.signum();
            *mode = [*frequency, sign * root, sign * (root + slope.dot(shape))];
        }
        let own = stiffness.view((1, 1), (elastic, elastic)).into_owned();
        let bent = own.lu().solve(&-&coupling).ok_or_else(singular)?;
        let tilt = -coupling.dot(&bent) / inertia;
        let reach = self.field().arm.link1.length + a;
        Ok(LowModes {
            modes,
            tilt,
            tip: deflection.dot(&bent.column(0)) + reach * tilt,
        })
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
        let bent = &self.lanes.arm.cantilever;
        let link1 = self.modes().0;
        for i in 1..self.size() {
            let (position, rate) = if i <= link1 { alpha } else { beta };
            (q[i], v[i]) = (bent[i] * position, bent[i] * rate);
        }
        if self.lanes.shaft.is_some() {
            (q[self.size()], v[self.size()]) = slew;
        }
        ConsistentState::new(q, v)
    }

    /// Deflection of the tip from the rotating axis, w(R), m, and its rate, m/s.
    pub fn tip_deflection(
        &self,
        state: &ConsistentState,
        extension: &Extension<f64>,
    ) -> (f64, f64) {
        let tip = self.field().tip(extension.length);
        (
            self.value(&tip.deflection, &state.q),
            self.value(&tip.deflection, &state.v)
                + extension.rate * self.value(&tip.drift, &state.q),
        )
    }

    /// Slope of the tip against the rotating axis, w_x(R), rad, and its rate, rad/s.
    pub fn tip_slope(&self, state: &ConsistentState, extension: &Extension<f64>) -> (f64, f64) {
        let tip = self.field().tip(extension.length);
        (
            self.value(&tip.slope, &state.q),
            self.value(&tip.slope, &state.v)
                + extension.rate * self.value(&tip.slope_drift, &state.q),
        )
    }

    /// Deflection of link 2's tip from the tangent at link 1's end, y2(a), m, and its rate, m/s:
    /// what the laws know as 2 beta.
    pub fn link2_deflection(&self, state: &ConsistentState) -> (f64, f64) {
        let own = self.field().link2_end();
        (self.value(&own, &state.q), self.value(&own, &state.v))
    }

    /// Deflection of link 1's end, m, and its rate, m/s: what the thesis knows as 2 alpha.
    pub fn link1_deflection(&self, state: &ConsistentState) -> (f64, f64) {
        let [deflection, _] = self.field().link1_end();
        (
            self.value(&deflection, &state.q),
            self.value(&deflection, &state.v),
        )
    }

    /// Deflection (m) and slope (rad) of link 1's end against the rotating axis.
    pub fn link1_end(&self, state: &ConsistentState) -> (f64, f64) {
        let [deflection, slope] = self.field().link1_end();
        (
            self.value(&deflection, &state.q),
            self.value(&slope, &state.q),
        )
    }

    /// Deflection w (m) from the rotating axis at the distance `xi` (m) from the shoulder.
    pub fn deflection(&self, state: &ConsistentState, extension: f64, xi: f64) -> f64 {
        self.value(&self.field().place(extension, xi).deflection, &state.q)
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
