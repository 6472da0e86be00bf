//! A shader without the declarations that have errors, to find the errors of the others.

use super::token::{Declaration, Token, TokenKind, declarations, tokens};
use std::ops::Range;

/// A text in which declarations are taken away. The others stay where they are.
pub(super) struct Repaired {
    text: String,
    declarations: Vec<Broken>,
}

/// A declaration that may be taken away.
struct Broken {
    bytes: Range<usize>,
    name: String,
    /// A function of the same signature, for a function.
    stub: Option<String>,
    state: State,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum State {
    There,
    /// A function of the same signature stands in its place.
    Stubbed,
    Gone,
}

impl Repaired {
    pub fn new(own: &str) -> Self {
        let tokens = tokens(own);
        let broken = |declaration: Declaration<'_>| {
            let Range { start, end } = declaration.tokens;
            let bytes = tokens[start].at..tokens[end - 1].range().end;
            let name = declaration.name.map_or(String::new(), |name| tokens[name].text.to_owned());
            let stub = (declaration.keyword == "fn").then(|| stub(&tokens[start..end])).flatten();
            Broken { bytes, name, stub, state: State::There }
        };
        let declarations = declarations(&tokens).into_iter().map(broken).collect();
        Self { text: own.to_owned(), declarations }
    }

    /// Takes away the declaration at a byte. False if there is none, or it has been taken away.
    pub fn take_away(&mut self, at: usize) -> bool {
        // Stubs stand behind the text, in the order of the declarations.
        if at >= self.text.len() {
            let mut end = self.text.len();
            for declaration in self.declarations.iter_mut().filter(|one| one.state == State::Stubbed) {
                end += declaration.stub.as_ref().map_or(0, String::len) + 1;
                if at < end {
                    declaration.state = State::Gone;
                    return true;
                }
            }
            return false;
        }
        let Some(declaration) = self.declarations.iter_mut().find(|one| one.bytes.contains(&at)) else {
            return false;
        };
        if declaration.state != State::There {
            return false;
        }
        declaration.state = if declaration.stub.is_some() { State::Stubbed } else { State::Gone };
        let blank = |c: char| if c == '\n' { "\n".to_owned() } else { " ".repeat(c.len_utf8()) };
        let blanks: String = self.text[declaration.bytes.clone()].chars().map(blank).collect();
        self.text.replace_range(declaration.bytes.clone(), &blanks);
        true
    }

    /// The text, with stubs behind it.
    pub fn text(&self) -> String {
        let stubs = self.declarations.iter().filter(|declaration| declaration.state == State::Stubbed);
        stubs
            .filter_map(|declaration| declaration.stub.as_ref())
            .fold(self.text.clone(), |text, stub| text + "\n" + stub)
    }

    /// True if a message names a declaration that is gone.
    pub fn names_one_gone(&self, message: &str) -> bool {
        let is_gone = |token: &Token<'_>| {
            token.kind == TokenKind::Name
                && self.declarations.iter().any(|one| one.state == State::Gone && one.name == token.text)
        };
        tokens(message).iter().any(is_gone)
    }
}

/// A function of the same signature that returns zeros.
fn stub(tokens: &[Token<'_>]) -> Option<String> {
    let start = tokens.iter().position(|token| token.text == "fn")?;
    let body = tokens.iter().position(|token| token.text == "{")?;
    let text = |tokens: &[Token<'_>]| tokens.iter().map(|token| token.text).collect::<Vec<_>>().join(" ");
    let header = text(tokens.get(start..body)?).replace("- >", "->");
    let result = header.rsplit_once(")").map_or("", |(_, result)| result).trim();
    Some(match result.strip_prefix("->") {
        Some(result) => format!("{header} {{ var zeros: {result}; return zeros; }}"),
        None => format!("{header} {{}}"),
    })
}
