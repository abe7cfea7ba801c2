//! Pictures of environments: whoever steps one tells its follower, which notices new episodes.

use crate::config::scenario::Scenario;
use crate::env::Env;
use crate::error::ConfigError;
use crate::render::from_simulation::{magnification, paid_moment, stage_of};
use crate::render::scene::Look;
use crate::render::tracker::Tracker;

/// What has been seen of one environment.
#[derive(Default)]
pub struct Follower {
    seen: Option<Seen>,
}

struct Seen {
    tracker: Tracker,
    scenario: Scenario,
    /// Whether the factor of the deflections has been chosen, which takes milliseconds.
    is_fitted: bool,
}

impl Follower {
    /// Takes the present instant. What was before is forgotten where an episode has begun, and with
    /// `restart`, after a restored state: pictures know nothing of what they have not seen.
    ///
    /// # Errors
    /// A scenario that cannot be flown, which is none of a running environment.
    pub fn take(&mut self, env: &Env, restart: bool) -> Result<(), ConfigError> {
        let moment = paid_moment(env);
        let goes_on = !restart
            && self.seen.as_ref().is_some_and(|seen| {
                let last = seen.tracker.time().unwrap_or(0.0);
                moment.time >= last && (moment.time > 0.0 || seen.scenario == env.scenario())
            });
        if !goes_on {
            let scenario = env.scenario();
            self.seen = Some(Seen {
                tracker: Tracker::new(stage_of(env, 1.0)?),
                scenario,
                is_fitted: false,
            });
        }
        if let Some(seen) = &mut self.seen {
            seen.tracker.take(&moment, env.diverged());
        }
        Ok(())
    }

    /// The picture of the last instant taken, deflections drawn larger by `factor` or by one that
    /// follows from the manoeuvre.
    pub fn draw(&mut self, look: &Look, factor: Option<f64>) -> Vec<u8> {
        let Some(seen) = &mut self.seen else {
            return vec![255; look.width as usize * look.height as usize * 3];
        };
        if !seen.is_fitted {
            let factor = factor.unwrap_or_else(|| magnification(&seen.scenario));
            seen.tracker.magnify(factor);
            seen.is_fitted = true;
        }
        seen.tracker.draw(look)
    }
}
