//! The linear state-space form of the equations of motion about the undeflected arm.

use nalgebra::{DMatrix, DMatrixView};

/// Names of the inputs u: torques, N m.
pub const INPUT_NAMES: [&str; 3] = ["slew_torque", "root_torque", "tip_torque"];

/// Names of the outputs y: slew angle and rate (rad, rad/s), deflection of link 2's tip from link 1's
/// end and its rate, deflection of the tip from the rotating axis and its rate (m, m/s).
pub const OUTPUT_NAMES: [&str; 6] = [
    "slew_angle",
    "slew_rate",
    "link2_deflection",
    "link2_deflection_rate",
    "tip_deflection",
    "tip_deflection_rate",
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
