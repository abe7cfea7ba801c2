//! Flights that leave what the equations describe, at every door; and numbers with which none begins.

use std::sync::Arc;

use drm_env::analysis::transitions::Transitions;
use drm_env::batch::{Autoreset, Batch, StepBuffers};
use drm_env::config::distribution::Setting;
use drm_env::config::parameter::{COUNT, Overrides, PARAMETERS};
use drm_env::config::scenario::ValidScenario;
use drm_env::config::{EnvConfig, Limits, ValidConfig};
use drm_env::control::Law;
use drm_env::control::mlp::{Activation, Layer, Network, Output};
use drm_env::math::rng::Seed;
use drm_env::plant::PlantModel;
use drm_env::reference::deployment::DeploymentMode;
use drm_env::rollout::{
    Options, Pilot, Recording, SIGNAL_NAMES, Schedule, Trajectory, fly, simulate,
};
use drm_env::simulation::metrics::Metrics;
use drm_env::validity::{LARGEST_DEFLECTION, LARGEST_SLEW_ERROR};
use drm_env::{Env, Error, Scenario, SimulationError};

/// Three tonnes at a fixed 8 m, slewed twice as fast as the thesis does: the axial load throws the arm
/// of the thesis away.
fn runaway() -> Scenario {
    let mut scenario = Scenario {
        horizon: 12.0,
        ..Scenario::default()
    };
    scenario.payload.mass = 3000.0;
    scenario.slew.max_accel = 0.04;
    scenario.deployment.start = 8.0;
    scenario.deployment.mode = DeploymentMode::None;
    scenario
}

fn column(name: &str) -> usize {
    let place = SIGNAL_NAMES.iter().position(|known| *known == name);
    place.expect("there is such a signal")
}

/// The metrics of a flight that is void: nothing that could be taken for a result.
fn assert_void(metrics: &Metrics, horizon: f64) {
    assert!(metrics.diverged && !metrics.settled);
    assert!((0.0..horizon).contains(&metrics.duration));
    assert!(metrics.slew_end_time.is_finite() && metrics.episode_return.is_finite());
    let void = metrics.values().iter().filter(|x| x.is_nan()).count();
    assert_eq!(void, 12, "{metrics:?}");
}

fn assert_within(signals: &[Vec<f64>; SIGNAL_NAMES.len()]) {
    assert!(signals.iter().flatten().all(|value| value.is_finite()));
    let names = [
        "tip_deflection",
        "extension",
        "slew_angle",
        "reference_angle",
    ];
    let [deflection, extension, angle, reference] = names.map(|name| &signals[column(name)]);
    for (y, a) in deflection.iter().zip(extension) {
        assert!(y.abs() <= LARGEST_DEFLECTION * (7.0 + a), "{y} at {a}");
    }
    for (angle, reference) in angle.iter().zip(reference) {
        assert!((angle - reference).abs() <= LARGEST_SLEW_ERROR);
    }
}

fn simulated(scenario: &Scenario) -> Trajectory {
    simulate(scenario, &Law::default(), 1, Seed::from_u64(0)).expect("it can be flown")
}

#[test]
fn simulations_that_leave_the_limits_end_there_and_say_so() {
    let mut heavy = Scenario {
        plant: PlantModel::Consistent,
        horizon: 20.0,
        ..runaway()
    };
    heavy.payload.mass = 30_000.0;
    let mut spun = Scenario::default();
    spun.initial.slew_rate = 0.5 * LARGEST_SLEW_ERROR;
    let mut torn = Scenario::default();
    torn.initial.beta_rate = 1e20;
    for scenario in [runaway(), heavy, spun, torn] {
        let flown = simulated(&scenario);
        assert_void(&flown.metrics, scenario.horizon);
        // the last row is the last state within the limits
        let last = flown.signals[0].last().expect("there is a first row");
        assert!((flown.metrics.duration - last).abs() < 1e-9);
        if scenario != torn {
            assert_within(&flown.signals);
        }
    }
    let calm = simulated(&Scenario::default());
    assert!(!calm.metrics.diverged);
}

#[test]
fn rollouts_that_leave_the_limits_end_there_and_say_so() {
    let scenarios = [
        Scenario {
            horizon: 12.0,
            ..Scenario::default()
        },
        runaway(),
    ];
    let seeds = [Seed::from_u64(0); 2];
    let options = Options {
        recording: Some(Recording::new(&SIGNAL_NAMES, 1).expect("they are signals")),
        ..Options::default()
    };
    let law = Law::default();
    let alone = simulated(&runaway());
    let schedule = Schedule {
        torques: &[[0.0; 2]; 2],
        rows: 1,
        hold: 1,
    };
    let checked = ValidScenario::all(&scenarios).expect("both can be flown");
    for pilot in [Pilot::law(&law), Pilot::schedule(schedule)] {
        let pilot = pilot.expect("it can fly");
        let flown = fly(&checked, &pilot, &seeds, &options, |_| true).expect("both fly");
        assert!(!flown.metrics[0].diverged);
        assert_void(&flown.metrics[1], 12.0);
        assert_eq!(flown.metrics[1].duration, alone.metrics.duration);
        let kept = flown.trajectories.expect("signals are kept");
        for ((name, values), expected) in kept.signals.iter().zip(&alone.signals) {
            let (row, rest) = values[kept.samples..].split_at(expected.len());
            assert_eq!(row, expected, "{name}");
            assert!(rest.iter().all(|value| value.is_nan()), "{name}");
        }
    }
}

/// The runaway as an environment whose own limits let it pass.
fn unlimited() -> EnvConfig {
    let mut config = EnvConfig::preset("slew_thesis").expect("it is a preset");
    config.scenario = runaway();
    config.task.control_period = 0.02;
    config.task.limits = Limits {
        slew_error: 1e20,
        tip_deflection: 1e20,
    };
    config
}

fn assert_observed(observation: &[f32]) {
    assert!(
        observation.iter().all(|x| x.abs() < 100.0),
        "{observation:?}"
    );
}

#[test]
fn environments_end_at_the_limits_whatever_their_own() {
    let config = Arc::new(unlimited());
    let mut env = Env::new(Arc::clone(&config)).expect("it can be made");
    env.reset(Some(Seed::from_u64(0)), &Overrides::new())
        .expect("it can be drawn");
    let mut batch = Batch::new(config, 3, Autoreset::Disabled, Some(1)).expect("they can be made");
    batch
        .reset(&[Some(Seed::from_u64(0)); 3], None, None)
        .expect("they can be drawn");
    let size = batch.observation_size();
    let mut observations = vec![0.0; 3 * size];
    let (mut rewards, mut terms) = ([0.0; 3], [0.0; 9]);
    let (mut terminated, mut truncated) = ([false; 3], [false; 3]);
    let outcome = loop {
        let outcome = env.step(&[0.0, 0.0]).expect("it is running");
        let mut out = StepBuffers {
            observations: &mut observations,
            rewards: &mut rewards,
            terminated: &mut terminated,
            truncated: &mut truncated,
            terms: &mut terms,
        };
        batch.step(&[0.0; 6], &mut out).expect("they are running");
        if !env.is_running() {
            break outcome;
        }
    };
    assert!(outcome.terminated && outcome.reward.is_finite());
    assert!(env.diverged());
    assert_void(&env.metrics(), 12.0);
    assert_observed(env.observation());
    assert_eq!(terminated, [true; 3]);
    assert_eq!(rewards, [outcome.reward; 3]);
    for (index, ended) in batch.ended() {
        assert_void(&ended.metrics, 12.0);
        assert_eq!(ended.observation, env.observation(), "{index}");
    }
    // and what is left of it can be saved
    let saved = env.get_state();
    env.set_state(&saved).expect("it is its own");
    assert_eq!(env.get_state(), saved);
}

#[test]
fn networks_end_at_the_limits_whatever_their_tasks() {
    let config = unlimited();
    let layer = Layer {
        weights: vec![0.0; 2 * drm_env::env::observation::observation_size(&config)],
        biases: vec![0.0; 2],
    };
    let network = Network::new(&[layer], Activation::Tanh, Output::Clip).expect("it is one");
    let held = ValidConfig::new(config.clone()).expect("it can be flown");
    let pilot = Pilot::network(&network, &held).expect("it fits");
    let seeds = [Seed::from_u64(0); 2];
    let scenarios = ValidScenario::all(&[runaway(); 2]).expect("both can be flown");
    let flown = fly(&scenarios, &pilot, &seeds, &Options::default(), |_| true);
    for metrics in flown.expect("both fly").metrics {
        assert_void(&metrics, 12.0);
        assert_eq!(metrics.duration, simulated(&runaway()).metrics.duration);
    }
}

#[test]
fn linear_models_of_what_leaves_the_limits_are_refused() {
    let mut scenario = Scenario {
        horizon: 0.2,
        ..Scenario::default()
    };
    scenario.root_wheel.torque_limit = 1e12;
    match Transitions::of(&scenario, 100) {
        Err(Error::Simulation(SimulationError::Diverged { time })) => {
            assert!(0.0 < time && time <= 0.2);
        }
        other => panic!("{other:?}"),
    }
}

/// Numbers at both ends of what a double can hold, and at the ends of what is accepted.
const ENDS: [f64; 12] = [
    0.0,
    5e-324,
    1e-308,
    1e-200,
    1e-20,
    1e-12,
    1e12,
    1e20,
    1e200,
    f64::MAX,
    -1e20,
    f64::MIN,
];

/// Steps an environment until its end, or a while; every number that it shows must be finite.
fn fly_through(config: &EnvConfig, what: &str) {
    let mut env = match Env::new(Arc::new(config.clone())) {
        Ok(env) => env,
        Err(error) => panic!("{what}: accepted, then {error}"),
    };
    env.reset(Some(Seed::from_u64(1)), &Overrides::new())
        .unwrap_or_else(|error| panic!("{what}: accepted, then {error}"));
    let actions = [[1.0, -1.0], [-1.0, 1.0], [0.3, 1.0]];
    for action in actions.iter().cycle().take(40) {
        if !env.is_running() {
            break;
        }
        let outcome = env.step(action).expect("it is running");
        assert!(
            outcome.reward.is_finite(),
            "{what}: reward {}",
            outcome.reward
        );
        assert!(
            (outcome.reward as f32).is_finite(),
            "{what}: {}",
            outcome.reward
        );
        let shown = env.observation().iter().all(|x| x.is_finite());
        assert!(shown, "{what}: {:?}", env.observation());
        assert!(env.metrics().episode_return.is_finite(), "{what}");
        let known = env.diverged() || env.flight().is_finite();
        assert!(known, "{what}: not finite and not diverged");
        if !env.diverged() {
            let metrics = env.metrics();
            let kept = [
                metrics.tip_error_rms,
                metrics.wheel_effort,
                metrics.slew_energy,
            ];
            assert!(kept.iter().all(|x| x.is_finite()), "{what}: {metrics:?}");
        }
    }
}

fn short(plant: PlantModel) -> EnvConfig {
    let mut config = EnvConfig::preset("slew_residual").expect("it is a preset");
    config.randomize = drm_env::config::parameter::Randomize::default();
    config.scenario.plant = plant;
    config.scenario.modes = [1, 1];
    config.scenario.horizon = 0.6;
    config.scenario.slew.smoothing = 0.1;
    config.task.observe_identified = true;
    config.task.inner_law = Some(Law::named("lyapunov").expect("there is one"));
    config
}

#[test]
fn every_parameter_is_refused_by_name_or_flown_with_finite_numbers() {
    let mut refused = [0; COUNT];
    for plant in [PlantModel::Thesis, PlantModel::Consistent] {
        for (index, parameter) in PARAMETERS.iter().enumerate() {
            for end in ENDS {
                let mut config = short(plant);
                let setting = Setting::Number(end);
                if parameter.set(&mut config.scenario, &setting).is_err() {
                    continue;
                }
                match config.validate() {
                    Ok(()) => fly_through(&config, &format!("{} = {end:e}", parameter.name)),
                    Err(error) => {
                        let text = error.to_string();
                        assert!(text.len() < 250, "{text}");
                        refused[index] += 1;
                    }
                }
            }
        }
    }
    for (parameter, count) in PARAMETERS.iter().zip(refused) {
        let names = parameter.setting(&short(PlantModel::Thesis).scenario);
        if !matches!(names, Some(Setting::Name(_))) {
            assert!(count >= 4, "{} takes any number", parameter.name);
        }
    }
}

#[test]
fn limits_that_cannot_be_divided_by_are_refused_with_path_and_value() {
    let refused = |set: fn(&mut EnvConfig)| {
        let mut config = short(PlantModel::Thesis);
        set(&mut config);
        let error = config.validate().expect_err("it cannot be computed with");
        error.to_string()
    };
    assert_eq!(
        refused(|c| c.scenario.root_wheel.torque_limit = 5e-324),
        "root_wheel.torque_limit must be within 1e-20 to 1e20, got 5e-324"
    );
    assert_eq!(
        refused(|c| c.scenario.payload.mass = 1e308),
        "payload.mass must be at most 1e20, got 1e308"
    );
    assert_eq!(
        refused(|c| c.scenario.sensors.rate_resolution = 1e-310),
        "sensors.rate_resolution must be within 1e-20 to 1e20, got 1e-310"
    );
    assert_eq!(
        refused(|c| c.task.reward.resolution = 1e-308),
        "reward.resolution must be within 1e-20 to 1e20, got 1e-308"
    );
    let message = refused(|c| c.scenario.slew.smoothing = 1e-200);
    assert!(
        message.starts_with("slew.smoothing must be 0 or long enough"),
        "{message}"
    );
    assert!(message.ends_with("got 1e-200"), "{message}");
}

#[test]
fn rewards_stay_finite_whatever_their_weights_or_are_refused_by_name() {
    type Slot = fn(&mut EnvConfig) -> &mut f64;
    let slots: [(&str, Slot); 10] = [
        ("reward.tip_vibration", |c| &mut c.task.reward.tip_vibration),
        ("reward.slew_error", |c| &mut c.task.reward.slew_error),
        ("reward.effort", |c| &mut c.task.reward.effort),
        ("reward.resolution", |c| &mut c.task.reward.resolution),
        ("reward.linear", |c| &mut c.task.reward.linear),
        ("reward.vibration_time", |c| {
            &mut c.task.reward.vibration_time
        }),
        ("reward.slew_time", |c| &mut c.task.reward.slew_time),
        ("limits.slew_error", |c| &mut c.task.limits.slew_error),
        ("limits.tip_deflection", |c| {
            &mut c.task.limits.tip_deflection
        }),
        ("wheel_scale", |c| &mut c.task.wheel_scale),
    ];
    for (name, slot) in slots {
        for end in ENDS {
            let mut config = short(PlantModel::Thesis);
            *slot(&mut config) = end;
            match config.validate() {
                Ok(()) => fly_through(&config, &format!("{name} = {end:e}")),
                Err(error) => assert!(error.to_string().starts_with(name), "{error}"),
            }
        }
    }
    let mut long = short(PlantModel::Thesis);
    long.task.reward.effort = 1e20;
    long.scenario.horizon = 1e12;
    long.scenario.sample_period = 1e4;
    long.scenario.integrator_step = 1e-3;
    long.task.control_period = 1e4;
    assert!(long.validate().is_err());
    let mut dear = short(PlantModel::Thesis);
    dear.task.reward.slew_error = 1e20;
    dear.task.reward.resolution = 1e20;
    fly_through(&dear, "a weight and a resolution of 1e20");
}

/// The thesis' arm with damping, flown with steps on both sides of the limit that is told.
#[test]
fn damped_modes_are_integrated_below_the_step_that_is_told_and_not_above() {
    for (damping, mode) in [
        (0.001, DeploymentMode::None),
        (0.004, DeploymentMode::None),
        (0.01, DeploymentMode::None),
        (0.02, DeploymentMode::None),
        (0.02, DeploymentMode::Coincident),
        (0.3, DeploymentMode::Coincident),
    ] {
        let mut scenario = Scenario {
            horizon: 4.0,
            sample_period: 0.1,
            integrator_step: 0.1,
            ..Scenario::default()
        };
        scenario.payload.mass = 50.0;
        scenario.dynamics.structural_damping = damping;
        scenario.deployment.mode = mode;
        scenario.initial.beta = 1e-4;
        let message = scenario
            .validate()
            .expect_err("the step is long")
            .to_string();
        assert!(
            message.contains("integrator_step must be below"),
            "{message}"
        );
        assert!(message.contains("dynamics.structural_damping = 0.0") || damping >= 0.1);
        let told = message
            .split(' ')
            .nth(4)
            .and_then(|word| word.parse::<f64>().ok());
        let limit = told.expect("the limit is told");
        // whole steps to a sample
        let with = |step: f64| Scenario {
            integrator_step: step,
            sample_period: step,
            ..scenario
        };
        let below = simulated(&with(0.98 * limit));
        assert!(!below.metrics.diverged, "{damping} {mode:?}");
        assert!(below.metrics.peak_deflection < 0.5);
        assert!(with(1.02 * limit).validate().is_err());
    }
    // what was accepted and threw the arm away
    let mut scenario = Scenario::default();
    scenario.payload.mass = 50.0;
    scenario.dynamics.structural_damping = 0.018;
    let error = scenario.validate().expect_err("0.5 ms are too long");
    assert!(error.to_string().contains("damping ratio"), "{error}");
}
