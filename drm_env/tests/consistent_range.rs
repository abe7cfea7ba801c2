//! The consistent plant over everything that can be asked of it: payloads from none to 30 t, slow and fast
//! slews, deploying, retracting and fixed arms.

// the measured figures, with --nocapture
#![allow(clippy::print_stdout)]

use drm_env::Scenario;
use drm_env::config::scenario::ValidScenario;
use drm_env::control::Law;
use drm_env::math::rng::Seed;
use drm_env::plant::PlantModel;
use drm_env::reference::deployment::DeploymentMode;
use drm_env::rollout::{Options, Pilot, Recording, SIGNAL_NAMES, fly};
use drm_env::validity::LARGEST_DEFLECTION;

const MASSES: [f64; 10] = [
    0.0, 50.0, 200.0, 450.0, 600.0, 700.0, 1000.0, 3000.0, 10_000.0, 30_000.0,
];
const ACCELERATIONS: [f64; 4] = [0.005, 0.01, 0.02, 0.04];

fn scenarios() -> Vec<Scenario> {
    let mut all = Vec::new();
    for mass in MASSES {
        for accel in ACCELERATIONS {
            for (start, end) in [(1.0, 8.0), (8.0, 1.0), (1.0, 1.0), (4.0, 4.0), (8.0, 8.0)] {
                let mut scenario = Scenario {
                    plant: PlantModel::Consistent,
                    horizon: 40.0,
                    ..Scenario::default()
                };
                scenario.payload.mass = mass;
                scenario.slew.max_accel = accel;
                scenario.deployment.start = start;
                scenario.deployment.end = end;
                if start == end {
                    scenario.deployment.mode = DeploymentMode::None;
                }
                all.push(scenario);
            }
        }
    }
    all
}

/// Every flight bends like a beam under the acceleration of what it carries, or leaves the limits of the
/// equations and says so; within the payloads of the environments none leaves them.
#[test]
fn any_payload_flies_or_is_called_diverged() {
    let scenarios = scenarios();
    let seeds = vec![Seed::from_u64(0); scenarios.len()];
    let options = Options {
        recording: Some(Recording::new(&SIGNAL_NAMES, 5).expect("they are signals")),
        ..Options::default()
    };
    let law = Law::default();
    let pilot = Pilot::law(&law).expect("its gains are finite");
    let checked = ValidScenario::all(&scenarios).expect("they can be flown");
    let flown = fly(&checked, &pilot, &seeds, &options, |_| true).expect("they fly");
    let kept = flown.trajectories.expect("signals are kept");
    let column = |name: &str| {
        let found = kept.signals.iter().find(|(known, _)| *known == name);
        found
            .map(|(_, values)| values.chunks(kept.samples))
            .expect("there is such a signal")
    };
    let mut diverged = 0;
    for ((scenario, metrics), (deflection, extension)) in scenarios
        .iter()
        .zip(&flown.metrics)
        .zip(column("tip_deflection").zip(column("extension")))
    {
        let (mass, accel) = (scenario.payload.mass, scenario.slew.max_accel);
        let told = format!("{mass} kg, {accel} rad/s^2, {:?}", scenario.deployment);
        diverged += usize::from(metrics.diverged);
        assert!(mass > 1000.0 || !metrics.diverged, "{told}");
        let peak = deflection
            .iter()
            .zip(extension)
            .filter(|(y, _)| y.is_finite())
            .map(|(y, a)| y.abs() / (7.0 + a))
            .fold(0.0, f64::max);
        assert!(peak <= LARGEST_DEFLECTION, "{told}: {peak}");
        // a cantilever of link 1's stiffness with all of its mass at the end; what is switched swings to
        // twice as far, and twice as far again at the second switch
        let reach = 7.0 + scenario.deployment.start.max(scenario.deployment.end);
        let still = (mass + 175.0) * accel * (reach + 1.0) * reach * reach / (3.0 * 2.5e6);
        if metrics.diverged {
            assert!(4.0 * still > LARGEST_DEFLECTION, "{told}: {still}");
            continue;
        }
        assert!(deflection.iter().all(|y| y.is_finite()), "{told}");
        assert!(peak < 5.0 * still, "{told}: {peak} of {still}");
    }
    println!("{diverged} of {} diverged", scenarios.len());
}
