//! Shader files: parsing, validation and messages with line and column.

use super::diagnosis;
use super::import::Files;
use super::repaired::Repaired;
use super::run::Endless;
use super::translation::Translation;
use naga::front::wgsl::Frontend;
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use naga::{Handle, Module, Span, Type};
use std::fmt;
use std::ops::Range;
use std::sync::Arc;

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

/// Characters of a line that an error shows.
const EXCERPT: usize = 160;

/// Error of a shader. The message names file, line and column, shows the line, and says what to do.
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
    /// Errors of other declarations.
    others: Box<[Self]>,
}

impl ShaderError {
    /// An error of a whole file.
    pub(super) fn of_file(file: &str, message: &str, remedy: &str) -> Self {
        error(file, "", None, &Fault::new(Span::UNDEFINED, message, remedy))
    }

    /// Errors of other declarations of the file.
    pub fn others(&self) -> &[Self] {
        &self.others
    }
}

impl std::error::Error for ShaderError {}

impl fmt::Display for ShaderError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.message)?;
        match self.line {
            0 => write!(f, "\n --> {}", self.file)?,
            line => write!(f, "\n --> {}:{line}:{}\n{}", self.file, self.column, self.excerpt)?,
        }
        if !self.remedy.is_empty() {
            write!(f, "\n  = help: {}", self.remedy)?;
        }
        self.others.iter().try_for_each(|other| write!(f, "\n\n{other}"))
    }
}

/// A file's text with those of the files that it imports, and the text that is parsed: its translation with the prelude
/// behind it.
#[derive(Debug)]
pub(super) struct SourceText {
    files: Files,
    /// Bytes of the files.
    own: usize,
    parsed: String,
    translation: Translation,
}

impl SourceText {
    /// The text that is parsed.
    pub fn parsed(&self) -> &str {
        &self.parsed
    }

    /// The file's part of the text that is parsed.
    pub fn translated(&self) -> &str {
        &self.translation.text
    }

    /// The file's name.
    pub fn file(&self) -> &str {
        self.files.first()
    }

    /// The file's name for a name of the text that is parsed.
    pub fn own_name<'a>(&'a self, name: &'a str) -> &'a str {
        self.translation.own_name(name)
    }

    /// The bytes of the file for a place; `None` for the prelude.
    fn own_range(&self, span: Span) -> Option<Range<usize>> {
        let range = self.translation.own_range(span.to_range()?)?;
        (range.end <= self.own).then_some(range)
    }

    /// The error for a loop that does not end.
    pub fn endless_loop(&self, endless: Endless) -> ShaderError {
        let span = Span::new(endless.place, endless.place + 1);
        self.error(&Fault::new(
            span,
            "this loop takes too many turns",
            "make it end at every point, or sooner",
        ))
    }

    /// The error for a fault.
    pub fn error(&self, fault: &Fault) -> ShaderError {
        let message = self.translation.in_own_names(&fault.message);
        let remedy = self.translation.in_own_names(&fault.remedy);
        self.files.error(&Fault { span: fault.span, message, remedy }, self.own_range(fault.span))
    }
}

/// A parsed and valid shader, followed by the prelude.
#[derive(Debug)]
pub(super) struct Source {
    pub text: Arc<SourceText>,
    pub module: Module,
    pub info: ModuleInfo,
}

/// The most errors that are told at once.
const MOST_ERRORS: usize = 8;

impl Source {
    /// Parses and validates a file's text with the prelude.
    ///
    /// # Errors
    /// When the text is no valid WGSL, or too long or too deeply nested. Of each declaration one error is told.
    pub fn parse(file: &str, text: &str, prelude: &str) -> Result<Self, ShaderError> {
        if text.len() > MAX_SOURCE_BYTES {
            let message = format!("the shader has {} bytes; at most {MAX_SOURCE_BYTES} are read", text.len());
            return Err(ShaderError::of_file(file, &message, "split it into shaders of several materials"));
        }
        let files = Files::of(file, text)?;
        let own = &*files.code();
        let (mut first, mut at) = match Self::parse_once(&files, own, prelude) {
            Ok(source) => return Ok(source),
            Err(refused) => *refused,
        };
        // The declarations with errors are taken away, until there is no error or it is not known where it is.
        let mut repaired = Repaired::new(own);
        let mut others = Vec::new();
        while others.len() + 1 < MOST_ERRORS
            && let Some(place) = at
            && repaired.take_away(place)
        {
            let Err(refused) = Self::parse_once(&files, &repaired.text(), prelude) else { break };
            let (error, next) = *refused;
            at = next;
            if next.is_some_and(|place| place < own.len()) && !repaired.names_one_gone(&error.message) {
                others.push(error);
            }
        }
        others.sort_by(|a: &ShaderError, b| (&a.file, a.line).cmp(&(&b.file, b.line)));
        first.others = others.into();
        Err(first)
    }

    /// Parses and validates a text. The error comes with its place in the text.
    fn parse_once(
        files: &Files,
        own: &str,
        prelude: &str,
    ) -> Result<Self, Box<(ShaderError, Option<usize>)>> {
        let whole = |message: String, remedy: &str, at: Option<usize>| {
            let fault = Fault::new(Span::UNDEFINED, message, remedy);
            Err(Box::new((files.error(&fault, at.map(|at| at..at + 1)), None)))
        };
        if let Some(at) = too_deep(own, 1) {
            let message = format!(
                "parentheses are nested more than {MAX_NESTING} deep, or a statement has more than {MAX_OPERATORS} \
                 operators"
            );
            return whole(message, "name parts of the expression with `let`", Some(at as usize));
        }
        let Some(translation) = Translation::new(own, prelude) else {
            let message =
                "constants that depend on functions like `sin` become too long when they are written out";
            return whole(message.into(), "compute them in a function", None);
        };
        // Constants that are written out nest deeper than the file does.
        if too_deep(&translation.text, 2).is_some() {
            let message = "constants that depend on functions like `sin` depend on each other too deeply";
            return whole(message.into(), "compute them in a function", None);
        }
        let parsed = format!("{}\n{prelude}", translation.text);
        let text = SourceText { files: files.clone(), own: own.len(), parsed, translation };
        let refused = |text: &SourceText, fault: Fault| {
            let at = text.own_range(fault.span).map(|range| range.start);
            Err(Box::new((text.error(&fault), at)))
        };
        let module = match Frontend::new().parse(&text.parsed) {
            Ok(module) => module,
            Err(found) => {
                return refused(&text, diagnosis::of_parse_error(&found, text.translated(), prelude));
            }
        };
        // Pictures are bound by name.
        let checks = ValidationFlags::all() - ValidationFlags::BINDINGS;
        match Validator::new(checks, Capabilities::SHADER_FLOAT16_IN_FLOAT32).validate(&module) {
            Ok(info) => Ok(Self { text: Arc::new(text), module, info }),
            Err(found) => refused(&text, diagnosis::of_invalid_module(&found, &module)),
        }
    }

    /// The name of a type as WGSL writes it: of structs their own, of numbers and vectors `f32`, `vec3f`, ..
    pub fn type_name(&self, ty: Handle<Type>) -> String {
        diagnosis::type_name(
            &self.module,
            &self.module.types[ty].inner,
            self.module.types[ty].name.as_deref(),
        )
    }

    /// The error for a fault.
    pub fn error(&self, fault: &Fault) -> ShaderError {
        self.text.error(fault)
    }
}

/// The byte at which nesting becomes too deep, or a statement too long, by so many times the limits.
fn too_deep(text: &str, times: usize) -> Option<u32> {
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
            if depth > times * MAX_NESTING || operators > times * MAX_OPERATORS {
                return Some((at + offset) as u32);
            }
        }
        at += line.len();
    }
    None
}

/// The number of the line of a byte, from 1.
fn line_of(text: &str, at: usize) -> u32 {
    text[..floor_boundary(text, at)].matches('\n').count() as u32 + 1
}

/// The error for a fault at some bytes of a file's text, or of the whole file.
pub(super) fn error(file: &str, own: &str, range: Option<Range<usize>>, fault: &Fault) -> ShaderError {
    let (file, excerpt, others) = (file.into(), String::new(), Box::default());
    let (message, remedy) = (fault.message.clone(), fault.remedy.clone());
    let mut error = ShaderError { file, line: 0, column: 0, message, remedy, excerpt, others };
    let Some(range) = range.filter(|range| range.start <= own.len()) else { return error };
    let start = floor_boundary(own, range.start);
    let line_start = own[..start].rfind('\n').map_or(0, |at| at + 1);
    let line_end = own[start..].find('\n').map_or(own.len(), |at| start + at);
    let end = floor_boundary(own, range.end.min(line_end)).max(start);
    error.line = line_of(own, start);
    error.column = own[line_start..start].chars().count() as u32 + 1;
    let number = error.line.to_string();
    let margin = " ".repeat(number.len());
    let marked = error.column as usize - 1..error.column as usize - 1 + own[start..end].chars().count();
    let (line, marks) = shown(&own[line_start..line_end], marked);
    error.excerpt = format!("{margin} |\n{number} | {line}\n{margin} | {marks}");
    error
}

/// The part of a line around some of its characters, and marks below these. Of a long line, as generated files have,
/// [`EXCERPT`] characters are shown.
fn shown(line: &str, marked: Range<usize>) -> (String, String) {
    const CUT: &str = "...";
    let characters: Vec<char> = line.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    let first = match characters.len() > EXCERPT {
        true => marked.start.saturating_sub(EXCERPT / 2).min(characters.len() - EXCERPT),
        false => 0,
    };
    let last = characters.len().min(first + EXCERPT);
    let cut = |is_cut| if is_cut { CUT } else { "" };
    let before = cut(first > 0);
    let text = String::from_iter(&characters[first..last]);
    let marks = marked.end.min(last).saturating_sub(marked.start).max(1);
    (
        format!("{before}{text}{}", cut(last < characters.len())),
        format!("{}{}", " ".repeat(before.len() + marked.start - first), "^".repeat(marks)),
    )
}

/// The greatest character boundary that is not behind a byte.
fn floor_boundary(text: &str, at: usize) -> usize {
    (0..=at.min(text.len())).rev().find(|&at| text.is_char_boundary(at)).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lines_are_cut_around_the_marks() {
        assert_eq!(shown("let a = b;", 8..9), ("let a = b;".into(), "        ^".into()));
        let long = format!("{}wrong{}", "ä".repeat(500), "é".repeat(500));
        let (line, marks) = shown(&long, 500..505);
        assert_eq!(line.chars().count(), EXCERPT + 6);
        let below: String =
            line.chars().zip(marks.chars()).filter(|&(_, mark)| mark == '^').map(|(c, _)| c).collect();
        assert_eq!(below, "wrong");
        let (line, marks) = shown(&long, 1005..1005);
        assert!(line.starts_with("...é") && line.ends_with('é'), "{line}");
        assert_eq!(marks.chars().count(), line.chars().count() + 1, "behind the end");
    }
}
