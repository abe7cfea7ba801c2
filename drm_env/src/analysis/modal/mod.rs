//! Natural frequencies and mode shapes of the arm at rest at a fixed length.
//!
//! - [`crate::plant::thesis_modes`]: the two elastic modes of the plant that is flown.
//! - [`assumed_modes`]: the Rayleigh-Ritz method with any number of shapes.
//! - [`exact`]: the characteristic equation of a uniform beam on a hub: the arm with rigid link 1.
//! - [`finite_element`]: the whole arm as a beam in three segments.
//! - [`spatial`]: the whole arm in three dimensions, with a body off its axis.
//! - [`torsion`]: twist of the arm as a massless shaft.
//! - [`appendix_e`]: the finite-element model behind Table 2-11.

pub mod appendix_e;
pub mod assumed_modes;
pub mod beam;
mod eigen;
pub mod exact;
pub mod finite_element;
pub mod spatial;
pub mod torsion;

pub use crate::plant::thesis_modes::{
    ElasticModes, elastic_frequencies, elastic_modes, matrices_at_rest,
};
pub use assumed_modes::{AssumedArm, Kinematics};
pub use beam::{Root, Segment, SegmentedBeam, TipBody, UniformBeam};
pub use finite_element::FiniteElementBeam;
pub use spatial::{SpatialBeam, SpatialModes};

use eigen::{Eigenpair, Field};

/// Natural vibrations as displacements of the arm's axis.
#[derive(Debug, Clone, PartialEq)]
pub struct ModeShapes {
    /// Distances from the shoulder along the undeformed arm, rising from 0 to the tip, m.
    pub positions: Vec<f64>,
    /// Transverse displacements at the positions, one list a mode. The rotation that keeps the
    /// angular momentum zero is part of them. Largest magnitude 1, the tip not negative.
    pub displacements: Vec<Vec<f64>>,
    /// Angular frequencies, rising, rad/s.
    pub frequencies: Vec<f64>,
}

/// `points` equally spaced distances from 0 to `reach`.
fn places(reach: f64, points: usize) -> Vec<f64> {
    let last = points.max(2) - 1;
    (0..=last).map(|i| reach * i as f64 / last as f64).collect()
}

/// Largest magnitude 1, the tip not negative.
fn normalised(mut shape: Vec<f64>) -> Vec<f64> {
    let peak = shape.iter().fold(0.0_f64, |peak, y| peak.max(y.abs()));
    let tip = shape.last().copied().unwrap_or(0.0);
    let scale = if tip < 0.0 { -peak } else { peak };
    if peak > 0.0 {
        for y in &mut shape {
            *y /= scale;
        }
    }
    shape
}

fn frequencies(pairs: &[Eigenpair]) -> Vec<f64> {
    pairs.iter().map(|pair| pair.frequency).collect()
}

fn sampled(field: &impl Field, pairs: &[Eigenpair], reach: f64, points: usize) -> ModeShapes {
    let positions = places(reach, points);
    let rows: Vec<_> = positions.iter().map(|&x| field.at(x).value).collect();
    let shape =
        |pair: &Eigenpair| normalised(rows.iter().map(|row| row.dot(&pair.coordinates)).collect());
    ModeShapes {
        displacements: pairs.iter().map(shape).collect(),
        frequencies: frequencies(pairs),
        positions,
    }
}
