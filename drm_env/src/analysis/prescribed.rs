//! What a manoeuvre prescribes: the reference of the slew angle and the extension, whatever the arm does.

use crate::config::scenario::ValidScenario;
use crate::error::ConfigError;
use crate::interruption;
use crate::reference::shaped::largest_accel;
use crate::reference::shaping::ShaperKind;
use crate::simulation::plan::Plan;

/// Slew and deployment of a manoeuvre as they are planned.
#[derive(Debug, Clone, PartialEq)]
pub struct Prescribed {
    /// Duration of the slew, s.
    pub final_time: f64,
    /// Its largest angular acceleration, rad/s^2.
    pub largest_accel: f64,
    /// Instants at which one of the accelerations changes its formula, the first and the last included, s.
    pub switches: Vec<f64>,
    /// At each of the times that were asked for: angle (rad), rate and acceleration of the reference, and length
    /// (m), rate and acceleration of the extension, each after a switch that falls on the time.
    pub motion: Vec<[f64; 6]>,
}

impl Prescribed {
    /// Of a manoeuvre at the given times, s.
    ///
    /// # Errors
    /// A manoeuvre that cannot be flown.
    pub fn of(scenario: ValidScenario, times: &[f64]) -> Result<Self, ConfigError> {
        let slew = scenario.slew;
        let plan = Plan::new(scenario)?;
        let final_time = plan.slew_end_time;
        let largest_accel = match slew.shaper.kind {
            ShaperKind::None => slew.largest_accel(),
            _ => largest_accel(&scenario.slew_pieces(&scenario.deployment_pieces(0.0)?)?),
        };
        let timeline = plan.timeline;
        let mut switches = vec![timeline.piece(0).start];
        while timeline.end(switches.len() - 1).is_finite() {
            switches.push(timeline.end(switches.len() - 1));
        }
        let at = |time: &f64| {
            interruption::poll();
            let (reference, extension) = (timeline.reference(*time), timeline.extension(*time));
            [
                reference.angle,
                reference.rate,
                reference.accel,
                extension.length,
                extension.rate,
                extension.accel,
            ]
        };
        Ok(Self {
            final_time,
            largest_accel,
            switches,
            motion: times.iter().map(at).collect(),
        })
    }
}
