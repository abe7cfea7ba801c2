//! The consistent plant in motion against laws that hold whatever the parameters: power, momentum,
//! energy, order of the integration, convergence with the number of modes. No reference runs.

// the measured figures, with --nocapture
#![allow(clippy::print_stdout)]

mod consistent_common;

use consistent_common::{NO_TORQUE, fixed, moving, payload, plant, vibration_modes};
use drm_env::arm::mode_shape::{ShapeBasis, ShapeFamily};
use drm_env::arm::{Arm, PayloadProperties};
use drm_env::math::generalized_alpha::GeneralizedAlpha;
use drm_env::math::quadrature::{gauss_legendre, integrate};
use drm_env::plant::consistent::{ConsistentPlant, ConsistentState};
use drm_env::plant::{Dynamics, RigidInertia, TipTorque, Torques};
use drm_env::reference::deployment::Deployment;
use drm_env::reference::slew::Slew;
use drm_env::reference::timeline::Timeline;

/// Energies from the positions of the particles in space, differentiated along the motion: not from
/// the rows of the plant.
struct Space {
    arm: Arm,
    payload: PayloadProperties,
    shapes: [ShapeBasis; 2],
    rule: Vec<(f64, f64)>,
}

/// q, q', a, a'.
type Moment = (Vec<f64>, Vec<f64>, f64, f64);

impl Space {
    fn new(payload: PayloadProperties, modes: usize) -> Self {
        Self {
            arm: Arm::default(),
            payload,
            shapes: [0, 1].map(|_| ShapeBasis::new(ShapeFamily::Mono, modes)),
            rule: gauss_legendre(modes + 6),
        }
    }

    /// Value, slope and curvature of a link's own deflection; `u` is the fraction of `length`.
    fn bent(&self, link: usize, q: &[f64], length: f64, u: f64) -> [f64; 3] {
        let count = self.shapes[link].len();
        let own = &q[1 + link * count..1 + (link + 1) * count];
        let mut sum = [0.0; 3];
        for (shape, q) in self.shapes[link].at(u).into_iter().zip(own) {
            sum[0] += shape[0] * q;
            sum[1] += shape[1] * q / length;
            sum[2] += shape[2] * q / (length * length);
        }
        sum
    }

    fn deflection(&self, q: &[f64], a: f64, xi: f64) -> [f64; 2] {
        let l1 = self.arm.link1.length;
        if xi <= l1 {
            let [w, slope, _] = self.bent(0, q, l1, xi / l1);
            return [w, slope];
        }
        let [end, turn, _] = self.bent(0, q, l1, 1.0);
        let [w, slope, _] = self.bent(1, q, a, (xi - l1) / a);
        [end + (xi - l1) * turn + w, turn + slope]
    }

    /// Square of the velocity of what is at (x, y) in the rotating frame.
    fn speed2(&self, moment: &Moment, at: impl Fn(&[f64], f64) -> [f64; 2]) -> f64 {
        let (q, v, a, ad) = moment;
        let position = |t: f64| {
            let q: Vec<f64> = q.iter().zip(v).map(|(q, v)| q + v * t).collect();
            let ([x, y], theta) = (at(&q, a + ad * t), q[0]);
            [
                x * theta.cos() - y * theta.sin(),
                x * theta.sin() + y * theta.cos(),
            ]
        };
        let h = 1e-3;
        let [far, near, back, behind] = [2.0 * h, h, -h, -2.0 * h].map(position);
        (0..2)
            .map(|i| {
                let rate = (8.0 * (near[i] - back[i]) - (far[i] - behind[i])) / (12.0 * h);
                rate * rate
            })
            .sum()
    }

    fn kinetic(&self, moment: &Moment) -> f64 {
        let (one, two) = (&self.arm.link1, &self.arm.link2);
        let (q, v, a, _) = moment;
        let start = one.length + a - two.length;
        let fixed = integrate(&self.rule, 0.0, one.length, |xi| {
            self.speed2(moment, |q, a| [xi, self.deflection(q, a, xi)[0]])
        });
        // link 2 by the distance from its own root, so that the particles are followed
        let slides = |low: f64, high: f64| {
            integrate(&self.rule, low, high, |own| {
                self.speed2(moment, |q, a| {
                    let xi = one.length + a - two.length + own;
                    [xi, self.deflection(q, a, xi)[0]]
                })
            })
        };
        let moves = slides(0.0, one.length - start) + slides(one.length - start, two.length);
        let lever = self.payload.length / 2.0;
        let centre = self.speed2(moment, |q, a| {
            let reach = one.length + a;
            let [w, slope] = self.deflection(q, a, reach);
            let off = self.payload.offset;
            [reach + lever - off * slope, w + lever * slope + off]
        });
        let turn = |t: f64| {
            let q: Vec<f64> = q.iter().zip(v).map(|(q, v)| q + v * t).collect();
            let a = a + moment.3 * t;
            q[0] + self.deflection(&q, a, one.length + a)[1]
        };
        let h = 1e-3;
        let spin = (8.0 * (turn(h) - turn(-h)) - (turn(2.0 * h) - turn(-2.0 * h))) / (12.0 * h);
        0.5 * (one.mass_per_length * fixed
            + two.mass_per_length * moves
            + self.payload.mass * centre
            + self.payload.inertia_centre * spin * spin)
    }

    fn bending(&self, (q, _, a, _): &Moment) -> f64 {
        let (one, two) = (&self.arm.link1, &self.arm.link2);
        let first = |low: f64| {
            integrate(&self.rule, low, one.length, |xi| {
                self.bent(0, q, one.length, xi / one.length)[2].powi(2)
            })
        };
        let second = integrate(&self.rule, 0.0, *a, |x| {
            self.bent(1, q, *a, x / a)[2].powi(2)
        });
        0.5 * (one.bending_stiffness * first(0.0)
            + two.bending_stiffness * (first(one.length + a - two.length) + second))
    }

    /// dL/da'.
    fn pushing_momentum(&self, (q, v, a, ad): &Moment) -> f64 {
        let at = |ad: f64| self.kinetic(&(q.clone(), v.clone(), *a, ad));
        // exact: T is of second degree in a'
        (at(ad + 1.0) - at(ad - 1.0)) / 2.0
    }

    /// dL/da.
    fn pull(&self, (q, v, a, ad): &Moment) -> f64 {
        let lagrangian = |a: f64| {
            let moment = (q.clone(), v.clone(), a, *ad);
            self.kinetic(&moment) - self.bending(&moment)
        };
        let h = 1e-2;
        (8.0 * (lagrangian(a + h) - lagrangian(a - h))
            - (lagrangian(a + 2.0 * h) - lagrangian(a - 2.0 * h)))
            / (12.0 * h)
    }

    /// Rate at which the tip turns, t q'.
    fn tip_turn(&self, (_, v, a, _): &Moment) -> f64 {
        v[0] + self.deflection(v, *a, self.arm.link1.length + a)[1]
    }
}

/// A deploying, turning and vibrating arm.
fn excited(plant: &ConsistentPlant, size: f64) -> ConsistentState {
    let scaled = |value: f64, rate: f64| (value * size, rate * size);
    plant.released((0.3, 0.4), scaled(2e-3, 0.01), scaled(-3e-3, 0.02))
}

/// E - E0 less the work of torques and deployment force, J, and the work's magnitude; the payload's centre of
/// mass is `offset` off the axis. `size` scales vibration and torques: of a payload off the axis the plant leaves
/// out what is of second order in the deflection.
fn power_defect(offset: f64, size: f64, steps: usize) -> (f64, f64) {
    let modes = 2;
    let dynamics = Dynamics {
        axial_load: false,
        ..Dynamics::default()
    };
    let payload = PayloadProperties {
        offset,
        ..payload(2)
    };
    let plant = ConsistentPlant::new(
        &Arm::default(),
        &payload,
        &dynamics,
        (modes, modes),
        (2.0, 4.0),
    )
    .expect("the plant exists");
    let space = Space::new(payload, modes);
    let torques = Torques {
        slew: 500.0 * size,
        root: 80.0 * size,
        tip: -9.0 * size,
    };
    let piece = moving(3.0, 1.5, -2.0);
    let (duration, mut state) = (0.1, excited(&plant, size));
    let h = duration / steps as f64;
    let at = |state: &ConsistentState, t: f64| -> Moment {
        let extension = piece.extension(t);
        let (q, v) = (
            state.q[..plant.size()].to_vec(),
            state.v[..plant.size()].to_vec(),
        );
        (q, v, extension.length, extension.rate)
    };
    // F a' dt with F = d/dt dL/da' - dL/da, the first part integrated by parts
    let power = |moment: &Moment| {
        (torques.slew + torques.root) * moment.1[0] + torques.tip * space.tip_turn(moment)
            - space.pushing_momentum(moment) * piece.extension_accel
            - moment.3 * space.pull(moment)
    };
    let stored = |moment: &Moment| {
        space.kinetic(moment) + space.bending(moment) - moment.3 * space.pushing_momentum(moment)
    };
    let first = at(&state, 0.0);
    let (begin, mut before) = (stored(&first), power(&first));
    let (mut work, mut magnitude) = (0.0, 0.0);
    for step in 0..steps {
        let t = step as f64 * h;
        plant.step(
            &GeneralizedAlpha::default(),
            &mut state,
            &[torques; 3],
            &piece,
            t,
            h,
        );
        let now = power(&at(&state, t + h));
        work += h * (before + now) / 2.0;
        magnitude += h * before.abs();
        before = now;
    }
    (stored(&at(&state, duration)) - begin - work, magnitude)
}

/// d/dt (T + V) = (S + T1) theta' + T2 (t q') + F a' without the axial load.
#[test]
fn power_balance_closes_at_the_order_of_the_step() {
    for (offset, size) in [(0.0, 1.0), (0.05, 0.05), (-0.02, 0.05)] {
        let [(coarse, _), (middle, _), (fine, magnitude)] =
            [2000, 4000, 8000].map(|steps| power_defect(offset, size, steps));
        println!(
            "offset {offset} m: defect {coarse:.3e} {middle:.3e} {fine:.3e} J of {magnitude:.3e} J"
        );
        assert!(fine.abs() < 1e-5 * magnitude, "{fine} of {magnitude}");
        let order = (coarse - middle).abs().log2() - (middle - fine).abs().log2();
        assert!((order - 2.0).abs() < 0.3, "{order}");
    }
}

/// The thesis manoeuvre with Payload 1: 50 degrees in minimum time while deploying from 1 m to 8 m.
fn manoeuvre() -> Timeline {
    let slew = Slew::default();
    let deployment = Deployment::default();
    Timeline::new(&slew.pieces(), &deployment.pieces(slew.final_time()))
}

/// Flies `timeline` from `start` to `end` in steps of at most `step` that meet its switches and
/// those of the wheels (every `sample` seconds); `visit` sees every step's torques, state and end.
fn fly(
    plant: &ConsistentPlant,
    state: &mut ConsistentState,
    [start, end, sample, step]: [f64; 4],
    wheels: impl Fn(f64) -> [f64; 2],
    mut visit: impl FnMut(&[Torques<f64>; 3], f64, &ConsistentState, f64),
) {
    let timeline = manoeuvre();
    let inertia = RigidInertia::new(&Arm::default(), &payload(2));
    let samples = ((end - start) / sample).round() as usize;
    for index in 0..samples {
        let (mut time, until) = (
            start + index as f64 * sample,
            start + (index + 1) as f64 * sample,
        );
        let [root, tip] = wheels(time);
        let mut at = timeline.index(time);
        while time < until {
            let piece = timeline.piece(at);
            let leg = until.min(timeline.end(at)) - time;
            let steps = (leg / step - 1e-6).ceil().max(1.0);
            let h = leg / steps;
            for i in 0..steps as usize {
                let from = (time - piece.start).max(0.0) + i as f64 * h;
                let torques = [0.0, 0.5, 1.0].map(|part| {
                    let u = from + part * h;
                    let (accel, rate) = piece.motion(u);
                    Torques {
                        slew: inertia.slew_torque(&piece.extension(u), rate, accel),
                        root,
                        tip,
                    }
                });
                plant.step(
                    &GeneralizedAlpha::default(),
                    state,
                    &torques,
                    piece,
                    from,
                    h,
                );
                visit(&torques, h, state, piece.start + from + h);
            }
            time += leg;
            at += 1;
        }
    }
}

fn swinging_wheels(time: f64) -> [f64; 2] {
    [90.0 * (2.0 * time).sin(), 9.0 * (20.0 * time).cos()]
}

/// Second order holds across the switch of the slew at 6.6055 s and the steps of held wheels.
#[test]
fn integration_shows_second_order_across_switches_and_held_torques() {
    for dynamics in [
        Dynamics::default(),
        Dynamics {
            tip_torque: TipTorque::TipOnly,
            structural_damping: 1e-4,
            ..Dynamics::default()
        },
    ] {
        let plant = plant(2, &dynamics, 2, (1.0, 8.0));
        let end = |step: f64| {
            let mut state = excited(&plant, 1.0);
            fly(
                &plant,
                &mut state,
                [6.4, 6.8, 0.02, step],
                swinging_wheels,
                |_, _, _, _| {},
            );
            state
        };
        let states = [8e-5, 4e-5, 2e-5].map(end);
        let distance = |x: &ConsistentState, y: &ConsistentState| {
            let of = |x: &[f64], y: &[f64]| -> f64 {
                x.iter().zip(y).map(|(x, y)| (x - y) * (x - y)).sum()
            };
            of(&x.q, &y.q).sqrt().hypot(of(&x.v, &y.v).sqrt())
        };
        let order = (distance(&states[0], &states[1]) / distance(&states[1], &states[2])).log2();
        println!("order {order:.3}");
        assert!((order - 2.0).abs() < 0.2, "{order}");
    }
}

/// Payload 1 with its centre of mass off the arm's axis (m).
fn off_axis(offset: f64, modes: usize, range: (f64, f64)) -> ConsistentPlant {
    let payload = PayloadProperties {
        offset,
        ..payload(2)
    };
    let modes = (modes, modes);
    ConsistentPlant::new(
        &Arm::default(),
        &payload,
        &Dynamics::default(),
        modes,
        range,
    )
    .expect("the plant exists")
}

/// Change of the angular momentum less the impulse of the torques, over the impulse's magnitude.
fn momentum_defect(offset: f64, modes: usize, end: f64, step: f64) -> f64 {
    let plant = off_axis(offset, modes, (1.0, 8.0));
    let mut state = plant.released((0.0, 0.0), (0.0, 0.0), (0.0, 0.0));
    let timeline = manoeuvre();
    let (mut impulse, mut magnitude) = (0.0, 0.0);
    fly(
        &plant,
        &mut state,
        [0.0, end, 0.02, step],
        swinging_wheels,
        |torques, h, _, _| {
            let [begin, middle, end] = torques.map(|t| t.slew + t.root + t.tip);
            impulse += h * (begin + 4.0 * middle + end) / 6.0;
            magnitude += h * begin.abs();
        },
    );
    let momentum = plant.angular_momentum(&state, &timeline.extension(end));
    (momentum - impulse).abs() / magnitude
}

/// Over the whole manoeuvre; to second order where the step resolves every mode.
#[test]
fn angular_momentum_changes_by_the_torques_alone() {
    for offset in [0.0, 0.2] {
        let whole = momentum_defect(offset, 4, 15.0, 5e-4);
        let [coarse, middle, fine] =
            [1e-4, 5e-5, 2.5e-5].map(|step| momentum_defect(offset, 2, 8.0, step));
        println!("momentum defect {whole:.3e}; {coarse:.3e} {middle:.3e} {fine:.3e}");
        assert!(whole < 1e-5, "{whole}");
        assert!(
            fine < 1e-8 && fine < middle / 3.0,
            "{coarse} {middle} {fine}"
        );
    }
}

/// Relative change of the Jacobi integral in `duration` seconds of turning and vibrating at a fixed
/// length without torques; `size` scales turning rate and vibration.
fn energy_drift(offset: f64, modes: usize, size: f64, duration: f64, step: f64) -> f64 {
    let plant = off_axis(offset, modes, (5.0, 5.0));
    let scheme = GeneralizedAlpha::new(1.0).expect("the radius is within 0 to 1");
    let mut state = plant.released((0.0, 0.5 * size), (0.005 * size, 0.0), (-0.01 * size, 0.0));
    let length = fixed(5.0);
    let before = plant.energy(&state, &length).total();
    let piece = moving(5.0, 0.0, 0.0);
    for _ in 0..(duration / step).round() as usize {
        plant.step(&scheme, &mut state, &[NO_TORQUE; 3], &piece, 0.0, step);
    }
    plant.energy(&state, &length).total() / before - 1.0
}

/// Small motions are linear; then the undamped method conserves the energy to rounding whatever its
/// step.
#[test]
fn energy_of_small_motions_is_conserved_to_rounding() {
    for step in [1e-3, 5e-4] {
        let drift = energy_drift(0.0, 4, 1e-5, 2.0, step);
        println!("drift {drift:.2e}");
        assert!(drift.abs() < 1e-9, "{drift}");
    }
}

/// With the products of turning and vibration the drift is of second order where the step resolves
/// every mode.
#[test]
fn energy_of_large_motions_is_conserved_to_second_order() {
    for offset in [0.0, 0.2] {
        let [coarse, middle, fine] =
            [1e-4, 5e-5, 2.5e-5].map(|step| energy_drift(offset, 2, 10.0, 0.5, step));
        println!("drift {coarse:.3e} {middle:.3e} {fine:.3e}");
        assert!(fine.abs() < 1e-7, "{fine}");
        assert!(fine.abs() < middle.abs() / 3.0, "{middle} {fine}");
    }
}

/// A mode of damping ratio z and angular frequency w loses its energy as exp(-2 z w t), whichever mode, length
/// and payload; the arm that turns as a whole loses nothing.
#[test]
fn every_mode_decays_by_its_damping_ratio_and_the_rotation_does_not() {
    let ratio = 0.02;
    let dynamics = Dynamics {
        damping_ratio: ratio,
        ..Dynamics::default()
    };
    let scheme = GeneralizedAlpha::new(1.0).expect("the radius is within 0 to 1");
    for (row, length) in [(0, 1.0), (2, 2.7), (2, 8.0), (4, 5.0)] {
        let plant = plant(row, &dynamics, 4, (1.0, 8.0));
        let (shapes, frequencies) = vibration_modes(&plant, length);
        let still = fixed(length);
        let piece = moving(length, 0.0, 0.0);
        for (shape, frequency) in shapes.iter().zip(&frequencies).take(4) {
            let mut state = *shape;
            let before = plant.energy(&state, &still).total();
            // five cycles of a hundred steps
            let step = std::f64::consts::TAU / frequency / 100.0;
            for _ in 0..500 {
                plant.step(&scheme, &mut state, &[NO_TORQUE; 3], &piece, 0.0, step);
            }
            let left = plant.energy(&state, &still).total() / before;
            let found = -left.ln() / (2.0 * std::f64::consts::TAU * 5.0);
            println!("payload {row}, {length} m, {frequency:.1} rad/s: {found:.5}");
            assert!((found / ratio - 1.0).abs() < 0.01, "{found}");
        }
        let mut state = plant.released((0.0, 0.01), (0.0, 0.0), (0.0, 0.0));
        let before = plant.angular_momentum(&state, &still);
        for _ in 0..1000 {
            plant.step(&scheme, &mut state, &[NO_TORQUE; 3], &piece, 0.0, 1e-3);
        }
        let after = plant.angular_momentum(&state, &still);
        assert!((after / before - 1.0).abs() < 1e-9, "{after} of {before}");
    }
}

/// The damped method takes energy only from what the step does not resolve: none to speak of from a
/// slow mode, all of it from the fastest.
#[test]
fn dissipation_takes_the_fast_modes_alone() {
    let plant = plant(0, &Dynamics::default(), 4, (1.0, 1.0));
    let (shapes, frequencies) = vibration_modes(&plant, 1.0);
    let left = |mode: usize| {
        let mut state = shapes[mode];
        let length = fixed(1.0);
        let before = plant.energy(&state, &length).total();
        let piece = moving(1.0, 0.0, 0.0);
        for _ in 0..1000 {
            plant.step(
                &GeneralizedAlpha::default(),
                &mut state,
                &[NO_TORQUE; 3],
                &piece,
                0.0,
                5e-4,
            );
        }
        plant.energy(&state, &length).total() / before
    };
    let (slow, second, fast) = (left(0), left(1), left(frequencies.len() - 1));
    println!("left {slow} {second} {fast} of {frequencies:.0?} rad/s");
    assert!(
        (slow - 1.0).abs() < 1e-4 && (second - 1.0).abs() < 1e-2,
        "{slow} {second}"
    );
    assert!(fast < 1e-12, "{fast}");
}

/// Tip deflection every 10 ms of the thesis manoeuvre without feedback, mm.
fn tip_deflections(modes: usize) -> Vec<f64> {
    let plant = plant(2, &Dynamics::default(), modes, (1.0, 8.0));
    let mut state = plant.released((0.0, 0.0), (0.0, 0.0), (0.0, 0.0));
    let timeline = manoeuvre();
    let mut signal = Vec::new();
    let mut next = 0.01;
    fly(
        &plant,
        &mut state,
        [0.0, 16.0, 0.01, 5e-4],
        |_| [0.0; 2],
        |_, _, state, time| {
            if time > next - 1e-9 {
                signal.push(1e3 * plant.tip_deflection(state, &timeline.extension(time)).0);
                next += 0.01;
            }
        },
    );
    signal
}

#[test]
fn tip_deflection_converges_with_the_number_of_modes() {
    let signals = [1, 2, 3, 4, 5, 6].map(tip_deflections);
    let peak = |signal: &[f64]| signal.iter().fold(0.0, |peak: f64, x| peak.max(x.abs()));
    let residual_from = (Slew::default().final_time() / 0.01).ceil() as usize;
    let mut changes = Vec::new();
    for (i, signal) in signals.iter().enumerate() {
        let change = i.checked_sub(1).map(|last| {
            let squares = signal
                .iter()
                .zip(&signals[last])
                .map(|(x, y)| (x - y) * (x - y));
            (squares.sum::<f64>() / signal.len() as f64).sqrt()
        });
        println!(
            "n = m = {}: peak {:.4} mm, residual {:.4} mm, change {change:.4?} mm rms",
            i + 1,
            peak(signal),
            peak(&signal[residual_from..]),
        );
        changes.extend(change);
    }
    assert!(
        changes.windows(2).all(|pair| pair[1] < pair[0]),
        "{changes:?}"
    );
}
