//! Parameters of shaders: `override`s, the members of `var<private> params: Params`, and pictures.

use super::source::{Fault, Source};
use super::translation::UNFOLDED;
use naga::{
    AddressSpace, GlobalVariable, ImageClass, ImageDimension, Module, Scalar, ScalarKind, Span, TypeInner,
};
use std::collections::BTreeMap;

/// The type and the variable of parameters of more than one number.
pub(super) const STRUCT: &str = "Params";
pub(super) const VARIABLE: &str = "params";

/// The type of a picture.
pub(super) const PICTURE: &str = "texture_2d<f32>";

/// A parameter of a shader: an `override` of its file, a member of `struct Params` in `var<private> params: Params`, or
/// a picture, `var name: texture_2d<f32>`.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Parameter {
    /// Name.
    pub name: String,
    /// `f32`, `i32`, `u32`, `bool`, `vec2f`, `vec3f`, `vec4f`, or `texture_2d<f32>`.
    pub kind: &'static str,
    /// True if it has a default, so that it need not be set.
    pub has_default: bool,
    /// Place of its definition.
    pub(super) span: Span,
}

impl Parameter {
    /// True if it is a picture.
    pub fn is_picture(&self) -> bool {
        self.kind == PICTURE
    }
}

/// True if a variable of a module is a picture.
pub(super) fn is_picture(module: &Module, variable: &GlobalVariable) -> bool {
    let class = ImageClass::Sampled { kind: ScalarKind::Float, multi: false };
    let inner = TypeInner::Image { dim: ImageDimension::D2, arrayed: false, class };
    variable.space == AddressSpace::Handle && module.types[variable.ty].inner == inner
}

fn kind(inner: &TypeInner) -> Option<&'static str> {
    Some(match inner {
        TypeInner::Scalar(Scalar { kind: ScalarKind::Float, .. }) => "f32",
        TypeInner::Scalar(Scalar { kind: ScalarKind::Sint, .. }) => "i32",
        TypeInner::Scalar(Scalar { kind: ScalarKind::Uint, .. }) => "u32",
        TypeInner::Scalar(Scalar { kind: ScalarKind::Bool, .. }) => "bool",
        TypeInner::Vector { size, scalar: Scalar { kind: ScalarKind::Float, .. } } => {
            ["vec2f", "vec3f", "vec4f"][*size as usize - 2]
        }
        _ => return None,
    })
}

/// The parameters of a file.
pub(super) fn parameters(source: &Source) -> Vec<Parameter> {
    let module = &source.module;
    let mut all = Vec::new();
    for (handle, parameter) in module.overrides.iter() {
        let (Some(kind), Some(name)) = (kind(&module.types[parameter.ty].inner), parameter.name.clone())
        else {
            continue;
        };
        if name == UNFOLDED {
            continue;
        }
        let name = source.text.own_name(&name).to_owned();
        let (has_default, span) = (parameter.init.is_some(), module.overrides.get_span(handle));
        all.push(Parameter { name, kind, has_default, span });
    }
    for (handle, global) in module.global_variables.iter() {
        if is_picture(module, global) {
            let name = source.text.own_name(global.name.as_deref().unwrap_or_default()).to_owned();
            let span = module.global_variables.get_span(handle);
            all.push(Parameter { name, kind: PICTURE, has_default: false, span });
            continue;
        }
        let ty = &module.types[global.ty];
        let TypeInner::Struct { members, .. } = &ty.inner else { continue };
        if global.name.as_deref() != Some(VARIABLE) || ty.name.as_deref() != Some(STRUCT) {
            continue;
        }
        let span = module.global_variables.get_span(handle);
        for member in members {
            let (Some(kind), Some(name)) = (kind(&module.types[member.ty].inner), member.name.clone()) else {
                continue;
            };
            all.push(Parameter { name, kind, has_default: global.init.is_some(), span });
        }
    }
    all
}

/// The words of parameters that are set: `name` of a number, `name.0`, `name.1`, .. of a vector's numbers. Pictures
/// have none.
///
/// # Errors
/// When there is no such parameter, or its value is none of its kind.
pub(super) fn words<'a>(
    parameters: &[Parameter],
    values: impl IntoIterator<Item = (&'a str, &'a str)>,
) -> Result<BTreeMap<String, u32>, Fault> {
    let mut words = BTreeMap::new();
    for (name, value) in values {
        let Some(parameter) = parameters.iter().find(|parameter| parameter.name == name) else {
            return Err(unknown(parameters, name, value));
        };
        if parameter.is_picture() {
            continue;
        }
        let told = |remedy: &str| {
            Fault::new(
                parameter.span,
                format!("`{name}` is {value:?}, which is no {}", parameter.kind),
                remedy,
            )
        };
        let number = |text: &str| text.trim().parse().ok().filter(|x: &f32| x.is_finite()).map(f32::to_bits);
        if let Some(size) = parameter.kind.strip_prefix("vec") {
            let size = usize::from(size.as_bytes()[0] - b'0');
            let numbers: Option<Vec<u32>> = value.split(',').map(number).collect();
            let Some(numbers) = numbers.filter(|numbers| numbers.len() == size) else {
                return Err(told(&format!("write {size} finite numbers with commas between")));
            };
            let named = numbers.into_iter().enumerate();
            words.extend(named.map(|(i, word)| (format!("{name}.{i}"), word)));
            continue;
        }
        let word = match parameter.kind {
            "f32" => number(value),
            "i32" => value.parse().ok().map(|x: i32| x as u32),
            "u32" => value.parse().ok(),
            _ => value.parse().ok().map(|truth: bool| if truth { u32::MAX } else { 0 }),
        };
        let word = word.ok_or_else(|| told("write a finite number, or true or false for a bool"))?;
        words.insert(name.to_owned(), word);
    }
    Ok(words)
}

fn unknown(parameters: &[Parameter], name: &str, value: &str) -> Fault {
    let names: Vec<&str> = parameters.iter().map(|parameter| parameter.name.as_str()).collect();
    let there = if names.is_empty() { "it has none".into() } else { format!("it has {}", names.join(", ")) };
    Fault::new(
        Span::UNDEFINED,
        format!("the shader has no parameter `{name}`"),
        format!("{there}; `override {name}: f32 = {value};` would make it one"),
    )
}
