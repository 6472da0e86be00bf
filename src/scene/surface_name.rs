//! Names of surfaces of user code in scene files.

use super::SurfaceRequest;
use serde::Deserialize;
use serde_json::Value;
use std::collections::BTreeMap;

/// Name by which a scene file asks for a surface of user code.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub enum SurfaceName {
    /// By its name.
    Name(String),
    /// By a shader's file, beside values of its parameters.
    Shader(ShaderName),
}

/// `{ "shader": "wood.wgsl", "rings": 12 }`
#[derive(Clone, Debug, Deserialize)]
pub struct ShaderName {
    /// The file.
    pub shader: String,
    /// Values of its parameters.
    #[serde(flatten)]
    pub values: BTreeMap<String, Value>,
}

impl SurfaceName {
    /// The request of a material for the surface, with options that stand beside it.
    pub(super) fn request(
        &self,
        material: u32,
        options: BTreeMap<String, String>,
    ) -> Result<SurfaceRequest, String> {
        match self {
            Self::Name(surface) => Ok(SurfaceRequest { material, surface: surface.clone(), options }),
            Self::Shader(_) if !options.is_empty() => {
                Err("the shader's parameters stand beside its name, not in options".into())
            }
            Self::Shader(ShaderName { shader, .. }) if !shader.ends_with(".wgsl") => {
                Err(format!("its shader is {shader:?}; name a file that ends in .wgsl"))
            }
            Self::Shader(ShaderName { shader, values }) => {
                Ok(SurfaceRequest { material, surface: shader.clone(), options: option_texts(values)? })
            }
        }
    }
}

/// The texts of options that a scene file writes as JSON: text, numbers and truth values as they are, lists of these
/// with commas between.
pub(super) fn option_texts(options: &BTreeMap<String, Value>) -> Result<BTreeMap<String, String>, String> {
    fn text(value: &Value) -> Option<String> {
        match value {
            Value::String(text) => Some(text.clone()),
            Value::Number(_) | Value::Bool(_) => Some(value.to_string()),
            Value::Array(list) => Some(list.iter().map(text).collect::<Option<Vec<_>>>()?.join(",")),
            Value::Null | Value::Object(_) => None,
        }
    }
    let parsed = options.iter().map(|(key, value)| match text(value) {
        Some(value) => Ok((key.clone(), value)),
        None => {
            Err(format!("option {key:?} is {value}; write text, a number, true, false or a list of these"))
        }
    });
    parsed.collect()
}
