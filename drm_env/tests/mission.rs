//! Missions: legs that take over what the leg before has left. Momentum and energy are balanced over all of
//! them, and every door flies the same bits.

use drm_env::arm::Payload;
use drm_env::config::handling::{Base, TurnedBase};
use drm_env::config::mission::{
    DesaturateLeg, GrappleLeg, HoldLeg, Leg, Mission, ReleaseLeg, RestLeg, SlewLeg, ValidMission,
};
use drm_env::config::{EnvConfig, ValidConfig};
use drm_env::control::Law;
use drm_env::env::Env;
use drm_env::math::rng::Seed;
use drm_env::plant::PlantModel;
use drm_env::reference::series::Series;
use drm_env::reference::slew::SlewProfile;
use drm_env::rollout::{
    Beside, Options, Pilot, Recording, SIGNAL_NAMES, Schedule, TOLD, fly_missions,
    fly_missions_asked, fly_one_mission,
};
use drm_env::simd::Instructions;
use drm_env::simulation::LegRecord;
use drm_env::{Error, Scenario};

fn slew(angle: f64, extension: Option<f64>) -> Leg {
    Leg::Slew(SlewLeg {
        angle: Some(angle),
        extension,
        max_accel: Some(0.2),
        smoothing: Some(0.1),
        ..SlewLeg::default()
    })
}

fn hold(duration: f64) -> Leg {
    Leg::Hold(HoldLeg {
        duration,
        ..HoldLeg::default()
    })
}

/// Pick, slew, place, return, with payloads that are grappled and released while the arm vibrates.
fn pick_and_place() -> Mission {
    Mission {
        legs: vec![
            slew(0.3, Some(3.0)),
            Leg::WaitForRest(RestLeg {
                most: 1.0,
                ..RestLeg::default()
            }),
            Leg::Grapple(GrappleLeg::default()),
            slew(-0.5, Some(2.0)),
            hold(0.5),
            Leg::Release(ReleaseLeg {}),
            slew(0.2, None),
            hold(0.3),
        ],
        ..Mission::default()
    }
}

fn scenario(plant: PlantModel) -> Scenario {
    let mut scenario = Scenario {
        plant,
        modes: [2, 2],
        mass_error: 0.15,
        ..Scenario::default()
    };
    scenario.payload.mass = 300.0;
    scenario.deployment.start = 2.0;
    scenario
}

fn both() -> [PlantModel; 2] {
    [PlantModel::Thesis, PlantModel::Consistent]
}

fn flyable(mission: &Mission, scenario: Scenario) -> ValidMission {
    ValidMission::with_horizon(mission, scenario).expect("the mission can be flown")
}

struct Flown {
    signals: Vec<(&'static str, Vec<f64>)>,
    legs: Vec<LegRecord>,
}

impl Flown {
    fn of(mission: &ValidMission, law: &Law) -> Self {
        let pilot = Pilot::law(law).expect("the law can be used");
        let flown = fly_one_mission(mission, &pilot, 1, Seed::default(), Beside::default());
        let (trajectory, legs) = flown.expect("the mission can be flown");
        Self {
            signals: trajectory.signals,
            legs,
        }
    }

    fn signal(&self, name: &str) -> &[f64] {
        let index = SIGNAL_NAMES.iter().position(|known| *known == name);
        &self.signals[index.expect("there is such a signal")].1
    }

    /// Row at the beginning of a leg.
    fn row(&self, leg: usize) -> usize {
        let start = self.legs[leg].start;
        let times = self.signal("time");
        let row = times.iter().position(|time| (time - start).abs() < 1e-9);
        row.expect("legs begin at samples")
    }
}

/// Angles, deflections, momenta and time go on over the ends of legs; the length too.
#[test]
fn nothing_jumps_where_a_leg_ends() {
    for plant in both() {
        let law = Law::named("linear").expect("the law exists");
        let flown = Flown::of(&flyable(&pick_and_place(), scenario(plant)), &law);
        assert_eq!(flown.legs.len(), 6);
        let period = 2e-3;
        for pair in flown.signal("time").windows(2) {
            assert!((pair[1] - pair[0] - period).abs() < 1e-9);
        }
        // (signal, rate that it can have)
        let limits = [
            ("slew_angle", 1.0),
            ("reference_angle", 1.0),
            ("extension", 3.0),
            ("tip_deflection", 3.0),
            ("link2_tip_deflection", 3.0),
            ("root_momentum", 101.0),
            ("tip_momentum", 11.0),
        ];
        for (name, rate) in limits {
            for pair in flown.signal(name).windows(2) {
                let step = (pair[1] - pair[0]).abs();
                assert!(step <= rate * period, "{plant:?}, {name}: {step}");
            }
        }
        let last = |name: &str| *flown.signal(name).last().expect("there are rows");
        assert!((last("reference_angle")).abs() < 1e-12);
        assert_eq!(last("extension"), 2.0);
    }
}

/// The arm's angular momentum is the impulse of motor and wheels and what came with payloads; with the
/// wheels' own it is the motor's impulse alone. The slew motor's impulse is integrated by Simpson's rule on
/// double samples, which do not straddle the legs' ends: they are whole periods.
#[test]
fn angular_momentum_is_balanced_over_the_legs() {
    for plant in both() {
        let mut scenario = scenario(plant);
        // one step a sample: the rows see all torques
        scenario.sample_period = 5e-4;
        scenario.integrator_step = 5e-4;
        let law = Law::named("linear").expect("the law exists");
        let mission = flyable(&pick_and_place(), scenario);
        let flown = Flown::of(&mission, &law);
        let torque = flown.signal("slew_torque");
        let impulse: f64 = torque
            .windows(2)
            .map(|pair| 0.5 * (pair[0] + pair[1]) * 5e-4)
            .sum();
        let size: f64 = torque.iter().map(|torque| torque.abs() * 5e-4).sum();
        let brought: f64 = flown.legs.iter().map(|leg| leg.exchange.momentum).sum();
        let wheels = |name: &str| *flown.signal(name).last().expect("there are rows");
        let stored = wheels("root_momentum") + wheels("tip_momentum");
        let arm = arm_momentum_at_end(&mission, &law);
        let defect = (arm + stored - impulse - brought).abs() / size;
        assert!(defect < 2e-5, "{plant:?}: {defect}");
        // a payload that comes while the arm vibrates brings something
        assert!(flown.legs[2].exchange.momentum.abs() > 1e-9 * size);
    }
}

/// By an environment, whose flight can be asked.
fn arm_momentum_at_end(mission: &ValidMission, law: &Law) -> f64 {
    let mut env = env_of(mission, law);
    let mut done = false;
    while !done {
        let outcome = env.step(&[0.0, 0.0]).expect("it is running");
        done = outcome.terminated || outcome.truncated;
    }
    env.flight().arm_momentum()
}

fn config_of(mission: &ValidMission, law: &Law) -> ValidConfig {
    let mut config = EnvConfig::preset("slew_thesis").expect("the preset exists");
    config.scenario = *mission.scenario();
    config.mission = Some(mission.mission().clone());
    config.task.control_period = 0.1;
    config.task.inner_law = Some(*law);
    ValidConfig::new(config).expect("the configuration can be flown")
}

fn env_of(mission: &ValidMission, law: &Law) -> Env {
    let mut env = Env::new(config_of(mission, law)).expect("it can be made");
    env.reset(Some(Seed::default()), &Vec::new())
        .expect("it can be reset");
    env
}

/// At a fixed length the energy of arm and payload is the work of motor and wheels and what came with
/// payloads, over slews, holds, a grapple and a release.
#[test]
fn energy_is_balanced_over_the_legs() {
    for plant in both() {
        let mut scenario = scenario(plant);
        scenario.sample_period = 5e-4;
        scenario.integrator_step = 5e-4;
        // so that the integrator takes nothing
        scenario.dynamics.spectral_radius = 1.0;
        let mission = Mission {
            legs: vec![
                slew(0.3, None),
                Leg::Grapple(GrappleLeg::default()),
                hold(0.5),
                slew(-0.5, None),
                Leg::Release(ReleaseLeg {}),
                slew(0.2, None),
                hold(0.3),
            ],
            ..Mission::default()
        };
        let mission = flyable(&mission, scenario);
        let law = Law::default();
        let flown = Flown::of(&mission, &law);
        // the open loop's torque does work on the slew angle alone
        let (torque, rate) = (flown.signal("slew_torque"), flown.signal("slew_rate"));
        let power: Vec<f64> = torque.iter().zip(rate).map(|(t, w)| t * w).collect();
        let work: f64 = power.windows(2).map(|p| 0.5 * (p[0] + p[1]) * 5e-4).sum();
        let size: f64 = power.iter().map(|p| p.abs() * 5e-4).sum();
        let brought: f64 = flown.legs.iter().map(|leg| leg.exchange.energy).sum();
        let last = flown.legs.last().expect("there are legs");
        let defect = (last.metrics.residual_energy - work - brought).abs() / size;
        assert!(defect < 2e-4, "{plant:?}: {defect}");
        assert!(flown.legs[1].exchange.energy > 0.0);
        // it takes what it has, less what its axial load had made of the arm's
        assert!(flown.legs[3].exchange.energy < 0.0);
    }
}

/// What a payload brings is the momentum and the energy of a body that moves with the tip: the thesis'
/// velocity field, written down for the payload alone. The arm is rigid enough that its bending is small.
#[test]
fn a_payload_brings_what_a_body_moving_with_the_tip_has() {
    let mut scenario = scenario(PlantModel::Thesis);
    scenario.dynamics.axial_load = false;
    scenario.initial.slew_rate = 0.05;
    let mission = Mission {
        legs: vec![
            hold(0.1),
            Leg::Grapple(GrappleLeg {
                payload: Some(Payload {
                    mass: 100.0,
                    length: Some(0.8),
                    width: Some(0.4),
                    ..Payload::default()
                }),
                ..GrappleLeg::default()
            }),
            hold(0.1),
        ],
        ..Mission::default()
    };
    let flown = Flown::of(&flyable(&mission, scenario), &Law::default());
    let row = flown.row(1);
    let at = |name: &str| flown.signal(name)[row];
    let (a, l1, lp) = (at("extension"), scenario.arm.link1.length, 0.8);
    let tip_rate = 2.0 * (at("alpha_rate") + at("beta_rate"));
    let slope_rate = 3.0 * at("beta_rate") / a;
    let lever = l1 + a + lp / 2.0;
    let speed = lever * at("slew_rate") + tip_rate + lp / 2.0 * slope_rate;
    let turning = at("slew_rate") + slope_rate;
    let inertia = 100.0 * (0.8 * 0.8 + 0.4 * 0.4) / 12.0;
    let momentum = 100.0 * lever * speed + inertia * turning;
    let energy = 0.5 * (100.0 * speed * speed + inertia * turning * turning);
    let brought = flown.legs[1].exchange;
    assert!(
        (brought.momentum / momentum - 1.0).abs() < 1e-9,
        "{brought:?}"
    );
    assert!((brought.energy / energy - 1.0).abs() < 1e-9, "{brought:?}");
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

fn desaturating() -> Leg {
    Leg::Desaturate(DesaturateLeg {
        most: 1.0,
        momentum: 0.0,
        ..DesaturateLeg::default()
    })
}

/// A base that turns through 5 mrad and carries the arm along.
fn braked() -> Leg {
    let series = |values: &[f64]| Series::new(values).expect("they are few");
    let turned = TurnedBase {
        times: series(&[0.0, 0.1, 0.1, 0.2]),
        accelerations: series(&[0.5, 0.5, -0.5, -0.5]),
        locked: true,
    };
    Leg::Hold(HoldLeg {
        duration: 0.5,
        base: Some(Base::Turned(turned)),
    })
}

/// A slew through 0.1 rad by a table that jumps, begins late and ends between two periods.
fn tabled() -> Leg {
    let series = |values: &[f64]| Series::new(values).expect("they are few");
    Leg::Slew(SlewLeg {
        profile: Some(SlewProfile::Table),
        times: series(&[0.05, 1.05, 1.05, 2.05]),
        accelerations: series(&[0.1, 0.1, -0.1, -0.1]),
        extension: Some(2.5),
        ..SlewLeg::default()
    })
}

/// Missions of unequal legs, with noise, delays and real wheels.
fn varied(plant: PlantModel) -> Vec<ValidMission> {
    (0..5)
        .map(|i| {
            let mut scenario = scenario(plant);
            scenario.payload.mass = 100.0 + 40.0 * f64::from(i);
            scenario.horizon = 40.0;
            scenario.root_wheel.lag = 0.01;
            scenario.root_wheel.dead_time = 0.006;
            if i % 2 == 0 {
                scenario.sensors.angle_noise = 1e-5;
                scenario.sensors.delay = 0.004;
            }
            let mut mission = Mission {
                replan: true,
                ..pick_and_place()
            };
            if i % 2 == 1 {
                // beside lanes whose legs are only manoeuvres
                mission.legs.extend([braked(), desaturating(), hold(0.2)]);
                // what vibrates when the shoulder is let go drifts away
                scenario.dynamics.structural_damping = 5e-3;
            }
            if i == 2 {
                mission.legs.extend([tabled(), hold(0.2)]);
            }
            flyable(&mission, scenario)
        })
        .collect()
}

/// Who is asked every seventh sample and answers with torques that are given beforehand flies their bits, over
/// legs that begin between two questions.
#[test]
fn who_is_asked_flies_what_is_given_beforehand() {
    const ROWS: usize = 300;
    const HOLD: usize = 7;
    for plant in both() {
        let missions = varied(plant);
        let seeds: Vec<Seed> = (0..missions.len() as u8)
            .map(|i| Seed::from_le_bytes(&[i]))
            .collect();
        let torques: Vec<[f64; 2]> = (0..missions.len() * ROWS)
            .map(|i| [40.0 * (0.1 * i as f64).sin(), 3.0 * (0.07 * i as f64).cos()])
            .collect();
        let recording = Recording::new(&SIGNAL_NAMES, 10).expect("they exist");
        let options = Options {
            threads: Some(1),
            recording: Some(recording.clone()),
            ..Options::default()
        };
        let schedule = Schedule {
            torques: &torques,
            rows: ROWS,
            hold: HOLD,
        };
        let pilot = Pilot::schedule(schedule).expect("they are finite");
        let given = fly_missions(&missions, &pilot, &seeds, &options, |_| true)
            .expect("the missions can be flown");
        let mut question = 0;
        let mut answer = |told: &[[f64; TOLD]]| {
            let row = question;
            question += 1;
            let of = |i: usize| torques.get(i * ROWS + row).copied().unwrap_or_default();
            let kept = |i: usize| if row < ROWS { of(i) } else { [0.0; 2] };
            Some((0..told.len()).map(kept).collect())
        };
        let flown = fly_missions_asked(
            &missions,
            &seeds,
            Some(HOLD as f64 * 0.002),
            Some(&recording),
            &mut answer,
            &mut |_| true,
        )
        .expect("the missions can be flown");
        for (own, other) in flown.metrics.iter().zip(&given.metrics) {
            assert_eq!(bits(&own.values()), bits(&other.values()));
        }
        assert_eq!(format!("{:?}", flown.legs), format!("{:?}", given.legs));
        let kept = |flown: &drm_env::rollout::Flown| flown.trajectories.clone().expect("kept");
        let (own, other) = (kept(&flown), kept(&given));
        assert_eq!(own.samples, other.samples);
        for ((name, own), (_, other)) in own.signals.iter().zip(&other.signals) {
            assert_eq!(bits(own), bits(other), "{name}");
        }
    }
}

/// One at a time, side by side with any instructions and threads, and in an environment.
#[test]
fn every_door_flies_the_same_bits() {
    for plant in both() {
        let law = Law::named("servo").expect("the law exists");
        let pilot = Pilot::law(&law).expect("the law can be used");
        let missions = varied(plant);
        let seeds: Vec<Seed> = (0..missions.len() as u8)
            .map(|i| Seed::from_le_bytes(&[i]))
            .collect();
        let one = |i: usize| {
            let flown = fly_one_mission(&missions[i], &pilot, 10, seeds[i], Beside::default());
            flown.expect("the mission can be flown")
        };
        let alone: Vec<_> = (0..missions.len()).map(one).collect();
        let known = [
            Instructions::Baseline,
            Instructions::Avx2,
            Instructions::Avx512,
        ];
        for instructions in known.into_iter().filter(|i| *i <= Instructions::detect()) {
            for threads in [1, 2] {
                let options = Options {
                    threads: Some(threads),
                    instructions,
                    recording: Some(Recording::new(&SIGNAL_NAMES, 10).expect("they exist")),
                };
                let flown = fly_missions(&missions, &pilot, &seeds, &options, |_| true)
                    .expect("the missions can be flown");
                let kept = flown.trajectories.expect("signals are kept");
                for (i, (trajectory, legs)) in alone.iter().enumerate() {
                    assert_eq!(
                        bits(&flown.metrics[i].values()),
                        bits(&trajectory.metrics.values())
                    );
                    // as text, in which NaN is NaN
                    assert_eq!(format!("{:?}", flown.legs[i]), format!("{legs:?}"));
                    for (column, (_, values)) in kept.signals.iter().enumerate() {
                        let row = &values[i * kept.samples..][..kept.samples];
                        let expected = &trajectory.signals[column].1;
                        assert_eq!(bits(&row[..expected.len()]), bits(expected));
                        assert!(row[expected.len()..].iter().all(|value| value.is_nan()));
                    }
                }
            }
        }
        for (i, mission) in missions.iter().enumerate() {
            let mut env = Env::new(config_of(mission, &law)).expect("it can be made");
            env.reset(Some(seeds[i]), &Vec::new())
                .expect("it can be reset");
            let mut done = false;
            while !done {
                done = env.step(&[0.0, 0.0]).expect("it is running").terminated;
            }
            let (trajectory, legs) = &alone[i];
            let angle = env.flight().position()[0] + env.leg().2;
            let last = trajectory.signals[1].1.last().expect("there are rows");
            assert_eq!(angle.to_bits(), last.to_bits());
            for (own, other) in env.legs().iter().zip(legs) {
                assert_eq!(own.metrics.tip_error_rms, other.metrics.tip_error_rms);
                assert_eq!(own.planned_mass, other.planned_mass);
            }
            let paid: f64 = env.legs().iter().flat_map(|leg| leg.terms).sum();
            assert!((paid / env.episode_return() - 1.0).abs() < 1e-12);
        }
    }
}

/// A snapshot taken in the middle of any leg, and of a step of the wait, goes on with the same bits; one
/// with other numbers is refused.
#[test]
fn snapshots_in_the_middle_of_a_leg() {
    for plant in both() {
        let law = Law::named("servo").expect("the law exists");
        let mission = &varied(plant)[0];
        let mut env = env_of(mission, &law);
        let mut copy = env_of(mission, &law);
        let action = |step: usize| [0.3 * (step as f32 * 0.7).sin(), -0.2];
        let mut done = false;
        let mut step = 0;
        while !done {
            let outcome = env.step(&action(step)).expect("it is running");
            if step % 9 == 4 {
                copy.set_state(&env.get_state()).expect("it is a snapshot");
            } else if step > 4 {
                let other = copy.step(&action(step)).expect("it is running");
                assert_eq!(outcome, other);
                assert_eq!(env.observation(), copy.observation());
            }
            done = outcome.terminated || outcome.truncated;
            step += 1;
        }
        let state = env.get_state();
        copy.set_state(&state).expect("it is a snapshot");
        assert_eq!(copy.get_state(), state);
        assert!(copy.step(&[0.0, 0.0]).is_err());
        assert_eq!(
            bits(&copy.metrics().values()),
            bits(&env.metrics().values())
        );
        // what follows is the next mission
        for env in [&mut env, &mut copy] {
            env.reset(None, &Vec::new()).expect("it can be reset");
        }
        assert_eq!(env.get_state(), copy.get_state());
        let mut cut = state.clone();
        cut.truncate(state.len() - 3);
        assert!(matches!(copy.set_state(&cut), Err(Error::Snapshot(_))));
    }
}

/// Waiting ends when the arm has been at rest for a while, and after its longest time if it never is.
#[test]
fn waiting_ends_at_rest_or_in_time() {
    let mut quick = scenario(PlantModel::Thesis);
    quick.initial.beta = 1e-3;
    let waiting = |most: f64| Mission {
        legs: vec![Leg::WaitForRest(RestLeg {
            most,
            quiet: 0.5,
            ..RestLeg::default()
        })],
        ..Mission::default()
    };
    let law = Law::named("linear").expect("the law exists");
    let damped = Flown::of(&flyable(&waiting(20.0), quick), &law);
    let duration = damped.legs[0].metrics.duration;
    assert!((0.5..19.0).contains(&duration), "{duration}");
    let tip = damped.signal("tip_deflection");
    let quiet = &tip[tip.len() - 250..];
    let largest = quiet.iter().fold(0.0_f64, |most, y| most.max(y.abs()));
    assert!(largest < 1.2e-3, "{largest}");
    let forever = Flown::of(&flyable(&waiting(2.0), quick), &Law::default());
    assert!((forever.legs[0].metrics.duration - 2.0).abs() < 1e-9);
}

/// An extension alone, and one that begins later than its slew.
#[test]
fn a_deployment_has_its_own_start() {
    let mission = Mission {
        legs: vec![
            Leg::Slew(SlewLeg {
                extension: Some(3.0),
                ..SlewLeg::default()
            }),
            Leg::Slew(SlewLeg {
                angle: Some(0.1),
                extension: Some(2.5),
                deployment: Some(drm_env::reference::deployment::DeploymentMode::ForceLimited),
                deployment_start: 1.0,
                ..SlewLeg::default()
            }),
        ],
        ..Mission::default()
    };
    let flown = Flown::of(
        &flyable(&mission, scenario(PlantModel::Thesis)),
        &Law::default(),
    );
    let row = flown.row(1);
    let length = flown.signal("extension");
    assert_eq!(length[0], 2.0);
    assert_eq!(length[row], 3.0);
    assert_eq!(length[row + 500], 3.0);
    assert!(length[row + 600] < 3.0);
    assert_eq!(length.last(), Some(&2.5));
    assert!(
        flown.signal("reference_angle")[..=row]
            .iter()
            .all(|angle| *angle == 0.0)
    );
    // 75 kg of link 2 over a metre with 200 N, up and down: 2 sqrt(75 / 200) s, to whole periods
    let needed = 2.0 * (75.0_f64 / 200.0).sqrt();
    let duration = flown.legs[0].metrics.duration;
    assert!(
        (duration - (needed / 0.1).ceil() * 0.1).abs() < 1e-9,
        "{duration}"
    );
}

/// A leg that is planned for the mass that was identified ends nearer to its target than one that is
/// planned for the report.
#[test]
fn legs_are_planned_for_the_identified_mass() {
    let legs = vec![
        Leg::Grapple(GrappleLeg::default()),
        slew(0.5, None),
        hold(1.0),
        slew(-0.5, None),
        hold(1.0),
    ];
    let error = |replan: bool| {
        let mission = Mission {
            legs: legs.clone(),
            replan,
            ..Mission::default()
        };
        let flown = Flown::of(
            &flyable(&mission, scenario(PlantModel::Thesis)),
            &Law::default(),
        );
        let told = flown.legs[2].planned_mass;
        let slewed = flown.signal("slew_angle");
        (
            told,
            (slewed[flown.row(3)] - slewed[flown.row(2)] + 0.5).abs(),
        )
    };
    let (reported, blind) = error(false);
    let (identified, seeing) = error(true);
    assert!((reported - 345.0).abs() < 1e-9);
    assert!((identified / 300.0 - 1.0).abs() < 0.02, "{identified}");
    assert!(seeing < 0.25 * blind, "{seeing} against {blind}");
}

/// What cannot be flown is refused by the name of the leg.
#[test]
fn impossible_legs_are_named() {
    let refused = |legs: Vec<Leg>| {
        let mission = Mission {
            legs,
            ..Mission::default()
        };
        let error = ValidMission::with_horizon(&mission, scenario(PlantModel::Thesis));
        error.expect_err("it cannot be flown").to_string()
    };
    let release = refused(vec![hold(1.0), Leg::Release(ReleaseLeg {})]);
    assert!(release.starts_with("mission.legs[1].kind"), "{release}");
    let long = refused(vec![slew(0.1, Some(80.0))]);
    assert!(long.starts_with("mission.legs[0].deployment.end"), "{long}");
    let short = refused(vec![Leg::Slew(SlewLeg {
        angle: Some(1.0),
        duration: Some(0.5),
        ..SlewLeg::default()
    })]);
    assert!(short.starts_with("mission.legs[0].duration"), "{short}");
    let Leg::Slew(table) = tabled() else {
        panic!("it is a slew");
    };
    let wrong = refused(vec![Leg::Slew(SlewLeg {
        angle: Some(0.2),
        ..table
    })]);
    assert!(wrong.starts_with("mission.legs[0].angle"), "{wrong}");
    let brakes = refused(vec![Leg::Slew(SlewLeg {
        base: Some(Base::Locked),
        ..table
    })]);
    assert!(brakes.starts_with("mission.legs[0].profile"), "{brakes}");
    assert!(refused(Vec::new()).starts_with("mission.legs"));
}
