//! Common part of all kinds of shaders: a file, its parameters, and a hash.

use super::attribute;
#[cfg(feature = "gpu")]
use super::code::Code;
use super::finish_call::FinishPlace;
use super::kernel::Signature;
#[cfg(feature = "gpu")]
use super::lower::lower_fork;
use super::lower::{Base, Input, Lowered, lower, lower_chain};
use super::parameter::{Parameter, parameters, words};
use super::prelude::prelude;
use super::source::{Fault, ShaderError, Source};
use super::token::{Declaration, declarations, tokens};
use crate::scene::{AttributeRequest, BoundTexture};
use naga::{Block, Expression, Function, Handle, Literal, Span, Statement};
use std::collections::BTreeMap;
use std::sync::Arc;
use xxhash_rust::xxh3::xxh3_64;

/// The function by which other renderers displace surfaces.
const DISPLACE: &str = "displace";

/// Finds the picture that a value names; the error is a part of a sentence.
pub(super) type FindPicture<'f> = dyn FnMut(&str) -> Result<BoundTexture, String> + 'f;

/// A valid file with values of its parameters.
#[derive(Debug)]
pub(super) struct Loaded {
    pub source: Source,
    pub parameters: Vec<Parameter>,
    pub overrides: BTreeMap<String, u32>,
    /// True if functions of the prelude become native.
    natives: bool,
    /// The pictures that are bound, in the order of the file.
    pictures: Arc<[BoundTexture]>,
}

impl Loaded {
    /// Parses a file's text and sets parameters.
    ///
    /// # Errors
    /// When the text is no valid WGSL, or a parameter is unknown or has no valid value.
    pub fn new<'a>(
        file: &str,
        text: &str,
        values: impl IntoIterator<Item = (&'a str, &'a str)>,
        natives: bool,
    ) -> Result<Self, ShaderError> {
        Self::before(&prelude(), file, text, values, natives)
    }

    /// [`Loaded::new`] with another prelude.
    pub fn before<'a>(
        prelude: &str,
        file: &str,
        text: &str,
        values: impl IntoIterator<Item = (&'a str, &'a str)>,
        natives: bool,
    ) -> Result<Self, ShaderError> {
        let source = Source::parse(file, text, prelude)?;
        let parameters = parameters(&source);
        let overrides = words(&parameters, values).map_err(|fault| source.error(&fault))?;
        Ok(Self { source, parameters, overrides, natives, pictures: Arc::default() })
    }

    /// The same with the pictures that values name.
    ///
    /// # Errors
    /// When a picture has no value, or none can be found for it.
    pub fn with_pictures(
        mut self,
        values: &[(&str, &str)],
        find: &mut FindPicture<'_>,
    ) -> Result<Self, ShaderError> {
        let mut pictures = Vec::new();
        for parameter in self.parameters.iter().filter(|parameter| parameter.is_picture()) {
            let value = values.iter().rev().find(|(name, _)| *name == parameter.name);
            let Some((name, value)) = value else { return Err(self.error(&unbound(parameter))) };
            pictures.push(find(value).map_err(|reason| {
                let message = format!("the picture `{name}` is {value:?}: {reason}");
                self.error(&Fault::new(parameter.span, message, bindings(name)))
            })?);
        }
        self.pictures = pictures.into();
        Ok(self)
    }

    /// The vertex attributes of the file, in its order.
    pub fn attributes(&self) -> Vec<AttributeRequest> {
        attribute::of_module(&self.source.module)
    }

    /// The pictures, in the order of the file.
    ///
    /// # Errors
    /// When one is not bound.
    pub fn pictures(&self) -> Result<Arc<[BoundTexture]>, ShaderError> {
        let mut all = self.parameters.iter().filter(|parameter| parameter.is_picture());
        match all.nth(self.pictures.len()) {
            Some(parameter) => Err(self.error(&unbound(parameter))),
            None => Ok(Arc::clone(&self.pictures)),
        }
    }

    /// Parses a file's text. Parameters without a default count as 1.
    ///
    /// # Errors
    /// When the text is no valid WGSL.
    pub fn with_ones(file: &str, text: &str) -> Result<Self, ShaderError> {
        Ok(Self::new(file, text, [], true)?.ones())
    }

    /// Sets parameters without a default to 1, pictures to white.
    pub fn ones(mut self) -> Self {
        let pictures = self.parameters.iter().filter(|parameter| parameter.is_picture());
        self.pictures = pictures.map(|_| BoundTexture::white()).collect();
        let needed =
            self.parameters.iter().filter(|parameter| !parameter.has_default && !parameter.is_picture());
        let one = |kind: &str| match kind {
            "f32" => 1.0f32.to_bits(),
            "bool" => u32::MAX,
            _ => 1,
        };
        let ones = needed.map(|parameter| (parameter.name.clone(), one(parameter.kind))).collect();
        self.overrides = ones;
        self
    }

    /// Lowers a function, in which `base` has a meaning.
    ///
    /// # Errors
    /// When there is no such function, or it uses what shaders lack.
    pub fn lower(&self, signature: &Signature, base: Base<'_>) -> Result<Lowered, ShaderError> {
        let function = signature.find(&self.source).map_err(|fault| self.error(&fault))?;
        let span = self.source.module.functions.get_span(function);
        let input = Input { base, ..self.input() };
        lower(input, function).map_err(|fault| self.error(&fault.at(span)))
    }

    /// Lowers a function and one that is called with its result and more arguments, in a BSDF of this place.
    ///
    /// # Errors
    /// When there is no such function, or one uses what shaders lack.
    pub fn chain(
        &self,
        [first, second]: [&Signature; 2],
        base: Base<'_>,
        place: FinishPlace,
    ) -> Result<Lowered, ShaderError> {
        let find = |signature: &Signature| signature.find(&self.source);
        let input = Input { base, finishes: Some(place), ..self.input() };
        let lowered = find(first).and_then(|first| lower_chain(input, &[first, find(second)?]));
        lowered.map_err(|fault| self.error(&fault))
    }

    /// Lowers a function and two that are called with its result and more arguments. They share the first of these.
    ///
    /// # Errors
    /// When there is no such function, or one uses what shaders lack.
    #[cfg(feature = "gpu")]
    pub fn fork(
        &self,
        first: &Signature,
        [second, third]: [&Signature; 2],
        place: FinishPlace,
    ) -> Result<Code, ShaderError> {
        let find = |signature: &Signature| signature.find(&self.source);
        let input = Input { base: Base::Unknown, finishes: Some(place), ..self.input() };
        let code = find(first).and_then(|first| lower_fork(input, first, [find(second)?, find(third)?], 2));
        code.map_err(|fault| self.error(&fault))
    }

    fn input(&self) -> Input<'_> {
        let Source { module, info, text } = &self.source;
        let (overrides, natives) = (&self.overrides, self.natives);
        Input { module, info, overrides, natives, text, host: None, base: Base::Refused, finishes: None }
    }

    /// The index of refraction of `const ior`.
    ///
    /// # Errors
    /// When it is no number of at least 1.
    pub fn ior(&self) -> Result<Option<f32>, Fault> {
        match self.constant("ior") {
            None => Ok(None),
            Some((ior, _)) if ior >= 1.0 && ior.is_finite() => Ok(Some(ior)),
            Some((ior, span)) => {
                let message = format!("`ior` is {}", shown(ior));
                Err(Fault::new(span, message, "write a number of at least 1"))
            }
        }
    }

    /// True if the file has a function of this name.
    pub fn has(&self, function: &str) -> bool {
        self.source.module.functions.iter().any(|(_, other)| other.name.as_deref() == Some(function))
    }

    /// Refuses a function `displace` that no other one calls: it would be ignored.
    ///
    /// # Errors
    /// When there is one.
    pub fn refuse_displacement(&self) -> Result<(), ShaderError> {
        let module = &self.source.module;
        let named = |(_, function): &(_, &naga::Function)| function.name.as_deref() == Some(DISPLACE);
        let Some((handle, _)) = module.functions.iter().find(named) else { return Ok(()) };
        if module.functions.iter().any(|(_, function)| calls(&function.body, handle)) {
            return Ok(());
        }
        Err(self.error(&Fault::new(
            module.functions.get_span(handle),
            "surfaces cannot be displaced: shaders run where a ray has hit",
            "bend the normals: `finish.normal = bump(at.normal, slopes)`",
        )))
    }

    pub fn error(&self, fault: &Fault) -> ShaderError {
        self.source.error(fault)
    }

    /// Hash of the source, the prelude, the parameters and the pictures.
    pub fn hash(&self) -> u64 {
        let mut all = format!("{}\0{:?}", self.source.text.parsed(), self.overrides);
        self.pictures.iter().for_each(|picture| all += &format!("\0{:016x}", picture.hash()));
        xxh3_64(all.as_bytes())
    }

    /// A number or a truth value (1 or 0) that the file defines as a constant, and where.
    pub fn constant(&self, name: &str) -> Option<(f32, Span)> {
        let module = &self.source.module;
        let named = module.constants.iter().find(|(_, constant)| constant.name.as_deref() == Some(name));
        let Some((handle, constant)) = named else {
            // A constant that the lowerer computes has become a variable.
            let variable = module.global_variables.iter().find(|(_, one)| one.name.as_deref() == Some(name));
            let computed = variable.map(|(handle, _)| (f32::NAN, module.global_variables.get_span(handle)));
            return computed.or_else(|| untyped_constant(self.source.text.translated(), name));
        };
        let number = match module.global_expressions[constant.init] {
            Expression::Literal(Literal::F32(x)) => x,
            Expression::Literal(Literal::AbstractFloat(x)) => x as f32,
            Expression::Literal(Literal::I32(x)) => x as f32,
            Expression::Literal(Literal::U32(x)) => x as f32,
            Expression::Literal(Literal::AbstractInt(x)) => x as f32,
            Expression::Literal(Literal::Bool(truth)) => f32::from(truth),
            _ => f32::NAN,
        };
        Some((number, module.constants.get_span(handle)))
    }
}

/// A constant in a message.
pub(super) fn shown(constant: f32) -> String {
    if constant.is_nan() { "no number, but an expression".into() } else { constant.to_string() }
}

/// The two things that a picture may be bound to.
fn bindings(name: &str) -> String {
    format!("bind a file, `{name}=FILE.png`, or a texture of the material, `{name}=base-colour`")
}

/// The fault of a picture that is not bound.
fn unbound(parameter: &Parameter) -> Fault {
    let name = &parameter.name;
    Fault::new(parameter.span, format!("the picture `{name}` is not bound"), bindings(name))
}

/// True if statements call a function.
fn calls(block: &Block, wanted: Handle<Function>) -> bool {
    block.iter().any(|statement| match statement {
        Statement::Call { function, .. } => *function == wanted,
        Statement::Block(block) => calls(block, wanted),
        Statement::If { accept, reject, .. } => calls(accept, wanted) || calls(reject, wanted),
        Statement::Switch { cases, .. } => cases.iter().any(|case| calls(&case.body, wanted)),
        Statement::Loop { body, continuing, .. } => calls(body, wanted) || calls(continuing, wanted),
        _ => false,
    })
}

/// A number that a text defines as a constant without a type: naga's module has no constants of abstract types. What is
/// more than a literal is not a number.
fn untyped_constant(text: &str, name: &str) -> Option<(f32, Span)> {
    let tokens = tokens(text);
    let is_named = |one: &Declaration<'_>| {
        one.keyword == "const"
            && one.name.is_some_and(|at| tokens[at].text == name && tokens[at + 1].text == "=")
    };
    let found = declarations(&tokens).into_iter().find(is_named)?;
    let at = tokens[found.name?].range();
    let value = text[at.end..].trim_start().strip_prefix('=').and_then(|rest| rest.split(';').next())?;
    Some((value.trim().parse().unwrap_or(f32::NAN), Span::new(at.start as u32, at.end as u32)))
}
