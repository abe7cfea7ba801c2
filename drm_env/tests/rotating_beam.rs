//! The frequencies of a uniform beam clamped to a hub that turns at a steady rate: those of the consistent
//! plant against a series solution of the beam's equation, and that against published numbers.

use drm_env::arm::{Arm, Link, PayloadInertia, PayloadProperties};
use drm_env::plant::Dynamics;
use drm_env::plant::consistent::ConsistentPlant;
use drm_env::reference::Extension;
use nalgebra::DMatrix;

/// First flapping frequency (out of the plane of rotation) of the uniform clamped beam, both in units of
/// sqrt(EI / (rho L^4)): the equation w'''' - speed^2/2 ((1 - x^2) w')' = frequency^2 w by a power series
/// from the clamped end, free at the other.
fn flapping(speed: f64) -> f64 {
    let square = speed * speed;
    let free_end = |frequency: f64| {
        // two solutions with w = w' = 0, their moment and shear at x = 1
        let ends = [2, 3].map(|lowest: usize| {
            let mut c = [0.0; 200];
            c[lowest] = 1.0;
            for k in 0..c.len() - 4 {
                let n = k as f64;
                // the coefficient of x^k in ((1 - x^2) w')'
                let tension = (n + 2.0) * (n + 1.0) * c[k + 2] - n * (n + 1.0) * c[k];
                let sum = square / 2.0 * tension + frequency * frequency * c[k];
                c[k + 4] = sum / ((n + 4.0) * (n + 3.0) * (n + 2.0) * (n + 1.0));
            }
            let mut end = [0.0; 2];
            for (k, c) in c.iter().enumerate() {
                let n = k as f64;
                end[0] += n * (n - 1.0) * c;
                end[1] += n * (n - 1.0) * (n - 2.0) * c;
            }
            end
        });
        ends[0][0] * ends[1][1] - ends[0][1] * ends[1][0]
    };
    let (mut low, mut step) = (speed.max(1.0), 0.05);
    let sign = free_end(low).signum();
    while free_end(low + step).signum() == sign {
        low += step;
    }
    for _ in 0..60 {
        step /= 2.0;
        if free_end(low + step).signum() == sign {
            low += step;
        }
    }
    low
}

#[test]
fn series_solution_has_the_published_frequencies() {
    let published = [
        (0.0, 3.516),
        (1.0, 3.682),
        (2.0, 4.137),
        (5.0, 6.450),
        (10.0, 11.20),
    ];
    for (speed, frequency) in published {
        let found = flapping(speed);
        assert!(
            (found / frequency - 1.0).abs() < 3e-4,
            "{speed}: {found} {frequency}"
        );
    }
}

/// In the plane of rotation the square of a frequency is that of flapping less that of the speed. The beam
/// is in two links of one kind, drawn out; the hub is heavy beside them and turns steadily.
#[test]
fn clamped_arm_has_the_frequencies_of_the_turning_beam() {
    let link = |length: f64| Link {
        length,
        bending_stiffness: 2.0e6,
        mass_per_length: 12.0,
    };
    let arm = Arm {
        link1: link(7.0),
        link2: link(8.0),
    };
    let nothing = PayloadProperties::new(0.0, 0.0, 0.0, PayloadInertia::Full);
    let plant = ConsistentPlant::new(&arm, &nothing, &Dynamics::default(), (5, 5), (8.0, 8.0))
        .expect("the plant exists");
    let extension = Extension {
        length: 8.0,
        rate: 0.0,
        accel: 0.0,
    };
    let unit = (2.0e6_f64 / 12.0).sqrt() / (15.0 * 15.0);
    for speed in [0.0, 1.0, 2.0, 5.0, 10.0] {
        let found = plant.matrices(&extension, speed * unit).expect("in range");
        let size = plant.size() - 1;
        let bent = |m: &DMatrix<f64>| m.view((1, 1), (size, size)).into_owned();
        let root = bent(&found.mass)
            .cholesky()
            .expect("M is positive definite")
            .l();
        let inverse = root.try_inverse().expect("M is regular");
        let squares =
            (&inverse * bent(&found.stiffness) * inverse.transpose()).symmetric_eigenvalues();
        let own = squares.min().sqrt() / unit;
        let expected = (flapping(speed).powi(2) - speed * speed).sqrt();
        assert!(
            (own / expected - 1.0).abs() < 2e-4,
            "{speed}: {own} {expected}"
        );
    }
}
