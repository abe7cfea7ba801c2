//! Hook called before and after every sample.

use crate::hardware::reaction_wheel::WheelTorques;
use crate::simd::Number;
use crate::simulation::Flight;
use crate::simulation::controller::Controller;

/// Told of every sample of a flight before and after it is flown; resting lanes do not fly.
pub(crate) trait StepHook<T: Number> {
    /// Before a sample.
    fn before(&mut self, flight: &Flight<T>);
    /// After it.
    fn after(&mut self, flight: &Flight<T>);
}

/// A controller with an optional hook.
pub(crate) struct Hooked<'a, 'b, T: Number, P> {
    pub(crate) controller: &'a mut P,
    pub(crate) hook: Option<&'a mut (dyn StepHook<T> + 'b)>,
}

impl<T: Number, P: Controller<T>> Controller<T> for Hooked<'_, '_, T, P> {
    #[inline(always)]
    fn command(&mut self, flight: &mut Flight<T>) -> (WheelTorques<T>, Option<T>) {
        if let Some(hook) = &mut self.hook {
            hook.before(flight);
        }
        self.controller.command(flight)
    }

    #[inline(always)]
    fn flown(&mut self, flight: &mut Flight<T>) -> bool {
        // first, for the controller may send lanes to rest that have flown this sample
        if let Some(hook) = &mut self.hook {
            hook.after(flight);
        }
        self.controller.flown(flight)
    }
}
