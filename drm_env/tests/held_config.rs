//! A configuration is checked once and held from then on.

use std::sync::Arc;

use drm_env::batch::{Autoreset, Batch};
use drm_env::config::scenario::ValidScenario;
use drm_env::config::{EnvConfig, ValidConfig};
use drm_env::math::rng::Seed;
use drm_env::{ConfigError, Env, Scenario};

fn impossible() -> EnvConfig {
    let mut config = EnvConfig::preset("slew").expect("it is a preset");
    config.scenario.horizon = -1.0;
    config
}

#[test]
fn what_cannot_be_flown_is_never_held() {
    let refused: [ConfigError; 4] = [
        ValidConfig::new(impossible()).expect_err("it is negative"),
        ValidConfig::resolve("slew", Some(r#"{"scenario": {"horizon": -1.0}}"#), None)
            .expect_err("it is negative"),
        Env::new(Arc::new(impossible())).expect_err("it is negative"),
        Batch::new(Arc::new(impossible()), 3, Autoreset::NextStep, None)
            .expect_err("it is negative"),
    ];
    for error in refused {
        assert!(error.to_string().contains("horizon"), "{error}");
    }
}

#[test]
fn clones_and_environments_share_what_is_held() {
    let held = ValidConfig::resolve("slew_residual", None, None).expect("it can be flown");
    let env = Env::new(held.clone()).expect("it can be made");
    let batch = Batch::new(held.clone(), 3, Autoreset::NextStep, None).expect("they can be made");
    assert!(std::ptr::eq::<EnvConfig>(&*held, &*held.clone()));
    assert!(std::ptr::eq(env.config(), &*held));
    assert!(std::ptr::eq(batch.config(), &*held));
}

#[test]
fn a_manoeuvre_that_cannot_be_flown_is_never_held() {
    let impossible = impossible().scenario;
    let error = ValidScenario::new(impossible).expect_err("it is negative");
    assert!(error.to_string().starts_with("horizon"), "{error}");
    let error = ValidScenario::all(&[Scenario::default(), impossible]).expect_err("one is");
    assert!(
        error.to_string().starts_with("scenarios[1].horizon"),
        "{error}"
    );
}

#[test]
fn a_configuration_that_draws_nothing_is_one_manoeuvre() {
    let fixed = ValidConfig::resolve("slew_thesis", None, None).expect("it can be flown");
    let drawn = fixed
        .draw(Seed::from_u64(3), 5, &[])
        .expect("it can be drawn");
    assert_eq!(fixed.manoeuvre(), Some(drawn));
    assert_eq!(*drawn, fixed.scenario);
    let several = ValidConfig::resolve("slew", None, None).expect("it can be flown");
    assert!(several.drawn().contains(&"payload_mass"));
    assert_eq!(several.manoeuvre(), None);
}
