//! One implicit step of the consistent plant.

use serde::{Deserialize, Serialize};

use super::ConsistentPlant;
use super::field::{CAPACITY, Row};
use crate::implicit::{Balance, GeneralizedAlpha, Jump, Motion};
use crate::plant::Torques;
use crate::timeline::Piece;

/// What the plant was driven by at the end of its last step.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Drive {
    slew: f64,
    root: f64,
    tip: f64,
    extension_accel: f64,
}

/// State of the consistent plant: coordinates (theta, link 1, link 2), rad and m, their rates, and
/// what the integrator remembers. Entries beyond the plant's size are zero.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ConsistentState {
    /// Coordinates.
    pub q: [f64; CAPACITY],
    /// Rates, per second.
    pub v: [f64; CAPACITY],
    /// The integrator's acceleration, per second squared.
    a: [f64; CAPACITY],
    drive: Option<Drive>,
}

impl ConsistentState {
    /// At the beginning of a flight.
    pub fn new(q: [f64; CAPACITY], v: [f64; CAPACITY]) -> Self {
        Self {
            q,
            v,
            a: [0.0; CAPACITY],
            drive: None,
        }
    }

    /// Whether every coordinate, rate and acceleration is finite.
    pub fn is_finite(&self) -> bool {
        [&self.q, &self.v, &self.a]
            .into_iter()
            .flatten()
            .all(|x| x.is_finite())
    }
}

impl ConsistentPlant {
    /// Advances `state` by a step of length `h` (s) that begins `from` seconds after the start of
    /// `piece` and does not leave it, under torques at the beginning, middle and end of the step
    /// (N m). Torques and extension acceleration may jump between steps: second order is kept.
    /// The extension must be within the range of the tables.
    pub fn step(
        &self,
        scheme: &GeneralizedAlpha,
        state: &mut ConsistentState,
        torques: &[Torques<f64>; 3],
        piece: &Piece<f64>,
        from: f64,
        h: f64,
    ) {
        let step = match self.size() {
            3 => Self::step_of::<3>,
            4 => Self::step_of::<4>,
            5 => Self::step_of::<5>,
            6 => Self::step_of::<6>,
            7 => Self::step_of::<7>,
            8 => Self::step_of::<8>,
            9 => Self::step_of::<9>,
            10 => Self::step_of::<10>,
            11 => Self::step_of::<11>,
            12 => Self::step_of::<12>,
            13 => Self::step_of::<13>,
            14 => Self::step_of::<14>,
            15 => Self::step_of::<15>,
            16 => Self::step_of::<16>,
            _ => Self::step_of::<CAPACITY>,
        };
        step(self, scheme, state, torques, piece, from, h);
    }

    fn step_of<const N: usize>(
        &self,
        scheme: &GeneralizedAlpha,
        state: &mut ConsistentState,
        torques: &[Torques<f64>; 3],
        piece: &Piece<f64>,
        from: f64,
        h: f64,
    ) {
        let point = scheme.balance_point();
        let extension = piece.extension(from + point * h);
        let (a, ad, add) = (extension.length, extension.rate, extension.accel);
        let mut motion = Motion::<N> {
            q: leading(&state.q),
            v: leading(&state.v),
            a: leading(&state.a),
        };

        let mut still = [[[0.0; N]; N]; 3];
        self.still
            .evaluate(a, still.as_flattened_mut().as_flattened_mut());
        let [mut mass, bending, turning] = still;
        let mut velocity = bending.map(|row| row.map(|k| k * self.dynamics.structural_damping));
        let mut stiffness = bending;
        // the terms with theta'^2 and theta' as at the beginning; what they miss is corrected
        let rate = motion.v[0];
        let bent: [f64; N] = turning.map(|row| dot(&row, &motion.q));
        for i in 0..N {
            for j in 0..N {
                stiffness[i][j] -= rate * rate * turning[i][j];
            }
            velocity[0][i] += 2.0 * rate * bent[i];
        }
        let inertia = dot(&bent, &motion.q);
        mass[0][0] += inertia;
        let mut growth = [[0.0; N]; N];
        let mut inertia_rate = 0.0;
        let mut accel_change = [0.0; N];
        let change = state.drive.map_or(0.0, |drive| add - drive.extension_accel);
        if ad != 0.0 || add != 0.0 || change != 0.0 {
            let mut moving = [[[0.0; N]; N]; 4];
            self.moving
                .evaluate(a, moving.as_flattened_mut().as_flattened_mut());
            let [gyroscopic, accelerated, squared, turning_slope] = &moving;
            for i in 0..N {
                for j in 0..N {
                    velocity[i][j] += ad * gyroscopic[i][j];
                    stiffness[i][j] += add * accelerated[i][j] + ad * ad * squared[i][j];
                }
            }
            growth = turning_slope.map(|row| row.map(|z| z * ad));
            inertia_rate = dot(&growth.map(|row| dot(&row, &motion.q)), &motion.q);
            velocity[0][0] += inertia_rate;
            if change != 0.0 {
                accel_change = accelerated.map(|row| -change * dot(&row, &motion.q));
            }
        }

        // the parabola through the three torques
        let weights = [
            (1.0 - point) * (1.0 - 2.0 * point),
            4.0 * point * (1.0 - point),
            point * (2.0 * point - 1.0),
        ];
        let mean = |get: fn(&Torques<f64>) -> f64| -> f64 {
            torques
                .iter()
                .zip(weights)
                .map(|(torque, weight)| weight * get(torque))
                .sum()
        };
        let balanced = Torques {
            slew: mean(|t| t.slew),
            root: mean(|t| t.root),
            tip: mean(|t| t.tip),
        };
        let balance = Balance {
            mass,
            velocity,
            stiffness,
            force: leading(&self.load(&balanced, a)),
        };
        let [begin, _, end] = torques;
        let force;
        let jump = match state.drive {
            None => Jump::Start,
            Some(last) => {
                let new = Torques {
                    slew: begin.slew - last.slew,
                    root: begin.root - last.root,
                    tip: begin.tip - last.tip,
                };
                let steady = new.slew == 0.0 && new.root == 0.0 && new.tip == 0.0;
                if steady && change == 0.0 {
                    Jump::None
                } else {
                    let load = self.load(&new, a);
                    force = std::array::from_fn(|i| load[i] + accel_change[i]);
                    Jump::Force(&force)
                }
            }
        };
        scheme.step_corrected(&mut motion, &balance, jump, h, |found| {
            let Motion { q, v, a } = found;
            let now: [f64; N] = turning.map(|row| dot(&row, q));
            let faster = v[0] * v[0] - rate * rate;
            let mut missed: [f64; N] = now.map(|z| faster * z);
            let moves = if ad == 0.0 {
                0.0
            } else {
                dot(&growth.map(|row| dot(&row, q)), q)
            };
            missed[0] = (inertia - dot(&now, q)) * a[0]
                + 2.0 * (rate * dot(&bent, v) - v[0] * dot(&now, v))
                + (inertia_rate - moves) * v[0];
            Some(missed)
        });
        state.q[..N].copy_from_slice(&motion.q);
        state.v[..N].copy_from_slice(&motion.v);
        state.a[..N].copy_from_slice(&motion.a);
        state.drive = Some(Drive {
            slew: end.slew,
            root: end.root,
            tip: end.tip,
            extension_accel: add,
        });
    }
}

#[inline(always)]
fn leading<const N: usize>(row: &Row) -> [f64; N] {
    std::array::from_fn(|i| row[i])
}

#[inline(always)]
fn dot<const N: usize>(x: &[f64; N], y: &[f64; N]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}
