//! The linear model of a manoeuvre: of an arm at rest it is the exponential of its equations.

use drm_env::analysis::model::{Model, ModelSpec};
use drm_env::analysis::transitions::Transitions;
use drm_env::config::scenario::Scenario;
use drm_env::reference::Extension;
use drm_env::reference::deployment::{Deployment, DeploymentMode};
use drm_env::reference::slew::Slew;
use nalgebra::DMatrix;

const EXTENSION: f64 = 5.0;

/// The arm at a fixed length, its reference at rest.
fn resting() -> Scenario {
    Scenario {
        slew: Slew {
            angle: 0.0,
            ..Slew::default()
        },
        deployment: Deployment {
            start: EXTENSION,
            mode: DeploymentMode::None,
            ..Deployment::default()
        },
        integrator_step: 1e-4,
        horizon: 0.08,
        ..Scenario::default()
    }
}

fn assert_close(found: &[f64], expected: &DMatrix<f64>, tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    let columns = expected.ncols();
    for (i, value) in found.iter().enumerate() {
        let (row, column) = (i / columns, i % columns);
        let expected = expected[(row, column)];
        assert!(
            (value - expected).abs() <= tolerance,
            "({row}, {column}): {value} instead of {expected}"
        );
    }
}

#[test]
fn an_arm_at_rest_has_the_exponential_of_its_equations() {
    let scenario = resting();
    let hold = 10;
    let found = Transitions::of(&scenario, hold).expect("the arm can be flown");
    let model = Model::new(ModelSpec::default()).expect("the default arm has a model");
    let still = Extension {
        length: EXTENSION,
        rate: 0.0,
        accel: 0.0,
    };
    let linear = model
        .linearize(&still, 0.0)
        .expect("the arm reaches so far");
    let (n, h) = (6, hold as f64 * scenario.sample_period);
    // [A B; 0 0] h holds the torques of the wheels
    let mut whole = DMatrix::zeros(n + 2, n + 2);
    whole.view_mut((0, 0), (n, n)).copy_from(&linear.a);
    whole
        .view_mut((0, n), (n, 2))
        .copy_from(&linear.b.columns(1, 2));
    let whole = (whole * h).exp();
    let a = whole.view((0, 0), (n, n)).into_owned();
    let b = whole.view((0, n), (n, 2)).into_owned();
    assert_eq!((found.size, found.intervals), (n, 4));
    for k in 0..found.intervals {
        let part = |values: &[f64], length: usize| values[k * length..][..length].to_vec();
        assert_close(&part(&found.transition, n * n), &a, 1e-6 * a.amax());
        assert_close(&part(&found.input, n * 2), &b, 1e-6 * b.amax());
        // the error of the tip after the last sample is that of the state
        let reach = scenario.arm.link1.length + EXTENSION;
        let row = DMatrix::from_row_slice(1, n, &[reach, 2.0, 2.0, 0.0, 0.0, 0.0]);
        let last = &part(&found.error_state, hold * n)[(hold - 1) * n..];
        assert_close(last, &(&row * &a), 1e-6 * (&row * &a).amax());
        let last = &part(&found.error_input, hold * 2)[(hold - 1) * 2..];
        assert_close(last, &(&row * &b), 1e-6 * (&row * &b).amax());
    }
    let constant = [&found.start, &found.offset, &found.error_offset];
    assert!(constant.into_iter().flatten().all(|value| *value == 0.0));
}

#[test]
fn wheels_and_sensors_are_ideal() {
    let plain = Transitions::of(&resting(), 10).expect("the arm can be flown");
    let mut real = resting();
    (real.root_wheel.lag, real.root_wheel.dead_time) = (0.05, 0.01);
    real.root_wheel.momentum_limit = Some(1e-9);
    (real.tip_wheel.lag, real.tip_wheel.dead_time) = (0.02, 0.03);
    real.tip_wheel.momentum_limit = Some(1e-9);
    (real.sensors.angle_noise, real.sensors.delay) = (1e-3, 0.01);
    let found = Transitions::of(&real, 10).expect("the arm can be flown");
    assert_eq!(found, plain);
}

#[test]
fn holds_that_do_not_fit_are_refused() {
    let refused = |scenario: &Scenario, hold| {
        let error = Transitions::of(scenario, hold).expect_err("it does not fit");
        error.to_string()
    };
    for hold in [0, 7, 41] {
        let expected = format!("hold must divide the 40 samples of the manoeuvre, got {hold}");
        assert_eq!(refused(&resting(), hold), expected);
    }
    let endless = Scenario {
        horizon: 1e6,
        ..resting()
    };
    let message = refused(&endless, 1);
    assert!(message.contains("at most 4 GiB"), "{message}");
    assert!(
        message.ends_with("got 1, which takes 234.7 GiB"),
        "{message}"
    );
}
