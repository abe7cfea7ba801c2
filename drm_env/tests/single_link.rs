//! The arm whose link 1 vanishes is a single flexible link on a hinge (thesis section 4.1.2): its
//! frequencies and its answer to a torque at the hinge against the exact beam, derived here.
//!
//! A uniform Euler-Bernoulli beam hinged at x = 0 with a body of mass Mp and inertia J at the tip
//! x = L has the modes sin kx + b sinh kx / cosh kL, z = kL, and frequencies z^2 sqrt(EI / rho L^4):
//!
//! ```text
//! EI y''(L) = w^2 J y'(L)       b = (sin z + j z^3 cos z) / (tanh z - j z^3),   j = J / (rho L^3)
//! EI y'''(L) = -w^2 Mp y(L)     b - cos z + m z (sin z + b tanh z) = 0,         m = Mp / (rho L)
//! ```
//!
//! which is tan z = tanh z for the free tip: z = 3.9266, 7.0686, ...

// the measured figures, with --nocapture
#![allow(clippy::print_stdout)]

use std::f64::consts::PI;

use drm_env::analysis::modal::{AssumedArm, FiniteElementBeam, Kinematics, SegmentedBeam};
use drm_env::arm::mode_shape::ShapeFamily;
use drm_env::arm::{Arm, Link, PayloadInertia, PayloadProperties};
use drm_env::math::generalized_alpha::GeneralizedAlpha;
use drm_env::plant::consistent::{CAPACITY, ConsistentPlant, ConsistentState};
use drm_env::plant::{Dynamics, Torques};
use drm_env::reference::Extension;
use drm_env::reference::timeline::Piece;

const LENGTH: f64 = 8.0;
const STIFFNESS: f64 = 3.0e6;
const DENSITY: f64 = 75.0 / 8.0;

/// A link 1 of length `link1` (m) with a part `section` of the stiffness and density of link 2.
fn arm(link1: f64, section: f64) -> Arm {
    let link = |length, part| Link {
        length,
        bending_stiffness: STIFFNESS * part,
        mass_per_length: DENSITY * part,
    };
    Arm {
        link1: link(link1, section),
        link2: link(LENGTH, 1.0),
    }
}

/// No payload, a mass without extent, a mass with rotary inertia.
fn payloads() -> [PayloadProperties; 3] {
    [(0.0, 0.0), (50.0, 0.0), (200.0, 1.5)]
        .map(|(mass, width)| PayloadProperties::new(mass, 0.0, width, PayloadInertia::Full))
}

/// The exact beam.
struct Beam {
    mass: f64,
    inertia: f64,
}

/// A mode of it.
struct Mode {
    frequency: f64,
    /// y'(0).
    root_slope: f64,
    /// y(L).
    tip: f64,
    /// int rho y^2 + Mp y(L)^2 + J y'(L)^2.
    mass: f64,
}

impl Beam {
    fn new(payload: &PayloadProperties) -> Self {
        Self {
            mass: payload.mass,
            inertia: payload.inertia_attachment,
        }
    }

    /// b times tanh z - j z^3, and that.
    fn coefficient(&self, z: f64) -> (f64, f64) {
        let j = self.inertia / (DENSITY * LENGTH.powi(3)) * z.powi(3);
        (z.sin() + j * z.cos(), z.tanh() - j)
    }

    fn characteristic(&self, z: f64) -> f64 {
        let m = self.mass / (DENSITY * LENGTH) * z;
        let (b, divisor) = self.coefficient(z);
        b - z.cos() * divisor + m * (z.sin() * divisor + b * z.tanh())
    }

    /// The first roots above zero, by bisection between sign changes.
    fn roots(&self, count: usize) -> Vec<f64> {
        let step = 0.05;
        let mut roots = Vec::new();
        let mut low = 0.5;
        while roots.len() < count {
            let high = low + step;
            let sign = self.characteristic(low).signum();
            if self.characteristic(high).signum() != sign {
                let (mut left, mut right) = (low, high);
                for _ in 0..60 {
                    let middle = 0.5 * (left + right);
                    if self.characteristic(middle).signum() == sign {
                        left = middle;
                    } else {
                        right = middle;
                    }
                }
                roots.push(0.5 * (left + right));
            }
            low = high;
        }
        roots
    }

    fn frequencies(&self, count: usize) -> Vec<f64> {
        let unit = (STIFFNESS / DENSITY).sqrt() / (LENGTH * LENGTH);
        self.roots(count)
            .into_iter()
            .map(|z| z * z * unit)
            .collect()
    }

    fn modes(&self, count: usize) -> Vec<Mode> {
        let roots = self.roots(count);
        let frequencies = self.frequencies(count);
        let mode = |(z, frequency): (&f64, f64)| {
            let (z, k) = (*z, z / LENGTH);
            let (b, divisor) = self.coefficient(z);
            let (b, sech, tanh) = (b / divisor, 1.0 / z.cosh(), z.tanh());
            let tip = z.sin() + b * tanh;
            let slope = k * (z.cos() + b);
            // sin^2, 2 sin sinh and sinh^2 integrated
            let square = LENGTH / 2.0 - (2.0 * z).sin() / (4.0 * k)
                + b / k * (z.sin() - z.cos() * tanh)
                + b * b * (tanh / (2.0 * k) - LENGTH / 2.0 * sech * sech);
            Mode {
                frequency,
                root_slope: k * (1.0 + b * sech),
                tip,
                mass: DENSITY * square + self.mass * tip * tip + self.inertia * slope * slope,
            }
        };
        roots.iter().zip(frequencies).map(mode).collect()
    }

    fn rigid_inertia(&self) -> f64 {
        DENSITY * LENGTH.powi(3) / 3.0 + self.mass * LENGTH * LENGTH + self.inertia
    }
}

/// Largest relative error of the first `count` frequencies.
fn worst(found: &[f64], exact: &[f64]) -> f64 {
    let errors = found.iter().zip(exact).map(|(f, e)| (f / e - 1.0).abs());
    errors.fold(0.0, f64::max)
}

fn assumed(
    link1: f64,
    extension: f64,
    payload: &PayloadProperties,
    kinematics: Kinematics,
    modes: [usize; 2],
) -> Vec<f64> {
    let family = ShapeFamily::Mono;
    AssumedArm::new(
        &arm(link1, 1.0),
        payload,
        extension,
        kinematics,
        family,
        modes,
    )
    .frequencies()
}

fn flown(arm: &Arm, extension: f64, payload: &PayloadProperties, modes: usize) -> ConsistentPlant {
    let dynamics = Dynamics {
        spectral_radius: 1.0,
        ..Dynamics::default()
    };
    let range = (extension, extension);
    ConsistentPlant::new(arm, payload, &dynamics, (1, modes), range).expect("the plant exists")
}

#[test]
fn exact_roots_are_the_textbooks() {
    let free = Beam {
        mass: 0.0,
        inertia: 0.0,
    };
    for (root, z) in free.roots(4).iter().zip([3.9266, 7.0686, 10.2102, 13.3518]) {
        assert!((root - z).abs() < 5e-5, "{root} {z}");
    }
    // a mass that does not move: the beam is hinged at both ends
    let held = Beam {
        mass: 1e12,
        inertia: 0.0,
    };
    for (i, root) in held.roots(4).iter().enumerate() {
        assert!((root / (PI * (i + 1) as f64) - 1.0).abs() < 1e-6, "{root}");
    }
    // and does not turn either: hinged and clamped, tan z = tanh z again
    let clamped = Beam {
        mass: 1e12,
        inertia: 1e12,
    };
    let roots = clamped.roots(4);
    for z in [3.9266, 7.0686] {
        assert!(
            roots.iter().any(|root| (root - z).abs() < 5e-5),
            "{roots:?}"
        );
    }
}

/// With link 2 fully out the arm is longer by link 1: its frequencies approach those of link 2
/// alone at the first order of that length.
#[test]
fn frequencies_are_those_of_the_single_link_as_link_1_vanishes() {
    const COUNT: usize = 3;
    for payload in payloads() {
        let exact = Beam::new(&payload).frequencies(COUNT);
        type Find<'a> = &'a dyn Fn(f64) -> Vec<f64>;
        let models: [(&str, Find<'_>); 4] = [
            ("thesis kinematics", &|link1| {
                assumed(link1, LENGTH, &payload, Kinematics::Translating, [1, 10])
            }),
            ("slope turning", &|link1| {
                assumed(link1, LENGTH, &payload, Kinematics::Turning, [1, 10])
            }),
            ("consistent plant", &|link1| {
                flown(&arm(link1, 1.0), LENGTH, &payload, 8)
                    .natural_frequencies(LENGTH)
                    .expect("the length is in range")
            }),
            ("finite elements", &|link1| {
                let beam = SegmentedBeam::arm(&arm(link1, 1.0), &payload, LENGTH);
                FiniteElementBeam::new(beam, 60).frequencies()
            }),
        ];
        for (name, find) in models {
            let errors = [0.08, 0.04, 0.02, 0.01].map(|link1| worst(&find(link1), &exact));
            println!("{name} {} kg: {errors:?}", payload.mass);
            for pair in errors.windows(2) {
                let order = (pair[0] / pair[1]).log2();
                assert!((order - 1.0).abs() < 0.05, "{name}: {errors:?}");
            }
            // a beam longer by one part in 800 has frequencies lower by at most two
            assert!(errors[3] < 2.1 * 0.01 / LENGTH, "{name}: {errors:?}");
            // what is left without link 1 is below 1e-5
            let limit = 2.0 * errors[3] - errors[2];
            assert!(limit.abs() < 1e-5, "{name}: {limit:e}");
        }
    }
}

/// With link 2 reaching back to the hinge the whole has the length of link 2; the doubled section
/// near the hinge, where neither bending nor speed is large, is felt as the cube of its length.
#[test]
fn frequencies_with_the_root_in_link_1_converge_faster() {
    for payload in payloads() {
        let exact = Beam::new(&payload).frequencies(2);
        for (name, kinematics) in [
            ("thesis kinematics", Kinematics::Translating),
            ("slope turning", Kinematics::Turning),
        ] {
            let errors = [0.4, 0.2, 0.1].map(|link1| {
                let extension = LENGTH - link1;
                worst(
                    &assumed(link1, extension, &payload, kinematics, [4, 10]),
                    &exact,
                )
            });
            println!("{name} {} kg: {errors:?}", payload.mass);
            for pair in errors.windows(2) {
                let order = (pair[0] / pair[1]).log2();
                assert!((order - 3.0).abs() < 0.25, "{name}: {errors:?}");
            }
            assert!(errors[2] < 2e-5, "{name}: {errors:?}");
        }
    }
}

/// The torque 1 - cos(2 pi t / PULSE) times half its peak, N m, until PULSE.
const PEAK: f64 = 20.0;
const PULSE: f64 = 0.06;
const END: f64 = 0.15;

fn torque(t: f64) -> f64 {
    if t < PULSE {
        0.5 * PEAK * (1.0 - (2.0 * PI * t / PULSE).cos())
    } else {
        0.0
    }
}

/// Slope at the hinge and deflection of the tip from the tangent there, by Duhamel's integral over
/// the modes of the exact beam.
fn series(beam: &Beam, modes: &[Mode], t: f64) -> [f64; 2] {
    let (half, nu) = (0.5 * PEAK, 2.0 * PI / PULSE);
    let s = t.min(PULSE);
    // x'' = half (1 - cos nu t)
    let spun = half / beam.rigid_inertia();
    let rate = spun * (s - (nu * s).sin() / nu);
    let mut slope = spun * (s * s / 2.0 - (1.0 - (nu * s).cos()) / (nu * nu)) + rate * (t - s);
    let mut tip = slope * LENGTH;
    for mode in modes {
        let w = mode.frequency;
        // x'' + w^2 x = half (1 - cos nu t) from rest, then free
        let (of_one, of_cos) = (1.0 / (w * w), 1.0 / (w * w - nu * nu));
        let x = of_one * (1.0 - (w * s).cos()) - of_cos * ((nu * s).cos() - (w * s).cos());
        let v = of_one * w * (w * s).sin() + of_cos * (nu * (nu * s).sin() - w * (w * s).sin());
        let u = t - s;
        let free = x * (w * u).cos() + v / w * (w * u).sin();
        let eta = half * mode.root_slope / mode.mass * free;
        slope += eta * mode.root_slope;
        tip += eta * mode.tip;
    }
    [slope, tip - slope * LENGTH]
}

/// Slew angle and tip deflection of the flown plant at 60 instants, in steps of `h` and half that,
/// extrapolated.
fn flight(payload: &PayloadProperties, modes: usize, arm: &Arm) -> Vec<[f64; 2]> {
    let extension = LENGTH - arm.link1.length;
    let plant = flown(arm, extension, payload, modes);
    let scheme = GeneralizedAlpha::new(1.0).expect("the radius is within 0 to 1");
    let piece = Piece {
        start: 0.0,
        angle: 0.0,
        rate: 0.0,
        accel: [0.0; 4],
        extension,
        extension_rate: 0.0,
        extension_accel: 0.0,
    };
    let at: Extension<f64> = piece.extension(0.0);
    let fly = |each: usize| {
        let h = END / (60 * each) as f64;
        let mut state = ConsistentState::new([0.0; CAPACITY], [0.0; CAPACITY]);
        let mut seen = Vec::new();
        for step in 0..60 * each {
            let t = h * step as f64;
            let torques = [t, t + h / 2.0, t + h].map(|t| Torques {
                slew: torque(t),
                root: 0.0,
                tip: 0.0,
            });
            plant.step(&scheme, &mut state, &torques, &piece, t, h);
            if (step + 1) % each == 0 {
                seen.push([state.q[0], plant.tip_deflection(&state, &at).0]);
            }
        }
        seen
    };
    let (coarse, fine) = (fly(100), fly(200));
    let extrapolated = coarse.iter().zip(&fine);
    extrapolated
        .map(|(c, f)| [0, 1].map(|i| (4.0 * f[i] - c[i]) / 3.0))
        .collect()
}

/// A torque pulse at the hinge, where link 1 is a millionth of link 2: angle and tip deflection of
/// the flown plant against the series, over the pulse and the vibration after it, in parts of their
/// largest values.
#[test]
fn pulse_at_the_hinge_answers_as_the_modal_series() {
    for payload in payloads().into_iter().take(2) {
        let beam = Beam::new(&payload);
        let exact = beam.modes(20_000);
        let expected: Vec<[f64; 2]> = (1..=60)
            .map(|i| series(&beam, &exact, END * f64::from(i) / 60.0))
            .collect();
        let peak = |i: usize| expected.iter().fold(0.0_f64, |m, x| m.max(x[i].abs()));
        // the series converges as the reciprocal of its length: what is missing is what the
        // second half adds
        let half = series(&beam, &exact[..10_000], PULSE / 2.0);
        let whole = series(&beam, &exact, PULSE / 2.0);
        for i in 0..2 {
            assert!(
                (whole[i] - half[i]).abs() < 3e-5 * peak(i),
                "{whole:?} {half:?}"
            );
        }
        let mut before = f64::INFINITY;
        for (modes, tolerance) in [(3, 0.1), (4, 0.03), (6, 3e-3), (8, 3e-4)] {
            let found = flight(&payload, modes, &arm(0.01, 1e-6));
            let error = |i: usize| {
                let errors = found
                    .iter()
                    .zip(&expected)
                    .map(|(f, e)| (f[i] - e[i]).abs());
                errors.fold(0.0, f64::max) / peak(i)
            };
            let (angle, tip) = (error(0), error(1));
            let mass = payload.mass;
            println!("{mass} kg, {modes} modes: angle {angle:.1e}, tip {tip:.1e}");
            assert!(
                angle < tolerance && tip < tolerance,
                "{modes}: {angle:e} {tip:e}"
            );
            assert!(angle.max(tip) < before / 2.0, "{modes}: {angle:e} {tip:e}");
            before = angle.max(tip);
        }
    }
}
