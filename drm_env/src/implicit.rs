//! Implicit integration of structural equations M(t) q'' + C(t) q' + K(t) q = F(t) with small dense
//! matrices: the generalised-alpha method (Chung and Hulbert 1993), of second order and
//! unconditionally stable, with a chosen damping of what the step cannot resolve.

use crate::error::ConfigError;

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

    /// Advances by one step of length `h` (s), given the equations at the balance point.
    #[inline(always)]
    pub fn step<const N: usize>(
        &self,
        motion: &mut Motion<N>,
        balance: &Balance<N>,
        jump: Jump<'_, N>,
        h: f64,
    ) {
        self.step_corrected(motion, balance, jump, h, |_| None);
    }

    /// As [`GeneralizedAlpha::step`], for equations that are not quite linear: `beyond` gives the
    /// force that M, C and K leave out, at the coordinates, rates and accelerations found at the
    /// balance point without it. Second order is kept when M, C and K are those of the beginning.
    #[inline(always)]
    pub fn step_corrected<const N: usize>(
        &self,
        motion: &mut Motion<N>,
        balance: &Balance<N>,
        jump: Jump<'_, N>,
        h: f64,
        beyond: impl FnOnce(&Motion<N>) -> Option<[f64; N]>,
    ) {
        let Balance {
            mass,
            velocity,
            stiffness,
            force,
        } = balance;
        let point = self.balance_point();
        let (of_mass, of_velocity, of_stiffness) = (
            1.0 - self.alpha_m,
            point * self.gamma * h,
            point * self.beta * h * h,
        );
        let factors = Factors::new(std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                of_mass * mass[i][j] + of_velocity * velocity[i][j] + of_stiffness * stiffness[i][j]
            })
        }));
        let residual = |q: &[f64; N], v: &[f64; N], a: &[f64; N]| -> [f64; N] {
            std::array::from_fn(|i| {
                force[i] - dot(&mass[i], a) - dot(&velocity[i], v) - dot(&stiffness[i], q)
            })
        };
        // a discontinuous force changes the acceleration at once; through the step's own matrix,
        // which leaves out the modes too fast for the step
        match jump {
            Jump::None => {}
            Jump::Force(change) => {
                let added = factors.solve(change);
                for (a, added) in motion.a.iter_mut().zip(added) {
                    *a += of_mass * added;
                }
            }
            Jump::Start => {
                let start = factors.solve(&residual(&motion.q, &motion.v, &[0.0; N]));
                motion.a = start.map(|a| of_mass * a);
            }
        }
        let Motion { q, v, a } = motion;
        let (v_weight, q_weight) = (
            point * h * (1.0 - self.gamma),
            point * h * h * (0.5 - self.beta),
        );
        let ahead = point * h;
        let known = Motion {
            q: std::array::from_fn(|i| q[i] + ahead * v[i] + q_weight * a[i]),
            v: std::array::from_fn(|i| v[i] + v_weight * a[i]),
            a: std::array::from_fn(|i| self.alpha_m * a[i]),
        };
        let mut next = factors.solve(&residual(&known.q, &known.v, &known.a));
        let found = Motion {
            q: std::array::from_fn(|i| known.q[i] + of_stiffness * next[i]),
            v: std::array::from_fn(|i| known.v[i] + of_velocity * next[i]),
            a: std::array::from_fn(|i| known.a[i] + of_mass * next[i]),
        };
        if let Some(force) = beyond(&found) {
            for (next, correction) in next.iter_mut().zip(factors.solve(&force)) {
                *next += correction;
            }
        }
        for i in 0..N {
            q[i] += h * v[i] + h * h * ((0.5 - self.beta) * a[i] + self.beta * next[i]);
            v[i] += h * ((1.0 - self.gamma) * a[i] + self.gamma * next[i]);
        }
        *a = next;
    }
}

/// Coordinates, rates and the method's acceleration (that of a moment before the present).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion<const N: usize> {
    /// Coordinates.
    pub q: [f64; N],
    /// Rates, per second.
    pub v: [f64; N],
    /// Accelerations, per second squared.
    pub a: [f64; N],
}

/// M, C, K and F at the balance point of a step, rows first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Balance<const N: usize> {
    /// M.
    pub mass: [[f64; N]; N],
    /// C.
    pub velocity: [[f64; N]; N],
    /// K.
    pub stiffness: [[f64; N]; N],
    /// F.
    pub force: [f64; N],
}

/// What happened to the force between the last step and this one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Jump<'a, const N: usize> {
    /// It is continuous.
    None,
    /// It changed by this much.
    Force(&'a [f64; N]),
    /// There is no last step: the acceleration follows from the equations.
    Start,
}

/// L U factors of a matrix that needs no pivoting (a positive definite one and small unsymmetric
/// parts); reciprocals on the diagonal.
#[derive(Debug, Clone, Copy)]
struct Factors<const N: usize>([[f64; N]; N]);

impl<const N: usize> Factors<N> {
    #[inline(always)]
    fn new(mut m: [[f64; N]; N]) -> Self {
        for k in 0..N {
            let pivot_row = m[k];
            let reciprocal = 1.0 / pivot_row[k];
            m[k][k] = reciprocal;
            for row in m.iter_mut().skip(k + 1) {
                let factor = row[k] * reciprocal;
                row[k] = factor;
                for j in k + 1..N {
                    row[j] -= factor * pivot_row[j];
                }
            }
        }
        Self(m)
    }

    #[inline(always)]
    fn solve(&self, right: &[f64; N]) -> [f64; N] {
        let mut x = *right;
        for i in 1..N {
            x[i] -= dot(&self.0[i][..i], &x[..i]);
        }
        for i in (0..N).rev() {
            x[i] = (x[i] - dot(&self.0[i][i + 1..], &x[i + 1..])) * self.0[i][i];
        }
        x
    }
}

#[inline(always)]
fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// m q'' + c q' + k q = 0 from q = 1 at rest: state after `time`, in `steps` steps.
    fn oscillator(radius: f64, [m, c, k]: [f64; 3], time: f64, steps: usize) -> Motion<1> {
        let scheme = GeneralizedAlpha::new(radius).expect("the radius is within 0 to 1");
        let balance = Balance {
            mass: [[m]],
            velocity: [[c]],
            stiffness: [[k]],
            force: [0.0],
        };
        let mut motion = Motion {
            q: [1.0],
            v: [0.0],
            a: [0.0],
        };
        let mut jump = Jump::Start;
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
        let norm = |m: &Motion<1>| libm::hypot(libm::hypot(m.q[0], m.v[0]), m.a[0]);
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
                let balance = Balance {
                    mass: [[1.0]],
                    velocity: [[0.0]],
                    stiffness: [[4.0]],
                    force: [force],
                };
                let jump = [5.0];
                let jump = if step == steps {
                    Jump::Force(&jump)
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
