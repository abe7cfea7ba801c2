//! Contract: an environment gives the same bits alone and in any lane of any batch, whatever the
//! instructions, the size of the batch and the number of threads.

use std::sync::Arc;

use drm_env::Env;
use drm_env::EnvConfig;
use drm_env::batch::{Autoreset, Batch, StepBuffers};
use drm_env::config::parameter::Overrides;
use drm_env::config::scenario::Scenario;
use drm_env::control::Law;
use drm_env::math::rng::Seed;
use drm_env::rollout::{rollout, simulate};
use drm_env::simd::Instructions;

/// What a step returns, as bits.
#[derive(Debug, PartialEq, Clone)]
struct Step {
    observation: Vec<u32>,
    reward: u64,
    terms: [u64; 3],
    ended: (bool, bool),
}

const STEPS: usize = 90;

/// The same actions for an environment wherever it is; some beyond the limits.
fn action(env: usize, step: usize, index: usize) -> f32 {
    let phase = (env * 37 + step * 11 + index * 5) as f32;
    1.3 * (0.61 * phase).sin()
}

fn bits(observation: &[f32]) -> Vec<u32> {
    observation.iter().map(|x| x.to_bits()).collect()
}

/// Episodes of one environment, reset in the step that ends them; the first entry is the reset.
fn alone(config: &Arc<EnvConfig>, env: usize) -> Vec<Step> {
    let mut single = Env::new(Arc::clone(config)).expect("it can be made");
    let none = Overrides::new();
    single
        .reset(Some(Seed::from_u64(env as u64)), &none)
        .expect("it can be reset");
    let width = config.task.actuators.len();
    (0..STEPS)
        .map(|step| {
            let action: Vec<f32> = (0..width).map(|i| action(env, step, i)).collect();
            let outcome = single.step(&action).expect("it can be stepped");
            let terms = single.reward_terms().map(f64::to_bits);
            if outcome.terminated || outcome.truncated {
                single.reset(None, &none).expect("it can be reset");
            }
            Step {
                observation: bits(single.observation()),
                reward: outcome.reward.to_bits(),
                terms,
                ended: (outcome.terminated, outcome.truncated),
            }
        })
        .collect()
}

fn together(
    config: &Arc<EnvConfig>,
    count: usize,
    threads: usize,
    instructions: Instructions,
) -> Vec<Vec<Step>> {
    let mut batch = Batch::with_instructions(
        Arc::clone(config),
        count,
        Autoreset::SameStep,
        Some(threads),
        instructions,
    )
    .expect("it can be made");
    let seeds: Vec<Option<Seed>> = (0..count)
        .map(|env| Some(Seed::from_u64(env as u64)))
        .collect();
    batch.reset(&seeds, None, None).expect("it can be reset");
    let (width, size) = (config.task.actuators.len(), batch.observation_size());
    let (mut observations, mut rewards) = (vec![0.0; count * size], vec![0.0; count]);
    let (mut terminated, mut truncated) = (vec![false; count], vec![false; count]);
    let mut terms = vec![0.0; 3 * count];
    let mut flown = vec![Vec::new(); count];
    for step in 0..STEPS {
        let actions: Vec<f32> = (0..count * width)
            .map(|i| action(i / width, step, i % width))
            .collect();
        let mut out = StepBuffers {
            observations: &mut observations,
            rewards: &mut rewards,
            terminated: &mut terminated,
            truncated: &mut truncated,
            terms: &mut terms,
        };
        batch.step(&actions, &mut out).expect("it can be stepped");
        for (env, steps) in flown.iter_mut().enumerate() {
            steps.push(Step {
                observation: bits(&observations[env * size..][..size]),
                reward: rewards[env].to_bits(),
                terms: std::array::from_fn(|i| terms[3 * env + i].to_bits()),
                ended: (terminated[env], truncated[env]),
            });
        }
    }
    flown
}

fn available() -> Vec<Instructions> {
    [
        Instructions::Baseline,
        Instructions::Avx2,
        Instructions::Avx512,
    ]
    .into_iter()
    .filter(|instructions| *instructions <= Instructions::detect())
    .collect()
}

fn same_bits_everywhere(name: &str, preset: &str, options: &str) {
    let config = EnvConfig::resolve(preset, None, Some(options)).expect("the options are good");
    let config = Arc::new(config);
    let expected: Vec<Vec<Step>> = (0..13).map(|env| alone(&config, env)).collect();
    let ends = expected
        .iter()
        .flatten()
        .filter(|step| step.ended.0 || step.ended.1);
    assert!(ends.count() >= 13, "{name}: episodes end in between");
    for instructions in available() {
        for (count, threads) in [(1, 1), (3, 1), (8, 2), (13, 1), (13, 2)] {
            let flown = together(&config, count, threads, instructions);
            for (env, (flown, expected)) in flown.iter().zip(&expected).enumerate() {
                for (step, (flown, expected)) in flown.iter().zip(expected).enumerate() {
                    assert_eq!(
                        flown, expected,
                        "{name}, {instructions:?}, {count} on {threads}, environment {env}, step {step}"
                    );
                }
            }
        }
    }
}

/// Slews and deployments of every kind, so that lanes switch at different times.
const DRAWN: &str = r#""slew_angle": {"uniform": [0.01, 0.4]}, "slew_profile": ["min_time", "min_energy"],
    "slew_smoothing": {"uniform": [0.0, 0.2]}, "deployment_end": {"uniform": [2.0, 8.0]},
    "deployment_mode": ["coincident", "force_limited", "none"], "horizon": 0.6"#;

#[test]
fn drawn_manoeuvres_with_ideal_wheels() {
    same_bits_everywhere("ideal", "slew", &format!("{{{DRAWN}}}"));
}

#[test]
fn an_inner_law_and_stacked_observations() {
    let options = format!(r#"{{{DRAWN}, "observation_history": 3, "inner_law": "lyapunov"}}"#);
    same_bits_everywhere("inner law", "slew_residual", &options);
}

#[test]
fn lags_delays_noise_and_limits_that_end_episodes() {
    let options = format!(
        r#"{{{DRAWN}, "root_lag": {{"uniform": [0.0, 0.02]}}, "tip_dead_time": {{"uniform": [0.0, 0.006]}},
        "root_momentum_limit": 40.0, "angle_noise": 1e-5, "sensor_delay": {{"uniform": [0.0, 0.006]}},
        "deflection_resolution": 1e-5, "action_rate_limit": 20.0,
        "limits": {{"slew_error": 1.5, "tip_deflection": 0.006}}}}"#
    );
    same_bits_everywhere("rough", "slew", &options);
}

#[test]
fn followed_particles_damping_and_a_driven_slew_motor() {
    let options = format!(
        r#"{{{DRAWN}, "particle_following": true, "structural_damping": {{"uniform": [0.0, 1e-3]}}}}"#
    );
    same_bits_everywhere("driven", "slew_direct", &options);
}

#[test]
fn the_consistent_plant_of_one_arm_and_of_several() {
    let one = format!(r#"{{{DRAWN}, "plant": "consistent", "modes": [2, 2]}}"#);
    same_bits_everywhere("consistent", "slew", &one);
    // each takes another of the steps that are compiled
    for modes in ["[4, 4]", "[3, 5]", "[5, 5]"] {
        let options = format!(r#"{{{DRAWN}, "plant": "consistent", "modes": {modes}}}"#);
        same_bits_everywhere(modes, "slew", &options);
    }
    let several = format!(
        r#"{{{DRAWN}, "plant": "consistent", "modes": [2, 1],
        "link1_bending_stiffness": {{"uniform": [2.0e6, 3.0e6]}}}}"#
    );
    same_bits_everywhere("consistent, several arms", "slew", &several);
}

/// Rollouts refill lanes and put manoeuvres of another kind aside: each is flown as `simulate` does.
#[test]
fn rollouts_give_the_bits_of_manoeuvres_flown_alone() {
    let mut scenarios = Vec::new();
    for i in 0..23_u32 {
        let mut scenario = Scenario {
            horizon: 0.5 + 0.1 * f64::from(i % 5),
            ..Scenario::default()
        };
        scenario.payload.mass = 100.0 + 10.0 * f64::from(i);
        scenario.slew.angle = 0.02 + 0.01 * f64::from(i % 7);
        scenario.dynamics.axial_load = i % 6 != 0;
        scenario.sample_period = if i % 9 == 0 { 4e-3 } else { 2e-3 };
        scenarios.push(scenario);
    }
    let seeds = vec![Seed::default(); scenarios.len()];
    let law = Law::named("lyapunov").expect("the law exists");
    for threads in [1, 2, 3] {
        let metrics =
            rollout(&scenarios, &law, &seeds, Some(threads), |_| true).expect("they can be flown");
        for (i, (metrics, scenario)) in metrics.iter().zip(&scenarios).enumerate() {
            let single = simulate(scenario, &law, 1, Seed::default()).expect("it can be flown");
            let same = |x: [f64; 17]| x.map(f64::to_bits);
            assert_eq!(
                same(metrics.values()),
                same(single.metrics.values()),
                "scenario {i} on {threads} threads"
            );
        }
    }
}

/// A fault on purpose, which `make sanitize` has to report: a caller says that there are more actions than there
/// are, and the engine reads them.
#[test]
#[ignore = "wrong on purpose: the address sanitiser ends it (make sanitize)"]
fn actions_that_end_too_early() {
    let config = EnvConfig::resolve("slew", None, None).expect("the options are good");
    let count = 8;
    let mut batch =
        Batch::new(Arc::new(config), count, Autoreset::SameStep, Some(1)).expect("it can be made");
    let seeds = vec![Some(Seed::default()); count];
    batch.reset(&seeds, None, None).expect("it can be reset");
    let actions = vec![0.0_f32; 2 * count - 1];
    // SAFETY: none; there is one less
    let more = unsafe { std::slice::from_raw_parts(actions.as_ptr(), 2 * count) };
    let mut out = StepBuffers {
        observations: &mut vec![0.0; count * batch.observation_size()],
        rewards: &mut vec![0.0; count],
        terminated: &mut vec![false; count],
        truncated: &mut vec![false; count],
        terms: &mut vec![0.0; 3 * count],
    };
    batch.step(more, &mut out).expect("it can be stepped");
}
