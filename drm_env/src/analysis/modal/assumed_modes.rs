//! Assumed modes: the Rayleigh-Ritz method with shapes of clamped links.

use nalgebra::DVector;

use super::beam::{Root, SegmentedBeam, TipBody, UniformBeam, overlap_start};
use super::eigen::{Field, Pencil, Rows, Stretch};
use super::{ModeShapes, frequencies, sampled};
use crate::arm::mode_shape::{ShapeBasis, ShapeFamily};
use crate::arm::{Arm, PayloadProperties};

/// What the end of link 1 does to link 2.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kinematics {
    /// Displaces it, as in the thesis.
    Translating,
    /// Displaces and turns it, as a joint does.
    Turning,
}

/// The arm at one length with assumed modes on both links.
#[derive(Debug, Clone)]
pub struct AssumedArm {
    field: ArmField,
    stretches: Vec<Stretch>,
    tip: TipBody,
}

#[derive(Debug, Clone)]
struct ArmField {
    link1: ShapeBasis,
    link2: ShapeBasis,
    l1: f64,
    extension: f64,
    turning: bool,
}

impl Field for ArmField {
    fn size(&self) -> usize {
        self.link1.len() + self.link2.len()
    }

    fn at(&self, distance: f64) -> Rows {
        let mut rows = empty_rows(self.size(), distance);
        let n = self.link1.len();
        let inside = distance <= self.l1;
        let shapes = self.link1.at(if inside { distance / self.l1 } else { 1.0 });
        for (i, [value, slope, curvature]) in shapes.into_iter().enumerate() {
            let slope = slope / self.l1;
            rows.value[1 + i] = value;
            if inside {
                rows.slope[1 + i] = slope;
                rows.curvature[1 + i] = curvature / (self.l1 * self.l1);
            } else if self.turning {
                rows.value[1 + i] += (distance - self.l1) * slope;
                rows.slope[1 + i] = slope;
            }
        }
        if !inside {
            let a = self.extension;
            put(&mut rows, 1 + n, &self.link2, (distance - self.l1) / a, a);
        }
        rows
    }
}

struct BeamField {
    shapes: ShapeBasis,
    radius: f64,
    length: f64,
}

impl Field for BeamField {
    fn size(&self) -> usize {
        self.shapes.len()
    }

    fn at(&self, distance: f64) -> Rows {
        let mut rows = empty_rows(self.size(), distance);
        let u = (distance - self.radius) / self.length;
        if u > 0.0 {
            put(&mut rows, 1, &self.shapes, u, self.length);
        }
        rows
    }
}

/// Rows of the rigid rotation alone.
fn empty_rows(size: usize, distance: f64) -> Rows {
    let mut value = DVector::zeros(size + 1);
    let mut slope = value.clone();
    let curvature = value.clone();
    value[0] = distance;
    slope[0] = 1.0;
    Rows {
        value,
        slope,
        curvature,
    }
}

fn put(rows: &mut Rows, first: usize, basis: &ShapeBasis, u: f64, length: f64) {
    for (i, [value, slope, curvature]) in basis.at(u).into_iter().enumerate() {
        rows.value[first + i] = value;
        rows.slope[first + i] = slope / length;
        rows.curvature[first + i] = curvature / (length * length);
    }
}

impl AssumedArm {
    /// `counts` shapes of the family on link 1 and on link 2; 0 makes a link rigid.
    ///
    /// # Panics
    /// More than [`crate::arm::mode_shape::MAX_SHAPES`] on a link.
    pub fn new(
        arm: &Arm,
        payload: &PayloadProperties,
        extension: f64,
        kinematics: Kinematics,
        family: ShapeFamily,
        counts: [usize; 2],
    ) -> Self {
        let beam = SegmentedBeam::arm(arm, payload, extension);
        let mut start = 0.0;
        let stretches = beam.segments.iter().map(|segment| {
            let stretch = Stretch {
                start,
                end: start + segment.length,
                mass_per_length: segment.mass_per_length,
                bending_stiffness: segment.bending_stiffness,
            };
            start = stretch.end;
            stretch
        });
        let mut stretches: Vec<_> = stretches.filter(|s| s.end > s.start).collect();
        // rounding must not put the joint on the other side of a stretch's end
        for stretch in &mut stretches {
            if (stretch.end - arm.link1.length).abs() < 1e-12 * arm.link1.length {
                stretch.end = arm.link1.length;
            }
        }
        debug_assert!(overlap_start(arm, extension) <= arm.link1.length);
        Self {
            field: ArmField {
                link1: ShapeBasis::new(family, counts[0]),
                link2: ShapeBasis::new(family, counts[1]),
                l1: arm.link1.length,
                extension,
                turning: kinematics == Kinematics::Turning,
            },
            stretches,
            tip: beam.tip,
        }
    }

    fn reach(&self) -> f64 {
        self.field.l1 + self.field.extension
    }

    fn pencil(&self) -> Pencil {
        let field = &self.field;
        let points = field
            .link1
            .quadrature_points()
            .max(field.link2.quadrature_points());
        let (stretches, reach) = (&self.stretches, self.reach());
        Pencil::assemble(field, stretches, points, &Root::PINNED, &self.tip, reach)
    }

    /// Elastic angular frequencies, rising, rad/s.
    pub fn frequencies(&self) -> Vec<f64> {
        frequencies(&self.pencil().eigenpairs())
    }

    /// Elastic mode shapes of the whole arm at `points` places.
    pub fn mode_shapes(&self, points: usize) -> ModeShapes {
        sampled(
            &self.field,
            &self.pencil().eigenpairs(),
            self.reach(),
            points,
        )
    }
}

/// Elastic angular frequencies of a uniform beam with `count` shapes, rising, rad/s.
///
/// # Panics
/// More than [`crate::arm::mode_shape::MAX_SHAPES`] shapes.
pub fn beam_frequencies(beam: &UniformBeam, family: ShapeFamily, count: usize) -> Vec<f64> {
    let radius = beam.root.radius();
    let segment = &beam.segment;
    let field = BeamField {
        shapes: ShapeBasis::new(family, count),
        radius,
        length: segment.length,
    };
    let reach = radius + segment.length;
    let stretch = Stretch {
        start: radius,
        end: reach,
        mass_per_length: segment.mass_per_length,
        bending_stiffness: segment.bending_stiffness,
    };
    let points = field.shapes.quadrature_points();
    let pencil = Pencil::assemble(&field, &[stretch], points, &beam.root, &beam.tip, reach);
    frequencies(&pencil.eigenpairs())
}
