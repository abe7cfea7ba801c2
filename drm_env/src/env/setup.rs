//! What all environments of one configuration have in common.

use crate::config::reward::RewardScale;
use crate::config::{EnvConfig, ValidConfig};
use crate::env::observation::{frame_size, observation_size};
use std::sync::Arc;

/// What all environments of one configuration have in common.
#[derive(Debug)]
pub(crate) struct Setup {
    pub(crate) config: ValidConfig,
    pub(crate) fingerprint: u64,
    pub(crate) scale: RewardScale,
    pub(crate) frame_size: usize,
    pub(crate) observation_size: usize,
    pub(crate) samples_per_action: usize,
    /// Samples until the manoeuvre is over, which are paid or charged.
    pub(crate) horizon: u64,
    /// Samples after which an episode is truncated: the horizon, or fewer.
    pub(crate) cut: u64,
}

impl Setup {
    pub(crate) fn new(config: &ValidConfig) -> Arc<Self> {
        Self::limited(config, None)
    }

    /// With episodes that are truncated after at most so many actions, and are else the same.
    pub(crate) fn limited(config: &ValidConfig, actions: Option<usize>) -> Arc<Self> {
        let horizon = config.scenario.samples() as u64;
        let cut = actions.map_or(horizon, |count| {
            horizon.min((count as u64).saturating_mul(config.samples_per_action() as u64))
        });
        Arc::new(Self {
            cut,
            horizon,
            fingerprint: fingerprint(config),
            scale: RewardScale::new(&config.task.reward),
            frame_size: frame_size(&config.task),
            observation_size: observation_size(config),
            samples_per_action: config.samples_per_action(),
            config: config.clone(),
        })
    }
}

/// A mark of the configuration: two environments with the same mark exchange snapshots.
pub(crate) fn fingerprint(config: &EnvConfig) -> u64 {
    let text = config.to_json();
    let reversed: Vec<u8> = text.bytes().rev().collect();
    u64::from(crc32fast::hash(text.as_bytes())) << 32 | u64::from(crc32fast::hash(&reversed))
}
