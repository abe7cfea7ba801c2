//! Displacement field of the slope-continuous arm and its integrals over the moving particles, by
//! quadrature at one length.

use nalgebra::DMatrix;

use crate::arm::mode_shape::{ShapeBasis, ShapeFamily};
use crate::arm::{Arm, PayloadProperties};
use crate::math::quadrature::gauss_legendre;

/// Largest number of coordinates: the slew angle and the modes of both links.
pub const CAPACITY: usize = 17;

/// A linear form of the coordinates: an entry a coordinate, the first that of the slew angle.
pub(crate) type Row = [f64; CAPACITY];

/// What a particle sees, as linear forms of the coordinates.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    /// Deflection w from the rotating axis (the row W).
    pub deflection: Row,
    /// dw/dxi.
    pub slope: Row,
    /// d2w/dxi2.
    pub curvature: Row,
    /// Change of w per unit of extension, following a particle of link 2 (the row D).
    pub drift: Row,
}

/// The tip of link 2: the forms of [`Place`] and the change of its slope per unit of extension.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tip {
    pub deflection: Row,
    pub slope: Row,
    pub drift: Row,
    pub slope_drift: Row,
}

/// Deflections of both links as linear forms of the coordinates.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Field {
    pub arm: Arm,
    pub link1: ShapeBasis,
    pub link2: ShapeBasis,
    /// Whether link 2 turns with the end slope of link 1.
    pub slope_turning: bool,
    /// Deflections of the shapes at their links' ends.
    pub end_deflection: Row,
    /// Their slopes there: per m for link 1, per fraction u of the length for link 2.
    pub end_slope: Row,
}

impl Field {
    /// Of an arm with `modes` shapes a link.
    pub fn new(arm: &Arm, family: ShapeFamily, modes: (usize, usize), slope_turning: bool) -> Self {
        let (link1, link2) = (
            ShapeBasis::new(family, modes.0),
            ShapeBasis::new(family, modes.1),
        );
        let (mut end_deflection, mut end_slope) = ([0.0; CAPACITY], [0.0; CAPACITY]);
        let per_m = link1
            .at(1.0)
            .into_iter()
            .map(|[value, slope, _]| (value, slope / arm.link1.length));
        let per_u = link2
            .at(1.0)
            .into_iter()
            .map(|[value, slope, _]| (value, slope));
        for (i, (value, slope)) in per_m.chain(per_u).enumerate() {
            (end_deflection[1 + i], end_slope[1 + i]) = (value, slope);
        }
        Self {
            arm: *arm,
            link1,
            link2,
            slope_turning,
            end_deflection,
            end_slope,
        }
    }

    /// Number of coordinates.
    pub fn size(&self) -> usize {
        1 + self.link1.len() + self.link2.len()
    }

    /// Gauss points that integrate every term over a part of the arm to rounding.
    pub fn points(&self) -> usize {
        // three more for the levers and the axial force beside the product of two shapes
        self.link1
            .quadrature_points()
            .max(self.link2.quadrature_points())
            + 3
    }

    /// Chebyshev nodes that resolve the integrals as functions of the length: the cut of an
    /// integral at the start of the overlap has twice the degree of a shape.
    pub fn nodes(&self) -> usize {
        2 * self.points()
    }

    /// A place on link 1, or in the part of link 2 inside it, at the distance xi from the shoulder.
    pub fn inside(&self, xi: f64) -> Place {
        let length = self.arm.link1.length;
        let mut place = Place {
            deflection: [0.0; CAPACITY],
            slope: [0.0; CAPACITY],
            curvature: [0.0; CAPACITY],
            drift: [0.0; CAPACITY],
        };
        for (i, [value, slope, curvature]) in self.link1.at(xi / length).into_iter().enumerate() {
            place.deflection[1 + i] = value;
            place.slope[1 + i] = slope / length;
            place.curvature[1 + i] = curvature / (length * length);
            place.drift[1 + i] = slope / length;
        }
        place
    }

    /// A place on link 2 outside link 1, `x` from the end of link 1, at the extension `a`.
    fn outside(&self, a: f64, x: f64) -> Place {
        let mut place = self.inside(self.arm.link1.length);
        place.curvature = [0.0; CAPACITY];
        if self.slope_turning {
            for i in 1..=self.link1.len() {
                place.deflection[i] += x * place.slope[i];
            }
        } else {
            place.slope = [0.0; CAPACITY];
            place.drift = [0.0; CAPACITY];
        }
        let (first, u) = (1 + self.link1.len(), x / a);
        for (i, [value, slope, curvature]) in self.link2.at(u).into_iter().enumerate() {
            place.deflection[first + i] = value;
            place.slope[first + i] = slope / a;
            place.curvature[first + i] = curvature / (a * a);
            // the particle moves out by one and the shape stretches with the length
            place.drift[first + i] = slope * (1.0 - u) / a;
        }
        place
    }

    /// Any place along the deflected arm, xi from the shoulder.
    pub fn place(&self, a: f64, xi: f64) -> Place {
        let end = self.arm.link1.length;
        if xi <= end {
            self.inside(xi)
        } else {
            self.outside(a, xi - end)
        }
    }

    /// The tip of link 2 at the extension `a`.
    pub fn tip(&self, a: f64) -> Tip {
        let turning = if self.slope_turning { 1.0 } else { 0.0 };
        let mut tip = Tip {
            deflection: self.end_deflection,
            slope: [0.0; CAPACITY],
            drift: [0.0; CAPACITY],
            slope_drift: [0.0; CAPACITY],
        };
        let first = 1 + self.link1.len();
        for i in 1..first {
            let slope = turning * self.end_slope[i];
            tip.deflection[i] += a * slope;
            (tip.slope[i], tip.drift[i]) = (slope, slope);
        }
        for i in first..self.size() {
            tip.slope[i] = self.end_slope[i] / a;
            tip.slope_drift[i] = -tip.slope[i] / a;
        }
        tip
    }

    /// Deflection and slope of link 1's end.
    pub fn link1_end(&self) -> [Row; 2] {
        [&self.end_deflection, &self.end_slope]
            .map(|row| std::array::from_fn(|i| if i <= self.link1.len() { row[i] } else { 0.0 }))
    }

    /// Deflection of link 2's end from the tangent at link 1's.
    pub fn link2_end(&self) -> Row {
        std::array::from_fn(|i| {
            if i <= self.link1.len() {
                0.0
            } else {
                self.end_deflection[i]
            }
        })
    }
}

/// Integrals over all particles at one length; every matrix has a row and a column a coordinate.
#[derive(Debug, Clone)]
pub(super) struct Integrals {
    /// M = int rho B^T B.
    pub mass: DMatrix<f64>,
    /// G = int rho B^T D.
    pub drift: DMatrix<f64>,
    /// H = int rho D^T D.
    pub drift_square: DMatrix<f64>,
    /// N = int rho W^T W.
    pub offset: DMatrix<f64>,
    /// int rho W over what moves out.
    pub offset_line: Row,
    /// int rho D over what moves out.
    pub drift_line: Row,
    /// Bending stiffness per that of link 1's and link 2's section, 1/m^3.
    pub bending: [DMatrix<f64>; 2],
    /// int P w_x^2 per square of the slew rate.
    pub centrifugal: DMatrix<f64>,
    /// int P w_x^2 per negative acceleration of the extension.
    pub thrust: DMatrix<f64>,
    /// int w_x^2 over link 2: of an axial force of 1 N.
    pub shortening: DMatrix<f64>,
}

impl Integrals {
    /// Sums over links and payload at the extension `a`.
    pub fn new(field: &Field, payload: &PayloadProperties, a: f64) -> Self {
        let size = field.size();
        let zero = || DMatrix::zeros(size, size);
        let mut sums = Self {
            mass: zero(),
            drift: zero(),
            drift_square: zero(),
            offset: zero(),
            offset_line: [0.0; CAPACITY],
            drift_line: [0.0; CAPACITY],
            bending: [zero(), zero()],
            centrifugal: zero(),
            thrust: zero(),
            shortening: zero(),
        };
        let (one, two) = (&field.arm.link1, &field.arm.link2);
        let reach = one.length + a;
        let centre = reach + payload.length / 2.0;
        // axial force of the particles of link 2 beyond xi and of the payload
        let start = reach - two.length;
        let pull = |xi: f64| {
            let mass = two.mass_per_length;
            [
                mass * (reach * reach - xi * xi) / 2.0 + payload.mass * centre,
                mass * (reach - xi) + payload.mass,
            ]
        };
        let rule = gauss_legendre(field.points());
        let mut over = |low: f64, high: f64, visit: &mut dyn FnMut(&mut Self, f64, f64)| {
            let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0);
            for &(node, weight) in &rule {
                visit(&mut sums, middle + half * node, half * weight);
            }
        };
        over(0.0, one.length, &mut |sums, xi, dx| {
            let place = field.inside(xi);
            sums.stay(xi, one.mass_per_length * dx, &place.deflection);
            add(&mut sums.bending[0], dx, &place.curvature, &place.curvature);
            let tension = one.mass_per_length * (one.length * one.length - xi * xi) / 2.0;
            add(
                &mut sums.centrifugal,
                tension * dx,
                &place.slope,
                &place.slope,
            );
        });
        let link2 = |sums: &mut Self, xi: f64, dx: f64, place: &Place| {
            sums.move_out(
                xi,
                two.mass_per_length * dx,
                &place.deflection,
                &place.drift,
            );
            add(&mut sums.bending[1], dx, &place.curvature, &place.curvature);
            let [turning, pushing] = pull(xi);
            add(
                &mut sums.centrifugal,
                turning * dx,
                &place.slope,
                &place.slope,
            );
            add(&mut sums.thrust, pushing * dx, &place.slope, &place.slope);
            add(&mut sums.shortening, dx, &place.slope, &place.slope);
        };
        // link 1 holds link 2 at its root and carries its force from there to the shoulder
        over(0.0, start, &mut |sums, xi, dx| {
            let slope = field.inside(xi).slope;
            let [turning, pushing] = pull(start);
            add(&mut sums.centrifugal, turning * dx, &slope, &slope);
            add(&mut sums.thrust, pushing * dx, &slope, &slope);
        });
        over(start, one.length, &mut |sums, xi, dx| {
            link2(sums, xi, dx, &field.inside(xi));
        });
        over(0.0, a, &mut |sums, x, dx| {
            link2(sums, one.length + x, dx, &field.outside(a, x));
        });
        let tip = field.tip(a);
        let lever = payload.length / 2.0;
        let at_centre = |at_tip: &Row, per_length: &Row| -> Row {
            std::array::from_fn(|i| at_tip[i] + lever * per_length[i])
        };
        sums.move_out(
            centre,
            payload.mass,
            &at_centre(&tip.deflection, &tip.slope),
            &at_centre(&tip.drift, &tip.slope_drift),
        );
        // the payload's centre draws near as the payload turns with the tip
        let near = payload.mass * lever;
        add(&mut sums.centrifugal, near * centre, &tip.slope, &tip.slope);
        add(&mut sums.thrust, near, &tip.slope, &tip.slope);
        let mut turn = tip.slope;
        turn[0] = 1.0;
        let inertia = payload.inertia_on_axis();
        add(&mut sums.mass, inertia, &turn, &turn);
        add(&mut sums.drift, inertia, &turn, &tip.slope_drift);
        add(
            &mut sums.drift_square,
            inertia,
            &tip.slope_drift,
            &tip.slope_drift,
        );
        sums
    }

    /// Kb of links with these sections, N m^2.
    pub fn stiffness(&self, sections: [f64; 2]) -> DMatrix<f64> {
        &self.bending[0] * sections[0] + &self.bending[1] * sections[1]
    }

    /// A mass (kg) at xi that turns with the arm.
    fn stay(&mut self, xi: f64, mass: f64, deflection: &Row) {
        let mut velocity = *deflection;
        velocity[0] = xi;
        add(&mut self.mass, mass, &velocity, &velocity);
        add(&mut self.offset, mass, deflection, deflection);
    }

    /// A mass (kg) at xi that also moves out.
    fn move_out(&mut self, xi: f64, mass: f64, deflection: &Row, drift: &Row) {
        self.stay(xi, mass, deflection);
        let mut velocity = *deflection;
        velocity[0] = xi;
        add(&mut self.drift, mass, &velocity, drift);
        add(&mut self.drift_square, mass, drift, drift);
        for i in 0..CAPACITY {
            self.offset_line[i] += mass * deflection[i];
            self.drift_line[i] += mass * drift[i];
        }
    }
}

/// sum += weight left^T right
fn add(sum: &mut DMatrix<f64>, weight: f64, left: &Row, right: &Row) {
    for (j, mut column) in sum.column_iter_mut().enumerate() {
        let scaled = weight * right[j];
        for (entry, left) in column.iter_mut().zip(left) {
            *entry += scaled * left;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The tip is the place at the reach, and drifts are rates of what a moving particle sees.
    #[test]
    fn drifts_are_differences_along_a_moving_particle() {
        for turning in [true, false] {
            let field = Field::new(&Arm::default(), ShapeFamily::Mono, (3, 2), turning);
            let (a, l1, h) = (3.0, field.arm.link1.length, 1e-5);
            let near = |x: &Row, y: &Row, tolerance: f64| {
                for i in 0..CAPACITY {
                    assert!((x[i] - y[i]).abs() < tolerance, "{i}: {} {}", x[i], y[i]);
                }
            };
            for xi in [1.3, 5.0, l1 + 0.4, l1 + 2.9] {
                let (ahead, behind) = (field.place(a + h, xi + h), field.place(a - h, xi - h));
                let difference: Row = std::array::from_fn(|i| {
                    (ahead.deflection[i] - behind.deflection[i]) / (2.0 * h)
                });
                near(&difference, &field.place(a, xi).drift, 1e-9);
            }
            let (tip, place) = (field.tip(a), field.place(a, l1 + a));
            near(&tip.deflection, &place.deflection, 1e-13);
            near(&tip.slope, &place.slope, 1e-13);
            near(&tip.drift, &place.drift, 1e-13);
            let (ahead, behind) = (field.tip(a + h), field.tip(a - h));
            let difference: Row =
                std::array::from_fn(|i| (ahead.slope[i] - behind.slope[i]) / (2.0 * h));
            near(&difference, &tip.slope_drift, 1e-9);
        }
    }
}
