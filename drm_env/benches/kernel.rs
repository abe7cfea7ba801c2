//! Times of the engine's inner parts: a Runge-Kutta step, whole manoeuvres, steps of batches, pictures.

use std::sync::Arc;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use drm_env::batch::{Autoreset, Batch, StepBuffers};
use drm_env::benchmark::kernel;
use drm_env::config::ValidConfig;
use drm_env::config::parameter::Overrides;
use drm_env::config::scenario::Scenario;
use drm_env::control::Law;
use drm_env::math::rng::Seed;
use drm_env::render::{Follower, Look};
use drm_env::rollout::rollout;
use drm_env::simd::Instructions;
use drm_env::{Env, EnvConfig};

/// One thesis manoeuvre open loop a lane; an element is a Runge-Kutta step of an environment.
fn steps(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("runge_kutta_step");
    for &lanes in Instructions::detect().widths() {
        let whole = kernel(lanes, 1).expect("the processor has these lanes");
        group.throughput(Throughput::Elements((whole.steps * lanes) as u64));
        group.bench_function(BenchmarkId::new("lanes", lanes), |bencher| {
            bencher.iter(|| kernel(lanes, 1).expect("the processor has these lanes"));
        });
    }
    group.finish();
}

/// Thesis manoeuvres in closed loop on one thread; an element is one Runge-Kutta step of one of them.
fn manoeuvres(criterion: &mut Criterion) {
    let scenario = Scenario::default();
    let steps = (scenario.horizon / scenario.integrator_step).round() as u64;
    let mut group = criterion.benchmark_group("rollout_per_step");
    group.sample_size(20);
    for (name, count) in [("none", 1), ("lyapunov", 1), ("lyapunov", 64)] {
        let law = Law::named(name).expect("a law of this name exists");
        let (scenarios, seeds) = (vec![scenario; count], vec![Seed::default(); count]);
        group.throughput(Throughput::Elements(steps * count as u64));
        group.bench_function(BenchmarkId::new(name, count), |bencher| {
            bencher.iter(|| {
                rollout(&scenarios, &law, &seeds, Some(1), |_| true)
                    .expect("the thesis manoeuvre can be flown")
            });
        });
    }
    group.finish();
}

/// Control periods of batches on one thread; an element is one of one environment.
fn batches(criterion: &mut Criterion) {
    let config = Arc::new(EnvConfig::default());
    let mut group = criterion.benchmark_group("batch_step");
    for count in [1, 8, 64, 1024] {
        let mut batch = Batch::new(Arc::clone(&config), count, Autoreset::SameStep, Some(1))
            .expect("the default configuration can be flown");
        let seeds: Vec<Option<Seed>> = (0..count as u64).map(|i| Some(Seed::from_u64(i))).collect();
        batch.reset(&seeds, None, None).expect("it can be reset");
        let size = batch.observation_size();
        let actions = vec![0.01; 2 * count];
        let (mut observations, mut rewards) = (vec![0.0; count * size], vec![0.0; count]);
        let (mut terminated, mut truncated) = (vec![false; count], vec![false; count]);
        let mut terms = vec![0.0; 3 * count];
        group.throughput(Throughput::Elements(count as u64));
        group.bench_function(BenchmarkId::from_parameter(count), |bencher| {
            bencher.iter(|| {
                let mut out = StepBuffers {
                    observations: &mut observations,
                    rewards: &mut rewards,
                    terminated: &mut terminated,
                    truncated: &mut truncated,
                    terms: &mut terms,
                };
                batch.step(&actions, &mut out).expect("it can be stepped");
            });
        });
    }
    group.finish();
}

/// Pictures of the end of an episode, with its curves and its trail; an element is a picture.
fn pictures(criterion: &mut Criterion) {
    let config =
        ValidConfig::new(EnvConfig::default()).expect("the default configuration is valid");
    let mut env = Env::new(config).expect("the default configuration can be flown");
    env.reset(Some(Seed::from_u64(0)), &Overrides::new())
        .expect("it can be reset");
    let mut follower = Follower::default();
    while env.is_running() {
        follower.take(&env, false).expect("it is being flown");
        env.step(&[0.2, -0.2]).expect("it is running");
    }
    let mut group = criterion.benchmark_group("picture");
    group.throughput(Throughput::Elements(1));
    for (width, height) in [(320, 240), (640, 480), (800, 450), (1280, 720)] {
        let look = Look {
            width,
            height,
            title: "a policy".to_owned(),
            colour: [0, 114, 178],
        };
        let name = format!("{width}x{height}");
        group.bench_function(BenchmarkId::new("size", name), |bencher| {
            bencher.iter(|| follower.draw(&look, None));
        });
    }
    group.finish();
}

criterion_group!(benches, steps, manoeuvres, batches, pictures);
criterion_main!(benches);
