//! One manoeuvre, as a page asks for it.

use drm_env::config::{ValidConfig, law_from_json, scenario_from_json, typed};
use drm_env::control::mlp::{Activation, Layer, Network, Output};
use drm_env::error::{ConfigError, Error};
use drm_env::math::rng::Seed;
use drm_env::rollout::{Pilot, SIGNAL_NAMES, fly_one, simulate};
use drm_env::simulation::metrics::METRIC_NAMES;
use drm_env::{Model, Scenario};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

/// Lengths of link 2 at which natural frequencies are given, from the start of the deployment to its end.
pub const LENGTHS: usize = 17;

/// Natural frequencies that are given at each length.
pub const FREQUENCIES: usize = 2;

/// What is to be flown, by whom.
#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Request {
    /// Any part of a scenario.
    scenario: Map<String, Value>,
    /// A law by name or with its parameters.
    #[serde(default)]
    law: Option<Value>,
    /// A network instead of a law; its weights come beside the text.
    #[serde(default)]
    policy: Option<Policy>,
    /// Every so many samples are kept.
    every: usize,
    /// Of the sensors' noise.
    seed: u64,
}

/// A learned policy as its `policy.json` describes it.
#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct Policy {
    /// Environment in which it acts.
    config: Map<String, Value>,
    /// Outputs and inputs of each layer.
    layers: Vec<[usize; 2]>,
    activation: String,
    output: String,
}

/// What is where among the numbers of a [`Flown`].
#[derive(Debug, Serialize)]
pub struct Contents {
    /// Names of the metrics.
    pub metrics: [&'static str; METRIC_NAMES.len()],
    /// Names of the signals.
    pub signals: [&'static str; SIGNAL_NAMES.len()],
    /// Numbers in each signal.
    pub samples: usize,
    /// Lengths of link 2 at which natural frequencies are given.
    pub lengths: usize,
    /// Natural frequencies at each length.
    pub frequencies: usize,
    /// The whole scenario.
    pub scenario: Value,
    /// Length and width of the payload, m.
    pub payload: [f64; 2],
}

/// A manoeuvre that has been flown.
#[derive(Debug)]
pub struct Flown {
    /// What is where.
    pub contents: Contents,
    /// Metrics; each signal, one after the other; then lengths of link 2, m, and for each of them its natural
    /// frequencies, rad/s. SI units, angles in radians.
    pub numbers: Vec<f64>,
}

/// Flies one manoeuvre. `weights` are those of a policy, single precision, little-endian: for each layer
/// its weights, outputs x inputs, then its biases.
///
/// # Errors
/// Text that is no request, or a scenario, law or policy that cannot be used; with its path and value.
pub fn fly(request: &str, weights: &[u8]) -> Result<Flown, Error> {
    let document: Value =
        serde_json::from_str(request).map_err(|e| ConfigError::form("request", e))?;
    let request: Request = typed(&document).map_err(|e| e.within("request"))?;
    let scenario = scenario_from_json(&Value::Object(request.scenario).to_string())?;
    let seed = Seed::from_u64(request.seed);
    let flown = match (request.law, request.policy) {
        (Some(law), None) => {
            let law = law_from_json(&law.to_string())?;
            simulate(scenario, &law, request.every, seed)?
        }
        (None, Some(policy)) => {
            let network = network(&policy, weights)?;
            let config = Value::Object(policy.config).to_string();
            let config = ValidConfig::resolve("slew", Some(&config), None)?;
            let pilot = Pilot::network(&network, &config)?;
            fly_one(&scenario, &pilot, request.every, seed)?
        }
        _ => return Err(ConfigError::form("request", "give a law or a policy").into()),
    };
    let mut numbers = flown.metrics.values().to_vec();
    for signal in &flown.signals {
        numbers.extend_from_slice(signal);
    }
    let payload = scenario.true_payload()?;
    numbers.extend(natural_frequencies(&scenario)?);
    let contents = Contents {
        metrics: METRIC_NAMES,
        signals: SIGNAL_NAMES,
        samples: flown.signals[0].len(),
        lengths: LENGTHS,
        frequencies: FREQUENCIES,
        scenario: serde_json::to_value(*scenario).unwrap_or_default(),
        payload: [payload.length, payload.width],
    };
    Ok(Flown { contents, numbers })
}

/// The network of a policy.
fn network(policy: &Policy, weights: &[u8]) -> Result<Network, ConfigError> {
    let activation = match policy.activation.as_str() {
        "tanh" => Activation::Tanh,
        "relu" => Activation::Relu,
        other => {
            let requirement = "must be one of tanh, relu";
            return Err(ConfigError::value("policy.activation", requirement, other));
        }
    };
    let output = match policy.output.as_str() {
        "clip" => Output::Clip,
        "tanh" => Output::Tanh,
        other => {
            let requirement = "must be one of clip, tanh";
            return Err(ConfigError::value("policy.output", requirement, other));
        }
    };
    // sizes are a stranger's: their product may not be a number
    let needed = policy.layers.iter().fold(0_u128, |sum, [rows, columns]| {
        let numbers = (*rows as u128).saturating_mul(*columns as u128 + 1);
        sum.saturating_add(numbers.saturating_mul(4))
    });
    if weights.len() as u128 != needed {
        let requirement = format!("must have {needed} bytes");
        return Err(ConfigError::value("weights", requirement, weights.len()));
    }
    let mut numbers = weights
        .as_chunks::<4>()
        .0
        .iter()
        .map(|bytes| f32::from_le_bytes(*bytes));
    let mut take = |count: usize| -> Vec<f32> { numbers.by_ref().take(count).collect() };
    let layers: Vec<Layer> = policy
        .layers
        .iter()
        .map(|[rows, columns]| Layer {
            weights: take(rows * columns),
            biases: take(*rows),
        })
        .collect();
    Network::new(&layers, activation, output)
}

/// Lengths of link 2, then for each of them the lowest natural frequencies of the arm at rest.
fn natural_frequencies(scenario: &Scenario) -> Result<Vec<f64>, ConfigError> {
    let spec = json!({
        "arm": scenario.arm,
        "payload": scenario.payload,
        "plant": scenario.plant,
        "dynamics": scenario.dynamics,
    });
    let model = Model::from_json(&spec.to_string())?;
    let (from, to) = (
        scenario.deployment.start,
        scenario.deployment.final_extension(),
    );
    let length = |i: usize| from + (to - from) * i as f64 / (LENGTHS - 1) as f64;
    let mut numbers: Vec<f64> = (0..LENGTHS).map(length).collect();
    for i in 0..LENGTHS {
        numbers.extend(model.natural_frequencies(length(i), Some(FREQUENCIES))?);
    }
    Ok(numbers)
}
