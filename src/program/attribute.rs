//! Vertex attributes that shaders read: the members of `var<private> attributes: Attributes`.

use super::source::Fault;
use crate::scene::AttributeRequest;
use naga::{Module, Scalar, Span, Type, TypeInner};

/// The type and the variable of vertex attributes.
pub(super) const STRUCT: &str = "Attributes";
pub(super) const VARIABLE: &str = "attributes";

/// The number of the first input that is a scalar of an attribute. No function has so many scalars as arguments.
pub(super) const FIRST_INPUT: u32 = 1 << 16;

/// The attributes that a type of this name stands for.
///
/// # Errors
/// When a member is neither a number nor a vector of numbers.
pub(super) fn requests(module: &Module, ty: &Type) -> Result<Vec<AttributeRequest>, Fault> {
    let TypeInner::Struct { members, .. } = &ty.inner else {
        return Err(Fault::new(Span::UNDEFINED, format!("`{STRUCT}` is no struct"), example()));
    };
    let mut requests = Vec::new();
    for member in members {
        let name = member.name.clone().unwrap_or_default();
        let width = match module.types[member.ty].inner {
            TypeInner::Scalar(Scalar::F32) => 1,
            TypeInner::Vector { size, scalar: Scalar::F32 } => size as u32,
            _ => {
                let message =
                    format!("the vertex attribute `{name}` has another type than f32, vec2f, vec3f or vec4f");
                return Err(Fault::new(Span::UNDEFINED, message, example()));
            }
        };
        requests.push(AttributeRequest { name, width });
    }
    Ok(requests)
}

/// The attributes of a module's variable of this name: none if it has no such variable.
pub(super) fn of_module(module: &Module) -> Vec<AttributeRequest> {
    let named =
        module.global_variables.iter().find(|(_, variable)| variable.name.as_deref() == Some(VARIABLE));
    let ty = named.map(|(_, variable)| &module.types[variable.ty]);
    let ty = ty.filter(|ty| ty.name.as_deref() == Some(STRUCT));
    ty.and_then(|ty| requests(module, ty).ok()).unwrap_or_default()
}

fn example() -> &'static str {
    "write `struct Attributes { wetness: f32, flow: vec2f }` and `var<private> attributes: Attributes;`"
}
