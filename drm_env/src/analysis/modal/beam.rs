//! What vibrates: beams with a root, a body at the tip, and one or several stretches.

use crate::arm::{Arm, PayloadProperties};

/// How a beam begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Root {
    /// Held.
    Clamped,
    /// Fixed to the rim of a rigid hub that turns freely; the hub of a pinned beam is nothing.
    Hub {
        /// Distance of the beam's root from the axis of rotation, m.
        radius: f64,
        /// Moment of inertia of the hub about that axis, kg m^2.
        inertia: f64,
    },
}

impl Root {
    /// A hinge.
    pub const PINNED: Self = Self::Hub {
        radius: 0.0,
        inertia: 0.0,
    };

    /// Distance of the beam's root from the axis of rotation, m.
    pub fn radius(&self) -> f64 {
        match self {
            Self::Clamped => 0.0,
            Self::Hub { radius, .. } => *radius,
        }
    }
}

/// A rigid body at the tip of a beam.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TipBody {
    /// kg.
    pub mass: f64,
    /// Distance of its centre beyond the tip, m.
    pub offset: f64,
    /// Moment of inertia about its centre, kg m^2.
    pub inertia_centre: f64,
}

impl TipBody {
    /// Moment of inertia about the tip of the beam, kg m^2.
    pub fn inertia_attachment(&self) -> f64 {
        self.inertia_centre + self.mass * self.offset * self.offset
    }
}

impl From<&PayloadProperties> for TipBody {
    fn from(payload: &PayloadProperties) -> Self {
        Self {
            mass: payload.mass,
            offset: payload.length / 2.0,
            inertia_centre: payload.inertia_on_axis(),
        }
    }
}

/// A stretch of a beam with constant properties.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// m.
    pub length: f64,
    /// kg/m.
    pub mass_per_length: f64,
    /// EI, N m^2.
    pub bending_stiffness: f64,
}

/// One segment with root and tip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UniformBeam {
    /// Its beginning.
    pub root: Root,
    /// The beam itself.
    pub segment: Segment,
    /// Its end.
    pub tip: TipBody,
}

impl UniformBeam {
    /// The arm with a rigid link 1, whose overlap with link 2 is rigid too: link 2's outer part on
    /// a hub.
    pub fn rigid_link1(arm: &Arm, payload: &PayloadProperties, extension: f64) -> Self {
        let (l1, rho1) = (arm.link1.length, arm.link1.mass_per_length);
        let rho2 = arm.link2.mass_per_length;
        let start = overlap_start(arm, extension);
        let cube = l1 * l1 * l1;
        Self {
            root: Root::Hub {
                radius: l1,
                inertia: rho1 * cube / 3.0 + rho2 * (cube - start * start * start) / 3.0,
            },
            segment: Segment {
                length: extension,
                mass_per_length: rho2,
                bending_stiffness: arm.link2.bending_stiffness,
            },
            tip: payload.into(),
        }
    }
}

/// Several segments end to end, stiffly joined, with root and tip.
#[derive(Debug, Clone, PartialEq)]
pub struct SegmentedBeam {
    /// Its beginning.
    pub root: Root,
    /// From root to tip; segments of no length are allowed.
    pub segments: Vec<Segment>,
    /// Its end.
    pub tip: TipBody,
}

impl SegmentedBeam {
    /// The whole arm hinged at the shoulder: link 1 alone, both links side by side, link 2 alone.
    pub fn arm(arm: &Arm, payload: &PayloadProperties, extension: f64) -> Self {
        Self {
            tip: payload.into(),
            ..Self::bare(arm, extension)
        }
    }

    /// The same without a payload.
    pub fn bare(arm: &Arm, extension: f64) -> Self {
        let start = overlap_start(arm, extension);
        let (one, two) = (&arm.link1, &arm.link2);
        let segment = |length: f64, mass_per_length: f64, bending_stiffness: f64| Segment {
            length,
            mass_per_length,
            bending_stiffness,
        };
        Self {
            root: Root::PINNED,
            segments: vec![
                segment(start, one.mass_per_length, one.bending_stiffness),
                segment(
                    one.length - start,
                    one.mass_per_length + two.mass_per_length,
                    one.bending_stiffness + two.bending_stiffness,
                ),
                segment(extension, two.mass_per_length, two.bending_stiffness),
            ],
            tip: TipBody::default(),
        }
    }

    /// Distance of the tip from the axis of rotation, m.
    pub fn reach(&self) -> f64 {
        self.root.radius() + self.segments.iter().map(|s| s.length).sum::<f64>()
    }
}

impl From<&UniformBeam> for SegmentedBeam {
    fn from(beam: &UniformBeam) -> Self {
        Self {
            root: beam.root,
            segments: vec![beam.segment],
            tip: beam.tip,
        }
    }
}

/// Distance from the shoulder at which link 2 begins inside link 1, m.
pub(crate) fn overlap_start(arm: &Arm, extension: f64) -> f64 {
    (arm.link1.length + extension - arm.link2.length).max(0.0)
}
