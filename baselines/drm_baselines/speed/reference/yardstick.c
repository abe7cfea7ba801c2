// The thesis plant by hand: slew angle theta, link modes alpha and beta, integrated by the classical
// Runge-Kutta method along the open-loop manoeuvre (Payload 1, 50 deg in minimum time at
// 0.02 rad/s^2, 1 m to 8 m). Plain C, as somebody would write it who wants this one program fast.
//
// cc -O3 -march=native -ffast-math -DLANES=8 -DAXIAL=1 yardstick.c -lm && ./a.out REPETITIONS
//
// LANES: manoeuvres flown side by side (1 or a power of two; vector extensions of GCC and clang).
// AXIAL: 1 with the axial load of the thesis' section 2.4, 0 without.
// Prints one JSON object: the best time of all repetitions, and where the manoeuvre ends.

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#ifndef LANES
#define LANES 1
#endif
#ifndef AXIAL
#define AXIAL 1
#endif

#if LANES == 1
typedef double real;
#else
typedef double real __attribute__((vector_size(8 * LANES)));
#endif

// Arm: lengths m, masses per length kg/m, bending stiffnesses N m^2.
static const double L1 = 7.0, L2 = 8.0;
static const double RHO1 = 100.0 / 7.0, RHO2 = 75.0 / 8.0;
static const double EI1 = 2.5e6, EI2 = 3.0e6;
static const double MAX_STEP = 5e-4, SAMPLE = 2e-3;

// Payload: mass kg, length m, inertia about its attachment kg m^2; and the wheels' torques, N m.
struct plant { real mass, length, inertia, root, tip; };

// One half of the manoeuvre, as polynomials in the time since it began.
struct half { real rate, accel, extension, extension_rate, extension_accel; };

struct state { real theta, alpha, beta, theta_rate, alpha_rate, beta_rate; };

// Everything that depends on the instant alone.
struct instant {
    real load, tip_load;                          // generalised forces of motor and wheels
    real e_aa, e_ab, e_bb;                        // inverse of the elastic part of the mass matrix
    real w_a, w_b, pivot;                         // that inverse times the coupling; what is left of Mtt
    real ctt, cta, ctb, cbt, caa, cab, cba, cbb;  // velocity terms; Cat = Cta
    real ktb, kaa, kab, kbb;                      // stiffness
#if AXIAL
    real a2, a2_rate, b2, b2_rate;
#endif
};

static inline struct instant at(const struct plant *p, const struct half *h, real u)
{
    struct instant i;
    const real m = p->mass, l = p->length, j = p->inertia, ml = m * l;

    const real a = h->extension + u * (h->extension_rate + 0.5 * u * h->extension_accel);
    const real ad = h->extension_rate + u * h->extension_accel, add = h->extension_accel;
    const real ia = 1.0 / a, ia2 = ia * ia, ad2 = ad * ad;
    const real r = L1 + a, c = a - (L2 - L1), s = c / L1;
    const real s2 = s * s, s3 = s2 * s, s4 = s2 * s2, s5 = s4 * s, s6 = s3 * s3, s7 = s4 * s3;
    const real g = 3.0 * s2 - s3;

    // mass matrix
    const real mtt = RHO1 * L1 * L1 * L1 / 3.0 + RHO2 / 3.0 * (r * r * r - c * c * c) + m * r * (r + l) + j;
    const real mta = 11.0 / 20.0 * RHO1 * L1 * L1
        + RHO2 * L1 * L1 * (11.0 / 20.0 - 0.75 * s4 + 0.2 * s5)
        + RHO2 * (r * r - L1 * L1) + m * (2.0 * r + l);
    const real mtb = RHO2 * (0.75 * L1 * a + 0.55 * a * a) + 2.0 * m * r + 2.5 * ml
        + 1.5 * L1 * ml * ia + 3.0 * j * ia;
    const real maa = 33.0 / 35.0 * RHO1 * L1
        + RHO2 * L1 * (33.0 / 35.0 - 1.8 * s5 + s6 - s7 / 7.0) + 4.0 * (RHO2 * a + m);
    const real mab = 1.5 * RHO2 * a + 4.0 * m + 3.0 * ml * ia;
    const real mbb = 33.0 / 35.0 * RHO2 * a + 4.0 * m + 6.0 * ml * ia + 9.0 * j * ia2;

    const real inverse = 1.0 / (maa * mbb - mab * mab);
    i.e_aa = mbb * inverse;
    i.e_ab = -mab * inverse;
    i.e_bb = maa * inverse;
    i.w_a = i.e_aa * mta + i.e_ab * mtb;
    i.w_b = i.e_ab * mta + i.e_bb * mtb;
    i.pivot = mtt - i.w_a * mta - i.w_b * mtb;

    // velocity terms
    const real inertia_slope = RHO2 * (r * r - c * c) + m * (2.0 * r + l);
    const real overhang = (3.0 * L1 * ml + 6.0 * j) * ia2;
    i.ctt = ad * inertia_slope;
    i.cta = ad * (2.0 * RHO2 * r + 2.0 * m - RHO2 * L1 * s * g);
    i.ctb = ad * (RHO2 * (0.2 * a - 0.5 * L1) + 2.0 * m - 1.5 * ml * ia - overhang);
    i.cbt = ad * (2.0 * RHO2 * r + 2.0 * m + 1.5 * ml * ia);
    i.caa = ad * RHO2 * (4.0 - g * g);
    i.cab = -ad * (RHO2 + 6.0 * ml * ia2);
    i.cba = 4.0 * RHO2 * ad;
    i.cbb = ad * (33.0 / 35.0 * RHO2 - 6.0 * ml * ia2 - 18.0 * j * ia2 * ia);

    // stiffness
    const real free = 1.0 - s;
    i.ktb = ad2 * (1.5 * ml * ia2 + overhang * ia - 0.9 * RHO2)
        - add * (RHO2 * (1.25 * L1 + 0.9 * a) + 1.5 * ml * ia + 0.5 * overhang);
    i.kaa = 12.0 * EI1 / (L1 * L1 * L1) + 12.0 * EI2 / (L1 * L1 * L1) * free * free * free;
    i.kab = 6.0 * ml * ad2 * ia2 * ia - add * (2.5 * RHO2 + 3.0 * ml * ia2);
    i.kbb = 12.0 * EI2 * ia2 * ia
        + ad2 * ia * (6.0 * ml * ia2 + 18.0 * j * ia2 * ia - 87.0 / 35.0 * RHO2)
        - add * (107.0 / 70.0 * RHO2 + 3.0 * ml * ia2 + 9.0 * j * ia2 * ia);

#if AXIAL
    const real gs = 6.0 * s - 3.0 * s2;
    const real g0 = 4.8 - (12.0 * s3 - 9.0 * s4 + 1.8 * s5);
    const real g1 = 3.3 - (9.0 * s4 - 7.2 * s5 + 1.5 * s6);
    const real g2 = 87.0 / 35.0 - (7.2 * s5 - 6.0 * s6 + 9.0 / 7.0 * s7);
    const real q = 0.5 * RHO2 * (L1 * L1 + a * a) + m * (l + a);
    i.kaa -= add / L1 * ((RHO2 * r + m) * g0 - RHO2 * L1 * g1);
    i.kbb -= add * (4.8 * m * ia + 1.5 * RHO2);
    i.a2 = (q * g0 - 0.5 * RHO2 * L1 * L1 * g2) / L1;
    i.a2_rate = ad / L1 * ((RHO2 * a + m) * g0 - q * gs * gs / L1 + 0.5 * RHO2 * L1 * s2 * gs * gs);
    i.b2 = 4.8 * m * (1.0 + l * ia) + 81.0 / 70.0 * RHO2 * a;
    i.b2_rate = ad * (81.0 / 70.0 * RHO2 - 4.8 * ml * ia2);
#endif

    // the motor turns the rigid arm along the reference
    const real slew = mtt * h->accel + inertia_slope * ad * (h->rate + u * h->accel);
    i.load = slew + p->root + p->tip;
    i.tip_load = 3.0 * ia * p->tip;
    return i;
}

static inline struct state slope(const struct instant *i, const struct state *y)
{
    const real w = y->theta_rate, al = y->alpha, be = y->beta, ar = y->alpha_rate, br = y->beta_rate;
    real pivot = i->pivot;
    real ft = i->load - i->ctt * w - i->cta * ar - i->ctb * br - i->ktb * be;
    real fa = -i->cta * w - i->caa * ar - i->cab * br - i->kaa * al - i->kab * be;
    real fb = i->tip_load - i->cbt * w - i->cba * ar - i->cbb * br - i->kbb * be;
#if AXIAL
    pivot -= i->a2 * al * al + i->b2 * be * be;
    ft += w * (2.0 * (i->a2 * al * ar + i->b2 * be * br) + i->a2_rate * al * al + i->b2_rate * be * be);
    fa -= i->a2 * w * w * al;
    fb -= i->b2 * w * w * be;
#endif
    const real theta = (ft - i->w_a * fa - i->w_b * fb) / pivot;
    return (struct state){
        w, ar, br, theta,
        i->e_aa * fa + i->e_ab * fb - i->w_a * theta,
        i->e_ab * fa + i->e_bb * fb - i->w_b * theta,
    };
}

static inline struct state plus(const struct state *y, real h, const struct state *k)
{
    return (struct state){
        y->theta + h * k->theta, y->alpha + h * k->alpha, y->beta + h * k->beta,
        y->theta_rate + h * k->theta_rate, y->alpha_rate + h * k->alpha_rate,
        y->beta_rate + h * k->beta_rate,
    };
}

static inline struct state step(const struct state *y, real h, const struct instant *begin,
                                const struct instant *middle, const struct instant *end)
{
    const struct state k1 = slope(begin, y), y2 = plus(y, 0.5 * h, &k1);
    const struct state k2 = slope(middle, &y2), y3 = plus(y, 0.5 * h, &k2);
    const struct state k3 = slope(middle, &y3), y4 = plus(y, h, &k3);
    const struct state k4 = slope(end, &y4);
    struct state next = plus(y, h / 6.0, &k1);
    next = plus(&next, h / 3.0, &k2);
    next = plus(&next, h / 3.0, &k3);
    return plus(&next, h / 6.0, &k4);
}

// Equal steps under held torques within one half of the manoeuvre; returns their number.
static int leg(const struct plant *p, const struct half *half, double from, double span, struct state *y)
{
    const int steps = (int)ceil(span / MAX_STEP - 1e-6);
    const real zero = {0}, h = zero + span / steps;
    real u = zero + from;
    struct instant begin = at(p, half, u);
    for (int n = 0; n < steps; n++) {
        const struct instant middle = at(p, half, u + 0.5 * h), end = at(p, half, u + h);
        *y = step(y, h, &begin, &middle, &end);
        begin = end;
        u += h;
    }
    return steps;
}

static double lane(real value)
{
#if LANES == 1
    return value;
#else
    return value[0];
#endif
}

static double seconds(void)
{
    struct timespec t;
    timespec_get(&t, TIME_UTC);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

int main(int argc, char **argv)
{
    const int repetitions = argc > 1 ? atoi(argv[1]) : 5;
    const double angle = 50.0 * acos(-1.0) / 180.0, max_accel = 0.02, from = 1.0, to = 8.0;
    const double duration = sqrt(4.0 * angle / max_accel), middle = 0.5 * duration;
    const double extension_accel = 4.0 * (to - from) / (duration * duration);
    const int samples = (int)floor(duration / SAMPLE);

    // The compiler must not know that all lanes fly the same, nor that no torque is applied.
    volatile double zero = 0.0, mass = 200.0, length = 1.0, inertia = 200.0 * (4.0 + 0.25) / 12.0;
    const real none = {0};
    struct plant plant = {none + mass, none + length, none + inertia, none, none};
#if LANES > 1
    for (int n = 0; n < LANES; n++) {
        plant.mass[n] = mass;
        plant.length[n] = length;
        plant.inertia[n] = inertia;
        plant.root[n] = zero;
        plant.tip[n] = zero;
    }
#else
    plant.root = plant.tip = zero;
#endif
    const struct half halves[2] = {
        {none, none + max_accel, none + from, none, none + extension_accel},
        {none + max_accel * middle, none - max_accel, none + 0.5 * (from + to),
         none + extension_accel * middle, none - extension_accel},
    };

    struct state y = {none, none, none, none, none, none};
    double best = INFINITY;
    long steps = 0;
    for (int repetition = 0; repetition < repetitions; repetition++) {
        y = (struct state){none, none, none, none, none, none};
        steps = 0;
        const double before = seconds();
        for (int sample = 0; sample < samples; sample++) {
            const double start = sample * SAMPLE, stop = (sample + 1) * SAMPLE;
            if (start < middle && middle < stop) {
                steps += leg(&plant, &halves[0], start, middle - start, &y);
                steps += leg(&plant, &halves[1], 0.0, stop - middle, &y);
            } else {
                const int second = start >= middle;
                steps += leg(&plant, &halves[second], second ? start - middle : start, stop - start, &y);
            }
        }
        const double spent = (seconds() - before) / (double)(steps * LANES);
        if (spent < best)
            best = spent;
    }
    printf("{\"lanes\": %d, \"axial\": %d, \"ns_per_step\": %.6g, \"steps\": %ld, \"samples\": %d, "
           "\"slew_angle\": %.17g, \"tip_deflection\": %.17g}\n",
           LANES, AXIAL, best * 1e9, steps, samples, lane(y.theta), lane(2.0 * (y.alpha + y.beta)));
    return 0;
}
