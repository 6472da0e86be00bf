//! Values that have names, or a few choices.

use super::super::Denoiser;
use super::{Form, number, number_schema};
use crate::film::{Exposure, ExrCompression, LayerFormat, PngBits, View};
use serde_json::{Value, json};

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

/// `true`, `false`, or `oidn`.
#[derive(Debug)]
pub struct DenoiserName;

impl Form for DenoiserName {
    type Value = Denoiser;

    const ALONE: Option<&'static str> = Some("true");

    fn read(text: &str) -> Result<Denoiser, String> {
        match text {
            "false" => Ok(Denoiser::None),
            "true" => Ok(Denoiser::Own),
            "oidn" => Ok(Denoiser::Oidn),
            _ => Err("ask for true (raystream's own filter), oidn or false".into()),
        }
    }

    fn read_json(value: &Value) -> Result<Denoiser, String> {
        match value {
            Value::Bool(value) => Self::read(&value.to_string()),
            Value::String(text) => Self::read(text),
            other => Err(format!("is true, false or \"oidn\", not {other}")),
        }
    }

    fn text(value: &Denoiser) -> String {
        match value {
            Denoiser::None => "false".into(),
            Denoiser::Own => "true".into(),
            Denoiser::Oidn => "oidn".into(),
        }
    }

    fn json(value: &Denoiser) -> Value {
        match value {
            Denoiser::None => false.into(),
            Denoiser::Own => true.into(),
            Denoiser::Oidn => "oidn".into(),
        }
    }

    fn schema() -> Value {
        json!({ "enum": [false, true, "false", "true", "oidn"] })
    }
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
