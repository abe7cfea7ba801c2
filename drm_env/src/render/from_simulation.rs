//! What a picture of a flight shows.

use crate::config::scenario::Scenario;
use crate::env::Env;
use crate::error::ConfigError;
use crate::hardware::reaction_wheel::WheelTorques;
use crate::interruption;
use crate::math::rng::{Purpose, Seed, Stream};
use crate::render::scene::{Moment, Payment, Stage};
use crate::simulation::{Flight, Plan};

/// What the largest deflection of the uncontrolled arm is drawn as, a part of its longest reach.
const DRAWN_DEFLECTION: f64 = 0.13;
/// The factor where nothing is known, and the largest there is.
const PLAIN_MAGNIFICATION: f64 = 20.0;
const MOST_MAGNIFICATION: f64 = 1e4;
/// Integration steps for which the uncontrolled arm is flown to find the factor: milliseconds.
const MOST_STEPS: f64 = 4e5;
/// Instants of the reference that the camera looks at.
const INSTANTS: usize = 48;

/// A manoeuvre as pictures show it, with this magnification.
///
/// # Errors
/// A scenario that cannot be flown.
pub fn stage(scenario: &Scenario, magnification: f64) -> Result<Stage, ConfigError> {
    let plan = Plan::new(scenario)?;
    let limit = |limit: Option<f64>| limit.unwrap_or(f64::INFINITY);
    let at = |i: usize| {
        let time = scenario.horizon * i as f64 / INSTANTS as f64;
        let reference = plan.timeline.reference(time);
        (reference.angle, plan.timeline.extension(time).length)
    };
    Ok(Stage {
        link1_length: scenario.arm.link1.length,
        link2_length: scenario.arm.link2.length,
        target_angle: scenario.slew.target(),
        path: (0..=INSTANTS).map(at).collect(),
        payload_mass: plan.payload.mass,
        reported_mass: plan.reported.mass,
        torque_limits: [
            scenario.slew_motor.torque_limit,
            scenario.root_wheel.torque_limit,
            scenario.tip_wheel.torque_limit,
        ],
        momentum_limits: [
            limit(scenario.root_wheel.momentum_limit),
            limit(scenario.tip_wheel.momentum_limit),
        ],
        slew_end: plan.slew_end_time,
        horizon: scenario.horizon,
        magnification,
    })
}

/// What stays the same through an episode of an environment: a manoeuvre, or the legs of a mission.
///
/// # Errors
/// See [`stage`].
pub fn stage_of(env: &Env, magnification: f64) -> Result<Stage, ConfigError> {
    let mut stage = stage(&env.scenario(), magnification)?;
    if let Some((angle, path)) = env.mission_path() {
        stage.target_angle = angle;
        stage.path = path;
        stage.slew_end = stage.horizon;
    }
    Ok(stage)
}

/// A factor with which the bending of a manoeuvre can be seen: the arm is flown without control, and
/// its largest deflection is drawn as about an eighth of its reach. 1, 2 or 5 times a power of ten.
pub fn magnification(scenario: &Scenario) -> f64 {
    let rehearsed = Plan::new(scenario).and_then(|plan| {
        let lasts = (plan.slew_end_time + 2.0).min(scenario.horizon);
        let samples = (lasts / scenario.sample_period).ceil();
        if samples * plan.steps_per_sample() as f64 > MOST_STEPS {
            return Ok(None);
        }
        let noise = Stream::new(Seed::default(), 0, Purpose::Sensors);
        let mut flight = Flight::new(plan, noise)?;
        let mut peak = flight.tip_deflection().0.abs();
        let rest = WheelTorques {
            root: 0.0,
            tip: 0.0,
        };
        for sample in 0..samples as usize {
            if sample.is_multiple_of(1000) {
                interruption::poll();
            }
            flight.advance(&rest, None);
            if flight.void() != 0 {
                break;
            }
            peak = peak.max(flight.tip_deflection().0.abs());
        }
        let reach = scenario.arm.link1.length + flight.extension().length;
        Ok(Some(DRAWN_DEFLECTION * reach / peak))
    });
    match rehearsed {
        Ok(Some(wanted)) if wanted.is_finite() => {
            let wanted = wanted.clamp(1.0, MOST_MAGNIFICATION);
            let decade = 10f64.powf(wanted.log10().floor());
            let steps = [5.0, 2.0, 1.0];
            let step = steps.into_iter().find(|step| step * decade <= wanted);
            decade * step.unwrap_or(1.0)
        }
        Ok(Some(_)) => MOST_MAGNIFICATION,
        _ => PLAIN_MAGNIFICATION,
    }
}

/// The present instant of a flight.
pub fn moment(flight: &Flight) -> Moment {
    let [slew_angle, alpha, beta] = flight.position();
    Moment {
        time: flight.time(),
        slew_angle,
        reference_angle: flight.reference().angle,
        extension: flight.extension().length,
        alpha,
        beta,
        tip_deflection: flight.tip_deflection().0,
        torques: flight.last_torques(),
        momenta: flight.wheel_momenta(),
        payment: None,
    }
}

/// The present instant of an environment, with what it has paid.
pub fn paid_moment(env: &Env) -> Moment {
    let now = moment(env.flight());
    let (_, start, angle) = env.leg();
    Moment {
        time: now.time + start,
        slew_angle: now.slew_angle + angle,
        reference_angle: now.reference_angle + angle,
        payment: Some(Payment {
            terms: env.reward_terms(),
            sum: env.episode_return(),
        }),
        ..now
    }
}
