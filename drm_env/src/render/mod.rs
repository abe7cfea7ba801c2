//! Pictures of the arm seen from above: RGB rasters for windows and films, text for terminals.
//!
//! World coordinates are metres with the shoulder at the origin, x along slew angle zero and y to
//! the left of it, so positive angles and deflections turn counter-clockwise in the picture.
//!
//! A [`Tracker`] is told of the instants of a flight as they pass and draws the present one, with the
//! trail and the curves of what has passed; a [`Film`] draws any instant of a flight that has been
//! flown. Both keep what they remember: the physics knows of neither.

mod ansi;
mod arm;
mod canvas;
mod film;
mod follower;
mod font;
mod frame;
pub mod from_simulation;
mod geometry;
mod grid;
pub mod palette;
mod panels;
mod scene;
mod text;
mod tracker;
mod view;

pub use ansi::ansi;
pub use film::{FILM_SIGNALS, Film, moment_of};
pub use follower::Follower;
pub use grid::Grid;
pub use scene::{Ending, Extent, Look, Moment, Payment, Stage};
pub use tracker::Tracker;

#[cfg(test)]
mod tests;
