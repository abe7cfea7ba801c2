//! Environments that are stepped side by side, one a lane: episodes drawn from one configuration.

use std::sync::Arc;

use crate::config::parameter::Overrides;
use crate::config::{Actuator, Task};
use crate::env::agent::{Agent, hold};
use crate::env::episode::{Draft, Member, Phase};
use crate::env::observation::{frame_now, observe, told_payload};
use crate::env::reward::RewardSums;
use crate::env::reward::charge_for_rest;
use crate::env::setup::Setup;
use crate::error::ConfigError;
use crate::hardware::reaction_wheel::WheelTorques;
use crate::math::rng::{Purpose, Seed, Stream};
use crate::simd::dispatch::{Vector, Work, variants};
use crate::simd::mask::everyone;
use crate::simd::mask::lanes_of;
use crate::simd::{Laned, Number};
use crate::simulation::course::{Course, Turn};
use crate::simulation::hook::{Hooked, StepHook};
use crate::simulation::{Flight, Plan};

/// What a step returns besides the observations; flags are a bit a lane.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Outcomes<T> {
    pub(crate) reward: T,
    pub(crate) terminated: u32,
    pub(crate) truncated: u32,
}

/// `T::WIDTH` environments of one configuration.
#[derive(Debug, Clone)]
pub struct EnvPack<T: Number> {
    pub(crate) setup: Arc<Setup>,
    pub(crate) members: Vec<Member>,
    pub(crate) flight: Flight<T>,
    /// Payload as it is observed: mass (kg), length and width (m).
    pub(crate) payload: [T; 3],
    pub(crate) steps: T,
    /// Samples flown in the legs of a mission before the present one.
    pub(crate) before: T,
    pub(crate) action: [T; 3],
    pub(crate) terms: [T; 3],
    pub(crate) episode_return: T,
    /// Lanes whose episode ended by divergence or at a limit, a bit each.
    pub(crate) diverged: u32,
    /// One row a lane, oldest frame first.
    pub(crate) observations: Vec<f32>,
}

impl<T: Number> EnvPack<T> {
    /// The same environment in every lane.
    pub(crate) fn spread(single: &EnvPack<f64>) -> Self {
        Self {
            setup: Arc::clone(&single.setup),
            members: vec![single.members[0].clone(); T::WIDTH],
            flight: Flight::spread(&single.flight),
            payload: Laned::spread(&single.payload),
            steps: T::splat(single.steps),
            before: T::splat(single.before),
            action: Laned::spread(&single.action),
            terms: Laned::spread(&single.terms),
            episode_return: T::splat(single.episode_return),
            diverged: if single.diverged == 0 { 0 } else { u32::MAX },
            observations: single.observations.repeat(T::WIDTH),
        }
    }

    /// The environment of one lane.
    pub(crate) fn one(&self, lane: usize) -> EnvPack<f64> {
        EnvPack {
            setup: Arc::clone(&self.setup),
            members: vec![self.members[lane].clone()],
            flight: self.flight.one(lane),
            payload: self.payload.lane_of(lane),
            steps: self.steps.lane(lane),
            before: self.before.lane(lane),
            action: self.action.lane_of(lane),
            terms: self.terms.lane_of(lane),
            episode_return: self.episode_return.lane(lane),
            diverged: self.diverged >> lane & 1,
            observations: self.observation_of(lane).to_vec(),
        }
    }

    /// Replaces the environment of one lane by another of the same configuration.
    pub(crate) fn put(&mut self, lane: usize, single: &EnvPack<f64>) {
        self.members[lane].clone_from(&single.members[0]);
        self.flight.put(lane, &single.flight);
        self.payload.put_lane(lane, &single.payload);
        self.steps.put_lane(lane, &single.steps);
        self.before.put_lane(lane, &single.before);
        self.action.put_lane(lane, &single.action);
        self.terms.put_lane(lane, &single.terms);
        self.episode_return.put_lane(lane, &single.episode_return);
        self.diverged = self.diverged & !(1 << lane) | single.diverged << lane;
        let size = self.setup.observation_size;
        self.observations[lane * size..][..size].copy_from_slice(&single.observations);
    }

    /// Memory of it, bytes, about.
    pub(crate) fn bytes(&self) -> usize {
        size_of::<Self>() - size_of::<Flight<T>>()
            + self.flight.bytes()
            + self.members.len() * size_of::<Member>()
            + size_of_val(self.observations.as_slice())
    }

    /// Observation of one lane, scaled, oldest frame first.
    pub(crate) fn observation_of(&self, lane: usize) -> &[f32] {
        let size = self.setup.observation_size;
        &self.observations[lane * size..][..size]
    }

    /// Draws the next episode of a lane: the first of a seed, or the one after the present.
    ///
    /// # Errors
    /// A scenario that cannot be flown.
    pub(crate) fn draw(
        &self,
        lane: usize,
        seed: Option<Seed>,
        once: &Overrides,
    ) -> Result<Draft, ConfigError> {
        let member = &self.members[lane];
        let (seed, episode) = match (seed, member.phase) {
            (Some(seed), _) => (seed, 0),
            (None, Phase::Fresh) => (member.seed, 0),
            (None, _) => (member.seed, member.episode + 1),
        };
        let overrides = [&member.persistent, once];
        Ok(Draft {
            seed,
            episode,
            scenario: self.setup.config.draw(seed, episode, &overrides)?,
        })
    }

    /// Overrides what is drawn in every later episode of a lane, until called again; see
    /// [`EnvPack::check_context`].
    pub(crate) fn set_lane_context(&mut self, lane: usize, settings: Overrides) {
        self.members[lane].persistent = settings;
    }

    /// Refuses settings with which the configuration cannot be flown.
    pub(crate) fn check_context(
        &self,
        lane: usize,
        settings: &Overrides,
    ) -> Result<(), ConfigError> {
        let member = &self.members[lane];
        let config = &self.setup.config;
        config.check_overrides(member.seed, member.episode, settings)
    }

    /// Begins an episode in a lane.
    ///
    /// # Errors
    /// Parameters that no arm has; nothing has changed then.
    pub(crate) fn begin(&mut self, lane: usize, draft: &Draft) -> Result<(), ConfigError> {
        let noise = Stream::new(draft.seed, draft.episode, Purpose::Sensors);
        let (flight, course) = match self.setup.config.mission_of(draft.scenario)? {
            None => (Flight::new(Plan::new(draft.scenario)?, noise)?, None),
            Some(mission) => {
                let (flight, course) = Course::begin(mission, noise)?;
                (flight, Some(Box::new(course)))
            }
        };
        let payload = told_payload(&flight.scenario(), &self.setup.config.task)?;
        self.start(lane, &flight, payload, draft.seed, draft.episode);
        self.members[lane].course = course;
        Ok(())
    }

    /// Begins an episode in a lane with a manoeuvre at its beginning that the others accept; `payload`
    /// is what is told of it, see [`told_payload`].
    pub(crate) fn start(
        &mut self,
        lane: usize,
        flight: &Flight<f64>,
        payload: [f64; 3],
        seed: Seed,
        episode: u64,
    ) {
        let setup = Arc::clone(&self.setup);
        self.flight.put(lane, flight);
        let member = &mut self.members[lane];
        member.seed = seed;
        member.episode = episode;
        member.phase = Phase::Running;
        member.course = None;
        self.before.set_lane(lane, 0.0);
        self.payload.put_lane(lane, &payload);
        self.steps.set_lane(lane, 0.0);
        self.action.put_lane(lane, &[0.0; 3]);
        self.terms.put_lane(lane, &[0.0; 3]);
        self.episode_return.set_lane(lane, 0.0);
        self.diverged &= !(1 << lane);
        let frame = frame_now(flight, &setup.config, &payload);
        let size = setup.observation_size;
        for row in self.observations[lane * size..][..size].chunks_exact_mut(frame.len()) {
            row.copy_from_slice(&frame);
        }
    }

    /// One control period of the lanes whose bits are set, which must be running, under finite
    /// actions, a row a lane; entries beyond -1..=1 are limited to it.
    pub(crate) fn step_lanes(&mut self, actions: &[f32], lanes: u32) -> Outcomes<T>
    where
        T: Vector,
    {
        self.step_watched(actions, lanes, None)
    }

    /// [`EnvPack::step_lanes`] with a hook.
    pub(crate) fn step_watched(
        &mut self,
        actions: &[f32],
        lanes: u32,
        hook: Option<&mut (dyn StepHook<T> + '_)>,
    ) -> Outcomes<T>
    where
        T: Vector,
    {
        T::enter(Step {
            pack: self,
            actions,
            lanes,
            hook,
        })
    }

    #[inline(always)]
    fn step_inlined(
        &mut self,
        actions: &[f32],
        lanes: u32,
        hook: Option<&mut (dyn StepHook<T> + '_)>,
    ) -> Outcomes<T>
    where
        T: Vector,
    {
        // not a clone: threads that count in the same place wait for each other
        let setup = &*self.setup;
        let task = &setup.config.task;
        let held = hold(&mut self.action, actions, lanes, task);
        let fixed = self.flight.fixed();
        let zero = T::splat(0.0);
        let mut command = WheelTorques {
            root: zero,
            tip: zero,
        };
        let mut slew = None;
        let scale = setup.config.task.wheel_scale;
        for (actuator, fraction) in task.actuators.iter().zip(held) {
            match actuator {
                Actuator::RootWheel => command.root = fraction * fixed.root.torque * scale,
                Actuator::TipWheel => command.tip = fraction * fixed.tip.torque * scale,
                Actuator::SlewMotor => {
                    slew = Some(fraction * setup.config.scenario.slew_motor.torque_limit);
                }
            }
        }
        let horizon = T::splat(setup.horizon as f64);
        let flown_before = self.flight.common.sample + self.before;
        let left = (horizon - flown_before).max(zero);
        let samples = left.min(T::splat(setup.samples_per_action as f64));
        let mut agent = Agent {
            task,
            scale: &setup.scale,
            command,
            slew,
            samples,
            flown: zero,
            sums: RewardSums::none(),
            lost: 0,
        };
        let spent = zero.below(samples).bits() ^ everyone::<T>();
        self.flight.rest(!lanes | spent);
        if lanes & !spent != 0 {
            let controller = &mut agent;
            self.flight
                .fly(setup.samples_per_action, &mut Hooked { controller, hook });
        }
        let Agent {
            flown, sums, lost, ..
        } = agent;
        let period = self.flight.sample_period();
        let mut terms = sums.terms(&setup.scale, flown * period);
        for lane in lanes_of(lost) {
            let rest = (left.lane(lane) - flown.lane(lane)) * period;
            let reach = self.flight.reach().lane(lane);
            let charge = charge_for_rest(task, &setup.scale, reach, rest);
            for (term, charge) in terms.iter_mut().zip(charge) {
                let charged = term.lane(lane) + charge;
                term.set_lane(lane, charged);
            }
        }
        let reward = terms[0] + terms[1] + terms[2];
        let one = T::splat(1.0);
        if lanes == everyone::<T>() {
            self.terms = terms;
            self.steps += one;
            self.episode_return += reward;
        } else {
            for lane in lanes_of(lanes) {
                self.terms.put_lane(lane, &terms.lane_of(lane));
                self.steps.set_lane(lane, self.steps.lane(lane) + 1.0);
                let sum = self.episode_return.lane(lane) + reward.lane(lane);
                self.episode_return.set_lane(lane, sum);
            }
        }
        self.diverged |= lost;
        let completed = if setup.config.mission.is_some() {
            let mut missions = Missions {
                task,
                flight: &mut self.flight,
                members: &mut self.members,
                before: &mut self.before,
                payload: &mut self.payload,
            };
            missions.turn(&self.terms, lanes & !spent, lost)
        } else {
            0
        };
        // a void state is not observed: the last observation of a valid one stays
        let valid = lanes & !self.flight.void();
        let (size, frame) = (setup.observation_size, setup.frame_size);
        if size > frame {
            for lane in lanes_of(valid) {
                self.observations[lane * size..][..size].copy_within(frame.., 0);
            }
        }
        let mut rows = self.observations.chunks_exact_mut(size).enumerate();
        if task.observe_still_tip_error {
            self.flight.model_for(&setup.config.believed());
        }
        observe(&self.flight, task, &self.payload, valid, |lane| {
            // lanes come in rising order
            rows.by_ref()
                .find(|(i, _)| *i == lane)
                .map(|(_, row)| &mut row[size - frame..])
                .unwrap_or_default()
        });
        let cut = T::splat(setup.cut as f64);
        let over = one - (self.flight.common.sample + self.before).below(cut);
        let truncated = over.bits() & lanes & !lost & !completed;
        for lane in lanes_of(lost | completed | truncated) {
            self.members[lane].phase = Phase::Ended;
        }
        Outcomes {
            reward,
            terminated: lost | completed,
            truncated,
        }
    }

    /// The mission under way in a lane.
    pub(crate) fn course_of(&self, lane: usize) -> Option<&Course> {
        self.members[lane].course.as_deref()
    }
}

/// What changes where the legs of missions end.
struct Missions<'a, T: Number> {
    task: &'a Task,
    flight: &'a mut Flight<T>,
    members: &'a mut [Member],
    before: &'a mut T,
    payload: &'a mut [T; 3],
}

impl<T: Number> Missions<'_, T> {
    /// Lets missions go on after a step of some lanes that has paid these terms: those that have come to
    /// the end of a leg, and are not `lost`, begin the next one. Lanes that have flown their last leg
    /// are returned, a bit each.
    #[inline(never)]
    fn turn(&mut self, terms: &[T; 3], lanes: u32, lost: u32) -> u32 {
        let mut completed = 0;
        for lane in lanes_of(lanes) {
            let Some(course) = &mut self.members[lane].course else {
                continue;
            };
            course.pay(terms.lane_of(lane));
            let sample = self.flight.common.sample.lane(lane) as u64;
            if lost >> lane & 1 == 1 || !course.is_due(sample) {
                continue;
            }
            match course.look(&self.flight.one(lane)) {
                Turn::Same => continue,
                Turn::Next(next) => {
                    self.flight.put(lane, &next);
                    // what flies has a payload that can be told
                    let told = told_payload(&next.scenario(), self.task);
                    self.payload.put_lane(lane, &told.unwrap_or([0.0; 3]));
                }
                Turn::Done => completed |= 1 << lane,
            }
            self.before.set_lane(lane, course.before() as f64);
        }
        completed
    }
}

struct Step<'a, 'b, T: Number> {
    pack: &'a mut EnvPack<T>,
    actions: &'a [f32],
    lanes: u32,
    hook: Option<&'a mut (dyn StepHook<T> + 'b)>,
}

variants!(step);

impl<T: Vector> Work for Step<'_, '_, T> {
    type Output = Outcomes<T>;
    type Variants = step::Here;

    #[inline(always)]
    fn run(self) -> Outcomes<T> {
        self.pack.step_inlined(self.actions, self.lanes, self.hook)
    }
}
