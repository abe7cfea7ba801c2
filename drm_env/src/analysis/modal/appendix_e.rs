//! The finite-element model of the thesis' appendix E, recovered from its printed rigid-body
//! modes and its figure. It is not the arm of the other chapters:
//!
//! - its "6 m" arm is 3 m of link 1, 4 m of overlap and 4 m of link 2, an extension of 4 m;
//! - bending stiffnesses follow from the tubes with E = 2.6 G;
//! - the overlap has the sum of both volumetric densities on the section of both tubes, twice the
//!   mass of the two links;
//! - payloads sit 0.5 m beyond the tip, with a moment of inertia of m l^2 / 3 about that centre.

use super::beam::{Root, Segment, SegmentedBeam, TipBody};
use super::spatial::{Body, Shaft, SpatialBeam};
use super::torsion::{LINK1, LINK2, OVERLAP, Tube};
use crate::arm::{Arm, PayloadInertia, PayloadProperties};
use nalgebra::{Matrix3, Vector3};

/// Young's modulus over shear modulus at a Poisson ratio of 0.3.
const YOUNG_OVER_SHEAR: f64 = 2.6;

/// Distance of every payload's centre beyond the tip, m.
const PAYLOAD_OFFSET: f64 = 0.5;

/// The model with lengths (m) of link 1 alone, the overlap and link 2 alone.
pub fn beam(lengths: [f64; 3], payload: &PayloadProperties) -> SegmentedBeam {
    let segment = |(length, tube, density): (f64, Tube, f64)| Segment {
        length,
        mass_per_length: density * tube.area(),
        bending_stiffness: YOUNG_OVER_SHEAR * tube.shear_modulus * tube.area_moment(),
    };
    SegmentedBeam {
        root: Root::PINNED,
        segments: tubes(lengths).map(segment).to_vec(),
        tip: TipBody {
            mass: payload.mass,
            offset: PAYLOAD_OFFSET,
            inertia_centre: payload.mass * payload.length * payload.length / 3.0,
        },
    }
}

/// The same in three dimensions with a body whose moments of inertia (kg m^2) are about the axes through
/// its centre, which lies `offset` (m) from the arm's axis: along y, in the plane, and along z. The root
/// turns freely in both planes.
pub fn spatial(lengths: [f64; 3], mass: f64, offset: [f64; 2], inertia: [f64; 3]) -> SpatialBeam {
    let shaft = |(_, tube, density): (f64, Tube, f64)| Shaft {
        torsional_stiffness: tube.torsional_stiffness(),
        inertia_per_length: density * 2.0 * tube.area_moment(),
    };
    SpatialBeam {
        beam: beam(
            lengths,
            &PayloadProperties::new(0.0, 0.0, 0.0, PayloadInertia::Full),
        ),
        shafts: tubes(lengths).map(shaft).to_vec(),
        body: Body {
            mass,
            centre: Vector3::new(PAYLOAD_OFFSET, offset[0], offset[1]),
            inertia: Matrix3::from_diagonal(&inertia.into()),
        },
        gimballed: true,
    }
}

/// Length (m), section and density (kg/m^3) of the three stretches.
fn tubes(lengths: [f64; 3]) -> [(f64, Tube, f64); 3] {
    let arm = Arm::default();
    let density1 = arm.link1.mass_per_length / LINK1.area();
    let density2 = arm.link2.mass_per_length / LINK2.area();
    [
        (lengths[0], LINK1, density1),
        (lengths[1], OVERLAP, density1 + density2),
        (lengths[2], LINK2, density2),
    ]
}
