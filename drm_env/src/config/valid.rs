//! A configuration that has been found good, held from then on.

use std::convert::Infallible;
use std::ops::Deref;
use std::sync::Arc;

use crate::config::EnvConfig;
use crate::config::scenario::ValidScenario;
use crate::error::ConfigError;

/// A configuration that can be flown. It is checked when it is made and cannot change, so that whoever
/// takes one need not check it again; clones share it.
#[derive(Debug, Clone, PartialEq)]
pub struct ValidConfig(Arc<EnvConfig>);

impl ValidConfig {
    /// Checks a configuration.
    ///
    /// # Errors
    /// See [`EnvConfig::validate`].
    pub fn new(config: EnvConfig) -> Result<Self, ConfigError> {
        config.validate()?;
        Ok(Self::of_valid(config))
    }

    /// See [`EnvConfig::resolve`], which checks.
    ///
    /// # Errors
    /// Malformed text, unknown names, values of the wrong type or out of range; each with its path.
    pub fn resolve(
        preset: &str,
        config: Option<&str>,
        options: Option<&str>,
    ) -> Result<Self, ConfigError> {
        EnvConfig::resolve(preset, config, options).map(Self::of_valid)
    }

    /// Of a configuration that has been checked, with the instruments that are observed.
    fn of_valid(mut config: EnvConfig) -> Self {
        let EnvConfig { scenario, task, .. } = &mut config;
        scenario.sensors.fit(task.instruments());
        Self(Arc::new(config))
    }

    /// The manoeuvre that its environments fly, if they draw nothing.
    pub fn manoeuvre(&self) -> Option<ValidScenario> {
        let fixed = self.drawn().is_empty();
        fixed.then(|| ValidScenario::of_valid(self.scenario))
    }
}

impl TryFrom<Arc<EnvConfig>> for ValidConfig {
    type Error = ConfigError;

    fn try_from(config: Arc<EnvConfig>) -> Result<Self, ConfigError> {
        Self::new(Arc::unwrap_or_clone(config))
    }
}

impl Deref for ValidConfig {
    type Target = EnvConfig;

    fn deref(&self) -> &EnvConfig {
        &self.0
    }
}

/// What takes an [`EnvConfig`] takes a [`ValidConfig`] as well, which fails in no way.
impl From<Infallible> for ConfigError {
    fn from(never: Infallible) -> Self {
        match never {}
    }
}
