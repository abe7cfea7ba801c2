//! Environments side by side, whatever the number of lanes.

use std::fmt::Debug;
use std::sync::Arc;

use crate::config::context;
use crate::config::parameter::{COUNT, Overrides};
use crate::env::Env;
use crate::env::episode::Draft;
use crate::env::episode::Phase;
use crate::env::pack::EnvPack;
use crate::env::setup::Setup;
use crate::error::ConfigError;
use crate::interruption;
use crate::math::rng::Seed;
use crate::memory;
use crate::simd::dispatch::Vector;
use crate::simd::mask::lanes_of;
use crate::simd::{Instructions, Narrow};
use crate::simulation::metrics::Metrics;

/// Results of one step, a row a lane.
pub(crate) struct Rows<'a> {
    pub(crate) observations: &'a mut [f32],
    pub(crate) rewards: &'a mut [f64],
    pub(crate) terminated: &'a mut [bool],
    pub(crate) truncated: &'a mut [bool],
    /// Three a lane.
    pub(crate) terms: &'a mut [f64],
}

/// Environments that are stepped side by side.
pub(crate) trait AnyEnvPack: Send + Sync + Debug {
    /// Number of lanes.
    fn width(&self) -> usize;
    /// Memory of it, bytes, about.
    fn bytes(&self) -> usize;
    /// One control period of the lanes whose bits are set; writes their rows.
    fn step(&mut self, actions: &[f32], lanes: u32, rows: &mut Rows<'_>);
    /// Writes the row of a lane that has not been stepped.
    fn write(&self, lane: usize, reward: f64, rows: &mut Rows<'_>);
    /// Writes the observation of a lane into its row.
    fn write_observation(&self, lane: usize, rows: &mut Rows<'_>);
    /// What is kept of the episode of a lane that has ended.
    fn end(&self, lane: usize) -> Ended;
    /// See [`EnvPack::draw`].
    fn draw(&self, lane: usize, seed: Option<Seed>, once: &Overrides)
    -> Result<Draft, ConfigError>;
    /// See [`EnvPack::begin`].
    fn begin(&mut self, lane: usize, draft: &Draft) -> Result<(), ConfigError>;
    /// See [`EnvPack::check_context`].
    fn check_context(&self, lane: usize, settings: &Overrides) -> Result<(), ConfigError>;
    /// See [`EnvPack::set_lane_context`].
    fn set_context(&mut self, lane: usize, settings: Overrides);
    /// The true context of a lane.
    fn context(&self, lane: usize) -> [f64; COUNT];
    /// Place of the leg under way in a lane; 0 of a manoeuvre.
    fn leg(&self, lane: usize) -> usize;
    /// True coordinates of a lane and their rates: see [`crate::batch::Batch::coordinates`].
    fn coordinates(&self, lane: usize) -> [f64; COORDINATES];
    /// Where a lane is in its life.
    fn phase(&self, lane: usize) -> Phase;
    /// Observation of a lane.
    fn observation_of(&self, lane: usize) -> &[f32];
    /// The environment of a lane.
    fn one(&self, lane: usize) -> Env;
    /// Replaces the environment of a lane.
    fn put(&mut self, lane: usize, env: &Env);
    /// Replaces what the environments have in common by what fits their flights as well.
    fn set_up(&mut self, setup: &Arc<Setup>);
}

impl<T: Vector> AnyEnvPack for EnvPack<T> {
    fn width(&self) -> usize {
        T::WIDTH
    }

    fn bytes(&self) -> usize {
        EnvPack::bytes(self)
    }

    fn step(&mut self, actions: &[f32], lanes: u32, rows: &mut Rows<'_>) {
        if lanes == 0 {
            return;
        }
        let outcomes = self.step_lanes(actions, lanes);
        for lane in lanes_of(lanes) {
            self.write(lane, outcomes.reward.lane(lane), rows);
            rows.terminated[lane] = outcomes.terminated >> lane & 1 == 1;
            rows.truncated[lane] = outcomes.truncated >> lane & 1 == 1;
        }
    }

    fn write(&self, lane: usize, reward: f64, rows: &mut Rows<'_>) {
        rows.rewards[lane] = reward;
        rows.terminated[lane] = false;
        rows.truncated[lane] = false;
        for (slot, term) in rows.terms[3 * lane..].iter_mut().zip(&self.terms) {
            *slot = term.lane(lane);
        }
        self.write_observation(lane, rows);
    }

    fn write_observation(&self, lane: usize, rows: &mut Rows<'_>) {
        let row = self.observation_of(lane);
        rows.observations[lane * row.len()..][..row.len()].copy_from_slice(row);
    }

    fn end(&self, lane: usize) -> Ended {
        let env = self.one(lane);
        Ended {
            metrics: env.metrics(),
            context: env.context().to_vec(),
            mission: env.mission_report(),
            observation: env.observations,
        }
    }

    fn draw(
        &self,
        lane: usize,
        seed: Option<Seed>,
        once: &Overrides,
    ) -> Result<Draft, ConfigError> {
        EnvPack::draw(self, lane, seed, once)
    }

    fn begin(&mut self, lane: usize, draft: &Draft) -> Result<(), ConfigError> {
        EnvPack::begin(self, lane, draft)
    }

    fn check_context(&self, lane: usize, settings: &Overrides) -> Result<(), ConfigError> {
        EnvPack::check_context(self, lane, settings)
    }

    fn set_context(&mut self, lane: usize, settings: Overrides) {
        self.set_lane_context(lane, settings);
    }

    fn context(&self, lane: usize) -> [f64; COUNT] {
        match self.course_of(lane) {
            Some(course) => context(course.mission().scenario()),
            None => context(&self.flight.scenario_of(lane)),
        }
    }

    fn leg(&self, lane: usize) -> usize {
        self.course_of(lane).map_or(0, |course| course.leg())
    }

    fn coordinates(&self, lane: usize) -> [f64; COORDINATES] {
        let outputs = self.flight.outputs();
        let parts = [outputs.slew, outputs.alpha, outputs.beta];
        std::array::from_fn(|i| parts[i % 3][i / 3].lane(lane))
    }

    fn phase(&self, lane: usize) -> Phase {
        self.members[lane].phase
    }

    fn observation_of(&self, lane: usize) -> &[f32] {
        EnvPack::observation_of(self, lane)
    }

    fn one(&self, lane: usize) -> Env {
        EnvPack::one(self, lane)
    }

    fn put(&mut self, lane: usize, env: &Env) {
        EnvPack::put(self, lane, env);
    }

    fn set_up(&mut self, setup: &Arc<Setup>) {
        self.setup = Arc::clone(setup);
    }
}

/// Lanes of the packs that `count` environments are spread over: the widest, and for the remainder
/// those that waste the least.
pub(crate) fn widths(count: usize, instructions: Instructions) -> Vec<usize> {
    let widest = instructions.lanes();
    let mut widths = vec![widest; count / widest];
    let left = count % widest;
    if left > 0 {
        let fitting = instructions.widths().iter().filter(|width| **width >= left);
        widths.push(fitting.copied().min().unwrap_or(widest));
    }
    widths
}

/// Copies of an environment for a number of them, side by side as the instructions allow. `each` is what
/// every one takes beside its copy, bytes.
///
/// # Errors
/// Instructions that the processor does not have; more than fits into memory.
pub(crate) fn packs(
    env: &Env,
    count: usize,
    instructions: Instructions,
    each: usize,
) -> Result<Vec<Box<dyn AnyEnvPack>>, ConfigError> {
    if instructions > Instructions::detect() {
        let requirement = "must be instructions that the processor has";
        return Err(ConfigError::value(
            "instructions",
            requirement,
            instructions.name(),
        ));
    }
    let pack = |width: usize| -> Box<dyn AnyEnvPack> {
        match width {
            // the processor has been asked for the instructions above
            #[cfg(target_arch = "x86_64")]
            8 => Box::new(EnvPack::<crate::simd::x86::Wide8>::spread(env)),
            #[cfg(target_arch = "x86_64")]
            4 => Box::new(EnvPack::<crate::simd::x86::Wide4>::spread(env)),
            2 => Box::new(EnvPack::<Narrow>::spread(env)),
            _ => Box::new(env.clone()),
        }
    };
    let widest = pack(instructions.lanes());
    let lane = widest.bytes() / widest.width() + each;
    let bytes = count as u128 * lane as u128;
    memory::check("num_envs", count, bytes, None, "a smaller number")?;
    let widths = widths(count, instructions).into_iter();
    let polled = widths.map(|width| {
        interruption::poll();
        pack(width)
    });
    Ok(polled.collect())
}

/// What is kept of an episode that ended in the last step.
#[derive(Debug, Clone)]
pub struct Ended {
    /// Last observation.
    pub observation: Vec<f32>,
    /// Metrics.
    pub metrics: Metrics,
    /// Context of the episode.
    pub context: Vec<f64>,
    /// See [`Env::mission_report`].
    pub mission: Vec<f64>,
}

/// Entries of [`Batch::coordinates`].
pub const COORDINATES: usize = 6;
