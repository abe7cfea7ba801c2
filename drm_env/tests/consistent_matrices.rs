//! Matrices of the consistent plant: frequencies against the finite elements of its own
//! assumptions, the thesis plant where both make the same ones, and what is refused.

// the measured figures, with --nocapture
#![allow(clippy::print_stdout)]

mod consistent_common;

use consistent_common::{NO_TORQUE, fixed, moving, payload, plant, vibration_modes};
use drm_env::arm::mode_shape::{ShapeBasis, ShapeFamily};
use drm_env::arm::{Arm, Payload, PayloadProperties, TABLE_2_7};
use drm_env::math::generalized_alpha::GeneralizedAlpha;
use drm_env::math::quadrature::{gauss_legendre, integrate};
use drm_env::plant::Dynamics;
use drm_env::plant::consistent::{ConsistentPlant, ConsistentState, Kinematics};
use drm_env::plant::thesis::Constants;
use drm_env::reference::Extension;
use nalgebra::{DMatrix, DVector};

/// Hz, f1 f2 f3 a length: converged finite elements of the same pinned beam (cubic Hermite elements,
/// consistent mass, rigid payload; rows of payload 0, 1 and 3 of the thesis, lengths 2, 4, 6, 8 m).
const FINITE_ELEMENTS: [(usize, [[f64; 3]; 4]); 4] = [
    (
        0,
        [
            [17.12, 50.44, 100.0],
            [10.64, 31.43, 68.63],
            [7.059, 23.02, 47.99],
            [5.216, 17.54, 35.61],
        ],
    ),
    (
        1,
        [
            [11.46, 38.71, 85.53],
            [7.380, 25.69, 59.11],
            [5.199, 18.97, 41.51],
            [4.024, 14.46, 31.29],
        ],
    ),
    (
        2,
        [
            [8.851, 32.08, 67.65],
            [5.939, 22.29, 47.81],
            [4.318, 16.60, 35.77],
            [3.411, 12.77, 28.02],
        ],
    ),
    (
        4,
        [
            [6.964, 22.38, 50.98],
            [4.946, 16.38, 35.20],
            [3.729, 12.74, 27.37],
            [3.003, 10.31, 22.13],
        ],
    ),
];

/// Largest and smallest of f / f_FE - 1 of the first three modes over lengths and the payloads from
/// row `first` on.
fn frequency_errors(modes: usize, first: usize) -> [(f64, f64); 3] {
    let mut errors = [(f64::NEG_INFINITY, f64::INFINITY); 3];
    for (row, table) in FINITE_ELEMENTS.into_iter().skip(first) {
        let plant = plant(row, &Dynamics::default(), modes, (2.0, 8.0));
        for (length, expected) in [2.0, 4.0, 6.0, 8.0].into_iter().zip(table) {
            let found = plant
                .natural_frequencies(length)
                .expect("the length is the arm's");
            for i in 0..3 {
                let error = found[i] / std::f64::consts::TAU / expected[i] - 1.0;
                errors[i] = (errors[i].0.max(error), errors[i].1.min(error));
            }
        }
    }
    errors
}

/// Assumed modes bound the frequencies from above and approach them as their number grows.
#[test]
fn frequencies_approach_the_finite_elements_from_above() {
    let found = [2, 3, 4, 6, 8].map(|modes| (modes, frequency_errors(modes, 0)));
    for (modes, errors) in found {
        println!("n = m = {modes}: {errors:.4?}");
        // half a unit of the tables' last digit
        assert!(
            errors.iter().all(|(_, least)| *least > -5e-4),
            "{modes}: {errors:?}"
        );
    }
    for pair in found.windows(2) {
        for i in 0..3 {
            assert!(pair[1].1[i].0 < pair[0].1[i].0, "mode {i}: {pair:?}");
        }
    }
}

/// Derived bounds of the error with a payload (0, 1 or 3 of the thesis), n = m = 3 and 4.
#[test]
fn frequencies_of_three_and_four_modes_are_within_their_bounds() {
    for (modes, bounds) in [(3, [0.020, 0.043, 0.17]), (4, [0.014, 0.015, 0.037])] {
        let errors = frequency_errors(modes, 1);
        println!("n = m = {modes}: {errors:.4?}");
        for (bound, (largest, _)) in bounds.into_iter().zip(errors) {
            // the bounds are given to two digits, the tables to half a unit of their last
            assert!(largest < bound + 5e-4 + 5e-4, "{modes}: {errors:?}");
        }
    }
}

/// A free vibration in one mode swings at the frequency of K x = w^2 M x.
#[test]
fn free_vibration_swings_at_the_natural_frequencies() {
    let length = 5.0;
    let plant = plant(2, &Dynamics::default(), 4, (length, length));
    let (released, expected) = vibration_modes(&plant, length);
    let frequencies = plant
        .natural_frequencies(length)
        .expect("the length is the arm's");
    for (one, other) in frequencies.iter().zip(&expected) {
        assert!(
            (one / other - 1.0).abs() < 1e-8,
            "{frequencies:?} {expected:?}"
        );
    }
    for (mode, frequency) in frequencies.iter().enumerate().take(4) {
        let mut state = released[mode];
        let h = std::f64::consts::TAU / frequency / 400.0;
        let tip = |state: &ConsistentState| plant.tip_deflection(state, &fixed(length)).0;
        // the last of the crossings of zero, by linear interpolation
        let (mut crossings, mut last, mut before) = (0, 0.0, tip(&state));
        let piece = moving(length, 0.0, 0.0);
        for step in 0..8000 {
            plant.step(
                &GeneralizedAlpha::default(),
                &mut state,
                &[NO_TORQUE; 3],
                &piece,
                0.0,
                h,
            );
            let now = tip(&state);
            if now * before < 0.0 {
                crossings += 1;
                last = h * (f64::from(step) + before / (before - now));
            }
            before = now;
        }
        // the first crossing is a quarter of a period after the release
        let measured = std::f64::consts::PI * (f64::from(crossings) - 0.5) / last;
        // period error of the method, (w h)^2 / 12 to / 4
        assert!(
            (measured / frequency - 1.0).abs() < 1e-4,
            "{mode}: {measured} {frequency}"
        );
    }
}

/// Without the turning of link 2 and with one B.8 shape a link, M, C and K are those of the thesis
/// plant with particle following.
#[test]
fn without_turning_the_matrices_are_those_of_the_thesis_plant() {
    let arm = Arm::default();
    let dynamics = Dynamics {
        axial_load: false,
        particle_following: true,
        structural_damping: 0.01,
        ..Dynamics::default()
    };
    let kinematics = Kinematics {
        shapes: ShapeFamily::B8,
        slope_turning: false,
    };
    // the basis has the span of the family; the thesis' shape is 2 at the end
    let scale = 2.0 / ShapeBasis::new(ShapeFamily::B8, 1).at(1.0)[0][0];
    let scale = [1.0, scale, scale];
    for row in 0..TABLE_2_7.len() {
        let thesis = Constants::new(&arm, &payload(row), &dynamics);
        let plant = ConsistentPlant::with_kinematics(
            &arm,
            &payload(row),
            &dynamics,
            (1, 1),
            (1.0, 8.0),
            kinematics,
        )
        .expect("the plant exists");
        for (length, rate, accel) in [(1.0, 0.3, 0.1), (2.7, -0.9, 0.2), (8.0, 0.5, -0.4)] {
            let extension = Extension {
                length,
                rate,
                accel,
            };
            let expected = thesis.matrices(&extension, false, true);
            let found = plant
                .matrices(&extension, 0.0)
                .expect("the length is in range");
            for (name, expected, found) in [
                ("M", expected.mass, found.mass),
                ("C", expected.velocity, found.velocity),
                ("K", expected.stiffness, found.stiffness),
            ] {
                let found = DMatrix::from_fn(3, 3, |i, j| found[(i, j)] * scale[i] * scale[j]);
                for i in 0..3 {
                    for j in 0..3 {
                        // an entry is as exact as the terms that cancel in it
                        let size = expected[i][j].abs().max(1e-3 * found.amax());
                        let difference = (found[(i, j)] - expected[i][j]).abs();
                        assert!(
                            difference < 1e-9 * size,
                            "{name}[{i}][{j}] payload {row} a {length}: {} {}",
                            found[(i, j)],
                            expected[i][j]
                        );
                    }
                }
            }
        }
    }
}

/// Twice the energy of turning (rad/s, squared) and of an axial acceleration at the deflection of one
/// link's shape `i` plus the other's shape `j`, from the places of the particles: one at xi on the
/// straight arm is at (xi + u, w) on the bent one, which keeps its length: u = -1/2 int_0^xi w_x^2.
fn axial_energy(row: usize, a: f64, [i, j]: [usize; 2], turning2: f64, accel: f64) -> f64 {
    let (arm, payload) = (Arm::default(), payload(row));
    let (one, two) = (&arm.link1, &arm.link2);
    let basis = ShapeBasis::new(ShapeFamily::Mono, 3);
    let rule = gauss_legendre(12);
    let (l1, reach) = (one.length, one.length + a);
    let end = basis.at(1.0)[i];
    let bent = |xi: f64| {
        if xi < l1 {
            let shape = basis.at(xi / l1)[i];
            return [shape[0], shape[1] / l1];
        }
        let own = basis.at((xi - l1) / a)[j];
        [
            end[0] + (xi - l1) * end[1] / l1 + own[0],
            end[1] / l1 + own[1] / a,
        ]
    };
    let nearer = |xi: f64| {
        let over = |low: f64, high: f64| integrate(&rule, low, high, |x| bent(x)[1].powi(2));
        -0.5 * (over(0.0, xi.min(l1)) + over(l1, xi.max(l1)))
    };
    // of a mass at x + u and y, what is of second order in the deflections
    let particle =
        |x: f64, u: f64, y: f64, accel: f64| turning2 * (y * y + 2.0 * x * u) - 2.0 * accel * u;
    // the particles of link 1 do not move along it
    let link1 = integrate(&rule, 0.0, l1, |xi| {
        particle(xi, nearer(xi), bent(xi)[0], 0.0)
    });
    let link2 = |low: f64, high: f64| {
        integrate(&rule, low, high, |xi| {
            particle(xi, nearer(xi), bent(xi)[0], accel)
        })
    };
    let [w, slope] = bent(reach);
    let lever = payload.length / 2.0;
    let centre = nearer(reach) - lever * slope * slope / 2.0;
    one.mass_per_length * link1
        + two.mass_per_length * (link2(reach - two.length, l1) + link2(l1, reach))
        + payload.mass * particle(reach + lever, centre, w + lever * slope, accel)
}

/// The terms with theta'^2 and the axial ones with a'' are those of the energies.
#[test]
fn turning_and_axial_load_are_those_of_their_energies() {
    let [loaded, unloaded] = [true, false].map(|axial_load| {
        let dynamics = Dynamics {
            axial_load,
            ..Dynamics::default()
        };
        [2, 4].map(|row| (row, plant(row, &dynamics, 3, (1.0, 8.0))))
    });
    let stiffness = |plant: &ConsistentPlant, length: f64, accel: f64, rate: f64| {
        let extension = Extension {
            accel,
            ..fixed(length)
        };
        plant
            .matrices(&extension, rate)
            .expect("the length is in range")
            .stiffness
    };
    for ((row, loaded), (_, unloaded)) in loaded.iter().zip(&unloaded) {
        for (length, shapes) in [(1.5, [0, 0]), (3.0, [1, 2]), (6.5, [2, 0]), (8.0, [0, 1])] {
            let mut q = DVector::zeros(7);
            (q[1 + shapes[0]], q[4 + shapes[1]]) = (1.0, 1.0);
            let form = |m: DMatrix<f64>| q.dot(&(m * &q));
            let (rate, accel) = (1.7, 0.6);
            let turning =
                form(stiffness(loaded, length, 0.0, 0.0) - stiffness(loaded, length, 0.0, rate));
            let expected = axial_energy(*row, length, shapes, rate * rate, 0.0);
            // the bending stiffness, five orders larger, cancels
            assert!(
                (turning - expected).abs() < 1e-8 * expected.abs(),
                "{turning} {expected}"
            );
            let pushing = form(
                stiffness(unloaded, length, accel, 0.0) - stiffness(loaded, length, accel, 0.0),
            );
            let expected = axial_energy(*row, length, shapes, 0.0, accel);
            assert!(
                (pushing - expected).abs() < 1e-8 * expected.abs(),
                "{pushing} {expected}"
            );
        }
    }
}

#[test]
fn numbers_of_modes_and_lengths_that_do_not_exist_are_refused() {
    let build = |modes, range| {
        let payload = PayloadProperties::resolve(&Payload::default()).expect("a payload");
        ConsistentPlant::new(
            &Arm::default(),
            &payload,
            &Dynamics::default(),
            modes,
            range,
        )
    };
    for (modes, range, name) in [
        ((0, 1), (1.0, 8.0), "modes.link1"),
        ((1, 9), (1.0, 8.0), "modes.link2"),
        ((1, 1), (0.5, 8.0), "extension_range"),
        ((1, 1), (1.0, 8.5), "extension_range"),
    ] {
        let error = build(modes, range).expect_err("it does not exist");
        assert!(error.to_string().contains(name), "{error}");
    }
    let plant = build((2, 2), (2.0, 4.0)).expect("the plant exists");
    let error = plant
        .matrices(&fixed(5.0), 0.0)
        .expect_err("5 m is not in the tables");
    assert!(error.to_string().contains("extension"), "{error}");
}
