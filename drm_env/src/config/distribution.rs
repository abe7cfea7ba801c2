//! Distributions that the parameters of an episode are drawn from.

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::error::ConfigError;
use crate::math::rng::Stream;

/// A number, or the name of an option.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Setting {
    /// A number.
    Number(f64),
    /// The name of one of an option's alternatives.
    Name(String),
}

impl std::fmt::Display for Setting {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Number(value) => value.fmt(f),
            Self::Name(name) => write!(f, "\"{name}\""),
        }
    }
}

/// How one parameter is drawn for each episode. As data: a number or name (fixed), `[low, high]`
/// (uniform), a list of names or of any other length (choices), or an object with the name of the
/// distribution.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Value", into = "Value")]
pub enum Distribution {
    /// Always the same.
    Fixed(Setting),
    /// Uniform between the two.
    Uniform([f64; 2]),
    /// Uniform in the logarithm between the two, which must be positive.
    LogUniform([f64; 2]),
    /// Normal, redrawn until it falls within the limits.
    Normal {
        /// Mean.
        mean: f64,
        /// Standard deviation.
        std: f64,
        /// Lower limit.
        low: f64,
        /// Upper limit.
        high: f64,
    },
    /// One of a list, each as likely as the others.
    Choices(Vec<Setting>),
}

/// Names of the distributions in their data form, `{"uniform": [low, high]}`.
pub const KINDS: [&str; 4] = ["uniform", "log_uniform", "normal", "choices"];

impl JsonSchema for Distribution {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Distribution".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "description": "How one parameter is drawn for each episode: a number or name (fixed), [low, high] (uniform), a list of choices, or one of {\"uniform\": [low, high]}, {\"log_uniform\": [low, high]}, {\"normal\": {\"mean\", \"std\", \"low\", \"high\"}}, {\"choices\": [...]}.",
            "anyOf": [
                {"type": "number"},
                {"type": "string"},
                {"type": "array", "items": {"anyOf": [{"type": "number"}, {"type": "string"}]}},
                {"type": "object", "additionalProperties": true},
            ]
        })
    }
}

/// Attempts at a truncated normal before its limits are refused as too improbable.
const NORMAL_ATTEMPTS: usize = 1000;

impl Distribution {
    /// Refuses limits in the wrong order, numbers that are not finite and empty lists.
    ///
    /// # Errors
    /// Bounds, weights or values from which nothing can be drawn.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let ordered = |[low, high]: [f64; 2]| {
            if low.is_finite() && high.is_finite() && low <= high {
                return Ok(());
            }
            Err(ConfigError::value(
                "",
                "must be a finite range with low <= high",
                format!("[{low}, {high}]"),
            ))
        };
        match self {
            Self::Fixed(Setting::Number(value)) => crate::check::finite("", *value),
            Self::Fixed(Setting::Name(_)) => Ok(()),
            Self::Uniform(range) => ordered(*range),
            Self::LogUniform(range) => {
                ordered(*range)?;
                crate::check::positive("", range[0])
            }
            Self::Normal {
                mean,
                std,
                low,
                high,
            } => {
                crate::check::finite("mean", *mean)?;
                crate::check::non_negative("std", *std)?;
                // a share of at least 1e-2 keeps the redraws few
                let reach = |limit: f64| (limit - mean) / std.max(f64::MIN_POSITIVE);
                let share = normal_share(reach(*low), reach(*high));
                if low < high && share >= 1e-2 {
                    return Ok(());
                }
                Err(ConfigError::value(
                    "",
                    "must leave at least 1 % of the normal distribution within its limits",
                    format!("mean {mean}, std {std}, low {low}, high {high}"),
                ))
            }
            Self::Choices(choices) if choices.is_empty() => Err(ConfigError::value(
                "",
                "must list at least one choice",
                "[]",
            )),
            Self::Choices(choices) => choices.iter().try_for_each(|choice| match choice {
                Setting::Number(value) => crate::check::finite("", *value),
                Setting::Name(_) => Ok(()),
            }),
        }
    }

    /// Whether there is more than one value to draw.
    pub(crate) fn draws(&self) -> bool {
        !matches!(self, Self::Fixed(_))
    }

    /// Draws a value.
    pub fn draw(&self, stream: &mut Stream) -> Setting {
        let between = |[low, high]: [f64; 2], u: f64| (low + (high - low) * u).clamp(low, high);
        match self {
            Self::Fixed(setting) => setting.clone(),
            Self::Uniform(range) => Setting::Number(between(*range, stream.uniform())),
            Self::LogUniform(range) => {
                let logs = range.map(libm::log);
                let value = libm::exp(between(logs, stream.uniform()));
                Setting::Number(value.clamp(range[0], range[1]))
            }
            Self::Normal {
                mean,
                std,
                low,
                high,
            } => {
                for _ in 0..NORMAL_ATTEMPTS {
                    let value = mean + std * stream.normal();
                    if (*low..=*high).contains(&value) {
                        return Setting::Number(value);
                    }
                }
                Setting::Number(mean.clamp(*low, *high))
            }
            Self::Choices(choices) => choices[stream.index(choices.len())].clone(),
        }
    }

    /// Values at the edge of what can be drawn, with which a configuration is tried.
    pub fn extremes(&self) -> Vec<Setting> {
        match self {
            Self::Fixed(setting) => vec![setting.clone()],
            Self::Uniform([low, high]) | Self::LogUniform([low, high]) => {
                vec![Setting::Number(*low), Setting::Number(*high)]
            }
            Self::Normal {
                mean,
                std,
                low,
                high,
            } => vec![
                Setting::Number(low.max(mean - 6.0 * std)),
                Setting::Number(high.min(mean + 6.0 * std)),
            ],
            Self::Choices(choices) => choices.clone(),
        }
    }
}

fn normal_share(low: f64, high: f64) -> f64 {
    let below = |x: f64| 0.5 * libm::erfc(-x / std::f64::consts::SQRT_2);
    below(high) - below(low)
}

impl TryFrom<Value> for Distribution {
    type Error = String;

    fn try_from(value: Value) -> Result<Self, String> {
        let setting = |value: &Value| match value {
            Value::Number(number) => number
                .as_f64()
                .map(Setting::Number)
                .ok_or_else(|| format!("must be a number, got {number}")),
            Value::String(name) => Ok(Setting::Name(name.clone())),
            other => Err(format!("must be a number or a name, got {other}")),
        };
        let number = |value: Option<&Value>, name: &str| {
            value
                .and_then(Value::as_f64)
                .ok_or_else(|| format!("needs the number \"{name}\""))
        };
        let range = |value: &Value| match value.as_array().map(Vec::as_slice) {
            Some([low, high]) => match (low.as_f64(), high.as_f64()) {
                (Some(low), Some(high)) => Ok([low, high]),
                _ => Err(format!("must be [low, high] in numbers, got {value}")),
            },
            _ => Err(format!("must be [low, high] in numbers, got {value}")),
        };
        let choices = |value: &Value| match value.as_array() {
            Some(items) => items.iter().map(setting).collect::<Result<Vec<_>, _>>(),
            None => Err(format!("must be a list of choices, got {value}")),
        };
        match &value {
            Value::Number(_) | Value::String(_) => setting(&value).map(Self::Fixed),
            Value::Array(items) => match items.as_slice() {
                [low, high] if low.is_number() && high.is_number() => {
                    range(&value).map(Self::Uniform)
                }
                _ => choices(&value).map(Self::Choices),
            },
            Value::Object(fields) if fields.len() == 1 => {
                let (name, inner) = fields.iter().next().ok_or("is empty")?;
                match name.as_str() {
                    "uniform" => range(inner).map(Self::Uniform),
                    "log_uniform" => range(inner).map(Self::LogUniform),
                    "choices" => choices(inner).map(Self::Choices),
                    "normal" => {
                        if let Some(unknown) = inner.as_object().and_then(|fields| {
                            let known = ["mean", "std", "low", "high"];
                            fields.keys().find(|key| !known.contains(&key.as_str()))
                        }) {
                            return Err(format!("normal has no field \"{unknown}\""));
                        }
                        let limit = |name: &str, open: f64| match inner.get(name) {
                            None | Some(Value::Null) => Ok(open),
                            given => number(given, name),
                        };
                        Ok(Self::Normal {
                            mean: number(inner.get("mean"), "mean")?,
                            std: number(inner.get("std"), "std")?,
                            low: limit("low", f64::NEG_INFINITY)?,
                            high: limit("high", f64::INFINITY)?,
                        })
                    }
                    other => Err(format!(
                        "must be uniform, log_uniform, normal or choices, got \"{other}\""
                    )),
                }
            }
            other => Err(format!(
                "must be a number, a name, [low, high], a list of choices or one named \
                 distribution, got {other}"
            )),
        }
    }
}

impl From<Setting> for Value {
    fn from(setting: Setting) -> Self {
        match setting {
            Setting::Number(value) => Self::from(value),
            Setting::Name(name) => Self::from(name),
        }
    }
}

impl From<Distribution> for Value {
    fn from(distribution: Distribution) -> Self {
        match distribution {
            Distribution::Fixed(setting) => setting.into(),
            Distribution::Uniform(range) => serde_json::json!({ "uniform": range }),
            Distribution::LogUniform(range) => serde_json::json!({ "log_uniform": range }),
            Distribution::Normal {
                mean,
                std,
                low,
                high,
            } => {
                let limit = |value: f64| value.is_finite().then_some(value);
                serde_json::json!({
                    "normal": {"mean": mean, "std": std, "low": limit(low), "high": limit(high)}
                })
            }
            Distribution::Choices(choices) => serde_json::json!({
                "choices": choices.into_iter().map(Value::from).collect::<Vec<_>>()
            }),
        }
    }
}
