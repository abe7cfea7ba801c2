//! Points, areas and turns.

/// Horizontal and vertical: metres in the world, pixels (downwards) in a picture.
pub(super) type Point = (f64, f64);

/// A rectangle in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Area {
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) right: f64,
    pub(super) bottom: f64,
}

impl Area {
    pub(super) fn new(left: f64, top: f64, right: f64, bottom: f64) -> Self {
        Self {
            left,
            top,
            right,
            bottom,
        }
    }

    pub(super) fn width(&self) -> f64 {
        self.right - self.left
    }

    pub(super) fn height(&self) -> f64 {
        self.bottom - self.top
    }

    /// The area without a margin on each side.
    pub(super) fn within(&self, across: f64, down: f64) -> Self {
        Self::new(
            self.left + across,
            self.top + down,
            self.right - across,
            self.bottom - down,
        )
    }
}

pub(super) fn polar(radius: f64, angle: f64) -> Point {
    let (sin, cos) = angle.sin_cos();
    (radius * cos, radius * sin)
}

/// Points in pixels on an arc around `centre`, counter-clockwise for a positive `turn`.
pub(super) fn arc(centre: Point, radius: f64, from: f64, turn: f64) -> Vec<Point> {
    let count = (turn.abs() * radius.max(0.0).sqrt() * 4.0).clamp(8.0, 90.0) as i32;
    let at = |i: i32| polar(radius, from + turn * f64::from(i) / f64::from(count));
    (0..=count)
        .map(at)
        .map(|(x, y)| (centre.0 + x, centre.1 - y))
        .collect()
}

pub(super) fn mix(a: Point, b: Point, s: f64) -> Point {
    (a.0 + s * (b.0 - a.0), a.1 + s * (b.1 - a.1))
}

/// The value, or another where it is not finite.
pub(super) fn finite(value: f64, otherwise: f64) -> f64 {
    if value.is_finite() { value } else { otherwise }
}

/// `part / whole`, or zero where there is no whole.
pub(super) fn ratio(part: f64, whole: f64) -> f64 {
    if whole > 0.0 { part / whole } else { 0.0 }
}

/// The smallest number of one digit, times a power of ten, that is not below a positive value.
pub(super) fn rounded_up(value: f64) -> f64 {
    if !(value > 0.0 && value.is_finite()) {
        return 0.0;
    }
    let decade = 10f64.powf(value.log10().floor());
    let steps = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0];
    let found = steps
        .iter()
        .find(|step| **step * decade >= value * (1.0 - 1e-9));
    found.unwrap_or(&10.0) * decade
}
