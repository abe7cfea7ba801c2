//! The arm in three dimensions: it bends in the plane of the slew and out of it, and twists; a rigid body
//! whose centre of mass need not be on the axis couples the three (thesis sections 2.8.2 and 6.3,
//! appendix E). Beam finite elements; the arm is at rest at a fixed length.
//!
//! Axes: x along the arm, y in the plane of the slew where a positive slew goes, z along the axis of the
//! shoulder. Displacements of the arm's axis are v along y and w along z, the twist about x is p. Rotations
//! are small, those of the tip are (p, -w', v').

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use super::beam::SegmentedBeam;
use super::eigen::{Eigenpair, Field, Pencil};
use super::finite_element::{Mesh, POINTS, pieces, stretches};
use super::torsion::{LINK1, LINK2, Tube};
use super::{TipBody, frequencies, places};
use crate::arm::{Arm, Link};

/// What a mode mostly is, in the order of [`SpatialModes::shares`].
pub const KINDS: [&str; 3] = ["in-plane bending", "out-of-plane bending", "torsion"];

/// Most elements of a mesh, whose nodes have five coordinates each.
pub const MAX_ELEMENTS: usize = 80;

/// A stretch of the arm as a shaft.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shaft {
    /// G J, N m^2.
    pub torsional_stiffness: f64,
    /// Polar moment of inertia, kg m^2 per m.
    pub inertia_per_length: f64,
}

/// A rigid body fixed to the tip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body {
    /// kg.
    pub mass: f64,
    /// Its centre of mass from the tip, m.
    pub centre: Vector3<f64>,
    /// Moments of inertia about the centre of mass, kg m^2.
    pub inertia: Matrix3<f64>,
}

/// A beam that turns about the z axis at its root, is held there otherwise, and carries a body.
#[derive(Debug, Clone, PartialEq)]
pub struct SpatialBeam {
    /// Lengths, masses and bending stiffnesses, the same in the plane and out of it; hinged, the body at
    /// the tip counts nothing.
    pub beam: SegmentedBeam,
    /// The segments of the beam as shafts.
    pub shafts: Vec<Shaft>,
    /// What is at the tip.
    pub body: Body,
    /// Whether the root turns freely about the y axis, too, as in appendix E.
    pub gimballed: bool,
}

/// Natural vibrations of a [`SpatialBeam`].
#[derive(Debug, Clone, PartialEq)]
pub struct SpatialModes {
    /// Angular frequencies, rising, rad/s.
    pub frequencies: Vec<f64>,
    /// Parts of the elastic energy in bending in the plane, bending out of it, and twist.
    pub shares: Vec<[f64; 3]>,
    /// Distances from the shoulder along the undeformed arm, rising from 0 to the tip, m.
    pub positions: Vec<f64>,
    /// v (m), w (m) and p (rad) at the positions, three lists a mode; the largest magnitude is 1.
    pub shapes: Vec<[Vec<f64>; 3]>,
}

impl Shaft {
    /// A link whose torsional stiffness is given, or that of the thesis' tube in the proportion of the
    /// bending stiffnesses; it has the tube's radius of gyration.
    pub fn link(
        link: &Link,
        torsional_stiffness: Option<f64>,
        of_thesis: &Link,
        tube: Tube,
    ) -> Self {
        let proportion = link.bending_stiffness / of_thesis.bending_stiffness;
        let radii = tube.outer.mul_add(tube.outer, tube.inner * tube.inner) / 8.0;
        Self {
            torsional_stiffness: torsional_stiffness
                .unwrap_or_else(|| proportion * tube.torsional_stiffness()),
            inertia_per_length: link.mass_per_length * radii,
        }
    }

    fn beside(self, other: Self) -> Self {
        Self {
            torsional_stiffness: self.torsional_stiffness + other.torsional_stiffness,
            inertia_per_length: self.inertia_per_length + other.inertia_per_length,
        }
    }
}

impl SpatialModes {
    /// What each mode mostly is, one of [`KINDS`].
    pub fn kinds(&self) -> Vec<&'static str> {
        let kind = |shares: &[f64; 3]| {
            let largest = (1..3).fold(0, |k, i| if shares[i] > shares[k] { i } else { k });
            KINDS[largest]
        };
        self.shares.iter().map(kind).collect()
    }
}

impl SpatialBeam {
    /// The arm at a length (m) with a body; torsional stiffnesses of the links as for [`Shaft::link`].
    pub fn arm(
        arm: &Arm,
        torsional_stiffness: Option<[f64; 2]>,
        body: Body,
        extension: f64,
    ) -> Self {
        let thesis = Arm::default();
        let given = |i: usize| torsional_stiffness.map(|both| both[i]);
        let one = Shaft::link(&arm.link1, given(0), &thesis.link1, LINK1);
        let two = Shaft::link(&arm.link2, given(1), &thesis.link2, LINK2);
        Self {
            beam: SegmentedBeam::bare(arm, extension),
            shafts: vec![one, one.beside(two), two],
            body,
            gimballed: false,
        }
    }

    /// The first `count` natural vibrations by rising frequency, or as many as there are, sampled at
    /// `points` places.
    ///
    /// # Panics
    /// No elements, or more than [`MAX_ELEMENTS`]; another number of shafts than of segments.
    pub fn modes(&self, elements: usize, count: usize, points: usize) -> SpatialModes {
        assert!(
            (1..=MAX_ELEMENTS).contains(&elements),
            "1 to {MAX_ELEMENTS} elements"
        );
        assert_eq!(self.shafts.len(), self.beam.segments.len());
        let parts = Parts::of(self, elements);
        let mut pairs = parts.pencil.eigenpairs();
        pairs.truncate(count);
        let positions = places(self.beam.reach(), points);
        SpatialModes {
            frequencies: frequencies(&pairs),
            shares: pairs.iter().map(|pair| parts.shares(pair)).collect(),
            shapes: pairs
                .iter()
                .map(|pair| parts.shape(pair, &positions))
                .collect(),
            positions,
        }
    }
}

/// Which coordinates are whose: first the rotations about the shoulder, then the nodes' displacements and
/// slopes in the plane, those out of it, and the nodes' twists.
struct Parts {
    pencil: Pencil,
    mesh: Mesh,
    rotations: usize,
}

impl Parts {
    fn of(spatial: &SpatialBeam, elements: usize) -> Self {
        let SpatialBeam { beam, body, .. } = spatial;
        let mesh = Mesh::of(beam, elements);
        let rotations = 1 + usize::from(spatial.gimballed);
        let (bending, twisting) = (mesh.size(), mesh.0.len() - 1);
        let size = rotations + 2 * bending + twisting;
        let zeros = || DMatrix::zeros(size, size);
        let mut parts = Self {
            pencil: Pencil {
                mass: zeros(),
                stiffness: zeros(),
                rotations,
                clamped: false,
            },
            mesh,
            rotations,
        };
        let (root, reach) = (&beam.root, beam.reach());
        let pieces_of_beam = stretches(beam, &parts.mesh.0);
        let none = TipBody::default();
        let plane = Pencil::assemble(&parts.mesh, &pieces_of_beam, POINTS, root, &none, reach);
        for places in [parts.in_plane(), parts.out_of_plane()] {
            parts.add(&plane, &places);
        }
        parts.twist(spatial);
        parts.carry(body, reach);
        parts
    }

    /// Places of (rotation, bending coordinates) in the plane.
    fn in_plane(&self) -> Vec<Option<usize>> {
        let first = self.rotations;
        std::iter::once(Some(0))
            .chain((first..first + self.mesh.size()).map(Some))
            .collect()
    }

    /// The same out of the plane, where the root may be held.
    fn out_of_plane(&self) -> Vec<Option<usize>> {
        let first = self.rotations + self.mesh.size();
        std::iter::once((self.rotations > 1).then_some(1))
            .chain((first..first + self.mesh.size()).map(Some))
            .collect()
    }

    /// Place of the first node's twist that is free.
    fn first_twist(&self) -> usize {
        self.rotations + 2 * self.mesh.size()
    }

    fn add(&mut self, plane: &Pencil, places: &[Option<usize>]) {
        for (i, row) in places.iter().enumerate() {
            for (j, column) in places.iter().enumerate() {
                if let (Some(row), Some(column)) = (*row, *column) {
                    self.pencil.mass[(row, column)] += plane.mass[(i, j)];
                    self.pencil.stiffness[(row, column)] += plane.stiffness[(i, j)];
                }
            }
        }
    }

    /// Elements of a shaft whose twist is linear between nodes; the first node is held.
    fn twist(&mut self, spatial: &SpatialBeam) {
        let first = self.first_twist();
        for piece in pieces(&spatial.beam, &self.mesh.0) {
            let shaft = spatial.shafts[piece.segment];
            let (from, to) = (self.mesh.0[piece.element], self.mesh.0[piece.element + 1]);
            let (h, length) = (to - from, piece.end - piece.start);
            // the mean over the piece of the product of two linear functions, by Simpson's rule exact
            let at = |x: f64| [(to - x) / h, (x - from) / h];
            let seen = [
                piece.start,
                f64::midpoint(piece.start, piece.end),
                piece.end,
            ]
            .map(at);
            for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let (Some(row), Some(column)) = (
                    (piece.element + i).checked_sub(1),
                    (piece.element + j).checked_sub(1),
                ) else {
                    continue;
                };
                let sign = if i == j { 1.0 } else { -1.0 };
                let mean = (seen[0][i] * seen[0][j]
                    + 4.0 * seen[1][i] * seen[1][j]
                    + seen[2][i] * seen[2][j])
                    / 6.0;
                let place = (first + row, first + column);
                self.pencil.stiffness[place] += sign * shaft.torsional_stiffness * length / (h * h);
                self.pencil.mass[place] += shaft.inertia_per_length * length * mean;
            }
        }
    }

    /// The body at the tip, which moves with displacement, slopes and twist there.
    fn carry(&mut self, body: &Body, reach: f64) {
        let size = self.pencil.mass.nrows();
        let tip = self.mesh.at(reach);
        let spread = |values: &DVector<f64>, places: &[Option<usize>]| {
            let mut row = DVector::zeros(size);
            for (value, place) in values.iter().zip(places) {
                if let Some(place) = place {
                    row[*place] += value;
                }
            }
            row
        };
        let (inside, outside) = (self.in_plane(), self.out_of_plane());
        let mut twist = DVector::zeros(size);
        twist[size - 1] = 1.0;
        let turns = [
            twist,
            -spread(&tip.slope, &outside),
            spread(&tip.slope, &inside),
        ];
        let [x, y, z] = [body.centre.x, body.centre.y, body.centre.z];
        let moves = [
            &turns[1] * z - &turns[2] * y,
            spread(&tip.value, &inside) + &turns[2] * x - &turns[0] * z,
            spread(&tip.value, &outside) + &turns[0] * y - &turns[1] * x,
        ];
        let mass = &mut self.pencil.mass;
        for row in &moves {
            mass.ger(body.mass, row, row, 1.0);
        }
        for (i, one) in turns.iter().enumerate() {
            for (j, other) in turns.iter().enumerate() {
                mass.ger(body.inertia[(i, j)], one, other, 1.0);
            }
        }
    }

    fn shares(&self, pair: &Eigenpair) -> [f64; 3] {
        let bending = self.mesh.size();
        let starts = [self.rotations, self.rotations + bending, self.first_twist()];
        let sizes = [bending, bending, self.mesh.0.len() - 1];
        let energies: [f64; 3] = std::array::from_fn(|k| {
            let block = self
                .pencil
                .stiffness
                .view((starts[k], starts[k]), (sizes[k], sizes[k]));
            let part = pair.coordinates.rows(starts[k], sizes[k]);
            part.dot(&(block * part)).max(0.0)
        });
        let total: f64 = energies.iter().sum();
        energies.map(|energy| energy / total)
    }

    fn shape(&self, pair: &Eigenpair, positions: &[f64]) -> [Vec<f64>; 3] {
        let q = &pair.coordinates;
        let (inside, outside) = (self.in_plane(), self.out_of_plane());
        let along = |places: &[Option<usize>]| -> Vec<f64> {
            let values = places.iter().map(|place| place.map_or(0.0, |i| q[i]));
            let values = DVector::from_iterator(places.len(), values);
            positions
                .iter()
                .map(|&x| self.mesh.at(x).value.dot(&values))
                .collect()
        };
        let twists = q.rows(self.first_twist(), self.mesh.0.len() - 1);
        let twist = |&x: &f64| {
            let nodes = &self.mesh.0;
            let after = nodes
                .partition_point(|&node| node < x)
                .clamp(1, nodes.len() - 1);
            let u = (x - nodes[after - 1]) / (nodes[after] - nodes[after - 1]);
            let before = if after > 1 { twists[after - 2] } else { 0.0 };
            before + u * (twists[after - 1] - before)
        };
        let mut found = [
            along(&inside),
            along(&outside),
            positions.iter().map(twist).collect(),
        ];
        let all = || found.iter().flatten().copied();
        let peak = all().fold(0.0_f64, |peak, y| peak.max(y.abs()));
        // the largest of the three at the tip is not negative
        let tip = found
            .iter()
            .filter_map(|values| values.last().copied())
            .fold(0.0_f64, |tip, y| if y.abs() > tip.abs() { y } else { tip });
        if peak > 0.0 {
            let scale = if tip < 0.0 { -peak } else { peak };
            for y in found.iter_mut().flatten() {
                *y /= scale;
            }
        }
        found
    }
}
