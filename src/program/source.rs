//! Shader files: parsing, validation and messages with line and column.

use naga::front::wgsl::Frontend;
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use naga::{Handle, Module, Scalar, ScalarKind, Span, Type, TypeInner};
use std::fmt;

/// The longest shader file in bytes.
pub const MAX_SOURCE_BYTES: usize = 1 << 20;

/// The deepest nesting of parentheses and braces. Parsing takes stack for each level.
const MAX_NESTING: usize = 64;

/// The most operators, dots and brackets of a statement. Each may be a level of its expression's tree.
const MAX_OPERATORS: usize = 512;

/// Fault of a shader, and its place.
#[derive(Clone, Debug)]
pub(super) struct Fault {
    span: Span,
    message: String,
    remedy: String,
}

impl Fault {
    pub fn new(span: Span, message: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { span, message: message.into(), remedy: remedy.into() }
    }

    /// The fault at a place, unless it has a more precise one.
    pub fn at(self, span: Span) -> Self {
        if self.span.is_defined() { self } else { Self { span, ..self } }
    }
}

/// Error of loading a shader. The message names file, line and column, shows the line, and says what to do.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct ShaderError {
    /// The file's name.
    pub file: String,
    /// Line, from 1; 0 if the whole file is meant.
    pub line: u32,
    /// Column in characters, from 1.
    pub column: u32,
    /// The problem.
    pub message: String,
    /// The remedy.
    pub remedy: String,
    /// The line with marks below the place.
    excerpt: String,
}

impl std::error::Error for ShaderError {}

impl fmt::Display for ShaderError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.message)?;
        match self.line {
            0 => write!(f, "\n --> {}", self.file)?,
            line => write!(f, "\n --> {}:{line}:{}\n{}", self.file, self.column, self.excerpt)?,
        }
        match self.remedy.is_empty() {
            true => Ok(()),
            false => write!(f, "\n  = help: {}", self.remedy),
        }
    }
}

/// A parsed and valid shader, followed by the prelude.
#[derive(Debug)]
pub(super) struct Source {
    file: String,
    /// The file's text and the prelude.
    pub text: String,
    /// Bytes of the file's text.
    own: usize,
    pub module: Module,
    pub info: ModuleInfo,
}

impl Source {
    /// The file's text.
    pub fn own(&self) -> &str {
        &self.text[..self.own]
    }

    /// Parses and validates a file's text with the prelude.
    ///
    /// # Errors
    /// When the text is no valid WGSL, or too long or too deeply nested.
    pub fn parse(file: &str, own: &str, prelude: &str) -> Result<Self, ShaderError> {
        let text = format!("{own}\n{prelude}");
        let refused = |fault| Err(error(file, own, &fault));
        if own.len() > MAX_SOURCE_BYTES {
            let message = format!("the shader has {} bytes; at most {MAX_SOURCE_BYTES} are read", own.len());
            return refused(Fault::new(
                Span::UNDEFINED,
                message,
                "split it into shaders of several materials",
            ));
        }
        if let Some(at) = too_deep(own) {
            let message = format!(
                "parentheses are nested more than {MAX_NESTING} deep, or a statement has more than {MAX_OPERATORS} \
                 operators"
            );
            return refused(Fault::new(
                Span::new(at, at + 1),
                message,
                "name parts of the expression with `let`",
            ));
        }
        let module = match Frontend::new().parse(&text) {
            Ok(module) => module,
            Err(found) => {
                let (span, label) = found
                    .labels()
                    .next()
                    .map_or((Span::UNDEFINED, String::new()), |(span, label)| (span, label.to_owned()));
                let notes: Vec<&str> = found.notes().collect();
                let remedy = if notes.is_empty() { label } else { notes.join("; ") };
                return refused(Fault::new(span, found.message(), remedy));
            }
        };
        let flags = ValidationFlags::all();
        let info = match Validator::new(flags, Capabilities::empty()).validate(&module) {
            Ok(info) => info,
            Err(found) => {
                // The narrowest place is the most precise.
                let spans = found.spans().filter_map(|(span, _)| Some((span.to_range()?.len(), *span)));
                let span = spans.min_by_key(|(bytes, _)| *bytes).map_or(Span::UNDEFINED, |(_, span)| span);
                let mut message = found.to_string();
                let mut cause: Option<&dyn std::error::Error> = std::error::Error::source(found.as_inner());
                while let Some(because) = cause {
                    message = format!("{message}: {because}");
                    cause = because.source();
                }
                return refused(Fault::new(span, message, ""));
            }
        };
        Ok(Self { file: file.into(), own: own.len(), text, module, info })
    }

    /// The name of a type as WGSL writes it: of structs their own, of numbers and vectors `f32`, `vec3f`, ..
    pub fn type_name(&self, ty: Handle<Type>) -> String {
        let ty = &self.module.types[ty];
        if let Some(name) = &ty.name {
            return name.clone();
        }
        let letter = |scalar: Scalar| match scalar.kind {
            ScalarKind::Float => "f",
            ScalarKind::Sint => "i",
            ScalarKind::Uint => "u",
            _ => "",
        };
        match ty.inner {
            TypeInner::Scalar(scalar) if scalar.kind == ScalarKind::Bool => "bool".into(),
            TypeInner::Scalar(scalar) => format!("{}32", letter(scalar)),
            TypeInner::Vector { size, scalar } => format!("vec{}{}", size as u8, letter(scalar)),
            _ => "another type".into(),
        }
    }

    /// The error for a fault.
    pub fn error(&self, fault: &Fault) -> ShaderError {
        error(&self.file, self.own(), fault)
    }
}

/// The byte at which nesting becomes too deep, or a statement too long.
fn too_deep(text: &str) -> Option<u32> {
    let (mut depth, mut operators, mut at) = (0usize, 0usize, 0);
    for line in text.split_inclusive('\n') {
        let code = line.split("//").next().unwrap_or_default();
        for (offset, byte) in code.bytes().enumerate() {
            match byte {
                b'(' | b'{' | b'[' => depth += 1,
                b')' | b'}' | b']' => depth = depth.saturating_sub(1),
                _ => {}
            }
            match byte {
                b';' | b'{' | b'}' | b',' => operators = 0,
                _ if b"+-*/%<>=!~&|^.[".contains(&byte) => operators += 1,
                _ => {}
            }
            if depth > MAX_NESTING || operators > MAX_OPERATORS {
                return Some((at + offset) as u32);
            }
        }
        at += line.len();
    }
    None
}

fn error(file: &str, own: &str, fault: &Fault) -> ShaderError {
    let Fault { span, message, remedy } = fault.clone();
    let mut error =
        ShaderError { file: file.into(), line: 0, column: 0, message, remedy, excerpt: String::new() };
    let Some(range) = span.to_range().filter(|range| range.start <= own.len()) else { return error };
    let start = floor_boundary(own, range.start);
    let line_start = own[..start].rfind('\n').map_or(0, |at| at + 1);
    let line_end = own[start..].find('\n').map_or(own.len(), |at| start + at);
    let end = floor_boundary(own, range.end.min(line_end)).max(start);
    let shown = |text: &str| text.replace(|c: char| c.is_control(), " ");
    error.line = own[..start].matches('\n').count() as u32 + 1;
    error.column = own[line_start..start].chars().count() as u32 + 1;
    let number = error.line.to_string();
    let margin = " ".repeat(number.len());
    error.excerpt = format!(
        "{margin} |\n{number} | {}\n{margin} | {}{}",
        shown(&own[line_start..line_end]),
        " ".repeat(own[line_start..start].chars().count()),
        "^".repeat(own[start..end].chars().count().max(1)),
    );
    error
}

/// The greatest character boundary that is not behind a byte.
fn floor_boundary(text: &str, at: usize) -> usize {
    (0..=at.min(text.len())).rev().find(|&at| text.is_char_boundary(at)).unwrap_or(0)
}
