//! A shape and its material.

use super::Shape;
use super::unique::unique;
use serde::de::{Deserialize, Deserializer, Error};
use serde_json::Value;

/// A shape with its material.
#[derive(Clone, Debug)]
pub struct Object {
    /// The shape. Its fields are beside `material` in the JSON object.
    pub shape: Shape,
    /// Name of a material or a mix.
    pub material: String,
}

/// By hand, because serde's flattened fields cannot refuse unknown names.
impl<'de> Deserialize<'de> for Object {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let mut fields = unique::<D, Value>(from)?;
        let material = match fields.remove("material") {
            Some(Value::String(name)) => name,
            Some(other) => return Err(D::Error::custom(format!("the material {other} is not a name"))),
            None => return Err(D::Error::missing_field("material")),
        };
        let shape = Shape::deserialize(Value::Object(fields.into_iter().collect()));
        Ok(Self { shape: shape.map_err(D::Error::custom)?, material })
    }
}
