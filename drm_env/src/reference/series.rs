//! A short list of numbers in place, so that what holds it can be copied.

use std::fmt;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Error, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Most entries of a [`Series`].
pub const MOST_ENTRIES: usize = 64;

/// At most [`MOST_ENTRIES`] numbers.
#[derive(Clone, Copy, PartialEq)]
pub struct Series {
    len: u8,
    /// Zero beyond the length.
    values: [f64; MOST_ENTRIES],
}

impl Default for Series {
    /// Empty.
    fn default() -> Self {
        Self {
            len: 0,
            values: [0.0; MOST_ENTRIES],
        }
    }
}

impl fmt::Debug for Series {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.values().fmt(f)
    }
}

impl Series {
    /// Of these numbers; nothing if there are too many.
    pub fn new(values: &[f64]) -> Option<Self> {
        let mut series = Self::default();
        for value in values {
            *series.values.get_mut(usize::from(series.len))? = *value;
            series.len += 1;
        }
        Some(series)
    }

    /// The numbers.
    pub fn values(&self) -> &[f64] {
        &self.values[..usize::from(self.len)]
    }
}

impl Serialize for Series {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.values())
    }
}

impl<'de> Deserialize<'de> for Series {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Numbers;

        impl<'de> Visitor<'de> for Numbers {
            type Value = Series;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "at most {MOST_ENTRIES} numbers")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Series, A::Error> {
                let mut values = Vec::new();
                while let Some(value) = list.next_element()? {
                    if values.len() == MOST_ENTRIES {
                        return Err(A::Error::invalid_length(MOST_ENTRIES + 1, &self));
                    }
                    values.push(value);
                }
                let many = || A::Error::invalid_length(values.len(), &self);
                Series::new(&values).ok_or_else(many)
            }
        }

        deserializer.deserialize_seq(Numbers)
    }
}

impl JsonSchema for Series {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Series".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "type": "array",
            "items": {"type": "number"},
            "maxItems": MOST_ENTRIES,
        })
    }
}
