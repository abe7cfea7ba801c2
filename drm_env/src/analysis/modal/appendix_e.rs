//! The finite-element model of the thesis' appendix E, recovered from its printed rigid-body
//! modes and its figure. It is not the arm of the other chapters:
//!
//! - its "6 m" arm is 3 m of link 1, 4 m of overlap and 4 m of link 2, an extension of 4 m;
//! - bending stiffnesses follow from the tubes with E = 2.6 G;
//! - the overlap has the sum of both volumetric densities on the section of both tubes, twice the
//!   mass of the two links;
//! - payloads sit 0.5 m beyond the tip, with a moment of inertia of m l^2 / 3 about that centre.

use super::beam::{Root, Segment, SegmentedBeam, TipBody};
use super::torsion::{LINK1, LINK2, OVERLAP, Tube};
use crate::arm::{Arm, PayloadProperties};

/// Young's modulus over shear modulus at a Poisson ratio of 0.3.
const YOUNG_OVER_SHEAR: f64 = 2.6;

/// Distance of every payload's centre beyond the tip, m.
const PAYLOAD_OFFSET: f64 = 0.5;

/// The model with lengths (m) of link 1 alone, the overlap and link 2 alone.
pub fn beam(lengths: [f64; 3], payload: &PayloadProperties) -> SegmentedBeam {
    let arm = Arm::default();
    let density1 = arm.link1.mass_per_length / LINK1.area();
    let density2 = arm.link2.mass_per_length / LINK2.area();
    let segment = |length: f64, tube: Tube, density: f64| Segment {
        length,
        mass_per_length: density * tube.area(),
        bending_stiffness: YOUNG_OVER_SHEAR * tube.shear_modulus * tube.area_moment(),
    };
    SegmentedBeam {
        root: Root::PINNED,
        segments: vec![
            segment(lengths[0], LINK1, density1),
            segment(lengths[1], OVERLAP, density1 + density2),
            segment(lengths[2], LINK2, density2),
        ],
        tip: TipBody {
            mass: payload.mass,
            offset: PAYLOAD_OFFSET,
            inertia_centre: payload.mass * payload.length * payload.length / 3.0,
        },
    }
}
