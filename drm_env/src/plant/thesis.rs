//! The thesis' model with three degrees of freedom q = (theta, alpha, beta): slew angle and one
//! assumed mode a link, phi(u) = 3 u^2 - u^3 (appendix C). M q'' + C q' + K q + axial load = Q in
//! closed form; C is not symmetric because the length is prescribed.
//!
//! Every entry is a polynomial of the overlap's fraction s, of the length a and of 1/a, whose
//! coefficients are put together once an episode: a step evaluates them by Horner's rule. With
//! R = L2 + L1 s and c = L1 s, powers of s from the third on come from the overlap alone.

use crate::arm::{Arm, PayloadProperties};
use crate::plant::{Dynamics, TipTorque, Torques};
use crate::reference::Extension;
use crate::simd::{Lane, laned};

/// Coefficients of the matrices for one arm and payload; constant through an episode. Names ending in
/// `_s` multiply powers of s, in `_a` powers of a, in `_y` powers of 1/a.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Constants<T> {
    l1: T,
    inv_l1: T,
    /// L2 - L1: the overlap starts at c = a - (L2 - L1)
    protrusion: T,
    rho2: T,
    /// rho2 L1, rho2 L1^2
    rho2_l1: T,
    rho2_l1_squared: T,
    mp: T,
    /// Mp Lp and multiples
    mp_lp: T,
    mp_lp_3: T,
    mp_lp_6: T,
    /// multiples of J
    j_9: T,
    j_18: T,
    /// 3 Mp Lp L1 / 2 + 3 J
    overhang: T,
    mtt_a: [T; 3],
    mta_s: [T; 2],
    /// 2 rho2 L2 + 2 Mp: dMta/da at s = 0
    mta_slope: T,
    mtb_a: [T; 3],
    maa_s: [T; 2],
    mab_a: [T; 2],
    mbb_a: [T; 2],
    ctb_a: [T; 2],
    cbt_a: [T; 2],
    /// bending of both links over alpha
    bend_aa_s: [T; 4],
    /// 12 EI2
    bend_bb_y: T,
    /// A0 per negative acceleration a'', without and with s^3
    a0_s: [T; 2],
    a0_s3: [T; 4],
    a2_s: [T; 8],
    /// 24 Mp / 5, 24 Mp Lp / 5, 81 rho2 / 70
    b2: [T; 3],
    /// share of the tip torque that works on the slew angle: 1 or 0
    tip_on_slew: T,
    /// Kelvin-Voigt time constant, s
    damping: T,
}

laned!(Constants {
    l1,
    inv_l1,
    protrusion,
    rho2,
    rho2_l1,
    rho2_l1_squared,
    mp,
    mp_lp,
    mp_lp_3,
    mp_lp_6,
    j_9,
    j_18,
    overhang,
    mtt_a,
    mta_s,
    mta_slope,
    mtb_a,
    maa_s,
    mab_a,
    mbb_a,
    ctb_a,
    cbt_a,
    bend_aa_s,
    bend_bb_y,
    a0_s,
    a0_s3,
    a2_s,
    b2,
    tip_on_slew,
    damping,
});

/// G0(s) of the axial load, and the parts of G1 and G2 that depend on s.
const G0: [f64; 6] = [24.0 / 5.0, 0.0, 0.0, -12.0, 9.0, -9.0 / 5.0];
const G1: [f64; 7] = [33.0 / 10.0, 0.0, 0.0, 0.0, -9.0, 36.0 / 5.0, -3.0 / 2.0];
const G2: [f64; 8] = [
    87.0 / 35.0,
    0.0,
    0.0,
    0.0,
    0.0,
    -36.0 / 5.0,
    6.0,
    -9.0 / 7.0,
];

/// Coefficients of the product of two polynomials, plus `weight` times a third.
fn product<const N: usize>(x: &[f64], y: &[f64], weight: f64, z: &[f64]) -> [f64; N] {
    let mut sum = [0.0; N];
    for (i, x) in x.iter().enumerate() {
        for (j, y) in y.iter().enumerate() {
            sum[i + j] += x * y;
        }
    }
    for (sum, z) in sum.iter_mut().zip(z) {
        *sum += weight * z;
    }
    sum
}

impl Constants<f64> {
    /// From the arm, the true payload and the switches.
    pub fn new(arm: &Arm, payload: &PayloadProperties, dynamics: &Dynamics) -> Self {
        let (l1, l2) = (arm.link1.length, arm.link2.length);
        let (rho1, rho2) = (arm.link1.mass_per_length, arm.link2.mass_per_length);
        let (ei1, ei2) = (arm.link1.bending_stiffness, arm.link2.bending_stiffness);
        let (mp, lp, j) = (payload.mass, payload.length, payload.inertia_attachment);
        let (square, cube) = (l1 * l1, l1 * l1 * l1);
        let (mp_lp, protrusion) = (mp * lp, l2 - l1);
        let stiff = 12.0 * ei2 / cube;
        // rho2 R + Mp and Q = rho2 (L1^2 + a^2)/2 + Mp (Lp + a), as polynomials of s
        let pull = [rho2 * l2 + mp, rho2 * l1];
        let turning = [
            rho2 * (square + protrusion * protrusion) / 2.0 + mp * (lp + protrusion),
            (rho2 * protrusion + mp) * l1,
            rho2 * square / 2.0,
        ];
        let a0: [f64; 7] = product(&pull, &G0, -rho2 * l1, &G1).map(|c| c / l1);
        let a2: [f64; 8] = product(&turning, &G0, -rho2 * square / 2.0, &G2).map(|c| c / l1);
        Self {
            l1,
            inv_l1: 1.0 / l1,
            protrusion,
            rho2,
            rho2_l1: rho2 * l1,
            rho2_l1_squared: rho2 * square,
            mp,
            mp_lp,
            mp_lp_3: 3.0 * mp_lp,
            mp_lp_6: 6.0 * mp_lp,
            j_9: 9.0 * j,
            j_18: 18.0 * j,
            overhang: 1.5 * mp_lp * l1 + 3.0 * j,
            // r^3 - c^3 of link 2's two ends: l2 (3 r^2 - 3 r l2 + l2^2)
            mtt_a: [
                rho1 * cube / 3.0
                    + rho2 * l2 * (square - l1 * l2 + l2 * l2 / 3.0)
                    + mp * l1 * (l1 + lp)
                    + j,
                rho2 * l2 * (2.0 * l1 - l2) + mp * (2.0 * l1 + lp),
                rho2 * l2 + mp,
            ],
            mta_s: [
                11.0 / 20.0 * (rho1 + rho2) * square
                    + rho2 * (l2 * l2 - square)
                    + mp * (2.0 * l2 + lp),
                2.0 * (rho2 * l2 + mp) * l1,
            ],
            mta_slope: 2.0 * (rho2 * l2 + mp),
            mtb_a: [
                mp * (2.0 * l1 + 2.5 * lp),
                0.75 * rho2 * l1 + 2.0 * mp,
                0.55 * rho2,
            ],
            maa_s: [
                33.0 / 35.0 * (rho1 + rho2) * l1 + 4.0 * (rho2 * protrusion + mp),
                4.0 * rho2 * l1,
            ],
            mab_a: [4.0 * mp, 1.5 * rho2],
            mbb_a: [4.0 * mp, 33.0 / 35.0 * rho2],
            ctb_a: [2.0 * mp - 0.5 * rho2 * l1, 0.2 * rho2],
            cbt_a: [2.0 * (rho2 * l1 + mp), 2.0 * rho2],
            // 12 EI1 / L1^3 + 12 EI2 (1 - s)^3 / L1^3
            bend_aa_s: [12.0 * ei1 / cube + stiff, -3.0 * stiff, 3.0 * stiff, -stiff],
            bend_bb_y: 12.0 * ei2,
            a0_s: [a0[0], a0[1]],
            a0_s3: [a0[3], a0[4], a0[5], a0[6]],
            a2_s: a2,
            b2: [24.0 / 5.0 * mp, 24.0 / 5.0 * mp_lp, 81.0 / 70.0 * rho2],
            tip_on_slew: match dynamics.tip_torque {
                TipTorque::SlewAndTip => 1.0,
                TipTorque::TipOnly => 0.0,
            },
            damping: dynamics.structural_damping,
        }
    }
}

impl<T: Lane> Constants<T> {
    /// Rate that a torque of the tip wheel works on, rad/s: of the slew angle (rad/s), as far as it works on
    /// it, and of beta (m/s) at an extension (m).
    #[inline(always)]
    pub fn tip_turn_rate(&self, slew_rate: T, beta_rate: T, extension: T) -> T {
        (extension.recip() * 3.0).mul_add(beta_rate, self.tip_on_slew * slew_rate)
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

impl<T: Lane> Constants<T> {
    /// M, C, K and the axial load at a length with its rate and acceleration.
    ///
    /// `axial_load` switches the axial load on, `following` the particle-following correction.
    #[inline(always)]
    pub fn matrices(
        &self,
        extension: &Extension<T>,
        axial_load: bool,
        following: bool,
    ) -> Matrices<T> {
        let zero = T::splat(0.0);
        let Extension {
            length: a,
            rate: ad,
            accel: add,
        } = *extension;
        let y = a.recip();
        let s = (a - self.protrusion) * self.inv_l1;
        let s2 = s * s;
        let s3 = s2 * s;
        let g = s2.negated_mul_add(s, s2 * 3.0);

        // s + ... + s^4 of Mta above s^0: m1 s + rho2 L1^2 s^2 (1 - 3 s^2/4 + s^3/5)
        let fade = s2.mul_add(s.mul_add(T::splat(0.2), T::splat(-0.75)), T::splat(1.0));
        let mta = s.mul_add(
            (self.rho2_l1_squared * s).mul_add(fade, self.mta_s[1]),
            self.mta_s[0],
        );
        let mta_slope = self
            .rho2_l1
            .mul_add(s * s2.mul_add(s - 3.0, T::splat(2.0)), self.mta_slope);
        // s^5 (s - 9/5 - s^2/7)
        let tail = (s2 * s3)
            * s.mul_add(
                s.mul_add(T::splat(-1.0 / 7.0), T::splat(1.0)),
                T::splat(-1.8),
            );
        let maa = self.rho2_l1.mul_add(tail, s.polynomial(&self.maa_s));
        let bend_aa = s.polynomial(&self.bend_aa_s);
        let pressed = s3.mul_add(s.polynomial(&self.a0_s3), s.polynomial(&self.a0_s));
        let (a2, a2_slope) = if axial_load {
            self.turning(s)
        } else {
            (zero, zero)
        };

        let mtt = a.polynomial(&self.mtt_a);
        let mtt_slope = (self.mtt_a[2] * 2.0).mul_add(a, self.mtt_a[1]);
        let mtb = self.overhang.mul_add(y, a.polynomial(&self.mtb_a));
        let mab = self.mp_lp_3.mul_add(y, a.polynomial(&self.mab_a));
        let mbb = y.mul_add(self.j_9.mul_add(y, self.mp_lp_6), a.polynomial(&self.mbb_a));

        let y2 = y * y;
        let ad2 = ad * ad;
        let stretch = ad2 * y;
        // recurs in what the deployment adds to K: (2 a'^2/a - a'')/a^2
        let shift = y2 * (stretch * 2.0 - add);
        let slope_bb = shift * self.j_9.mul_add(y, self.mp_lp_3);
        let bend_bb = self.bend_bb_y * (y2 * y);

        let (ctt, ctb, cbt, cab, cba, cta, cat);
        let (kta, ktb, kaa, kab, kbb);
        let wide = self.rho2.mul_add(T::splat(4.0), -(self.rho2 * (g * g)));
        if following {
            let gs = s * 6.0 - s2 * 3.0;
            let g0 = s3.mul_add(
                s.mul_add(s.mul_add(T::splat(G0[5]), T::splat(G0[4])), T::splat(G0[3])),
                T::splat(G0[0]),
            );
            let quarter = s3.mul_add(s * 0.25 - 1.0, T::splat(0.75));
            let f = self.rho2_l1 * quarter + (self.rho2 * a + self.mp) * 2.0;
            let n = self.rho2_l1 * (T::splat(2.0) - s * g) - self.rho2_l1 * quarter - f;
            let mp_lp_y = self.mp_lp * y;
            cta = mta_slope + n;
            cat = f * 2.0;
            cab = self.rho2 * 3.0 - self.mp_lp_6 * y2;
            cba = zero;
            ctb =
                self.rho2_l1 * 1.5 + self.rho2 * a * 0.7 - mp_lp_y * 3.0 - self.overhang * 2.0 * y2;
            cbt = self.rho2 * a * 1.5 + self.mp * 4.0 + mp_lp_y * 3.0;
            kta = add * n + ad2 * self.rho2 * (g - s * gs - 2.0);
            ktb = shift * self.overhang + mp_lp_y * 3.0 * (stretch - add) - ad2 * self.rho2 * 0.4
                + add * (self.rho2_l1 * 0.75 - self.rho2 * a * 0.4 - self.mp * 2.0);
            kaa = bend_aa + add * wide * 0.5 - ad2 * self.rho2 * (g * gs + g0) * self.inv_l1;
            kab = shift * self.mp_lp_3 + add * self.rho2 * 1.5;
            kbb = bend_bb + slope_bb - stretch * self.rho2 * (24.0 / 35.0)
                + add * self.rho2 * (33.0 / 70.0);
        } else {
            let mp_lp_y = self.mp_lp * (y * 1.5);
            cta = mta_slope;
            cat = mta_slope;
            cab = -(self.mp_lp_6.mul_add(y2, self.rho2));
            cba = self.rho2 * 4.0;
            ctb = a.polynomial(&self.ctb_a) - (self.overhang * 2.0).mul_add(y2, mp_lp_y);
            cbt = a.polynomial(&self.cbt_a) + mp_lp_y;
            kta = zero;
            let bent = a.mul_add(T::splat(0.9), self.l1 * 1.25);
            ktb = shift.mul_add(self.overhang, mp_lp_y * (stretch - add))
                - self.rho2 * add.mul_add(bent, ad2 * 0.9);
            kaa = bend_aa;
            kab = shift.mul_add(self.mp_lp_3, -(self.rho2 * (add * 2.5)));
            kbb = (bend_bb + slope_bb)
                - self.rho2 * stretch.mul_add(T::splat(87.0 / 35.0), add * (107.0 / 70.0));
        }
        ctt = mtt_slope;

        let axial = if axial_load {
            Axial {
                a0: -(add * pressed),
                a2,
                a2_rate: ad * a2_slope,
                b0: -(add * self.b2[0].mul_add(y, self.rho2 * 1.5)),
                b2: self.b2[2].mul_add(a, self.b2[1].mul_add(y, self.b2[0])),
                b2_rate: ad * self.b2[1].negated_mul_add(y2, self.b2[2]),
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

        let cbb = y2.negated_mul_add(self.j_18.mul_add(y, self.mp_lp_6), self.mbb_a[1]);
        Matrices {
            mass: [[mtt, mta, mtb], [mta, maa, mab], [mtb, mab, mbb]],
            velocity: [
                [ad * ctt, ad * cta, ad * ctb],
                [ad * cat, ad.mul_add(wide, self.damping * bend_aa), ad * cab],
                [ad * cbt, ad * cba, ad.mul_add(cbb, self.damping * bend_bb)],
            ],
            stiffness: [[zero, kta, ktb], [zero, kaa, kab], [zero, zero, kbb]],
            axial,
            tip_slope: y * 3.0,
            tip_on_slew: self.tip_on_slew,
        }
    }

    /// A2 and dA2/da.
    #[inline(always)]
    fn turning(&self, s: T) -> (T, T) {
        let c = &self.a2_s;
        let (mut value, mut slope) = (c[7], c[7]);
        for i in (1..7).rev() {
            value = value.mul_add(s, c[i]);
            slope = slope.mul_add(s, value);
        }
        (value.mul_add(s, c[0]), slope * self.inv_l1)
    }
}

/// The matrices made ready for a step: the elastic block of M is inverted, since the axial load
/// enters the slew angle's pivot alone.
#[derive(Debug, Clone, Copy)]
pub struct Prepared<T> {
    velocity: [[T; 3]; 3],
    /// Row of the slew angle over alpha and beta.
    k_theta: [T; 2],
    /// Stiffness of alpha and beta with the part of the axial load that a'' makes.
    k_alpha: T,
    k_beta: T,
    k_cross: T,
    a2: T,
    a2_rate: T,
    b2: T,
    b2_rate: T,
    tip_slope: T,
    tip_on_slew: T,
    /// Inverse of the elastic block: alpha alpha, alpha beta, beta beta.
    inverse: [T; 3],
    /// The inverse times the coupling with the slew angle.
    coupling: [T; 2],
    /// The slew angle's pivot without the axial load.
    pivot: T,
}

laned!(Prepared {
    velocity,
    k_theta,
    k_alpha,
    k_beta,
    k_cross,
    a2,
    a2_rate,
    b2,
    b2_rate,
    tip_slope,
    tip_on_slew,
    inverse,
    coupling,
    pivot,
});

impl Prepared<f64> {
    /// All zero.
    pub(crate) const ZERO: Self = Self {
        velocity: [[0.0; 3]; 3],
        k_theta: [0.0; 2],
        k_alpha: 0.0,
        k_beta: 0.0,
        k_cross: 0.0,
        a2: 0.0,
        a2_rate: 0.0,
        b2: 0.0,
        b2_rate: 0.0,
        tip_slope: 0.0,
        tip_on_slew: 0.0,
        inverse: [0.0; 3],
        coupling: [0.0; 2],
        pivot: 0.0,
    };
}

impl<T: Lane> Prepared<T> {
    /// Inverts the elastic block.
    #[inline(always)]
    pub fn new(matrices: Matrices<T>) -> Self {
        let [[mtt, mta, mtb], [_, maa, mab], [_, _, mbb]] = matrices.mass;
        let per_determinant = mab.negated_mul_add(mab, maa * mbb).recip();
        let inverse = [
            mbb * per_determinant,
            -(mab * per_determinant),
            maa * per_determinant,
        ];
        let coupling = [
            inverse[0].mul_add(mta, inverse[1] * mtb),
            inverse[1].mul_add(mta, inverse[2] * mtb),
        ];
        let [[_, kta, ktb], [_, kaa, kab], [_, _, kbb]] = matrices.stiffness;
        let Axial {
            a0,
            a2,
            a2_rate,
            b0,
            b2,
            b2_rate,
        } = matrices.axial;
        Self {
            velocity: matrices.velocity,
            k_theta: [kta, ktb],
            k_alpha: kaa + a0,
            k_beta: kbb + b0,
            k_cross: kab,
            a2,
            a2_rate,
            b2,
            b2_rate,
            tip_slope: matrices.tip_slope,
            tip_on_slew: matrices.tip_on_slew,
            inverse,
            coupling,
            pivot: coupling[1].negated_mul_add(mtb, coupling[0].negated_mul_add(mta, mtt)),
        }
    }

    /// q'' (rad/s^2, m/s^2, m/s^2) from q, q' and the torques. Without `following` the particle-following
    /// correction's stiffness between theta and alpha is known to be zero.
    #[inline(always)]
    pub fn acceleration(
        &self,
        q: &[T; 3],
        v: &[T; 3],
        torques: &Torques<T>,
        following: bool,
    ) -> [T; 3] {
        let [[ctt, cta, ctb], [cat, caa, cab], [cbt, cba, cbb]] = self.velocity;
        let [kta, ktb] = self.k_theta;
        let [to_alpha, to_beta] = self.coupling;
        let [e_aa, e_ab, e_bb] = self.inverse;
        let [_, alpha, beta] = *q;
        let [rate, alpha_rate, beta_rate] = *v;

        let (alpha2, beta2) = (alpha * alpha, beta * beta);
        let per_pivot = self
            .b2
            .negated_mul_add(beta2, self.a2.negated_mul_add(alpha2, self.pivot))
            .recip();
        let (turned_alpha, turned_beta) = (self.a2 * alpha, self.b2 * beta);
        let rate2 = rate * rate;
        // half the Coriolis torque of the axial load per slew rate
        let coriolis = turned_alpha
            .mul_add(alpha_rate, turned_beta * beta_rate)
            .mul_add(
                T::splat(2.0),
                self.a2_rate.mul_add(alpha2, self.b2_rate * beta2),
            );
        let load = self.tip_on_slew.mul_add(torques.tip, torques.root) + torques.slew;
        let held = if following {
            kta.negated_mul_add(alpha, load)
        } else {
            load
        };
        let f_theta = rate.mul_add(
            coriolis - ctt,
            ktb.negated_mul_add(beta, held) - ctb.mul_add(beta_rate, cta * alpha_rate),
        );
        let f_alpha = turned_alpha.negated_mul_add(
            rate2,
            -(cat.mul_add(rate, caa * alpha_rate))
                - self
                    .k_alpha
                    .mul_add(alpha, cab.mul_add(beta_rate, self.k_cross * beta)),
        );
        let f_beta = turned_beta.negated_mul_add(
            rate2,
            cbt.negated_mul_add(rate, self.tip_slope * torques.tip)
                - self
                    .k_beta
                    .mul_add(beta, cba.mul_add(alpha_rate, cbb * beta_rate)),
        );

        let theta =
            to_beta.negated_mul_add(f_beta, to_alpha.negated_mul_add(f_alpha, f_theta)) * per_pivot;
        [
            theta,
            to_alpha.negated_mul_add(theta, e_aa.mul_add(f_alpha, e_ab * f_beta)),
            to_beta.negated_mul_add(theta, e_ab.mul_add(f_alpha, e_bb * f_beta)),
        ]
    }

    /// q'' where the shoulder is held so that the slew angle accelerates by `accel` (rad/s^2), and the
    /// torque that holds it (N m), in place of the slew motor's.
    pub fn held_acceleration(
        &self,
        q: &[T; 3],
        v: &[T; 3],
        torques: &Torques<T>,
        following: bool,
        accel: T,
    ) -> ([T; 3], T) {
        let free = Torques {
            slew: T::splat(0.0),
            ..*torques
        };
        let [theta, alpha, beta] = self.acceleration(q, v, &free, following);
        let (alpha2, beta2) = (q[1] * q[1], q[2] * q[2]);
        let pivot = self
            .b2
            .negated_mul_add(beta2, self.a2.negated_mul_add(alpha2, self.pivot));
        let change = accel - theta;
        let [to_alpha, to_beta] = self.coupling;
        let held = [
            accel,
            to_alpha.negated_mul_add(change, alpha),
            to_beta.negated_mul_add(change, beta),
        ];
        (held, change * pivot)
    }
}
