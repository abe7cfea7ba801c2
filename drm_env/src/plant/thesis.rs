//! The thesis' model with three degrees of freedom q = (theta, alpha, beta): slew angle and one
//! assumed mode a link, phi(u) = 3 u^2 - u^3 (appendix C). M q'' + C q' + K q + axial load = Q in
//! closed form; C is not symmetric because the length is prescribed.

use crate::arm::{Arm, PayloadProperties};
use crate::lane::{Lane, Pack};
use crate::plant::{Dynamics, Extension, TipTorque, Torques};

/// What the matrices need of arm, payload and switches; constant through an episode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Constants<T> {
    l1: T,
    inv_l1: T,
    /// L2 - L1: the overlap starts at c = a - (L2 - L1)
    protrusion: T,
    rho2: T,
    /// rho2 L1
    rho2_l1: T,
    mp: T,
    /// Mp Lp
    mp_lp: T,
    lp: T,
    j: T,
    /// rho1 parts of Mta and Maa
    mta_link1: T,
    maa_link1: T,
    /// rho1 L1^3 / 3 + J
    mtt_fixed: T,
    l2: T,
    /// 12 EI1 / L1^3, 12 EI2 / L1^3, 12 EI2
    kaa_link1: T,
    kaa_link2: T,
    kbb: T,
    /// share of the tip torque that works on the slew angle: 1 or 0
    tip_on_slew: T,
    /// Kelvin-Voigt time constant, s
    damping: T,
}

impl Constants<f64> {
    /// From the arm, the true payload and the switches.
    pub fn new(arm: &Arm, payload: &PayloadProperties, dynamics: &Dynamics) -> Self {
        let (l1, l2) = (arm.link1.length, arm.link2.length);
        let (rho1, rho2) = (arm.link1.mass_per_length, arm.link2.mass_per_length);
        let (ei1, ei2) = (arm.link1.bending_stiffness, arm.link2.bending_stiffness);
        let cube = l1 * l1 * l1;
        Self {
            l1,
            inv_l1: 1.0 / l1,
            protrusion: l2 - l1,
            rho2,
            rho2_l1: rho2 * l1,
            mp: payload.mass,
            mp_lp: payload.mass * payload.length,
            lp: payload.length,
            j: payload.inertia_attachment,
            mta_link1: 11.0 * rho1 * l1 * l1 / 20.0,
            maa_link1: 33.0 * rho1 * l1 / 35.0,
            mtt_fixed: rho1 * cube / 3.0 + payload.inertia_attachment,
            l2,
            kaa_link1: 12.0 * ei1 / cube,
            kaa_link2: 12.0 * ei2 / cube,
            kbb: 12.0 * ei2,
            tip_on_slew: match dynamics.tip_torque {
                TipTorque::SlewAndTip => 1.0,
                TipTorque::TipOnly => 0.0,
            },
            damping: dynamics.structural_damping,
        }
    }
}

/// The model's matrices at one length, row-major in the order (theta, alpha, beta).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Matrices<T> {
    /// Mass matrix M (symmetric): kg m^2, kg m, kg.
    pub mass: [[T; 3]; 3],
    /// Velocity matrix C.
    pub velocity: [[T; 3]; 3],
    /// Stiffness K: bending and deployment, without the axial load.
    pub stiffness: [[T; 3]; 3],
    /// Axial load; zero when it is switched off.
    pub axial: Axial<T>,
    /// 3/a: work of the tip torque on beta, 1/m.
    pub tip_slope: T,
    /// Share of the tip torque that works on the slew angle.
    pub tip_on_slew: T,
}

/// Coefficients of V = alpha^2 (A0 + A2 th'^2)/2 + beta^2 (B0 + B2 th'^2)/2 and their rates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axial<T> {
    /// A0, N/m.
    pub a0: T,
    /// A2, kg.
    pub a2: T,
    /// dA2/dt, kg/s.
    pub a2_rate: T,
    /// B0, N/m.
    pub b0: T,
    /// B2, kg.
    pub b2: T,
    /// dB2/dt, kg/s.
    pub b2_rate: T,
}

impl Constants<f64> {
    /// The same constants in every lane.
    #[inline(always)]
    pub(crate) fn spread<const N: usize>(&self) -> Constants<Pack<N>> {
        Constants {
            l1: Pack::splat(self.l1),
            inv_l1: Pack::splat(self.inv_l1),
            protrusion: Pack::splat(self.protrusion),
            rho2: Pack::splat(self.rho2),
            rho2_l1: Pack::splat(self.rho2_l1),
            mp: Pack::splat(self.mp),
            mp_lp: Pack::splat(self.mp_lp),
            lp: Pack::splat(self.lp),
            j: Pack::splat(self.j),
            mta_link1: Pack::splat(self.mta_link1),
            maa_link1: Pack::splat(self.maa_link1),
            mtt_fixed: Pack::splat(self.mtt_fixed),
            l2: Pack::splat(self.l2),
            kaa_link1: Pack::splat(self.kaa_link1),
            kaa_link2: Pack::splat(self.kaa_link2),
            kbb: Pack::splat(self.kbb),
            tip_on_slew: Pack::splat(self.tip_on_slew),
            damping: Pack::splat(self.damping),
        }
    }
}

impl<T: Lane> Constants<T> {
    /// M, C, K and the axial load at a length with its rate and acceleration.
    ///
    /// `AXIAL` switches the axial load on, `FOLLOW` the particle-following correction.
    #[inline(always)]
    pub fn matrices<const AXIAL: bool, const FOLLOW: bool>(
        &self,
        extension: &Extension<T>,
    ) -> Matrices<T> {
        let zero = T::splat(0.0);
        let Extension {
            length: a,
            rate: ad,
            accel: add,
        } = *extension;
        let (l1, rho2, rho2_l1) = (self.l1, self.rho2, self.rho2_l1);
        let (mp, mp_lp, j) = (self.mp, self.mp_lp, self.j);

        let ia = a.recip();
        let r = l1 + a;
        let s = (a - self.protrusion) * self.inv_l1;
        let s2 = s * s;
        let s3 = s2 * s;
        let s4 = s2 * s2;
        let s5 = s4 * s;
        let s6 = s4 * s2;
        let s7 = s4 * s3;
        let g = s2 * 3.0 - s3;
        let g2 = g * g;
        // 1 - c^3 ... of link 2's two ends: r^3 - c^3 = l2 (r^2 + r c + c^2)
        let c = r - self.l2;
        let cubes = self.l2 * (r * r + r * c + c * c);
        // overhang terms that recur
        let mp_lp_ia = mp_lp * ia;
        let overhang = (mp_lp * l1 * 3.0 + j * 6.0) * ia * ia;

        let mtt = self.mtt_fixed + rho2 * cubes * (1.0 / 3.0) + mp * r * (r + self.lp);
        let mta = self.mta_link1
            + rho2_l1 * l1 * (s5 * 0.2 - s4 * 0.75 + 0.55)
            + rho2 * (r * r - l1 * l1)
            + mp * r * 2.0
            + mp_lp;
        let mtb = rho2 * a * (l1 * 0.75 + a * 0.55)
            + mp * r * 2.0
            + mp_lp * 2.5
            + mp_lp_ia * l1 * 1.5
            + j * ia * 3.0;
        let maa = self.maa_link1
            + rho2_l1 * (s6 - s5 * 1.8 - s7 * (1.0 / 7.0) + 33.0 / 35.0)
            + (rho2 * a + mp) * 4.0;
        let mab = rho2 * a * 1.5 + mp * 4.0 + mp_lp_ia * 3.0;
        let mbb = rho2 * a * (33.0 / 35.0) + mp * 4.0 + mp_lp_ia * 6.0 + j * ia * ia * 9.0;

        let ctt = ad * (rho2 * (r * r - c * c) + mp * r * 2.0 + mp_lp);
        let mta_rate = ad * (rho2 * r * 2.0 + mp * 2.0 - rho2_l1 * s * g);
        let caa = ad * rho2 * (T::splat(4.0) - g2);
        let cbb = ad * (rho2 * (33.0 / 35.0) - mp_lp_ia * ia * 6.0 - j * ia * ia * ia * 18.0);

        let one_minus_s = T::splat(1.0) - s;
        let bend_aa = self.kaa_link1 + self.kaa_link2 * one_minus_s * one_minus_s * one_minus_s;
        let bend_bb = self.kbb * ia * ia * ia;
        let ad2 = ad * ad;

        let (cta, cat, cab, cba, ctb, cbt, kta, ktb, kaa, kab, kbb);
        if FOLLOW {
            let quarter = s4 * 0.25 - s3 + 0.75;
            let f = rho2_l1 * quarter + rho2 * a * 2.0 + mp * 2.0;
            let n = rho2_l1 * (T::splat(2.0) - s * g) - rho2_l1 * quarter - f;
            let gs = s * 6.0 - s2 * 3.0;
            let g0 = T::splat(24.0 / 5.0) - (s3 * 12.0 - s4 * 9.0 + s5 * 1.8);
            cta = mta_rate + ad * n;
            cat = ad * f * 2.0;
            cab = ad * (rho2 * 3.0 - mp_lp_ia * ia * 6.0);
            cba = zero;
            ctb = ad * (rho2_l1 * 1.5 + rho2 * a * 0.7 - mp_lp_ia * 3.0 - overhang);
            cbt = ad * (rho2 * a * 1.5 + mp * 4.0 + mp_lp_ia * 3.0);
            kta = add * n + ad2 * rho2 * (g - s * gs - 2.0);
            ktb = ad2 * (overhang * ia + mp_lp_ia * ia * 3.0 - rho2 * 0.4)
                + add
                    * (rho2_l1 * 0.75
                        - rho2 * a * 0.4
                        - mp * 2.0
                        - mp_lp_ia * 3.0
                        - overhang * 0.5);
            kaa = bend_aa
                + rho2 * (add * (T::splat(4.0) - g2) * 0.5 - ad2 * (g * gs + g0) * self.inv_l1);
            kab = ad2 * mp_lp_ia * ia * ia * 6.0 + add * (rho2 * 1.5 - mp_lp_ia * ia * 3.0);
            kbb = bend_bb
                + ad2 * ia * (j * ia * ia * ia * 18.0 + mp_lp_ia * ia * 6.0 - rho2 * (24.0 / 35.0))
                + add * (rho2 * (33.0 / 70.0) - j * ia * ia * ia * 9.0 - mp_lp_ia * ia * 3.0);
        } else {
            cta = mta_rate;
            cat = mta_rate;
            cab = -(ad * (rho2 + mp_lp_ia * ia * 6.0));
            cba = ad * rho2 * 4.0;
            ctb = ad * (rho2 * (a * 0.2 - l1 * 0.5) + mp * 2.0 - mp_lp_ia * 1.5 - overhang);
            cbt = ad * (rho2 * r * 2.0 + mp * 2.0 + mp_lp_ia * 1.5);
            kta = zero;
            ktb = ad2 * (mp_lp_ia * ia * 1.5 + overhang * ia - rho2 * 0.9)
                - add * (rho2 * (l1 * 1.25 + a * 0.9) + mp_lp_ia * 1.5 + overhang * 0.5);
            kaa = bend_aa;
            kab = ad2 * mp_lp_ia * ia * ia * 6.0 - add * (rho2 * 2.5 + mp_lp_ia * ia * 3.0);
            kbb = bend_bb
                + ad2 * ia * (j * ia * ia * ia * 18.0 + mp_lp_ia * ia * 6.0 - rho2 * (87.0 / 35.0))
                - add * (rho2 * (107.0 / 70.0) + mp_lp_ia * ia * 3.0 + j * ia * ia * ia * 9.0);
        }

        let axial = if AXIAL {
            let gs = s * 6.0 - s2 * 3.0;
            let gs2 = gs * gs;
            let g0 = T::splat(24.0 / 5.0) - (s3 * 12.0 - s4 * 9.0 + s5 * 1.8);
            let g1 = T::splat(3.3) - (s4 * 9.0 - s5 * 7.2 + s6 * 1.5);
            let g2 = T::splat(87.0 / 35.0) - (s5 * 7.2 - s6 * 6.0 + s7 * (9.0 / 7.0));
            let load = rho2 * (l1 * l1 + a * a) * 0.5 + mp_lp + mp * a;
            let inv_l1 = self.inv_l1;
            Axial {
                a0: -(add * inv_l1) * ((rho2 * r + mp) * g0 - rho2_l1 * g1),
                a2: (load * g0 - rho2_l1 * l1 * g2 * 0.5) * inv_l1,
                a2_rate: ad
                    * inv_l1
                    * ((rho2 * a + mp) * g0 - load * gs2 * inv_l1 + rho2_l1 * s2 * gs2 * 0.5),
                b0: -add * (mp * ia * (24.0 / 5.0) + rho2 * 1.5),
                b2: (mp + mp_lp_ia) * (24.0 / 5.0) + rho2 * a * (81.0 / 70.0),
                b2_rate: ad * (rho2 * (81.0 / 70.0) - mp_lp_ia * ia * (24.0 / 5.0)),
            }
        } else {
            Axial {
                a0: zero,
                a2: zero,
                a2_rate: zero,
                b0: zero,
                b2: zero,
                b2_rate: zero,
            }
        };

        Matrices {
            mass: [[mtt, mta, mtb], [mta, maa, mab], [mtb, mab, mbb]],
            velocity: [
                [ctt, cta, ctb],
                [cat, caa + self.damping * bend_aa, cab],
                [cbt, cba, cbb + self.damping * bend_bb],
            ],
            stiffness: [[zero, kta, ktb], [zero, kaa, kab], [zero, zero, kbb]],
            axial,
            tip_slope: ia * 3.0,
            tip_on_slew: self.tip_on_slew,
        }
    }
}

/// The matrices made ready for a step: the elastic block of M is factorised (M = L D L^T in the
/// order alpha, beta, theta), since the axial load enters the last pivot alone.
#[derive(Debug, Clone, Copy)]
pub struct Prepared<T> {
    matrices: Matrices<T>,
    inv_d_alpha: T,
    l_beta_alpha: T,
    inv_d_beta: T,
    l_theta_alpha: T,
    l_theta_beta: T,
    d_theta: T,
    /// Stiffness of alpha and beta with the part of the axial load that a'' makes.
    k_alpha: T,
    k_beta: T,
}

impl<const N: usize> Prepared<Pack<N>> {
    /// One lane.
    #[inline(always)]
    pub(crate) fn lane(&self, index: usize) -> Prepared<f64> {
        let grid = |rows: &[[Pack<N>; 3]; 3]| rows.map(|row| row.map(|value| value.0[index]));
        let Matrices {
            mass,
            velocity,
            stiffness,
            axial,
            tip_slope,
            tip_on_slew,
        } = &self.matrices;
        Prepared {
            matrices: Matrices {
                mass: grid(mass),
                velocity: grid(velocity),
                stiffness: grid(stiffness),
                axial: Axial {
                    a0: axial.a0.0[index],
                    a2: axial.a2.0[index],
                    a2_rate: axial.a2_rate.0[index],
                    b0: axial.b0.0[index],
                    b2: axial.b2.0[index],
                    b2_rate: axial.b2_rate.0[index],
                },
                tip_slope: tip_slope.0[index],
                tip_on_slew: tip_on_slew.0[index],
            },
            inv_d_alpha: self.inv_d_alpha.0[index],
            l_beta_alpha: self.l_beta_alpha.0[index],
            inv_d_beta: self.inv_d_beta.0[index],
            l_theta_alpha: self.l_theta_alpha.0[index],
            l_theta_beta: self.l_theta_beta.0[index],
            d_theta: self.d_theta.0[index],
            k_alpha: self.k_alpha.0[index],
            k_beta: self.k_beta.0[index],
        }
    }
}

impl<T: Lane> Prepared<T> {
    /// Factorises the elastic block.
    #[inline(always)]
    pub fn new(matrices: Matrices<T>) -> Self {
        let [[mtt, mta, mtb], [_, maa, mab], [_, _, mbb]] = matrices.mass;
        let inv_d_alpha = maa.recip();
        let l_beta_alpha = mab * inv_d_alpha;
        let inv_d_beta = (mbb - l_beta_alpha * mab).recip();
        let l_theta_alpha = mta * inv_d_alpha;
        let rest = mtb - l_theta_alpha * mab;
        let l_theta_beta = rest * inv_d_beta;
        Self {
            k_alpha: matrices.stiffness[1][1] + matrices.axial.a0,
            k_beta: matrices.stiffness[2][2] + matrices.axial.b0,
            matrices,
            inv_d_alpha,
            l_beta_alpha,
            inv_d_beta,
            l_theta_alpha,
            l_theta_beta,
            d_theta: mtt - l_theta_alpha * mta - l_theta_beta * rest,
        }
    }

    /// q'' (rad/s^2, m/s^2, m/s^2) from q, q' and the torques.
    #[inline(always)]
    pub fn acceleration(&self, q: &[T; 3], v: &[T; 3], torques: &Torques<T>) -> [T; 3] {
        let Matrices {
            velocity: c,
            stiffness: k,
            axial: x,
            ..
        } = &self.matrices;
        let [_, alpha, beta] = *q;
        let [rate, alpha_rate, beta_rate] = *v;
        let rate2 = rate * rate;
        let (alpha2, beta2) = (alpha * alpha, beta * beta);

        // Sums are paired and the last pivot is inverted beside them: one trajectory is bound by the
        // length of this chain, not by the number of operations.
        let inv_pivot = (self.d_theta - (x.a2 * alpha2 + x.b2 * beta2)).recip();
        let load = self.matrices.tip_on_slew * torques.tip + (torques.root + torques.slew);
        let coriolis = (x.a2 * alpha * alpha_rate + x.b2 * beta * beta_rate) * 2.0
            + (x.a2_rate * alpha2 + x.b2_rate * beta2);
        let f_theta = ((load - c[0][0] * rate) - (c[0][1] * alpha_rate + c[0][2] * beta_rate))
            + (rate * coriolis - (k[0][1] * alpha + k[0][2] * beta));
        let f_alpha = -((c[1][0] * rate + c[1][1] * alpha_rate)
            + (c[1][2] * beta_rate + k[1][2] * beta))
            - (self.k_alpha + x.a2 * rate2) * alpha;
        let f_beta = ((self.matrices.tip_slope * torques.tip - c[2][0] * rate)
            - (c[2][1] * alpha_rate + c[2][2] * beta_rate))
            - (self.k_beta + x.b2 * rate2) * beta;

        let z_beta = f_beta - self.l_beta_alpha * f_alpha;
        let z_theta = (f_theta - self.l_theta_alpha * f_alpha) - self.l_theta_beta * z_beta;
        let theta = z_theta * inv_pivot;
        let beta = z_beta * self.inv_d_beta - self.l_theta_beta * theta;
        let alpha =
            (f_alpha * self.inv_d_alpha - self.l_theta_alpha * theta) - self.l_beta_alpha * beta;
        [theta, alpha, beta]
    }
}
