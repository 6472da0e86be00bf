//! Tokens of WGSL and the declarations of a file. Enough is read to find names; the rest is naga's.

use std::ops::Range;

/// A token's kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TokenKind {
    /// A name or a keyword.
    Name,
    /// A number, its suffix too.
    Number,
    /// One character of another kind.
    Sign,
}

/// A token of a text.
#[derive(Clone, Copy, Debug)]
pub(super) struct Token<'t> {
    pub kind: TokenKind,
    pub text: &'t str,
    /// The first byte.
    pub at: usize,
}

impl Token<'_> {
    /// The bytes.
    pub fn range(&self) -> Range<usize> {
        self.at..self.at + self.text.len()
    }
}

/// The tokens of a text. Comments are left out; block comments nest.
pub(super) fn tokens(text: &str) -> Vec<Token<'_>> {
    let mut tokens = Vec::new();
    let mut at = 0;
    while let Some(first) = text[at..].chars().next() {
        let rest = &text[at..];
        let (kind, length) = if first.is_whitespace() {
            at += first.len_utf8();
            continue;
        } else if rest.starts_with("//") {
            at += rest.find('\n').unwrap_or(rest.len());
            continue;
        } else if rest.starts_with("/*") {
            at += block_comment(rest);
            continue;
        } else if first.is_alphabetic() || first == '_' {
            let is_end = |c: char| !c.is_alphanumeric() && c != '_';
            (TokenKind::Name, rest.find(is_end).unwrap_or(rest.len()))
        } else if first.is_ascii_digit() {
            (TokenKind::Number, number(rest))
        } else {
            (TokenKind::Sign, first.len_utf8())
        };
        tokens.push(Token { kind, text: &rest[..length], at });
        at += length;
    }
    tokens
}

/// The bytes of the block comment with which a text begins.
fn block_comment(text: &str) -> usize {
    let (bytes, mut depth, mut at) = (text.as_bytes(), 0, 0);
    while at < bytes.len() {
        match bytes.get(at..at + 2) {
            Some(b"/*") => (depth, at) = (depth + 1, at + 2),
            Some(b"*/") => (depth, at) = (depth - 1, at + 2),
            _ => at += 1,
        }
        if depth == 0 {
            break;
        }
    }
    // The end is behind an ASCII character, or the end of the text.
    at.min(text.len())
}

/// The bytes of the number with which a text begins.
fn number(text: &str) -> usize {
    let is_hex = text.starts_with("0x") || text.starts_with("0X");
    let mut before = '0';
    for (at, c) in text.char_indices() {
        let is_exponent = if is_hex { "pP" } else { "eE" };
        let is_sign = "+-".contains(c) && is_exponent.contains(before);
        if !c.is_ascii_alphanumeric() && c != '.' && !is_sign {
            return at;
        }
        before = c;
    }
    text.len()
}

/// A declaration of a module: its tokens.
#[derive(Clone, Debug)]
pub(super) struct Declaration<'t> {
    /// `fn`, `const`, `var`, `override`, `struct`, `alias`, or another word.
    pub keyword: &'t str,
    /// The token of the name.
    pub name: Option<usize>,
    /// All its tokens, those of attributes too.
    pub tokens: Range<usize>,
}

/// The declarations of a module. Text that is none ends at the next semicolon.
pub(super) fn declarations<'t>(tokens: &[Token<'t>]) -> Vec<Declaration<'t>> {
    let mut all = Vec::new();
    let mut at = 0;
    while at < tokens.len() {
        let start = at;
        while at + 1 < tokens.len() && tokens[at].text == "@" {
            at += 2;
            if tokens.get(at).is_some_and(|token| token.text == "(") {
                at = closing(tokens, at) + 1;
            }
        }
        let Some(first) = tokens.get(at) else { break };
        let (keyword, mut named) = (first.text, at + 1);
        if keyword == "var" && tokens.get(named).is_some_and(|token| token.text == "<") {
            let end = tokens[named..].iter().position(|token| token.text == ">");
            named = end.map_or(tokens.len(), |end| named + end + 1);
        }
        let has_name = ["fn", "const", "var", "override", "struct", "alias"].contains(&keyword);
        let is_name = |index: &usize| tokens.get(*index).is_some_and(|token| token.kind == TokenKind::Name);
        let has_body = ["fn", "struct"].contains(&keyword);
        while at < tokens.len() && tokens[at].text != ";" {
            let opens = ["(", "{", "["].contains(&tokens[at].text);
            let is_body = has_body && tokens[at].text == "{";
            at = if opens { closing(tokens, at) } else { at };
            if is_body {
                break;
            }
            at += 1;
        }
        at = (at + 1).min(tokens.len());
        all.push(Declaration {
            keyword,
            name: Some(named).filter(|index| has_name && is_name(index)),
            tokens: start..at,
        });
    }
    all
}

/// True if a text declares something of this name: a struct, a function.
pub(super) fn declares(text: &str, keyword: &str, name: &str) -> bool {
    let tokens = tokens(text);
    let is_it =
        |one: &Declaration<'_>| one.keyword == keyword && one.name.is_some_and(|at| tokens[at].text == name);
    declarations(&tokens).iter().any(is_it)
}

/// The token that closes the bracket at an index, or the last one.
pub(super) fn closing(tokens: &[Token<'_>], open: usize) -> usize {
    let mut depth = 0u32;
    for (index, token) in tokens.iter().enumerate().skip(open) {
        match token.text {
            "(" | "{" | "[" => depth += 1,
            ")" | "}" | "]" => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth == 0 {
            return index;
        }
    }
    tokens.len().saturating_sub(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn declarations_have_their_names_and_ends() {
        let text = "/* a /* b */ fn no() {} */ const a = 1.5e-3; // const b = 2;\n\
                    @id(1) override c: f32 = 0x1p+2f;;\n\
                    struct D { e: f32, f: array<f32, 2> }\n\
                    var<private> g = D(1., array(1, 2));\n\
                    @must_use fn h(x: f32) -> f32 { if x > 0 { return x; } return 1; }\n\
                    alias i = f32; const_assert a > 0; fn é() {}";
        let tokens = tokens(text);
        let all = declarations(&tokens);
        let names: Vec<(&str, Option<&str>)> =
            all.iter().map(|d| (d.keyword, d.name.map(|name| tokens[name].text))).collect();
        let expected = [
            ("const", Some("a")),
            ("override", Some("c")),
            (";", None),
            ("struct", Some("D")),
            ("var", Some("g")),
            ("fn", Some("h")),
            ("alias", Some("i")),
            ("const_assert", None),
            ("fn", Some("é")),
        ];
        assert_eq!(names, expected);
        assert!(tokens.iter().any(|token| token.text == "1.5e-3"));
        assert!(tokens.iter().any(|token| token.text == "0x1p+2f"));
        assert_eq!(all.last().map(|d| d.tokens.end), Some(tokens.len()));
    }

    #[test]
    fn broken_text_has_an_end() {
        for text in
            ["fn", "fn f(", "@", "@a(", "var<", "{{{", "}}}", "/* /*", "const", "0x", "é//", "struct S {"]
        {
            let tokens = tokens(text);
            assert!(declarations(&tokens).iter().all(|d| d.tokens.end <= tokens.len()), "{text}");
        }
    }
}
