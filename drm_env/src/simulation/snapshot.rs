//! What changes through a flight, for a snapshot.

use super::Flight;
use crate::control::LawMemory;
use crate::error::SnapshotError;
use crate::hardware::delay::DelayLines;
use crate::hardware::sensors::OUTPUTS;
use crate::simulation::any_plant::Motion;
use crate::simulation::clock::Clock;
use crate::simulation::constants::WheelLimits;
use crate::simulation::state::LaneState;
use serde::{Deserialize, Serialize};

/// What changes through one episode, for a snapshot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FlightState {
    common: LaneState<f64>,
    motion: Motion<f64>,
    measured: [f64; OUTPUTS],
    lines: Option<Box<DelayLines>>,
}

impl Flight<f64> {
    /// The state, for a snapshot.
    pub fn state(&self) -> FlightState {
        FlightState {
            common: self.common,
            motion: self.motion.clone(),
            measured: self.all_measured(),
            lines: self.manoeuvres[0].lines.clone(),
        }
    }

    /// Replaces the state by one taken from a flight of the same plan; only a flight that is over, or one that
    /// the scenario lets begin there, may be beyond the limits of [`crate::validity`].
    ///
    /// # Errors
    /// A state of another plant, with other delays, or with numbers that no flight has; nothing has
    /// changed then.
    pub fn set_state(&mut self, state: FlightState, over: bool) -> Result<(), SnapshotError> {
        let damaged = |what: &str| Err(SnapshotError::Damaged(what.into()));
        let fits = match (&state.lines, self.plain) {
            (None, plain) => plain,
            (Some(lines), _) => {
                let own = self.manoeuvres[0].lines.as_ref();
                own.is_some_and(|own| lines.fits(own))
            }
        };
        if !fits {
            return damaged("it holds delay lines of another length");
        }
        let sample = state.common.sample;
        if !(0.0..=9.0e15).contains(&sample) || sample.fract() != 0.0 {
            return damaged("its sample is not a whole number");
        }
        let time = sample * self.shared.sample_period;
        let piece = self.timeline().index(time);
        let clock = Clock::new(self.timeline(), piece, time);
        let mut next = Self {
            clock,
            common: state.common,
            motion: state.motion,
            measured: (!self.plain).then(|| Box::new(state.measured)),
            ..self.clone()
        };
        next.manoeuvres[0].piece = piece as u32;
        next.manoeuvres[0].lines = state.lines;
        next.look_at_pieces();
        let void = next.void() != 0;
        // what begins there ends with its first sample
        if void && !over && sample > 0.0 {
            return damaged("it holds a flight that is over");
        }
        if !next.body.owns(&next.motion, &clock.extension, !void) {
            return damaged("it holds the state of another plant");
        }
        if !next.is_plausible(void) {
            return damaged("it holds numbers that no flight has");
        }
        *self = next;
        Ok(())
    }

    /// Whether a flight can have left these numbers in wheels, laws, metrics and lines; what follows the
    /// motion need not be finite where that is `void`.
    pub(super) fn is_plausible(&self, void: bool) -> bool {
        let LaneState {
            sample,
            root,
            tip,
            memory,
            metrics,
            torques,
            balance,
        } = &self.common;
        let finite = |values: &[f64]| values.iter().all(|value| value.is_finite());
        // a lag's torque is rounded on the way to its command
        let within = |values: &[f64], wheel: &WheelLimits<f64>| {
            let limit = wheel.torque * (1.0 + 1e-9);
            values.iter().all(|value| value.abs() <= limit)
        };
        let LawMemory {
            slew_error_rate,
            link2_deflection_rate,
            started,
            servo,
            filters,
        } = *memory;
        let lines = &self.manoeuvres[0].lines;
        let [to_root, to_tip, seen] = lines
            .as_ref()
            .map_or_else(Default::default, |lines| lines.numbers());
        let following = [
            &[slew_error_rate, link2_deflection_rate][..],
            &servo.numbers(),
            &self.all_measured(),
            filters.as_flattened(),
            &balance.numbers(),
            &seen,
        ];
        within(&[root.torque], &self.fixed.root)
            && within(&to_root, &self.fixed.root)
            && within(&[tip.torque], &self.fixed.tip)
            && within(&to_tip, &self.fixed.tip)
            && finite(&[root.applied, root.momentum, tip.applied, tip.momentum])
            && finite(torques)
            && [0.0, 1.0].contains(&started)
            && metrics.fits(*sample)
            && (void || following.into_iter().all(finite))
    }
}
