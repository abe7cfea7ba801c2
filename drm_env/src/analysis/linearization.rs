//! The linear state-space form of the equations of motion about the undeflected arm.

use nalgebra::{DMatrix, DMatrixView};

use crate::arm::LINK_END_DEFLECTION;
use crate::error::ConfigError;
use crate::plant::Torques;
use crate::plant::consistent::{CAPACITY, ConsistentPlant, ConsistentState};
use crate::plant::thesis::Matrices;
use crate::reference::Extension;

/// Names of the inputs u: torques, N m.
pub const INPUT_NAMES: [&str; 3] = ["slew_torque", "root_torque", "tip_torque"];

/// Names of the outputs y: slew angle and rate (rad, rad/s), deflection of link 2's tip from link 1's
/// end and its rate, deflection of the tip from the rotating axis and its rate (m, m/s), rate at which the tip
/// turns (rad/s).
pub const OUTPUT_NAMES: [&str; 7] = [
    "slew_angle",
    "slew_rate",
    "link2_deflection",
    "link2_deflection_rate",
    "tip_deflection",
    "tip_deflection_rate",
    "tip_turn_rate",
];

/// x' = A x + B u, y = C x at one instant of a prescribed deployment, x = (q, q').
///
/// The undeflected arm turning at a rate is no equilibrium while it deploys, yet there is no constant
/// term: every force at zero deflection is proportional to the slew rate, which is part of x. In
/// deviations from the state x0 of that rate, A x0 is the constant term.
#[derive(Debug, Clone, PartialEq)]
pub struct Linearization {
    /// A, square.
    pub a: DMatrix<f64>,
    /// B, a column a torque of [`INPUT_NAMES`].
    pub b: DMatrix<f64>,
    /// C, a row an output of [`OUTPUT_NAMES`].
    pub c: DMatrix<f64>,
    /// Names of the states: coordinates, then their rates.
    pub states: Vec<String>,
}

/// M q'' + C q' + K q = F u with the outputs as linear forms of q and q'.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Equations {
    /// M, C and K.
    pub matrices: [DMatrix<f64>; 3],
    /// F, a column a torque.
    pub input: DMatrix<f64>,
    /// Outputs per state (q, q').
    pub output: DMatrix<f64>,
    /// Names of the coordinates beside the slew angle.
    pub elastic: Vec<String>,
}

impl Equations {
    /// Solved for the accelerations; nothing when the mass matrix is not positive definite.
    pub fn solved(self) -> Option<Linearization> {
        let [mass, velocity, stiffness] = self.matrices;
        let n = mass.nrows();
        let mass = mass.cholesky()?;
        let mut a = DMatrix::zeros(2 * n, 2 * n);
        a.view_mut((0, n), (n, n)).fill_with_identity();
        put(&mut a, (n, 0), (-mass.solve(&stiffness)).as_view());
        put(&mut a, (n, n), (-mass.solve(&velocity)).as_view());
        let mut b = DMatrix::zeros(2 * n, self.input.ncols());
        put(&mut b, (n, 0), mass.solve(&self.input).as_view());
        let coordinates = std::iter::once("slew_angle".to_owned()).chain(self.elastic.clone());
        let rates = self.elastic.iter().map(|name| format!("{name}_rate"));
        let states = coordinates
            .chain(std::iter::once("slew_rate".to_owned()))
            .chain(rates)
            .collect();
        Some(Linearization {
            a,
            b,
            c: self.output,
            states,
        })
    }
}

fn put(whole: &mut DMatrix<f64>, corner: (usize, usize), part: DMatrixView<'_, f64>) {
    whole.view_mut(corner, part.shape()).copy_from(&part);
}

/// The thesis' plant about the undeflected arm that turns at `slew_rate` (rad/s).
pub(crate) fn thesis_equations(m: &Matrices<f64>, slew_rate: f64) -> Equations {
    let dense = |rows: [[f64; 3]; 3]| DMatrix::from_fn(3, 3, |i, j| rows[i][j]);
    let mut stiffness = dense(m.stiffness);
    let square = slew_rate * slew_rate;
    stiffness[(1, 1)] += m.axial.a0 + m.axial.a2 * square;
    stiffness[(2, 2)] += m.axial.b0 + m.axial.b2 * square;
    let mut input = DMatrix::zeros(3, INPUT_NAMES.len());
    (input[(0, 0)], input[(0, 1)]) = (1.0, 1.0);
    (input[(0, 2)], input[(2, 2)]) = (m.tip_on_slew, m.tip_slope);
    let mut output = DMatrix::zeros(OUTPUT_NAMES.len(), 6);
    for (i, first) in [0, 3].into_iter().enumerate() {
        output[(i, first)] = 1.0;
        output[(2 + i, first + 2)] = LINK_END_DEFLECTION;
        output[(4 + i, first + 1)] = LINK_END_DEFLECTION;
        output[(4 + i, first + 2)] = LINK_END_DEFLECTION;
    }
    (output[(6, 3)], output[(6, 5)]) = (m.tip_on_slew, m.tip_slope);
    Equations {
        matrices: [dense(m.mass), dense(m.velocity), stiffness],
        input,
        output,
        elastic: vec!["alpha".into(), "beta".into()],
    }
}

/// The consistent plant about the undeflected arm that turns at `slew_rate` (rad/s).
///
/// # Errors
/// An extension outside the range of the plant.
pub(crate) fn consistent_equations(
    plant: &ConsistentPlant,
    extension: &Extension<f64>,
    slew_rate: f64,
) -> Result<Equations, ConfigError> {
    let found = plant.matrices(extension, slew_rate)?;
    let size = plant.size();
    let unit = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
        .map(|[slew, root, tip]| plant.force(&Torques { slew, root, tip }, extension.length));
    let mut output = DMatrix::zeros(OUTPUT_NAMES.len(), 2 * size);
    for (j, mut column) in output.column_iter_mut().enumerate() {
        let (mut q, mut v) = ([0.0; CAPACITY], [0.0; CAPACITY]);
        if j < size {
            q[j] = 1.0;
        } else {
            v[j - size] = 1.0;
        }
        let state = ConsistentState::new(q, v);
        let link2 = plant.link2_deflection(&state);
        let tip = plant.tip_deflection(&state, extension);
        let turn = v[0] + plant.tip_slope(&state, extension).1;
        column.copy_from_slice(&[q[0], v[0], link2.0, link2.1, tip.0, tip.1, turn]);
    }
    let (link1, link2) = plant.modes();
    let names = |link: usize, count: usize| (1..=count).map(move |i| format!("link{link}_{i}"));
    Ok(Equations {
        matrices: [found.mass, found.velocity, found.stiffness],
        input: DMatrix::from_columns(&unit),
        output,
        elastic: names(1, link1).chain(names(2, link2)).collect(),
    })
}
