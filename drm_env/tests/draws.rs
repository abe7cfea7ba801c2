//! Parameters that are drawn and do not always go together.

use std::sync::Arc;

use drm_env::batch::{Autoreset, Batch, StepBuffers};
use drm_env::config::EnvConfig;
use drm_env::config::distribution::{Distribution, Setting};
use drm_env::config::parameter::{Overrides, Randomize, position};
use drm_env::env::sample_scenarios;
use drm_env::math::rng::Seed;
use drm_env::reference::slew::SlewProfile;
use drm_env::{Env, Error};

fn named(name: &str) -> Setting {
    Setting::Name(name.into())
}

/// Smoothing up to 0.27, of which minimum time takes less than 0.25.
fn at_odds(profiles: [&str; 2], smoothing: Distribution) -> EnvConfig {
    let mut config = EnvConfig::preset("slew").expect("it is a preset");
    config.scenario.horizon = 0.02;
    config.randomize = Randomize {
        slew_profile: Some(Distribution::Choices(profiles.map(named).into())),
        slew_smoothing: Some(smoothing),
        ..Randomize::default()
    };
    config
}

fn both_orders() -> [EnvConfig; 2] {
    [["min_energy", "min_time"], ["min_time", "min_energy"]]
        .map(|profiles| at_odds(profiles, Distribution::Uniform([0.0, 0.27])))
}

fn seeds(count: usize, first: u64) -> Vec<Seed> {
    (0..count as u64)
        .map(|i| Seed::from_u64(first + i))
        .collect()
}

/// Rows of a batch with what a step writes.
struct Rows {
    observations: Vec<f32>,
    rewards: Vec<f64>,
    terminated: Vec<bool>,
    truncated: Vec<bool>,
    terms: Vec<f64>,
}

impl Rows {
    fn of(batch: &Batch) -> Self {
        let count = batch.len();
        Self {
            observations: vec![0.0; count * batch.observation_size()],
            rewards: vec![0.0; count],
            terminated: vec![false; count],
            truncated: vec![false; count],
            terms: vec![0.0; 3 * count],
        }
    }

    fn step(&mut self, batch: &mut Batch) -> Result<(), Error> {
        let actions = vec![0.0; batch.len() * 2];
        let mut out = StepBuffers {
            observations: &mut self.observations,
            rewards: &mut self.rewards,
            terminated: &mut self.terminated,
            truncated: &mut self.truncated,
            terms: &mut self.terms,
        };
        batch.step(&actions, &mut out)
    }
}

/// Every door that draws; the order of the choices does not matter.
#[test]
fn what_does_not_go_together_is_drawn_again() {
    for config in both_orders() {
        config.validate().expect("most draws can be flown");
        let drawn = sample_scenarios(&config, &seeds(300, 0)).expect("all can be drawn");
        let long = drawn.iter().filter(|s| s.slew.smoothing >= 0.25);
        let long: Vec<_> = long.map(|s| s.slew.profile).collect();
        assert!(!long.is_empty() && long.iter().all(|p| *p == SlewProfile::MinEnergy));
        for autoreset in [Autoreset::NextStep, Autoreset::SameStep] {
            let mut batch = Batch::new(Arc::new(config.clone()), 16, autoreset, Some(2))
                .expect("it can be made");
            let first: Vec<_> = seeds(16, 0).into_iter().map(Some).collect();
            batch.reset(&first, None, None).expect("all can be drawn");
            let mut rows = Rows::of(&batch);
            for _ in 0..300 {
                rows.step(&mut batch).expect("all can be drawn");
            }
        }
        let mut env = Env::new(Arc::new(config)).expect("it can be made");
        for _ in 0..300 {
            env.reset(None, &Overrides::new()).expect("it can be drawn");
        }
    }
}

/// A draw that could be flown is the first attempt's, with what goes together beside it or not.
#[test]
fn draws_that_could_be_flown_have_not_moved() {
    let [config, _] = both_orders();
    let mut narrow = config.clone();
    narrow.randomize.slew_profile = Some(Distribution::Fixed(named("min_energy")));
    let seeds = seeds(300, 0);
    let both = sample_scenarios(&config, &seeds).expect("all can be drawn");
    let plain = sample_scenarios(&narrow, &seeds).expect("all can be drawn");
    let moved: Vec<_> = both
        .iter()
        .zip(&plain)
        .filter(|(both, plain)| both.slew.smoothing != plain.slew.smoothing)
        .collect();
    assert!(!moved.is_empty() && moved.len() < 40, "{}", moved.len());
    // only where the first attempt was minimum time with more than it takes
    assert!(moved.iter().all(|(_, plain)| plain.slew.smoothing >= 0.25));
}

#[test]
fn ends_that_fit_nothing_and_ranges_that_seldom_go_together_are_refused() {
    let refused = |config: &EnvConfig| config.validate().expect_err("it cannot fly").to_string();
    for range in [[0.0, 0.6], [-0.1, 0.2]] {
        let config = at_odds(["min_energy", "min_time"], Distribution::Uniform(range));
        assert!(refused(&config).starts_with("slew.smoothing must be at least 0"));
    }
    // minimum time takes one of fifty, minimum energy is not drawn
    let mut choices = vec![Setting::Number(0.1)];
    choices.extend((0..49).map(|i| Setting::Number(0.3 + 1e-3 * f64::from(i))));
    let mut config = at_odds(["min_time", "min_energy"], Distribution::Choices(choices));
    config.validate().expect("half of the draws can be flown");
    let seldom = std::iter::repeat_n(named("min_time"), 50);
    config.randomize.slew_profile = Some(Distribution::Choices(
        seldom.chain([named("min_energy")]).collect(),
    ));
    let message = refused(&config);
    assert!(message.starts_with("randomize: only "), "{message}");
    assert!(message.contains("slew.smoothing"), "{message}");
}

/// Of 400 choices of the smoothing, minimum time takes one.
fn seldom() -> (EnvConfig, Overrides) {
    let mut choices = vec![Setting::Number(0.1)];
    choices.extend((0..399).map(|i| Setting::Number(0.3 + 1e-4 * f64::from(i))));
    let config = at_odds(["min_energy", "min_energy"], Distribution::Choices(choices));
    let profile = position("slew_profile").expect("it is a parameter");
    (
        config,
        vec![(profile, Distribution::Fixed(named("min_time")))],
    )
}

/// Overrides with which episodes could hardly be drawn are refused, and nothing has changed.
#[test]
fn overrides_that_leave_hardly_a_draw_are_refused() {
    let (config, minimum_time) = seldom();
    let mut env = Env::new(Arc::new(config)).expect("it can be made");
    let mut refusals = 0;
    for seed in 0..30 {
        env.reset(Some(Seed::from_u64(seed)), &Overrides::new())
            .expect("it can be drawn");
        let before = env.get_state();
        if env.set_context(minimum_time.clone()).is_err() {
            assert_eq!(env.get_state(), before);
            refusals += 1;
        } else {
            env.set_context(Overrides::new())
                .expect("nothing is overridden");
        }
    }
    assert!(refusals > 15, "{refusals}");
}

/// A batch whose contexts have slipped through, each of which leaves one draw in 400: after some
/// episodes one cannot be drawn.
fn doomed(autoreset: Autoreset) -> Batch {
    let (config, minimum_time) = seldom();
    let mut batch = Batch::new(Arc::new(config), 12, autoreset, Some(2)).expect("it can be made");
    let mut seed = 0;
    for index in 0..12 {
        let mut mask = [false; 12];
        mask[index] = true;
        for _ in 0..200 {
            seed += 1;
            let seeds = [Some(Seed::from_u64(seed)); 12];
            batch
                .reset(&seeds, None, Some(&mask))
                .expect("it can be drawn");
            if batch.set_env_context(index, minimum_time.clone()).is_ok() {
                break;
            }
        }
    }
    batch
}

#[test]
fn a_draw_that_fails_before_a_step_moves_nothing() {
    let mut batch = doomed(Autoreset::NextStep);
    let mut rows = Rows::of(&batch);
    let mut before = batch.get_state();
    for _ in 0..200 {
        if let Err(error) = rows.step(&mut batch) {
            assert!(matches!(error, Error::Config(_)), "{error}");
            for _ in 0..3 {
                assert_eq!(batch.get_state(), before, "nothing has moved");
                assert_eq!(rows.step(&mut batch), Err(error.clone()));
            }
            let seeds: Vec<_> = seeds(12, 0).into_iter().map(Some).collect();
            batch
                .set_context(&vec![Overrides::new(); 12])
                .expect("nothing is overridden");
            batch.reset(&seeds, None, None).expect("all can be drawn");
            rows.step(&mut batch).expect("all are running");
            return;
        }
        before = batch.get_state();
    }
    panic!("every draw has succeeded");
}

#[test]
fn a_draw_that_fails_within_a_step_ends_that_episode_alone() {
    let mut batch = doomed(Autoreset::SameStep);
    let mut rows = Rows::of(&batch);
    for _ in 0..200 {
        rows.step(&mut batch).expect("the next one says so");
        let over: Vec<usize> = batch.ended().map(|(index, _)| index).collect();
        let began: Vec<usize> = batch.began().collect();
        let left: Vec<usize> = over
            .iter()
            .copied()
            .filter(|i| !began.contains(i))
            .collect();
        if left.is_empty() {
            continue;
        }
        // all the others have moved on
        for index in 0..12 {
            let env = batch.env(index).expect("there are twelve");
            assert_eq!(env.is_running(), !left.contains(&index));
        }
        let before = batch.get_state();
        for _ in 0..3 {
            let error = rows.step(&mut batch).expect_err("one cannot be drawn");
            assert!(matches!(error, Error::Config(_)), "{error}");
            assert_eq!(batch.get_state(), before, "nothing has moved");
        }
        let mask: Vec<bool> = (0..12).map(|i| left.contains(&i)).collect();
        let seeds: Vec<_> = seeds(12, 0).into_iter().map(Some).collect();
        batch
            .set_context(&vec![Overrides::new(); 12])
            .expect("nothing is overridden");
        batch
            .reset(&seeds, None, Some(&mask))
            .expect("all can be drawn");
        rows.step(&mut batch).expect("all are running");
        return;
    }
    panic!("every draw has succeeded");
}
