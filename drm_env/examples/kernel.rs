//! Time of a Runge-Kutta step of the kernel: `kernel [--lanes N] [--steps K]`.

use drm_env::benchmark::kernel;
use drm_env::lane::Instructions;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (mut lanes, mut steps) = (0, 1_000_000);
    let mut arguments = std::env::args().skip(1);
    while let Some(name) = arguments.next() {
        let value = arguments
            .next()
            .ok_or_else(|| format!("{name} needs a value"))?;
        match name.as_str() {
            "--lanes" => lanes = value.parse()?,
            "--steps" => steps = value.parse()?,
            other => return Err(format!("unknown option {other}: use --lanes and --steps").into()),
        }
    }
    let time = kernel(lanes, steps)?;
    println!("{}, lanes: {}", Instructions::detect().name(), time.lanes);
    println!(
        "{} steps: {:.2} ns a step and environment",
        time.steps, time.nanoseconds
    );
    Ok(())
}
