//! Who flies the manoeuvres of a rollout.

use crate::config::ValidConfig;
use crate::config::mission::ValidMission;
use crate::config::scenario::ValidScenario;
use crate::control::Law;
use crate::control::mlp::Network;
use crate::error::ConfigError;
use crate::hardware::sensors::INSTRUMENTS;
use crate::interruption;
use crate::simd::dispatch::Vector;

use super::law::{self, Commands, Schedule};
use super::network::NetworkPilot;
use super::queue::Queue;

/// Who flies manoeuvres from end to end. It is checked when it is made, so that whoever takes one need
/// not check it again; whether it can fly certain manoeuvres is another question. In flight it is asked
/// for commands as a [`Controller`](crate::simulation::controller::Controller), sample by sample.
#[derive(Debug)]
pub struct Pilot<'a>(Kind<'a>);

#[derive(Debug)]
enum Kind<'a> {
    /// Commands of the wheels at the sample period.
    Commands(Commands<'a>),
    /// Actions in a task.
    Network(Box<NetworkPilot<'a>>),
}

impl<'a> Pilot<'a> {
    /// A law, at the sample period; nothing is paid and no limit but those of [`crate::validity`] watched.
    ///
    /// # Errors
    /// Gains that are not finite.
    pub fn law(law: &'a Law) -> Result<Self, ConfigError> {
        law.validate()?;
        Ok(Self(Kind::Commands(Commands::Law(law))))
    }

    /// Torques that are given beforehand.
    ///
    /// # Errors
    /// Torques that are not finite, or held for no sample.
    pub fn schedule(schedule: Schedule<'a>) -> Result<Self, ConfigError> {
        schedule.validate()?;
        Ok(Self(Kind::Commands(Commands::Schedule(schedule))))
    }

    /// A network that acts on the observations of an environment: its episodes are those of [`crate::Env`]
    /// with each scenario in the place of the one that the configuration draws. What it does, sees and
    /// is paid for is the configuration's task.
    ///
    /// # Errors
    /// Other inputs than the observation has entries, or other outputs than there are actuators.
    pub fn network(network: &'a Network, config: &ValidConfig) -> Result<Self, ConfigError> {
        let pilot = NetworkPilot::new(network, config)?;
        Ok(Self(Kind::Network(Box::new(pilot))))
    }

    /// Refuses manoeuvres that it cannot fly.
    pub(super) fn check(&self, scenarios: &[ValidScenario]) -> Result<(), ConfigError> {
        match &self.0 {
            Kind::Commands(Commands::Law(_)) => Ok(()),
            Kind::Commands(Commands::Schedule(schedule)) => schedule.check_count(scenarios.len()),
            Kind::Network(pilot) => {
                for (i, scenario) in scenarios.iter().enumerate() {
                    interruption::poll();
                    let checked = pilot.check(scenario);
                    checked.map_err(|e| e.within(&format!("scenarios[{i}]")))?;
                }
                Ok(())
            }
        }
    }

    /// Refuses missions that are not those of a network's task, and manoeuvres where it has missions.
    pub(super) fn check_missions(
        &self,
        missions: Option<&[ValidMission]>,
    ) -> Result<(), ConfigError> {
        let Kind::Network(pilot) = &self.0 else {
            return Ok(());
        };
        let differs = match (missions, pilot.mission()) {
            (None, None) => false,
            (Some(missions), Some(of_task)) => missions.iter().any(|m| m.mission() != of_task),
            _ => true,
        };
        if differs {
            let message =
                "the manoeuvres must be missions where the policy's task has one, and its own";
            return Err(ConfigError::form("mission", message));
        }
        Ok(())
    }

    /// Instruments that it sees: they are fitted to what it flies.
    pub(super) fn instruments(&self) -> [bool; INSTRUMENTS] {
        match &self.0 {
            Kind::Commands(_) => [false; INSTRUMENTS],
            Kind::Network(pilot) => pilot.instruments(),
        }
    }

    /// Refuses one manoeuvre that it cannot fly, by the manoeuvre's own names.
    pub(super) fn check_one(&self, scenario: &ValidScenario) -> Result<(), ConfigError> {
        match &self.0 {
            Kind::Commands(Commands::Law(_)) => Ok(()),
            Kind::Commands(Commands::Schedule(schedule)) => schedule.check_count(1),
            Kind::Network(pilot) => {
                self.check_missions(None)?;
                pilot.check(scenario)
            }
        }
    }

    /// Flies what waits in a queue.
    pub(super) fn fly<T: Vector>(&self, queue: &Queue<'_>) {
        match &self.0 {
            Kind::Commands(commands) => law::fly::<T>(queue, commands),
            Kind::Network(pilot) => pilot.fly::<T>(queue),
        }
    }
}
