//! Time of a Runge-Kutta step of the kernel: `kernel [--lanes N] [--steps K]`.
#![allow(clippy::print_stdout)] // it is what an example is for

use drm_env::benchmark::kernel;
use drm_env::simd::Instructions;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = pico_args::Arguments::from_env();
    let lanes = arguments.opt_value_from_str("--lanes")?.unwrap_or(0);
    let steps = arguments
        .opt_value_from_str("--steps")?
        .unwrap_or(1_000_000);
    let unknown = arguments.finish();
    if !unknown.is_empty() {
        return Err(format!("unknown arguments {unknown:?}: use --lanes N and --steps K").into());
    }
    let time = kernel(lanes, steps)?;
    println!("{}, lanes: {}", Instructions::detect().name(), time.lanes);
    println!(
        "{} steps: {:.2} ns a step and environment",
        time.steps, time.nanoseconds
    );
    Ok(())
}
