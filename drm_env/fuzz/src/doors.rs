//! The doors of the engine through which bytes and text of strangers come. Each function takes any bytes and
//! panics if a promise is broken: what cannot be used is refused with a text and changes nothing; what is taken
//! is finite, comes back from its own text or bytes, and has the same bits in any company.
//!
//! The targets of cargo-fuzz beside this file let libFuzzer make up the bytes; `drm_env/web/tests/corpora.rs`
//! gives the same functions the kept corpora, and damaged copies of them, in every run of the tests.

use std::sync::Arc;

use drm_env::analysis::model::Model;
use drm_env::batch::{Autoreset, Batch, StepBuffers};
use drm_env::config::parameter::{Overrides, overrides};
use drm_env::config::scenario::ValidScenario;
use drm_env::config::{
    EnvConfig, PRESETS, ValidConfig, law_from_json, mission_from_json, scenario_from_json,
};
use drm_env::control::Law;
use drm_env::control::mlp::{Activation, Layer, Network, Output, Scratch};
use drm_env::env::sample_scenarios;
use drm_env::math::rng::Seed;
use drm_env::plant::PlantModel;
use drm_env::rollout::{Flown, Options, Pilot, Schedule, fly, fly_missions, fly_one, simulate};
use drm_env::simd::Instructions;
use drm_env::{Env, Scenario};
use drm_env_web::flight;
use serde_json::{Value, json};

/// A function that takes any bytes.
pub type Door = fn(&[u8]);

/// All doors, by name.
pub const DOORS: [(&str, Door); 5] = [
    ("configuration", configuration),
    ("text", text),
    ("snapshot", snapshot),
    ("network", network),
    ("actions", actions),
];

/// Samples of a flight that is worth flying here.
const SAMPLES: usize = 250;

/// Integration steps of a sample, and samples of a control period, that are worth computing here.
const STEPS: f64 = 25.0;

/// Numbers that are read from bytes one after the other; zeros when there are no more.
struct Bytes<'a>(&'a [u8]);

impl Bytes<'_> {
    fn byte(&mut self, below: usize) -> usize {
        let Some((first, rest)) = self.0.split_first() else {
            return 0;
        };
        self.0 = rest;
        usize::from(*first) % below
    }

    fn take<const N: usize>(&mut self) -> [u8; N] {
        let mut found = [0; N];
        let count = self.0.len().min(N);
        found[..count].copy_from_slice(&self.0[..count]);
        self.0 = &self.0[count..];
        found
    }

    /// Any single, or one of ordinary size: most fuzzed bits are no number of any use.
    fn single(&mut self) -> f32 {
        match self.byte(4) {
            0 => f32::from_le_bytes(self.take()),
            _ => f32::from(i16::from_le_bytes(self.take())) / 20_000.0,
        }
    }

    fn double(&mut self) -> f64 {
        match self.byte(4) {
            0 => f64::from_le_bytes(self.take()),
            _ => f64::from(i16::from_le_bytes(self.take())) / 300.0,
        }
    }
}

/// The texts in bytes, which zeros separate.
fn texts(data: &[u8], count: usize) -> Vec<String> {
    data.splitn(count, |byte| *byte == 0)
        .map(|text| String::from_utf8_lossy(text).into_owned())
        .collect()
}

fn refused(error: &dyn std::fmt::Display) {
    assert!(!error.to_string().is_empty(), "an error says something");
}

fn is_short(scenario: &Scenario) -> bool {
    scenario.samples() <= SAMPLES && scenario.sample_period <= STEPS * scenario.integrator_step
}

fn bits(values: &[f64]) -> Vec<u64> {
    // not-a-numbers are all the same
    let bits = |value: &f64| {
        if value.is_nan() {
            u64::MAX
        } else {
            value.to_bits()
        }
    };
    values.iter().map(bits).collect()
}

/// Parts of a configuration and flat options over a preset, as JSON text.
pub fn configuration(data: &[u8]) {
    let Some((first, rest)) = data.split_first() else {
        return;
    };
    let preset = PRESETS[usize::from(*first) % PRESETS.len()];
    let parts = texts(rest, 2);
    let part = |i: usize| parts.get(i).filter(|text| !text.is_empty());
    let (config, options) = (part(0), part(1));
    let resolved = ValidConfig::resolve(
        preset,
        config.map(String::as_str),
        options.map(String::as_str),
    );
    let config = match resolved {
        Ok(config) => config,
        Err(error) => return refused(&error),
    };
    let text = config.to_json();
    let again = EnvConfig::from_json(&text).expect("its own text is taken");
    assert_eq!(again.to_json(), text, "its own text says the same");
    let task = &config.task;
    let size = task.observation_history * (task.preview_times.len() + 20);
    let seeds = [Seed::default(), Seed::from_u64(7)];
    match sample_scenarios(&config, &seeds) {
        Ok(drawn) => {
            let ratio = |scenario: &Scenario| task.control_period / scenario.sample_period;
            let worth = |scenario| is_short(scenario) && ratio(scenario) <= STEPS;
            if size <= 10_000 && drawn.iter().all(worth) {
                episode(&config);
            }
        }
        Err(error) => refused(&error),
    }
}

/// The beginning of an episode, and a copy of it that goes on from a snapshot.
fn episode(config: &ValidConfig) {
    let mut env = match Env::new(config.clone()) {
        Ok(env) => env,
        Err(error) => return refused(&error),
    };
    if let Err(error) = env.reset(Some(Seed::from_u64(7)), &Overrides::new()) {
        return refused(&error);
    }
    let mut other = Env::new(config.clone()).expect("as before");
    other.set_state(&env.get_state()).expect("it was taken");
    let action = vec![0.5; config.task.actuators.len()];
    for _ in 0..6 {
        if !env.is_running() {
            break;
        }
        let outcome = env.step(&action).expect("it is running");
        assert_eq!(other.step(&action), Ok(outcome));
        assert!(outcome.reward.is_finite() && outcome.reward <= 0.0);
        assert!(env.observation().iter().all(|x| x.is_finite()));
    }
    assert_eq!(env.get_state(), other.get_state());
}

/// Laws, manoeuvres, missions, settings of an episode, models and requests of a page, as JSON text.
pub fn text(data: &[u8]) {
    let Some((first, rest)) = data.split_first() else {
        return;
    };
    let text = String::from_utf8_lossy(rest);
    match first % 6 {
        0 => match law_from_json(&text) {
            Ok(law) => {
                let written = serde_json::to_string(&law).expect("it can be written");
                assert_eq!(law_from_json(&written).as_ref(), Ok(&law));
                let short = scenario_from_json(r#"{"horizon": 0.1}"#).expect("it can be flown");
                let flown = simulate(short, &law, 1, Seed::from_u64(3));
                flown.map_or_else(|error| refused(&error), |_| ());
            }
            Err(error) => refused(&error),
        },
        1 => match scenario_from_json(&text) {
            Ok(scenario) => manoeuvre(scenario),
            Err(error) => refused(&error),
        },
        2 => match mission_from_json(&text) {
            Ok(mission) => {
                let again = mission_from_json(&mission.to_json());
                assert_eq!(again.as_ref(), Ok(&mission), "its own text says the same");
                if is_short(mission.scenario()) {
                    let law = Law::named("lyapunov").expect("there is one");
                    let pilot = Pilot::law(&law).expect("it can fly");
                    let seeds = [Seed::from_u64(3); 2];
                    let twice = [mission.clone(), mission];
                    let flown = fly_missions(&twice, &pilot, &seeds, &one_thread(), |_| true);
                    match flown {
                        Ok(flown) => {
                            let [a, b] = [0, 1].map(|i| bits(&flown.metrics[i].values()));
                            assert_eq!(a, b);
                        }
                        Err(error) => refused(&error),
                    }
                }
            }
            Err(error) => refused(&error),
        },
        3 => match overrides(&text) {
            Ok(settings) => {
                let mut env = Env::new(Arc::new(plain())).expect("it can be made");
                let before = env.get_state();
                if let Err(error) = env.reset(Some(Seed::from_u64(3)), &settings) {
                    refused(&error);
                    assert_eq!(env.get_state(), before, "nothing has changed");
                }
            }
            Err(error) => refused(&error),
        },
        4 => match Model::from_json(&text) {
            Ok(model) => match model.natural_frequencies(2.0, None) {
                Ok(found) => assert!(found.iter().all(|value| *value >= 0.0)),
                Err(error) => refused(&error),
            },
            Err(error) => refused(&error),
        },
        _ => page(&text, &[]),
    }
}

/// One manoeuvre under a law, alone and with others.
fn manoeuvre(scenario: ValidScenario) {
    let written = serde_json::to_string(&*scenario).expect("it can be written");
    let again = scenario_from_json(&written).expect("its own text is taken");
    assert_eq!(serde_json::to_string(&*again).ok(), Some(written));
    if !is_short(&scenario) {
        return;
    }
    let law = Law::named("lyapunov").expect("there is one");
    let alone = match simulate(scenario, &law, 1, Seed::from_u64(3)) {
        Ok(flown) => flown,
        Err(error) => return refused(&error),
    };
    let finite = alone
        .signals
        .iter()
        .flatten()
        .all(|value| value.is_finite());
    assert!(finite, "what is kept of a flight is finite");
    let pilot = Pilot::law(&law).expect("it can fly");
    let seeds = [Seed::from_u64(3); 3];
    let flown = fly(&[scenario; 3], &pilot, &seeds, &one_thread(), |_| true).expect("as alone");
    for metrics in &flown.metrics {
        assert_eq!(bits(&metrics.values()), bits(&alone.metrics.values()));
    }
}

fn one_thread() -> Options {
    Options {
        threads: Some(1),
        ..Options::default()
    }
}

/// A request of the page, unless its flight would last.
fn page(text: &str, weights: &[u8]) {
    let short = serde_json::from_str::<Value>(text).map_or(true, |request| {
        let scenario = request.get("scenario").map(Value::to_string);
        let scenario = scenario.map(|text| scenario_from_json(&text));
        scenario.is_none_or(|scenario| scenario.is_ok_and(|scenario| is_short(&scenario)))
    });
    if !short {
        return;
    }
    match flight::fly(text, weights) {
        Ok(flown) => assert!(flown.contents.samples > 0),
        Err(error) => refused(&error),
    }
}

/// Environments whose snapshots are tried.
fn configurations() -> [EnvConfig; 4] {
    let preset = |name| EnvConfig::preset(name).expect("it is a preset");
    let mut plain = preset("slew");
    plain.task.control_period = 0.01;
    let mut real = preset("slew_residual");
    real.task.inner_law = Some(Law::named("lyapunov").expect("there is one"));
    real.task.observation_history = 2;
    real.scenario.root_wheel.dead_time = 0.006;
    real.scenario.tip_wheel.momentum_limit = Some(5.0);
    real.scenario.sensors.delay = 0.004;
    real.scenario.sensors.angle_noise = 1e-4;
    let mut consistent = preset("slew_direct");
    consistent.scenario.plant = PlantModel::Consistent;
    consistent.scenario.modes = [1, 2];
    let legs = json!({"mission": {"legs": [
        {"kind": "hold", "duration": 0.1}, {"kind": "grapple"}, {"kind": "hold", "duration": 0.1},
        {"kind": "release"}, {"kind": "wait_for_rest", "most": 0.2, "quiet": 0.02},
    ]}});
    let mission = EnvConfig::from_json(&legs.to_string()).expect("it can be flown");
    let mut all = [plain, real, consistent, mission];
    for config in &mut all {
        config.scenario.horizon = 0.5;
        config.scenario.slew.max_accel = 0.5;
        config.task.preview_times = vec![0.1, 0.3];
    }
    all
}

fn plain() -> EnvConfig {
    let [plain, ..] = configurations();
    plain
}

/// Magic, version, fingerprint of the configuration; then the checksum of the rest.
const CHECKSUM: usize = 4 + 2 + 8;
const BODY: usize = CHECKSUM + 4;

/// Places of a snapshot that are replaced, or a snapshot as a whole; in one environment and in a batch.
pub fn snapshot(data: &[u8]) {
    let mut given = Bytes(data);
    let config = Arc::new(configurations()[given.byte(4)].clone());
    let mut env = Env::new(config.clone()).expect("it can be made");
    env.reset(Some(Seed::from_u64(3)), &Overrides::new())
        .expect("it can be drawn");
    for _ in 0..given.byte(40) {
        if env.is_running() {
            env.step(&vec![0.3; config.task.actuators.len()])
                .expect("it is running");
        }
    }
    let before = env.get_state();
    let (how, in_batch) = (given.byte(4), given.byte(4) == 0);
    let mut bytes = match how {
        0 => given.0.to_vec(),
        1 => [&before[..BODY], given.0].concat(),
        _ => {
            let mut bytes = before.clone();
            while !given.0.is_empty() {
                let place = usize::from(u16::from_le_bytes(given.take())) % bytes.len();
                match given.byte(5) {
                    0 => bytes[place] ^= 1 << given.byte(8),
                    1 => bytes[place] = given.byte(256) as u8,
                    2 => bytes.truncate(place.max(1)),
                    3 => bytes.insert(place, given.byte(256) as u8),
                    _ => {
                        let end = (place + 8).min(bytes.len());
                        bytes[place..end].copy_from_slice(&given.take::<8>()[..end - place]);
                    }
                }
            }
            bytes
        }
    };
    if how != 0 && how != 2 && bytes.len() > BODY {
        let checksum = crc32fast::hash(&bytes[BODY..]).to_le_bytes();
        bytes[CHECKSUM..BODY].copy_from_slice(&checksum);
    }
    if in_batch {
        return snapshot_of_batch(&config, &bytes);
    }
    if let Err(error) = env.set_state(&bytes) {
        refused(&error);
        assert_eq!(env.get_state(), before, "nothing has changed");
        return;
    }
    let taken = env.get_state();
    env.set_state(&taken).expect("what was taken is whole");
    assert_eq!(env.get_state(), taken);
    for _ in 0..4 {
        if !env.is_running() {
            env.reset(None, &Overrides::new()).expect("it can be drawn");
        }
        let outcome = env
            .step(&vec![0.5; config.task.actuators.len()])
            .expect("it is running");
        assert!(outcome.reward.is_finite());
        assert!(env.observation().iter().all(|x| x.is_finite()));
    }
}

fn snapshot_of_batch(config: &Arc<EnvConfig>, bytes: &[u8]) {
    let mut batch =
        Batch::new(config.clone(), 3, Autoreset::NextStep, Some(1)).expect("it can be made");
    let seeds: Vec<_> = (0..3).map(|i| Some(Seed::from_u64(i))).collect();
    batch.reset(&seeds, None, None).expect("it can be drawn");
    let before = batch.get_state();
    if batch.set_env_state(1, bytes).is_err() {
        assert_eq!(batch.get_state(), before, "nothing has changed");
    }
    let before = batch.get_state();
    // as the whole, and as what is under a right checksum
    let checksum = crc32fast::hash(bytes).to_le_bytes();
    let sealed = [&before[..4], &checksum, bytes].concat();
    for bytes in [bytes, &sealed] {
        match batch.set_state(bytes) {
            Ok(()) => assert!(batch.has_reset() || !batch.get_state().is_empty()),
            Err(error) => {
                refused(&error);
                assert_eq!(batch.get_state(), before, "nothing has changed");
            }
        }
    }
}

/// Networks of any sizes and numbers, and policies as a page has them: text, a zero, weights.
pub fn network(data: &[u8]) {
    let Some((first, rest)) = data.split_first() else {
        return;
    };
    if first.is_multiple_of(2) {
        let parts: Vec<&[u8]> = rest.splitn(2, |byte| *byte == 0).collect();
        let weights = parts.get(1).copied().unwrap_or_default();
        return page(&String::from_utf8_lossy(parts[0]), weights);
    }
    let mut given = Bytes(rest);
    let activation = [Activation::Tanh, Activation::Relu][given.byte(2)];
    let output = [Output::Clip, Output::Tanh][given.byte(2)];
    let (count, odd) = (given.byte(4), given.byte(8) == 0);
    let mut inputs = given.byte(9);
    let layers: Vec<Layer> = (0..count)
        .map(|_| {
            let outputs = given.byte(9);
            let size = if odd {
                given.byte(90)
            } else {
                inputs * outputs
            };
            inputs = outputs;
            Layer {
                weights: (0..size).map(|_| given.single()).collect(),
                biases: (0..outputs).map(|_| given.single()).collect(),
            }
        })
        .collect();
    let made = match Network::new(&layers, activation, output) {
        Ok(made) => made,
        Err(error) => return refused(&error),
    };
    let mut shown: Vec<f64> = (0..made.inputs())
        .map(|_| f64::from(given.single()))
        .collect();
    let mut action = vec![0.0; made.outputs()];
    let mut scratch = Scratch::new();
    made.act(&shown, &mut scratch, &mut action)
        .expect("the sizes fit");
    let sound = shown.iter().all(|value| value.is_finite());
    assert!(action.iter().all(|a| a.is_nan() || a.abs() <= 1.0));
    if sound && shown.iter().all(|value| value.abs() <= 1e3) {
        let most = layers
            .iter()
            .flat_map(|l| l.weights.iter().chain(&l.biases));
        if most.fold(0.0_f32, |most, w| most.max(w.abs())) <= 1e3 {
            assert!(action.iter().all(|a| a.is_finite()));
        }
    }
    shown.push(0.0);
    assert!(made.act(&shown, &mut scratch, &mut action).is_err());
}

/// Actions of any bits in batches of any width, and torques of any bits for any number of manoeuvres.
pub fn actions(data: &[u8]) {
    let mut given = Bytes(data);
    if given.byte(2) == 0 {
        return torques(&mut given);
    }
    let config = Arc::new(configurations()[given.byte(4)].clone());
    let count = 1 + given.byte(10);
    let autoreset = [
        Autoreset::Disabled,
        Autoreset::NextStep,
        Autoreset::SameStep,
    ][given.byte(3)];
    let instructions = some_instructions(&mut given);
    let mut batch =
        Batch::with_instructions(config.clone(), count, autoreset, Some(1), instructions)
            .expect("it can be made");
    let seeds: Vec<_> = (0..count as u64).map(|i| Some(Seed::from_u64(i))).collect();
    batch.reset(&seeds, None, None).expect("it can be drawn");
    let size = batch.observation_size();
    let actuators = config.task.actuators.len();
    for _ in 0..1 + given.byte(12) {
        let odd = given.byte(16) == 0;
        let entries = if odd {
            given.byte(30)
        } else {
            count * actuators
        };
        let actions: Vec<f32> = (0..entries).map(|_| given.single()).collect();
        let (before, mut singles) = (batch.get_state(), Vec::new());
        for i in 0..count {
            singles.push(batch.env(i).expect("there is such an environment"));
        }
        let mut observations = vec![0.0; count * size];
        let mut rewards = vec![0.0; count];
        let mut out = StepBuffers {
            observations: &mut observations,
            rewards: &mut rewards,
            terminated: &mut vec![false; count],
            truncated: &mut vec![false; count],
            terms: &mut vec![0.0; 3 * count],
        };
        let waits = !singles.iter().all(Env::is_running);
        if let Err(error) = batch.step(&actions, &mut out) {
            refused(&error);
            assert_eq!(batch.get_state(), before, "nothing has changed");
            let sound = entries == count * actuators && actions.iter().all(|a| a.is_finite());
            assert!(!sound || waits, "sound actions are taken");
            continue;
        }
        assert!(rewards.iter().all(|reward| reward.is_finite()));
        assert!(observations.iter().all(|value| value.is_finite()));
        for (i, single) in singles.iter_mut().enumerate() {
            if single.is_running() {
                let own = &actions[i * actuators..(i + 1) * actuators];
                let outcome = single.step(own).expect("it is running");
                assert_eq!(outcome.reward.to_bits(), rewards[i].to_bits());
                let ended = outcome.terminated || outcome.truncated;
                if !ended || autoreset != Autoreset::SameStep {
                    let row = &observations[i * size..(i + 1) * size];
                    assert_eq!(single.observation(), row);
                }
            }
        }
    }
}

fn some_instructions(given: &mut Bytes<'_>) -> Instructions {
    let wanted = [
        Instructions::Baseline,
        Instructions::Avx2,
        Instructions::Avx512,
    ][given.byte(3)];
    wanted.min(Instructions::detect())
}

fn torques(given: &mut Bytes<'_>) {
    let count = given.byte(11);
    let options = Options {
        instructions: some_instructions(given),
        ..one_thread()
    };
    let mut scenarios = Vec::with_capacity(count);
    for _ in 0..count {
        let mut scenario = Scenario {
            horizon: 0.02 * (1 + given.byte(8)) as f64,
            ..Scenario::default()
        };
        for _ in 0..given.byte(4) {
            let value = given.double();
            match given.byte(7) {
                0 => scenario.payload.mass = value,
                1 => scenario.slew.angle = value,
                2 => scenario.slew.max_accel = value,
                3 => scenario.deployment.start = value,
                4 => scenario.mass_error = value,
                5 => scenario.initial.beta = value,
                _ => scenario.slew_motor.torque_limit = value,
            }
        }
        scenarios.push(scenario);
    }
    let scenarios = match ValidScenario::all(&scenarios) {
        Ok(scenarios) => scenarios,
        Err(error) => return refused(&error),
    };
    let (rows, hold) = (given.byte(7), given.byte(5));
    let odd = given.byte(16) == 0;
    let all = if odd { given.byte(40) } else { rows * count };
    let torques: Vec<[f64; 2]> = (0..all).map(|_| [given.double(), given.double()]).collect();
    let schedule = |torques| Schedule {
        torques,
        rows,
        hold,
    };
    let pilot = match Pilot::schedule(schedule(&torques)) {
        Ok(pilot) => pilot,
        Err(error) => return refused(&error),
    };
    let seeds: Vec<_> = (0..count as u64).map(Seed::from_u64).collect();
    let flown = match fly(&scenarios, &pilot, &seeds, &options, |_| true) {
        Ok(Flown { metrics, .. }) => metrics,
        Err(error) => return refused(&error),
    };
    assert_eq!(flown.len(), count);
    for (i, scenario) in scenarios.iter().enumerate() {
        let own = &torques[i * rows..(i + 1) * rows];
        let pilot = Pilot::schedule(schedule(own)).expect("they are finite");
        let alone = fly_one(scenario, &pilot, 1, seeds[i]).expect("as among others");
        assert_eq!(bits(&flown[i].values()), bits(&alone.metrics.values()));
    }
}
