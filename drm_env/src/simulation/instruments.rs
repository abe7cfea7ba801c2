//! What strain gauges and accelerometer read at an instant. They look at forces and accelerations, which jump
//! where torques do: a reading is that of the last moment before its sample, under the torques that have acted
//! until then.

use super::Flight;
use crate::hardware::sensors::{INSTRUMENTS, OUTPUTS, Sensors};
use crate::reference::Extension;
use crate::reference::timeline::SAME_INSTANT;
use crate::simd::{Laned, Number};
use crate::simulation::loads::LoadMeter;

/// The instruments of one manoeuvre.
#[derive(Debug, Clone)]
pub(super) struct Instruments {
    meter: LoadMeter,
    fitted: [bool; INSTRUMENTS],
}

impl Instruments {
    /// Those of a manoeuvre; nothing if its payload cannot be, with which it would not fly.
    pub(super) fn of(flight: &Flight<f64>, sensors: &Sensors) -> Option<Self> {
        Some(Self {
            meter: LoadMeter::of(flight, 0)?,
            fitted: sensors.instruments().map(|one| one.is_fitted()),
        })
    }

    /// Memory of them, bytes, about.
    pub(super) fn bytes(&self) -> usize {
        size_of::<Self>() + self.meter.bytes()
    }
}

impl<T: Number> Flight<T> {
    /// Everything that is measured in a lane; NaN of an instrument that is not there.
    pub(crate) fn all_measured_in(&self, lane: usize) -> [f64; OUTPUTS] {
        let mut all = match &self.measured {
            Some(measured) => measured.lane_of(lane),
            None => self.measurable().lane_of(lane),
        };
        let instruments = self.manoeuvres[lane].instruments.as_ref();
        let fitted = instruments.map_or([false; INSTRUMENTS], |all| all.fitted);
        for (value, fitted) in all[OUTPUTS - INSTRUMENTS..].iter_mut().zip(fitted) {
            if !fitted {
                *value = f64::NAN;
            }
        }
        all
    }

    /// Everything that can be measured in a lane, as it is; see [`Flight::readings`] for `slew`.
    pub(super) fn readable(&self, lane: usize, slew: Option<f64>) -> [f64; OUTPUTS] {
        let mut seen = self.measurable().lane_of(lane);
        if let Some(read) = self.readings(lane, slew) {
            seen[OUTPUTS - INSTRUMENTS..].copy_from_slice(&read);
        }
        seen
    }

    /// What the instruments of a lane read, as it is, where there are any; `slew` is what has replaced the
    /// open-loop torque of the slew motor (N m) until now. Those that are not fitted read 0.
    pub(super) fn readings(&self, lane: usize, slew: Option<f64>) -> Option<[f64; INSTRUMENTS]> {
        let Instruments { meter, fitted } = self.manoeuvres[lane].instruments.as_deref()?;
        let (extension, open_loop) = self.just_before(lane);
        let wheels = [&self.common.root, &self.common.tip].map(|wheel| wheel.applied.lane(lane));
        let [root, tip] = wheels;
        let motion = self.in_space(lane);
        let held = self.held_torque(lane, &extension, wheels);
        let slew = held.or(slew).unwrap_or(open_loop);
        let mut read = meter.readings(&motion, &extension, [slew, root, tip]);
        for (value, fitted) in read.iter_mut().zip(fitted) {
            if !fitted {
                *value = 0.0;
            }
        }
        Some(read)
    }

    /// Extension and open-loop torque of the slew motor (N m) at the last moment before the present instant: at
    /// the very beginning the arm is still at rest.
    fn just_before(&self, lane: usize) -> (Extension<f64>, f64) {
        let clock = self.clock.lane_of(lane);
        if self.common.sample.lane(lane) == 0.0 {
            let extension = Extension {
                accel: 0.0,
                ..clock.extension
            };
            return (extension, 0.0);
        }
        let timeline = self.timeline_of(lane);
        let mut index = self.piece_of(lane);
        while index > 0 && timeline.piece(index).start + SAME_INSTANT >= clock.time {
            index -= 1;
        }
        let piece = timeline.piece(index);
        let u = clock.time - piece.start;
        let (extension, reference) = (piece.extension(u), piece.reference(u));
        let inertia = self.fixed.inertia.lane_of(lane);
        let torque = inertia.slew_torque(&extension, reference.rate, reference.accel);
        (extension, torque)
    }
}
