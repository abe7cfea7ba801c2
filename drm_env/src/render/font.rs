//! Glyphs of the embedded fonts as coverage, each rasterised once a thread.

use std::cell::RefCell;
use std::collections::HashMap;
use std::rc::Rc;

use ab_glyph::{Font, FontRef, GlyphId, PxScale, ScaleFont, point};

/// Inter, cut down to Latin-1 with digits of equal width: see `fonts/LICENSE` and `tools/subset_font.py`.
const FILES: [&[u8]; 2] = [
    include_bytes!("fonts/Inter-Regular.ttf"),
    include_bytes!("fonts/Inter-SemiBold.ttf"),
];

/// Steps of a pixel at which a glyph may begin.
const STEPS: f32 = 4.0;

/// Glyphs that are kept; more sizes than that are not in use at once.
const MOST_KEPT: usize = 4096;

/// How heavy a text is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Weight {
    Regular,
    Bold,
}

/// Coverage of one glyph, row by row, and where it lies from the whole pixel of the pen.
pub(super) struct Coverage {
    pub(super) left: i32,
    pub(super) top: i32,
    pub(super) width: usize,
    pub(super) values: Vec<u8>,
}

/// Face, glyph, size and place within the pixel, the latter two in steps.
type Key = (usize, u16, u16, u8);

struct Fonts {
    /// None where a file cannot be read, which a test would notice; no text is drawn then.
    faces: [Option<FontRef<'static>>; 2],
    kept: HashMap<Key, Option<Rc<Coverage>>>,
}

thread_local! {
    static FONTS: RefCell<Fonts> = RefCell::new(Fonts {
        faces: FILES.map(|file| FontRef::try_from_slice(file).ok()),
        kept: HashMap::new(),
    });
}

/// Height of a font's lines for a size of the em square, both px.
fn scale(face: &FontRef<'static>, size: f32) -> PxScale {
    let em = face.units_per_em().unwrap_or(1000.0);
    PxScale::from(size * face.height_unscaled() / em)
}

/// Calls `place` with each glyph of a text and the whole pixel of its pen, starting at `left` (px);
/// returns where the text ends.
pub(super) fn lay_out(
    text: &str,
    weight: Weight,
    size: f32,
    left: f32,
    mut place: impl FnMut(i32, &Coverage),
) -> f32 {
    FONTS.with_borrow_mut(|fonts| {
        let Fonts { faces, kept } = fonts;
        let index = weight as usize;
        let Some(face) = &faces[index] else {
            return left;
        };
        if kept.len() > MOST_KEPT {
            kept.clear();
        }
        let scaled = face.as_scaled(scale(face, size));
        let quarters = (size * STEPS).round() as u16;
        let mut pen = left;
        let mut before: Option<GlyphId> = None;
        for letter in text.chars() {
            let glyph = face.glyph_id(letter);
            if let Some(before) = before {
                pen += scaled.kern(before, glyph);
            }
            before = Some(glyph);
            let steps = (pen * STEPS).round();
            let whole = (steps / STEPS).floor();
            let part = (steps - whole * STEPS) as u8;
            let coverage = kept
                .entry((index, glyph.0, quarters, part))
                .or_insert_with(|| rasterise(face, glyph, size, f32::from(part) / STEPS));
            if let Some(coverage) = coverage {
                place(whole as i32, coverage);
            }
            pen += scaled.h_advance(glyph);
        }
        pen
    })
}

/// Length of a text, px.
pub(super) fn length(text: &str, weight: Weight, size: f64) -> f64 {
    FONTS.with_borrow(|fonts| {
        let Some(face) = &fonts.faces[weight as usize] else {
            return 0.0;
        };
        let scaled = face.as_scaled(scale(face, size as f32));
        let advance = |letter| scaled.h_advance(face.glyph_id(letter));
        f64::from(text.chars().map(advance).sum::<f32>())
    })
}

fn rasterise(
    face: &FontRef<'static>,
    glyph: GlyphId,
    size: f32,
    part: f32,
) -> Option<Rc<Coverage>> {
    let placed = glyph.with_scale_and_position(scale(face, size), point(part, 0.0));
    let outlined = face.outline_glyph(placed)?;
    let bounds = outlined.px_bounds();
    let width = bounds.width() as usize;
    let mut values = vec![0; width * bounds.height() as usize];
    outlined.draw(|x, y, share| {
        if let Some(value) = values.get_mut(y as usize * width + x as usize) {
            *value = (share.clamp(0.0, 1.0) * 255.0).round() as u8;
        }
    });
    Some(Rc::new(Coverage {
        left: bounds.min.x as i32,
        top: bounds.min.y as i32,
        width,
        values,
    }))
}
