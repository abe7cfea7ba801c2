//! Many pictures in one.

use super::palette::FAINT;
use super::scene::Look;

/// Places of equal size for some pictures in a large one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    /// Width and height of the whole, px.
    pub size: (u32, u32),
    /// Pictures beside each other.
    pub columns: u32,
    /// Pictures below each other.
    pub rows: u32,
}

impl Grid {
    /// For `count` pictures, as many beside each other as make each as near to 4 : 3 as can be.
    pub fn new(count: u32, size: (u32, u32)) -> Self {
        let count = count.max(1);
        let columns = (1..=count).min_by(|&a, &b| {
            let off = |columns: u32| {
                let rows = count.div_ceil(columns);
                let (w, h) = (f64::from(size.0), f64::from(size.1));
                let shape = w / f64::from(columns) / (h / f64::from(rows)) * 0.75;
                let empty = f64::from(columns * rows) / f64::from(count);
                shape.ln().abs() + empty.ln()
            };
            off(a).total_cmp(&off(b))
        });
        let columns = columns.unwrap_or(1);
        Self {
            size,
            columns,
            rows: count.div_ceil(columns),
        }
    }

    /// Width and height of one picture, px.
    pub fn tile(&self) -> (u32, u32) {
        let (width, height) = self.size;
        (
            (width / self.columns).saturating_sub(1).max(1),
            (height / self.rows).saturating_sub(1).max(1),
        )
    }

    /// The whole, of pictures that look so, row by row.
    pub fn join(&self, tiles: impl Iterator<Item = Vec<u8>>) -> Vec<u8> {
        let (width, height) = (self.size.0 as usize, self.size.1 as usize);
        let (across, down) = (self.tile().0 as usize, self.tile().1 as usize);
        let mut whole = FAINT.repeat(width * height);
        let columns = self.columns as usize;
        for (i, tile) in tiles.enumerate() {
            let left = (i % columns) * (width / columns);
            let top = (i / columns) * (height / self.rows as usize);
            for (row, bytes) in tile.chunks_exact(3 * across).take(down).enumerate() {
                let from = 3 * ((top + row) * width + left);
                if let Some(place) = whole.get_mut(from..from + bytes.len()) {
                    place.copy_from_slice(bytes);
                }
            }
        }
        whole
    }

    /// What a picture in it looks like.
    pub fn look(&self, title: String, colour: super::palette::Rgb) -> Look {
        let (width, height) = self.tile();
        Look {
            width,
            height,
            title,
            colour,
        }
    }
}
