//! Configurations from JSON text.

use crate::config::mission::{Mission, ValidMission};
use crate::config::options::is_distribution;
use crate::config::scenario::{Scenario, ValidScenario};
use crate::control::Law;
use crate::error::ConfigError;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value, json};

/// Reads a typed value from JSON, naming the path of what does not fit.
///
/// Serde takes a list for a table, its entries for the fields in their order; here that is refused.
///
/// # Errors
/// An unknown field, a value of the wrong type, a list where a table belongs.
pub fn typed<T: DeserializeOwned + Serialize>(document: &Value) -> Result<T, ConfigError> {
    let found: T = match serde_path_to_error::deserialize(document) {
        Ok(found) => found,
        Err(error) => {
            let path = error.path().to_string();
            let path = if path == "." { String::new() } else { path };
            let message = error.into_inner().to_string();
            let path = below_a_tag::<T>(document, path, &message);
            return Err(ConfigError::form(path, message));
        }
    };
    let made = serde_json::to_value(&found).map_err(|e| ConfigError::form("", e))?;
    refuse_lists_for_tables(document, &made, "")?;
    Ok(found)
}

/// Where it is that something does not fit. Serde tells no path below a tag, such as the name of a law: there it
/// is the part without which the complaint would be another.
fn below_a_tag<T: DeserializeOwned>(document: &Value, mut path: String, message: &str) -> String {
    let tags = ["name", "kind"];
    let pointer = |path: &str| match path.replace(['.', '['], "/").replace(']', "") {
        path if path.is_empty() => path,
        path => format!("/{path}"),
    };
    let tagged = |part: &Value| tags.iter().any(|tag| part[*tag].is_string());
    if !document.pointer(&pointer(&path)).is_some_and(tagged) {
        return path;
    }
    while let Some(Value::Object(parts)) = document.pointer(&pointer(&path)) {
        let culprit = parts.keys().find(|name| {
            let mut rest = document.clone();
            if let Some(Value::Object(parts)) = rest.pointer_mut(&pointer(&path)) {
                parts.remove(*name);
            }
            let other = T::deserialize(rest).err().map(|error| error.to_string());
            !tags.contains(&name.as_str()) && other.as_deref() != Some(message)
        });
        let Some(name) = culprit else { break };
        let separator = if path.is_empty() { "" } else { "." };
        path = format!("{path}{separator}{name}");
    }
    path
}

/// Refuses a list that a table was made of. A list of a distribution is a range or choices.
fn refuse_lists_for_tables(given: &Value, made: &Value, path: &str) -> Result<(), ConfigError> {
    match (given, made) {
        (Value::Array(_), Value::Object(_)) if !is_distribution(made) => Err(ConfigError::form(
            path,
            format!("must be a table of names and values, got the list {given}"),
        )),
        (Value::Array(given), Value::Array(made)) => {
            let pairs = given.iter().zip(made).enumerate();
            pairs.into_iter().try_for_each(|(index, (given, made))| {
                refuse_lists_for_tables(given, made, &format!("{path}[{index}]"))
            })
        }
        (Value::Object(given), Value::Object(made)) => given.iter().try_for_each(|(name, part)| {
            let separator = if path.is_empty() { "" } else { "." };
            let inner = format!("{path}{separator}{name}");
            made.get(name)
                .map_or(Ok(()), |made| refuse_lists_for_tables(part, made, &inner))
        }),
        _ => Ok(()),
    }
}

/// A JSON object from text.
pub(crate) fn object(name: &str, text: &str) -> Result<Map<String, Value>, ConfigError> {
    serde_json::from_str(text).map_err(|e| ConfigError::form(name, e))
}

/// `"linear"` stands for `{"name": "linear"}`.
pub(crate) fn name_law(law: &mut Value) {
    if let Value::String(name) = law {
        *law = json!({ "name": name });
    }
}

/// One scenario from JSON text; parts left out have their defaults.
///
/// # Errors
/// Malformed text, unknown names, values of the wrong type or out of range; each with its path.
pub fn scenario_from_json(text: &str) -> Result<ValidScenario, ConfigError> {
    let scenario: Scenario = typed(&Value::Object(object("scenario", text)?))?;
    ValidScenario::new(scenario)
}

/// A mission from JSON text: an object with `mission`, and `scenario` with what all legs have in common;
/// parts left out have their defaults, a horizon too short for the legs is lengthened to theirs unless it is
/// given.
///
/// # Errors
/// Malformed text, unknown names, values of the wrong type or out of range; each with its path.
pub fn mission_from_json(text: &str) -> Result<ValidMission, ConfigError> {
    let mut document = object("mission", text)?;
    let mission: Mission = typed_part(&mut document, "mission")?;
    let scenario = document.remove("scenario").unwrap_or_else(|| json!({}));
    if let Some(name) = document.keys().next() {
        let message = "unknown field of a mission; there are mission and scenario";
        return Err(ConfigError::form(name, message));
    }
    let has_horizon = scenario
        .get("horizon")
        .is_some_and(|value| !value.is_null());
    let scenario: Scenario = typed(&scenario).map_err(|e| e.within("scenario"))?;
    if has_horizon {
        let scenario = ValidScenario::new(scenario).map_err(|e| e.within("scenario"))?;
        return ValidMission::new(&mission, scenario);
    }
    ValidMission::with_horizon(&mission, scenario)
}

/// Takes a part out of a document and reads it.
fn typed_part<T: DeserializeOwned + Serialize + Default>(
    document: &mut Map<String, Value>,
    name: &str,
) -> Result<T, ConfigError> {
    match document.remove(name) {
        None | Some(Value::Null) => Ok(T::default()),
        Some(value) => typed(&value).map_err(|e| e.within(name)),
    }
}

/// A law from JSON text: an object, or the bare name in quotes.
///
/// # Errors
/// An unknown name, unknown gains, or gains that are not finite.
pub fn law_from_json(text: &str) -> Result<Law, ConfigError> {
    let mut value: Value = serde_json::from_str(text).map_err(|e| ConfigError::form("law", e))?;
    name_law(&mut value);
    if let Some(name) = value.get("name").and_then(Value::as_str) {
        Law::named(name).map_err(|e| e.within("law"))?;
    }
    let law: Law = typed(&value).map_err(|e| e.within("law"))?;
    law.validate().map_err(|e| e.within("law"))?;
    Ok(law)
}
