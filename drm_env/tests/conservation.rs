//! Laws that hold whatever the parameters: order of the integration, angular momentum, energy,
//! rigid motion. No reference runs.

use drm_env::arm::{Arm, Link, Payload, PayloadInertia};
use drm_env::config::scenario::Scenario;
use drm_env::control::Law;
use drm_env::hardware::reaction_wheel::WheelTorques;
use drm_env::hardware::reaction_wheel::{RootWheel, TipWheel};
use drm_env::math::rng::{Purpose, Seed, Stream};
use drm_env::plant::PlantModel;
use drm_env::plant::energy::angular_momentum;
use drm_env::reference::deployment::{Deployment, DeploymentMode};
use drm_env::reference::slew::{Slew, SlewProfile};
use drm_env::rollout::{SIGNAL_NAMES, simulate};
use drm_env::simulation::{Flight, Plan};
use proptest::prelude::*;

fn launch(scenario: &Scenario) -> Flight {
    let plan = Plan::new(scenario).expect("the manoeuvre can be flown");
    let noise = Stream::new(Seed::default(), 0, Purpose::Sensors);
    Flight::new(plan, noise).expect("the manoeuvre can be flown")
}

/// State of a deploying, vibrating arm under constant wheel torques, 1.4 s after the bang-bang switch
/// at 6.6055 s, which falls on no step's end.
fn state_after(step: f64) -> [f64; 6] {
    let mut scenario = Scenario {
        integrator_step: step,
        // one sample spans many steps, so that the step alone changes
        sample_period: 0.02,
        horizon: 8.0,
        ..Scenario::default()
    };
    scenario.initial.beta = 2e-4;
    let mut flight = launch(&scenario);
    let command = WheelTorques {
        root: 60.0,
        tip: -4.0,
    };
    for _ in 0..scenario.samples() {
        flight.advance(&command, None);
    }
    let ([a, b, c], [d, e, f]) = (flight.position(), flight.velocity());
    [a, b, c, d, e, f]
}

#[test]
fn integration_of_the_deploying_arm_shows_fourth_order() {
    let [coarse, middle, fine] = [5e-4, 2.5e-4, 1.25e-4].map(state_after);
    let distance = |x: &[f64; 6], y: &[f64; 6]| {
        let squares = x.iter().zip(y).map(|(x, y)| (x - y) * (x - y));
        squares.sum::<f64>().sqrt()
    };
    let order = (distance(&coarse, &middle) / distance(&middle, &fine)).log2();
    assert!((order - 4.0).abs() < 0.1, "observed order {order}");
}

/// Change of the angular momentum about the shoulder less the impulse of the applied torques, as a
/// fraction of the impulse's magnitude, over a whole manoeuvre.
fn momentum_defect(step: f64, following: bool) -> f64 {
    let mut scenario = Scenario {
        integrator_step: step,
        sample_period: step,
        ..Scenario::default()
    };
    scenario.slew.smoothing = 0.1;
    scenario.dynamics.particle_following = following;
    let law = Law::named("lyapunov").expect("the law exists");
    let mut flight = launch(&scenario);
    let plan = Plan::new(&scenario).expect("the manoeuvre can be flown");
    let momentum = |flight: &Flight| {
        angular_momentum(
            &plan.scenario.arm,
            &plan.payload,
            &plan.scenario.dynamics,
            &flight.extension(),
            flight.position(),
            flight.velocity(),
        )
    };
    let before = momentum(&flight);
    let (mut impulse, mut magnitude) = (0.0, 0.0);
    for _ in 0..scenario.samples() {
        let start = flight.time();
        let command = flight.law_torques(&law);
        let at = |time: f64| plan.slew_torque(time);
        // Simpson's rule on the smooth open-loop torque; the wheels are held
        let slew = (at(start) + 4.0 * at(start + step / 2.0) + at(start + step)) / 6.0;
        flight.advance(&command, None);
        let [_, root, tip] = flight.last_torques();
        impulse += (slew + root + tip) * step;
        magnitude += slew.abs() * step;
    }
    (momentum(&flight) - before - impulse).abs() / magnitude
}

#[test]
fn angular_momentum_about_the_shoulder_changes_by_the_applied_torques_alone() {
    for following in [false, true] {
        let defect = momentum_defect(5e-4, following);
        assert!(defect < 1e-9, "following {following}: {defect}");
    }
}

#[test]
fn energy_of_a_fixed_length_is_conserved_while_the_arm_turns_and_vibrates() {
    let mut scenario = Scenario {
        integrator_step: 1e-4,
        horizon: 5.0,
        ..Scenario::default()
    };
    scenario.slew.angle = 0.0;
    scenario.deployment = Deployment {
        start: 5.0,
        mode: DeploymentMode::None,
        ..Deployment::default()
    };
    scenario.initial.slew_rate = 0.5;
    scenario.initial.alpha = 0.01;
    scenario.initial.beta = -0.02;
    let mut flight = launch(&scenario);
    let before = flight.energy().total();
    let still = WheelTorques {
        root: 0.0,
        tip: 0.0,
    };
    for _ in 0..scenario.samples() {
        flight.advance(&still, None);
    }
    let drift = flight.energy().total() / before - 1.0;
    assert!(drift.abs() < 1e-9, "{drift}");
}

/// A very stiff arm follows the rigid solution: with the payload reported exactly it ends at the
/// target, otherwise where int (I_reported / I_true) th'ref dt leads.
#[test]
fn stiff_arm_ends_where_the_rigid_solution_does() {
    let stiff = |link: Link| Link {
        bending_stiffness: 50.0 * link.bending_stiffness,
        ..link
    };
    let arm = Arm::default();
    for mass_error in [0.0, 0.15, -0.15] {
        let scenario = Scenario {
            arm: Arm {
                link1: stiff(arm.link1),
                link2: stiff(arm.link2),
            },
            mass_error,
            integrator_step: 1e-4,
            horizon: 14.0,
            ..Scenario::default()
        };
        let plan = Plan::new(&scenario).expect("the manoeuvre can be flown");
        let inertia = |payload| drm_env::plant::RigidInertia::new(&scenario.arm, payload);
        let (told, truth) = (inertia(&plan.reported), inertia(&plan.payload));
        let steps = 200_000;
        let h = plan.slew_end_time / f64::from(steps);
        let rigid: f64 = (0..steps)
            .map(|i| {
                let t = (f64::from(i) + 0.5) * h;
                let a = plan.timeline.extension(t).length;
                told.at(a) / truth.at(a) * plan.timeline.reference(t).rate * h
            })
            .sum();
        let flown = simulate(&scenario, &Law::default(), 1, Seed::default())
            .expect("the manoeuvre can be flown");
        let index = SIGNAL_NAMES.iter().position(|n| *n == "slew_angle");
        let angle = flown.signals[index.expect("the signal exists")]
            .last()
            .copied()
            .unwrap_or(f64::NAN);
        // what is left is the vibration of the stiff arm
        assert!(
            (angle - rigid).abs() < 2e-4,
            "error {mass_error}: {angle} against {rigid}"
        );
    }
}

fn scenarios() -> impl Strategy<Value = Scenario> {
    (
        (20.0..600.0_f64, -0.2..0.2_f64, any::<bool>()),
        (-1.5..1.5_f64, 0.005..0.05_f64, 0.0..0.2_f64, any::<bool>()),
        (1.5..8.0_f64, 1.5..8.0_f64, 0..3_u8),
        (0.0..0.02_f64, 0.0..0.01_f64, 0.0..0.01_f64),
        any::<bool>(),
    )
        .prop_map(
            |(
                (mass, mass_error, slender),
                (angle, max_accel, smoothing, energy),
                (start, end, mode),
                (lag, dead_time, delay),
                consistent,
            )| {
                let mut scenario = Scenario {
                    payload: Payload {
                        mass,
                        inertia: if slender {
                            PayloadInertia::Slender
                        } else {
                            PayloadInertia::Full
                        },
                        ..Payload::default()
                    },
                    mass_error,
                    slew: Slew {
                        angle,
                        max_accel,
                        profile: if energy {
                            SlewProfile::MinEnergy
                        } else {
                            SlewProfile::MinTime
                        },
                        smoothing,
                        ..Slew::default()
                    },
                    deployment: Deployment {
                        start,
                        end,
                        mode: match mode {
                            0 => DeploymentMode::Coincident,
                            1 => DeploymentMode::ForceLimited,
                            _ => DeploymentMode::None,
                        },
                        ..Deployment::default()
                    },
                    root_wheel: RootWheel {
                        lag,
                        dead_time,
                        momentum_limit: Some(300.0),
                        ..RootWheel::default()
                    },
                    tip_wheel: TipWheel {
                        lag,
                        ..TipWheel::default()
                    },
                    plant: if consistent {
                        PlantModel::Consistent
                    } else {
                        PlantModel::Thesis
                    },
                    modes: [2, 3],
                    horizon: 4.0,
                    ..Scenario::default()
                };
                scenario.sensors.delay = delay;
                scenario
            },
        )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Any manoeuvre within reason stays finite, within the wheels' limits, and is the same when
    /// flown mirrored.
    #[test]
    fn manoeuvres_are_finite_limited_and_mirror_symmetric(scenario in scenarios()) {
        prop_assume!(scenario.slew.angle.abs() > 1e-2);
        let law = Law::named("linear").expect("the law exists");
        let mut mirrored = scenario;
        mirrored.slew.angle = -scenario.slew.angle;
        let (a, b) = (
            simulate(&scenario, &law, 1, Seed::default()).unwrap(),
            simulate(&mirrored, &law, 1, Seed::default()).unwrap(),
        );
        for (name, (one, other)) in SIGNAL_NAMES.iter().zip(a.signals.iter().zip(&b.signals)) {
            let even = ["time", "extension", "extension_rate", "motor_power"].contains(name);
            let sign = if even { 1.0 } else { -1.0 };
            for (x, y) in one.iter().zip(other) {
                prop_assert!(x.is_finite());
                // mirrored to the bit
                prop_assert!(*x == sign * y, "{} {} {}", name, x, y);
            }
        }
        let index = |name| SIGNAL_NAMES.iter().position(|n| *n == name).unwrap();
        prop_assert!(a.signals[index("root_torque")].iter().all(|t| t.abs() <= 100.0 + 1e-12));
        prop_assert!(a.signals[index("tip_torque")].iter().all(|t| t.abs() <= 10.0 + 1e-12));
        prop_assert!(a.signals[index("root_momentum")].iter().all(|h| h.abs() <= 300.0 + 1e-9));
    }
}
