//! Forms of values: how each is written as text and as JSON, and which values are refused.

mod name;
mod number;
mod range;
mod text;
mod vector;

pub use name::{Bits, Compression, DenoiserName, LayerFormatName, Stops, ViewName};
pub use number::{Angle, Count, Error, Kelvin, Plain, Positive, Rate, Samples, Seconds, Seed, Span, Time};
pub use range::{Frames, SampleRange};
pub use text::{File, Own, Text};
pub use vector::{BrownConrady, Calibration, Fisheye, Shift, Size, Vector};

use serde_json::{Value, json};
use std::fmt::Display;

/// The form of a value.
pub trait Form {
    /// The value.
    type Value: Clone + PartialEq + std::fmt::Debug;

    /// Reads it from text.
    ///
    /// # Errors
    /// How to write it.
    fn read(text: &str) -> Result<Self::Value, String>;

    /// Reads it from JSON.
    ///
    /// # Errors
    /// How to write it.
    fn read_json(value: &Value) -> Result<Self::Value, String> {
        Self::read(&super::option::text(value)?)
    }

    /// Writes it as text, which [`Form::read`] reads as the same value.
    fn text(value: &Self::Value) -> String;

    /// Writes it as JSON.
    fn json(value: &Self::Value) -> Value {
        Self::text(value).into()
    }

    /// The JSON schema of what is read.
    fn schema() -> Value {
        json!({ "type": "string" })
    }

    /// The value that the option's name alone stands for on a command line, as text, if it may stand alone.
    const ALONE: Option<&'static str> = None;

    /// The only values, where these are names.
    fn choices() -> Vec<&'static str> {
        Vec::new()
    }
}

/// A number as JSON has it, without the digits that a conversion to more bits adds.
fn number(value: impl Display) -> Value {
    let text = value.to_string();
    text.parse::<u64>()
        .map(Value::from)
        .or_else(|_| text.parse::<f64>().map(Value::from))
        .unwrap_or(text.into())
}

fn number_schema() -> Value {
    json!({ "type": ["number", "string"] })
}

/// The schema of several numbers: a list, or a text with commas between them.
fn numbers_schema(least: usize, most: usize) -> Value {
    json!({ "anyOf": [
        { "type": "array", "items": { "type": "number" }, "minItems": least, "maxItems": most },
        { "type": "string" }
    ] })
}

/// The text of numbers with commas between them.
fn joined<T: Display>(numbers: impl IntoIterator<Item = T>) -> String {
    numbers.into_iter().map(|number| number.to_string()).collect::<Vec<_>>().join(",")
}
