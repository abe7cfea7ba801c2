//! The servo's model of the arm against the arm: frequencies, participation of the modes, and what an angular
//! acceleration bends.

// the measured figures, with --nocapture
#![allow(clippy::print_stdout)]

// what other tests of the plant share has more than these need
#[allow(dead_code)]
mod consistent_common;

use consistent_common::{fixed, moving, payload};
use drm_env::arm::Arm;
use drm_env::config::scenario::Scenario;
use drm_env::control::ServoLaw;
use drm_env::math::generalized_alpha::GeneralizedAlpha;
use drm_env::plant::consistent::{ConsistentPlant, ConsistentState, LowModes};
use drm_env::plant::{Dynamics, PlantModel, Torques};
use drm_env::simulation::servo_model;

fn plant(row: usize, damping_ratio: f64) -> ConsistentPlant {
    let dynamics = Dynamics {
        damping_ratio,
        ..Dynamics::default()
    };
    ConsistentPlant::new(
        &Arm::default(),
        &payload(row),
        &dynamics,
        (4, 4),
        (1.0, 8.0),
    )
    .expect("the plant exists")
}

/// With shapes V of unit modal mass, M^-1 = V V^T: the turns of the shoulder's tangent in all modes, the rigid
/// rotation among them, make the tangent's entry of M^-1; so do those of the tip with the tip's row.
#[test]
fn turns_of_all_modes_make_the_inverse_of_the_mass_matrix() {
    for (row, length) in [(0, 1.0), (2, 4.3), (4, 8.0)] {
        let plant = plant(row, 0.0);
        let LowModes { modes, .. } = plant
            .low_modes::<8>(length)
            .expect("the arm has the length");
        let mass = plant
            .matrices(&fixed(length), 0.0)
            .expect("the arm has the length")
            .mass;
        let unit = |tip: f64| {
            let torques = Torques {
                slew: 1.0 - tip,
                root: 0.0,
                tip,
            };
            plant.force(&torques, length)
        };
        let inverse = mass.clone().try_inverse().expect("M is regular");
        for (place, tip) in [(1, 0.0), (2, 1.0)] {
            let expected = unit(tip).dot(&(&inverse * unit(tip)));
            let sum: f64 = modes.iter().map(|mode| mode[place] * mode[place]).sum();
            let found = sum + 1.0 / mass[(0, 0)];
            println!("payload {row}, {length} m: {found:.6e} of {expected:.6e}");
            assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
        }
        for (mode, frequency) in modes.iter().zip(
            plant
                .natural_frequencies(length)
                .expect("the arm has the length"),
        ) {
            assert!((mode[0] / frequency - 1.0).abs() < 1e-6);
        }
    }
}

/// A torque that has long been on turns the arm as a whole by half of its acceleration times the time squared;
/// tangent and tip are off that by what the model says.
#[test]
fn steady_acceleration_bends_the_arm_as_the_model_says() {
    for (row, length) in [(2, 8.0), (4, 3.0)] {
        let plant = plant(row, 0.3);
        let LowModes { tilt, tip, .. } = plant
            .low_modes::<3>(length)
            .expect("the arm has the length");
        let still = fixed(length);
        let inertia = plant.matrices(&still, 0.0).expect("in range").mass[(0, 0)];
        let accel = 1e-4;
        let torques = Torques {
            slew: accel * inertia,
            root: 0.0,
            tip: 0.0,
        };
        let mut state = ConsistentState::new([0.0; 17], [0.0; 17]);
        let (step, steps) = (1e-3, 4000);
        let scheme = GeneralizedAlpha::default();
        for _ in 0..steps {
            plant.step(
                &scheme,
                &mut state,
                &[torques; 3],
                &moving(length, 0.0, 0.0),
                0.0,
                step,
            );
        }
        let time = step * f64::from(steps);
        let whole = accel * time * time / 2.0;
        let found = (state.q[0] - whole) / accel;
        let reach = Arm::default().link1.length + length;
        let off = (plant.tip_deflection(&state, &still).0 + reach * (state.q[0] - whole)) / accel;
        println!("payload {row}, {length} m: {found:.5} of {tilt:.5}, {off:.5} of {tip:.5}");
        assert!((found / tilt - 1.0).abs() < 0.01, "{found} {tilt}");
        assert!((off - tip).abs() < 0.01 * reach * tilt.abs(), "{off} {tip}");
    }
}

/// Between its nodes the model is within 1 % of the arm, whatever the length and the true mass.
#[test]
fn model_follows_the_arm_between_its_nodes() {
    for mass in [50.0, 200.0, 500.0] {
        let mut scenario = Scenario::default();
        scenario.payload.mass = mass;
        scenario.plant = PlantModel::Consistent;
        let reported = scenario.reported().expect("the payload can be reported");
        let model = servo_model(&scenario, &reported, &ServoLaw::default()).expect("it exists");
        for error in [-0.2, 0.0, 0.13] {
            let mut truth = reported;
            truth.mass *= 1.0 + error;
            truth.inertia_centre *= 1.0 + error;
            truth.inertia_attachment *= 1.0 + error;
            let plant = ConsistentPlant::new(
                &Arm::default(),
                &truth,
                &Dynamics::default(),
                (4, 4),
                (1.0, 8.0),
            )
            .expect("the plant exists");
            for length in [1.0, 1.4, 2.9, 5.2, 7.7, 8.0] {
                let found = model.node(length, error);
                let LowModes { modes, tilt, .. } = plant
                    .low_modes::<3>(length)
                    .expect("the arm has the length");
                for (mode, [frequency, root, tip]) in found.modes.iter().zip(modes) {
                    let off = [mode.frequency / frequency, mode.root / root, mode.tip / tip]
                        .map(|ratio| (ratio - 1.0).abs());
                    assert!(
                        off.iter().all(|x| *x < 0.015),
                        "{mass} {error} {length}: {off:?}"
                    );
                }
                assert!(
                    (found.tilt / tilt - 1.0).abs() < 0.05,
                    "{length} {}",
                    found.tilt
                );
            }
        }
    }
}
