//! What a page is given beside what the engine flies.

use drm_env::config::{ValidConfig, scenario_from_json};
use drm_env::control::Law;
use drm_env::control::mlp::{Activation, Layer, Network, Output};
use drm_env::math::rng::Seed;
use drm_env::rollout::{Pilot, fly_one, simulate};
use drm_env_web::exports;
use drm_env_web::flight::{FREQUENCIES, Flown, LENGTHS, fly};
use serde_json::{Value, json};

const SCENARIO: &str = r#"{"payload": {"mass": 321.5}, "mass_error": -0.1, "horizon": 3.0,
    "sensors": {"rate_noise": 1e-4}, "deployment": {"start": 2.0, "end": 5.0}}"#;

fn asked(more: &Value) -> Result<Flown, String> {
    let mut request = json!({"every": 5, "seed": 9});
    request["scenario"] = serde_json::from_str(SCENARIO).expect("it is JSON");
    for (name, value) in more.as_object().expect("it is an object") {
        request[name] = value.clone();
    }
    fly(&request.to_string(), &weights()).map_err(|error| error.to_string())
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

/// Those of a network from `inputs` to two outputs, without a hidden layer.
fn layer() -> Layer {
    let inputs = 35;
    let weight = |i: usize| (i * 37 % 19) as f32 / 190.0 - 0.05;
    Layer {
        weights: (0..2 * inputs).map(weight).collect(),
        biases: vec![0.01, -0.02],
    }
}

fn weights() -> Vec<u8> {
    let layer = layer();
    let numbers = layer.weights.iter().chain(&layer.biases);
    numbers.flat_map(|number| number.to_le_bytes()).collect()
}

fn policy(config: &Value) -> Value {
    let inputs = layer().weights.len() / 2;
    json!({"policy": {
        "config": config, "layers": [[2, inputs]], "activation": "tanh", "output": "clip",
    }})
}

#[test]
fn a_law_flies_what_the_engine_simulates() {
    let found = asked(&json!({"law": "lyapunov"})).expect("it flies");
    let scenario = scenario_from_json(SCENARIO).expect("it can be flown");
    let law = Law::named("lyapunov").expect("there is one");
    let expected = simulate(scenario, &law, 5, Seed::from_u64(9)).expect("it flies");
    let mut numbers = expected.metrics.values().to_vec();
    expected
        .signals
        .iter()
        .for_each(|signal| numbers.extend(signal));
    assert_eq!(bits(&found.numbers[..numbers.len()]), bits(&numbers));
    assert_eq!(found.contents.samples, 301);
    let rest = &found.numbers[numbers.len()..];
    assert_eq!(rest.len(), LENGTHS * (1 + FREQUENCIES));
    assert_eq!((rest[0], rest[LENGTHS - 1]), (2.0, 5.0));
    // a longer arm is softer
    assert!(rest[LENGTHS] > rest[LENGTHS + FREQUENCIES]);
    assert_eq!(found.contents.scenario["payload"]["mass"], 321.5);
}

#[test]
fn a_network_flies_what_a_rollout_flies() {
    let config = json!({"scenario": {"horizon": 3.0}});
    let held = ValidConfig::resolve("slew", Some(&config.to_string()), None).expect("it is valid");
    let inputs = drm_env::env::observation::observation_size(&held);
    assert_eq!(inputs, layer().weights.len() / 2);
    let network = Network::new(&[layer()], Activation::Tanh, Output::Clip).expect("it is one");
    let pilot = Pilot::network(&network, &held).expect("it can fly");
    let scenario = scenario_from_json(SCENARIO).expect("it can be flown");
    let expected = fly_one(&scenario, &pilot, 5, Seed::from_u64(9)).expect("it flies");
    let found = asked(&policy(&config)).expect("it flies");
    let metrics = expected.metrics.values();
    assert_eq!(bits(&found.numbers[..metrics.len()]), bits(&metrics));
    assert!(expected.metrics.episode_return < 0.0);
}

#[test]
fn what_cannot_be_flown_is_refused_in_the_engine_s_words() {
    let scenario = json!({"scenario": {"payload": {"mass": -3.0}}, "law": "none"});
    let mass = asked(&scenario).expect_err("there is none");
    assert_eq!(mass, "payload.mass must be finite and not negative, got -3");
    let law = asked(&json!({"law": "strong"})).expect_err("there is none");
    assert!(
        law.starts_with("law.name must be one of none, linear"),
        "{law}"
    );
    let both = asked(&json!({})).expect_err("nobody flies");
    assert_eq!(both, "request: give a law or a policy");
    let unknown = asked(&json!({"law": "none", "speed": 3})).expect_err("there is none");
    assert!(unknown.contains("unknown field `speed`"), "{unknown}");
    let mut other = policy(&json!({}));
    other["policy"]["layers"] = json!([[2, 5]]);
    let refused = asked(&other).expect_err("the weights are others");
    assert_eq!(refused, "weights must have 48 bytes, got 288");
    // the second has 2^128 bytes, which is 0 where numbers wrap around, and those that are there
    let half = 1_usize << 63;
    let inputs = policy(&json!({}))["policy"]["layers"][0][1].clone();
    for layers in [
        json!([[usize::MAX, usize::MAX]]),
        json!([[half, half - 1], [2, inputs]]),
    ] {
        other["policy"]["layers"] = layers;
        let huge = asked(&other).expect_err("nobody has such weights");
        assert!(huge.starts_with("weights must have "), "{huge}");
    }
    let horizon =
        asked(&policy(&json!({"scenario": {"horizon": 4.0}}))).expect_err("it is another");
    assert_eq!(horizon, "horizon must be 4, as in the policy's task, got 3");
}

/// Serde takes a list for a table, by position.
#[test]
fn a_list_is_no_table() {
    let list = fly(r#"[{}, "none", null, 1, 0]"#, &[]).expect_err("it is a list");
    assert!(
        list.to_string()
            .starts_with("request: must be a table of names and values"),
        "{list}"
    );
    let inner =
        asked(&json!({"policy": [{}, [[2, 35]], "tanh", "clip"]})).expect_err("it is a list");
    assert!(
        inner.starts_with("request.policy: must be a table"),
        "{inner}"
    );
    let law = asked(&json!({"law": ["linear"]})).expect_err("it is a list");
    assert!(law.starts_with("law: must be a table"), "{law}");
}

#[test]
fn memory_is_given_and_given_back() {
    assert_eq!(exports::exact(), 1);
    let text = br#"{"scenario": {"horizon": 0.1}, "law": "none", "every": 1, "seed": 0}"#;
    let place = exports::allocate(text.len());
    assert!(!place.is_null());
    // SAFETY: it is memory of so many bytes, which is given back once, as is the reply
    unsafe {
        place.copy_from(text.as_ptr(), text.len());
        let nothing = exports::allocate(0);
        let reply = exports::fly(place, text.len(), nothing, 0);
        let words: [usize; 5] = std::ptr::read(reply.cast());
        assert_eq!(words[0], 0);
        let said = std::slice::from_raw_parts(words[1] as *const u8, words[2]);
        let contents: Value = serde_json::from_slice(said).expect("it is JSON");
        assert_eq!(contents["samples"], 51);
        assert_eq!(words[4], 17 + 20 * 51 + 3 * LENGTHS);
        exports::forget(reply);
        exports::release(place, text.len());
        exports::release(nothing, 0);
    }
}

/// A fault on purpose, which `make sanitize` has to report: the page reads a reply that it has given back.
#[test]
#[ignore = "wrong on purpose: the address sanitiser ends it (make sanitize)"]
fn a_reply_that_was_given_back() {
    let text = b"{}";
    // SAFETY: none; the reply is not there any more
    unsafe {
        let reply = exports::fly(text.as_ptr(), text.len(), exports::allocate(0), 0);
        exports::forget(reply);
        exports::forget(reply);
    }
}
