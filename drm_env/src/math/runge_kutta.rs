//! Fixed-step Runge-Kutta integration of y' = f(y) over a closure.

use crate::simd::Lane;

/// Where in its step a Runge-Kutta stage lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// At the beginning of the step.
    Start,
    /// Half a step later (two stages).
    Middle,
    /// At the end of the step.
    End,
}

/// The right-hand side f of y' = f(y) at the stages of a step. Closures are one; where the numbers are
/// registers of a processor, a type with a method that is inlined always must be.
pub trait Derivative<T, const N: usize> {
    /// y' at a stage.
    fn at(&mut self, stage: Stage, y: &[T; N]) -> [T; N];
}

impl<T, const N: usize, F: FnMut(Stage, &[T; N]) -> [T; N]> Derivative<T, N> for F {
    #[inline(always)]
    fn at(&mut self, stage: Stage, y: &[T; N]) -> [T; N] {
        self(stage, y)
    }
}

/// One step of length `h` of the classical fourth-order Runge-Kutta method (Kutta 1901).
///
/// `derivative` is asked at [`Stage::Start`], twice at [`Stage::Middle`] and at [`Stage::End`].
#[inline(always)]
pub fn rk4_step<T: Lane, const N: usize>(
    y: &[T; N],
    h: T,
    mut derivative: impl Derivative<T, N>,
) -> [T; N] {
    let half = h * 0.5;
    let k1 = derivative.at(Stage::Start, y);
    let k2 = derivative.at(Stage::Middle, &advanced(y, half, &k1));
    let k3 = derivative.at(Stage::Middle, &advanced(y, half, &k2));
    let k4 = derivative.at(Stage::End, &advanced(y, h, &k3));
    let sixth = h * (1.0 / 6.0);
    let two = T::splat(2.0);
    let mut next = *y;
    for i in 0..N {
        let slope = (k2[i] + k3[i]).mul_add(two, k1[i] + k4[i]);
        next[i] = sixth.mul_add(slope, y[i]);
    }
    next
}

#[inline(always)]
fn advanced<T: Lane, const N: usize>(y: &[T; N], h: T, slope: &[T; N]) -> [T; N] {
    let mut next = *y;
    for i in 0..N {
        next[i] = h.mul_add(slope[i], y[i]);
    }
    next
}

/// Where the stability region of [`rk4_step`] ends on the negative real axis: the real root of
/// R(-x) = 1, 24 - 12 x + 4 x^2 - x^3 = 0.
const REAL_LIMIT: f64 = 2.785_293_563_405_282;

/// The left half-disc of this radius lies within the stability region, and beyond the larger one
/// nothing of it does.
const STABLE_RADII: [f64; 2] = [2.6, 3.3];

/// The longest step (s) with which [`rk4_step`] does not let the free vibration
/// y'' + 2 `damping_ratio` w y' + w^2 y = 0 of an angular frequency w (rad/s) grow: that of the
/// eigenvalue z with |R(h z)| = 1, where R(z) = 1 + z + z^2/2 + z^3/6 + z^4/24.
pub fn largest_stable_step(frequency: f64, damping_ratio: f64) -> f64 {
    if damping_ratio == 0.0 {
        return 2.0 * std::f64::consts::SQRT_2 / frequency;
    }
    if damping_ratio >= 1.0 {
        // two real eigenvalues; the faster one
        let faster = damping_ratio + libm::sqrt(damping_ratio * damping_ratio - 1.0);
        return REAL_LIMIT / (frequency * faster);
    }
    let direction = [
        -damping_ratio,
        libm::sqrt(1.0 - damping_ratio * damping_ratio),
    ];
    let [mut stable, mut unstable] = STABLE_RADII;
    // halved until nothing is left between two numbers
    for _ in 0..60 {
        let middle = 0.5 * (stable + unstable);
        if amplification(direction.map(|part| part * middle)) <= 1.0 {
            stable = middle;
        } else {
            unstable = middle;
        }
    }
    stable / frequency
}

/// |R(z)|^2 of [`rk4_step`] for z = x + i y.
fn amplification([x, y]: [f64; 2]) -> f64 {
    let (mut real, mut imaginary) = (1.0, 0.0);
    for power in [4.0, 3.0, 2.0, 1.0] {
        let product = (real * x - imaginary * y, real * y + imaginary * x);
        (real, imaginary) = (1.0 + product.0 / power, product.1 / power);
    }
    real * real + imaginary * imaginary
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// A vibration integrated with a step just below the limit dies or stays, with one just above
        /// it grows; on the way up to the limit no step lets it grow.
        #[test]
        fn longest_stable_step_divides_growth_from_decay(
            ratio in prop_oneof![Just(0.0), 0.0..1.0_f64, 1.0..50.0_f64], frequency in 0.1..1e4_f64,
        ) {
            let limit = largest_stable_step(frequency, ratio);
            // energy norm after many steps from a state with a part of both eigenvectors
            let grown = |h: f64| {
                let mut y = [1.0, -0.3];
                for _ in 0..3000 {
                    y = rk4_step(&y, h * frequency, |_: Stage, y: &[f64; 2]| {
                        [y[1], -y[0] - 2.0 * ratio * y[1]]
                    });
                    // long before it is not finite
                    if y[0].abs() + y[1].abs() > 1e12 {
                        return true;
                    }
                }
                y[0].abs() + y[1].abs() > 1e3
            };
            for part in [0.2, 0.5, 0.8, 0.95, 0.995] {
                prop_assert!(!grown(part * limit), "{part} of {limit}");
            }
            prop_assert!(grown(1.005 * limit), "beyond {limit}");
        }

        /// What [`STABLE_RADII`] says, and that each ray leaves the region once.
        #[test]
        fn each_ray_leaves_the_stability_region_once(ratio in 1e-6..1.0_f64) {
            let direction = [-ratio, (1.0 - ratio * ratio).sqrt()];
            let mut left = None;
            for i in 1..4000 {
                let radius = f64::from(i) * 1e-3;
                let stable = amplification(direction.map(|part| part * radius)) <= 1.0;
                match left {
                    None if !stable => left = Some(radius),
                    Some(place) => prop_assert!(!stable, "left at {place}, back at {radius}"),
                    None => {}
                }
            }
            let place = left.expect("nothing beyond a radius of 4 is stable");
            prop_assert!(STABLE_RADII[0] < place && place < STABLE_RADII[1], "{place}");
        }
    }

    /// y' = A y with a rotation: the exact solution is a circle.
    fn error_after_one_turn(steps: usize) -> f64 {
        let h = std::f64::consts::TAU / steps as f64;
        let mut y = [1.0, 0.0];
        for _ in 0..steps {
            y = rk4_step(&y, h, |_: Stage, y: &[f64; 2]| [-y[1], y[0]]);
        }
        ((y[0] - 1.0).powi(2) + y[1].powi(2)).sqrt()
    }

    #[test]
    fn exact_rotation_shows_fourth_order() {
        let order = (error_after_one_turn(64) / error_after_one_turn(128)).log2();
        assert!((order - 4.0).abs() < 0.1, "observed order {order}");
    }
}
