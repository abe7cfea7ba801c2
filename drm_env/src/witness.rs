//! Looking on while others fly.

use crate::control::WheelTorques;
use crate::flight::{Flight, Pilot};
use crate::lane::Number;

/// Told of every sample of a flight before and after it is flown; resting lanes do not fly.
pub(crate) trait Witness<T: Number> {
    /// Before a sample.
    fn before(&mut self, flight: &Flight<T>);
    /// After it.
    fn after(&mut self, flight: &Flight<T>);
}

/// A pilot with somebody who looks on, if anybody does.
pub(crate) struct Watched<'a, 'b, T: Number, P> {
    pub(crate) pilot: &'a mut P,
    pub(crate) witness: Option<&'a mut (dyn Witness<T> + 'b)>,
}

impl<T: Number, P: Pilot<T>> Pilot<T> for Watched<'_, '_, T, P> {
    #[inline(always)]
    fn command(&mut self, flight: &mut Flight<T>) -> (WheelTorques<T>, Option<T>) {
        if let Some(witness) = &mut self.witness {
            witness.before(flight);
        }
        self.pilot.command(flight)
    }

    #[inline(always)]
    fn flown(&mut self, flight: &mut Flight<T>) -> bool {
        // first, for the pilot may send lanes to rest that have flown this sample
        if let Some(witness) = &mut self.witness {
            witness.after(flight);
        }
        self.pilot.flown(flight)
    }
}
