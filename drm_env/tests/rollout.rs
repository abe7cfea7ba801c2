//! Rollouts beside the slow way to the same numbers: one manoeuvre at a time, one step at a time.

use std::sync::Arc;

use drm_env::config::parameter::Overrides;
use drm_env::config::scenario::ValidScenario;
use drm_env::config::{Actuator, EnvConfig, ValidConfig};
use drm_env::control::Law;
use drm_env::control::mlp::{Activation, Layer, Network, Output, Scratch};
use drm_env::env::sample_scenarios;
use drm_env::math::rng::Seed;
use drm_env::plant::PlantModel;
use drm_env::rollout::{
    Flown, Options, Pilot, Recording, SIGNAL_NAMES, fly, fly_one, rollout, signals, simulate,
};
use drm_env::simd::Instructions;
use drm_env::simulation::metrics::Metrics;
use drm_env::{Env, Error, Scenario, SimulationError};

fn seeds(count: usize) -> Vec<Seed> {
    (0..count)
        .map(|i| Seed::from_le_bytes(&[7 + i as u8]))
        .collect()
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

fn metric_bits(metrics: &Metrics) -> Vec<u64> {
    bits(&metrics.values())
}

/// Every number of a rollout.
fn all_bits(flown: &Flown) -> Vec<u64> {
    let trajectories = flown.trajectories.iter().flat_map(|t| &t.signals);
    let metrics = flown.metrics.iter().flat_map(metric_bits);
    metrics
        .chain(trajectories.flat_map(|(_, values)| bits(values)))
        .collect()
}

fn every_signal(every: usize) -> Option<Recording> {
    Some(Recording::new(&SIGNAL_NAMES, every).unwrap())
}

/// Manoeuvres of unequal lengths, some with noise, one of the other plant, one with other steps.
fn varied() -> Vec<Scenario> {
    let config = EnvConfig::preset("slew").unwrap();
    let mut scenarios = sample_scenarios(&config, &seeds(19)).unwrap();
    for (i, scenario) in scenarios.iter_mut().enumerate() {
        scenario.horizon = 0.5 + 0.07 * (i % 5) as f64;
        scenario.slew.max_accel = 0.2 + 0.1 * (i % 7) as f64;
        if i % 3 == 0 {
            scenario.sensors.angle_noise = 1e-4;
        }
    }
    scenarios[4].plant = PlantModel::Consistent;
    scenarios[9].integrator_step = 4e-4;
    scenarios[11].sample_period = 1e-3;
    scenarios
}

/// Every way to spread the work.
fn spreads(recording: Option<&Recording>) -> Vec<Options> {
    let known = [
        Instructions::Baseline,
        Instructions::Avx2,
        Instructions::Avx512,
    ];
    let usable = known.into_iter().filter(|i| *i <= Instructions::detect());
    usable
        .flat_map(|instructions| {
            [1, 2, 5, 19].map(|threads| Options {
                threads: Some(threads),
                instructions,
                recording: recording.cloned(),
            })
        })
        .collect()
}

fn network(inputs: usize, outputs: usize, gain: f32) -> Network {
    let mut state = 0x2545_f491_u32;
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 23) as f32 - 1.0
    };
    let sizes = [inputs, 17, 9, outputs];
    let layers: Vec<Layer> = sizes
        .windows(2)
        .map(|pair| Layer {
            weights: (0..pair[0] * pair[1]).map(|_| gain * next()).collect(),
            biases: (0..pair[1]).map(|_| next()).collect(),
        })
        .collect();
    Network::new(&layers, Activation::Tanh, Output::Tanh).unwrap()
}

fn network_for(config: &EnvConfig) -> Network {
    let inputs = drm_env::env::observation::observation_size(config);
    network(inputs, config.task.actuators.len(), 0.4)
}

#[test]
fn a_law_gives_the_same_bits_in_any_lane_on_any_thread_and_alone() {
    let (scenarios, seeds) = (varied(), seeds(19));
    let checked = ValidScenario::all(&scenarios).unwrap();
    let law = Law::named("lyapunov").unwrap();
    let recording = every_signal(30).unwrap();
    let mut first = None;
    for options in spreads(Some(&recording)) {
        let flown = fly(
            &checked,
            &Pilot::law(&law).unwrap(),
            &seeds,
            &options,
            |_| true,
        )
        .unwrap();
        let got = all_bits(&flown);
        assert_eq!(&got, first.get_or_insert(got.clone()), "{options:?}");
    }
    let flown = fly(
        &checked,
        &Pilot::law(&law).unwrap(),
        &seeds,
        &Options {
            recording: Some(recording),
            ..Options::default()
        },
        |_| true,
    )
    .unwrap();
    let plain = rollout(&scenarios, &law, &seeds, Some(1), |_| true).unwrap();
    let kept = flown.trajectories.unwrap();
    assert_eq!(kept.samples, 570 / 30 + 1, "0.57 s of 1 ms");
    for (i, scenario) in scenarios.iter().enumerate() {
        let alone = simulate(scenario, &law, 30, seeds[i]).unwrap();
        assert_eq!(metric_bits(&alone.metrics), metric_bits(&plain[i]));
        assert_eq!(metric_bits(&alone.metrics), metric_bits(&flown.metrics[i]));
        for ((name, values), expected) in kept.signals.iter().zip(&alone.signals) {
            let row = &values[i * kept.samples..][..kept.samples];
            let (row, rest) = row.split_at(expected.len());
            assert_eq!(bits(row), bits(expected), "{name} of {i}");
            assert!(rest.iter().all(|value| value.is_nan()));
        }
    }
}

#[test]
fn a_diverging_manoeuvre_ends_with_its_last_finite_row() {
    let mut scenario = Scenario {
        horizon: 1.0,
        ..Scenario::default()
    };
    scenario.initial.beta_rate = 1e4;
    let law = Law::named("linear").unwrap();
    let scenarios = [
        Scenario {
            horizon: 1.0,
            ..Scenario::default()
        },
        scenario,
    ];
    let checked = ValidScenario::all(&scenarios).unwrap();
    let options = Options {
        recording: every_signal(1),
        ..Options::default()
    };
    let flown = fly(
        &checked,
        &Pilot::law(&law).unwrap(),
        &seeds(2),
        &options,
        |_| true,
    )
    .unwrap();
    assert!(!flown.metrics[0].diverged);
    assert!(flown.metrics[1].diverged);
    let kept = flown.trajectories.unwrap();
    let time = &kept.signals[0].1;
    assert!(time[..kept.samples].iter().all(|t| t.is_finite()));
    let finite = time[kept.samples..].iter().filter(|t| t.is_finite());
    assert!((1..kept.samples).contains(&finite.count()));
}

/// Tasks with everything that an action passes through.
fn tasks() -> Vec<EnvConfig> {
    let mut residual = EnvConfig::preset("slew_residual").unwrap();
    residual.task.action_rate_limit = Some(3.0);
    residual.task.observation_history = 3;
    let mut direct = EnvConfig::preset("slew_direct").unwrap();
    direct.task.limits.slew_error = 0.02;
    direct.task.control_period = 0.006;
    assert!(direct.task.actuators.contains(&Actuator::SlewMotor));
    let mut tasks = [residual, direct];
    for config in &mut tasks {
        config.scenario.horizon = 0.5;
        config.scenario.slew.max_accel = 0.5;
        config.scenario.sensors.rate_noise = 1e-4;
    }
    tasks.into()
}

/// One episode, a step at a time: metrics and the signals after each sample period count `every`.
fn step_by_hand(config: &EnvConfig, scenario: &Scenario, seed: Seed, network: &Network) -> Env {
    let mut config = config.clone();
    config.scenario = *scenario;
    config.randomize = drm_env::config::parameter::Randomize::default();
    let mut env = Env::new(Arc::new(config)).unwrap();
    env.reset(Some(seed), &Overrides::new()).unwrap();
    let mut action = vec![0.0; network.outputs()];
    let mut scratch = Scratch::new();
    while env.is_running() {
        let observation: Vec<f64> = env.observation().iter().map(|x| f64::from(*x)).collect();
        network
            .act(&observation, &mut scratch, &mut action)
            .unwrap();
        let action: Vec<f32> = action.iter().map(|x| *x as f32).collect();
        env.step(&action).unwrap();
    }
    env
}

#[test]
fn a_network_flies_the_episodes_that_stepping_an_environment_makes() {
    for config in tasks() {
        let seeds = seeds(19);
        let mut scenarios = sample_scenarios(&config, &seeds).unwrap();
        // flown apart from the others
        scenarios[5].plant = PlantModel::Consistent;
        scenarios[6].integrator_step = 4e-4;
        let checked = ValidScenario::all(&scenarios).unwrap();
        let network = network_for(&config);
        let held = ValidConfig::new(config.clone()).unwrap();
        let pilot = Pilot::network(&network, &held).unwrap();
        let recording = every_signal(3).unwrap();
        let mut first = None;
        for options in spreads(Some(&recording)) {
            let flown = fly(&checked, &pilot, &seeds, &options, |_| true).unwrap();
            let got = all_bits(&flown);
            assert_eq!(&got, first.get_or_insert(got.clone()), "{options:?}");
            if options.threads != Some(2) {
                continue;
            }
            let kept = flown.trajectories.unwrap();
            for (i, scenario) in scenarios.iter().enumerate() {
                let env = step_by_hand(&config, scenario, seeds[i], &network);
                let expected = env.metrics();
                assert!(expected.episode_return < 0.0);
                assert_eq!(metric_bits(&flown.metrics[i]), metric_bits(&expected));
                let alone = fly_one(&checked[i], &pilot, 3, seeds[i]).unwrap();
                assert_eq!(metric_bits(&alone.metrics), metric_bits(&expected));
                let last = signals(env.flight(), env.flight().last_torques());
                let rows = (expected.duration / 0.006).round() as usize;
                for (column, (name, values)) in kept.signals.iter().enumerate() {
                    let values = &values[i * kept.samples..][..kept.samples];
                    let count = values.iter().filter(|value| value.is_finite()).count();
                    assert!(count.abs_diff(rows) <= 2, "{name}: {count} {rows}");
                    assert_eq!(bits(&alone.signals[column]), bits(&values[..count]));
                    if !["slew_torque", "motor_power"].contains(name) {
                        assert_eq!(
                            values[count - 1].to_bits(),
                            last[column].to_bits(),
                            "{name}"
                        );
                    }
                }
            }
            let ended_early = flown
                .metrics
                .iter()
                .filter(|metrics| metrics.diverged)
                .count();
            assert_eq!(ended_early > 0, config.task.limits.slew_error < 0.1);
        }
    }
}

fn refusal(config: &EnvConfig, network: &Network, scenarios: &[Scenario]) -> String {
    let config = match ValidConfig::new(config.clone()) {
        Ok(held) => held,
        Err(error) => return error.to_string(),
    };
    let pilot = match Pilot::network(network, &config) {
        Ok(pilot) => pilot,
        Err(error) => return error.to_string(),
    };
    let scenarios = match ValidScenario::all(scenarios) {
        Ok(scenarios) => scenarios,
        Err(error) => return error.to_string(),
    };
    let mut asked = 0;
    let result = fly(
        &scenarios,
        &pilot,
        &seeds(scenarios.len()),
        &Options::default(),
        |_| {
            asked += 1;
            true
        },
    );
    assert_eq!(asked, 0, "refused before anything flies");
    result.unwrap_err().to_string()
}

#[test]
fn what_does_not_fit_the_task_is_refused() {
    let config = ValidConfig::resolve("slew", None, None).unwrap();
    let size = drm_env::env::observation::observation_size(&config);
    let good = [config.scenario; 3];
    assert_eq!(
        refusal(&config, &network(size + 1, 2, 0.1), &good),
        format!(
            "policy must have {size} inputs, one for each entry of the observation, got {}",
            size + 1
        )
    );
    assert_eq!(
        refusal(&config, &network(size, 3, 0.1), &good),
        "policy must have 2 outputs, one for each actuator, got 3"
    );
    let network = network_for(&config);
    let mut bad = good;
    bad[1].sample_period = 1e-3;
    assert_eq!(
        refusal(&config, &network, &bad),
        "scenarios[1].sample_period must be 0.002, as in the policy's task, got 0.001"
    );
    let mut bad = good;
    bad[2].horizon = 3.0;
    assert_eq!(
        refusal(&config, &network, &bad),
        "scenarios[2].horizon must be 20, as in the policy's task, got 3"
    );
    let mut bad = good;
    bad[0].payload.mass = -1.0;
    assert!(refusal(&config, &network, &bad).contains("scenarios[0].payload.mass"));
    let direct = EnvConfig::preset("slew_direct").unwrap();
    let mut bad = good;
    bad[1].slew_motor.torque_limit = 10.0;
    assert_eq!(
        refusal(&direct, &network_for(&direct), &bad),
        "scenarios[1].slew_motor.torque_limit must be 5000, as in the policy's task, got 10"
    );
}

#[test]
fn recordings_that_cannot_be_kept_are_refused() {
    let names = Recording::new(&["time", "speed"], 1).unwrap_err();
    assert!(
        names
            .to_string()
            .starts_with("signals[1] must be one of time, slew_angle")
    );
    let twice = Recording::new(&["time", "time"], 1).unwrap_err();
    assert_eq!(twice.to_string(), "signals[1] must be named once, got time");
    let often = Recording::new(&["time"], 0).unwrap_err();
    assert_eq!(often.to_string(), "decimation must be at least 1, got 0");
    // 20 signals of 10^6 + 1 rows of 8 bytes, a thousand times
    let scenarios = vec![
        Scenario {
            horizon: 2000.0,
            ..Scenario::default()
        };
        1000
    ];
    let checked = ValidScenario::all(&scenarios).unwrap();
    let options = Options {
        recording: every_signal(1),
        ..Options::default()
    };
    let law = Law::named("none").unwrap();
    let seeds = seeds(1000);
    let error = fly(
        &checked,
        &Pilot::law(&law).unwrap(),
        &seeds,
        &options,
        |_| true,
    )
    .unwrap_err();
    let text = error.to_string();
    assert!(
        text.starts_with("signals must take at most 16 GiB"),
        "{text}"
    );
    assert!(
        text.ends_with("got 20 of 1000 manoeuvres, which takes 149.0 GiB"),
        "{text}"
    );
}

#[test]
fn an_interruption_ends_the_work() {
    let config = ValidConfig::resolve("slew_residual", None, None).unwrap();
    let network = network_for(&config);
    let checked = ValidScenario::all(&vec![config.scenario; 4000]).unwrap();
    let seeds = vec![Seed::default(); 4000];
    let law = Law::named("linear").unwrap();
    for pilot in [
        Pilot::law(&law).unwrap(),
        Pilot::network(&network, &config).unwrap(),
    ] {
        let options = Options {
            recording: Some(Recording::new(&["time"], 10).unwrap()),
            threads: Some(2),
            ..Options::default()
        };
        let begun = std::time::Instant::now();
        let result = fly(&checked, &pilot, &seeds, &options, |_| false);
        assert!(matches!(
            result,
            Err(Error::Simulation(SimulationError::Interrupted))
        ));
        assert!(begun.elapsed().as_secs_f64() < 1.0);
    }
}

#[test]
fn a_policy_that_is_not_a_number_is_named() {
    let config = ValidConfig::resolve("slew", None, None).unwrap();
    let size = drm_env::env::observation::observation_size(&config);
    // f32::MAX^9 is beyond double precision; infinite sums of both signs are not a number
    let widen = |inputs: usize, sign: f32| Layer {
        weights: (0..2 * inputs)
            .map(|i| {
                if i < inputs {
                    f32::MAX
                } else {
                    sign * f32::MAX
                }
            })
            .collect(),
        biases: vec![f32::MAX, f32::MAX],
    };
    let mut layers = vec![widen(size, 1.0)];
    layers.extend((0..10).map(|_| widen(2, 1.0)));
    layers.push(Layer {
        weights: vec![1.0, -1.0, 1.0, -1.0],
        biases: vec![0.0; 2],
    });
    let network = Network::new(&layers, Activation::Relu, Output::Clip).unwrap();
    let pilot = Pilot::network(&network, &config).unwrap();
    let checked = ValidScenario::all(&[config.scenario; 3]).unwrap();
    let error = fly(&checked, &pilot, &seeds(3), &Options::default(), |_| true).unwrap_err();
    let text = error.to_string();
    assert!(
        text.contains("action[0] of the policy in scenarios["),
        "{text}"
    );
    assert!(text.contains("must be finite, got NaN"), "{text}");
}

#[test]
fn nothing_is_flown_of_nothing() {
    let law = Law::named("none").unwrap();
    let options = Options {
        recording: every_signal(1),
        ..Options::default()
    };
    let flown = fly(&[], &Pilot::law(&law).unwrap(), &[], &options, |_| true).unwrap();
    assert!(flown.metrics.is_empty());
    assert_eq!(flown.trajectories.unwrap().samples, 0);
}

#[test]
fn one_manoeuvre_is_flown_under_any_pilot_and_refused_by_its_own_names() {
    let (scenario, seed) = (varied()[3], Seed::from_u64(5));
    let law = Law::named("linear").unwrap();
    let pilot = Pilot::law(&law).unwrap();
    let checked = ValidScenario::new(scenario).unwrap();
    let alone = fly_one(&checked, &pilot, 7, seed).unwrap();
    let plain = simulate(&scenario, &law, 7, seed).unwrap();
    assert_eq!(metric_bits(&alone.metrics), metric_bits(&plain.metrics));
    for (found, expected) in alone.signals.iter().zip(&plain.signals) {
        assert_eq!(bits(found), bits(expected));
    }
    let none = fly_one(&checked, &pilot, 0, seed).unwrap_err();
    assert_eq!(none.to_string(), "decimation must be at least 1, got 0");
}
