//! A mission under way in one lane: which leg is flown, when it ends, and what has been of the others.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::Flight;
use crate::arm::PayloadProperties;
use crate::config::mission::{Ending, PlannedLeg, ValidMission};
use crate::config::scenario::{Scenario, ValidScenario};
use crate::error::{ConfigError, SnapshotError};
use crate::math::rng::Stream;
use crate::simulation::any_plant::AnyPlant;
use crate::simulation::continuation::Exchange;
use crate::simulation::identification::SLOWEST_IDENTIFICATION;
use crate::simulation::metrics::Metrics;
use crate::simulation::plan::Plan;

/// Time by which the deflection rate is weighed where an arm at rest is looked for, s: one over the angular
/// frequency of the vibration, as in the reward.
const VIBRATION_TIME: f64 = 0.04;

/// Errors of the reported mass beyond this are no knowledge: what tells them is limited at
/// [`LARGEST_IDENTIFIED_ERROR`](crate::simulation::identification::LARGEST_IDENTIFIED_ERROR).
const LARGEST_BELIEVED_ERROR: f64 = 0.4;

/// What has been of one leg.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LegRecord {
    /// Place in the mission's list of legs.
    pub leg: usize,
    /// Beginning, s after that of the mission.
    pub start: f64,
    /// Reference of the slew angle at the beginning, rad.
    pub angle: f64,
    /// Reported mass that the leg was planned for, kg.
    pub planned_mass: f64,
    /// What a payload brought or took at the leg's beginning, and what brakes took that closed.
    pub exchange: Exchange,
    /// Sums of the reward's terms; 0 where nothing is paid.
    pub terms: [f64; 3],
    /// Metrics of the leg.
    pub metrics: Metrics,
}

/// Sums from which the mass error of the payload is identified: least squares over the leg.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
struct Learnt {
    /// Squared slew rates times the errors seen at them.
    error: f64,
    /// Squared slew rates.
    weight: f64,
}

/// What changes in a course, for a snapshot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CourseState {
    leg: usize,
    quiet: u64,
    learnt: Learnt,
    believed: Option<f64>,
    exchange: Exchange,
    terms: [f64; 3],
    records: Vec<LegRecord>,
    /// Momentum of arm and wheels after the last leg in which brakes or motor have held the shoulder, N m s.
    stored: f64,
}

/// Equations of motion with each payload of a mission.
type Bodies = Vec<(PayloadProperties, AnyPlant<f64>)>;

/// A mission under way.
#[derive(Debug, Clone)]
pub(crate) struct Course {
    mission: Arc<ValidMission>,
    bodies: Arc<Bodies>,
    /// Samples of the leg under way, unless the arm is at rest before.
    samples: u64,
    /// Samples flown in the legs before.
    before: u64,
    /// Reference angle at the leg's beginning, rad.
    angle: f64,
    state: CourseState,
}

/// Where a leg has begun, told from the beginning of its mission on.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Origin {
    /// Time, s.
    pub(crate) time: f64,
    /// Reference of the slew angle, rad.
    pub(crate) angle: f64,
    /// Electrical energy of the slew motor until then, J.
    pub(crate) energy: f64,
    /// Angle through which the base has turned, rad.
    pub(crate) base: f64,
}

/// What comes after a period of a mission.
pub(crate) enum Turn {
    /// The leg goes on.
    Same,
    /// The next leg begins.
    Next(Box<Flight<f64>>),
    /// There is no leg left.
    Done,
}

impl Course {
    /// A mission and its flight at the beginning; `noise` feeds the sensors.
    ///
    /// # Errors
    /// Parameters that no arm has.
    pub(crate) fn begin(
        mission: ValidMission,
        noise: Stream,
    ) -> Result<(Flight<f64>, Self), ConfigError> {
        let mut bodies = Bodies::new();
        for leg in mission.legs() {
            let payload = leg.scenario.true_payload()?;
            if !bodies.iter().any(|(other, _)| *other == payload) {
                let body = AnyPlant::new(&leg.scenario, &payload, mission.range())?;
                bodies.push((payload, body));
            }
        }
        let mut course = Self {
            bodies: Arc::new(bodies),
            samples: 0,
            before: 0,
            angle: 0.0,
            state: CourseState {
                leg: 0,
                quiet: 0,
                learnt: Learnt::default(),
                believed: None,
                exchange: Exchange::default(),
                terms: [0.0; 3],
                records: Vec::new(),
                stored: 0.0,
            },
            mission: Arc::new(mission),
        };
        let (plan, body) = course.plan_leg(0, None)?;
        let flight = Flight::with_body(plan, body, noise);
        course.samples = course.samples_of(&flight.scenario())?;
        Ok((flight, course))
    }

    /// Memory of the course of a mission, bytes, about, without what legs have in common.
    pub(crate) fn bytes(mission: &ValidMission) -> u128 {
        let each = size_of::<PlannedLeg>() + size_of::<LegRecord>();
        (size_of::<Self>() + mission.legs().len() * each) as u128
    }

    /// The mission.
    pub(crate) fn mission(&self) -> &ValidMission {
        &self.mission
    }

    /// Samples flown in the legs before.
    pub(crate) fn before(&self) -> u64 {
        self.before
    }

    /// Where the leg began that the flight is of.
    pub(crate) fn origin(&self, sample_period: f64) -> Origin {
        let energy = |records: &[LegRecord]| records.iter().map(|r| r.metrics.slew_energy).sum();
        let records = &self.state.records;
        match records.split_last() {
            Some((last, others)) if self.is_done() => Origin {
                time: last.start,
                angle: last.angle,
                energy: energy(others),
                base: self.base_angle(others.len()),
            },
            _ => Origin {
                time: self.before as f64 * sample_period,
                angle: self.angle,
                energy: energy(records),
                base: self.base_angle(records.len()),
            },
        }
    }

    /// Angle through which the base turns in the first legs that take time, rad.
    fn base_angle(&self, legs: usize) -> f64 {
        let legs = self.mission.legs().iter().take(legs);
        let bases = legs.filter_map(|leg| leg.handling.base);
        bases.map(|base| base.angle()).sum()
    }

    /// Place of the leg under way in the mission's list of legs; after the last one, their number.
    pub(crate) fn leg(&self) -> usize {
        let timed = self.mission.legs().get(self.state.leg);
        timed.map_or(self.mission.mission().legs.len(), |leg| leg.index)
    }

    /// Whether all legs have been flown.
    pub(crate) fn is_done(&self) -> bool {
        self.state.leg == self.mission.legs().len()
    }

    /// Samples from one of the leg under way until [`Course::look`] has to be asked.
    pub(crate) fn until_look(&self, sample: u64) -> u64 {
        let period = self.mission.period();
        let left = self.limit().saturating_sub(self.before + sample);
        (period - sample % period).min(left).max(1)
    }

    /// Samples after which a mission ends, complete or not.
    fn limit(&self) -> u64 {
        self.mission.scenario().samples() as u64
    }

    /// Whether [`Course::look`] has to be asked after so many samples of the leg.
    pub(crate) fn is_due(&self, sample: u64) -> bool {
        sample.is_multiple_of(self.mission.period()) || self.before + sample >= self.limit()
    }

    /// Angle (rad) at which the mission ends, and angle and extension (m) on the way as the legs prescribe
    /// them, `instants` a leg.
    pub(crate) fn path(&self, instants: usize) -> (f64, Vec<(f64, f64)>) {
        let mut path = Vec::new();
        let mut angle = 0.0;
        for leg in self.mission.legs() {
            let scenario = &leg.scenario;
            let deployment = &scenario.deployment;
            let (from, to) = (deployment.start, deployment.final_extension());
            if !scenario.slew.turns() && from == to {
                continue;
            }
            let plan = Plan::of_leg(&leg.scenario, leg, self.mission.range());
            let (Ok(plan), Ok(samples)) = (plan, leg.samples(scenario, self.mission.period()))
            else {
                continue;
            };
            let seconds = samples as f64 * scenario.sample_period;
            for i in 0..=instants {
                let time = seconds * i as f64 / instants as f64;
                let reference = plan.timeline.reference(time);
                path.push((
                    angle + reference.angle,
                    plan.timeline.extension(time).length,
                ));
            }
            angle += scenario.slew.target();
        }
        (angle, path)
    }

    /// Place of the leg under way, and the sums of the reward's terms of every leg that takes time.
    pub(crate) fn report(&self) -> Vec<f64> {
        let mut report = vec![0.0; 1 + 3 * self.mission.legs().len()];
        report[0] = self.leg() as f64;
        let flown = self.state.records.iter().map(|record| record.terms);
        let terms = flown.chain([self.state.terms]);
        for (row, terms) in report[1..].chunks_exact_mut(3).zip(terms) {
            row.copy_from_slice(&terms);
        }
        report
    }

    /// Takes what was paid for a part of the leg under way.
    pub(crate) fn pay(&mut self, terms: [f64; 3]) {
        for (sum, term) in self.state.terms.iter_mut().zip(terms) {
            *sum += term;
        }
    }

    /// The leg under way as if it ended now.
    fn record(&self, flight: &Flight<f64>, metrics: Metrics) -> LegRecord {
        let scenario = flight.scenario();
        LegRecord {
            leg: self.leg(),
            start: self.before as f64 * scenario.sample_period,
            angle: self.angle,
            planned_mass: scenario.reported().map_or(f64::NAN, |told| told.mass),
            exchange: self.state.exchange,
            terms: self.state.terms,
            metrics,
        }
    }

    /// Legs flown, and the one under way up to now; `diverged` says that it ended at a limit.
    pub(crate) fn records(&self, flight: &Flight<f64>, diverged: bool) -> Vec<LegRecord> {
        let mut records = self.state.records.clone();
        if !self.is_done() {
            let paid = self.state.terms.iter().sum();
            records.push(self.record(flight, flight.metrics(diverged, paid)));
        }
        records
    }

    /// Metrics of the mission so far.
    pub(crate) fn metrics(&self, flight: &Flight<f64>, diverged: bool) -> Metrics {
        combined(&self.records(flight, diverged))
    }

    /// [`Course::metrics`] with NaN for the energy, which costs as much as a control period.
    pub(crate) fn metrics_under_way(&self, flight: &Flight<f64>, diverged: bool) -> Metrics {
        let mut records = self.state.records.clone();
        if !self.is_done() {
            let paid = self.state.terms.iter().sum();
            let metrics = flight.metrics_under_way(diverged, paid);
            records.push(self.record(flight, metrics));
        }
        combined(&records)
    }

    /// To be asked after each period of the mission: whether the leg goes on, and the next one if not.
    pub(crate) fn look(&mut self, flight: &Flight<f64>) -> Turn {
        let Some(leg) = self.mission.legs().get(self.state.leg).copied() else {
            return Turn::Done;
        };
        let period = self.mission.period();
        self.learn(flight);
        let sample = flight.common.sample as u64;
        let is_last = self.before + sample >= self.limit();
        let mut over = is_last || sample >= self.samples;
        match leg.ending {
            None => {}
            Some(Ending::Rest {
                deflection: most,
                slew_error,
                quiet,
            }) => {
                // what brakes hold does not come nearer
                let slide = if flight.is_braked(0) {
                    0.0
                } else {
                    flight.reach() * flight.slew_error()
                };
                let (deflection, rate) = flight.tip_deflection();
                let amplitude = libm::hypot(deflection, rate * VIBRATION_TIME);
                let still = amplitude <= most && slide.abs() <= slew_error;
                self.state.quiet = if still { self.state.quiet + 1 } else { 0 };
                let seconds = (self.state.quiet * period) as f64 * flight.sample_period();
                over |= still && seconds >= quiet;
            }
            Some(Ending::Empty(momentum)) => {
                let stored = flight.wheel_momenta().map(f64::abs);
                over |= momentum > 0.0 && stored.into_iter().all(|stored| stored <= momentum);
            }
        }
        if !over {
            return Turn::Same;
        }
        let paid = self.state.terms.iter().sum();
        let record = self.record(flight, flight.metrics(false, paid));
        self.state.records.push(record);
        if self.mission.replans() && self.state.learnt.weight > 0.0 {
            let error = self.state.learnt.error / self.state.learnt.weight;
            if error.abs() <= LARGEST_BELIEVED_ERROR {
                self.state.believed = Some(record.planned_mass * (1.0 + error));
            }
        }
        self.before += sample;
        self.angle += flight.reference().angle;
        self.state.leg += 1;
        self.state.quiet = 0;
        self.state.learnt = Learnt::default();
        self.state.terms = [0.0; 3];
        self.state.exchange = Exchange::default();
        let next = self.mission.legs().get(self.state.leg);
        let Some(next) = next.filter(|_| !is_last) else {
            self.state.leg = self.mission.legs().len();
            return Turn::Done;
        };
        let held = leg.scenario.payload;
        let other_payload = next.grappled || next.scenario.payload != held;
        if other_payload {
            self.state.believed = None;
        }
        // with what has been learnt, or else as it was checked
        let planned = self
            .plan_leg(self.state.leg, self.state.believed)
            .or_else(|_| self.plan_leg(self.state.leg, None));
        let Ok((plan, body)) = planned else {
            self.state.leg = self.mission.legs().len();
            return Turn::Done;
        };
        if flight.is_held(0) {
            self.state.stored = flight.whole_momentum();
        }
        let samples = self.samples_of(&plan.scenario);
        let (next, exchange) = flight.continued(plan, body, other_payload, self.state.stored);
        self.state.exchange = exchange;
        self.samples = samples.unwrap_or(period);
        Turn::Next(Box::new(next))
    }

    /// Takes what the balance of angular momentum tells of the payload now.
    fn learn(&mut self, flight: &Flight<f64>) {
        let [_, rate, ..] = flight.measured();
        let handled = flight.handling_of(0).is_some();
        if rate.abs() < SLOWEST_IDENTIFICATION || flight.knows_no_payload() || handled {
            return;
        }
        let learnt = &mut self.state.learnt;
        learnt.error += rate * rate * flight.identified_mass_error();
        learnt.weight += rate * rate;
    }

    /// Plan and equations of a leg, planned for a mass that is believed (kg) if there is one.
    fn plan_leg(
        &self,
        leg: usize,
        believed: Option<f64>,
    ) -> Result<(Plan, AnyPlant<f64>), ConfigError> {
        let planned = &self.mission.legs()[leg];
        let mut scenario = planned.scenario;
        if let Some(mass) = believed {
            let told = scenario.reported()?;
            let mut changed = Scenario::from(scenario);
            changed.mass_error = 0.0;
            changed.reported_payload.mass = Some(mass);
            changed.reported_payload.length = Some(told.length);
            changed.reported_payload.width = Some(told.width);
            scenario = ValidScenario::new(changed)?;
        }
        let plan = Plan::of_leg(&scenario, planned, self.mission.range())?;
        let mut bodies = self.bodies.iter();
        let body = match bodies.find(|(payload, _)| *payload == plan.payload) {
            Some((_, body)) => body.clone(),
            None => AnyPlant::new(&scenario, &plan.payload, self.mission.range())?,
        };
        Ok((plan, body))
    }

    /// Samples of the leg under way where it is flown as this scenario.
    fn samples_of(&self, scenario: &Scenario) -> Result<u64, ConfigError> {
        let leg = &self.mission.legs()[self.state.leg];
        leg.samples(scenario, self.mission.period())
    }

    /// What changes, for a snapshot.
    pub(crate) fn state(&self) -> &CourseState {
        &self.state
    }

    /// The course in a state taken from one of the same mission, and the flight at the beginning of the
    /// leg under way; `noise` feeds the sensors.
    ///
    /// # Errors
    /// A state that no flight of the mission has.
    pub(crate) fn restored(
        mission: ValidMission,
        state: CourseState,
        noise: Stream,
    ) -> Result<(Flight<f64>, Self), SnapshotError> {
        let damaged = |what: &dyn std::fmt::Display| SnapshotError::Damaged(what.to_string());
        let (first, mut course) = Self::begin(mission, noise.clone()).map_err(|e| damaged(&e))?;
        let legs = course.mission.legs();
        let flown = state.records.len();
        let cut = state.leg == legs.len() && 0 < flown && flown < legs.len();
        if flown > legs.len() || !(state.leg == flown || cut) {
            return Err(damaged(&"it holds legs that the mission does not have"));
        }
        let period = course.mission.period();
        let sample = first.sample_period();
        let mut before = 0_u64;
        let mut angle = 0.0;
        for (leg, record) in legs.iter().zip(&state.records) {
            let samples = (record.metrics.duration / sample).round();
            let fits = record.leg == leg.index
                && record.start == before as f64 * sample
                && record.angle == angle
                && record.terms.iter().all(|x| x.is_finite() && *x <= 0.0)
                && (0.0..=1e9).contains(&samples)
                && (cut || (samples as u64).is_multiple_of(period));
            if !fits {
                return Err(damaged(&"it holds records of other legs"));
            }
            before += samples as u64;
            angle += leg.scenario.slew.target();
        }
        let sums = [state.learnt.error, state.learnt.weight];
        let believed = state
            .believed
            .is_none_or(|mass| mass.is_finite() && mass >= 0.0);
        let paid = state.terms.iter().all(|x| x.is_finite() && *x <= 0.0);
        let finite = sums.iter().all(|x| x.is_finite()) && state.stored.is_finite();
        if !(believed && paid && finite && state.learnt.weight >= 0.0) {
            return Err(damaged(&"its mission holds numbers that none has"));
        }
        // after the last leg the flight is still that of it
        let done = state.leg == legs.len();
        let flying = if done { flown - 1 } else { flown };
        let believed = if done {
            let told = legs[flying]
                .scenario
                .reported()
                .map_or(0.0, |told| told.mass);
            let last = state.records.last().map(|record| record.planned_mass);
            last.filter(|mass| *mass != told)
        } else {
            state.believed
        };
        let (plan, body) = course.plan_leg(flying, believed).map_err(|e| damaged(&e))?;
        let mut flight = Flight::with_body(plan, body, noise);
        flight.store(state.stored);
        course.before = before;
        course.angle = angle;
        course.state = state;
        if !course.is_done() {
            let samples = course.samples_of(&flight.scenario());
            course.samples = samples.map_err(|e| damaged(&e))?;
        }
        Ok((flight, course))
    }
}

/// Metrics of several legs as those of one flight: means over all of the time, largest values of any leg,
/// sums, and what belongs to the end as it is at the end of the last one.
pub(crate) fn combined(records: &[LegRecord]) -> Metrics {
    let Some(last) = records.last() else {
        return Metrics::default();
    };
    let end = last.metrics;
    let sum = |value: fn(&Metrics) -> f64| records.iter().map(|r| value(&r.metrics)).sum::<f64>();
    let peak = |value: fn(&Metrics) -> f64| {
        let values = records.iter().map(|r| value(&r.metrics));
        values.fold(f64::NAN, f64::max)
    };
    let duration = sum(|m| m.duration);
    let whole = Metrics {
        slew_end_time: last.start + end.slew_end_time,
        duration,
        episode_return: sum(|m| m.episode_return),
        ..end
    };
    if end.diverged && end.tip_error_rms.is_nan() {
        return whole;
    }
    let residual = |m: &Metrics| (m.duration - m.slew_end_time).max(0.0);
    let (mut squares, mut seconds) = (0.0, 0.0);
    for record in records {
        let metrics = &record.metrics;
        if metrics.residual_rms.is_finite() {
            let weight = residual(metrics);
            squares += weight * metrics.residual_rms * metrics.residual_rms;
            seconds += weight;
        }
    }
    Metrics {
        tip_error_rms: libm::sqrt(
            sum(|m| m.duration * m.tip_error_rms * m.tip_error_rms) / duration,
        ),
        peak_deflection: peak(|m| m.peak_deflection),
        peak_slew_angle: peak(|m| m.peak_slew_angle),
        residual_rms: libm::sqrt(squares / seconds),
        residual_peak: peak(|m| m.residual_peak),
        overshoot: peak(|m| m.overshoot),
        wheel_effort: sum(|m| m.wheel_effort),
        saturation: sum(|m| m.duration * m.saturation) / duration,
        slew_energy: sum(|m| m.slew_energy),
        ..whole
    }
}
