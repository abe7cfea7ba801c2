//! The arm in world coordinates (metres, the shoulder at the origin), with deflections magnified.

use std::f64::consts::PI;

use super::geometry::{Point, finite, polar, ratio};
use super::scene::{Moment, Stage};

/// Largest drawn deflection as a fraction of the reach; beyond it the factor is reduced.
pub(super) const MOST_DRAWN_DEFLECTION: f64 = 0.35;
/// Largest drawn turn of the payload against the axis, rad.
const MOST_DRAWN_SLOPE: f64 = PI / 3.0;
/// Pieces of a link's centre line.
const PIECES: usize = 24;

/// Half widths at both ends of link 1 and of link 2, as fractions of the longest reach: drawn wider
/// than they are, so that they can be seen.
const WIDTHS: [[f64; 2]; 2] = [[0.042, 0.033], [0.024, 0.017]];
/// Radius of a payload of 500 kg, as a fraction of the longest reach.
const PAYLOAD: f64 = 0.05;
/// Smallest and largest radius of a payload, likewise.
const PAYLOADS: [f64; 2] = [0.012, 0.09];

/// The longest distance from the shoulder to the tip, m.
pub(super) fn longest_reach(stage: &Stage) -> f64 {
    let length = |value: f64| finite(value, 0.0).clamp(0.0, 1e6);
    let longest = stage.path.iter().map(|at| length(at.1)).fold(0.0, f64::max);
    let reach = length(stage.link1_length) + longest;
    if reach > 1e-6 { reach } else { 1.0 }
}

/// Radius at which a mass (kg) is drawn, m: its area is proportional to it. None without a mass.
pub(super) fn payload_radius(stage: &Stage, mass: f64) -> Option<f64> {
    (mass > 0.0).then(|| {
        let [least, most] = PAYLOADS;
        longest_reach(stage) * (PAYLOAD * (mass / 500.0).sqrt()).clamp(least, most)
    })
}

/// A payload: where its middle is, and the radii of its true and reported mass.
#[derive(Clone, Copy)]
pub(super) struct Load {
    pub(super) centre: Point,
    pub(super) radius: Option<f64>,
    pub(super) reported: Option<f64>,
}

/// The arm at an instant.
pub(super) struct Arm {
    /// By which deflections are drawn larger.
    pub(super) magnification: f64,
    /// Whether that is less than it should be.
    pub(super) reduced: bool,
    /// Centre lines of the links; link 2 inside link 1 and outside.
    pub(super) link1: Vec<Point>,
    pub(super) inner: Vec<Point>,
    pub(super) outer: Vec<Point>,
    pub(super) tip: Point,
    /// Direction of link 2 at its end, rad.
    pub(super) tip_angle: f64,
    pub(super) load: Load,
}

impl Arm {
    /// The arm as it is; none if it is nowhere.
    pub(super) fn bent(stage: &Stage, moment: &Moment) -> Option<Self> {
        let turn = moment.tip_deflection - 2.0 * (moment.alpha + moment.beta);
        Self::new(
            stage,
            moment,
            moment.slew_angle,
            [moment.alpha, moment.beta, turn],
        )
    }

    /// The rigid arm that follows the reference.
    pub(super) fn reference(stage: &Stage, moment: &Moment) -> Option<Self> {
        Self::new(stage, moment, moment.reference_angle, [0.0; 3])
    }

    fn new(
        stage: &Stage,
        moment: &Moment,
        angle: f64,
        [alpha, beta, turn]: [f64; 3],
    ) -> Option<Self> {
        let given = [stage.link1_length, stage.link2_length, moment.extension];
        let numbers = [angle, alpha, beta, turn];
        if !given.iter().all(|l| (0.0..1e6).contains(l)) || !numbers.iter().all(|v| v.is_finite()) {
            return None;
        }
        let [l1, l2, a] = given;
        let wanted = finite(stage.magnification, 1.0).clamp(0.0, 1e9);
        let largest = (2.0 * alpha).abs().max((2.0 * (alpha + beta) + turn).abs());
        let limit = MOST_DRAWN_DEFLECTION * longest_reach(stage) / largest;
        let reduced = limit < wanted;
        let magnification = if reduced { limit } else { wanted };
        let phi = |u: f64| (3.0 - u) * u * u;
        let y1 = |x: f64| magnification * alpha * phi(ratio(x, l1));
        let y2 = |x: f64| {
            let u = ratio(x - l1, a);
            magnification * (2.0 * alpha + turn * u + beta * phi(u))
        };
        let (sin, cos) = angle.sin_cos();
        let place = |x: f64, y: f64| (x * cos - y * sin, x * sin + y * cos);
        let sweep = |from: f64, to: f64, y: &dyn Fn(f64) -> f64| -> Vec<Point> {
            let at = |i: usize| from + (to - from) * i as f64 / PIECES as f64;
            (0..=PIECES).map(|i| place(at(i), y(at(i)))).collect()
        };
        let tip = place(l1 + a, y2(l1 + a));
        // the beam's own slope at the tip: that of link 2's mode, and what turns it
        let slope = magnification * ratio(3.0 * beta + turn, a);
        let tip_angle = angle + slope.atan().clamp(-MOST_DRAWN_SLOPE, MOST_DRAWN_SLOPE);
        let radius = payload_radius(stage, stage.payload_mass);
        let reported = payload_radius(stage, stage.reported_mass);
        let ahead = polar(radius.unwrap_or(0.0), tip_angle);
        Some(Self {
            magnification,
            reduced,
            link1: sweep(0.0, l1, &y1),
            inner: sweep((l1 - (l2 - a).max(0.0)).max(0.0), l1, &y1),
            outer: sweep(l1, l1 + a, &y2),
            tip,
            tip_angle,
            load: Load {
                centre: (tip.0 + ahead.0, tip.1 + ahead.1),
                radius,
                reported,
            },
        })
    }

    /// Outlines of link 1 and of link 2 inside and outside it, so much larger (m).
    pub(super) fn bodies(&self, stage: &Stage, larger: f64) -> [Vec<Point>; 3] {
        let reach = longest_reach(stage);
        let [one, two] = WIDTHS.map(|ends| ends.map(|share| share * reach + larger));
        [
            widened(&self.link1, one),
            widened(&self.inner, [two[0]; 2]),
            widened(&self.outer, two),
        ]
    }

    /// The lattice within link 1, from end to end.
    pub(super) fn lattice(&self, stage: &Stage) -> Vec<Point> {
        let reach = longest_reach(stage);
        let [from, to] = WIDTHS[0].map(|share| share * reach);
        let last = self.link1.len() - 1;
        (0..=last)
            .map(|i| {
                let width = from + (to - from) * i as f64 / last as f64;
                beside(&self.link1, i, if i % 2 == 0 { width } else { -width })
            })
            .collect()
    }

    /// The collar of link 1 that link 2 slides through.
    pub(super) fn collar(&self, stage: &Stage) -> Vec<Point> {
        let width = 1.25 * WIDTHS[0][1] * longest_reach(stage);
        let last = self.link1.len() - 1;
        let line = [self.link1[last - 1], self.link1[last]];
        widened(&line, [width; 2])
    }
}

/// A point beside point `i` of a line, `distance` to the left.
fn beside(line: &[Point], i: usize, distance: f64) -> Point {
    let before = line[i.saturating_sub(1)];
    let after = line[(i + 1).min(line.len() - 1)];
    let (x, y) = (after.0 - before.0, after.1 - before.1);
    let length = x.hypot(y);
    let (nx, ny) = if length > 0.0 {
        (-y / length, x / length)
    } else {
        (0.0, 0.0)
    };
    (line[i].0 + distance * nx, line[i].1 + distance * ny)
}

/// The outline of a line that is so wide to each side at its ends.
fn widened(line: &[Point], [from, to]: [f64; 2]) -> Vec<Point> {
    let last = (line.len() - 1).max(1) as f64;
    let width = |i: usize| from + (to - from) * i as f64 / last;
    let left = (0..line.len()).map(|i| beside(line, i, width(i)));
    let right = (0..line.len()).rev().map(|i| beside(line, i, -width(i)));
    left.chain(right).collect()
}
