//! Pictures of environments and of flights.

use std::sync::{Mutex, PoisonError};

use drm_env::error::{ConfigError, Error};
use drm_env::render::from_simulation::{magnification, stage};
use drm_env::render::palette::{PALETTE, Rgb};
use drm_env::render::{Extent, FILM_SIGNALS, Film as EngineFilm, Follower, Grid, Look, moment_of};
use drm_env::{interruption, memory};
use pyo3::prelude::*;

use crate::arrays::{In2, Out3};
use crate::batch::Batch;
use crate::config::Manoeuvre;
use crate::env::{Env, flight};
use crate::error::{Outcome, check_shape, detached};

/// Title and colour of pictures.
#[derive(Clone)]
struct Label {
    title: String,
    colour: Rgb,
}

impl Label {
    fn look(&self, width: u32, height: u32) -> Look {
        Look {
            width,
            height,
            title: self.title.clone(),
            colour: self.colour,
        }
    }
}

/// Refuses pictures for which there is no memory.
fn check_size(width: u32, height: u32) -> Result<(), Error> {
    let pixels = u128::from(width) * u128::from(height);
    let size = format!("{width} x {height}");
    // the canvas, what stays of it, and the bytes
    Ok(memory::check(
        "size",
        size,
        12 * pixels,
        None,
        "a smaller picture",
    )?)
}

fn frame(py: Python<'_>, width: u32, height: u32, bytes: Vec<u8>) -> Out3<'_, u8> {
    Out3::new(py, (height as usize, width as usize, 3), bytes)
}

/// Follows environments and draws them; what it remembers is no part of their state.
#[pyclass(frozen, module = "drm_env._engine")]
pub(crate) struct Painter {
    followers: Mutex<Vec<Follower>>,
    magnification: Option<f64>,
    label: Label,
}

impl Painter {
    fn with<T>(&self, work: impl FnOnce(&mut Vec<Follower>) -> T) -> T {
        // nothing that a panic has left half-done is more than a picture
        work(
            &mut self
                .followers
                .lock()
                .unwrap_or_else(PoisonError::into_inner),
        )
    }

    fn label_of(&self, index: usize) -> Label {
        let Label { title, colour } = self.label.clone();
        let title = if title.is_empty() {
            format!("environment {index}")
        } else {
            format!("{title} {index}")
        };
        Label { title, colour }
    }
}

#[pymethods]
impl Painter {
    /// For `count` environments.
    #[new]
    #[pyo3(signature = (count, magnification, title, colour))]
    fn new(count: usize, magnification: Option<f64>, title: String, colour: Rgb) -> Self {
        Self {
            followers: Mutex::new((0..count).map(|_| Follower::default()).collect()),
            magnification,
            label: Label { title, colour },
        }
    }

    /// Takes the present instant of an environment; `restart` forgets what was before.
    fn follow(&self, py: Python<'_>, env: &Env, restart: bool) -> Outcome<()> {
        env.engine().look(py, |engine| {
            flight(engine)?;
            Ok(self.with(|followers| followers[0].take(engine, restart))?)
        })
    }

    /// The same of every environment of a batch.
    fn follow_batch(&self, py: Python<'_>, batch: &Batch, restart: bool) -> Outcome<()> {
        batch.engine().look(py, |engine| {
            self.with(|followers| {
                for (index, follower) in followers.iter_mut().enumerate() {
                    interruption::poll();
                    if let Some(env) = engine.env(index)
                        && env.has_reset()
                    {
                        follower.take(&env, restart)?;
                    }
                }
                Ok(())
            })
        })
    }

    /// A picture of an environment, (height, width, 3).
    fn frame<'py>(
        &self,
        py: Python<'py>,
        env: &Env,
        width: u32,
        height: u32,
    ) -> Outcome<Out3<'py, u8>> {
        let bytes = env.engine().look(py, |engine| {
            check_size(width, height)?;
            flight(engine)?;
            self.with(|followers| {
                followers[0].take(engine, false)?;
                let look = self.label.look(width, height);
                Ok(followers[0].draw(&look, self.magnification))
            })
        })?;
        Ok(frame(py, width, height, bytes))
    }

    /// A picture of one environment of a batch, (height, width, 3).
    fn frame_of<'py>(
        &self,
        py: Python<'py>,
        batch: &Batch,
        index: usize,
        width: u32,
        height: u32,
    ) -> Outcome<Out3<'py, u8>> {
        let bytes = batch.env(py, index, |env| {
            check_size(width, height)?;
            flight(env)?;
            self.with(|followers| {
                followers[index].take(env, false)?;
                let look = self.label.look(width, height);
                Ok(followers[index].draw(&look, self.magnification))
            })
        })?;
        Ok(frame(py, width, height, bytes))
    }

    /// A picture of the first `count` environments of a batch beside and below each other,
    /// (height, width, 3).
    fn grid<'py>(
        &self,
        py: Python<'py>,
        batch: &Batch,
        count: usize,
        width: u32,
        height: u32,
    ) -> Outcome<Out3<'py, u8>> {
        let bytes = batch.engine().look(py, |engine| {
            check_size(width, height)?;
            let count = count.min(engine.len());
            let grid = Grid::new(u32::try_from(count).unwrap_or(1), (width, height));
            self.with(|followers| {
                let mut tiles = Vec::with_capacity(count);
                for (index, follower) in followers.iter_mut().enumerate().take(count) {
                    interruption::poll();
                    let Some(env) = engine.env(index) else {
                        continue;
                    };
                    flight(&env)?;
                    follower.take(&env, false)?;
                    let Label { title, colour } = self.label_of(index);
                    tiles.push(follower.draw(&grid.look(title, colour), self.magnification));
                }
                Ok(grid.join(tiles.into_iter()))
            })
        })?;
        Ok(frame(py, width, height, bytes))
    }
}

/// Smallest and largest tip error (m), tip deflection (m) and slew angle (rad).
type Ranges = [[f64; 2]; 3];

/// A flight that has been flown, to be drawn at any instant.
#[pyclass(frozen, module = "drm_env._engine")]
pub(crate) struct Film(Mutex<EngineFilm>);

impl Film {
    fn with<T>(&self, work: impl FnOnce(&mut EngineFilm) -> T) -> T {
        work(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

#[pymethods]
impl Film {
    /// Of a manoeuvre and the signals of its flight, an instant a row, in the order of
    /// `film_signals`.
    #[new]
    #[pyo3(signature = (scenario, signals, diverged, factor))]
    fn new(
        py: Python<'_>,
        scenario: Manoeuvre,
        signals: In2<f64>,
        diverged: bool,
        factor: Option<f64>,
    ) -> Outcome<Self> {
        let rows = signals.shape()[0];
        check_shape("signals", signals.shape(), &[rows, FILM_SIGNALS.len()])?;
        detached(py, || {
            let scenario = scenario.scenario(None)?;
            let factor = factor.unwrap_or_else(|| magnification(&scenario));
            let (rows, _) = signals.slice().as_chunks::<{ FILM_SIGNALS.len() }>();
            let moments = rows.iter().map(moment_of).collect();
            let film = EngineFilm::new(stage(&scenario, factor)?, moments, diverged);
            Ok::<_, ConfigError>(Self(Mutex::new(film)))
        })
    }

    /// Factor by which deflections are drawn larger.
    #[getter]
    fn magnification(&self) -> f64 {
        self.with(|film| film.stage().magnification)
    }

    /// Smallest and largest tip error (m), tip deflection (m) and slew angle (rad) of the flight.
    fn ranges(&self) -> Ranges {
        self.with(|film| {
            let Extent {
                error,
                deflection,
                slew,
                ..
            } = *film.extent();
            [error, deflection, slew]
        })
    }

    /// Lets curves and camera hold the ranges of another flight too.
    fn widen(&self, ranges: Ranges) {
        let [error, deflection, slew] = ranges;
        self.with(|film| {
            film.widen(&Extent {
                error,
                deflection,
                slew,
                ..Extent::NOTHING
            });
        });
    }

    /// The picture at a time (s), (height, width, 3).
    fn frame<'py>(
        &self,
        py: Python<'py>,
        time: f64,
        size: (u32, u32),
        title: String,
        colour: Rgb,
    ) -> Outcome<Out3<'py, u8>> {
        let (width, height) = size;
        let bytes = detached(py, || {
            check_size(width, height)?;
            let look = Label { title, colour }.look(width, height);
            Ok::<_, Error>(self.with(|film| film.draw(&look, time)))
        })?;
        Ok(frame(py, width, height, bytes))
    }
}

/// Names of the signals that a film needs, in order.
#[pyfunction]
pub(crate) fn film_signals() -> Vec<&'static str> {
    FILM_SIGNALS.to_vec()
}

/// Red, green and blue of the colours of all pictures, by name.
#[pyfunction]
pub(crate) fn palette() -> Vec<(&'static str, Rgb)> {
    PALETTE.to_vec()
}
