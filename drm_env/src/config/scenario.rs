//! One manoeuvre as data: arm, payload true and reported, slew, deployment, wheels, sensors, plant.

use std::ops::Deref;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::arm::{Arm, Payload, PayloadProperties, table_2_7_dimensions};
use crate::check::finite;
use crate::check::non_negative;
use crate::check::positive;
use crate::control::LAW_PERIOD;
use crate::error::ConfigError;
use crate::hardware::reaction_wheel::{RootWheel, TipWheel};
use crate::hardware::sensors::{INSTRUMENTS, Instrument, Sensors};
use crate::hardware::slew_motor::SlewMotor;
use crate::interruption;
use crate::math::runge_kutta::largest_stable_step;
use crate::plant::consistent::CAPACITY;
use crate::plant::thesis_modes::elastic_frequencies;
use crate::plant::{Dynamics, PlantModel};
use crate::reference::deployment::Deployment;
use crate::reference::slew::Slew;

/// The payload as laws and open loop are told; null entries are as the true payload's.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ReportedPayload {
    /// Mass, kg; null is the true mass times (1 + `mass_error`).
    pub mass: Option<f64>,
    /// Length along the arm, m.
    pub length: Option<f64>,
    /// Width across the arm, m.
    pub width: Option<f64>,
}

/// State at t = 0, besides the length.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Initial {
    /// Slew angle, rad (the reference starts at 0).
    pub slew_angle: f64,
    /// Slew rate, rad/s.
    pub slew_rate: f64,
    /// Modal coordinate of link 1, half its tip deflection, m.
    pub alpha: f64,
    /// Its rate, m/s.
    pub alpha_rate: f64,
    /// Modal coordinate of link 2, half its tip deflection, m.
    pub beta: f64,
    /// Its rate, m/s.
    pub beta_rate: f64,
}

/// One manoeuvre. Any part left out has its default: Payload 1 known exactly, 50 deg in minimum
/// time while the arm deploys from 1 m to 8 m.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Scenario {
    /// The two links.
    pub arm: Arm,
    /// The payload as it is.
    pub payload: Payload,
    /// The payload as it is reported.
    pub reported_payload: ReportedPayload,
    /// Relative error of the reported mass: 0.15 reports 15 % too much.
    pub mass_error: f64,
    /// The open-loop slew.
    pub slew: Slew,
    /// The change of length.
    pub deployment: Deployment,
    /// State at the beginning.
    pub initial: Initial,
    /// Reaction wheel at the shoulder.
    pub root_wheel: RootWheel,
    /// Reaction wheel at the tip.
    pub tip_wheel: TipWheel,
    /// Slew motor.
    pub slew_motor: SlewMotor,
    /// Measured outputs.
    pub sensors: Sensors,
    /// Equations of motion.
    pub plant: PlantModel,
    /// Assumed modes of link 1 and link 2 in the consistent plant; the thesis plant has one each.
    pub modes: [usize; 2],
    /// Switches of the equations of motion.
    pub dynamics: Dynamics,
    /// Longest integration step, s.
    pub integrator_step: f64,
    /// Period at which laws, sensors, wheels and metrics are sampled, s.
    pub sample_period: f64,
    /// Duration, s.
    pub horizon: f64,
}

impl Default for Scenario {
    fn default() -> Self {
        Self {
            arm: Arm::default(),
            payload: Payload::default(),
            reported_payload: ReportedPayload::default(),
            mass_error: 0.0,
            slew: Slew::default(),
            deployment: Deployment::default(),
            initial: Initial::default(),
            root_wheel: RootWheel::default(),
            tip_wheel: TipWheel::default(),
            slew_motor: SlewMotor::default(),
            sensors: Sensors::default(),
            plant: PlantModel::default(),
            modes: [4, 4],
            dynamics: Dynamics::default(),
            // thesis section 3.5.4: Runge-Kutta at 0.5 ms, control at 2 ms
            integrator_step: 5e-4,
            sample_period: LAW_PERIOD,
            horizon: 20.0,
        }
    }
}

/// Longest run of samples that dead times and delays may cover.
const LONGEST_DELAY_SAMPLES: f64 = 1000.0;

/// Most steps of the integrator in a sample period: with more, a sample would take for ever.
const MOST_STEPS_PER_SAMPLE: f64 = 1e5;

impl Scenario {
    /// The payload as it is, with every dimension known.
    ///
    /// # Errors
    /// A payload that does not exist.
    pub fn true_payload(&self) -> Result<PayloadProperties, ConfigError> {
        PayloadProperties::resolve(&self.payload).map_err(|e| e.within("payload"))
    }

    /// The payload as it is reported, with every dimension known.
    ///
    /// # Errors
    /// A payload, true or reported, that does not exist.
    pub fn reported(&self) -> Result<PayloadProperties, ConfigError> {
        let truth = self.true_payload()?;
        let mass = match self.reported_payload.mass {
            Some(mass) => {
                non_negative("reported_payload.mass", mass)?;
                mass
            }
            None => truth.mass * (1.0 + self.mass_error),
        };
        let length = self.reported_payload.length.unwrap_or(truth.length);
        let width = self.reported_payload.width.unwrap_or(truth.width);
        non_negative("reported_payload.length", length)?;
        non_negative("reported_payload.width", width)?;
        Ok(PayloadProperties::new(
            mass,
            length,
            width,
            self.payload.inertia,
        ))
    }

    /// Lets dimensions that follow from the mass be reported as those of the reported mass, unless they
    /// are given: where the mass is drawn, the true ones would tell it to whoever looks.
    pub(crate) fn hide_dimensions(&mut self) {
        let reported = &mut self.reported_payload;
        let truth = self.payload.mass * (1.0 + self.mass_error);
        let (length, width) = table_2_7_dimensions(reported.mass.unwrap_or(truth));
        if self.payload.length.is_none() {
            reported.length.get_or_insert(length);
        }
        if self.payload.width.is_none() {
            reported.width.get_or_insert(width);
        }
    }

    /// Refuses anything that cannot be flown, naming field and value.
    ///
    /// # Errors
    /// The first parameter that cannot be flown, with its path and value.
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.arm.validate().map_err(|e| e.within("arm"))?;
        let payload = self.true_payload()?;
        finite("mass_error", self.mass_error)?;
        if self.mass_error < -1.0 {
            return Err(ConfigError::value(
                "mass_error",
                "must be at least -1",
                self.mass_error,
            ));
        }
        if self.reported_payload.mass.is_some() && self.mass_error != 0.0 {
            return Err(ConfigError::value(
                "mass_error",
                "must be 0 when reported_payload.mass is given",
                self.mass_error,
            ));
        }
        self.reported()?;
        self.slew.validate().map_err(|e| e.within("slew"))?;
        self.deployment
            .validate(&self.arm, self.slew.final_time())
            .map_err(|e| e.within("deployment"))?;
        let slew_time = self.slew_time(0.0)?;
        if !slew_time.is_finite() {
            let requirement = "must give a slew that ends";
            return Err(ConfigError::value(
                "slew.shaper.frequency",
                requirement,
                slew_time,
            ));
        }
        let Initial {
            slew_angle,
            slew_rate,
            alpha,
            alpha_rate,
            beta,
            beta_rate,
        } = self.initial;
        for (name, value) in [
            ("slew_angle", slew_angle),
            ("slew_rate", slew_rate),
            ("alpha", alpha),
            ("alpha_rate", alpha_rate),
            ("beta", beta),
            ("beta_rate", beta_rate),
        ] {
            finite(name, value).map_err(|e| e.within("initial"))?;
        }
        let (root, tip) = (&self.root_wheel, &self.tip_wheel);
        root.validate().map_err(|e| e.within("root_wheel"))?;
        tip.validate().map_err(|e| e.within("tip_wheel"))?;
        self.delay_samples("root_wheel.dead_time", root.dead_time)?;
        self.delay_samples("tip_wheel.dead_time", tip.dead_time)?;
        self.slew_motor
            .validate()
            .map_err(|e| e.within("slew_motor"))?;
        self.sensors.validate().map_err(|e| e.within("sensors"))?;
        self.delay_samples("sensors.delay", self.sensors.delay)?;
        self.dynamics.validate().map_err(|e| e.within("dynamics"))?;
        positive("sample_period", self.sample_period)?;
        positive("horizon", self.horizon)?;
        if self.horizon < self.sample_period {
            return Err(ConfigError::value(
                "horizon",
                format!(
                    "must be at least the sample period of {} s",
                    self.sample_period
                ),
                self.horizon,
            ));
        }
        if self.horizon / self.sample_period > 1e9 {
            return Err(ConfigError::value(
                "horizon",
                "must be at most 1e9 sample periods",
                self.horizon,
            ));
        }
        positive("integrator_step", self.integrator_step)?;
        if self.sample_period / self.integrator_step > MOST_STEPS_PER_SAMPLE {
            return Err(ConfigError::value(
                "integrator_step",
                format!("must be at least 1/{MOST_STEPS_PER_SAMPLE} of the sample period"),
                self.integrator_step,
            ));
        }
        match self.plant {
            PlantModel::Thesis => {
                self.validate_on_axis()?;
                self.validate_step(&payload)
            }
            // implicit: stable with any step
            PlantModel::Consistent => self.validate_modes(),
        }
    }

    /// Refuses what the thesis' equations do not know.
    fn validate_on_axis(&self) -> Result<(), ConfigError> {
        let only_consistent = [
            ("payload.offset", self.payload.offset),
            ("dynamics.damping_ratio", self.dynamics.damping_ratio),
        ];
        for (path, value) in only_consistent {
            if value != 0.0 {
                let requirement = "must be 0 in the thesis' plant; plant = consistent has it";
                return Err(ConfigError::value(path, requirement, value));
            }
        }
        if let Some(stiffness) = self.slew_motor.shaft_stiffness {
            let requirement = "must be null in the thesis' plant; plant = consistent has it";
            let path = "slew_motor.shaft_stiffness";
            return Err(ConfigError::value(path, requirement, stiffness));
        }
        Ok(())
    }

    fn validate_modes(&self) -> Result<(), ConfigError> {
        let most = (CAPACITY - 1) / 2;
        if self.modes.iter().all(|count| (1..=most).contains(count)) {
            return Ok(());
        }
        let [link1, link2] = self.modes;
        Err(ConfigError::value(
            "modes",
            format!("must be 1 to {most} for each link"),
            format!("[{link1}, {link2}]"),
        ))
    }

    /// Dead time or delay in whole samples.
    ///
    /// # Errors
    /// A delay that is negative, not a number or too long, by `path`.
    pub fn delay_samples(&self, path: &str, delay: f64) -> Result<usize, ConfigError> {
        positive("sample_period", self.sample_period)?;
        let samples = libm::round(delay / self.sample_period);
        if samples <= LONGEST_DELAY_SAMPLES {
            return Ok(samples as usize);
        }
        Err(ConfigError::value(
            path,
            format!("must be at most {LONGEST_DELAY_SAMPLES} sample periods"),
            delay,
        ))
    }

    /// Refuses a step beyond the stability limit of the Runge-Kutta method for the modes met on the way.
    fn validate_step(&self, payload: &PayloadProperties) -> Result<(), ConfigError> {
        let step = self.integrator_step.min(self.sample_period);
        let damping = self.dynamics.structural_damping;
        let (from, to) = (self.deployment.start, self.deployment.final_extension());
        let mut worst = (f64::INFINITY, 0.0, from);
        for i in 0..=8 {
            let extension = from + (to - from) * f64::from(i) / 8.0;
            for frequency in elastic_frequencies(&self.arm, payload, extension) {
                if !frequency.is_finite() {
                    let requirement = format!(
                        "must have finite natural frequencies with this payload; at an extension \
                         of {extension} m it has not"
                    );
                    return Err(ConfigError::value("arm", requirement, frequency));
                }
                let limit = largest_stable_step(frequency, damping * frequency / 2.0);
                if limit < worst.0 {
                    worst = (limit, frequency, extension);
                }
            }
        }
        let (limit, frequency, extension) = worst;
        if step < limit {
            return Ok(());
        }
        let damped = if damping > 0.0 {
            let ratio = damping * frequency / 2.0;
            format!(", damping ratio {ratio:.3} by dynamics.structural_damping = {damping} s")
        } else {
            String::new()
        };
        Err(ConfigError::value(
            "integrator_step",
            format!(
                "must be below {limit:.3e} s, or the Runge-Kutta integration is unstable \
                 (fastest mode {frequency:.0} rad/s at an extension of {extension} m{damped})"
            ),
            step,
        ))
    }

    /// Duration of the deployment, s, as planned with the reported payload.
    pub fn deployment_time(&self, reported: &PayloadProperties) -> f64 {
        let link2 = self.arm.link2.mass_per_length * self.arm.link2.length;
        self.deployment
            .duration(self.slew.final_time(), link2 + reported.mass)
    }

    /// What no parameter sets: scenarios of one environment have it in common.
    pub(crate) fn common_part(&self) -> Self {
        let Self {
            dynamics,
            slew_motor,
            plant,
            modes,
            integrator_step,
            sample_period,
            horizon,
            ..
        } = *self;
        let mut common = Self {
            dynamics,
            slew_motor,
            plant,
            modes,
            integrator_step,
            sample_period,
            horizon,
            ..Self::default()
        };
        (common.slew.final_time, common.slew.times) = (self.slew.final_time, self.slew.times);
        common.slew.shaper = self.slew.shaper;
        let sensors = &self.sensors;
        common.sensors.tip_rate_noise = sensors.tip_rate_noise;
        common.sensors.tip_rate_resolution = sensors.tip_rate_resolution;
        common.sensors.tip_rate_bandwidth = sensors.tip_rate_bandwidth;
        let unbiased = |instrument: Instrument| Instrument {
            bias: 0.0,
            ..instrument
        };
        common.sensors.link1_gauge = unbiased(sensors.link1_gauge);
        common.sensors.link2_gauge = unbiased(sensors.link2_gauge);
        common.sensors.tip_accelerometer = unbiased(sensors.tip_accelerometer);
        common.slew.accelerations = self.slew.accelerations;
        common.dynamics.structural_damping = 0.0;
        common.dynamics.damping_ratio = 0.0;
        common
    }

    /// Number of samples in the horizon.
    pub fn samples(&self) -> usize {
        (libm::round(self.horizon / self.sample_period) as usize).max(1)
    }
}

/// A manoeuvre that can be flown. It is checked when it is made and cannot change, so that whoever takes
/// one need not check it again.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ValidScenario(Scenario);

impl ValidScenario {
    /// Checks a scenario.
    ///
    /// # Errors
    /// See [`Scenario::validate`].
    pub fn new(scenario: Scenario) -> Result<Self, ConfigError> {
        scenario.validate()?;
        Ok(Self(scenario))
    }

    /// A scenario that has been checked with the configuration that it is of.
    pub(super) fn of_valid(scenario: Scenario) -> Self {
        Self(scenario)
    }

    /// The same with these instruments fitted as well, strain gauges of link 1 and link 2 and accelerometer.
    #[must_use]
    pub(crate) fn fitted(mut self, instruments: [bool; INSTRUMENTS]) -> Self {
        self.0.sensors.fit(instruments);
        self
    }

    /// Checks many.
    ///
    /// # Errors
    /// That of the first that cannot be flown, with its place.
    pub fn all(scenarios: &[Scenario]) -> Result<Vec<Self>, ConfigError> {
        let checked = scenarios.iter().enumerate().map(|(i, scenario)| {
            interruption::poll();
            Self::new(*scenario).map_err(|e| e.within(&format!("scenarios[{i}]")))
        });
        checked.collect()
    }
}

impl TryFrom<&Scenario> for ValidScenario {
    type Error = ConfigError;

    fn try_from(scenario: &Scenario) -> Result<Self, ConfigError> {
        Self::new(*scenario)
    }
}

impl From<&ValidScenario> for ValidScenario {
    fn from(scenario: &ValidScenario) -> Self {
        *scenario
    }
}

impl From<ValidScenario> for Scenario {
    fn from(scenario: ValidScenario) -> Self {
        scenario.0
    }
}

impl Deref for ValidScenario {
    type Target = Scenario;

    fn deref(&self) -> &Scenario {
        &self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(scenario: &Scenario) -> PayloadProperties {
        scenario.reported().expect("the payload can be reported")
    }

    #[test]
    fn what_is_not_reported_is_as_the_true_payload() {
        let scenario = Scenario {
            mass_error: 0.25,
            ..Scenario::default()
        };
        let found = told(&scenario);
        assert_eq!((found.mass, found.length, found.width), (250.0, 1.0, 0.5));
    }

    #[test]
    fn hidden_dimensions_are_those_of_the_reported_mass() {
        let mut scenario = Scenario {
            mass_error: 0.25,
            ..Scenario::default()
        };
        scenario.hide_dimensions();
        let (length, width) = table_2_7_dimensions(250.0);
        let found = told(&scenario);
        assert_eq!((found.length, found.width), (length, width));
        // two payloads that are reported alike cannot be told apart
        let mut other = Scenario::default();
        other.payload.mass = 400.0;
        other.reported_payload.mass = Some(250.0);
        other.hide_dimensions();
        assert_eq!(told(&other), found);
    }

    #[test]
    fn dimensions_that_are_given_are_not_hidden() {
        let mut scenario = Scenario {
            mass_error: 0.25,
            ..Scenario::default()
        };
        scenario.payload.length = Some(1.3);
        scenario.reported_payload.width = Some(0.7);
        scenario.hide_dimensions();
        assert_eq!((told(&scenario).length, told(&scenario).width), (1.3, 0.7));
    }
}
