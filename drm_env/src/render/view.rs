//! The camera: it sees what the manoeuvre needs and stays.

use super::arm::{longest_reach, payload_radius};
use super::geometry::{Area, Point, finite, polar};
use super::scene::{Extent, Stage};

/// Room for deflections beside the arm, as a fraction of the reach.
const BESIDE: f64 = 0.1;
/// Room around the shoulder, likewise.
const AROUND: f64 = 0.11;
/// Slew angles beyond those of the reference: this many radians and this share of the slew.
const BEYOND: (f64, f64) = (0.05, 0.1);

/// Pixels per metre and the shoulder's pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct View {
    pub(super) scale: f64,
    pub(super) origin: Point,
    /// The smallest and the largest slew angle that the picture is made for, rad.
    pub(super) sector: (f64, f64),
}

impl View {
    /// Fits what the manoeuvre and the slew angles of an extent need into an area.
    pub(super) fn new(stage: &Stage, extent: &Extent, area: Area) -> Self {
        let reach = longest_reach(stage);
        let load = payload_radius(stage, stage.payload_mass).unwrap_or(0.0);
        let target = finite(stage.target_angle, 0.0).clamp(-7.0, 7.0);
        let beyond = BEYOND.0 + BEYOND.1 * target.abs();
        // rounded, so that the camera moves rarely where an arm goes astray
        let step = 0.1;
        let low = (extent.slew[0] / step).floor() * step;
        let high = (extent.slew[1] / step).ceil() * step;
        let mut sector = (target.min(0.0) - beyond, target.max(0.0) + beyond);
        if extent.slew[0] < sector.0 {
            sector.0 = low.max(-7.0);
        }
        if extent.slew[1] > sector.1 {
            sector.1 = high.min(7.0);
        }
        let around = AROUND * reach;
        let mut low = (-around, -around);
        let mut high = (around, around);
        let mut see = |radius: f64, angle: f64, beside: f64| {
            let end = polar(radius, angle);
            let across = polar(beside, angle + std::f64::consts::FRAC_PI_2);
            for sign in [-1.0, 1.0] {
                let (x, y) = (end.0 + sign * across.0, end.1 + sign * across.1);
                low = (low.0.min(x), low.1.min(y));
                high = (high.0.max(x), high.1.max(y));
            }
        };
        for &(angle, extension) in &stage.path {
            if angle.is_finite() && extension.is_finite() {
                let length = (stage.link1_length + extension).clamp(0.0, 1e6);
                see(finite(length, reach) + 2.0 * load, angle, BESIDE * reach);
            }
        }
        for i in 0..=24 {
            let angle = sector.0 + (sector.1 - sector.0) * f64::from(i) / 24.0;
            see(reach + 2.0 * load, angle, 0.0);
        }
        let scale = (area.width() / (high.0 - low.0)).min(area.height() / (high.1 - low.1));
        let middle = (
            (area.left + area.right) / 2.0,
            (area.top + area.bottom) / 2.0,
        );
        Self {
            scale: scale.max(1e-9),
            origin: (
                middle.0 - scale * (low.0 + high.0) / 2.0,
                middle.1 + scale * (low.1 + high.1) / 2.0,
            ),
            sector,
        }
    }

    pub(super) fn pixel(&self, (x, y): Point) -> Point {
        let (left, top) = self.origin;
        (left + self.scale * x, top - self.scale * y)
    }

    pub(super) fn pixels(&self, points: &[Point]) -> Vec<Point> {
        points.iter().map(|&point| self.pixel(point)).collect()
    }
}
