//! Errors of naga in words for people: what is wrong in the file's own terms, and what to write instead.

mod habit;
mod invalid;
mod spelling;

pub(super) use invalid::of_invalid_module;

use super::parameter::PICTURE;
use super::source::Fault;
use super::token::{Token, tokens};
use naga::front::wgsl::ParseError;
use naga::{Module, Scalar, ScalarKind, Span, TypeInner};
use std::fmt::Write;

/// The fault for an error of naga's parser in a text that the prelude follows.
pub(super) fn of_parse_error(found: &ParseError, text: &str, prelude: &str) -> Fault {
    let tokens = tokens(text);
    let labels: Vec<(Span, &str)> = found.labels().collect();
    let at = labels.first().and_then(|label| label.0.to_range()).map_or(usize::MAX, |range| range.start);
    let here = tokens.partition_point(|token| token.at < at);
    let error =
        Refusal { message: found.message(), labels, notes: found.notes().collect(), tokens: &tokens, here };
    if let Some(habit) = habit::at(&tokens, here) {
        let span = tokens.get(habit.token).map_or(error.place(0), |token| span_of(token.range()));
        return Fault::new(span, habit.message, habit.remedy);
    }
    error.of_names(prelude).or_else(|| error.of_types()).unwrap_or_else(|| error.of_text())
}

/// An error of naga's parser.
struct Refusal<'t> {
    message: &'t str,
    labels: Vec<(Span, &'t str)>,
    notes: Vec<&'t str>,
    tokens: &'t [Token<'t>],
    /// The token at which the first label begins.
    here: usize,
}

impl Refusal<'_> {
    fn place(&self, label: usize) -> Span {
        self.labels.get(label).map_or(Span::UNDEFINED, |label| label.0)
    }

    /// The words in backticks, without the signs.
    fn quoted(&self) -> impl Iterator<Item = &str> {
        self.message.split('`').skip(1).step_by(2)
    }

    /// The fault if it is about a name.
    fn of_names(&self, prelude: &str) -> Option<Fault> {
        let name = self.quoted().next()?;
        let starts = |start: &str| self.message.starts_with(start);
        let (message, remedy) = if starts("no definition in scope") {
            (format!("`{name}` is not defined"), spelling::of_name(name, self.tokens, self.here, prelude))
        } else if starts("invalid field accessor") {
            (format!("there is no member `{name}`"), spelling::of_member(name, self.tokens, prelude))
        } else if starts("redefinition of") {
            (format!("`{name}` is defined twice"), "give one of them another name".to_owned())
        } else if starts("declaration of") {
            let remedy = "write a loop; of functions only `hit` comes back, by `trace`";
            (format!("`{name}` depends on itself"), remedy.to_owned())
        } else if self.message.contains("is a reserved keyword") {
            (format!("`{name}` is a word that WGSL reserves"), "choose another name".to_owned())
        } else {
            return None;
        };
        Some(Fault::new(self.place(0), message, remedy))
    }

    /// The fault if it is about types.
    fn of_types(&self) -> Option<Fault> {
        let message = self.message;
        let mut types = self.quoted().map(short);
        if message.starts_with("automatic conversions cannot convert ") {
            let (from, to) = (types.next()?, types.next()?);
            let told = format!("this is `{from}` where `{to}` is needed");
            return Some(Fault::new(self.place(1), told, conversion(&from, &to)));
        }
        if message.starts_with("the type of ") {
            let (name, to, from) = (types.next()?, types.next()?, types.next()?);
            let told = format!("`{name}` is declared as `{to}`, and its value is `{from}`");
            return Some(Fault::new(self.place(0), told, conversion(&from, &to)));
        }
        if message.contains("type passed as argument #") {
            return Some(wrong_argument(message, &self.labels, &self.notes));
        }
        if message.contains("components, found") {
            let remedy = "give one number for each component, or a single one for all";
            return Some(Fault::new(self.place(0), sentence(message), remedy));
        }
        if message.starts_with("Cannot cast") || message.contains("enable extension") {
            let remedy = "numbers have 32 bits: `f32`, `i32`, `u32`";
            return Some(Fault::new(self.place(0), "shaders have no numbers of this size", remedy));
        }
        if message.starts_with("too many arguments") || message.starts_with("wrong number of arguments") {
            let label = self.labels.last().map_or("", |label| label.1);
            let remedy = self.notes.first().map_or(label, |note| note);
            let remedy =
                remedy.replace(" 1 argument(s)", " one argument").replace("argument(s)", "arguments");
            return Some(Fault::new(self.place(0), sentence(message), lower_first(&remedy)));
        }
        None
    }

    /// The fault if it is about something else.
    fn of_text(&self) -> Fault {
        if self.message.starts_with("invalid left-hand side") {
            return Fault::new(self.place(0), "this cannot be assigned to", self.assignable());
        }
        if let Some(rest) = self.message.strip_prefix("expected ") {
            return unexpected(rest, self.place(0), self.tokens, self.here);
        }
        let label = self.labels.first().map_or("", |label| label.1);
        let remedy = if self.notes.is_empty() { label.to_owned() } else { self.notes.join("; ") };
        let told = sentence(self.message);
        let remedy = if says_more(&remedy, &told) { remedy } else { String::new() };
        Fault::new(self.place(0), told, remedy)
    }

    /// What to assign to in place of something else.
    fn assignable(&self) -> String {
        let Some(note) = self.notes.first() else {
            return "assign to a variable, a component of one, or a member: `var x = ..; x = ..;`".into();
        };
        if note.contains("swizzles") {
            return "assign each component: `c.x = ..; c.y = ..;`".into();
        }
        let name = note.split('`').nth(1).unwrap_or_default();
        let is_let = |two: &[Token<'_>]| two[0].text == "let" && two[1].text == name;
        match self.tokens.windows(2).any(is_let) {
            true => format!("declare it with `var {name}` in place of `let {name}`"),
            false => format!("copy it: `var copy = {name};`"),
        }
    }
}

fn span_of(range: std::ops::Range<usize>) -> Span {
    Span::new(range.start as u32, range.end as u32)
}

/// True if a remedy does not repeat the message.
fn says_more(remedy: &str, message: &str) -> bool {
    let letters =
        |text: &str| text.chars().filter(|c| c.is_alphanumeric()).collect::<String>().to_lowercase();
    !letters(remedy).is_empty() && !letters(message).contains(&letters(remedy))
}

fn lower_first(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map_or(String::new(), |first| first.to_lowercase().chain(chars).collect())
}

/// A message of naga without the numbers of its tables.
fn sentence(message: &str) -> String {
    let mut text = String::new();
    let mut rest = message;
    while let Some(open) = rest.find('[') {
        let digits = rest[open + 1..].find(|c: char| !c.is_ascii_digit()).unwrap_or(0);
        let is_number = digits > 0 && rest[open + 1 + digits..].starts_with(']');
        let end = if is_number { open + digits + 2 } else { open + 1 };
        text += if is_number { &rest[..open] } else { &rest[..end] };
        if is_number {
            text += "this";
        }
        rest = &rest[end..];
    }
    text += rest;
    lower_first(text.trim_end_matches('.'))
}

/// A type as users write it: `vec3f` for `vec3<f32>`.
fn short(ty: &str) -> String {
    let mut text = ty.replace("{AbstractFloat}", "a number").replace("{AbstractInt}", "a whole number");
    for (long, letter) in [("<f32>", "f"), ("<i32>", "i"), ("<u32>", "u")] {
        for n in 2..5 {
            text = text.replace(&format!("vec{n}{long}"), &format!("vec{n}{letter}"));
        }
    }
    text
}

/// What to write to make one type of another.
fn conversion(from: &str, to: &str) -> String {
    let is_vector = |ty: &str| ty.starts_with("vec");
    let is_number = |ty: &str| ["f32", "i32", "u32"].contains(&ty) || ty.starts_with("a ");
    if from == PICTURE {
        return "look it up: `image(picture, uv)` is its red, green, blue and alpha".into();
    }
    if is_vector(to) && is_number(from) {
        return format!("write `{to}(x)`, a vector of one number");
    }
    if is_vector(from) && is_number(to) {
        return "take a component, `v.x`, or `length(v)`".into();
    }
    if is_vector(from) && is_vector(to) && from[..4] != to[..4] {
        return match from[3..4] < to[3..4] {
            true => format!("add components: `{to}(v, 0)`"),
            false => format!("take some components: `v.{}`", &"xyzw"[..to[3..4].parse().unwrap_or(2)]),
        };
    }
    if to.starts_with("a ") || to.is_empty() {
        return "write a number of the right kind: `1.0` for f32, `1u` for u32, `1i` for i32".into();
    }
    if to == "bool" {
        return "compare: `x > 0.0`".into();
    }
    if is_number(to) || is_vector(to) {
        return format!("convert it: `{to}(..)`");
    }
    format!("give a value of type `{to}`")
}

fn wrong_argument(message: &str, labels: &[(Span, &str)], notes: &[&str]) -> Fault {
    let span = labels.get(1).or(labels.first()).map_or(Span::UNDEFINED, |label| label.0);
    let number = message.split('#').nth(1).and_then(|rest| rest.split(' ').next()).unwrap_or("1");
    let function = message.split('`').nth(1).unwrap_or_default();
    let label = labels.get(1).map_or("", |label| label.1);
    let ty = short(label.rsplit("type ").next().unwrap_or_default().trim_matches('`'));
    let allowed = notes
        .iter()
        .filter_map(|note| note.strip_prefix("allowed type: "))
        .map(|ty| short(ty.trim_matches('`')));
    let allowed: Vec<String> =
        allowed.filter(|ty| !["a number", "a whole", "16", "64"].iter().any(|no| ty.contains(no))).collect();
    let shown = if ty.starts_with("a ") { ty.clone() } else { format!("`{ty}`") };
    let message = format!("argument {number} of `{function}` is {shown}");
    let remedy = match &allowed[..] {
        [one] => format!("it must be `{one}`: {}", conversion(&ty, one)),
        [] => format!("`{function}` takes other types"),
        many => {
            let shown: Vec<String> = many.iter().take(6).map(|ty| format!("`{ty}`")).collect();
            let more = if many.len() > 6 { ", .." } else { "" };
            format!("it must be one of {}{more}", shown.join(", "))
        }
    };
    Fault::new(span, message, remedy)
}

/// A token that does not fit.
fn unexpected(rest: &str, span: Span, tokens: &[Token<'_>], here: usize) -> Fault {
    let (wanted, _) = rest.split_once(", found").unwrap_or((rest, ""));
    let wanted = match wanted.split_once(" (") {
        Some((first, _)) => first,
        None => wanted,
    };
    let Some(found) = tokens.get(here) else {
        let span = tokens.last().map_or(span, |token| span_of(token.range()));
        return Fault::new(
            span,
            "the file ends inside of a declaration",
            "close each `{` with `}`, each `(` with `)`",
        );
    };
    let found = format!("`{}`", found.text);
    let wanted = wanted.replace('\'', "`");
    let remedy = match wanted.as_str() {
        "`)`" if found == "`=`" => "`==` compares",
        "`;`" => "end the statement before it with `;`",
        "`{`" => "put the body of `if`, `else`, `for`, `while` or a function in braces",
        "`}`" => "close the brace that is open",
        "`)`" => "close the parenthesis, or write an operator or a comma before it",
        "identifier" => "write a name here",
        "expression" | "primary expression" => "write a value here: a number, a name, a call",
        "`:`" => "write the type behind the name: `name: f32`",
        _ if wanted.starts_with("global item") => {
            "a file has `fn`, `const`, `override`, `var<private>`, `struct` and `alias` outside of functions"
        }
        _ if wanted.starts_with("assignment") => {
            "a statement is an assignment, a call, or begins with a keyword"
        }
        _ => "",
    };
    let wanted = if wanted.starts_with("global item") { "a declaration" } else { &wanted };
    let mut message = String::new();
    let _ = write!(message, "{found} stands where {} is expected", with_article(wanted));
    Fault::new(span, message, remedy)
}

fn with_article(noun: &str) -> String {
    let first = noun.chars().next().unwrap_or('`');
    match first {
        '`' => noun.to_owned(),
        _ if noun.starts_with("a ") => noun.to_owned(),
        'a' | 'e' | 'i' | 'o' | 'u' => format!("an {noun}"),
        _ => format!("a {noun}"),
    }
}

/// A type as WGSL writes it: of structs their names, of numbers and vectors `f32`, `vec3f`, ..
pub(super) fn type_name(module: &Module, inner: &TypeInner, name: Option<&str>) -> String {
    if let Some(name) = name {
        return name.to_owned();
    }
    let letter = |scalar: Scalar| match scalar.kind {
        ScalarKind::Float => "f",
        ScalarKind::Sint => "i",
        ScalarKind::Uint => "u",
        _ => "",
    };
    match *inner {
        TypeInner::Scalar(scalar) => match scalar.kind {
            ScalarKind::Bool => "bool".into(),
            ScalarKind::AbstractInt => "a whole number".into(),
            ScalarKind::AbstractFloat => "a number".into(),
            _ => format!("{}{}", letter(scalar), 8 * u32::from(scalar.width)),
        },
        TypeInner::Vector { size, scalar } if scalar.kind == ScalarKind::Bool => {
            format!("vec{}<bool>", size as u8)
        }
        TypeInner::Vector { size, scalar } => format!("vec{}{}", size as u8, letter(scalar)),
        TypeInner::Matrix { columns, rows, .. } => format!("mat{}x{}f", columns as u8, rows as u8),
        TypeInner::Pointer { base, .. } => {
            let base = &module.types[base];
            type_name(module, &base.inner, base.name.as_deref())
        }
        TypeInner::ValuePointer { size: Some(size), scalar, .. } => {
            type_name(module, &TypeInner::Vector { size, scalar }, None)
        }
        TypeInner::ValuePointer { size: None, scalar, .. } => {
            type_name(module, &TypeInner::Scalar(scalar), None)
        }
        TypeInner::Array { base, size: naga::ArraySize::Constant(count), .. } => {
            let base = &module.types[base];
            format!("array<{}, {count}>", type_name(module, &base.inner, base.name.as_deref()))
        }
        TypeInner::Struct { .. } => {
            let same = module.types.iter().find(|(_, ty)| ty.inner == *inner && ty.name.is_some());
            same.and_then(|(_, ty)| ty.name.clone()).unwrap_or_else(|| "a struct".into())
        }
        TypeInner::Image { dim: naga::ImageDimension::D2, arrayed: false, .. } => PICTURE.into(),
        _ => "another type".into(),
    }
}
