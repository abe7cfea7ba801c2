//! A configuration is checked once and held from then on.

use std::sync::Arc;

use drm_env::batch::{Autoreset, Batch};
use drm_env::config::{EnvConfig, ValidConfig};
use drm_env::{ConfigError, Env};

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
