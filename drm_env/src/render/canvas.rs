//! Anti-aliased lines, areas and text on a pixel map.

use font8x8::legacy::BASIC_LEGACY;
use tiny_skia::{Color, FillRule, Paint, PathBuilder, Pixmap, Stroke, StrokeDash, Transform};

use super::{Point, Rgb};

/// Anti-aliased drawing in pixel coordinates; points that are not finite draw nothing.
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
    pub(super) fn into_rgb(self) -> Vec<u8> {
        let pixels = self.pixmap.data().chunks_exact(4);
        pixels.flat_map(|p| [p[0], p[1], p[2]]).collect()
    }

    pub(super) fn polygon(&mut self, points: &[Point], rgb: Rgb) {
        let mut builder = PathBuilder::new();
        if trace(&mut builder, points) {
            builder.close();
            self.fill(builder, rgb);
        }
    }

    pub(super) fn fill(&mut self, builder: PathBuilder, rgb: Rgb) {
        if let Some(path) = builder.finish() {
            let transform = Transform::identity();
            self.pixmap
                .fill_path(&path, &paint(rgb), FillRule::Winding, transform, None);
        }
    }

    pub(super) fn line(&mut self, points: &[Point], width: f64, rgb: Rgb, dash: Option<[f64; 2]>) {
        let mut builder = PathBuilder::new();
        if !trace(&mut builder, points) {
            return;
        }
        if let Some(path) = builder.finish() {
            let dash = dash.and_then(|d| StrokeDash::new(d.map(|v| v as f32).to_vec(), 0.0));
            let stroke = Stroke {
                width: width as f32,
                dash,
                ..Stroke::default()
            };
            let transform = Transform::identity();
            self.pixmap
                .stroke_path(&path, &paint(rgb), &stroke, transform, None);
        }
    }

    /// ASCII text from its top left corner, `size` pixels a character, a third higher than wide.
    pub(super) fn text(&mut self, (left, top): Point, size: f64, text: &str, rgb: Rgb) {
        let mut builder = PathBuilder::new();
        for (i, byte) in text.bytes().enumerate() {
            let glyph = BASIC_LEGACY[usize::from(byte.min(127))];
            let lit = |x: usize, y: usize| x < 8 && y < 8 && glyph[y] >> x & 1 == 1;
            let mut shape = |corners: [Point; 4]| {
                let at = |(x, y)| (left + (i as f64 + x / 8.0) * size, top + y / 6.0 * size);
                if trace(&mut builder, &corners.map(at)) {
                    builder.close();
                }
            };
            for (x, y) in (0..64).map(|n| (n % 8, n / 8)) {
                let (u, v) = (x as f64, y as f64);
                if lit(x, y) {
                    shape([(u, v), (u + 1.0, v), (u + 1.0, v + 1.0), (u, v + 1.0)]);
                }
                // Bridging dots that touch only at a corner turns staircases into diagonals.
                let (a, b, c, d) = (lit(x, y), lit(x + 1, y), lit(x, y + 1), lit(x + 1, y + 1));
                if a == d && b == c && a != b {
                    shape([
                        (u + 1.0, v),
                        (u + 2.0, v + 1.0),
                        (u + 1.0, v + 2.0),
                        (u, v + 1.0),
                    ]);
                }
            }
        }
        self.fill(builder, rgb);
    }
}

/// Add an open contour, or nothing and false when a point is not finite or absurdly far away.
fn trace(builder: &mut PathBuilder, points: &[Point]) -> bool {
    let near = points.iter().all(|p| p.0.abs() < 1e6 && p.1.abs() < 1e6);
    if let (true, [first, rest @ ..]) = (near, points) {
        builder.move_to(first.0 as f32, first.1 as f32);
        rest.iter()
            .for_each(|p| builder.line_to(p.0 as f32, p.1 as f32));
    }
    near && !points.is_empty()
}

fn paint([r, g, b]: Rgb) -> Paint<'static> {
    let mut paint = Paint::default();
    paint.set_color_rgba8(r, g, b, 255);
    paint
}
