//! Anti-aliased lines, areas and text on a pixel map.

use tiny_skia::{
    Color, FillRule, LineCap, LineJoin, Paint, Path, PathBuilder, PathSegment, Pixmap, Rect,
    Stroke, StrokeDash, Transform,
};

use super::font::{self, Weight};
use super::geometry::{Area, Point};
use super::palette::Rgb;

/// A colour and how much of what lies below it hides, 0 to 1.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tone(pub(super) Rgb, pub(super) f64);

impl From<Rgb> for Tone {
    fn from(rgb: Rgb) -> Self {
        Self(rgb, 1.0)
    }
}

/// Which point of a text is placed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    Left,
    Middle,
    Right,
}

/// Size and kind of a text.
#[derive(Clone, Copy, Debug)]
pub(super) struct Type {
    /// Size of the em square, px.
    pub(super) size: f64,
    pub(super) weight: Weight,
    pub(super) colour: Rgb,
}

/// Anti-aliased drawing in pixel coordinates; points that are not finite draw nothing.
#[derive(Clone)]
pub(super) struct Canvas {
    pixmap: Pixmap,
}

impl Canvas {
    /// A sheet of one colour, or none of a size the rasteriser cannot hold.
    pub(super) fn new(width: u32, height: u32, [r, g, b]: Rgb) -> Option<Self> {
        let mut pixmap = Pixmap::new(width, height)?;
        pixmap.fill(Color::from_rgba8(r, g, b, 255));
        Some(Self { pixmap })
    }

    /// Rows of red, green and blue bytes.
    pub(super) fn to_rgb(&self) -> Vec<u8> {
        let data = self.pixmap.data();
        let mut bytes = vec![0; data.len() / 4 * 3];
        // Four pixels at a time go in registers. `from_fn` stayed a call here, one for each byte, and
        // took a third of a picture's time.
        let (fours, rest) = data.as_chunks::<16>();
        let (places, end) = bytes.as_chunks_mut::<12>();
        for (to, &[r0, g0, b0, _, r1, g1, b1, _, r2, g2, b2, _, r3, g3, b3, _]) in
            places.iter_mut().zip(fours)
        {
            *to = [r0, g0, b0, r1, g1, b1, r2, g2, b2, r3, g3, b3];
        }
        for (to, from) in end.chunks_exact_mut(3).zip(rest.chunks_exact(4)) {
            to.copy_from_slice(&from[..3]);
        }
        bytes
    }

    /// Becomes a copy of another canvas of the same size.
    pub(super) fn copy(&mut self, other: &Self) {
        self.pixmap.data_mut().copy_from_slice(other.pixmap.data());
    }

    pub(super) fn polygon(&mut self, points: &[Point], tone: impl Into<Tone>) {
        let mut builder = PathBuilder::new();
        if trace(&mut builder, points) {
            builder.close();
            self.fill(builder, tone.into());
        }
    }

    pub(super) fn disc(&mut self, centre: Point, radius: f64, tone: impl Into<Tone>) {
        if radius > 0.0 && near(centre) && radius < 1e6 {
            let mut builder = PathBuilder::new();
            builder.push_circle(centre.0 as f32, centre.1 as f32, radius as f32);
            self.fill(builder, tone.into());
        }
    }

    /// An area whose edges are moved to whole pixels.
    pub(super) fn rectangle(&mut self, area: Area, tone: impl Into<Tone>) {
        let edges = [area.left, area.top, area.right, area.bottom].map(|edge| edge.round() as f32);
        let [left, top, right, bottom] = edges;
        if let Some(rectangle) = Rect::from_ltrb(left, top, right, bottom) {
            let mut paint = paint(tone.into());
            paint.anti_alias = false;
            self.pixmap
                .fill_rect(rectangle, &paint, Transform::identity(), None);
        }
    }

    /// An area with round ends.
    pub(super) fn pill(&mut self, area: Area, tone: impl Into<Tone>) {
        let radius = (area.height() / 2.0).min(area.width() / 2.0);
        let middle = (area.top + area.bottom) / 2.0;
        let ends = [
            (area.left + radius, middle),
            (area.right - radius, middle + 1e-3),
        ];
        let mut builder = PathBuilder::new();
        if trace(&mut builder, &ends) {
            let stroke = Stroke {
                width: area.height() as f32,
                line_cap: LineCap::Round,
                ..Stroke::default()
            };
            self.stroke(builder, &stroke, tone.into());
        }
    }

    pub(super) fn line(&mut self, points: &[Point], width: f64, tone: impl Into<Tone>) {
        self.dashed(points, width, tone, None);
    }

    /// A line of dashes and gaps of these lengths (px).
    pub(super) fn dashed(
        &mut self,
        points: &[Point],
        width: f64,
        tone: impl Into<Tone>,
        dash: Option<[f64; 2]>,
    ) {
        let mut builder = PathBuilder::new();
        if trace(&mut builder, points) {
            let stroke = Stroke {
                width: width as f32,
                line_join: LineJoin::Bevel,
                dash: dash.and_then(|d| StrokeDash::new(d.map(|v| v as f32).to_vec(), 0.0)),
                ..Stroke::default()
            };
            self.stroke(builder, &stroke, tone.into());
        }
    }

    fn fill(&mut self, builder: PathBuilder, tone: Tone) {
        if let Some(path) = builder.finish() {
            let transform = Transform::identity();
            self.pixmap
                .fill_path(&path, &paint(tone), FillRule::Winding, transform, None);
        }
    }

    fn stroke(&mut self, builder: PathBuilder, stroke: &Stroke, tone: Tone) {
        let Some(path) = builder.finish() else {
            return;
        };
        if stroke.width > 1.0 {
            let transform = Transform::identity();
            self.pixmap
                .stroke_path(&path, &paint(tone), stroke, transform, None);
            return;
        }
        // The rasteriser starts its pipeline anew for each pixel of so thin a line, which took half of a
        // picture's time.
        let tone = Tone(tone.0, tone.1 * f64::from(stroke.width));
        match &stroke.dash {
            Some(dash) => {
                if let Some(dashes) = path.dash(dash, 1.0) {
                    self.hairlines(&dashes, tone);
                }
            }
            None => self.hairlines(&path, tone),
        }
    }

    /// The straight lines of a path as [`trace`] makes it, a pixel thick.
    fn hairlines(&mut self, path: &Path, tone: Tone) {
        let place = |point: tiny_skia::Point| (f64::from(point.x), f64::from(point.y));
        let mut last = (0.0, 0.0);
        for segment in path.segments() {
            match segment {
                PathSegment::MoveTo(point) => last = place(point),
                PathSegment::LineTo(point) => {
                    self.hairline(last, place(point), tone);
                    last = place(point);
                }
                _ => {}
            }
        }
    }

    /// A straight line that is a pixel thick along the axis that it is less inclined to: two pixels of each
    /// column (or row), inked by what it covers of them.
    fn hairline(&mut self, from: Point, to: Point, Tone(colour, opacity): Tone) {
        let steep = (to.1 - from.1).abs() > (to.0 - from.0).abs();
        let turned = |point: Point| if steep { (point.1, point.0) } else { point };
        let [(x0, y0), (x1, y1)] = if turned(from).0 <= turned(to).0 {
            [turned(from), turned(to)]
        } else {
            [turned(to), turned(from)]
        };
        if x0 >= x1 {
            return;
        }
        let width = self.pixmap.width() as usize;
        let size = [width, self.pixmap.height() as usize];
        let [along, across] = if steep { [size[1], size[0]] } else { size };
        let slope = (y1 - y0) / (x1 - x0);
        let data = self.pixmap.data_mut();
        for column in x0.max(0.0) as usize..(x1.ceil().max(0.0) as usize).min(along) {
            let left = x0.max(column as f64);
            let right = x1.min(column as f64 + 1.0);
            // from a row above the picture on, so that casts round down; there is no instruction for `floor`
            let top = y0 + slope * ((left + right) / 2.0 - x0) + 0.5;
            if top < 0.0 {
                continue;
            }
            let below = top as usize;
            let ink = 255.0 * opacity * (right - left);
            let part = top - below as f64;
            for (row, share) in [(below, 1.0 - part), (below + 1, part)] {
                // counted from 1 here
                if row == 0 || row > across {
                    continue;
                }
                let row = row - 1;
                let place = if steep {
                    column * width + row
                } else {
                    row * width + column
                };
                let share = (ink * share).min(255.0) + 0.5;
                blend(&mut data[4 * place..4 * place + 3], colour, share as u32);
            }
        }
    }

    /// A curve that never goes back to the left, as drawn by a square brush of this width (px):
    /// column by column, so that one of thousands of points costs no more than one of few.
    pub(super) fn curve(&mut self, points: &[Point], width: f64, colour: Rgb) {
        let (Some(first), Some(last)) = (points.first(), points.last()) else {
            return;
        };
        if !points.iter().all(|&point| near(point)) {
            return;
        }
        let half = width / 2.0;
        let across = (half - 0.5).max(0.0);
        let (columns, rows) = (self.pixmap.width() as i32, self.pixmap.height() as i32);
        let from = ((first.0 - half).floor() as i32).max(0);
        let to = ((last.0 + half).ceil() as i32).min(columns);
        let data = self.pixmap.data_mut();
        let mut begin = 0;
        for column in from..to {
            let left = f64::from(column) - across;
            let right = f64::from(column + 1) + across;
            while begin + 1 < points.len() && points[begin + 1].0 < left {
                begin += 1;
            }
            let Some((low, high)) = span(&points[begin..], left, right) else {
                continue;
            };
            let (low, high) = (low - half, high + half);
            let rows = (low.floor() as i32).max(0)..(high.ceil() as i32).min(rows);
            for row in rows {
                let y = f64::from(row);
                let share = (high.min(y + 1.0) - low.max(y)).clamp(0.0, 1.0);
                let place = 4 * (row as usize * columns as usize + column as usize);
                blend(
                    &mut data[place..place + 3],
                    colour,
                    (share * 255.0).round() as u32,
                );
            }
        }
    }

    /// A text on a baseline; returns where it ends.
    pub(super) fn text(&mut self, at: Point, anchor: Anchor, kind: Type, text: &str) -> f64 {
        let length = match anchor {
            Anchor::Left => 0.0,
            Anchor::Middle => font::length(text, kind.weight, kind.size) / 2.0,
            Anchor::Right => font::length(text, kind.weight, kind.size),
        };
        let (left, base) = (at.0 - length, at.1.round());
        if !near((left, base)) {
            return left;
        }
        let (width, height) = (self.pixmap.width() as i32, self.pixmap.height() as i32);
        let data = self.pixmap.data_mut();
        let end = font::lay_out(
            text,
            kind.weight,
            kind.size as f32,
            left as f32,
            |pen, glyph| {
                for (row, values) in glyph.values.chunks_exact(glyph.width.max(1)).enumerate() {
                    let y = base as i32 + glyph.top + row as i32;
                    if y < 0 || y >= height {
                        continue;
                    }
                    for (column, &share) in values.iter().enumerate() {
                        let x = pen + glyph.left + column as i32;
                        if share == 0 || x < 0 || x >= width {
                            continue;
                        }
                        let place = 4 * (y as usize * width as usize + x as usize);
                        blend(&mut data[place..place + 3], kind.colour, u32::from(share));
                    }
                }
            },
        );
        f64::from(end)
    }
}

/// Mixes a colour into an opaque pixel; the share is of 255.
fn blend(pixel: &mut [u8], colour: Rgb, share: u32) {
    for (value, ink) in pixel.iter_mut().zip(colour) {
        let mixed = u32::from(*value) * (255 - share) + u32::from(ink) * share;
        *value = ((mixed + 127) / 255) as u8;
    }
}

/// Smallest and largest height of a curve between two places, if it is there.
fn span(points: &[Point], left: f64, right: f64) -> Option<(f64, f64)> {
    let mut found: Option<(f64, f64)> = None;
    let mut take = |y: f64| {
        found = Some(found.map_or((y, y), |(low, high)| (low.min(y), high.max(y))));
    };
    for (i, &(x, y)) in points.iter().enumerate() {
        if (left..=right).contains(&x) {
            take(y);
        }
        let Some(&(next, height)) = points.get(i + 1) else {
            break;
        };
        for edge in [left, right] {
            if x < edge && edge < next {
                take(y + (height - y) * (edge - x) / (next - x));
            }
        }
        if x > right {
            break;
        }
    }
    found
}

/// Whether a point is finite and not absurdly far away.
fn near(point: Point) -> bool {
    point.0.abs() < 1e6 && point.1.abs() < 1e6
}

/// Add an open contour, or nothing and false when a point cannot be drawn.
fn trace(builder: &mut PathBuilder, points: &[Point]) -> bool {
    let all = points.iter().all(|&point| near(point));
    if let (true, [first, rest @ ..]) = (all, points) {
        builder.move_to(first.0 as f32, first.1 as f32);
        rest.iter()
            .for_each(|p| builder.line_to(p.0 as f32, p.1 as f32));
    }
    all && !points.is_empty()
}

fn paint(Tone([r, g, b], share): Tone) -> Paint<'static> {
    let mut paint = Paint::default();
    paint.set_color_rgba8(r, g, b, (share.clamp(0.0, 1.0) * 255.0).round() as u8);
    paint
}
