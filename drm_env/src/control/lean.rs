//! Torques that keep an arm with small wheels in its place over a manoeuvre that asks more of them (not in the thesis).
//!
//! The slew motor gives what the *reported* arm needs. What the true payload takes beyond that, the lack, is the wheels' to
//! give, and where it is more than they have the arm falls behind. The lack follows from the manoeuvre and the mass, so
//! it is known beforehand: an arm that has leant out to the other side by then ends nearer to where it should be.
//!
//! As a whole the arm is an inertia on two wheels, p' = u - lack, p = J e', |u| at most the wheels' limit. What
//! minimises the square of the tip's way from its place, with a price of the torque beside the lack, is a convex programme
//! of one bounded input. It is solved from where the arm is, again and again, by an interior-point method whose step is a
//! Riccati recursion (Rao, Wright and Rawlings 1998): the time of one grows with the instants, not with their cube.

use super::servo::ServoModel;

/// Least time between two instants of a plan, s.
const PERIOD: f64 = 0.1;
/// Most intervals of a plan.
const MOST: usize = 100;
/// Time after the slew that a plan looks ahead, s.
const AFTER: f64 = 3.0;
/// Way of the tip that the wheels' whole torque beside the lack is worth, m.
const PRICE: f64 = 4e-3;
/// Time between two plans, s.
pub(crate) const AGAIN: f64 = 0.1;
/// Most iterations of a programme; twenty are usual.
const ITERATIONS: usize = 60;
/// What may be left to gain, as a part of the cost.
const ACCURACY: f64 = 1e-7;
/// How far an iteration aims to lower the prices of the limits.
const CENTRING: f64 = 0.1;
/// Part of the way to a limit that an iteration may go.
const TO_THE_EDGE: f64 = 0.99;

/// A linear arm over equal intervals: state (e, p).
#[derive(Debug, Clone)]
struct Programme {
    /// State at the beginning.
    start: State,
    period: f64,
    /// Moment of inertia within each interval, kg m^2.
    inertia: Vec<f64>,
    /// Torque that is lacking within each interval, N m.
    lack: Vec<f64>,
    /// Square of the reach at each interval's end, m^2.
    weight: Vec<f64>,
    /// Torque limit, N m.
    limit: f64,
}

/// State at an instant: angle (rad) and angular momentum (N m s).
type State = [f64; 2];

impl Programme {
    /// (angle per momentum, angle per torque, momentum per torque) of an interval.
    fn gains(&self, k: usize) -> (f64, [f64; 2]) {
        let through = self.period / self.inertia[k];
        (through, [0.5 * self.period * through, self.period])
    }

    fn next(&self, k: usize, [angle, momentum]: State, torque: f64) -> State {
        let (through, [of_angle, of_momentum]) = self.gains(k);
        let net = torque - self.lack[k];
        [
            through.mul_add(momentum, of_angle.mul_add(net, angle)),
            of_momentum.mul_add(net, momentum),
        ]
    }

    /// What the wheels have of a lack, N m.
    fn ready(&self, lack: f64) -> f64 {
        lack.clamp(-self.limit, self.limit)
    }

    fn price(&self) -> f64 {
        (PRICE / self.limit) * (PRICE / self.limit)
    }

    /// Angles at the ends of the intervals, rad, and the arm's momentum there, N m s.
    fn states(&self, torques: &[f64]) -> Vec<State> {
        let mut state = self.start;
        let next = torques.iter().enumerate().map(|(k, torque)| {
            state = self.next(k, state, *torque);
            state
        });
        next.collect()
    }

    /// What torques and the angles under them cost, m^2.
    fn cost(&self, torques: &[f64], states: &[State]) -> f64 {
        let ways = self.weight.iter().zip(states);
        let ways: f64 = ways
            .map(|(weight, [angle, _])| weight * angle * angle)
            .sum();
        let beside = torques.iter().zip(&self.lack);
        let prices: f64 = beside
            .map(|(u, lack)| (u - self.ready(*lack)).powi(2))
            .sum();
        ways + self.price() * prices
    }

    /// Half of the cost's derivative by each torque.
    fn slope(&self, torques: &[f64], states: &[State]) -> Vec<f64> {
        let mut slope = vec![0.0; torques.len()];
        let mut adjoint = [0.0; 2];
        for k in (0..torques.len()).rev() {
            let (through, [a, b]) = self.gains(k);
            adjoint[0] += self.weight[k] * states[k][0];
            let beside = torques[k] - self.ready(self.lack[k]);
            slope[k] = self.price() * beside + adjoint[0] * a + adjoint[1] * b;
            adjoint[1] += through * adjoint[0];
        }
        slope
    }

    /// Newton's step of the torques against `slope`, where `stiff` is added to the price of each.
    fn step(&self, slope: &[f64], stiff: &[f64]) -> Vec<f64> {
        let count = slope.len();
        let mut feedback = vec![(0.0, [0.0; 2]); count];
        let ([mut s0, mut s1], [mut xx, mut xy, mut yy]) = ([0.0; 2], [0.0; 3]);
        for k in (0..count).rev() {
            let (through, [a, b]) = self.gains(k);
            xx += self.weight[k];
            let along = [xx * a + xy * b, xy * a + yy * b];
            let of_torque = slope[k] + s0 * a + s1 * b;
            let square = self.price() + stiff[k] + along[0] * a + along[1] * b;
            let mixed = [along[0], through.mul_add(along[0], along[1])];
            let step = -of_torque / square;
            feedback[k] = (step, mixed.map(|value| -value / square));
            let turned = through.mul_add(xx, xy);
            (s0, s1) = (
                s0 + mixed[0] * step,
                through.mul_add(s0, s1) + mixed[1] * step,
            );
            (xx, xy, yy) = (
                xx - mixed[0] * mixed[0] / square,
                turned - mixed[0] * mixed[1] / square,
                through.mul_add(xy + turned, yy) - mixed[1] * mixed[1] / square,
            );
        }
        let mut away = [0.0; 2];
        let steps = feedback.iter().enumerate().map(|(k, (step, gains))| {
            let step = step + gains[0] * away[0] + gains[1] * away[1];
            let (through, [a, b]) = self.gains(k);
            away = [
                through.mul_add(away[1], a.mul_add(step, away[0])),
                b.mul_add(step, away[1]),
            ];
            step
        });
        steps.collect()
    }

    /// The best torques and the states under them.
    fn solve(&self) -> (Vec<f64>, Vec<State>) {
        let (count, limit) = (self.lack.len(), self.limit);
        let mut torques: Vec<f64> = self.lack.iter().map(|x| 0.9 * self.ready(*x)).collect();
        let mut states = self.states(&torques);
        let mut slope = self.slope(&torques, &states);
        let whole = 2.0 * count as f64;
        let start = slope.iter().map(|x| x.abs()).sum::<f64>() / count as f64;
        // prices of the limits, above and below
        let mut duals = vec![[start; 2]; count];
        for _ in 0..ITERATIONS {
            let rooms: Vec<[f64; 2]> = torques.iter().map(|u| [limit - u, limit + u]).collect();
            let pairs = rooms.iter().zip(&duals);
            let gap: f64 = pairs
                .map(|(room, dual)| room[0] * dual[0] + room[1] * dual[1])
                .sum();
            if gap <= ACCURACY * self.cost(&torques, &states) + f64::MIN_POSITIVE {
                break;
            }
            let aim = CENTRING * gap / whole;
            let (mut stiff, mut against) = (Vec::with_capacity(count), Vec::with_capacity(count));
            for ((room, dual), slope) in rooms.iter().zip(&duals).zip(&slope) {
                stiff.push(dual[0] / room[0] + dual[1] / room[1]);
                against.push(slope + aim / room[0] - aim / room[1]);
            }
            let steps = self.step(&against, &stiff);
            let (mut changes, mut part) = (Vec::with_capacity(count), 1.0_f64);
            for ((room, dual), step) in rooms.iter().zip(&duals).zip(&steps) {
                let moved = [-step, *step];
                let change = [0, 1].map(|i| (aim - (room[i] + moved[i]) * dual[i]) / room[i]);
                for i in 0..2 {
                    for (value, change) in [(room[i], moved[i]), (dual[i], change[i])] {
                        if change < 0.0 {
                            part = part.min(TO_THE_EDGE * value / -change);
                        }
                    }
                }
                changes.push(change);
            }
            for (torque, step) in torques.iter_mut().zip(&steps) {
                *torque += part * step;
            }
            for (dual, change) in duals.iter_mut().zip(&changes) {
                for i in 0..2 {
                    dual[i] += part * change[i];
                }
            }
            states = self.states(&torques);
            slope = self.slope(&torques, &states);
        }
        (torques, states)
    }
}

/// What a manoeuvre prescribes at an instant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Prescribed {
    /// Extension, m, and its rate, m/s.
    pub extension: [f64; 2],
    /// Rate (rad/s) and acceleration (rad/s^2) of the slew.
    pub slew: [f64; 2],
}

/// Torque of both wheels now, N m, by a plan from `time` (s) on over a manoeuvre whose slew ends at `slew_end` (s), for the
/// inertias that the servo's model has at an error of the reported mass. `error` is where the arm is, rad, and at which
/// rate it leaves it, rad/s; `share` is the part of the wheels' torque that the plan counts on.
pub(crate) fn planned_torque(
    at: impl Fn(f64) -> Prescribed,
    (time, slew_end): (f64, f64),
    model: &ServoModel<f64>,
    (mass_error, error): (f64, [f64; 2]),
    share: f64,
) -> f64 {
    let ahead = (slew_end - time).max(0.0) + AFTER;
    let count = (ahead / PERIOD).ceil().clamp(1.0, MOST as f64) as usize;
    let period = (ahead / count as f64).max(PERIOD);
    let [angle, rate] = error;
    let mut programme = Programme {
        start: [
            angle,
            rate * model.inertia(at(time).extension[0], mass_error),
        ],
        period,
        inertia: Vec::with_capacity(count),
        lack: Vec::with_capacity(count),
        weight: Vec::with_capacity(count),
        limit: model.torque_limit() * share,
    };
    for k in 0..count {
        let middle = (k as f64 + 0.5).mul_add(period, time);
        let Prescribed { extension, slew } = at(middle);
        let inertia = model.inertia(extension[0], mass_error);
        programme.inertia.push(inertia);
        let lack = model.lack(extension, slew);
        programme.lack.push(lack * mass_error);
        let reach = model.reach(at(middle + 0.5 * period).extension[0]);
        programme.weight.push(reach * reach);
    }
    if !programme.start.iter().all(|x| x.is_finite()) {
        return f64::NAN;
    }
    programme.solve().0[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn programme(lack: impl Fn(usize) -> f64, count: usize) -> Programme {
        Programme {
            start: [0.0; 2],
            period: 0.1,
            inertia: vec![5e4; count],
            lack: (0..count).map(lack).collect(),
            weight: vec![225.0; count],
            limit: 100.0,
        }
    }

    fn most(states: &[State]) -> f64 {
        states
            .iter()
            .map(|state| state[0].abs())
            .fold(0.0, f64::max)
    }

    /// Where the wheels suffice, their torque is the lack, and the arm leans by less than the torque's price.
    #[test]
    fn an_arm_whose_wheels_suffice_does_not_lean() {
        let programme = programme(|k| 90.0 * (k as f64 * 0.1).sin(), 200);
        let (torques, states) = programme.solve();
        assert!(15.0 * most(&states) < PRICE, "{}", most(&states));
        let apart = torques
            .iter()
            .zip(&programme.lack)
            .map(|(u, lack)| (u - lack).abs());
        // but for the last seconds, which nothing comes after
        assert!(apart.take(150).fold(0.0, f64::max) < 5.0);
        assert_eq!(most(&programme_of_nothing().solve().1), 0.0);
    }

    fn programme_of_nothing() -> Programme {
        programme(|_| 0.0, 50)
    }

    /// Karush, Kuhn and Tucker: the cost, taken from flights alone, falls along no torque that may move.
    #[test]
    fn no_torque_that_may_move_makes_it_better() {
        let programme = programme(|k| if (60..120).contains(&k) { 160.0 } else { -20.0 }, 200);
        let (torques, states) = programme.solve();
        let cost = |torques: &[f64]| programme.cost(torques, &programme.states(torques));
        let best = cost(&torques);
        for k in 0..200 {
            for step in [-1.0, 1.0] {
                let mut tried = torques.clone();
                tried[k] = (tried[k] + step).clamp(-100.0, 100.0);
                assert!(cost(&tried) > best * (1.0 - 1e-7), "{k}");
            }
        }
        assert!(torques.iter().all(|torque| torque.abs() < 100.0));
        // it leans out to the other side beforehand
        let (before, after) = states.split_at(90);
        let far = |states: &[State], sign: f64| {
            states
                .iter()
                .map(|state| sign * state[0])
                .fold(f64::MIN, f64::max)
        };
        let scale = most(&states);
        assert!(far(before, 1.0) > 0.3 * scale && far(after, -1.0) > 0.3 * scale);
        let idle: Vec<f64> = programme
            .lack
            .iter()
            .map(|x| x.clamp(-100.0, 100.0))
            .collect();
        assert!(best < 0.1 * cost(&idle), "{best}");
    }

    /// One interval is a parabola: u - lack = -w a e / (price + w a^2), within the limit.
    #[test]
    fn a_single_interval_is_a_parabola() {
        for (angle, limited) in [(2e-5, false), (-2e-5, false), (-1e-2, true)] {
            let mut programme = programme(|_| 40.0, 1);
            programme.start = [angle, 0.0];
            let (_, [a, _]) = programme.gains(0);
            let weight = programme.weight[0];
            let beside = -weight * a * angle / (programme.price() + weight * a * a);
            assert_eq!(limited, 40.0 + beside > 100.0, "{beside}");
            let expected = (40.0 + beside).min(100.0);
            let (torques, _) = programme.solve();
            let off = (torques[0] - expected).abs();
            assert!(off < 1e-3 * expected, "{torques:?} {expected}");
        }
    }
}
