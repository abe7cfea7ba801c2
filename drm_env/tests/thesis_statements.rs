//! What the thesis states about its simulations, flown here. The published figures, their
//! tolerances and the manoeuvres are in tests/golden/thesis_statements.json.

use drm_env::arm::{Payload, PayloadInertia};
use drm_env::config::scenario::Scenario;
use drm_env::control::{Law, LinearLaw, LyapunovLaw};
use drm_env::hardware::slew_motor::MotorConstants;
use drm_env::math::rng::Seed;
use drm_env::plant::TipTorque;
use drm_env::reference::deployment::{Deployment, DeploymentMode};
use drm_env::reference::slew::{Slew, SlewProfile};
use drm_env::rollout::{SIGNAL_NAMES, Trajectory, simulate};
use serde_json::Value;

fn golden(key: &str) -> Value {
    let text = include_str!("../../tests/golden/thesis_statements.json");
    let all: Value = serde_json::from_str(text).expect("the golden file is JSON");
    all[key].clone()
}

fn number(key: &str, field: &str) -> f64 {
    let pointer = format!("/{}", field.replace('.', "/"));
    golden(key)
        .pointer(&pointer)
        .and_then(Value::as_f64)
        .unwrap_or_else(|| panic!("{key} has no number {field}"))
}

/// Payload 1 with the slender inertia of the thesis' numbers, 1 m to 8 m, minimum time.
fn thesis_manoeuvre() -> Scenario {
    Scenario {
        payload: Payload {
            inertia: PayloadInertia::Slender,
            ..Payload::default()
        },
        ..Scenario::default()
    }
}

fn fly(scenario: &Scenario, law: &Law) -> Trajectory {
    simulate(scenario, law, 1, Seed::default()).expect("the manoeuvre can be flown")
}

fn signal<'a>(trajectory: &'a Trajectory, name: &str) -> &'a [f64] {
    let index = SIGNAL_NAMES.iter().position(|n| *n == name);
    &trajectory.signals[index.expect("a signal of this name exists")]
}

fn largest_angle_deg(mass_error: f64, law: &Law, tip_torque: TipTorque) -> f64 {
    let mut scenario = thesis_manoeuvre();
    scenario.mass_error = mass_error;
    scenario.dynamics.tip_torque = tip_torque;
    fly(&scenario, law).metrics.peak_slew_angle.to_degrees()
}

fn linear() -> Law {
    Law::named("linear").expect("the law exists")
}

fn lyapunov() -> Law {
    Law::named("lyapunov").expect("the law exists")
}

fn assert_near(value: f64, expected: f64, tolerance: f64) {
    assert!(
        (value - expected).abs() <= tolerance,
        "{value} is not within {tolerance} of {expected}"
    );
}

#[test]
fn thesis_final_times() {
    for (profile, key) in [
        (SlewProfile::MinTime, "final_time_min_time_s"),
        (SlewProfile::MinEnergy, "final_time_min_energy_s"),
    ] {
        let slew = Slew {
            profile,
            ..Slew::default()
        };
        let (published, tolerance) = (number(key, "published"), number(key, "tolerance"));
        assert_near(slew.final_time(), published, tolerance);
    }
}

#[test]
fn thesis_largest_angle_open_loop_plus_15_percent() {
    let key = "largest_angle_open_loop_plus15_deg";
    let angle = largest_angle_deg(0.15, &Law::default(), TipTorque::SlewAndTip);
    assert_near(angle, number(key, "published"), number(key, "tolerance"));
}

#[test]
fn thesis_largest_angle_open_loop_minus_15_percent() {
    let angle = largest_angle_deg(-0.15, &Law::default(), TipTorque::SlewAndTip);
    let limit = number("largest_angle_open_loop_minus15_deg", "published_below");
    assert!(angle < limit, "{angle}");
}

#[test]
fn thesis_largest_angle_lyapunov_plus_15_percent() {
    let key = "largest_angle_lyapunov_plus15_deg";
    let tolerance = number(key, "derived.tolerance");
    for (tip_torque, field) in [
        (TipTorque::SlewAndTip, "derived.slew_and_tip"),
        (TipTorque::TipOnly, "derived.tip_only"),
    ] {
        let angle = largest_angle_deg(0.15, &lyapunov(), tip_torque);
        assert_near(angle, number(key, field), tolerance);
        assert_near(angle, number(key, "published"), number(key, "tolerance"));
    }
}

#[test]
fn thesis_linear_plus_15_percent_does_not_overshoot() {
    let angle = largest_angle_deg(0.15, &linear(), TipTorque::SlewAndTip);
    let limit = number("largest_angle_linear_plus15_deg", "published_below");
    assert!(angle < limit, "{angle}");
}

/// Residual of 2 beta after a smoothed slew from 4 m to 8 m at 0.04 rad/s^2, mm.
fn smoothed_residual_mm(smoothing: f64) -> f64 {
    let mut scenario = thesis_manoeuvre();
    scenario.slew.max_accel = 0.04;
    scenario.slew.smoothing = smoothing;
    scenario.deployment.start = 4.0;
    let trajectory = fly(&scenario, &Law::default());
    let end = scenario.slew.final_time();
    signal(&trajectory, "time")
        .iter()
        .zip(signal(&trajectory, "link2_tip_deflection"))
        .filter(|(time, _)| **time >= end)
        .fold(0.0, |peak: f64, (_, deflection)| peak.max(deflection.abs()))
        * 1e3
}

#[test]
fn thesis_smoothing_residuals() {
    let key = "residual_phi_0_05_mm";
    let ratio = smoothed_residual_mm(0.05) / number(key, "published");
    let factor = number(key, "within_factor");
    assert!(ratio < factor && ratio > 1.0 / factor, "{ratio}");
    let key = "residual_phi_0_01_mm";
    let residual = smoothed_residual_mm(0.01);
    let range = number(key, "published_from")..number(key, "published_to");
    assert!(range.contains(&residual), "{residual}");
}

#[test]
fn thesis_energy_of_a_released_arm_is_conserved() {
    let mut scenario = thesis_manoeuvre();
    scenario.slew.angle = 0.0;
    scenario.deployment = Deployment {
        start: 8.0,
        mode: DeploymentMode::None,
        ..Deployment::default()
    };
    scenario.initial.beta = 0.01;
    let released = |horizon: f64| {
        let scenario = Scenario {
            horizon,
            ..scenario
        };
        fly(&scenario, &Law::default()).metrics.residual_energy
    };
    let (start, end) = (released(scenario.sample_period), released(20.0));
    // 12 EI2 beta^2 / (2 a^3): the bending energy of the released link
    assert_near(start, 12.0 * 3.0e6 * 1e-4 / (2.0 * 512.0), 1e-3);
    let tolerance = number("energy_drift_20_s", "tolerance");
    assert_near(end / start, 1.0, tolerance);
}

/// Time from which |2 beta| stays below 0.1 mm, s.
fn settled(law: &Law) -> f64 {
    let scenario = Scenario {
        horizon: 40.0,
        ..thesis_manoeuvre()
    };
    let trajectory = fly(&scenario, law);
    let deflection = signal(&trajectory, "link2_tip_deflection");
    let last = deflection.iter().rposition(|d| d.abs() > 1e-4);
    signal(&trajectory, "time")[last.expect("the arm vibrates") + 1]
}

#[test]
fn thesis_order_of_the_settling_times() {
    let laws = [
        (
            "linear_root",
            Law::Linear(LinearLaw {
                tip: None,
                ..LinearLaw::default()
            }),
        ),
        (
            "lyapunov_root",
            Law::Lyapunov(LyapunovLaw {
                tip: None,
                ..LyapunovLaw::default()
            }),
        ),
        (
            "linear_tip",
            Law::Linear(LinearLaw {
                root: None,
                ..LinearLaw::default()
            }),
        ),
        (
            "lyapunov_tip",
            Law::Lyapunov(LyapunovLaw {
                root: None,
                ..LyapunovLaw::default()
            }),
        ),
        ("linear_both", linear()),
        ("lyapunov_both", lyapunov()),
    ];
    let times = laws.map(|(name, law)| (name, settled(&law)));
    let key = "settled_0_1_mm_s";
    for (name, time) in times {
        let expected = number(key, &format!("derived.{name}"));
        assert_near(time, expected, number(key, "derived.tolerance"));
    }
    let [
        (_, linear_root),
        (_, lyapunov_root),
        (_, linear_tip),
        (_, lyapunov_tip),
        both @ ..,
    ] = times;
    assert!(lyapunov_root > linear_root);
    assert!(lyapunov_tip < linear_tip);
    assert!(both[1].1 < both[0].1);
}

#[test]
fn thesis_slew_energies() {
    for (profile, key) in [
        (SlewProfile::MinTime, "slew_energy_min_time_J"),
        (SlewProfile::MinEnergy, "slew_energy_min_energy_J"),
    ] {
        for (constants, field) in [
            (MotorConstants::Fitted, "published"),
            (MotorConstants::Printed, "printed_constants"),
        ] {
            let mut scenario = thesis_manoeuvre();
            scenario.slew.profile = profile;
            scenario.slew_motor.constants = constants;
            let energy = fly(&scenario, &Law::default()).metrics.slew_energy;
            assert_near(energy, number(key, field), number(key, "tolerance"));
        }
    }
}
