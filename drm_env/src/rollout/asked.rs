//! Manoeuvres and missions under a law that is somebody else's: asked for the torques of all of them at once, at
//! its own period.

use crate::config::mission::ValidMission;
use crate::config::scenario::ValidScenario;
use crate::error::{ConfigError, Error, SimulationError};
use crate::hardware::reaction_wheel::WheelTorques;
use crate::hardware::sensors::INSTRUMENTS;
use crate::interruption;
use crate::math::rng::Seed;
use crate::memory;
use crate::simd::Number;
use crate::simd::dispatch::Vector;
use crate::simulation::Flight;
use crate::simulation::controller::Fly;
use crate::simulation::course::Course;
use crate::simulation::hook::{Hooked, StepHook};

use super::Flown;
use super::law::{Given, LawController, Source};
use super::place::{After, Ended, Place, begin};
use super::recorder::{Recorder, Recording};

/// Numbers that a law is told of each manoeuvre.
pub const TOLD: usize = GYRO + 1 + INSTRUMENTS;

/// Numbers of the measurement before the payload.
const SEEN: usize = 11;

/// Place of what the gyro at the tip wheel measures.
const GYRO: usize = SEEN + 3;

/// What a law is told, in the order of the columns: the measurement, the payload as reported, what the gyro at
/// the tip wheel measures, and strain gauges and accelerometer: 0 of one that is not there.
pub const TOLD_NAMES: [&str; TOLD] = [
    "slew_error",
    "slew_error_rate",
    "link2_deflection",
    "link2_deflection_rate",
    "extension",
    "extension_rate",
    "reference_rate",
    "reference_accel",
    "slew_torque",
    "root_momentum",
    "tip_momentum",
    "payload_mass",
    "payload_length",
    "payload_width",
    "tip_turn_rate",
    "link1_moment",
    "link2_moment",
    "tip_acceleration",
];

/// A law that is asked: for what is told of every manoeuvre, the torques of root and tip wheel of each, N m,
/// before saturation; nothing ends the work.
pub type Asked<'a> = dyn FnMut(&[[f64; TOLD]]) -> Option<Vec<[f64; 2]>> + 'a;

/// Torques that are held.
struct Held([f64; 2]);

impl<T: Number> Given<T> for Held {
    fn torques(&mut self, _flight: &Flight<T>) -> WheelTorques<T> {
        let [root, tip] = self.0;
        WheelTorques {
            root: T::splat(root),
            tip: T::splat(tip),
        }
    }
}

/// One manoeuvre or mission.
struct Flying<'a> {
    flight: Flight<f64>,
    place: Place,
    /// Samples from one question to the next.
    hold: usize,
    told: [f64; TOLD],
    recorder: Option<Recorder<'a>>,
    ended: Option<Box<Ended>>,
}

impl<'a> Flying<'a> {
    fn new(
        index: usize,
        scenario: &ValidScenario,
        mission: Option<&ValidMission>,
        seed: Seed,
        hold: usize,
        recording: Option<&'a Recording>,
    ) -> Result<Self, ConfigError> {
        let (flight, course) = begin(scenario, mission, seed)?;
        let mut flying = Self {
            place: Place::new(index, &flight, course),
            flight,
            hold,
            told: [0.0; TOLD],
            recorder: recording.map(|recording| Recorder::new(recording, 1)),
            ended: None,
        };
        flying.hear()?;
        Ok(flying)
    }

    /// Takes up what is reported of the payload, which stays as it is through a leg.
    fn hear(&mut self) -> Result<(), ConfigError> {
        let reported = self.flight.scenario().reported()?;
        self.told[SEEN..GYRO].copy_from_slice(&[reported.mass, reported.length, reported.width]);
        Ok(())
    }

    /// Looks at the manoeuvre; what has ended stays as it was seen last.
    fn look(&mut self) -> [f64; TOLD] {
        if self.ended.is_none() {
            let seen = self.flight.measurement();
            self.told[GYRO] = self.flight.measured_tip_rate();
            let read = self.flight.measured_by_instruments();
            self.told[GYRO + 1..].copy_from_slice(&read);
            self.told[..SEEN].copy_from_slice(&[
                seen.slew_error,
                seen.slew_error_rate,
                seen.link2_deflection,
                seen.link2_deflection_rate,
                seen.extension,
                seen.extension_rate,
                seen.reference_rate,
                seen.reference_accel,
                seen.slew_torque,
                seen.root_momentum,
                seen.tip_momentum,
            ]);
        }
        self.told
    }

    /// Flies on to the next question, over the ends of legs.
    ///
    /// # Errors
    /// A payload that cannot be reported, which no mission has that has been checked.
    fn fly(&mut self, torques: [f64; 2]) -> Result<(), ConfigError> {
        let mut held = Held(torques);
        let mut left = self.hold;
        while left > 0 && self.ended.is_none() {
            interruption::poll();
            if let Some(recorder) = &mut self.recorder {
                recorder.look_again();
            }
            let mut controller = LawController::new(Source::Given(&mut held));
            <f64 as Vector>::enter(Fly {
                flight: &mut self.flight,
                samples: self.place.left.min(left),
                controller: &mut Hooked {
                    controller: &mut controller,
                    hook: self
                        .recorder
                        .as_mut()
                        .map(|recorder| recorder as &mut dyn StepHook<f64>),
                },
            });
            let (flown, lost) = (controller.flown, controller.lost != 0);
            left -= flown;
            let recorder = self.recorder.as_mut();
            match self.place.flown(flown, lost, &mut self.flight, 0, recorder) {
                After::Same => {}
                After::NextLeg => self.hear()?,
                After::Ended(ended) => self.ended = Some(ended),
            }
        }
        Ok(())
    }
}

/// Whole samples in the period of a law; none is one sample.
fn samples_in(period: Option<f64>, sample_period: f64) -> Result<usize, ConfigError> {
    let Some(period) = period else {
        return Ok(1);
    };
    let samples = libm::round(period / sample_period);
    let whole = (samples * sample_period - period).abs() <= 1e-9 * period;
    if whole && (1.0..=1e9).contains(&samples) {
        return Ok(samples as usize);
    }
    let requirement = format!("must be a multiple of the sample period of {sample_period} s");
    Err(ConfigError::value("law_period", requirement, period))
}

/// Flies many manoeuvres under a law that is asked for the torques of all of them every `period` (s; none:
/// every sample). `seeds` feed the sensors' noise, one a scenario. What has ended is told as it was seen last
/// until all have, and its torques are not used.
///
/// # Errors
/// A scenario that cannot be flown, or a period that is no multiple of a sample period, before anything is
/// flown; torques that are not finite or not as many; an interruption.
pub fn fly_asked(
    scenarios: &[ValidScenario],
    seeds: &[Seed],
    period: Option<f64>,
    recording: Option<&Recording>,
    law: &mut Asked<'_>,
    progress: &mut dyn FnMut(usize) -> bool,
) -> Result<Flown, Error> {
    let given = Asking {
        scenarios,
        missions: None,
        seeds,
        period,
        recording,
    };
    given.fly(law, progress)
}

/// [`fly_asked`] for missions: the law is told of the leg under way, its payload as it is reported there, and is
/// asked every `period` from the mission's beginning on, wherever legs begin.
///
/// # Errors
/// See [`fly_asked`]; and rows that are to be kept and do not fall on the legs' beginnings.
pub fn fly_missions_asked(
    missions: &[ValidMission],
    seeds: &[Seed],
    period: Option<f64>,
    recording: Option<&Recording>,
    law: &mut Asked<'_>,
    progress: &mut dyn FnMut(usize) -> bool,
) -> Result<Flown, Error> {
    let scenarios: Vec<ValidScenario> = missions.iter().map(ValidMission::base).collect();
    let given = Asking {
        scenarios: &scenarios,
        missions: Some(missions),
        seeds,
        period,
        recording,
    };
    given.fly(law, progress)
}

/// What is flown under a law that is asked.
struct Asking<'a> {
    scenarios: &'a [ValidScenario],
    /// Missions, each with the scenario in the same place; none are single manoeuvres.
    missions: Option<&'a [ValidMission]>,
    seeds: &'a [Seed],
    period: Option<f64>,
    recording: Option<&'a Recording>,
}

impl<'a> Asking<'a> {
    fn fly(
        &self,
        law: &mut Asked<'_>,
        progress: &mut dyn FnMut(usize) -> bool,
    ) -> Result<Flown, Error> {
        let (count, recording) = (self.scenarios.len(), self.recording);
        self.check()?;
        let mut flown = Flown::room(self.scenarios, self.missions, recording)?;
        let mut flying = self.begin()?;
        let mut done = 0;
        while done < count {
            interruption::poll();
            let told: Vec<_> = flying.iter_mut().map(Flying::look).collect();
            let torques = law(&told).ok_or(SimulationError::Interrupted)?;
            check_torques(&flying, &torques)?;
            for (one, torques) in flying.iter_mut().zip(torques) {
                one.fly(torques)?;
            }
            let ended = flying.iter().filter(|one| one.ended.is_some()).count();
            if ended > done {
                done = ended;
                if !progress(done) {
                    return Err(SimulationError::Interrupted.into());
                }
            }
        }
        for one in flying {
            if let Some(ended) = one.ended {
                flown.take(one.place.index, *ended);
            }
        }
        Ok(flown)
    }

    /// Refuses what does not go together, or does not fit into memory.
    fn check(&self) -> Result<(), Error> {
        let count = self.scenarios.len();
        if self.seeds.len() != count {
            return Err(SimulationError::Length {
                name: "seeds",
                expected: count,
                got: self.seeds.len(),
            }
            .into());
        }
        if let (Some(recording), Some(missions)) = (self.recording, self.missions) {
            recording.check_missions(missions)?;
        }
        let missions = self.missions.unwrap_or_default();
        let courses: u128 = missions.iter().map(Course::bytes).sum();
        let each = size_of::<Flying<'_>>() as u128;
        let bytes = count as u128 * each + courses;
        let less = "a smaller number";
        memory::check("scenarios", count, bytes, None, less)?;
        Ok(())
    }

    /// Everything that is flown, at its beginning.
    fn begin(&self) -> Result<Vec<Flying<'a>>, ConfigError> {
        let mut flying = Vec::with_capacity(self.scenarios.len());
        for (i, (scenario, seed)) in self.scenarios.iter().zip(self.seeds).enumerate() {
            interruption::poll();
            let hold = samples_in(self.period, scenario.sample_period)?;
            let mission = self.missions.map(|missions| &missions[i]);
            let one = Flying::new(i, scenario, mission, *seed, hold, self.recording);
            flying.push(one.map_err(|e| e.within(&format!("scenarios[{i}]")))?);
        }
        Ok(flying)
    }
}

/// Refuses torques that are not finite or not as many as what is flown.
fn check_torques(flying: &[Flying<'_>], torques: &[[f64; 2]]) -> Result<(), Error> {
    if torques.len() != flying.len() {
        return Err(SimulationError::Length {
            name: "law's torques",
            expected: flying.len(),
            got: torques.len(),
        }
        .into());
    }
    for (i, (one, torques)) in flying.iter().zip(torques).enumerate() {
        for (value, wheel) in torques.iter().zip(["root", "tip"]) {
            if !value.is_finite() && one.ended.is_none() {
                let path = format!("the law's {wheel} torque of scenarios[{i}]");
                return Err(ConfigError::value(path, "must be finite", *value).into());
            }
        }
    }
    Ok(())
}
