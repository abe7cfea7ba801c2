//! Manoeuvres under a law that is somebody else's: asked for the torques of all of them at once, at its
//! own period.

use crate::config::scenario::ValidScenario;
use crate::error::{ConfigError, Error, SimulationError};
use crate::hardware::reaction_wheel::WheelTorques;
use crate::interruption;
use crate::math::rng::Seed;
use crate::memory;
use crate::simd::Number;
use crate::simd::dispatch::Vector;
use crate::simulation::controller::Fly;
use crate::simulation::hook::{Hooked, StepHook};
use crate::simulation::{Flight, Plan};

use super::law::{Given, LawController, Source};
use super::queue::Ended;
use super::recorder::{Recorder, Recording};
use super::{Flown, noise};

/// Numbers that a law is told of each manoeuvre.
pub const TOLD: usize = 15;

/// Numbers of the measurement before the payload.
const SEEN: usize = 11;

/// What a law is told, in the order of the columns: the measurement, the payload as reported, and what the
/// gyro at the tip wheel measures.
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

/// One manoeuvre.
struct Flying<'a> {
    flight: Flight<f64>,
    /// Samples that are left, and those from one question to the next.
    left: usize,
    hold: usize,
    told: [f64; TOLD],
    recorder: Option<Recorder<'a>>,
    ended: Option<Ended>,
}

impl<'a> Flying<'a> {
    fn new(
        scenario: &ValidScenario,
        seed: Seed,
        hold: usize,
        recording: Option<&'a Recording>,
    ) -> Result<Self, ConfigError> {
        let reported = scenario.reported()?;
        let mut told = [0.0; TOLD];
        told[SEEN..TOLD - 1].copy_from_slice(&[reported.mass, reported.length, reported.width]);
        Ok(Self {
            left: scenario.samples(),
            hold,
            told,
            recorder: recording.map(|recording| Recorder::new(recording, 1)),
            flight: Flight::new(Plan::new(scenario)?, noise(seed))?,
            ended: None,
        })
    }

    /// Looks at the manoeuvre; what has ended stays as it was seen last.
    fn look(&mut self) -> [f64; TOLD] {
        if self.ended.is_none() {
            let seen = self.flight.measurement();
            self.told[TOLD - 1] = self.flight.measured_tip_rate();
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

    /// Flies on to the next question.
    fn fly(&mut self, torques: [f64; 2]) {
        if self.ended.is_some() {
            return;
        }
        let mut held = Held(torques);
        let mut controller = LawController::new(Source::Given(&mut held));
        <f64 as Vector>::enter(Fly {
            flight: &mut self.flight,
            samples: self.left.min(self.hold),
            controller: &mut Hooked {
                controller: &mut controller,
                hook: self
                    .recorder
                    .as_mut()
                    .map(|recorder| recorder as &mut dyn StepHook<f64>),
            },
        });
        let lost = controller.lost != 0;
        self.left -= controller.flown;
        if self.left == 0 || lost {
            let recorder = self.recorder.as_mut();
            let kept = recorder.map(|recorder| recorder.end(&self.flight, 0, false));
            self.ended = Some(Ended {
                metrics: self.flight.metrics(lost, 0.0),
                kept: kept.unwrap_or_default(),
                legs: Vec::new(),
            });
        }
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
    let count = scenarios.len();
    if seeds.len() != count {
        return Err(SimulationError::Length {
            name: "seeds",
            expected: count,
            got: seeds.len(),
        }
        .into());
    }
    let each = size_of::<Flying<'_>>() as u128;
    let less = "a smaller number";
    memory::check("scenarios", count, count as u128 * each, None, less)?;
    let mut flown = Flown::room(scenarios, None, recording)?;
    let mut flying = Vec::with_capacity(count);
    for (i, (scenario, seed)) in scenarios.iter().zip(seeds).enumerate() {
        interruption::poll();
        let hold = samples_in(period, scenario.sample_period)?;
        let one = Flying::new(scenario, *seed, hold, recording);
        flying.push(one.map_err(|e| e.within(&format!("scenarios[{i}]")))?);
    }
    let mut done = 0;
    while done < count {
        interruption::poll();
        let told: Vec<_> = flying.iter_mut().map(Flying::look).collect();
        let torques = law(&told).ok_or(SimulationError::Interrupted)?;
        if torques.len() != count {
            return Err(SimulationError::Length {
                name: "law's torques",
                expected: count,
                got: torques.len(),
            }
            .into());
        }
        for (i, (one, torques)) in flying.iter().zip(&torques).enumerate() {
            for (value, wheel) in torques.iter().zip(["root", "tip"]) {
                if !value.is_finite() && one.ended.is_none() {
                    let path = format!("the law's {wheel} torque of scenarios[{i}]");
                    return Err(ConfigError::value(path, "must be finite", *value).into());
                }
            }
        }
        for (one, torques) in flying.iter_mut().zip(torques) {
            interruption::poll();
            one.fly(torques);
        }
        let ended = flying.iter().filter(|one| one.ended.is_some()).count();
        if ended > done {
            done = ended;
            if !progress(done) {
                return Err(SimulationError::Interrupted.into());
            }
        }
    }
    for (index, one) in flying.into_iter().enumerate() {
        if let Some(ended) = one.ended {
            flown.take(index, ended);
        }
    }
    Ok(flown)
}
