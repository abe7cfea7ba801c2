//! The linear state-space forms against differences of the code that steps: accelerations of the
//! thesis plant, and one step of either plant's integrator from displaced states.

// the measured figures, with --nocapture
#![allow(clippy::print_stdout)]

use drm_env::analysis::linearization::{INPUT_NAMES, Linearization, OUTPUT_NAMES};
use drm_env::analysis::model::{Model, ModelPlant, ModelSpec};
use drm_env::arm::{Arm, Payload};
use drm_env::math::generalized_alpha::GeneralizedAlpha;
use drm_env::math::runge_kutta::{Stage, rk4_step};
use drm_env::plant::consistent::{CAPACITY, ConsistentPlant, ConsistentState};
use drm_env::plant::thesis::{Constants, Prepared};
use drm_env::plant::{Dynamics, TipTorque, Torques};
use drm_env::reference::Extension;
use drm_env::reference::timeline::Piece;
use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;

const NO_TORQUE: Torques<f64> = Torques {
    slew: 0.0,
    root: 0.0,
    tip: 0.0,
};

/// A piece of timeline without a slew reference that begins at an extension.
fn moving(extension: &Extension<f64>) -> Piece<f64> {
    Piece {
        start: 0.0,
        angle: 0.0,
        rate: 0.0,
        accel: [0.0; 4],
        extension: extension.length,
        extension_rate: extension.rate,
        extension_accel: extension.accel,
    }
}

/// A random payload, length and motion, with random switches of the equations.
#[derive(Debug, Clone, Copy)]
struct Case {
    payload: Payload,
    dynamics: Dynamics,
    extension: Extension<f64>,
    slew_rate: f64,
}

fn config(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

fn either_sign(low: f64, high: f64) -> impl Strategy<Value = f64> {
    (low..high, any::<bool>()).prop_map(|(x, minus)| if minus { -x } else { x })
}

fn case() -> impl Strategy<Value = Case> {
    let payload = (50.0..500.0, 0.0..2.0, 0.1..1.0);
    let motion = (
        1.05..7.95,
        either_sign(0.1, 1.5),
        either_sign(0.1, 2.0),
        either_sign(0.05, 0.4),
    );
    let switches = (any::<bool>(), any::<bool>(), any::<bool>(), any::<bool>());
    (payload, motion, switches).prop_map(
        |((mass, length, width), (a, rate, accel, slew_rate), (axial, follow, whole, damped))| {
            Case {
                payload: Payload {
                    mass,
                    length: Some(length),
                    width: Some(width),
                    ..Payload::default()
                },
                dynamics: Dynamics {
                    axial_load: axial,
                    particle_following: follow,
                    tip_torque: if whole {
                        TipTorque::SlewAndTip
                    } else {
                        TipTorque::TipOnly
                    },
                    structural_damping: if damped { 1e-3 } else { 0.0 },
                    ..Dynamics::default()
                },
                extension: Extension {
                    length: a,
                    rate,
                    accel,
                },
                slew_rate,
            }
        },
    )
}

fn at_rest(extension: &Extension<f64>) -> Extension<f64> {
    Extension {
        rate: 0.0,
        accel: 0.0,
        ..*extension
    }
}

fn model(case: &Case, plant: ModelPlant, modes: Option<[usize; 2]>) -> Model {
    Model::new(ModelSpec {
        payload: case.payload,
        plant,
        dynamics: case.dynamics,
        modes,
        ..ModelSpec::default()
    })
    .expect("the model exists")
}

fn torques(input: usize, size: f64) -> Torques<f64> {
    let at = |i| if i == input { size } else { 0.0 };
    Torques {
        slew: at(0),
        root: at(1),
        tip: at(2),
    }
}

/// A and B by differences of a state after a time h, which may be negative, from x0 + displacement
/// under torques: the odd part of the transition over h, extrapolated to h = 0 from h and h / 2.
/// What is left is of the order (h w)^4.
fn differences(
    start: &DVector<f64>,
    h: f64,
    displacement: impl Fn(usize) -> f64,
    after: impl Fn(&DVector<f64>, &Torques<f64>, f64) -> DVector<f64>,
) -> (DMatrix<f64>, DMatrix<f64>) {
    let size = start.len();
    let rate = |at: &dyn Fn(f64, f64) -> DVector<f64>, unit: f64| {
        let odd = |h: f64| {
            let change = |h: f64| (at(unit, h) - at(-unit, h)) / (2.0 * unit);
            (change(h) - change(-h)) / (2.0 * h)
        };
        (odd(h / 2.0) * 4.0 - odd(h)) / 3.0
    };
    let a: Vec<_> = (0..size)
        .map(|j| {
            let at = |unit: f64, h: f64| {
                let mut state = start.clone();
                state[j] += unit;
                after(&state, &NO_TORQUE, h)
            };
            rate(&at, displacement(j))
        })
        .collect();
    let b: Vec<_> = (0..INPUT_NAMES.len())
        .map(|j| rate(&|unit, h| after(start, &torques(j, unit), h), 10.0))
        .collect();
    (DMatrix::from_columns(&a), DMatrix::from_columns(&b))
}

/// Coordinates and rates times the square roots of their masses: entries then compare.
fn scaled(a: &DMatrix<f64>, mass: &DMatrix<f64>) -> DMatrix<f64> {
    let n = mass.nrows();
    let root = |i: usize| mass[(i % n, i % n)].sqrt();
    let columns = a.ncols() == 2 * n;
    DMatrix::from_fn(a.nrows(), a.ncols(), |i, j| {
        a[(i, j)] * root(i) / if columns { root(j) } else { 1.0 }
    })
}

/// Largest errors in parts of the largest entry: of K's and of C's block of A, and of B.
fn errors(
    found: (&DMatrix<f64>, &DMatrix<f64>),
    expected: (&DMatrix<f64>, &DMatrix<f64>),
    mass: &DMatrix<f64>,
) -> [f64; 3] {
    let n = mass.nrows();
    let part = |found: &DMatrix<f64>, expected: &DMatrix<f64>, column: usize, count: usize| {
        let block = |m: &DMatrix<f64>| scaled(m, mass).view((n, column), (n, count)).into_owned();
        let (found, expected) = (block(found), block(expected));
        (&found - &expected).amax() / expected.amax()
    };
    [
        part(found.0, expected.0, 0, n),
        part(found.0, expected.0, n, n),
        part(found.1, expected.1, 0, 3),
    ]
}

/// The kinematic half of A and B holds exactly.
fn check_kinematics(linear: &Linearization) {
    let n = linear.a.nrows() / 2;
    assert_eq!(linear.states.len(), 2 * n);
    assert_eq!(linear.b.shape(), (2 * n, INPUT_NAMES.len()));
    assert_eq!(linear.c.shape(), (OUTPUT_NAMES.len(), 2 * n));
    let upper = linear.a.view((0, 0), (n, 2 * n)).into_owned();
    let mut expected = DMatrix::zeros(n, 2 * n);
    expected.view_mut((0, n), (n, n)).fill_with_identity();
    assert_eq!(upper, expected);
    assert_eq!(linear.b.view((0, 0), (n, 3)).amax(), 0.0);
}

fn undeflected(size: usize, slew_rate: f64) -> DVector<f64> {
    let mut state = DVector::zeros(2 * size);
    (state[0], state[size]) = (0.3, slew_rate);
    state
}

/// State after a step of the Runge-Kutta method over the moving arm.
fn thesis_step(case: &Case, state: &DVector<f64>, torques: &Torques<f64>, h: f64) -> DVector<f64> {
    let payload = *model(case, ModelPlant::Thesis, None).payload();
    let constants = Constants::new(&Arm::default(), &payload, &case.dynamics);
    let piece = moving(&case.extension);
    let prepared = |u: f64| {
        let at = piece.extension(u);
        let dynamics = &case.dynamics;
        Prepared::new(constants.matrices(&at, dynamics.axial_load, dynamics.particle_following))
    };
    let stages = [prepared(0.0), prepared(h / 2.0), prepared(h)];
    let y: [f64; 6] = std::array::from_fn(|i| state[i]);
    let next = rk4_step(&y, h, |stage: Stage, y: &[f64; 6]| {
        let at = match stage {
            Stage::Start => &stages[0],
            Stage::Middle => &stages[1],
            Stage::End => &stages[2],
        };
        let [theta, alpha, beta, rate, alpha_rate, beta_rate] = *y;
        let accel = at.acceleration(
            &[theta, alpha, beta],
            &[rate, alpha_rate, beta_rate],
            torques,
            true,
        );
        [rate, alpha_rate, beta_rate, accel[0], accel[1], accel[2]]
    });
    DVector::from_column_slice(&next)
}

/// State after a step of the generalised-alpha method over the moving arm.
fn consistent_step(
    plant: &ConsistentPlant,
    extension: &Extension<f64>,
    state: &DVector<f64>,
    torques: &Torques<f64>,
    h: f64,
) -> DVector<f64> {
    let n = plant.size();
    let (mut q, mut v) = ([0.0; CAPACITY], [0.0; CAPACITY]);
    q[..n].copy_from_slice(&state.as_slice()[..n]);
    v[..n].copy_from_slice(&state.as_slice()[n..]);
    let mut motion = ConsistentState::new(q, v);
    let piece = moving(extension);
    let scheme = GeneralizedAlpha::default();
    plant.step(&scheme, &mut motion, &[*torques; 3], &piece, 0.0, h);
    DVector::from_iterator(2 * n, motion.q[..n].iter().chain(&motion.v[..n]).copied())
}

/// The consistent plant tabulated over all lengths, as a manoeuvre does.
fn flown(case: &Case, modes: [usize; 2]) -> ConsistentPlant {
    let payload = *model(case, ModelPlant::Consistent, Some(modes)).payload();
    let modes = (modes[0], modes[1]);
    ConsistentPlant::new(&Arm::default(), &payload, &case.dynamics, modes, (1.0, 8.0))
        .expect("the plant exists")
}

/// 0.02 / w of the fastest mode w, or of its rate of decay where that is larger.
fn small_step(case: &Case, model: &Model) -> f64 {
    let frequencies = model
        .natural_frequencies(case.extension.length, None)
        .expect("the length is in range");
    let fastest = frequencies.into_iter().fold(0.0, f64::max);
    0.02 / (fastest + case.dynamics.structural_damping * fastest * fastest)
}

proptest! {
    #![proptest_config(config(48))]

    /// Along displacements of 0.1 mm what a difference of fourth order misses is far below rounding:
    /// 1e-10 is that of the differences.
    #[test]
    fn thesis_form_is_the_derivative_of_the_accelerations(case in case()) {
        let model = model(&case, ModelPlant::Thesis, None);
        let linear = model.linearize(&case.extension, case.slew_rate).expect("it exists");
        check_kinematics(&linear);
        let mass = &model.matrices(&case.extension, 0.0).expect("they exist")[0];
        let accel = |j: usize, by: f64| {
            let (mut q, mut v) = ([0.3, 0.0, 0.0], [case.slew_rate, 0.0, 0.0]);
            let mut torque = NO_TORQUE;
            match j {
                0..3 => q[j] += by,
                3..6 => v[j - 3] += by,
                _ => torque = torques(j - 6, by),
            }
            let found = model.acceleration(&case.extension, q, v, &torque).expect("it exists");
            DVector::from_column_slice(&found)
        };
        let column = |j: usize| {
            let unit = match j {
                0..3 => 1e-4,
                3..6 => 1e-1,
                _ => 10.0,
            };
            let change = |by: f64| (accel(j, by) - accel(j, -by)) / (2.0 * by);
            (change(unit) * 4.0 - change(2.0 * unit)) / 3.0
        };
        let both = |first: usize, count: usize| {
            let columns: Vec<_> = (first..first + count).map(column).collect();
            let mut whole = DMatrix::zeros(6, count);
            whole.view_mut((3, 0), (3, count)).copy_from(&DMatrix::from_columns(&columns));
            whole
        };
        let found = errors((&both(0, 6), &both(6, 3)), (&linear.a, &linear.b), mass);
        prop_assert!(found.iter().all(|error| *error < 1e-10), "{found:?}");
        // the whole rate of change, not only that of deviations
        let start = undeflected(3, case.slew_rate);
        let rate = &linear.a * &start;
        let whole = accel(0, 0.0);
        let singular = mass.clone().singular_values();
        let condition = singular.max() / singular.min();
        for i in 0..3 {
            // what rounding leaves through the condition of M
            let scale = 4.0 * f64::EPSILON * condition * whole.amax();
            prop_assert!((rate[3 + i] - whole[i]).abs() <= scale, "{rate} {whole}");
        }
    }

    /// h w = 0.02 leaves (h w)^4 = 2e-7 times a constant below one.
    #[test]
    fn thesis_form_is_the_derivative_of_a_step(case in case()) {
        let model = model(&case, ModelPlant::Thesis, None);
        let linear = model.linearize(&case.extension, case.slew_rate).expect("it exists");
        let mass = &model.matrices(&case.extension, 0.0).expect("they exist")[0];
        let h = small_step(&case, &model);
        let start = undeflected(3, case.slew_rate);
        let unit = |j: usize| if j < 3 { 1e-5 } else { 1e-1 };
        let step = |x: &DVector<f64>, u: &Torques<f64>, h: f64| thesis_step(&case, x, u, h);
        let (a, b) = differences(&start, h, unit, step);
        let found = errors((&a, &b), (&linear.a, &linear.b), mass);
        println!("{found:?}");
        prop_assert!(found.iter().all(|error| *error < 2e-7), "{found:?}");
    }
}

proptest! {
    #![proptest_config(config(24))]

    /// As for the thesis plant, with the rounding of short steps. Besides the whole, what deployment
    /// and turning add to the arm at rest: to 1e-4, and 2e-10 of the whole that rounding leaves of
    /// the stiffness of the fastest mode (it falls as the displacements of the differences grow).
    #[test]
    fn consistent_form_is_the_derivative_of_a_step(
        case in case(),
        modes in (1..4_usize, 1..4_usize),
    ) {
        let modes = [modes.0, modes.1];
        let model = model(&case, ModelPlant::Consistent, Some(modes));
        let plant = flown(&case, modes);
        let h = small_step(&case, &model);
        let n = plant.size();
        let unit = |j: usize| if j < n { 1e-5 } else { 1e-1 };
        let both = |extension: &Extension<f64>, slew_rate: f64| {
            let linear = model.linearize(extension, slew_rate).expect("it exists");
            check_kinematics(&linear);
            let start = undeflected(n, slew_rate);
            let step = |x: &DVector<f64>, u: &Torques<f64>, h: f64| {
                consistent_step(&plant, extension, x, u, h)
            };
            (linear, differences(&start, h, unit, step))
        };
        let mass = &model.matrices(&case.extension, 0.0).expect("they exist")[0];
        let (linear, (a, b)) = both(&case.extension, case.slew_rate);
        let (still, (still_a, _)) = both(&at_rest(&case.extension), 0.0);
        let whole = errors((&a, &b), (&linear.a, &linear.b), mass);
        println!("{modes:?} {whole:?}");
        prop_assert!(whole.iter().all(|error| *error < 1e-6), "{whole:?}");
        let block = |m: &DMatrix<f64>, column: usize| {
            scaled(m, mass).view((n, column), (n, n)).into_owned()
        };
        for column in [0, n] {
            let added = block(&(&linear.a - &still.a), column);
            let error = (block(&(&a - &still_a), column) - &added).amax();
            let allowed = 1e-4 * added.amax() + 2e-10 * block(&linear.a, column).amax();
            println!("{error:e} of {:e}", added.amax());
            prop_assert!(error < allowed, "{column}: {error:e} {allowed:e}");
        }
    }

    /// C gives the outputs, and the rows of rates are rates of change of those of values along the
    /// motion (central differences over 1 ms and 2 ms, second order, extrapolated).
    #[test]
    fn outputs_are_those_that_are_seen(case in case(), modes in (1..6_usize, 1..6_usize)) {
        let modes = [modes.0, modes.1];
        let model = model(&case, ModelPlant::Consistent, Some(modes));
        let plant = flown(&case, modes);
        let n = plant.size();
        let piece = moving(&case.extension);
        let c = model.linearize(&case.extension, case.slew_rate).expect("it exists").c;
        let reach = |a: f64| Arm::default().link1.length + a;
        let state = |q: &DVector<f64>| {
            let mut all = [0.0; CAPACITY];
            all[..n].copy_from_slice(q.as_slice());
            ConsistentState::new(all, [0.0; CAPACITY])
        };
        let x = DVector::from_fn(2 * n, |i, _| 1e-3 * (1.7 * i as f64 + 0.4).cos());
        let (q, v) = (x.rows(0, n).into_owned(), x.rows(n, n).into_owned());
        let seen = |t: f64| {
            let (a, q) = (piece.extension(t).length, &q + &v * t);
            let tip = plant.deflection(&state(&q), a, reach(a));
            let joint = plant.link1_end(&state(&q));
            [q[0], tip - joint.0 - a * joint.1, tip]
        };
        let y = &c * &x;
        let change = |h: f64, i: usize| (seen(h)[i] - seen(-h)[i]) / (2.0 * h);
        for i in 0..3 {
            let value = seen(0.0)[i];
            prop_assert!((y[2 * i] - value).abs() < 1e-14 + 1e-12 * value.abs());
            let rate = (4.0 * change(1e-3, i) - change(2e-3, i)) / 3.0;
            prop_assert!((y[2 * i + 1] - rate).abs() < 1e-10, "{i} {} {rate}", y[2 * i + 1]);
        }
    }
}

/// At rest the eigenvalues of A are i times the natural frequencies (Rayleigh-Ritz, another code)
/// and two zeros of the rotation.
#[test]
fn eigenvalues_at_rest_are_the_natural_frequencies() {
    let mut worst = 0.0_f64;
    for payload in [0.0, 200.0, 500.0] {
        for (plant, modes) in [
            (ModelPlant::Thesis, None),
            (ModelPlant::Consistent, Some([1, 2])),
            (ModelPlant::Consistent, Some([4, 4])),
            (ModelPlant::Consistent, Some([8, 8])),
        ] {
            let spec = ModelSpec {
                payload: Payload {
                    mass: payload,
                    ..Payload::default()
                },
                plant,
                modes,
                ..ModelSpec::default()
            };
            let model = Model::new(spec).expect("the model exists");
            for length in [1.0, 2.7, 8.0] {
                let extension = Extension {
                    length,
                    rate: 0.0,
                    accel: 0.0,
                };
                let linear = model.linearize(&extension, 0.0).expect("it exists");
                let n = linear.a.nrows() / 2;
                let mass = &model.matrices(&extension, 0.0).expect("they exist")[0];
                let stiff = scaled(&linear.a, mass).view((n, 0), (n, n)) * -1.0;
                let mut found: Vec<f64> = stiff
                    .complex_eigenvalues()
                    .iter()
                    .map(|square| square.re.max(0.0).sqrt())
                    .collect();
                found.sort_by(f64::total_cmp);
                let expected = model.natural_frequencies(length, None).expect("in range");
                assert_eq!(found.len(), expected.len() + 1);
                // eight modes a link: M's condition amplifies the rounding of the integrals
                for (found, expected) in found[1..].iter().zip(&expected) {
                    let error = (found / expected - 1.0).abs();
                    worst = worst.max(error);
                    assert!(
                        error < 1e-8,
                        "{plant:?} {modes:?} {length}: {found} {expected} {error:e}"
                    );
                }
            }
        }
    }
    println!("frequencies: {worst:e}");
}

#[test]
fn only_plants_with_equations_are_linearised() {
    let extension = Extension {
        length: 4.0,
        rate: 0.0,
        accel: 0.0,
    };
    for (plant, modes, field) in [
        (ModelPlant::FiniteElement, None, "plant"),
        (ModelPlant::ExactRigidLink1, None, "plant"),
        (ModelPlant::Thesis, Some([2, 2]), "modes"),
        (ModelPlant::Consistent, Some([0, 4]), "modes"),
        (ModelPlant::Consistent, Some([4, 9]), "modes"),
    ] {
        let spec = ModelSpec {
            plant,
            modes,
            ..ModelSpec::default()
        };
        let model = Model::new(spec).expect("the model exists");
        for error in [
            model.linearize(&extension, 0.0).err(),
            model.matrices(&extension, 0.0).err(),
        ] {
            let message = error.expect("it is refused").to_string();
            assert!(message.contains(field), "{message}");
        }
    }
}
