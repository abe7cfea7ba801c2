//! Who commands a flight.

use super::Flight;
use crate::hardware::reaction_wheel::WheelTorques;
use crate::simd::Number;
use crate::simd::dispatch::{Vector, Work, variants};

/// Who flies: asked for commands before each sample and told of it afterwards.
pub(crate) trait Controller<T: Number> {
    /// Wheel torques (N m, before saturation), and the torque of the slew motor where it is not the
    /// open-loop one.
    fn command(&mut self, flight: &mut Flight<T>) -> (WheelTorques<T>, Option<T>);
    /// After each sample: whether to fly on.
    fn flown(&mut self, flight: &mut Flight<T>) -> bool;
}

/// One sample under given commands.
pub(super) struct Held<T> {
    pub(super) command: WheelTorques<T>,
    pub(super) slew: Option<T>,
}

impl<T: Number> Controller<T> for Held<T> {
    #[inline(always)]
    fn command(&mut self, _flight: &mut Flight<T>) -> (WheelTorques<T>, Option<T>) {
        (self.command, self.slew)
    }

    #[inline(always)]
    fn flown(&mut self, _flight: &mut Flight<T>) -> bool {
        true
    }
}

/// [`Flight::fly`] where the instructions are chosen.
pub(crate) struct Fly<'a, T: Number, P> {
    pub(crate) flight: &'a mut Flight<T>,
    pub(crate) samples: usize,
    pub(crate) controller: &'a mut P,
}

variants!(fly);

impl<T: Vector, P: Controller<T>> Work for Fly<'_, T, P> {
    type Output = ();
    type Variants = fly::Here;

    #[inline(always)]
    fn run(self) {
        self.flight.fly(self.samples, self.controller);
    }
}
