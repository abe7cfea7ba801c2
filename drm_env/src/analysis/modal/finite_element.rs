//! Beam finite elements: Euler-Bernoulli, cubic Hermite functions, consistent mass.

use nalgebra::DVector;

use super::beam::SegmentedBeam;
use super::eigen::{Field, Pencil, Rows, Stretch};
use super::{ModeShapes, frequencies, sampled};

/// Most elements of a mesh.
pub const MAX_ELEMENTS: usize = 200;

/// Gauss points that integrate the product of two cubics exactly.
pub(super) const POINTS: usize = 4;

/// Segments shorter than this part of an element do not get one of their own: very short elements
/// spoil the condition of the stiffness matrix.
const SLIVER: f64 = 0.01;

/// A beam cut into elements. Nodes lie where segments meet; an element with a sliver of another
/// segment in it is integrated piece by piece.
#[derive(Debug, Clone)]
pub struct FiniteElementBeam {
    beam: SegmentedBeam,
    mesh: Mesh,
    stretches: Vec<Stretch>,
}

/// Distances of the nodes from the axis of rotation, rising, m. Coordinates are displacement and
/// slope of every node but the first, relative to the rotating axis.
#[derive(Debug, Clone)]
pub(super) struct Mesh(pub(super) Vec<f64>);

impl Mesh {
    /// Nodes of about `elements` elements of about the same length.
    pub(super) fn of(beam: &SegmentedBeam, elements: usize) -> Self {
        let (start, reach) = (beam.root.radius(), beam.reach());
        let size = (reach - start) / elements as f64;
        let mut ends = Vec::new();
        let mut at = start;
        for segment in &beam.segments {
            at += segment.length;
            let far = |from: f64| (at - from).abs() > SLIVER * size;
            if far(ends.last().copied().unwrap_or(start)) && far(reach) {
                ends.push(at);
            }
        }
        ends.push(reach);
        let mut nodes = vec![start];
        for end in ends {
            let from = nodes[nodes.len() - 1];
            let count = ((end - from) / size).round().max(1.0);
            nodes.extend((1..=count as usize).map(|i| from + (end - from) * i as f64 / count));
        }
        Self(nodes)
    }
}

impl Field for Mesh {
    fn size(&self) -> usize {
        2 * (self.0.len() - 1)
    }

    fn at(&self, distance: f64) -> Rows {
        let mut value = DVector::zeros(self.size() + 1);
        let (mut slope, mut curvature) = (value.clone(), value.clone());
        value[0] = distance;
        slope[0] = 1.0;
        if distance <= self.0[0] {
            return Rows {
                value,
                slope,
                curvature,
            };
        }
        let last = self.0.len() - 1;
        let element = self.0.partition_point(|&x| x < distance).clamp(1, last) - 1;
        let h = self.0[element + 1] - self.0[element];
        let u = (distance - self.0[element]) / h;
        let (u2, u3) = (u * u, u * u * u);
        let hermite = [
            [1.0 - 3.0 * u2 + 2.0 * u3, 6.0 * (u2 - u), 12.0 * u - 6.0],
            [u - 2.0 * u2 + u3, 1.0 - 4.0 * u + 3.0 * u2, 6.0 * u - 4.0],
            [3.0 * u2 - 2.0 * u3, 6.0 * (u - u2), 6.0 - 12.0 * u],
            [u3 - u2, 3.0 * u2 - 2.0 * u, 6.0 * u - 2.0],
        ];
        for (k, [f, df, ddf]) in hermite.into_iter().enumerate() {
            // slopes of nodes come with a factor h; the first node does not move
            let scale = if k % 2 == 1 { h } else { 1.0 };
            let Some(index) = (2 * element + k).checked_sub(2) else {
                continue;
            };
            value[1 + index] = f * scale;
            slope[1 + index] = df * scale / h;
            curvature[1 + index] = ddf * scale / (h * h);
        }
        Rows {
            value,
            slope,
            curvature,
        }
    }
}

impl FiniteElementBeam {
    /// Cuts a beam into about `elements` elements of about the same length.
    ///
    /// # Panics
    /// No elements, or more than [`MAX_ELEMENTS`].
    pub fn new(beam: SegmentedBeam, elements: usize) -> Self {
        assert!(
            (1..=MAX_ELEMENTS).contains(&elements),
            "1 to {MAX_ELEMENTS} elements"
        );
        let mesh = Mesh::of(&beam, elements);
        let stretches = stretches(&beam, &mesh.0);
        Self {
            beam,
            mesh,
            stretches,
        }
    }

    fn pencil(&self) -> Pencil {
        let beam = &self.beam;
        let (root, tip, reach) = (&beam.root, &beam.tip, beam.reach());
        Pencil::assemble(&self.mesh, &self.stretches, POINTS, root, tip, reach)
    }

    /// Elastic angular frequencies, rising, rad/s.
    pub fn frequencies(&self) -> Vec<f64> {
        frequencies(&self.pencil().eigenpairs())
    }

    /// Elastic mode shapes from the axis of rotation to the tip at `points` places.
    pub fn mode_shapes(&self, points: usize) -> ModeShapes {
        let pairs = self.pencil().eigenpairs();
        sampled(&self.mesh, &pairs, self.beam.reach(), points)
    }
}

/// The part of an element that lies in one segment, between two distances (m) from the shoulder.
pub(super) struct Piece {
    pub element: usize,
    pub segment: usize,
    pub start: f64,
    pub end: f64,
}

/// The parts of elements that lie in one segment each.
pub(super) fn pieces(beam: &SegmentedBeam, nodes: &[f64]) -> Vec<Piece> {
    let mut pieces = Vec::new();
    for (element, ends) in nodes.windows(2).enumerate() {
        let mut from = beam.root.radius();
        for (segment, stretch) in beam.segments.iter().enumerate() {
            let to = from + stretch.length;
            let (start, end) = (ends[0].max(from), ends[1].min(to));
            if end > start {
                pieces.push(Piece {
                    element,
                    segment,
                    start,
                    end,
                });
            }
            from = to;
        }
    }
    pieces
}

pub(super) fn stretches(beam: &SegmentedBeam, nodes: &[f64]) -> Vec<Stretch> {
    let stretch = |piece: Piece| Stretch {
        start: piece.start,
        end: piece.end,
        mass_per_length: beam.segments[piece.segment].mass_per_length,
        bending_stiffness: beam.segments[piece.segment].bending_stiffness,
    };
    pieces(beam, nodes).into_iter().map(stretch).collect()
}
