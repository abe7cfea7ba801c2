//! What the tests of the consistent plant share.

use drm_env::arm::{Arm, PayloadInertia, PayloadProperties, TABLE_2_7};
use drm_env::plant::consistent::{CAPACITY, ConsistentPlant, ConsistentState};
use drm_env::plant::{Dynamics, Torques};
use drm_env::reference::Extension;
use drm_env::reference::timeline::Piece;
use nalgebra::SymmetricEigen;

/// A payload of table 2-7: 0 is none, 1 to 4 are the thesis' Payloads 0 to 3.
pub fn payload(row: usize) -> PayloadProperties {
    let (mass, length, width) = TABLE_2_7[row];
    PayloadProperties::new(mass, length, width, PayloadInertia::Full)
}

/// With as many modes a link and the default kinematics.
pub fn plant(row: usize, dynamics: &Dynamics, modes: usize, range: (f64, f64)) -> ConsistentPlant {
    ConsistentPlant::new(
        &Arm::default(),
        &payload(row),
        dynamics,
        (modes, modes),
        range,
    )
    .expect("the plant exists")
}

/// A length at rest.
pub fn fixed(length: f64) -> Extension<f64> {
    Extension {
        length,
        rate: 0.0,
        accel: 0.0,
    }
}

/// A piece of timeline without a slew reference.
pub fn moving(length: f64, rate: f64, accel: f64) -> Piece<f64> {
    Piece {
        start: 0.0,
        angle: 0.0,
        rate: 0.0,
        accel: [0.0; 4],
        extension: length,
        extension_rate: rate,
        extension_accel: accel,
    }
}

/// No torque.
pub const NO_TORQUE: Torques<f64> = Torques {
    slew: 0.0,
    root: 0.0,
    tip: 0.0,
};

/// States released in each elastic mode, and the angular frequencies, from K x = w^2 M x.
pub fn vibration_modes(plant: &ConsistentPlant, length: f64) -> (Vec<ConsistentState>, Vec<f64>) {
    let still = plant
        .matrices(&fixed(length), 0.0)
        .expect("the length is in range");
    let root = still.mass.cholesky().expect("M is positive definite").l();
    let inverse = root.try_inverse().expect("M is regular");
    let eigen = SymmetricEigen::new(&inverse * &still.stiffness * inverse.transpose());
    let shapes = inverse.transpose() * &eigen.eigenvectors;
    let mut order: Vec<usize> = (0..plant.size()).collect();
    order.sort_by(|i, j| eigen.eigenvalues[*i].total_cmp(&eigen.eigenvalues[*j]));
    let state = |column: usize| {
        let mut q = [0.0; CAPACITY];
        for (q, x) in q.iter_mut().zip(shapes.column(column).iter()) {
            *q = 1e-6 * x / shapes.column(column).amax();
        }
        ConsistentState::new(q, [0.0; CAPACITY])
    };
    // the first is the rigid rotation
    let elastic = order.iter().skip(1);
    let frequencies = elastic
        .clone()
        .map(|i| eigen.eigenvalues[*i].sqrt())
        .collect();
    (elastic.map(|i| state(*i)).collect(), frequencies)
}
