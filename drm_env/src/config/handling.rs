//! What base, shoulder and wheels do in a leg of a mission beside what a law asks for: brakes, a base that
//! turns, wheels that are run down.

use std::borrow::Cow;
use std::fmt;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::error::ConfigError;
use crate::reference::series::Series;
use crate::reference::slew::{Slew, SlewPiece, SlewProfile};

/// A base that turns about the shoulder's axis, from rest to rest.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TurnedBase {
    /// Times, s after the leg's beginning, rising; at one that is given twice the acceleration jumps.
    pub times: Series,
    /// Angular accelerations of the base at them, rad/s^2, with straight lines between; the base must come
    /// to rest.
    pub accelerations: Series,
    /// Whether the brakes hold the shoulder, so that the arm turns with the base.
    pub locked: bool,
}

/// What the base does in a leg: `"locked"`, or a motion that is prescribed.
#[expect(
    clippy::large_enum_variant,
    reason = "it is copied with the leg that holds it, as a slew's table is"
)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Base {
    /// It is at rest, and the brakes hold the shoulder.
    Locked,
    /// It turns.
    Turned(TurnedBase),
}

/// What a base is called whose brakes hold the shoulder.
const LOCKED: &str = "locked";

impl Base {
    /// Refuses a motion that cannot be prescribed.
    ///
    /// # Errors
    /// Times and accelerations that are no table, or that do not bring the base to rest.
    pub(crate) fn validate(&self) -> Result<(), ConfigError> {
        let Self::Turned(turned) = self else {
            return Ok(());
        };
        turned.profile().validate().map_err(|e| e.within("base"))
    }

    /// Whether the brakes hold the shoulder.
    pub(crate) fn is_locked(&self) -> bool {
        match self {
            Self::Locked => true,
            Self::Turned(turned) => turned.locked,
        }
    }

    /// When the base is at rest again, s.
    pub(crate) fn final_time(&self) -> f64 {
        match self {
            Self::Locked => 0.0,
            Self::Turned(turned) => turned.profile().final_time(),
        }
    }

    /// Angle that the base turns through, rad.
    pub(crate) fn angle(&self) -> f64 {
        match self {
            Self::Locked => 0.0,
            Self::Turned(turned) => turned.profile().target(),
        }
    }

    /// Motion of the base, piece by piece; empty of one at rest.
    fn pieces(&self) -> Vec<SlewPiece> {
        match self {
            Self::Locked => Vec::new(),
            Self::Turned(turned) => turned.profile().pieces(),
        }
    }
}

impl TurnedBase {
    /// The same table as a slew has.
    fn profile(&self) -> Slew {
        Slew {
            profile: SlewProfile::Table,
            times: self.times,
            accelerations: self.accelerations,
            ..Slew::default()
        }
    }
}

impl Serialize for Base {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Locked => serializer.serialize_str(LOCKED),
            Self::Turned(turned) => turned.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Base {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either;

        impl<'de> Visitor<'de> for Either {
            type Value = Base;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "\"{LOCKED}\", or times and accelerations of the base")
            }

            fn visit_str<E: Error>(self, name: &str) -> Result<Base, E> {
                if name == LOCKED {
                    return Ok(Base::Locked);
                }
                Err(E::unknown_variant(name, &[LOCKED]))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Base, A::Error> {
                TurnedBase::deserialize(MapAccessDeserializer::new(map)).map(Base::Turned)
            }
        }

        deserializer.deserialize_any(Either)
    }
}

impl JsonSchema for Base {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> Cow<'static, str> {
        "Base".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let turned = generator.subschema_for::<TurnedBase>();
        json_schema!({"anyOf": [{"const": LOCKED, "type": "string"}, turned]})
    }
}

/// What a leg does beside its manoeuvre.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct LegHandling {
    /// What the base does, where it is not at rest with a free shoulder.
    pub(crate) base: Option<Base>,
    /// Whether the wheels are run down, with so much torque at most (N m) where that is given.
    pub(crate) unload: Option<Option<f64>>,
}

/// Time constant with which wheels are run down at the end, s, and how many times their own lag and dead
/// time it is at least: so that what they store goes to zero without swinging.
const UNLOAD_TIME: f64 = 0.5;
const UNLOAD_LAGS: f64 = 4.0;

impl LegHandling {
    /// What is done in flight with wheels that follow so late, s; nothing in a leg that is only a manoeuvre.
    pub(crate) fn planned(&self, late: [f64; 2]) -> Option<Handling> {
        if self.base.is_none() && self.unload.is_none() {
            return None;
        }
        Some(Handling {
            locked: self.base.is_some_and(|base| base.is_locked()),
            base: self.base.map_or_else(Vec::new, |base| base.pieces()),
            unload: self.unload.map(|torque| Unload {
                torque: torque.unwrap_or(f64::INFINITY),
                rates: late.map(|late| 1.0 / UNLOAD_TIME.max(UNLOAD_LAGS * late)),
            }),
        })
    }
}

/// How the wheels are run down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Unload {
    /// Largest torque of either wheel, N m.
    torque: f64,
    /// Part of what root and tip wheel store that goes in a second at the end, 1/s.
    rates: [f64; 2],
}

impl Unload {
    /// Torques on the arm of wheels that store so much (N m s), N m.
    pub(crate) fn torques(&self, momenta: [f64; 2]) -> [f64; 2] {
        std::array::from_fn(|i| (momenta[i] * self.rates[i]).clamp(-self.torque, self.torque))
    }
}

/// What a leg does beside its manoeuvre, as it is flown.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Handling {
    /// Whether the brakes hold the shoulder.
    pub(crate) locked: bool,
    /// Motion of the base, piece by piece; empty of one at rest.
    base: Vec<SlewPiece>,
    /// How the wheels are run down; nothing where they are not.
    pub(crate) unload: Option<Unload>,
}

impl Handling {
    /// Whether the base turns.
    pub(crate) fn turns(&self) -> bool {
        !self.base.is_empty()
    }

    /// Whether the shoulder is held by brakes or by the motor: what comes from outside then is no part
    /// of the plan.
    pub(crate) fn holds(&self) -> bool {
        self.locked || self.unload.is_some()
    }

    /// When the base's motion switches, s.
    pub(crate) fn switches(&self) -> impl Iterator<Item = f64> {
        self.base.iter().map(|piece| piece.start)
    }

    /// The motion of the base in force after `time` (s), to be told of times up to its next switch.
    pub(crate) fn motion(&self, time: f64) -> BaseMotion<'_> {
        let after = self.base.partition_point(|piece| piece.start <= time);
        BaseMotion(self.base.get(after.max(1) - 1))
    }
}

/// A part of the base's motion.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BaseMotion<'a>(Option<&'a SlewPiece>);

impl BaseMotion<'_> {
    /// Angle (rad), rate (rad/s) and acceleration (rad/s^2) of the base.
    pub(crate) fn at(&self, time: f64) -> (f64, f64, f64) {
        self.0.map_or((0.0, 0.0, 0.0), |piece| {
            piece.at((time - piece.start).max(0.0))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_base_is_a_word_or_a_table() {
        let read = |text: &str| serde_json::from_str::<Base>(text);
        assert_eq!(read("\"locked\"").expect("it is a base"), Base::Locked);
        let text = r#"{"times":[0.0,2.0],"accelerations":[0.1,-0.1],"locked":true}"#;
        let base = read(text).expect("it is a base");
        assert!(base.is_locked() && base.validate().is_ok());
        assert_eq!(serde_json::to_string(&base).expect("it is data"), text);
        // 0.1 - 0.1 t, twice integrated over 2 s
        assert!((base.angle() - 2.0 / 30.0).abs() < 1e-15);
        for (wrong, word) in [
            ("\"loose\"", "loose"),
            ("3", "locked"),
            (r#"{"tims":[]}"#, "tims"),
        ] {
            let error = read(wrong).expect_err("it is none").to_string();
            assert!(error.contains(word), "{error}");
        }
        let left = read(r#"{"times":[0.0,2.0],"accelerations":[0.1,0.1]}"#);
        let error = left
            .expect("it is a table")
            .validate()
            .expect_err("it turns on");
        assert!(error.to_string().contains("base.accelerations"), "{error}");
    }

    /// The angle is the acceleration's second integral, by the midpoint rule.
    #[test]
    fn the_motion_is_the_integral_of_the_table() {
        let base = Base::Turned(TurnedBase {
            times: Series::new(&[0.5, 1.5, 1.5, 3.5]).expect("they are few"),
            accelerations: Series::new(&[0.2, 0.2, -0.1, -0.1]).expect("they are few"),
            locked: false,
        });
        base.validate().expect("it comes to rest");
        let handling = LegHandling {
            base: Some(base),
            unload: None,
        };
        let handling = handling.planned([0.0; 2]).expect("the base turns");
        let (mut rate, mut angle) = (0.0, 0.0);
        let h = 1e-3;
        for i in 0..4000 {
            let time = f64::from(i) * h;
            let (seen, turning, _) = handling.motion(time).at(time);
            assert!(
                (seen - angle).abs() < 1e-9 && (turning - rate).abs() < 1e-9,
                "{time}"
            );
            let (_, _, accel) = handling.motion(time).at(time + h / 2.0);
            angle += h * (rate + 0.5 * h * accel);
            rate += h * accel;
        }
        assert!((angle - base.angle()).abs() < 1e-9);
    }
}
