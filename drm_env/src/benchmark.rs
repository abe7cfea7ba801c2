//! Timed runs of the engine's own code, without Python around it.

use std::time::Instant;

use crate::batch::{Autoreset, Batch, StepBuffers};
use crate::config::ValidConfig;
use crate::config::parameter::Overrides;
use crate::config::scenario::Scenario;
use crate::env::Env;
use crate::error::{ConfigError, Error};
use crate::hardware::reaction_wheel::WheelState;
use crate::interruption;
use crate::math::rng::Seed;
use crate::plant::RigidInertia;
use crate::plant::thesis::Constants;
use crate::reference::timeline::Piece;
use crate::simd::dispatch::{Vector, Work, variants};
use crate::simd::{Instructions, Laned, Narrow};
use crate::simulation::plan::Plan;
use crate::simulation::propagate_thesis::{FsalCache, Segment, Switches, WheelDrive};

/// Time of the kernel and what it ended at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KernelTime {
    /// Lanes side by side.
    pub lanes: usize,
    /// Steps flown in each lane.
    pub steps: usize,
    /// Nanoseconds per Runge-Kutta step and environment.
    pub nanoseconds: f64,
    /// theta, alpha, beta and their rates at the end, of lane 0.
    pub motion: [f64; 6],
}

/// Flies the thesis manoeuvre (Payload 1, axial load included) open loop on the calling thread, again
/// and again until at least `steps` Runge-Kutta steps of 0.5 ms are done: in one lane as a single
/// environment does, or in as many as there are side by side. 0 lanes are the most of the processor.
///
/// # Errors
/// A number of lanes that the processor has no instructions for.
pub fn kernel(lanes: usize, steps: usize) -> Result<KernelTime, ConfigError> {
    let widths = Instructions::detect().widths();
    let lanes = if lanes == 0 { widths[0] } else { lanes };
    if !widths.contains(&lanes) {
        let requirement = format!("must be one of {widths:?} on this processor, or 0");
        return Err(ConfigError::value("lanes", requirement, lanes));
    }
    let plan = Plan::new(&Scenario::default())?;
    Ok(match lanes {
        #[cfg(target_arch = "x86_64")]
        8 => Manoeuvre::<crate::simd::x86::Wide8>::new(&plan).time(steps),
        #[cfg(target_arch = "x86_64")]
        4 => Manoeuvre::<crate::simd::x86::Wide4>::new(&plan).time(steps),
        2 => Manoeuvre::<Narrow>::new(&plan).time(steps),
        _ => Manoeuvre::<f64>::new(&plan).time(steps),
    })
}

/// The slew of one plan in every lane.
struct Manoeuvre<T> {
    constants: Constants<T>,
    inertia: RigidInertia<T>,
    /// Pieces with their duration, s, and the whole samples that they hold.
    pieces: Vec<(Piece<T>, f64, usize)>,
    steps_per_sample: usize,
    motion: [T; 6],
}

impl<T: Vector> Manoeuvre<T> {
    fn new(plan: &Plan) -> Self {
        let scenario = &plan.scenario;
        let constants = Constants::new(&scenario.arm, &plan.payload, &scenario.dynamics);
        let timeline = &plan.timeline;
        let mut pieces = Vec::new();
        let mut index = timeline.index(0.0);
        while timeline.end(index).is_finite() {
            let piece = timeline.piece(index);
            let span = timeline.end(index) - piece.start;
            let samples = (span / scenario.sample_period).ceil().max(1.0) as usize;
            pieces.push((Piece::spread(piece), span, samples));
            index += 1;
        }
        Self {
            constants: Constants::spread(&constants),
            inertia: RigidInertia::spread(&RigidInertia::new(&scenario.arm, &plan.reported)),
            pieces,
            steps_per_sample: plan.steps_per_sample(),
            motion: [T::splat(0.0); 6],
        }
    }

    fn time(mut self, least: usize) -> KernelTime {
        let begin = Instant::now();
        let mut steps = 0;
        while steps < least {
            interruption::poll();
            steps += T::enter(Slew(&mut self));
        }
        let seconds = begin.elapsed().as_secs_f64();
        KernelTime {
            lanes: T::WIDTH,
            steps,
            nanoseconds: seconds * 1e9 / (steps * T::WIDTH) as f64,
            motion: self.motion.lane_of(0),
        }
    }
}

struct Slew<'a, T>(&'a mut Manoeuvre<T>);

variants!(slew);

impl<T: Vector> Work for Slew<'_, T> {
    type Output = usize;
    type Variants = slew::Here;

    #[inline(always)]
    fn run(self) -> usize {
        let Manoeuvre {
            constants,
            inertia,
            pieces,
            steps_per_sample,
            motion,
        } = self.0;
        let zero = T::splat(0.0);
        *motion = [zero; 6];
        let (mut root, mut tip) = (WheelState::rest(), WheelState::rest());
        let off = WheelDrive {
            command: zero,
            memory: zero,
            decay: zero,
            momentum_limit: zero,
        };
        let mut steps = 0;
        for (piece, span, samples) in pieces.iter() {
            let mut carried = FsalCache::nothing();
            let period = span / *samples as f64;
            let h = T::splat(period / *steps_per_sample as f64);
            for sample in 0..*samples {
                let leg = Segment {
                    constants,
                    inertia,
                    piece,
                    slew: None,
                    root: off,
                    tip: off,
                    from: T::splat(sample as f64 * period),
                    until: T::splat((sample + 1) as f64 * period),
                    h,
                    steps: *steps_per_sample,
                    still: false,
                };
                leg.fly(Switches::USUAL, motion, &mut root, &mut tip, &mut carried);
                steps += *steps_per_sample;
            }
        }
        steps
    }
}

/// Steps of one environment between two looks whether to stop: often enough, and nothing in the time.
const STEPS_BETWEEN_POLLS: usize = 64;

/// Seconds that a single environment takes for so many control periods under small actions, resets
/// included.
///
/// # Errors
/// A configuration that cannot be flown.
pub fn environment(config: &ValidConfig, steps: usize) -> Result<f64, Error> {
    let mut env = Env::new(config.clone())?;
    let none = Overrides::new();
    env.reset(Some(Seed::default()), &none)?;
    let action = vec![0.01; config.task.actuators.len()];
    let begin = Instant::now();
    for step in 0..steps {
        if step.is_multiple_of(STEPS_BETWEEN_POLLS) {
            interruption::poll();
        }
        let outcome = env.step(&action)?;
        if outcome.terminated || outcome.truncated {
            env.reset(None, &none)?;
        }
    }
    Ok(begin.elapsed().as_secs_f64())
}

/// Seconds that a batch takes for so many control periods under small actions, automatic resets in
/// the same step included. `threads` is the most that it may use.
///
/// # Errors
/// A configuration that cannot be flown.
pub fn batch(
    config: &ValidConfig,
    count: usize,
    steps: usize,
    threads: Option<usize>,
) -> Result<f64, Error> {
    let mut batch = Batch::new(config.clone(), count, Autoreset::SameStep, threads)?;
    let seeds: Vec<Option<Seed>> = (0..count as u64)
        .map(|seed| Some(Seed::from_u64(seed)))
        .collect();
    batch.reset(&seeds, None, None)?;
    let size = batch.observation_size();
    let actions = vec![0.01; count * config.task.actuators.len()];
    let (mut observations, mut rewards) = (vec![0.0; count * size], vec![0.0; count]);
    let (mut terminated, mut truncated) = (vec![false; count], vec![false; count]);
    let mut terms = vec![0.0; count * 3];
    let mut step = |batch: &mut Batch| {
        let mut out = StepBuffers {
            observations: &mut observations,
            rewards: &mut rewards,
            terminated: &mut terminated,
            truncated: &mut truncated,
            terms: &mut terms,
        };
        batch.step(&actions, &mut out)
    };
    // the first step makes the threads
    step(&mut batch)?;
    let begin = Instant::now();
    for _ in 0..steps {
        interruption::poll();
        step(&mut batch)?;
    }
    Ok(begin.elapsed().as_secs_f64())
}
