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
use crate::simulation::hook::{Hooked, StepHook};

use super::place::{After, Place};
use super::queue::{Queue, Taken};
use super::recorder::Recorder;

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
            let row = (place.before() + flight.common.sample.lane(lane) as usize) / hold;
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

/// Flies manoeuvres side by side until there are no more: a lane that has ended takes the next one.
pub(super) fn fly<T: Vector>(queue: &Queue<'_>, commands: &Commands<'_>) {
    let Some((index, first, course)) = queue.take() else {
        return;
    };
    let mut lanes: Vec<Option<Place>> = vec![None; T::WIDTH];
    lanes[0] = Some(Place::new(index, &first, course));
    let mut flight = Flight::<T>::spread(&first);
    let mut recorder = queue.recorder(T::WIDTH);
    let mut more = true;
    loop {
        for (lane, taken) in lanes.iter_mut().enumerate() {
            while more && taken.is_none() {
                match queue.take() {
                    None => more = false,
                    Some((index, next, course)) if flight.accepts(&next) => {
                        *taken = Some(Place::new(index, &next, course));
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

/// Flies one manoeuvre whose equations or samples are not those of the others.
fn fly_alone(queue: &Queue<'_>, taken: Taken, commands: &Commands<'_>) {
    let (index, mut flight, course) = taken;
    let mut lanes = [Some(Place::new(index, &flight, course))];
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
        let lost = lost_lanes >> lane & 1 == 1;
        let recorder = recorder.as_deref_mut();
        if let After::Ended(ended) = place.flown(flown, lost, flight, lane, recorder) {
            queue.send(place.index, Ok(*ended));
            lanes[lane] = None;
        }
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
