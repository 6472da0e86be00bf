//! Forms of values: how each is written as text and as JSON, and which values are refused.

use serde_json::{Value, json};
use std::fmt::Display;
use std::marker::PhantomData;
use std::ops::Range;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

use crate::film::{Exposure, ExrCompression, LayerFormat, Look, PngBits, View};
use crate::render::Settings;
use crate::scene::{Distortion, Intrinsics};
use glam::{Vec2, Vec3};

/// The form of a value.
pub trait Form {
    /// The value.
    type Value: Clone + PartialEq + std::fmt::Debug;

    /// Reads it from text.
    ///
    /// # Errors
    /// How to write it.
    fn read(text: &str) -> Result<Self::Value, String>;

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

/// A text of any kind.
#[derive(Debug)]
pub struct Text;

impl Form for Text {
    type Value = String;

    fn read(text: &str) -> Result<String, String> {
        Ok(text.to_owned())
    }

    fn text(value: &String) -> String {
        value.clone()
    }

    fn schema() -> Value {
        json!({ "type": ["string", "number", "array"] })
    }
}

/// The path of a file.
#[derive(Debug)]
pub struct File;

impl Form for File {
    type Value = PathBuf;

    fn read(text: &str) -> Result<PathBuf, String> {
        Ok(text.into())
    }

    fn text(value: &PathBuf) -> String {
        value.to_string_lossy().into_owned()
    }
}

/// What its type reads and writes itself.
#[derive(Debug)]
pub struct Own<T>(PhantomData<T>);

impl<T: FromStr<Err: Display> + Display + Clone + PartialEq + std::fmt::Debug> Form for Own<T> {
    type Value = T;

    fn read(text: &str) -> Result<T, String> {
        text.parse().map_err(|error: T::Err| error.to_string())
    }

    fn text(value: &T) -> String {
        value.to_string()
    }

    fn schema() -> Value {
        json!({ "type": ["string", "array"], "items": { "type": ["string", "number"] } })
    }
}

/// A whole number from `LEAST` to `MOST`.
#[derive(Debug)]
pub struct Count<const LEAST: u32, const MOST: u32>;

impl<const LEAST: u32, const MOST: u32> Form for Count<LEAST, MOST> {
    type Value = u32;

    fn read(text: &str) -> Result<u32, String> {
        let number = text.trim().parse::<i64>().map_err(|_| format!("{text:?} is not a whole number"))?;
        let number = u32::try_from(number).ok().filter(|number| (LEAST..=MOST).contains(number));
        number.ok_or_else(|| format!("write a whole number from {LEAST} to {MOST}"))
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

/// `WxH`, both at least 1 and at most 2²⁸ pixels together; as JSON also two numbers.
#[derive(Debug)]
pub struct Size;

impl Form for Size {
    type Value = (u32, u32);

    fn read(text: &str) -> Result<(u32, u32), String> {
        let (w, h) = text.split_once(['x', 'X', ',']).ok_or("write WIDTHxHEIGHT, as in 960x540")?;
        let number = |s: &str| s.trim().parse::<u32>().map_err(|e| format!("{s:?}: {e}"));
        let (w, h) = (number(w)?, number(h)?);
        if w == 0 || h == 0 || u64::from(w) * u64::from(h) > 1 << 28 {
            return Err(
                "width and height must be at least 1, and the picture at most 268435456 pixels".into()
            );
        }
        Ok((w, h))
    }

    fn text(&(w, h): &(u32, u32)) -> String {
        format!("{w}x{h}")
    }

    fn schema() -> Value {
        json!({ "anyOf": [
            { "type": "string", "pattern": "^[0-9]+[xX][0-9]+$" },
            { "type": "array", "items": { "type": "integer", "minimum": 1 }, "minItems": 2, "maxItems": 2 }
        ] })
    }
}

/// `X,Y,Z`, all finite.
#[derive(Debug)]
pub struct Vector;

impl Form for Vector {
    type Value = Vec3;

    fn read(text: &str) -> Result<Vec3, String> {
        let parts: Vec<f32> = text
            .split(',')
            .map(|s| s.trim().parse::<f32>().map_err(|e| format!("{s:?}: {e}")))
            .collect::<Result<_, _>>()?;
        match parts[..] {
            [x, y, z] if parts.iter().all(|p| p.is_finite()) => Ok(Vec3::new(x, y, z)),
            _ => Err("write three finite numbers, as in 1,-2.5,3".into()),
        }
    }

    fn text(value: &Vec3) -> String {
        joined(value.to_array())
    }

    fn json(value: &Vec3) -> Value {
        value.to_array().into_iter().map(number).collect()
    }

    fn schema() -> Value {
        numbers_schema(3, 3)
    }
}

/// Finite numbers with commas between them.
fn numbers(text: &str) -> Result<Vec<f64>, String> {
    let number = |s: &str| s.trim().parse::<f64>().map_err(|e| format!("{s:?}: {e}"));
    let numbers: Vec<f64> = text.split(',').map(number).collect::<Result<_, _>>()?;
    if numbers.iter().all(|n| n.is_finite()) { Ok(numbers) } else { Err("numbers must be finite".into()) }
}

/// `X,Y`.
#[derive(Debug)]
pub struct Shift;

impl Form for Shift {
    type Value = Vec2;

    fn read(text: &str) -> Result<Vec2, String> {
        match numbers(text)?[..] {
            [x, y] => Ok(Vec2::new(x as f32, y as f32)),
            _ => Err("write two numbers X,Y, as in 0,0.25".into()),
        }
    }

    fn text(value: &Vec2) -> String {
        joined(value.to_array())
    }

    fn json(value: &Vec2) -> Value {
        value.to_array().into_iter().map(number).collect()
    }

    fn schema() -> Value {
        numbers_schema(2, 2)
    }
}

/// `FX,FY,CX,CY`.
#[derive(Debug)]
pub struct Calibration;

impl Form for Calibration {
    type Value = Intrinsics;

    fn read(text: &str) -> Result<Intrinsics, String> {
        match numbers(text)?[..] {
            [fx, fy, cx, cy] => Ok(Intrinsics::new(fx, fy, cx, cy)),
            _ => Err("write four numbers FX,FY,CX,CY in pixels, as in 610,608.5,322.4,241".into()),
        }
    }

    fn text(k: &Intrinsics) -> String {
        joined([k.fx, k.fy, k.cx, k.cy])
    }

    fn json(k: &Intrinsics) -> Value {
        [k.fx, k.fy, k.cx, k.cy].into_iter().map(number).collect()
    }

    fn schema() -> Value {
        numbers_schema(4, 4)
    }
}

/// `K1,K2,P1,P2[,K3[,K4,K5,K6[,S1,S2,S3,S4]]]`.
#[derive(Debug)]
pub struct BrownConrady;

impl Form for BrownConrady {
    type Value = Distortion;

    fn read(text: &str) -> Result<Distortion, String> {
        let numbers = numbers(text)?;
        Distortion::brown_conrady(&numbers)
            .ok_or_else(|| format!("{} numbers; write 4, 5, 8 or 12, in OpenCV's order", numbers.len()))
    }

    fn text(value: &Distortion) -> String {
        joined(coefficients(value))
    }

    fn json(value: &Distortion) -> Value {
        coefficients(value).into_iter().map(number).collect()
    }

    fn schema() -> Value {
        numbers_schema(4, 12)
    }
}

/// The coefficients of a distortion in OpenCV's order.
fn coefficients(distortion: &Distortion) -> Vec<f64> {
    match *distortion {
        Distortion::BrownConrady { k: [k1, k2, k3, k4, k5, k6], p: [p1, p2], s: [s1, s2, s3, s4] } => {
            vec![k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4]
        }
        Distortion::Fisheye { k } => k.to_vec(),
        _ => Vec::new(),
    }
}

/// `K1,K2,K3,K4`.
#[derive(Debug)]
pub struct Fisheye;

impl Form for Fisheye {
    type Value = Distortion;

    fn read(text: &str) -> Result<Distortion, String> {
        let k = numbers(text)?.try_into().map_err(|_| "write four numbers K1,K2,K3,K4")?;
        Ok(Distortion::Fisheye { k })
    }

    fn text(value: &Distortion) -> String {
        joined(coefficients(value))
    }

    fn json(value: &Distortion) -> Value {
        coefficients(value).into_iter().map(number).collect()
    }

    fn schema() -> Value {
        numbers_schema(4, 4)
    }
}

/// `A..B`, not empty; `help` says how to write it.
fn range(text: &str, help: &str) -> Result<Range<u32>, String> {
    let (a, b) = text.split_once("..").ok_or(help)?;
    let number = |s: &str| s.trim().parse::<u32>().map_err(|e| format!("{s:?}: {e}"));
    let range = number(a)?..number(b)?;
    if range.is_empty() {
        return Err(format!("the range is empty; its end is not rendered: {help}"));
    }
    Ok(range)
}

/// Ranges with the same text.
macro_rules! ranges {
    ($( $(#[$meta:meta])+ $form:ident: $help:literal; )*) => {
        $(
            $(#[$meta])+
            #[derive(Debug)]
            pub struct $form;

            impl Form for $form {
                type Value = Range<u32>;

                fn read(text: &str) -> Result<Range<u32>, String> {
                    range(text, $help)
                }

                fn text(value: &Range<u32>) -> String {
                    format!("{}..{}", value.start, value.end)
                }

                fn schema() -> Value {
                    json!({ "type": "string", "pattern": r"^[0-9]+\.\.[0-9]+$" })
                }
            }
        )*
    };
}

ranges! {
    /// `A..B`, at least one frame.
    Frames: "write FIRST..END, as in 0..20 for frames 0 to 19";
    /// `A..B`, at least one sample.
    SampleRange: "write FIRST..END, as in 0..16 for samples 0 to 15";
}

/// Stops, or `auto`.
#[derive(Debug)]
pub struct Stops;

impl Form for Stops {
    type Value = Exposure;

    fn read(text: &str) -> Result<Exposure, String> {
        if text == "auto" {
            return Ok(Exposure::Auto);
        }
        match text.parse::<f32>() {
            Ok(stops) if stops.abs() <= 126.0 => Ok(Exposure::Stops(stops)),
            _ => Err("write a number of stops from -126 to 126, as in 1.5, or auto".into()),
        }
    }

    fn text(value: &Exposure) -> String {
        match value {
            Exposure::Stops(stops) => stops.to_string(),
            _ => "auto".into(),
        }
    }

    fn json(value: &Exposure) -> Value {
        match value {
            Exposure::Stops(stops) => number(stops),
            _ => "auto".into(),
        }
    }

    fn schema() -> Value {
        number_schema()
    }
}

/// Values that have names.
macro_rules! names {
    ($( $(#[$meta:meta])+ $form:ident: $type:ty; )*) => {
        $(
            $(#[$meta])+
            #[derive(Debug)]
            pub struct $form;

            impl Form for $form {
                type Value = $type;

                fn read(text: &str) -> Result<$type, String> {
                    let named = <$type>::ALL.into_iter().find(|value| value.name() == text);
                    named.ok_or_else(|| format!("ask for one of {}", Self::choices().join(", ")))
                }

                fn text(value: &$type) -> String {
                    value.name().to_owned()
                }

                fn schema() -> Value {
                    json!({ "enum": Self::choices() })
                }

                fn choices() -> Vec<&'static str> {
                    <$type>::ALL.into_iter().map(|value| value.name()).collect()
                }
            }
        )*
    };
}

names! {
    /// A view transform.
    ViewName: View;
    /// A lossless compression of EXR files.
    Compression: ExrCompression;
    /// A format of layers' files.
    LayerFormatName: LayerFormat;
}

/// 8 or 16.
#[derive(Debug)]
pub struct Bits;

impl Form for Bits {
    type Value = PngBits;

    fn read(text: &str) -> Result<PngBits, String> {
        match text {
            "8" => Ok(PngBits::Eight),
            "16" => Ok(PngBits::Sixteen),
            _ => Err("a channel of a .png has 8 or 16 bits".into()),
        }
    }

    fn text(value: &PngBits) -> String {
        match value {
            PngBits::Eight => "8".into(),
            PngBits::Sixteen => "16".into(),
        }
    }

    fn json(value: &PngBits) -> Value {
        number(Self::text(value))
    }

    fn schema() -> Value {
        json!({ "enum": [8, 16, "8", "16"] })
    }
}
