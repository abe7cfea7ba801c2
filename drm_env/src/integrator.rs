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

/// One step of length `h` of the classical fourth-order Runge-Kutta method (Kutta 1901).
///
/// `derivative` is called at [`Stage::Start`], twice at [`Stage::Middle`] and at [`Stage::End`].
#[inline(always)]
pub fn rk4_step<T: Lane, const N: usize>(
    y: &[T; N],
    h: T,
    mut derivative: impl FnMut(Stage, &[T; N]) -> [T; N],
) -> [T; N] {
    let half = h * 0.5;
    let k1 = derivative(Stage::Start, y);
    let k2 = derivative(Stage::Middle, &advanced(y, half, &k1));
    let k3 = derivative(Stage::Middle, &advanced(y, half, &k2));
    let k4 = derivative(Stage::End, &advanced(y, h, &k3));
    let sixth = h * (1.0 / 6.0);
    std::array::from_fn(|i| y[i] + sixth * (k1[i] + (k2[i] + k3[i]) * 2.0 + k4[i]))
}

#[inline(always)]
fn advanced<T: Lane, const N: usize>(y: &[T; N], h: T, slope: &[T; N]) -> [T; N] {
    std::array::from_fn(|i| y[i] + h * slope[i])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// y' = A y with a rotation: the exact solution is a circle.
    fn error_after_one_turn(steps: usize) -> f64 {
        let h = std::f64::consts::TAU / steps as f64;
        let mut y = [1.0, 0.0];
        for _ in 0..steps {
            y = rk4_step(&y, h, |_, y| [-y[1], y[0]]);
        }
        ((y[0] - 1.0).powi(2) + y[1].powi(2)).sqrt()
    }

    #[test]
    fn exact_rotation_shows_fourth_order() {
        let order = (error_after_one_turn(64) / error_after_one_turn(128)).log2();
        assert!((order - 4.0).abs() < 0.1, "observed order {order}");
    }
}
