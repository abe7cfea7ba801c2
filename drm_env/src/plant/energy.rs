//! Energy and angular momentum of the thesis plant, integrated over its velocity field
//! (not from the closed forms of the matrices).

use crate::arm::{Arm, PayloadProperties};
use crate::math::quadrature::{gauss_legendre, integrate};
use crate::plant::Dynamics;
use crate::plant::thesis::Constants;
use crate::reference::Extension;

/// Kinetic, potential and total energy, J.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Energy {
    /// Kinetic energy, less by the centrifugal part of the axial load.
    pub kinetic: f64,
    /// Bending, and the part of the axial load that does not depend on the slew rate.
    pub potential: f64,
}

impl Energy {
    /// T + V, J; conserved at a fixed length without torques.
    pub fn total(&self) -> f64 {
        self.kinetic + self.potential
    }
}

fn shape(u: f64) -> f64 {
    u * u * (3.0 - u)
}

fn shape_slope(u: f64) -> f64 {
    u * (6.0 - 3.0 * u)
}

/// Transverse velocity of every mass as (mass per length or mass, lever about the shoulder,
/// velocity), summed by `visit`.
struct Motion<'a> {
    arm: &'a Arm,
    payload: &'a PayloadProperties,
    follow: bool,
    a: f64,
    ad: f64,
    q: [f64; 3],
    v: [f64; 3],
}

impl Motion<'_> {
    /// Sums `term(lever, transverse velocity, offset, moves out)` over the mass of links and
    /// payload, and `turn(rate)` over the payload's rotation.
    fn sum(&self, term: impl Fn(f64, f64, f64, bool) -> f64, turn: impl Fn(f64) -> f64) -> f64 {
        let rule = gauss_legendre(10);
        let (l1, l2) = (self.arm.link1.length, self.arm.link2.length);
        let (rho1, rho2) = (
            self.arm.link1.mass_per_length,
            self.arm.link2.mass_per_length,
        );
        let [_, alpha, beta] = self.q;
        let [rate, alpha_rate, beta_rate] = self.v;
        let (a, ad) = (self.a, self.ad);
        let link1 = integrate(&rule, 0.0, l1, |x| {
            let u = x / l1;
            term(x, x * rate + shape(u) * alpha_rate, shape(u) * alpha, false)
        });
        let overlap = integrate(&rule, l1 + a - l2, l1, |x| {
            let u = x / l1;
            let moved = if self.follow {
                ad * alpha * shape_slope(u) / l1
            } else {
                0.0
            };
            term(
                x,
                x * rate + shape(u) * alpha_rate + moved,
                shape(u) * alpha,
                true,
            )
        });
        let outside = integrate(&rule, 0.0, a, |x| {
            let u = x / a;
            // at a fixed place the shape stretches with the length; a particle also moves along it
            let moved = beta * ad * shape_slope(u) / a * if self.follow { 1.0 - u } else { -u };
            term(
                l1 + x,
                (l1 + x) * rate + 2.0 * alpha_rate + shape(u) * beta_rate + moved,
                2.0 * alpha + shape(u) * beta,
                true,
            )
        });
        let (mp, lp) = (self.payload.mass, self.payload.length);
        let slope = 3.0 * beta / a;
        let slope_rate = 3.0 * beta_rate / a - 3.0 * beta * ad / (a * a);
        let lever = l1 + a + lp / 2.0;
        let payload = term(
            lever,
            lever * rate + 2.0 * (alpha_rate + beta_rate) + lp / 2.0 * slope_rate,
            2.0 * (alpha + beta) + lp / 2.0 * slope,
            true,
        );
        rho1 * link1
            + rho2 * (overlap + outside)
            + mp * payload
            + self.payload.inertia_centre * turn(rate + slope_rate)
    }
}

fn axial(constants: &Constants<f64>, extension: &Extension<f64>, dynamics: &Dynamics) -> [f64; 4] {
    if !dynamics.axial_load {
        return [0.0; 4];
    }
    let x = constants.matrices(extension, true, false).axial;
    [x.a0, x.a2, x.b0, x.b2]
}

/// Energy of the state q, q' at a length. With particle following, the part of the axial velocity's
/// square that couples to the deflection is included and its constant part left out.
pub fn energy(
    arm: &Arm,
    payload: &PayloadProperties,
    dynamics: &Dynamics,
    extension: &Extension<f64>,
    q: [f64; 3],
    v: [f64; 3],
) -> Energy {
    let (a, ad) = (extension.length, extension.rate);
    let motion = Motion {
        arm,
        payload,
        follow: dynamics.particle_following,
        a,
        ad,
        q,
        v,
    };
    let rate = v[0];
    let axial_velocity = if dynamics.particle_following { ad } else { 0.0 };
    let transverse = motion.sum(
        |_, velocity, offset, moves_out| {
            let coupling = if moves_out {
                axial_velocity * rate * offset
            } else {
                0.0
            };
            0.5 * velocity * velocity - coupling
        },
        |turning| 0.5 * turning * turning,
    );
    let rule = gauss_legendre(4);
    let (l1, l2) = (arm.link1.length, arm.link2.length);
    let (ei1, ei2) = (arm.link1.bending_stiffness, arm.link2.bending_stiffness);
    let curvature = |u: f64, length: f64| (6.0 - 6.0 * u) / (length * length);
    let [_, alpha, beta] = q;
    let bend1 = |low: f64| {
        integrate(&rule, low, l1, |x| curvature(x / l1, l1).powi(2)) * alpha * alpha / 2.0
    };
    let bend2 = integrate(&rule, 0.0, a, |x| curvature(x / a, a).powi(2)) * beta * beta / 2.0;
    let [a0, a2, b0, b2] = axial(&Constants::new(arm, payload, dynamics), extension, dynamics);
    let potential = ei1 * bend1(0.0)
        + ei2 * (bend1(l1 + a - l2) + bend2)
        + (alpha * alpha * a0 + beta * beta * b0) / 2.0;
    // the deflected arm is shorter: the centrifugal part of the axial load lessens its inertia
    let kinetic = transverse - rate * rate * (alpha * alpha * a2 + beta * beta * b2) / 2.0;
    Energy { kinetic, potential }
}

/// Angular momentum about the shoulder dL/d(theta'), N m s; it changes by the applied torques alone.
pub fn angular_momentum(
    arm: &Arm,
    payload: &PayloadProperties,
    dynamics: &Dynamics,
    extension: &Extension<f64>,
    q: [f64; 3],
    v: [f64; 3],
) -> f64 {
    let motion = Motion {
        arm,
        payload,
        follow: dynamics.particle_following,
        a: extension.length,
        ad: extension.rate,
        q,
        v,
    };
    let axial_velocity = if dynamics.particle_following {
        extension.rate
    } else {
        0.0
    };
    let kinetic = motion.sum(
        |lever, velocity, offset, moves_out| {
            lever * velocity
                - if moves_out {
                    axial_velocity * offset
                } else {
                    0.0
                }
        },
        |turning| turning,
    );
    let [_, a2, _, b2] = axial(&Constants::new(arm, payload, dynamics), extension, dynamics);
    let [_, alpha, beta] = q;
    kinetic - (a2 * alpha * alpha + b2 * beta * beta) * v[0]
}
