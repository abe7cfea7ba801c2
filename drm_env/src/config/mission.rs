//! A mission as data: legs that are flown one after the other, each from where the one before has left
//! the arm.

use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::arm::Payload;
use crate::check::{finite, non_negative, positive};
use crate::config::handling::{Base, LegHandling};
use crate::config::scenario::{Initial, ReportedPayload, Scenario, ValidScenario};
use crate::error::ConfigError;
use crate::hardware::sensors::INSTRUMENTS;
use crate::reference::deployment::{Deployment, DeploymentMode};
use crate::reference::series::Series;
use crate::reference::slew::{Slew, SlewProfile};

/// A slew, with or without a change of length, or a change of length alone.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SlewLeg {
    /// Angle to slew through from where the leg begins, rad; 0 turns nothing. Null is 0, or what a table turns
    /// through.
    pub angle: Option<f64>,
    /// Length of link 2 outside link 1 at the end, m; null keeps the length.
    pub extension: Option<f64>,
    /// Largest angular acceleration, rad/s^2; null is that of the scenario's slew. A table has none.
    pub max_accel: Option<f64>,
    /// Family of the profile; null is that of the scenario's slew.
    pub profile: Option<SlewProfile>,
    /// Smoothing fraction of the slew time; null is that of the scenario's slew. A table has none.
    pub smoothing: Option<f64>,
    /// Times of a table, s after the leg's beginning, rising; at one that is given twice the acceleration jumps.
    pub times: Series,
    /// Accelerations at them, rad/s^2, with straight lines between; the arm must come to rest.
    pub accelerations: Series,
    /// How the length changes; null is coincident with the slew, and force limited without one.
    pub deployment: Option<DeploymentMode>,
    /// Force of a force-limited change of length, N; null is that of the scenario's deployment.
    pub force: Option<f64>,
    /// When the length begins to change, s after the leg's beginning.
    pub deployment_start: f64,
    /// Duration, s, at least that of slew, deployment and the base's motion; null is theirs.
    pub duration: Option<f64>,
    /// What the base does; null is at rest with a free shoulder. With a locked shoulder there is no slew.
    pub base: Option<Base>,
}

/// The reference stands still for a time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct HoldLeg {
    /// Duration, s, at least that of the base's motion.
    pub duration: f64,
    /// What the base does; null is at rest with a free shoulder.
    pub base: Option<Base>,
}

impl Default for HoldLeg {
    fn default() -> Self {
        Self {
            duration: 1.0,
            base: None,
        }
    }
}

/// The reference stands still until the arm is at rest: tip deflection and slew error have stayed small
/// for a while.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RestLeg {
    /// Longest duration, s: the mission goes on then whether or not the arm is at rest.
    pub most: f64,
    /// Largest amplitude of the tip's vibration at rest, m: of deflection and deflection rate times 0.04 s.
    pub deflection: f64,
    /// Largest slew error at rest, taken to the tip, m.
    pub slew_error: f64,
    /// How long both must have been within, s.
    pub quiet: f64,
    /// `"locked"` where the brakes hold the shoulder, which is all that can be waited on; null is a free one.
    pub base: Option<Base>,
}

impl Default for RestLeg {
    /// What counts as settled in the metrics, for one second, within 20 s.
    fn default() -> Self {
        Self {
            most: 20.0,
            deflection: 1e-3,
            slew_error: 1e-2,
            quiet: 1.0,
            base: None,
        }
    }
}

/// The wheels are run down while the slew motor holds the arm: their momentum goes through the shoulder into
/// the base.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DesaturateLeg {
    /// Longest duration, s: the mission goes on then whether or not the wheels are empty.
    pub most: f64,
    /// Momentum of either wheel that counts as none, N m s; 0 takes the whole time.
    pub momentum: f64,
    /// Largest torque of either wheel, N m; null is the wheel's own.
    pub torque: Option<f64>,
    /// `"locked"` where the brakes hold the shoulder in the motor's stead; null is the motor.
    pub base: Option<Base>,
}

impl Default for DesaturateLeg {
    /// With all of their torque, to 1 N m s, within 60 s.
    fn default() -> Self {
        Self {
            most: 60.0,
            momentum: 1.0,
            torque: None,
            base: None,
        }
    }
}

/// A payload appears at the tip, moving with it, at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct GrappleLeg {
    /// The payload; null is the scenario's, which an environment may draw, with what is reported of it.
    pub payload: Option<Payload>,
    /// What is reported of the payload; null is the truth, or the scenario's report of its payload.
    pub reported: Option<ReportedPayload>,
}

/// The payload goes, at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ReleaseLeg {}

/// A part of a mission; as data, `{"kind": "hold", ...}`.
#[expect(
    clippy::large_enum_variant,
    reason = "a leg is copied with the tables that it holds, as a scenario is"
)]
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Leg {
    /// Slew, deployment or both.
    #[schemars(title = "SlewLeg")]
    Slew(SlewLeg),
    /// Stand still for a time.
    #[schemars(title = "HoldLeg")]
    Hold(HoldLeg),
    /// Stand still until the arm is at rest.
    #[schemars(title = "RestLeg")]
    WaitForRest(RestLeg),
    /// Run the wheels down.
    #[schemars(title = "DesaturateLeg")]
    Desaturate(DesaturateLeg),
    /// A payload appears.
    #[schemars(title = "GrappleLeg")]
    Grapple(GrappleLeg),
    /// The payload goes.
    #[schemars(title = "ReleaseLeg")]
    Release(ReleaseLeg),
}

impl Leg {
    /// Whether it is more than one instant.
    pub fn takes_time(&self) -> bool {
        !matches!(self, Self::Grapple(_) | Self::Release(_))
    }

    /// Name of the kind in the leg's data form.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Slew(_) => "slew",
            Self::Hold(_) => "hold",
            Self::WaitForRest(_) => "wait_for_rest",
            Self::Desaturate(_) => "desaturate",
            Self::Grapple(_) => "grapple",
            Self::Release(_) => "release",
        }
    }
}

/// Legs flown one after the other with one arm, from rest without a payload. Arm, wheels, sensors, plant
/// and what a leg leaves out are the scenario's; the length at the beginning is `deployment.start`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Mission {
    /// Legs, in order.
    pub legs: Vec<Leg>,
    /// Legs end at whole multiples of this, s: a whole number of control periods.
    pub period: f64,
    /// Whether legs are planned for the payload's mass as the balance of angular momentum has told it
    /// in the legs before, and no longer for the reported one.
    pub replan: bool,
}

impl Default for Mission {
    /// Pick, slew, place, return: the arm reaches out for a payload, takes it through 90 deg while it
    /// pulls it in, places it and goes back.
    fn default() -> Self {
        let turn = |degrees: f64, extension: f64| {
            Leg::Slew(SlewLeg {
                angle: Some(degrees.to_radians()),
                extension: Some(extension),
                ..SlewLeg::default()
            })
        };
        let wait = Leg::WaitForRest(RestLeg::default());
        Self {
            legs: vec![
                turn(30.0, 7.0),
                wait,
                Leg::Grapple(GrappleLeg::default()),
                turn(-90.0, 4.0),
                wait,
                Leg::Release(ReleaseLeg {}),
                turn(60.0, 1.0),
                wait,
            ],
            period: 0.1,
            replan: false,
        }
    }
}

/// Most legs of a mission.
const MOST_LEGS: usize = 100;

/// Ends of a leg within so much of a period after a multiple of it are at that multiple.
const ROUNDING: f64 = 1e-6;

/// What the angle of a table may be stated wrong by, rad: more is no rounding.
const SAME_ANGLE: f64 = 1e-6;

/// What ends a leg before its time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Ending {
    /// The arm is at rest; see [`RestLeg`].
    Rest {
        deflection: f64,
        slew_error: f64,
        quiet: f64,
    },
    /// Neither wheel stores more than so much, N m s.
    Empty(f64),
}

/// One leg that takes time, with what happens at its beginning.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PlannedLeg {
    /// Place in the list of legs.
    pub(crate) index: usize,
    /// The manoeuvre, its angles from the leg's beginning on.
    pub(crate) scenario: ValidScenario,
    /// When the length begins to change, s.
    pub(crate) deployment_start: f64,
    /// Duration that was asked for, s.
    pub(crate) duration: Option<f64>,
    /// What ends the leg before its time.
    pub(crate) ending: Option<Ending>,
    /// What is done beside the manoeuvre.
    pub(crate) handling: LegHandling,
    /// Whether a payload has appeared with this leg: what has been learnt of the one before is void.
    pub(crate) grappled: bool,
}

impl PlannedLeg {
    /// How long slew, deployment and the base's motion take where the leg is flown as `scenario`, s.
    fn needed(&self, scenario: &Scenario) -> Result<f64, ConfigError> {
        let moves = scenario.deployment.final_extension() != scenario.deployment.start;
        let deployment = if moves {
            self.deployment_start + scenario.deployment_time(&scenario.reported()?)
        } else {
            0.0
        };
        let base = self.handling.base.map_or(0.0, |base| base.final_time());
        let slew = scenario.slew_time(self.deployment_start)?;
        Ok(slew.max(deployment).max(base))
    }

    /// The leg with a base, which must not be moving where something else than its time ends the leg.
    fn with_base(mut self, base: Option<Base>) -> Result<Self, ConfigError> {
        let Some(base) = base else { return Ok(self) };
        base.validate()?;
        if self.ending.is_some() && base != Base::Locked {
            let message =
                "must be \"locked\": only the base of a leg of known duration (slew or hold) turns";
            return Err(ConfigError::form("base", message));
        }
        let slew = &self.scenario.slew;
        if base.is_locked() && slew.profile == SlewProfile::Table {
            let requirement = "must not be a table: the brakes hold the shoulder";
            return Err(ConfigError::value("profile", requirement, "table"));
        }
        if base.is_locked() && slew.turns() {
            let requirement = "must be 0: the brakes hold the shoulder";
            return Err(ConfigError::value("angle", requirement, slew.angle));
        }
        self.handling.base = Some(base);
        Ok(self)
    }

    /// Refuses a duration that is shorter than what happens within it.
    fn check_duration(self) -> Result<Self, ConfigError> {
        let needed = self.needed(&self.scenario)?;
        match self.duration {
            Some(duration) if self.ending.is_none() && duration < needed * (1.0 - ROUNDING) => {
                let requirement =
                    format!("must be at least the {needed} s of slew, deployment and base");
                Err(ConfigError::value("duration", requirement, duration))
            }
            _ => Ok(self),
        }
    }

    /// Samples in the leg where it is flown as `scenario`, if nothing ends it before: whole multiples of
    /// `period` samples.
    pub(crate) fn samples(&self, scenario: &Scenario, period: u64) -> Result<u64, ConfigError> {
        let seconds = self.duration.unwrap_or(0.0).max(self.needed(scenario)?);
        let periods = seconds / (period as f64 * scenario.sample_period);
        Ok((periods - ROUNDING).ceil().max(1.0) as u64 * period)
    }
}

/// A mission that can be flown: its legs as manoeuvres. It is checked when it is made.
#[derive(Debug, Clone, PartialEq)]
pub struct ValidMission {
    mission: Arc<Mission>,
    base: ValidScenario,
    legs: Vec<PlannedLeg>,
    period: u64,
    range: (f64, f64),
    longest: u64,
}

impl ValidMission {
    /// See [`ValidScenario::fitted`].
    #[must_use]
    pub(crate) fn fitted(&self, instruments: [bool; INSTRUMENTS]) -> Self {
        let mut mission = self.clone();
        mission.base = mission.base.fitted(instruments);
        for leg in &mut mission.legs {
            leg.scenario = leg.scenario.fitted(instruments);
        }
        mission
    }

    /// Checks a mission with the scenario that all legs have in common.
    ///
    /// # Errors
    /// The first leg that cannot be flown, with its path and value; no leg that takes time; a horizon
    /// shorter than the legs.
    pub fn new(mission: &Mission, base: ValidScenario) -> Result<Self, ConfigError> {
        let made = Self::planned(mission, base)?;
        let longest = made.longest as f64 * base.sample_period;
        if made.longest > base.samples() as u64 {
            let requirement = format!("must be at least the {longest} s that the legs can take");
            return Err(ConfigError::value("horizon", requirement, base.horizon));
        }
        Ok(made)
    }

    /// Checks a mission and gives the scenario the horizon that the legs need, unless it is long enough.
    ///
    /// # Errors
    /// See [`ValidMission::new`].
    pub fn with_horizon(mission: &Mission, base: Scenario) -> Result<Self, ConfigError> {
        let mut base = base;
        let made = Self::planned(mission, ValidScenario::new(base)?)?;
        base.horizon = base.horizon.max(made.longest as f64 * base.sample_period);
        Self::planned(mission, ValidScenario::new(base)?)
    }

    fn planned(mission: &Mission, base: ValidScenario) -> Result<Self, ConfigError> {
        let period = mission.period_samples(&base)?;
        let count = mission.legs.len();
        if !(1..=MOST_LEGS).contains(&count) {
            let requirement = format!("must have 1 to {MOST_LEGS} entries");
            return Err(ConfigError::value("mission.legs", requirement, count));
        }
        let start = base.deployment.start;
        let (mut extension, mut range) = (start, (start, start));
        let mut held: Option<GrappleLeg> = None;
        let mut grappled = false;
        let mut legs = Vec::with_capacity(count);
        let mut longest = 0_u64;
        let mut scenario = Scenario::from(base);
        for (index, leg) in mission.legs.iter().enumerate() {
            let within = |e: ConfigError| e.within(&format!("mission.legs[{index}]"));
            let planned = match leg {
                Leg::Grapple(grapple) => {
                    if held.is_some() {
                        let message = "there is a payload already; release it before";
                        return Err(within(ConfigError::form("kind", message)));
                    }
                    held = Some(*grapple);
                    grappled = true;
                    continue;
                }
                Leg::Release(_) => {
                    if held.take().is_none() {
                        let message = "there is no payload to release";
                        return Err(within(ConfigError::form("kind", message)));
                    }
                    grappled = false;
                    continue;
                }
                Leg::Slew(leg) => leg.planned(&scenario, extension, held.as_ref()),
                Leg::Hold(leg) => positive("duration", leg.duration).and_then(|()| {
                    let leg_scenario = still(&scenario, extension, held.as_ref());
                    of(leg_scenario, Some(leg.duration), None)?.with_base(leg.base)
                }),
                Leg::WaitForRest(leg) => leg.validate().and_then(|()| {
                    let leg_scenario = still(&scenario, extension, held.as_ref());
                    of(leg_scenario, Some(leg.most), Some(leg.ending()))?.with_base(leg.base)
                }),
                Leg::Desaturate(leg) => leg.validate().and_then(|()| {
                    let leg_scenario = still(&scenario, extension, held.as_ref());
                    let ending = Some(Ending::Empty(leg.momentum));
                    let mut planned = of(leg_scenario, Some(leg.most), ending)?;
                    planned.handling.unload = Some(leg.torque);
                    planned.with_base(leg.base)
                }),
            };
            let planned = planned.and_then(PlannedLeg::check_duration);
            let mut planned = planned.map_err(within)?;
            let locked = planned.handling.base.is_some_and(|base| base.is_locked());
            if locked && legs.is_empty() && scenario.initial.slew_rate != 0.0 {
                let requirement = "must be 0 where the mission begins with a locked base";
                let rate = scenario.initial.slew_rate;
                return Err(ConfigError::value("initial.slew_rate", requirement, rate));
            }
            planned.index = index;
            planned.grappled = std::mem::take(&mut grappled);
            scenario.initial = Initial::default();
            extension = planned.scenario.deployment.final_extension();
            range = (range.0.min(extension), range.1.max(extension));
            longest += planned.samples(&planned.scenario, period).map_err(within)?;
            legs.push(planned);
        }
        if legs.is_empty() {
            let message = "no leg takes time: there is nothing to fly";
            return Err(ConfigError::form("mission.legs", message));
        }
        Ok(Self {
            mission: Arc::new(mission.clone()),
            base,
            legs,
            period,
            range,
            longest,
        })
    }

    /// The mission as data.
    pub fn mission(&self) -> &Mission {
        &self.mission
    }

    /// What all legs have in common, with the payload that a grapple takes unless it says another.
    pub fn scenario(&self) -> &Scenario {
        &self.base
    }

    /// JSON text that [`mission_from_json`](crate::config::mission_from_json) reads.
    pub fn to_json(&self) -> String {
        let document = serde_json::json!({"mission": *self.mission, "scenario": *self.base});
        document.to_string()
    }

    pub(crate) fn base(&self) -> ValidScenario {
        self.base
    }

    pub(crate) fn legs(&self) -> &[PlannedLeg] {
        &self.legs
    }

    /// Samples in a period of the mission.
    pub(crate) fn period(&self) -> u64 {
        self.period
    }

    /// Least and largest extension of the mission, m.
    pub(crate) fn range(&self) -> (f64, f64) {
        self.range
    }

    /// Whether legs are planned for what has been learnt of the payload.
    pub(crate) fn replans(&self) -> bool {
        self.mission.replan
    }
}

impl Mission {
    /// Samples in a period.
    fn period_samples(&self, base: &Scenario) -> Result<u64, ConfigError> {
        positive("mission.period", self.period)?;
        let ratio = self.period / base.sample_period;
        if !(0.5..=1e9).contains(&ratio) || (ratio - libm::round(ratio)).abs() > 1e-6 * ratio {
            let requirement = format!(
                "must be a whole number of sample periods of {} s",
                base.sample_period
            );
            return Err(ConfigError::value(
                "mission.period",
                requirement,
                self.period,
            ));
        }
        Ok(libm::round(ratio) as u64)
    }

    /// Refuses a period that is no whole number of control periods.
    pub(super) fn check_control_period(&self, control_period: f64) -> Result<(), ConfigError> {
        let ratio = self.period / control_period;
        if ratio >= 0.5 && (ratio - libm::round(ratio)).abs() <= 1e-6 * ratio {
            return Ok(());
        }
        let requirement =
            format!("must be a whole number of control periods of {control_period} s");
        Err(ConfigError::value(
            "mission.period",
            requirement,
            self.period,
        ))
    }
}

impl SlewLeg {
    fn planned(
        &self,
        base: &Scenario,
        extension: f64,
        held: Option<&GrappleLeg>,
    ) -> Result<PlannedLeg, ConfigError> {
        non_negative("deployment_start", self.deployment_start)?;
        if let Some(duration) = self.duration {
            positive("duration", duration)?;
        }
        let mut scenario = still(base, extension, held);
        scenario.slew = self.slew(&base.slew)?;
        if let Some(end) = self.extension {
            let usual = if scenario.slew.turns() {
                DeploymentMode::Coincident
            } else {
                DeploymentMode::ForceLimited
            };
            scenario.deployment = Deployment {
                start: extension,
                end,
                mode: self.deployment.unwrap_or(usual),
                force: self.force.unwrap_or(base.deployment.force),
            };
        }
        let planned = PlannedLeg {
            deployment_start: self.deployment_start,
            ..of(scenario, self.duration, None)?
        };
        planned.with_base(self.base)
    }

    /// The leg's slew, where the scenario's is `common`.
    fn slew(&self, common: &Slew) -> Result<Slew, ConfigError> {
        let angle = self.angle.unwrap_or(0.0);
        finite("angle", angle)?;
        let mut slew = Slew {
            angle,
            max_accel: self.max_accel.unwrap_or(common.max_accel),
            profile: self.profile.unwrap_or(common.profile),
            smoothing: self.smoothing.unwrap_or(common.smoothing),
            final_time: None,
            times: self.times,
            accelerations: self.accelerations,
            ..*common
        };
        if slew.profile != SlewProfile::Table {
            slew.refuse_entries()?;
            return Ok(slew);
        }
        if self.profile.is_none() && self.times.values().is_empty() {
            let requirement =
                "must be given where the scenario's slew is a table: that is of no leg";
            return Err(ConfigError::value("profile", requirement, "null"));
        }
        if let Some(max_accel) = self.max_accel {
            let requirement = "must be null: a table has its own accelerations";
            return Err(ConfigError::value("max_accel", requirement, max_accel));
        }
        // not that of the scenario's profile
        slew.smoothing = self.smoothing.unwrap_or(0.0);
        slew.validate()?;
        slew.angle = slew.target();
        if self.angle.is_some() && (angle - slew.angle).abs() > SAME_ANGLE {
            let requirement = format!(
                "must be left out or the {} rad that the table turns through",
                slew.angle
            );
            return Err(ConfigError::value("angle", requirement, angle));
        }
        Ok(slew)
    }
}

impl DesaturateLeg {
    fn validate(&self) -> Result<(), ConfigError> {
        positive("most", self.most)?;
        non_negative("momentum", self.momentum)?;
        self.torque
            .map_or(Ok(()), |torque| positive("torque", torque))
    }
}

impl RestLeg {
    fn ending(&self) -> Ending {
        Ending::Rest {
            deflection: self.deflection,
            slew_error: self.slew_error,
            quiet: self.quiet,
        }
    }

    fn validate(&self) -> Result<(), ConfigError> {
        positive("most", self.most)?;
        positive("deflection", self.deflection)?;
        positive("slew_error", self.slew_error)?;
        non_negative("quiet", self.quiet)
    }
}

/// A leg of which only the place is not known yet.
fn of(
    scenario: Scenario,
    duration: Option<f64>,
    ending: Option<Ending>,
) -> Result<PlannedLeg, ConfigError> {
    Ok(PlannedLeg {
        index: 0,
        scenario: ValidScenario::new(scenario)?,
        deployment_start: 0.0,
        duration,
        ending,
        handling: LegHandling::default(),
        grappled: false,
    })
}

/// The arm at a length with what it holds, whose reference stands still.
fn still(base: &Scenario, extension: f64, held: Option<&GrappleLeg>) -> Scenario {
    let mut scenario = Scenario {
        slew: Slew {
            angle: 0.0,
            profile: match base.slew.profile {
                SlewProfile::Table => SlewProfile::default(),
                other => other,
            },
            times: Series::default(),
            accelerations: Series::default(),
            ..base.slew
        },
        deployment: Deployment {
            start: extension,
            end: extension,
            mode: DeploymentMode::None,
            ..base.deployment
        },
        ..*base
    };
    match held {
        None => {
            scenario.payload = Payload {
                mass: 0.0,
                length: Some(0.0),
                width: Some(0.0),
                offset: 0.0,
                ..base.payload
            };
            scenario.reported_payload = ReportedPayload::default();
            scenario.mass_error = 0.0;
        }
        Some(grapple) => {
            if let Some(payload) = grapple.payload {
                scenario.payload = payload;
                scenario.reported_payload = ReportedPayload::default();
                scenario.mass_error = 0.0;
            }
            if let Some(reported) = grapple.reported {
                scenario.reported_payload = reported;
                scenario.mass_error = 0.0;
            }
        }
    }
    scenario
}
