//! The drive shaft between slew motor and shoulder, against what holds for any of them: angular momentum, energy,
//! the closed form of two inertias on a spring, and the arm without a shaft as its limit.

mod consistent_common;

use consistent_common::{NO_TORQUE, fixed, moving, plant, vibration_modes};
use drm_env::hardware::slew_motor::{DriveShaft, SlewMotor};
use drm_env::math::generalized_alpha::GeneralizedAlpha;
use drm_env::plant::consistent::{CAPACITY, ConsistentPlant, ConsistentState};
use drm_env::plant::{Dynamics, Torques};
use drm_env::reference::timeline::Piece;

const SHAFT: DriveShaft = DriveShaft {
    rotor_inertia: 900.0,
    stiffness: 2e5,
    damping: 0.0,
};

fn behind(shaft: DriveShaft, modes: usize, range: (f64, f64)) -> ConsistentPlant {
    plant(2, &Dynamics::default(), modes, range)
        .with_shaft(Some(shaft))
        .expect("so many modes fit")
}

fn rest(plant: &ConsistentPlant) -> ConsistentState {
    plant.released((0.0, 0.0), (0.0, 0.0), (0.0, 0.0))
}

/// Angle and rate of the rotor.
fn rotor(plant: &ConsistentPlant, state: &ConsistentState) -> (f64, f64) {
    (state.q[plant.size()], state.v[plant.size()])
}

/// Flies under constant torques by a scheme that damps nothing; looks at the state after every step.
fn fly(
    plant: &ConsistentPlant,
    state: &mut ConsistentState,
    torques: Torques<f64>,
    piece: &Piece<f64>,
    (steps, step): (usize, f64),
    mut look: impl FnMut(f64, &ConsistentState),
) {
    let scheme = GeneralizedAlpha::new(1.0).expect("the radius is within 0 to 1");
    for i in 0..steps {
        plant.step(&scheme, state, &[torques; 3], piece, i as f64 * step, step);
        look((i + 1) as f64 * step, state);
    }
}

/// Rotor and arm together take what motor and wheels give, also while the arm extends.
#[test]
fn angular_momentum_of_rotor_and_arm_changes_by_the_torques_alone() {
    let torques = Torques {
        slew: 150.0,
        root: -40.0,
        tip: 6.0,
    };
    let (start, rate) = (2.0, 0.5);
    let defect = |step: f64| {
        let plant = behind(SHAFT, 4, (1.0, 8.0));
        let (mut state, piece) = (rest(&plant), moving(start, rate, 0.0));
        let steps = (2.0 / step).round() as usize;
        fly(
            &plant,
            &mut state,
            torques,
            &piece,
            (steps, step),
            |_, _| {},
        );
        let end = piece.extension(2.0);
        let (_, rotor_rate) = rotor(&plant, &state);
        let whole = SHAFT.rotor_inertia * rotor_rate + plant.angular_momentum(&state, &end);
        let before = plant.angular_momentum(&rest(&plant), &piece.extension(0.0));
        whole - before - (torques.slew + torques.root + torques.tip) * 2.0
    };
    let [coarse, fine] = [1e-3, 5e-4].map(defect);
    assert!(fine.abs() < 1e-3 * 116.0 * 2.0, "{fine}");
    assert!(fine.abs() < coarse.abs() / 3.0, "{coarse} {fine}");
}

/// On a soft spring the arm is rigid: z'' = -w^2 z - T / Ja of the twist z, w^2 = k (1 / J + 1 / Ja), under a torque
/// T of the root wheel from rest on.
#[test]
fn a_soft_shaft_lets_rotor_and_arm_swing_as_two_inertias_on_a_spring() {
    let shaft = DriveShaft {
        rotor_inertia: 9000.0,
        stiffness: 100.0,
        ..SHAFT
    };
    let length = 1.0;
    let plant = behind(shaft, 2, (length, length));
    let turning = plant.released((0.0, 1.0), (0.0, 0.0), (0.0, 0.0));
    let inertia = plant.angular_momentum(&turning, &fixed(length));
    let frequency = (shaft.stiffness * (1.0 / shaft.rotor_inertia + 1.0 / inertia)).sqrt();
    let torques = Torques {
        root: 50.0,
        ..NO_TORQUE
    };
    let size = torques.root / inertia / (frequency * frequency);
    let mut worst = 0.0_f64;
    let mut state = rest(&plant);
    let (steps, step) = (20_000, 2e-3);
    let piece = moving(length, 0.0, 0.0);
    fly(
        &plant,
        &mut state,
        torques,
        &piece,
        (steps, step),
        |time, state| {
            let expected = -size * (1.0 - (frequency * time).cos());
            let (angle, _) = rotor(&plant, state);
            worst = worst.max((angle - state.q[0] - expected).abs());
        },
    );
    // most of a period
    assert!(frequency * step * steps as f64 > 4.0, "{frequency}");
    assert!(worst < 5e-3 * size, "{worst} of {size}");
}

#[test]
fn energy_is_conserved_without_damping_and_lost_to_the_shaft_with_it() {
    let lost = |damping: f64, step: f64| {
        let shaft = DriveShaft { damping, ..SHAFT };
        let plant = behind(shaft, 2, (4.0, 4.0));
        let mut state = rest(&plant);
        let (length, piece) = (fixed(4.0), moving(4.0, 0.0, 0.0));
        // the rotor is hit
        let mut v = state.v;
        v[plant.size()] = 1e-4;
        state = ConsistentState::new(state.q, v);
        let before = plant.energy(&state, &length).total();
        let (mut work, mut last) = (0.0, 1e-4);
        let steps = (0.5 / step).round() as usize;
        fly(
            &plant,
            &mut state,
            NO_TORQUE,
            &piece,
            (steps, step),
            |_, state| {
                let rate = rotor(&plant, state).1 - state.v[0];
                work += 0.5 * damping * (rate * rate + last * last) * step;
                last = rate;
            },
        );
        let after = plant.energy(&state, &length).total();
        ((before - after) / before, work / before)
    };
    let (drift, _) = lost(0.0, 1e-4);
    assert!(drift.abs() < 1e-7, "{drift}");
    let [coarse, fine] = [1e-4, 5e-5].map(|step| {
        let (gone, work) = lost(500.0, step);
        assert!(gone > 0.1, "{gone}");
        gone - work
    });
    assert!(fine.abs() < 1e-3, "{fine}");
    assert!(fine.abs() < coarse.abs() / 3.0, "{coarse} {fine}");
}

/// Both ends of the shaft, under torques that switch on at once.
#[test]
fn the_slew_converges_with_the_second_order_of_the_step() {
    let torques = Torques {
        slew: 300.0,
        root: 20.0,
        tip: 0.0,
    };
    let end = |step: f64| {
        let plant = behind(SHAFT, 1, (1.0, 8.0));
        let (mut state, piece) = (rest(&plant), moving(2.0, 0.3, 0.0));
        let steps = (0.2 / step).round() as usize;
        fly(
            &plant,
            &mut state,
            torques,
            &piece,
            (steps, step),
            |_, _| {},
        );
        (state.q[0], rotor(&plant, &state).0)
    };
    let (exact, found) = (end(2.5e-6), [4e-5, 2e-5].map(end));
    let order = |of: fn((f64, f64)) -> f64| {
        ((of(found[0]) - of(exact)) / (of(found[1]) - of(exact)))
            .abs()
            .log2()
    };
    for order in [order(|end| end.0), order(|end| end.1)] {
        assert!((order - 2.0).abs() < 0.25, "{order}");
    }
}

/// A stiff shaft with next to no rotor is none: the tip is where it is without, as far as the step resolves it.
#[test]
fn a_stiff_shaft_of_a_light_rotor_is_none() {
    let torques = Torques {
        slew: 300.0,
        root: 20.0,
        tip: -3.0,
    };
    let scheme = GeneralizedAlpha::default();
    let free = plant(2, &Dynamics::default(), 4, (1.0, 8.0));
    let stiff = free
        .clone()
        .with_shaft(Some(DriveShaft {
            rotor_inertia: 1e-3,
            stiffness: 1e10,
            damping: 0.0,
        }))
        .expect("so many modes fit");
    let apart = |step: f64| {
        let [free, stiff] = [&free, &stiff].map(|plant| {
            let (mut state, piece) = (rest(plant), moving(2.0, 0.3, 0.0));
            for i in 0..(1.0 / step).round() as usize {
                let from = i as f64 * step;
                plant.step(&scheme, &mut state, &[torques; 3], &piece, from, step);
            }
            let end = piece.extension(1.0);
            (7.0 + end.length) * state.q[0] + plant.tip_deflection(&state, &end).0
        });
        ((stiff - free) / free).abs()
    };
    let (coarse, fine) = (apart(5e-4), apart(2.5e-4));
    assert!(coarse < 1e-5 && fine < 1e-5, "{coarse} {fine}");
}

#[test]
fn the_rotor_takes_the_place_of_a_mode() {
    let most = (CAPACITY - 1) / 2;
    let full = plant(2, &Dynamics::default(), most, (1.0, 8.0));
    let error = full
        .with_shaft(Some(SHAFT))
        .expect_err("it is one too many");
    assert!(error.to_string().contains("modes"), "{error}");
    assert_eq!(
        behind(SHAFT, most - 1, (1.0, 8.0)).coordinates(),
        CAPACITY - 1
    );
}

/// Table 4-1: 1845 squared times 2.67e-4 kg m^2 are 908.9 kg m^2 at the shoulder.
#[test]
fn the_rotor_has_its_inertia_times_the_square_of_the_gear_ratio() {
    let motor = SlewMotor {
        constants: drm_env::hardware::slew_motor::MotorConstants::Printed,
        shaft_stiffness: Some(2e5),
        ..SlewMotor::default()
    };
    let shaft = motor.shaft().expect("it has one");
    assert!((shaft.rotor_inertia - 908.9).abs() < 0.1, "{shaft:?}");
    assert_eq!(SlewMotor::default().shaft(), None);
}

/// A shaft that holds nothing leaves the free arm its modes: after whole periods each is where it was.
#[test]
fn a_shaft_that_holds_nothing_leaves_the_free_arm_its_modes() {
    let shaft = DriveShaft {
        rotor_inertia: 1e6,
        stiffness: 1.0,
        damping: 0.0,
    };
    let plant = behind(shaft, 2, (4.0, 4.0));
    let (shapes, frequencies) = vibration_modes(&plant, 4.0);
    let piece = moving(4.0, 0.0, 0.0);
    for (shape, frequency) in shapes.iter().zip(&frequencies).take(2) {
        let (steps, mut state) = (4000, *shape);
        let step = std::f64::consts::TAU / frequency / 2000.0;
        fly(
            &plant,
            &mut state,
            NO_TORQUE,
            &piece,
            (steps, step),
            |_, _| {},
        );
        let size = shape.q.iter().map(|x| x * x).sum::<f64>().sqrt();
        let moved = shape
            .q
            .iter()
            .zip(state.q)
            .map(|(before, after)| (before - after).powi(2));
        let moved = moved.take(plant.size()).sum::<f64>().sqrt();
        assert!(moved < 1e-3 * size, "{frequency}: {moved} of {size}");
    }
}
