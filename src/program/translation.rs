//! The text that naga parses: a file's own, with three changes.
//!
//! Names of the file come first: a name that the prelude or WGSL defines, too, is written another way. Constants are
//! computed by this crate's arithmetic: naga would compute `sin(1.0)` with the platform's library, so arguments of
//! inexact functions are multiplied by an `override` of 1, which naga leaves alone and the lowerer drops. Constants
//! that depend on such a call are written out where they are used.

use super::source::MAX_SOURCE_BYTES;
use super::token::{Declaration, Token, TokenKind, closing, declarations, tokens};
use std::collections::{HashMap, HashSet};
use std::ops::Range;

/// The `override` of 1 in the prelude.
pub(super) const UNFOLDED: &str = "unfolded";

/// Functions of WGSL whose result is rounded more than once, or by a library.
const INEXACT: [&str; 34] = [
    "acos",
    "acosh",
    "asin",
    "asinh",
    "atan",
    "atan2",
    "atanh",
    "cos",
    "cosh",
    "degrees",
    "determinant",
    "distance",
    "exp",
    "exp2",
    "fma",
    "frexp",
    "inverseSqrt",
    "ldexp",
    "length",
    "log",
    "log2",
    "mix",
    "modf",
    "normalize",
    "pow",
    "quantizeToF16",
    "radians",
    "reflect",
    "refract",
    "sin",
    "sinh",
    "smoothstep",
    "tan",
    "tanh",
];

/// Functions of WGSL that the prelude calls.
const CALLED_BY_PRELUDE: [&str; 14] = [
    "abs", "bitcast", "clamp", "cross", "dot", "floor", "max", "min", "mix", "round", "select", "sign",
    "sqrt", "trunc",
];

/// The most bytes of a translation, as a multiple of [`MAX_SOURCE_BYTES`].
const MOST_GROWTH: usize = 4;

/// A part of the translation: bytes of the translation, and the bytes of the file for which they stand.
#[derive(Debug)]
struct Piece {
    at: usize,
    from: Range<usize>,
    is_copy: bool,
}

/// A translated file.
#[derive(Debug)]
pub(super) struct Translation {
    pub text: String,
    pieces: Vec<Piece>,
    /// New and own names.
    renamed: Vec<(String, String)>,
}

/// Text in place of some bytes, and the bytes for which it stands.
struct Edit {
    bytes: Range<usize>,
    text: String,
    stands_for: Range<usize>,
}

impl Translation {
    /// Translates a file's text, for a prelude that follows it. `None` if it would become too long.
    pub fn new(own: &str, prelude: &str) -> Option<Self> {
        let (own_tokens, prelude_tokens) = (tokens(own), tokens(prelude));
        let of_prelude = names(&prelude_tokens, &declarations(&prelude_tokens));
        let translator = Translator::new(own, &own_tokens, &of_prelude)?;
        let renamed = translator.renamed.iter().map(|(&own, new)| (new.clone(), own.to_owned())).collect();
        let mut translation = Self { text: String::new(), pieces: Vec::new(), renamed };
        translation.apply(own, &translator.all_edits())?;
        Some(translation)
    }

    fn apply(&mut self, own: &str, edits: &[Edit]) -> Option<()> {
        let mut cursor = 0;
        for edit in edits {
            self.push(&own[cursor..edit.bytes.start], cursor..edit.bytes.start, true)?;
            self.push(&edit.text, edit.stands_for.clone(), false)?;
            cursor = edit.bytes.end;
        }
        self.push(&own[cursor..], cursor..own.len(), true)
    }

    fn push(&mut self, text: &str, from: Range<usize>, is_copy: bool) -> Option<()> {
        if !text.is_empty() {
            self.pieces.push(Piece { at: self.text.len(), from, is_copy });
            self.text += text;
        }
        (self.text.len() <= MOST_GROWTH * MAX_SOURCE_BYTES).then_some(())
    }

    /// The bytes of the file for which some of the translation stand; `None` beyond its end.
    pub fn own_range(&self, range: Range<usize>) -> Option<Range<usize>> {
        if range.start > self.text.len() {
            return None;
        }
        let Some(first) = self.piece(range.start) else { return Some(0..0) };
        let from = |piece: &Piece, at: usize| piece.from.start + (at - piece.at);
        let start =
            if first.is_copy { from(first, range.start).min(first.from.end) } else { first.from.start };
        let end = match self.piece(range.end.saturating_sub(1).max(range.start)) {
            Some(last) if last.is_copy => from(last, range.end.max(last.at)).min(last.from.end),
            Some(last) => last.from.end,
            None => start,
        };
        Some(start..if end > start { end } else { first.from.end.max(start) })
    }

    /// The piece that has a byte.
    fn piece(&self, at: usize) -> Option<&Piece> {
        self.pieces[..self.pieces.partition_point(|piece| piece.at <= at)].last()
    }

    /// The file's name for a name of the translation.
    pub fn own_name<'a>(&'a self, name: &'a str) -> &'a str {
        self.renamed.iter().find(|(new, _)| new == name).map_or(name, |(_, own)| own)
    }

    /// A message about the translation in the file's names.
    pub fn in_own_names(&self, message: &str) -> String {
        if self.renamed.is_empty() {
            return message.to_owned();
        }
        let mut result = String::new();
        let mut cursor = 0;
        for token in tokens(message) {
            result += &message[cursor..token.at];
            result += self.own_name(token.text);
            cursor = token.range().end;
        }
        result + &message[cursor..]
    }
}

/// The names that some declarations define.
fn names<'t>(tokens: &[Token<'t>], declarations: &[Declaration<'t>]) -> HashSet<&'t str> {
    declarations.iter().filter_map(|declaration| Some(tokens[declaration.name?].text)).collect()
}

/// The most rounds in which constants are put into order. Each finds what depends on constants before it.
const MOST_ROUNDS: usize = 64;

struct Translator<'t> {
    own: &'t str,
    tokens: &'t [Token<'t>],
    declarations: Vec<Declaration<'t>>,
    /// The names of the module's declarations.
    defined: HashSet<&'t str>,
    /// New names.
    renamed: HashMap<&'t str, String>,
    /// The names of constants that naga must not compute, and the declarations.
    unfolded: HashMap<&'t str, usize>,
    /// Their expressions, translated, in parentheses.
    written: HashMap<&'t str, String>,
}

impl<'t> Translator<'t> {
    /// `None` if constants become too long.
    fn new(own: &'t str, tokens: &'t [Token<'t>], of_prelude: &HashSet<&str>) -> Option<Self> {
        let declarations = declarations(tokens);
        let defined = names(tokens, &declarations);
        let used: HashSet<&str> = tokens.iter().map(|token| token.text).collect();
        let mut renamed = HashMap::new();
        for &name in &defined {
            if of_prelude.contains(name) || CALLED_BY_PRELUDE.contains(&name) {
                let mut new = format!("{name}_");
                while used.contains(new.as_str()) || of_prelude.contains(new.as_str()) {
                    new += "_";
                }
                renamed.insert(name, new);
            }
        }
        let (unfolded, written) = (HashMap::new(), HashMap::new());
        let mut translator = Self { own, tokens, declarations, defined, renamed, unfolded, written };
        translator.find_unfolded();
        translator.write_unfolded()?;
        Some(translator)
    }

    /// Finds the constants of the module that depend on inexact functions.
    fn find_unfolded(&mut self) {
        let constants = self.declarations.iter().enumerate();
        let mut rest: Vec<(&'t str, usize)> = constants
            .filter(|(_, declaration)| declaration.keyword == "const")
            .filter_map(|(index, declaration)| Some((self.tokens[declaration.name?].text, index)))
            .collect();
        for _ in 0..MOST_ROUNDS {
            let before = rest.len();
            rest.retain(|&(name, index)| {
                let is_unfolded = self.is_unfolded(self.expression(index), &HashSet::new());
                if is_unfolded {
                    self.unfolded.insert(name, index);
                }
                !is_unfolded
            });
            if rest.len() == before {
                return;
            }
        }
    }

    /// Writes their expressions, each after those that it needs.
    fn write_unfolded(&mut self) -> Option<()> {
        let mut rest: Vec<(&'t str, usize)> =
            self.unfolded.iter().map(|(&name, &index)| (name, index)).collect();
        rest.sort_unstable_by_key(|&(_, index)| index);
        let mut bytes = 0;
        for _ in 0..MOST_ROUNDS {
            let mut waiting = Vec::new();
            for (name, index) in rest {
                let mut needed = self.expression(index).filter_map(|token| self.constant(token));
                if !needed.all(|name| self.written.contains_key(name)) {
                    waiting.push((name, index));
                    continue;
                }
                let expression = self.written(self.expression(index))?;
                bytes += expression.len();
                if bytes > MOST_GROWTH * MAX_SOURCE_BYTES {
                    return None;
                }
                self.written.insert(name, expression);
            }
            if waiting.is_empty() {
                break;
            }
            rest = waiting;
        }
        Some(())
    }

    fn text(&self, token: usize) -> &'t str {
        self.tokens.get(token).map_or("", |token| token.text)
    }

    fn is_member(&self, token: usize) -> bool {
        token > 0 && self.text(token - 1) == "."
    }

    /// The tokens behind the equals sign of a declaration.
    fn expression(&self, declaration: usize) -> Range<usize> {
        self.behind_equals(self.declarations[declaration].tokens.clone())
    }

    /// The tokens behind an equals sign, without a semicolon.
    fn behind_equals(&self, tokens: Range<usize>) -> Range<usize> {
        let start =
            tokens.clone().find(|&token| self.text(token) == "=").map_or(tokens.end, |token| token + 1);
        let ends = tokens.end > start && self.text(tokens.end - 1) == ";";
        start..tokens.end - usize::from(ends)
    }

    /// True if a token calls an inexact function of WGSL.
    fn is_inexact(&self, token: usize) -> bool {
        let text = self.text(token);
        INEXACT.contains(&text)
            && !self.defined.contains(text)
            && self.text(token + 1) == "("
            && ![")", ""].contains(&self.text(token + 2))
            && !self.is_member(token)
    }

    /// The constant that a token names and that naga must not compute.
    fn constant(&self, token: usize) -> Option<&'t str> {
        let text = self.text(token);
        (self.unfolded.contains_key(text) && !self.is_member(token)).then_some(text)
    }

    /// True if an expression depends on inexact functions, by constants of the module or of the function.
    fn is_unfolded(&self, mut tokens: Range<usize>, locals: &HashSet<&str>) -> bool {
        tokens.any(|token| {
            let is_local = locals.contains(self.text(token)) && !self.is_member(token);
            is_local || self.is_inexact(token) || self.constant(token).is_some()
        })
    }

    /// An expression, translated, in parentheses. `None` if it is too long.
    fn written(&self, expression: Range<usize>) -> Option<String> {
        let Some(last) = expression.clone().next_back() else { return Some("()".into()) };
        let end = self.tokens[last].range().end;
        let mut cursor = self.tokens[expression.start].at;
        let mut text = String::from("(");
        for edit in self.edits(expression, &HashSet::new()) {
            text += &self.own[cursor..edit.bytes.start];
            text += &edit.text;
            cursor = edit.bytes.end;
        }
        text += &self.own[cursor..end];
        text += ")";
        (text.len() <= MOST_GROWTH * MAX_SOURCE_BYTES).then_some(text)
    }

    /// The edits of the whole file, in their order.
    fn all_edits(&self) -> Vec<Edit> {
        let mut edits = Vec::new();
        let unfolded: HashSet<usize> = self.unfolded.values().copied().collect();
        for (index, declaration) in self.declarations.iter().enumerate() {
            let Declaration { keyword, tokens, .. } = declaration.clone();
            let locals = if keyword == "fn" { self.locals(tokens.clone()) } else { HashSet::new() };
            if unfolded.contains(&index) {
                let keyword = tokens.clone().find(|&token| self.text(token) == "const");
                edits.extend(keyword.map(|token| self.replaced(token, "var<private>")));
            }
            if keyword == "fn" {
                edits.extend(self.unfolded_locals(tokens.clone()));
            }
            edits.extend(self.edits(tokens, &locals));
        }
        edits.sort_by_key(|edit| (edit.bytes.start, edit.bytes.end));
        edits
    }

    fn replaced(&self, token: usize, text: &str) -> Edit {
        let bytes = self.tokens[token].range();
        Edit { bytes: bytes.clone(), text: text.into(), stands_for: bytes }
    }

    /// The names that a function declares.
    fn locals(&self, tokens: Range<usize>) -> HashSet<&'t str> {
        let is_declared = |&token: &usize| {
            self.tokens[token].kind == TokenKind::Name
                && token > 0
                && (["let", "const", "var", ">"].contains(&self.text(token - 1))
                    || self.text(token + 1) == ":")
        };
        tokens.filter(is_declared).map(|token| self.text(token)).collect()
    }

    /// Constants of a function that depend on inexact functions are values.
    fn unfolded_locals(&self, tokens: Range<usize>) -> Vec<Edit> {
        let mut found = HashSet::new();
        let mut edits = Vec::new();
        for token in tokens.clone().filter(|&token| self.text(token) == "const") {
            let ends = |&token: &usize| [";", "{", "}", "const"].contains(&self.text(token));
            let end = (token + 1..tokens.end).find(ends).unwrap_or(tokens.end);
            if self.is_unfolded(self.behind_equals(token..end), &found) {
                found.insert(self.text(token + 1));
                edits.push(self.replaced(token, "let"));
            }
        }
        edits
    }

    /// The edits of names and calls among some tokens of a declaration.
    fn edits(&self, tokens: Range<usize>, locals: &HashSet<&str>) -> Vec<Edit> {
        let mut edits = Vec::new();
        let is_struct = self.text(tokens.start) == "struct";
        for token in tokens.clone().filter(|&token| self.tokens[token].kind == TokenKind::Name) {
            let text = self.text(token);
            let names_member = is_struct && self.text(token + 1) == ":";
            if let Some(new) = self.renamed.get(text)
                && !self.is_member(token)
                && !names_member
                && self.constant(token).is_none()
            {
                edits.push(self.replaced(token, new));
            }
            if let Some(name) = self.constant(token)
                && !locals.contains(name)
                && !names_member
            {
                let is_definition = self.text(token - usize::from(token > 0)) == "const";
                let new = if is_definition { self.renamed.get(name) } else { self.written.get(name) };
                edits.extend(new.map(|new| self.replaced(token, new)));
            }
            if self.is_inexact(token) {
                let name = self.tokens[token].range();
                let open = self.tokens[token + 1].range().end;
                edits.push(Edit {
                    bytes: open..open,
                    text: format!("{UNFOLDED}*("),
                    stands_for: name.clone(),
                });
                let close =
                    self.tokens.get(self.end_of_argument(token + 2)).map_or(self.own.len(), |end| end.at);
                edits.push(Edit { bytes: close..close, text: ")".into(), stands_for: name });
            }
        }
        edits.sort_by_key(|edit| (edit.bytes.start, edit.bytes.end));
        edits
    }

    /// The comma or the parenthesis behind an argument, or what is wrong in its place.
    fn end_of_argument(&self, first: usize) -> usize {
        let mut token = first;
        while token < self.tokens.len() && ![",", ")", ";", "]", "}"].contains(&self.text(token)) {
            let opens = ["(", "[", "{"].contains(&self.text(token));
            token = if opens { closing(self.tokens, token) + 1 } else { token + 1 };
        }
        token
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn translated(own: &str) -> String {
        Translation::new(own, "const TAU = 6.0; fn noise(p: vec3f) -> f32 { return abs(p.x); }")
            .expect("short")
            .text
    }

    #[test]
    fn arguments_of_inexact_functions_are_not_folded() {
        let cases = [
            (
                "fn f() -> f32 { return sin(1.0) + p.sin; }",
                "fn f() -> f32 { return sin(unfolded*(1.0)) + p.sin; }",
            ),
            (
                "fn f() { let a = pow(exp(2, ), (3, 4)); }",
                "fn f() { let a = pow(unfolded*(exp(unfolded*(2), )), (3, 4)); }",
            ),
            ("fn sin(x: f32) -> f32 { return sin(x); }", "fn sin(x: f32) -> f32 { return sin(x); }"),
            (
                "fn f() { const a = cos(1); const b = a; const c = 2; }",
                "fn f() { let a = cos(unfolded*(1)); let b = a; const c = 2; }",
            ),
            ("sin(", "sin("),
        ];
        for (own, expected) in cases {
            assert_eq!(translated(own), expected);
        }
    }

    #[test]
    fn constants_of_inexact_functions_are_written_out() {
        let own = "const b = a + 1; const a: f32 = exp(2.0); const n = 3; \
                   fn f(n: f32) { let x = b * s.a; var a = 1; a; }";
        let expected = "var<private> b = (exp(unfolded*(2.0))) + 1; \
                        var<private> a: f32 = exp(unfolded*(2.0)); const n = 3; \
                        fn f(n: f32) { let x = ((exp(unfolded*(2.0))) + 1) * s.a; var a = 1; a; }";
        assert_eq!(translated(own), expected);
    }

    #[test]
    fn names_of_the_file_come_first() {
        let own =
            "struct S { noise: f32 } fn noise(s: S) -> f32 { return s.noise; } fn abs() { noise(S(TAU)); }";
        let expected = "struct S { noise: f32 } fn noise_(s: S) -> f32 { return s.noise; } \
                        fn abs_() { noise_(S(TAU)); }";
        let translation = Translation::new(own, "const TAU = 6.0; fn noise() {}").expect("short");
        assert_eq!(translation.text, expected);
        assert_eq!(translation.in_own_names("no `noise_` of noise_x"), "no `noise` of noise_x");
    }

    #[test]
    fn places_are_those_of_the_file() {
        let own = "const TAU = 3.0; fn f(é: f32) { return sin(é) + x; }";
        let translation = Translation::new(own, "const TAU = 6.0;").expect("short");
        for word in ["3.0", "fn", "é:", "return", "sin", "x;"] {
            let (there, here) = (translation.text.rfind(word), own.rfind(word));
            let (there, here) = (there.expect(word), here.expect(word));
            assert_eq!(
                translation.own_range(there..there + word.len()),
                Some(here..here + word.len()),
                "{word}"
            );
        }
        let inserted = translation.text.find(UNFOLDED).expect("it is there");
        let sine = own.find("sin").expect("it is there");
        assert_eq!(translation.own_range(inserted..inserted + 3), Some(sine..sine + 3));
        assert_eq!(translation.own_range(translation.text.len() + 1..translation.text.len() + 2), None);
    }

    #[test]
    fn long_constants_are_refused() {
        let mut own = String::from("const a0 = sin(1.0);");
        for i in 0..40 {
            own += &format!("const a{} = a{i} + a{i};", i + 1);
        }
        assert!(Translation::new(&own, "").is_none());
        let mut own = format!("const a = sin({}1.0);", "1.0+".repeat(100_000));
        for i in 0..1000 {
            own += &format!("const b{i} = a;");
        }
        assert!(Translation::new(&own, "").is_none(), "many copies of a long one");
    }

    /// In the square of its length each would take hours. Deep nesting is refused before.
    #[test]
    fn hostile_text_is_translated_soon() {
        for piece in ["const ", "sin(}", "sin(]", "const a = sin(1.0) ", "sin(1.0;", "const x = sin(} "] {
            let own = format!("fn f() {{ {} }}", piece.repeat(MAX_SOURCE_BYTES / piece.len()));
            let _ = Translation::new(&own, "fn noise() {}");
        }
        let mut own = String::from("const a0 = sin(1.0);");
        for i in 0..300 {
            own += &format!("const a{} = a{i};", i + 1);
        }
        assert!(Translation::new(&own, "").is_some(), "a chain");
    }
}
