//! What the equations of one arm need whatever its payload, made once and shared.

use std::sync::{Arc, Mutex, MutexGuard, TryLockError};
use std::time::{Duration, Instant};

use nalgebra::{DMatrix, DVector};

use super::Kinematics;
use super::chebyshev::{GROUP, Interval, Sampled, Table};
use super::displacement::{CAPACITY, Field, Integrals, Row};
use crate::arm::mode_shape::ShapeBasis;
use crate::arm::{Arm, PayloadInertia, PayloadProperties};
use crate::math::quadrature::gauss_legendre;

/// Most shapes of one link.
pub(super) const MOST: usize = (CAPACITY - 1) / 2;
/// Entries of a symmetric matrix between the shapes of one link.
pub(super) const PACKED: usize = MOST * (MOST + 1) / 2;
/// Entries of a symmetric matrix between all elastic coordinates.
pub(super) const MOST_ELASTIC: usize = (CAPACITY - 1) * CAPACITY / 2;
/// Part of the arm's lengths by which the series reach beyond them.
const MARGIN: f64 = 0.01;
/// Arms that are kept for the flights to come.
const KEPT: usize = 32;

/// Place of an entry, not above the diagonal, of a symmetric matrix.
#[inline(always)]
pub(super) const fn packed(row: usize, column: usize) -> usize {
    row * (row + 1) / 2 + column
}

/// Place of an entry below the diagonal of a skew matrix.
#[inline(always)]
pub(super) const fn below(row: usize, column: usize) -> usize {
    row * (row - 1) / 2 + column
}

/// Where the functions of the length stand that are tabulated: all of link 1's shapes, over the arm
/// without payload. Symmetric matrices come [`packed`], skew ones [`below`] the diagonal.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slots {
    /// Mass matrix.
    pub mass: usize,
    /// Bending stiffness of the part of link 2 inside link 1, per that of its section.
    pub bending: usize,
    /// Z: int rho W^T W less the centrifugal part of the axial load.
    pub turning: usize,
    /// Row of the slew angle in the mass matrix.
    pub lead: usize,
    /// int w_x^2 over link 2.
    pub shortening: usize,
    /// The axial load's P0.
    pub thrust: usize,
    /// Half of G - G^T.
    pub skew: usize,
    /// Shapes at the root of link 2.
    pub root: usize,
    /// Their slopes there.
    pub root_slope: usize,
    /// int rho W over link 2.
    pub line: usize,
    /// First slot of what a moving link 2 alone needs; all from here on.
    pub moving: usize,
    /// Number of slots.
    pub count: usize,
}

impl Slots {
    /// For `modes` shapes of link 1.
    #[inline(always)]
    pub const fn new(modes: usize) -> Self {
        let square = modes * (modes + 1) / 2;
        let moving = (3 * square + modes).next_multiple_of(GROUP);
        let thrust = moving + square;
        let skew = thrust + square;
        let root = skew + modes * (modes - 1) / 2;
        Self {
            mass: 0,
            bending: square,
            turning: 2 * square,
            lead: 3 * square,
            shortening: moving,
            thrust,
            skew,
            root,
            root_slope: root + modes,
            line: root + 2 * modes,
            moving,
            count: (root + 3 * modes).next_multiple_of(GROUP),
        }
    }
}

/// Equations of motion of one arm up to its payload and the stiffness of its sections: number of modes, shapes, axial load, and every
/// integral over the links. Flights of the same arm share one.
#[derive(Debug, PartialEq)]
pub struct ConsistentArm {
    key: Key,
    pub(super) field: Field,
    /// Functions of the length, see [`Slots`].
    pub(super) table: Table,
    /// 1 with the axial load, 0 without.
    pub(super) load: f64,
    /// Mass per length of link 2, kg/m.
    pub(super) density: f64,
    /// Rigid moment of inertia of link 1, kg m^2.
    pub(super) inertia: f64,
    /// Lengths of the links, m.
    pub(super) lengths: [f64; 2],
    /// Deflection of link 1's end, and the turn of link 2 with it, per coordinate of link 1.
    pub(super) end: [f64; MOST],
    pub(super) turn: [f64; MOST],
    /// Deflection and slope (per u) of link 2's own end per coordinate of link 2.
    pub(super) tip: [f64; MOST],
    pub(super) tip_slope: [f64; MOST],
    /// Integrals over u = 0 to 1 of link 2's shapes p, with rho its mass per length: rho p, rho u p.
    pub(super) plain: [f64; MOST],
    pub(super) moment: [f64; MOST],
    /// rho p^T p, packed.
    pub(super) gram: [f64; PACKED],
    /// rho p^T p_u (1 - u), rows first.
    pub(super) stretch: [[f64; MOST]; MOST],
    /// rho (1 - u)^2 p_u^T p_u, packed.
    pub(super) slide: [f64; PACKED],
    /// p_uu^T p_uu, packed.
    pub(super) stiff: [f64; PACKED],
    /// With the axial load, zero without: rho (1 - u) p_u^T p_u, rho u (1 - u) p_u^T p_u and
    /// p_u^T p_u, packed.
    pub(super) pull: [f64; PACKED],
    pub(super) pull_moment: [f64; PACKED],
    pub(super) slope: [f64; PACKED],
    /// int w_x^2 over link 1, and int w_xx^2, packed.
    pub(super) slope1: [f64; PACKED],
    pub(super) stiff1: [f64; PACKED],
    /// Coordinates of both links' cantilever deflection under a force at the end, 2 at the end.
    pub(super) cantilever: Row,
}

/// What tells one arm from another.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Key {
    arm: Arm,
    modes: (usize, usize),
    kinematics: Kinematics,
    axial_load: bool,
}

/// The arms met last, the latest at the end.
static ARMS: Mutex<Vec<Arc<ConsistentArm>>> = Mutex::new(Vec::new());

/// Longest wait for [`ARMS`], which nobody keeps for long.
const PATIENCE: Duration = Duration::from_millis(50);

/// [`ARMS`], unless whoever has them does not give them back: a forked process inherits the lock as it was,
/// and nobody there may have it.
fn arms() -> Option<MutexGuard<'static, Vec<Arc<ConsistentArm>>>> {
    // asked for only where somebody else has the lock: without threads there may be no clock either
    let mut begin = None;
    loop {
        match ARMS.try_lock() {
            Ok(arms) => return Some(arms),
            Err(TryLockError::Poisoned(arms)) => return Some(arms.into_inner()),
            Err(TryLockError::WouldBlock) => {
                if begin.get_or_insert_with(Instant::now).elapsed() > PATIENCE {
                    return None;
                }
                std::thread::yield_now();
            }
        }
    }
}

impl ConsistentArm {
    /// The one arm of its kind: made at the first call, shared by the later ones. The arguments must
    /// have been validated.
    pub(super) fn shared(
        arm: &Arm,
        modes: (usize, usize),
        kinematics: Kinematics,
        axial_load: bool,
    ) -> Arc<Self> {
        let mut key = Key {
            arm: *arm,
            modes,
            kinematics,
            axial_load,
        };
        // the sections' stiffness is the lane's
        key.arm.link1.bending_stiffness = 1.0;
        key.arm.link2.bending_stiffness = 1.0;
        let find = |arms: &mut Vec<Arc<Self>>| {
            let place = arms.iter().rposition(|arm| arm.key == key)?;
            if place + 1 != arms.len() {
                let found = arms.remove(place);
                arms.push(found);
            }
            arms.last().cloned()
        };
        if let Some(found) = arms().and_then(|mut arms| find(&mut arms)) {
            return found;
        }
        // made outside the lock; another thread may have been faster
        let made = Arc::new(Self::new(key));
        let Some(mut arms) = arms() else {
            return made;
        };
        if let Some(found) = find(&mut arms) {
            return found;
        }
        if arms.len() == KEPT {
            arms.remove(0);
        }
        arms.push(made.clone());
        made
    }

    /// Number of shapes of link 1 and link 2.
    pub fn modes(&self) -> (usize, usize) {
        self.key.modes
    }

    fn new(key: Key) -> Self {
        let Key {
            arm,
            modes: (n, m),
            kinematics,
            axial_load,
        } = key;
        let field = Field::new(&arm, kinematics.shapes, key.modes, kinematics.slope_turning);
        let load = if axial_load { 1.0 } else { 0.0 };
        let density = arm.link2.mass_per_length;
        let turning = if kinematics.slope_turning { 1.0 } else { 0.0 };
        let mut made = Self {
            key,
            table: tabulate(&field, load),
            load,
            density,
            inertia: arm.link1.mass_per_length * arm.link1.length.powi(3) / 3.0,
            lengths: [arm.link1.length, arm.link2.length],
            end: std::array::from_fn(|i| {
                if i < n {
                    field.end_deflection[1 + i]
                } else {
                    0.0
                }
            }),
            turn: std::array::from_fn(|i| {
                if i < n {
                    turning * field.end_slope[1 + i]
                } else {
                    0.0
                }
            }),
            tip: std::array::from_fn(|j| {
                if j < m {
                    field.end_deflection[1 + n + j]
                } else {
                    0.0
                }
            }),
            tip_slope: std::array::from_fn(|j| {
                if j < m {
                    field.end_slope[1 + n + j]
                } else {
                    0.0
                }
            }),
            plain: [0.0; MOST],
            moment: [0.0; MOST],
            gram: [0.0; PACKED],
            stretch: [[0.0; MOST]; MOST],
            slide: [0.0; PACKED],
            stiff: [0.0; PACKED],
            pull: [0.0; PACKED],
            pull_moment: [0.0; PACKED],
            slope: [0.0; PACKED],
            slope1: [0.0; PACKED],
            stiff1: [0.0; PACKED],
            cantilever: [0.0; CAPACITY],
            field,
        };
        for (node, weight) in gauss_legendre(made.field.link2.quadrature_points() + 3) {
            let (u, du) = ((1.0 + node) / 2.0, weight / 2.0);
            let (dm, rest) = (density * du, 1.0 - u);
            let shapes = made.field.link2.at(u);
            for (j, p) in shapes.iter().enumerate() {
                made.plain[j] += dm * p[0];
                made.moment[j] += dm * u * p[0];
                for (k, r) in shapes.iter().enumerate() {
                    made.stretch[j][k] += dm * rest * p[0] * r[1];
                    if k > j {
                        continue;
                    }
                    let at = packed(j, k);
                    made.gram[at] += dm * p[0] * r[0];
                    made.slide[at] += dm * rest * rest * p[1] * r[1];
                    made.stiff[at] += du * p[2] * r[2];
                    made.pull[at] += load * dm * rest * p[1] * r[1];
                    made.pull_moment[at] += load * dm * u * rest * p[1] * r[1];
                    made.slope[at] += load * du * p[1] * r[1];
                }
            }
        }
        let length = arm.link1.length;
        for (node, weight) in gauss_legendre(made.field.link1.quadrature_points() + 3) {
            let (u, du) = ((1.0 + node) / 2.0, weight / 2.0);
            let shapes = made.field.link1.at(u);
            for (j, p) in shapes.iter().enumerate() {
                for (k, r) in shapes.iter().enumerate().take(j + 1) {
                    made.slope1[packed(j, k)] += du / length * p[1] * r[1];
                    made.stiff1[packed(j, k)] += du / length.powi(3) * p[2] * r[2];
                }
            }
        }
        let bent = cantilever(&made.field.link1)
            .into_iter()
            .chain(cantilever(&made.field.link2));
        for (coordinate, bent) in made.cantilever.iter_mut().skip(1).zip(bent) {
            *coordinate = bent;
        }
        made
    }
}

/// Series of the functions of [`Slots`] over all lengths that the arm can have.
fn tabulate(field: &Field, load: f64) -> Table {
    let arm = &field.arm;
    let interval = Interval::new(
        arm.shortest_extension() * (1.0 - MARGIN),
        arm.link2.length * (1.0 + MARGIN),
        field.nodes(),
    );
    let lengths = interval.lengths();
    let nothing = PayloadProperties::new(0.0, 0.0, 0.0, PayloadInertia::Full);
    let sums: Vec<Integrals> = lengths
        .iter()
        .map(|a| Integrals::new(field, &nothing, *a))
        .collect();
    let n = field.link1.len();
    let slots = Slots::new(n);
    let largest = |values: &[f64]| values.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    let mut functions = vec![
        Sampled {
            values: vec![0.0; lengths.len()],
            scale: 0.0,
        };
        slots.count
    ];
    // rounding of the quadrature grows with what an entry could be
    let scales = |f: &dyn Fn(&Integrals) -> DMatrix<f64>| {
        let size = |i: usize| {
            sums.iter()
                .fold(0.0, |m: f64, s| m.max(f(s)[(1 + i, 1 + i)].abs()))
        };
        let sizes: Vec<f64> = (0..n).map(size).collect();
        move |i: usize, k: usize| libm::sqrt(sizes[i] * sizes[k])
    };
    let matrix = |f: &dyn Fn(&Integrals) -> DMatrix<f64>| -> Vec<DMatrix<f64>> {
        sums.iter().map(f).collect()
    };
    type Part<'a> = &'a dyn Fn(&Integrals) -> DMatrix<f64>;
    // Z is what two larger matrices leave of each other
    let both: Part = &|s| &s.offset + &s.centrifugal * load;
    let symmetric: [(usize, Part, Option<Part>); 5] = [
        (slots.mass, &|s| s.mass.clone(), None),
        (slots.bending, &|s| s.bending[1].clone(), None),
        (
            slots.turning,
            &|s| &s.offset - &s.centrifugal * load,
            Some(both),
        ),
        (slots.shortening, &|s| s.shortening.clone(), None),
        (slots.thrust, &|s| &s.thrust * load, None),
    ];
    for (slot, f, size) in symmetric {
        let (values, scale) = (matrix(f), scales(size.unwrap_or(f)));
        for i in 0..n {
            for k in 0..=i {
                functions[slot + packed(i, k)] = Sampled {
                    values: values.iter().map(|m| m[(1 + i, 1 + k)]).collect(),
                    scale: scale(i, k),
                };
            }
        }
    }
    let scale = scales(&|s| s.drift.clone());
    for i in 0..n {
        for k in 0..i {
            let half = |s: &Integrals| (s.drift[(1 + i, 1 + k)] - s.drift[(1 + k, 1 + i)]) / 2.0;
            functions[slots.skew + below(i, k)] = Sampled {
                values: sums.iter().map(half).collect(),
                scale: scale(i, k),
            };
        }
    }
    let start = arm.link1.length - arm.link2.length;
    for i in 0..n {
        let mut set = |slot: usize, values: Vec<f64>| {
            functions[slot + i] = Sampled {
                scale: largest(&values),
                values,
            };
        };
        set(
            slots.lead,
            sums.iter().map(|s| s.mass[(0, 1 + i)]).collect(),
        );
        set(
            slots.line,
            sums.iter().map(|s| s.offset_line[1 + i]).collect(),
        );
        let root = |a: &f64| field.inside(start + a);
        set(
            slots.root,
            lengths.iter().map(|a| root(a).deflection[1 + i]).collect(),
        );
        set(
            slots.root_slope,
            lengths.iter().map(|a| root(a).slope[1 + i]).collect(),
        );
    }
    Table::new(&interval, &functions)
}

/// Coordinates of 3 u^2 - u^3, or of what comes nearest to it in curvature, with its deflection of 2
/// at the end.
fn cantilever(basis: &ShapeBasis) -> Vec<f64> {
    let count = basis.len();
    let (mut gram, mut right) = (DMatrix::zeros(count, count), DVector::zeros(count));
    for (node, weight) in gauss_legendre(basis.quadrature_points() + 2) {
        let u = (1.0 + node) / 2.0;
        let curvatures = DVector::from_iterator(count, basis.at(u).into_iter().map(|s| s[2]));
        gram += &curvatures * curvatures.transpose() * weight;
        right += &curvatures * (weight * (6.0 - 6.0 * u));
    }
    let nearest = gram.lu().solve(&right).unwrap_or(right);
    let end: f64 = basis
        .at(1.0)
        .iter()
        .zip(nearest.iter())
        .map(|(s, c)| s[0] * c)
        .sum();
    nearest.iter().map(|c| c * 2.0 / end).collect()
}
