//! Fixed-step Runge-Kutta integration of y' = f(y) over a closure.

use crate::lane::Lane;

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

#[cfg(test)]
mod tests {
    use super::*;

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
