//! Snapshots that nobody has taken: their checksum is right, their content cannot be.

use std::sync::Arc;

use drm_env::batch::{Autoreset, Batch, StepBuffers};
use drm_env::config::EnvConfig;
use drm_env::config::distribution::{Distribution, Setting};
use drm_env::config::parameter::{Overrides, Randomize, position};
use drm_env::control::Law;
use drm_env::math::rng::{Purpose, Seed, Stream};
use drm_env::plant::PlantModel;
use drm_env::{Env, Error, SnapshotError};

/// Magic, version, fingerprint of the configuration.
const CHECKSUM: usize = 4 + 2 + 8;
const BODY: usize = CHECKSUM + 4;

/// Puts the checksum right again.
fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
    let checksum = crc32fast::hash(&bytes[BODY..]).to_le_bytes();
    bytes[CHECKSUM..BODY].copy_from_slice(&checksum);
    bytes
}

/// Environments with everything that a snapshot holds.
fn configurations() -> [EnvConfig; 3] {
    let preset = |name| EnvConfig::preset(name).expect("it is a preset");
    let mut plain = preset("slew");
    plain.task.control_period = 0.01;
    let mut real = preset("slew_residual");
    real.task.inner_law = Some(Law::named("lyapunov").expect("there is one"));
    real.task.observation_history = 2;
    real.scenario.root_wheel.lag = 0.05;
    real.scenario.root_wheel.dead_time = 0.006;
    real.scenario.tip_wheel.dead_time = 0.004;
    real.scenario.tip_wheel.momentum_limit = Some(5.0);
    real.scenario.sensors.delay = 0.004;
    real.scenario.sensors.angle_noise = 1e-4;
    real.scenario.sensors.rate_resolution = 1e-5;
    let mut consistent = preset("slew_direct");
    consistent.scenario.plant = PlantModel::Consistent;
    consistent.scenario.modes = [1, 2];
    let mut all = [plain, real, consistent];
    for config in &mut all {
        config.scenario.horizon = 0.5;
        config.scenario.slew.max_accel = 0.5;
        config.task.preview_times = vec![0.1, 0.3];
    }
    all
}

fn made(config: &EnvConfig) -> Env {
    Env::new(Arc::new(config.clone())).expect("it can be made")
}

/// An environment in the middle of an episode.
fn under_way(config: &EnvConfig) -> Env {
    let mut env = made(config);
    let mass = position("payload_mass").expect("it is a parameter");
    env.set_context(vec![(mass, Distribution::Fixed(Setting::Number(320.0)))])
        .expect("it can be flown");
    env.reset(Some(Seed::from_u64(3)), &Overrides::new())
        .expect("it can be drawn");
    step(&mut env, 3);
    env
}

fn step(env: &mut Env, count: usize) {
    let actuators = env.config().task.actuators.len();
    for i in 0..count {
        if env.is_running() {
            let action: Vec<f32> = (0..actuators).map(|j| 0.4 - 0.3 * (i + j) as f32).collect();
            env.step(&action).expect("it is running");
        }
    }
}

/// What a forger does to a body: anything from one bit to a number of his own.
fn forge(body: &mut Vec<u8>, random: &mut Stream) {
    let numbers = [
        f64::NAN,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::MAX,
        -1e300,
        1e154,
        1e9,
        -1.0,
        0.5,
        5e-324,
        -0.0,
    ];
    for _ in 0..=random.index(3) {
        let place = random.index(body.len());
        match random.index(6) {
            0 => body[place] ^= 1 << random.index(8),
            1 => body[place] = random.index(256) as u8,
            2 => body[place] = [0, 1, 0x7f, 0x80, 0xff][random.index(5)],
            3 => body.truncate(place),
            4 => body.insert(place, random.index(256) as u8),
            _ => {
                let number = numbers[random.index(numbers.len())].to_le_bytes();
                let end = (place + 8).min(body.len());
                body[place..end].copy_from_slice(&number[..end - place]);
            }
        }
        if body.is_empty() {
            return;
        }
    }
}

/// A forged snapshot is refused and nothing has changed, or it holds what could have been: then the
/// environment flies on with finite numbers and can be saved, restored and reset.
#[test]
fn forged_snapshots_are_refused_as_a_whole_or_fly() {
    let mut random = Stream::new(Seed::from_u64(20), 0, Purpose::Sensors);
    let (mut refused, mut taken) = (0, 0);
    for config in configurations() {
        let mut ended = under_way(&config);
        step(&mut ended, 500);
        assert!(!ended.is_running());
        let whole = [made(&config), under_way(&config), ended];
        for source in whole {
            let bytes = source.get_state();
            for _ in 0..FORGERIES {
                let mut body = bytes[BODY..].to_vec();
                forge(&mut body, &mut random);
                let forged = sealed([&bytes[..BODY], &body].concat());
                let mut env = source.clone();
                match env.set_state(&forged) {
                    Err(_) => {
                        assert_eq!(env.get_state(), bytes, "nothing has changed");
                        refused += 1;
                    }
                    Ok(()) => {
                        taken += 1;
                        fly_on(&mut env);
                    }
                }
            }
        }
    }
    // a bit of a seed or the last digit of a state could have been
    assert!(
        0 < taken && 4 * taken < refused,
        "{taken} taken, {refused} refused"
    );
}

const FORGERIES: usize = 800;

fn fly_on(env: &mut Env) {
    let again = env.get_state();
    env.set_state(&again).expect("what was taken is whole");
    assert_eq!(env.get_state(), again);
    if !env.has_reset() {
        env.reset(None, &Overrides::new()).expect("it can be drawn");
    }
    let actuators = env.config().task.actuators.len();
    for _ in 0..8 {
        if !env.is_running() {
            env.reset(None, &Overrides::new()).expect("it can be drawn");
        }
        let outcome = env.step(&vec![0.5; actuators]).expect("it is running");
        assert!(outcome.reward.is_finite());
        assert!(env.observation().iter().all(|x| x.is_finite()));
        assert!(env.diverged() || env.flight().is_finite());
        assert!(env.metrics().episode_return.is_finite());
    }
}

fn refusal(env: &mut Env, bytes: Vec<u8>) -> String {
    let before = env.get_state();
    match env.set_state(&sealed(bytes)) {
        Err(Error::Snapshot(SnapshotError::Damaged(text))) => {
            assert_eq!(env.get_state(), before);
            text
        }
        other => panic!("{other:?}"),
    }
}

/// Replaces the only place of a number by another one.
fn with(bytes: &[u8], number: f64, by: f64) -> Vec<u8> {
    let (number, by) = (number.to_le_bytes(), by.to_le_bytes());
    let places: Vec<usize> = (BODY..bytes.len() - 7)
        .filter(|i| bytes[*i..i + 8] == number)
        .collect();
    assert_eq!(places.len(), 1, "{number:?}");
    let mut forged = bytes.to_vec();
    forged[places[0]..places[0] + 8].copy_from_slice(&by);
    forged
}

#[test]
fn content_that_cannot_be_is_named() {
    let [config, ..] = configurations();
    let mut env = made(&config);
    env.reset(Some(Seed::from_u64(5)), &Overrides::new())
        .expect("it can be drawn");
    env.step(&[0.123_f32, -0.456]).expect("it is running");
    let bytes = env.get_state();
    let held = f64::from(0.123_f32);
    for action in [f64::NAN, f64::INFINITY, 1.5] {
        let text = refusal(&mut env, with(&bytes, held, action));
        assert_eq!(text, "its action is none");
    }
    let mass = env.scenario().payload.mass;
    assert!(refusal(&mut env, with(&bytes, mass, f64::NAN)).contains("payload.mass"));
    let [_, _, beta] = env.flight().position();
    for value in [f64::NAN, 1e3] {
        let text = refusal(&mut env, with(&bytes, beta, value));
        assert_eq!(text, "it holds a flight that is over");
    }
    // another place of the arm than the one that is observed
    let text = refusal(&mut env, with(&bytes, beta, beta + 0.1));
    assert_eq!(text, "its parts do not belong together");
    let paid = env.metrics().episode_return;
    let text = refusal(&mut env, with(&bytes, paid, 1.0));
    assert_eq!(text, "its reward is none");
}

/// The body of another configuration under this one's fingerprint.
#[test]
fn manoeuvres_of_other_configurations_are_refused() {
    let [config, ..] = configurations();
    let own = under_way(&config).get_state();
    type Change = fn(&mut EnvConfig);
    let changes: [Change; 6] = [
        |c| {
            c.scenario.plant = PlantModel::Consistent;
        },
        |c| c.scenario.sample_period = 1e-3,
        |c| c.scenario.integrator_step = 4e-4,
        |c| c.scenario.horizon = 1.0,
        |c| c.scenario.dynamics.axial_load = false,
        |c| c.scenario.slew_motor.torque_limit = 1.0,
    ];
    for change in changes {
        let mut other = config.clone();
        change(&mut other);
        let foreign = under_way(&other).get_state();
        let bytes = [&own[..BODY], &foreign[BODY..]].concat();
        let text = refusal(&mut under_way(&config), bytes.clone());
        assert_eq!(text, "it holds a manoeuvre of another configuration");
        let mut batch = Batch::new(Arc::new(config.clone()), 3, Autoreset::NextStep, Some(1))
            .expect("it can be made");
        assert!(batch.set_env_state(1, &sealed(bytes)).is_err());
    }
}

/// Whatever is drawn, flown and ended comes back.
#[test]
fn snapshots_that_were_taken_are_taken_back() {
    for mut config in configurations() {
        for limit in [1.5, 1e-4] {
            config.task.limits.slew_error = limit;
            let mut env = made(&config);
            let mut other = made(&config);
            for seed in 0..4 {
                env.reset(Some(Seed::from_u64(seed)), &Overrides::new())
                    .expect("it can be drawn");
                for _ in 0..60 {
                    let bytes = env.get_state();
                    other.set_state(&bytes).expect("it was taken");
                    assert_eq!(other.get_state(), bytes);
                    if !env.is_running() {
                        break;
                    }
                    step(&mut env, 1);
                }
                assert!(!env.is_running());
                assert_eq!(env.diverged(), limit < 1.0);
            }
        }
        let count = 11;
        let mut batch = Batch::new(
            Arc::new(config.clone()),
            count,
            Autoreset::NextStep,
            Some(1),
        )
        .expect("it can be made");
        let seeds: Vec<_> = (0..count as u64).map(|i| Some(Seed::from_u64(i))).collect();
        batch.reset(&seeds, None, None).expect("it can be drawn");
        let size = batch.observation_size();
        let actions = vec![0.3; count * config.task.actuators.len()];
        for _ in 0..7 {
            let mut out = StepBuffers {
                observations: &mut vec![0.0; count * size],
                rewards: &mut vec![0.0; count],
                terminated: &mut vec![false; count],
                truncated: &mut vec![false; count],
                terms: &mut vec![0.0; 3 * count],
            };
            batch.step(&actions, &mut out).expect("they are running");
            let bytes = batch.get_state();
            batch.set_state(&bytes).expect("it was taken");
            assert_eq!(batch.get_state(), bytes);
            let one = batch.env_state(3).expect("there is such an environment");
            made(&config).set_state(&one).expect("it was taken");
        }
        config.randomize = Randomize::default();
        let fresh = made(&config).get_state();
        made(&config).set_state(&fresh).expect("it was taken");
    }
}
