//! Pictures of a flight that has been flown: any instant of it, in any order.

use super::frame::{Backdrop, Frame};
use super::scene::{Ending, Extent, Look, Moment, Sample, Stage};

/// A flight with all its instants.
pub struct Film {
    stage: Stage,
    moments: Vec<Moment>,
    samples: Vec<Sample>,
    own: Extent,
    shown: Extent,
    ending: Ending,
    backdrop: Option<Backdrop>,
}

impl Film {
    /// Of instants in the order of time; from the first on in which no arm can be there are none.
    /// `diverged` says that the flight was broken off after the last.
    pub fn new(stage: Stage, moments: Vec<Moment>, diverged: bool) -> Self {
        let count = moments
            .iter()
            .take_while(|moment| moment.is_possible(&stage))
            .count();
        let broken = moments.get(count).map(|moment| moment.time);
        let mut moments = moments;
        moments.truncate(count);
        let last = moments.last().map_or(0.0, |moment| moment.time);
        let ending = match broken {
            Some(time) => Ending::Diverged(time),
            None if diverged => Ending::Diverged(last),
            None => Ending::None,
        };
        let mut own = Extent::NOTHING;
        for moment in &moments {
            own.take(&stage, moment);
        }
        Self {
            samples: moments.iter().map(|moment| moment.sample(&stage)).collect(),
            stage,
            moments,
            own,
            shown: own,
            ending,
            backdrop: None,
        }
    }

    /// The manoeuvre.
    pub fn stage(&self) -> &Stage {
        &self.stage
    }

    /// The ranges of this flight.
    pub fn extent(&self) -> &Extent {
        &self.own
    }

    /// Lets curves and camera hold another range too: that of flights beside which this is seen.
    pub fn widen(&mut self, other: &Extent) {
        self.shown = self.shown.with(other);
    }

    /// The picture at a time (s), as rows of red, green and blue: of the last instant that is not
    /// later. White where there is none at all.
    pub fn draw(&mut self, look: &Look, time: f64) -> Vec<u8> {
        let after = self
            .moments
            .partition_point(|moment| moment.time <= time + 1e-9);
        let Some(place) = after
            .checked_sub(1)
            .or((!self.moments.is_empty()).then_some(0))
        else {
            return vec![255; look.width as usize * look.height as usize * 3];
        };
        let over = match self.ending {
            Ending::Diverged(at) if time >= at => self.ending,
            _ => Ending::None,
        };
        Frame {
            look,
            stage: &self.stage,
            moment: &self.moments[place],
            past: &self.samples[..=place],
            extent: &self.shown,
            ending: over,
        }
        .draw(&mut self.backdrop)
    }
}

/// The signals of a trajectory that a picture needs, in the order of
/// [`moment_of`].
pub const FILM_SIGNALS: [&str; 12] = [
    "time",
    "slew_angle",
    "reference_angle",
    "extension",
    "alpha",
    "beta",
    "tip_deflection",
    "slew_torque",
    "root_torque",
    "tip_torque",
    "root_momentum",
    "tip_momentum",
];

/// The instant that a row of [`FILM_SIGNALS`] describes.
pub fn moment_of(row: &[f64; FILM_SIGNALS.len()]) -> Moment {
    let [
        time,
        slew_angle,
        reference_angle,
        extension,
        alpha,
        beta,
        tip_deflection,
        rest @ ..,
    ] = *row;
    let [slew, root, tip, root_momentum, tip_momentum] = rest;
    Moment {
        time,
        slew_angle,
        reference_angle,
        extension,
        alpha,
        beta,
        tip_deflection,
        torques: [slew, root, tip],
        momenta: [root_momentum, tip_momentum],
        payment: None,
    }
}
