//! Manoeuvres under a law or under given torques, side by side.

use crate::control::Law;
use crate::error::ConfigError;
use crate::hardware::reaction_wheel::WheelTorques;
use crate::simd::Number;
use crate::simd::dispatch::Vector;
use crate::simd::mask::everyone;
use crate::simd::mask::lanes_of;
use crate::simulation::Flight;
use crate::simulation::controller::Controller;
use crate::simulation::controller::Fly;
use crate::simulation::course::{Course, Turn};
use crate::simulation::hook::{Hooked, StepHook};

use super::queue::{Ended, Queue, Taken};
use super::recorder::{Kept, Recorder};

/// Samples between two looks at the lanes, unless one ends before.
const SAMPLES_BETWEEN_LOOKS: usize = 256;

/// [`Commands`] for the lanes of a flight, or somebody else's. One type: each further kind of
/// controller compiles the whole step anew.
pub(crate) enum Source<'a, T> {
    /// A law.
    Law(&'a Law),
    /// Somebody else.
    Given(&'a mut dyn Given<T>),
}

/// Gives torques without a law.
pub(crate) trait Given<T> {
    /// Wheel torques of the next sample, N m, before saturation.
    fn torques(&mut self, flight: &Flight<T>) -> WheelTorques<T>
    where
        T: Number;
}

/// Torques that are given beforehand, each held for a number of samples; none follow the last.
#[derive(Debug, Clone, Copy)]
pub struct Schedule<'a> {
    /// Root and tip wheel, N m, before saturation: a block a manoeuvre, in it a row a hold.
    pub torques: &'a [[f64; 2]],
    /// Rows of a manoeuvre.
    pub rows: usize,
    /// Samples that a row is held for.
    pub hold: usize,
}

/// A schedule for the manoeuvres in the lanes.
struct ScheduledTorques<'a> {
    schedule: &'a Schedule<'a>,
    lanes: &'a [Option<Place>],
}

impl<T: Number> Given<T> for ScheduledTorques<'_> {
    fn torques(&mut self, flight: &Flight<T>) -> WheelTorques<T> {
        let mut torques = WheelTorques {
            root: T::splat(0.0),
            tip: T::splat(0.0),
        };
        let Schedule {
            torques: given,
            rows,
            hold,
        } = self.schedule;
        for (lane, place) in self.lanes.iter().enumerate() {
            let Some(place) = place else { continue };
            let before = place.course.as_ref().map_or(0, |course| course.before()) as usize;
            let row = (before + flight.common.sample.lane(lane) as usize) / hold;
            if row < *rows {
                let [root, tip] = given[place.index * rows + row];
                torques.root.set_lane(lane, root);
                torques.tip.set_lane(lane, tip);
            }
        }
        torques
    }
}

impl Schedule<'_> {
    /// Refuses torques that are not finite, or held for no sample.
    pub(super) fn validate(&self) -> Result<(), ConfigError> {
        if self.hold == 0 {
            let requirement = "must be at least 1 sample";
            return Err(ConfigError::value("hold", requirement, self.hold));
        }
        let mut torques = self.torques.iter().flatten();
        torques
            .find(|value| !value.is_finite())
            .map_or(Ok(()), |value| {
                Err(ConfigError::value("torques", "must be finite", *value))
            })
    }

    /// Refuses torques of another number of manoeuvres.
    pub(super) fn check_count(&self, count: usize) -> Result<(), ConfigError> {
        let (rows, got) = (self.rows, self.torques.len());
        if got == count * rows {
            return Ok(());
        }
        let requirement = format!("must have {} rows, {rows} for each scenario", count * rows);
        Err(ConfigError::value("torques", requirement, got))
    }
}

/// Where the wheels' torques of a rollout come from.
#[derive(Debug)]
pub(super) enum Commands<'a> {
    Law(&'a Law),
    Schedule(Schedule<'a>),
}

/// A manoeuvre in one lane: its place in the list, the samples that are left of it or until its mission
/// has to be asked, and its mission.
#[derive(Clone)]
pub(super) struct Place {
    index: usize,
    left: usize,
    course: Option<Box<Course>>,
}

/// Flies manoeuvres side by side until there are no more: a lane that has ended takes the next one.
pub(super) fn fly<T: Vector>(queue: &Queue<'_>, commands: &Commands<'_>) {
    let Some((index, first, course)) = queue.take() else {
        return;
    };
    let mut lanes: Vec<Option<Place>> = vec![None; T::WIDTH];
    lanes[0] = Some(place(index, &first, course));
    let mut flight = Flight::<T>::spread(&first);
    let mut recorder = queue.recorder(T::WIDTH);
    let mut more = true;
    loop {
        for (lane, taken) in lanes.iter_mut().enumerate() {
            while more && taken.is_none() {
                match queue.take() {
                    None => more = false,
                    Some((index, next, course)) if flight.accepts(&next) => {
                        *taken = Some(place(index, &next, course));
                        flight.put(lane, &next);
                    }
                    Some(taken) => fly_alone(queue, taken, commands),
                }
            }
        }
        if queue.stopped() || lanes.iter().all(Option::is_none) {
            return;
        }
        leg(queue, commands, &mut flight, &mut lanes, recorder.as_mut());
    }
}

fn place(index: usize, flight: &Flight<f64>, course: Option<Box<Course>>) -> Place {
    let left = match &course {
        None => flight.scenario().samples(),
        Some(course) => course.until_look(0) as usize,
    };
    Place {
        index,
        left,
        course,
    }
}

/// Flies one manoeuvre whose equations or samples are not those of the others.
fn fly_alone(queue: &Queue<'_>, taken: Taken, commands: &Commands<'_>) {
    let (index, mut flight, course) = taken;
    let mut lanes = [Some(place(index, &flight, course))];
    let mut recorder = queue.recorder(1);
    while lanes[0].is_some() && !queue.stopped() {
        leg(queue, commands, &mut flight, &mut lanes, recorder.as_mut());
    }
}

/// Flies until a lane ends or it is time for a look, and hands in those that have ended.
fn leg<T: Vector>(
    queue: &Queue<'_>,
    commands: &Commands<'_>,
    flight: &mut Flight<T>,
    lanes: &mut [Option<Place>],
    mut recorder: Option<&mut Recorder<'_>>,
) {
    let flying = lanes.iter().flatten();
    let left = flying.map(|place| place.left).min().unwrap_or(0);
    let taken = (0..T::WIDTH).filter(|lane| lanes[*lane].is_some());
    let taken = taken.fold(0_u32, |bits, lane| bits | 1 << lane);
    flight.rest(!taken);
    if let Some(recorder) = recorder.as_deref_mut() {
        recorder.look_again();
    }
    let mut played;
    let source = match commands {
        Commands::Law(law) => Source::Law(law),
        Commands::Schedule(schedule) => {
            played = ScheduledTorques { schedule, lanes };
            Source::Given(&mut played)
        }
    };
    let mut controller = LawController::new(source);
    T::enter(Fly {
        flight,
        samples: left.min(SAMPLES_BETWEEN_LOOKS),
        controller: &mut Hooked {
            controller: &mut controller,
            hook: recorder
                .as_deref_mut()
                .map(|recorder| recorder as &mut dyn StepHook<T>),
        },
    });
    let (flown, lost_lanes) = (controller.flown, controller.lost);
    for lane in lanes_of(taken & everyone::<T>()) {
        let Some(place) = &mut lanes[lane] else {
            continue;
        };
        place.left -= flown;
        let lost = lost_lanes >> lane & 1 == 1;
        if place.left == 0 && !lost && place.goes_on(flight, lane) {
            if let (Some(recorder), Some(course)) = (recorder.as_deref_mut(), &place.course) {
                recorder.begin_leg(flight, lane, course.origin(flight.sample_period()));
            }
            continue;
        }
        let index = place.index;
        if place.left == 0 || lost {
            let kept = recorder
                .as_deref_mut()
                .map_or_else(Kept::default, |recorder| recorder.end(flight, lane, false));
            let single = flight.one(lane);
            let (metrics, legs) = match &place.course {
                None => (single.metrics(lost, 0.0), Vec::new()),
                Some(course) => (course.metrics(&single, lost), course.records(&single, lost)),
            };
            let ended = Ended {
                metrics,
                kept,
                legs,
            };
            queue.send(index, Ok(ended));
            lanes[lane] = None;
        }
    }
}

impl Place {
    /// Asks the mission, if it is one, after the samples that were left; whether it goes on, perhaps with
    /// another leg in the lane.
    fn goes_on<T: Number>(&mut self, flight: &mut Flight<T>, lane: usize) -> bool {
        let Some(course) = &mut self.course else {
            return false;
        };
        match course.look(&flight.one(lane)) {
            Turn::Same => {}
            Turn::Next(next) => flight.put(lane, &next),
            Turn::Done => return false,
        }
        self.left = course.until_look(flight.common.sample.lane(lane) as u64) as usize;
        true
    }
}

/// A source of torques as the controller, until a lane leaves the limits of [`crate::validity`].
pub(crate) struct LawController<'a, T> {
    source: Source<'a, T>,
    pub(crate) flown: usize,
    /// Lanes that have left the limits with the last sample, a bit each.
    pub(crate) lost: u32,
}

impl<'a, T> LawController<'a, T> {
    pub(crate) fn new(source: Source<'a, T>) -> Self {
        Self {
            source,
            flown: 0,
            lost: 0,
        }
    }
}

impl<T: Number> Controller<T> for LawController<'_, T> {
    #[inline(always)]
    fn command(&mut self, flight: &mut Flight<T>) -> (WheelTorques<T>, Option<T>) {
        let torques = match &mut self.source {
            Source::Law(law) => flight.law_torques(law),
            Source::Given(given) => given.torques(flight),
        };
        (torques, None)
    }

    #[inline(always)]
    fn flown(&mut self, flight: &mut Flight<T>) -> bool {
        self.flown += 1;
        self.lost = flight.void() & !flight.resting();
        self.lost == 0
    }
}
