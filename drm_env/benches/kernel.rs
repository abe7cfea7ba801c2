//! Time of the closed-loop manoeuvre, per integration step.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use drm_env::control::Law;
use drm_env::rng::Seed;
use drm_env::rollout::rollout;
use drm_env::scenario::Scenario;

/// The thesis manoeuvre on one thread; an element is one Runge-Kutta step of 0.5 ms.
fn manoeuvre(criterion: &mut Criterion) {
    let scenario = Scenario::default();
    let steps = (scenario.horizon / scenario.integrator_step).round() as u64;
    let mut group = criterion.benchmark_group("rollout_per_step");
    group.throughput(Throughput::Elements(steps));
    for name in ["none", "linear", "lyapunov"] {
        let law = Law::named(name).expect("a law of this name exists");
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                rollout(&[scenario], &law, &[Seed::default()], Some(1), |_| true)
                    .expect("the thesis manoeuvre can be flown")
            });
        });
    }
    group.finish();
}

criterion_group!(benches, manoeuvre);
criterion_main!(benches);
