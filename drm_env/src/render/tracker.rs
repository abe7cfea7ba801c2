//! Pictures of a flight under way: what has been seen of it is remembered, outside the physics.

use super::frame::{Backdrop, Frame};
use super::scene::{Ending, Extent, Look, Moment, Sample, Stage};

/// Most instants that are remembered: then every second one is forgotten, and from there on.
const CAPACITY: usize = 4096;
/// Pictures of different looks whose still parts are kept.
const BACKDROPS: usize = 2;

/// What has been seen of one manoeuvre so far.
pub struct Tracker {
    stage: Stage,
    samples: Vec<Sample>,
    /// Instants of which one is remembered, and how many have passed since.
    stride: usize,
    passed: usize,
    extent: Extent,
    /// The last instant that an arm can be in.
    shown: Option<Moment>,
    ending: Ending,
    backdrops: Vec<Option<Backdrop>>,
}

impl Tracker {
    /// Nothing has been seen yet.
    pub fn new(stage: Stage) -> Self {
        Self {
            stage,
            samples: Vec::new(),
            stride: 1,
            passed: 0,
            extent: Extent::NOTHING,
            shown: None,
            ending: Ending::None,
            backdrops: Vec::new(),
        }
    }

    /// The manoeuvre.
    pub fn stage(&self) -> &Stage {
        &self.stage
    }

    /// Changes the factor by which deflections are drawn larger.
    pub fn magnify(&mut self, factor: f64) {
        self.stage.magnification = factor;
    }

    /// Time of the last instant seen, s.
    pub fn time(&self) -> Option<f64> {
        self.shown.map(|moment| moment.time)
    }

    /// Takes the present instant; `limit` says that a limit of the structure has been reached. One
    /// in which no arm can be is not taken: the last one stays.
    pub fn take(&mut self, moment: &Moment, limit: bool) {
        if !moment.is_possible(&self.stage) {
            if self.ending == Ending::None {
                self.ending = Ending::Diverged(moment.time);
            }
            return;
        }
        let again = self.time() == Some(moment.time);
        self.shown = Some(*moment);
        self.extent.take(&self.stage, moment);
        self.ending = if limit {
            Ending::Limit(moment.time)
        } else {
            Ending::None
        };
        if again && !self.samples.is_empty() {
            return;
        }
        self.passed += 1;
        if self.passed >= self.stride {
            self.passed = 0;
            self.samples.push(moment.sample(&self.stage));
        }
        if self.samples.len() >= CAPACITY {
            let mut even = false;
            self.samples.retain(|_| {
                even = !even;
                even
            });
            self.stride *= 2;
        }
    }

    /// The picture of now as rows of red, green and blue; white where nothing can be shown.
    pub fn draw(&mut self, look: &Look) -> Vec<u8> {
        let Some(moment) = self.shown else {
            return vec![255; look.width as usize * look.height as usize * 3];
        };
        let place = self
            .backdrops
            .iter()
            .position(|kept| kept.as_ref().is_some_and(|kept| kept.is_of(look)));
        let place = place.unwrap_or_else(|| {
            if self.backdrops.len() >= BACKDROPS {
                self.backdrops.remove(0);
            }
            self.backdrops.push(None);
            self.backdrops.len() - 1
        });
        Frame {
            look,
            stage: &self.stage,
            moment: &moment,
            past: &self.samples,
            extent: &self.extent,
            ending: self.ending,
        }
        .draw(&mut self.backdrops[place])
    }

    /// Number of instants that are remembered.
    pub fn remembered(&self) -> usize {
        self.samples.len()
    }

    /// The last instant that could be shown.
    pub fn shown(&self) -> Option<&Moment> {
        self.shown.as_ref()
    }
}
