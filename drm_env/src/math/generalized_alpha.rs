//! Implicit integration of structural equations M(t) q'' + C(t) q' + K(t) q = F(t) with small dense
//! matrices: the generalised-alpha method (Chung and Hulbert 1993), of second order and
//! unconditionally stable, with a chosen damping of what the step cannot resolve.

use crate::error::ConfigError;
use crate::simd::Lane;

/// Constants of the generalised-alpha method.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GeneralizedAlpha {
    alpha_m: f64,
    alpha_f: f64,
    beta: f64,
    gamma: f64,
}

impl Default for GeneralizedAlpha {
    /// A spectral radius of 0.8 at infinite frequency.
    fn default() -> Self {
        Self::with_radius(0.8)
    }
}

impl GeneralizedAlpha {
    /// From the spectral radius at infinite frequency: 1 damps nothing (the method is then that of
    /// the implicit midpoint), 0 annihilates infinitely fast modes in one step.
    ///
    /// # Errors
    /// A radius outside 0 to 1.
    pub fn new(spectral_radius: f64) -> Result<Self, ConfigError> {
        if (0.0..=1.0).contains(&spectral_radius) {
            return Ok(Self::with_radius(spectral_radius));
        }
        Err(ConfigError::value(
            "spectral_radius",
            "must be within 0 to 1",
            spectral_radius,
        ))
    }

    fn with_radius(radius: f64) -> Self {
        let alpha_m = (2.0 * radius - 1.0) / (radius + 1.0);
        let alpha_f = radius / (radius + 1.0);
        let lead = 1.0 - alpha_m + alpha_f;
        Self {
            alpha_m,
            alpha_f,
            beta: lead * lead / 4.0,
            gamma: lead - 0.5,
        }
    }

    /// Where in the step, as a fraction of it, the equations are balanced.
    pub fn balance_point(&self) -> f64 {
        1.0 - self.alpha_f
    }

    /// Advances by one step of length `h` (s), given the equations at the balance point. Second order
    /// is kept when M, C and K are those of the beginning and [`Equations::beyond`] gives the rest.
    #[inline(always)]
    pub fn step<T: Lane, const N: usize>(
        &self,
        motion: &mut Motion<T, N>,
        equations: &impl Equations<T, N>,
        jump: Jump<'_, T, N>,
        h: T,
    ) {
        let size = equations.size().min(N);
        let point = self.balance_point();
        let of_mass = 1.0 - self.alpha_m;
        let (of_velocity, of_stiffness) = (h * (point * self.gamma), h * h * (point * self.beta));
        let mut factors = [[T::splat(0.0); N]; N];
        equations.effective(T::splat(of_mass), of_velocity, of_stiffness, &mut factors);
        factorize(&mut factors, size);
        let Motion { q, v, a } = motion;
        // a discontinuous force changes the acceleration at once; through the step's own matrix,
        // which leaves out the modes too fast for the step
        if let Jump::Change { change, started } = jump {
            let mut added = *change;
            solve(&factors, size, &mut added);
            for i in 0..size {
                let before = a[i].where_set(started, T::splat(0.0));
                a[i] = T::splat(of_mass).mul_add(added[i], before);
            }
        }
        // with x the acceleration at the balance point over its weight, the matrix of the step takes
        // the place of M: what is known of q, v and a there, less what x takes of it
        let part = self.alpha_m / of_mass;
        let ahead = h * point;
        let of_v = h * (point * (1.0 - self.gamma)) - of_velocity * part;
        let of_q = h * h * (point * (0.5 - self.beta)) - of_stiffness * part;
        let mut found = Motion {
            q: [T::splat(0.0); N],
            v: [T::splat(0.0); N],
            a: [T::splat(0.0); N],
        };
        for i in 0..size {
            found.q[i] = of_q.mul_add(a[i], ahead.mul_add(v[i], q[i]));
            found.v[i] = of_v.mul_add(a[i], v[i]);
        }
        let mut x = equations.unbalanced(&found.q, &found.v);
        solve(&factors, size, &mut x);
        for (i, x) in x.iter().enumerate().take(size) {
            found.q[i] = of_stiffness.mul_add(*x, found.q[i]);
            found.v[i] = of_velocity.mul_add(*x, found.v[i]);
            found.a[i] = *x * of_mass;
        }
        if let Some(mut missed) = equations.beyond(&found) {
            solve(&factors, size, &mut missed);
            for (x, missed) in x.iter_mut().zip(missed).take(size) {
                *x += missed;
            }
        }
        let (q_old, q_new) = (h * h * (0.5 - self.beta), h * h * self.beta);
        let (v_old, v_new) = (h * (1.0 - self.gamma), h * self.gamma);
        for i in 0..size {
            let next = T::splat(-part).mul_add(a[i], x[i]);
            let moved = q_old.mul_add(a[i], h.mul_add(v[i], q[i]));
            q[i] = q_new.mul_add(next, moved);
            v[i] = v_new.mul_add(next, v_old.mul_add(a[i], v[i]));
            a[i] = next;
        }
    }
}

/// The equations at the balance point of a step.
pub trait Equations<T: Lane, const N: usize> {
    /// How many of the N coordinates there are.
    fn size(&self) -> usize;

    /// Writes mass M + velocity C + stiffness K, rows first; needs no pivoting.
    fn effective(&self, mass: T, velocity: T, stiffness: T, out: &mut [[T; N]; N]);

    /// F - C v - K q.
    fn unbalanced(&self, q: &[T; N], v: &[T; N]) -> [T; N];

    /// For equations that are not quite linear: the force that M, C and K leave out, at the
    /// coordinates, rates and accelerations found at the balance point without it.
    fn beyond(&self, _found: &Motion<T, N>) -> Option<[T; N]> {
        None
    }
}

/// Coordinates, rates and the method's acceleration (that of a moment before the present).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion<T, const N: usize> {
    /// Coordinates.
    pub q: [T; N],
    /// Rates, per second.
    pub v: [T; N],
    /// Accelerations, per second squared.
    pub a: [T; N],
}

/// What happened to the force between the last step and this one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Jump<'a, T, const N: usize> {
    /// It is continuous.
    None,
    /// Lane by lane: where `started` is 1 it changed by `change`; where it is 0 there is no last step:
    /// the acceleration follows from the equations, and `change` is F - C v - K q at the beginning.
    Change {
        /// Force.
        change: &'a [T; N],
        /// 1 or 0.
        started: T,
    },
}

/// L U factors in place of a matrix that needs no pivoting (a positive definite one and small
/// unsymmetric parts); reciprocals on the diagonal.
#[inline(always)]
pub(crate) fn factorize<T: Lane, const N: usize>(m: &mut [[T; N]; N], size: usize) {
    for k in 0..size {
        let (above, below) = m.split_at_mut(k + 1);
        let pivot_row = &mut above[k];
        let reciprocal = pivot_row[k].recip();
        pivot_row[k] = reciprocal;
        for row in &mut below[..size - k - 1] {
            let factor = row[k] * reciprocal;
            row[k] = factor;
            for j in k + 1..size {
                row[j] = (-factor).mul_add(pivot_row[j], row[j]);
            }
        }
    }
}

/// Replaces a right-hand side by the solution.
#[inline(always)]
pub(crate) fn solve<T: Lane, const N: usize>(factors: &[[T; N]; N], size: usize, x: &mut [T; N]) {
    for j in 0..size {
        let known = -x[j];
        for i in j + 1..size {
            x[i] = known.mul_add(factors[i][j], x[i]);
        }
    }
    for j in (0..size).rev() {
        x[j] = x[j] * factors[j][j];
        let known = -x[j];
        for i in 0..j {
            x[i] = known.mul_add(factors[i][j], x[i]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// m q'' + c q' + k q = f.
    struct Oscillator {
        matrices: [f64; 3],
        force: f64,
    }

    impl Equations<f64, 1> for Oscillator {
        fn size(&self) -> usize {
            1
        }

        fn effective(&self, mass: f64, velocity: f64, stiffness: f64, out: &mut [[f64; 1]; 1]) {
            let [m, c, k] = self.matrices;
            out[0][0] = mass * m + velocity * c + stiffness * k;
        }

        fn unbalanced(&self, q: &[f64; 1], v: &[f64; 1]) -> [f64; 1] {
            let [_, c, k] = self.matrices;
            [self.force - c * v[0] - k * q[0]]
        }
    }

    /// m q'' + c q' + k q = 0 from q = 1 at rest: state after `time`, in `steps` steps.
    fn oscillator(radius: f64, matrices: [f64; 3], time: f64, steps: usize) -> Motion<f64, 1> {
        let scheme = GeneralizedAlpha::new(radius).expect("the radius is within 0 to 1");
        let force = 0.0;
        let balance = Oscillator { matrices, force };
        let mut motion = Motion {
            q: [1.0],
            v: [0.0],
            a: [0.0],
        };
        let start = balance.unbalanced(&motion.q, &motion.v);
        let mut jump = Jump::Change {
            change: &start,
            started: 0.0,
        };
        for _ in 0..steps {
            scheme.step(&mut motion, &balance, jump, time / steps as f64);
            jump = Jump::None;
        }
        motion
    }

    #[test]
    fn exact_damped_oscillation_shows_second_order() {
        let (w, decay, time) = (3.0_f64, 0.4_f64, 2.0);
        let square = w * w + decay * decay;
        let (sin, cos) = (libm::sin(w * time), libm::cos(w * time));
        let envelope = libm::exp(-decay * time);
        let exact = (
            envelope * (cos + decay / w * sin),
            -envelope * square / w * sin,
        );
        for radius in [0.0, 0.5, 0.8, 1.0] {
            let error = |steps| {
                let end = oscillator(radius, [2.0, 4.0 * decay, 2.0 * square], time, steps);
                libm::hypot(end.q[0] - exact.0, end.v[0] - exact.1)
            };
            let order = libm::log2(error(400) / error(800));
            assert!((order - 2.0).abs() < 0.1, "{radius}: {order}");
        }
    }

    /// At infinite frequency the amplitude shrinks by the spectral radius in every step.
    #[test]
    fn unresolved_modes_shrink_by_the_spectral_radius() {
        let norm = |m: &Motion<f64, 1>| libm::hypot(libm::hypot(m.q[0], m.v[0]), m.a[0]);
        for radius in [0.5, 0.8, 0.95] {
            let at =
                |steps: usize| norm(&oscillator(radius, [1.0, 0.0, 1e12], steps as f64, steps));
            // the eigenvalue is a double or triple one: a factor of up to the square of the steps
            let measured = libm::pow(at(600) / at(300), 1.0 / 300.0);
            let most = libm::pow(4.0, 1.0 / 300.0);
            let ratio = measured / radius;
            assert!(
                ratio > 0.999 && ratio < 1.001 * most,
                "{radius}: {measured}"
            );
        }
    }

    /// A force that switches on: q = (1 - cos w t) f / k, to second order all the same.
    #[test]
    fn sudden_force_keeps_the_second_order() {
        let scheme = GeneralizedAlpha::default();
        let fly = |steps: usize| {
            let h = 1.0 / steps as f64;
            let mut motion = Motion {
                q: [0.0],
                v: [0.0],
                a: [0.0],
            };
            for step in 0..2 * steps {
                let force = if step < steps { 0.0 } else { 5.0 };
                let balance = Oscillator {
                    matrices: [1.0, 0.0, 4.0],
                    force,
                };
                let jump = if step == steps {
                    Jump::Change {
                        change: &[5.0],
                        started: 1.0,
                    }
                } else {
                    Jump::None
                };
                scheme.step(&mut motion, &balance, jump, h);
            }
            motion.q[0] - (1.0 - libm::cos(2.0)) * 1.25
        };
        let order = libm::log2((fly(100) / fly(200)).abs());
        assert!((order - 2.0).abs() < 0.1, "{order}");
    }

    #[test]
    fn radius_outside_0_to_1_is_refused() {
        for radius in [-0.1, 1.1, f64::NAN] {
            let error = GeneralizedAlpha::new(radius).expect_err("it is outside");
            assert!(error.to_string().contains("spectral_radius"), "{error}");
        }
    }
}
