//! Numbers: counts, seeds, angles, seconds.

use super::{Form, number, number_schema};
use crate::film::Look;
use crate::render::Settings;
use serde_json::{Value, json};
use std::time::Duration;

/// A whole number from `LEAST` to `MOST`.
#[derive(Debug)]
pub struct Count<const LEAST: u32, const MOST: u32>;

impl<const LEAST: u32, const MOST: u32> Form for Count<LEAST, MOST> {
    type Value = u32;

    fn read(text: &str) -> Result<u32, String> {
        let number = text.trim().parse::<i64>().map_err(|_| format!("{text:?} is not a whole number"))?;
        let number = u32::try_from(number).ok().filter(|number| (LEAST..=MOST).contains(number));
        number.ok_or_else(|| format!("{text} is not in {LEAST}..={MOST}"))
    }

    fn text(value: &u32) -> String {
        value.to_string()
    }

    fn json(value: &u32) -> Value {
        number(value)
    }

    fn schema() -> Value {
        json!({ "anyOf": [{ "type": "integer", "minimum": LEAST, "maximum": MOST }, { "type": "string" }] })
    }
}

/// Samples of a pixel.
pub type Samples = Count<1, { Settings::MAX_SPP }>;

/// A seed of random numbers.
#[derive(Debug)]
pub struct Seed;

impl Form for Seed {
    type Value = u64;

    fn read(text: &str) -> Result<u64, String> {
        text.trim().parse().map_err(|_| "write a whole number of at most 64 bits".into())
    }

    fn text(value: &u64) -> String {
        value.to_string()
    }

    fn json(value: &u64) -> Value {
        (*value).into()
    }

    fn schema() -> Value {
        json!({ "anyOf": [{ "type": "integer", "minimum": 0 }, { "type": "string" }] })
    }
}

/// Any number; what it means decides later which are refused.
#[derive(Debug)]
pub struct Plain;

impl Form for Plain {
    type Value = f32;

    fn read(text: &str) -> Result<f32, String> {
        text.trim().parse().map_err(|error| format!("{text:?}: {error}"))
    }

    fn text(value: &f32) -> String {
        value.to_string()
    }

    fn json(value: &f32) -> Value {
        number(value)
    }

    fn schema() -> Value {
        number_schema()
    }
}

/// Numbers of a condition, as `impl` blocks with the same text and JSON.
macro_rules! numbers {
    ($( $(#[$meta:meta])+ $form:ident: $type:ty = $text:ident => $read:expr; )*) => {
        $(
            $(#[$meta])+
            #[derive(Debug)]
            pub struct $form;

            impl Form for $form {
                type Value = $type;

                fn read($text: &str) -> Result<$type, String> {
                    $read
                }

                fn text(value: &$type) -> String {
                    value.to_string()
                }

                fn json(value: &$type) -> Value {
                    number(value)
                }

                fn schema() -> Value {
                    number_schema()
                }
            }
        )*
    };
}

numbers! {
    /// A finite angle in degrees.
    Angle: f32 = text => match text.trim().parse::<f32>() {
        Ok(degrees) if degrees.is_finite() => Ok(degrees),
        _ => Err("write a finite angle in degrees, as in 90".into()),
    };
    /// A positive, finite number.
    Positive: f32 = text => {
        let limit = text.trim().parse::<f32>().ok().filter(|limit| *limit > 0.0 && limit.is_finite());
        limit.ok_or_else(|| "write a number above 0, as in 10".into())
    };
    /// A relative error.
    Error: f32 = text => match text.trim().parse::<f32>() {
        Ok(x) if x > 0.0 && x <= 1.0 => Ok(x),
        _ => Err("write a relative error between 0 and 1, as in 0.05 for 5 %".into()),
    };
    /// Frames per second.
    Rate: f64 = text => match text.trim().parse::<f64>() {
        Ok(fps) if fps.is_normal() && fps > 0.0 => Ok(fps),
        _ => Err("write a positive number of frames per second, as in 24 or 29.97".into()),
    };
    /// A time of an animation in seconds.
    Time: f64 = text => match text.trim().parse::<f64>() {
        Ok(seconds) if seconds.is_finite() => Ok(seconds),
        _ => Err("write a finite number of seconds, as in 1.5".into()),
    };
    /// A span of an animation's time in seconds.
    Span: f64 = text => match text.trim().parse::<f64>() {
        Ok(seconds) if seconds.is_finite() && seconds > 0.0 => Ok(seconds),
        _ => Err("write a number of seconds above 0, as in 0.02".into()),
    };
    /// A colour temperature in kelvin.
    Kelvin: f32 = text => {
        let (least, greatest) = (Look::KELVINS.start(), Look::KELVINS.end());
        let kelvin = text.trim().parse::<f32>().ok().filter(|kelvin| Look::KELVINS.contains(kelvin));
        kelvin.ok_or_else(|| format!("write a colour temperature from {least} to {greatest} kelvin"))
    };
}

/// A positive number of seconds.
#[derive(Debug)]
pub struct Seconds;

impl Form for Seconds {
    type Value = Duration;

    fn read(text: &str) -> Result<Duration, String> {
        let seconds = text.trim().parse::<f64>().map_err(|e| format!("{text:?}: {e}"))?;
        let duration =
            Duration::try_from_secs_f64(seconds).map_err(|_| "write a positive number of seconds")?;
        if duration.is_zero() { Err("write a positive number of seconds".into()) } else { Ok(duration) }
    }

    fn text(value: &Duration) -> String {
        value.as_secs_f64().to_string()
    }

    fn json(value: &Duration) -> Value {
        number(value.as_secs_f64())
    }

    fn schema() -> Value {
        number_schema()
    }
}
