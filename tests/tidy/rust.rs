//! Rust sources taken apart into code, comments and literals. WGSL's are near enough.

use super::text::{closing, regex};

/// What a byte belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Code,
    Comment,
    /// Strings and characters, with their quotes.
    Literal,
}

/// A source whose bytes are told apart.
#[derive(Debug)]
pub struct Source<'a> {
    text: &'a str,
    kinds: Vec<Kind>,
}

impl<'a> Source<'a> {
    pub fn of(text: &'a str) -> Self {
        let mut kinds = Vec::with_capacity(text.len());
        while kinds.len() < text.len() {
            let at = kinds.len();
            let (kind, len) = token(text, at);
            kinds.resize((at + len.max(1)).min(text.len()), kind);
        }
        Self { text, kinds }
    }

    /// The text with everything else blank: places and lines stay.
    pub fn only(&self, kind: Kind) -> String {
        let keep = |(byte, of): (u8, &Kind)| if *of == kind || byte == b'\n' { byte } else { b' ' };
        let bytes = self.text.bytes().zip(&self.kinds).map(keep).collect();
        String::from_utf8(bytes).expect("whole characters are blanked")
    }

    /// Lines of comments with their numbers, without the marks that begin them.
    pub fn comment_lines(&self) -> Vec<(usize, String)> {
        let comments = self.only(Kind::Comment);
        let marks = |line: &str| {
            let line = line.trim();
            let line = line.strip_prefix("//").or(line.strip_prefix("/*")).unwrap_or(line);
            line.trim_start_matches(['/', '!']).trim().to_string()
        };
        let lines = comments.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
        lines.map(|(index, line)| (index + 1, marks(line))).collect()
    }

    /// The code, with items that only tests compile blank.
    pub fn code_without_tests(&self) -> String {
        let code = self.only(Kind::Code);
        let mut bytes = code.clone().into_bytes();
        for found in regex(r"#\[(?:cfg\((?:all\()?(?:test|doctest)\b[^\]]*\)|test)\]").find_iter(&code) {
            let end = item_end(&code, found.end());
            bytes[found.start()..end].iter_mut().filter(|byte| **byte != b'\n').for_each(|byte| *byte = b' ');
        }
        String::from_utf8(bytes).expect("whole items are blanked")
    }
}

/// What begins at a place, and its bytes.
fn token(text: &str, at: usize) -> (Kind, usize) {
    let rest = &text[at..];
    let in_word = text[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_');
    if rest.starts_with("//") {
        return (Kind::Comment, rest.find('\n').unwrap_or(rest.len()));
    }
    if rest.starts_with("/*") {
        return (Kind::Comment, block_comment(rest));
    }
    if !in_word && let Some(len) = raw_string(rest) {
        return (Kind::Literal, len);
    }
    match rest.as_bytes()[0] {
        b'"' => (Kind::Literal, quoted(rest, '"')),
        b'\'' => character(rest).map_or((Kind::Code, 1), |len| (Kind::Literal, len)),
        _ => (Kind::Code, rest.chars().next().map_or(1, char::len_utf8)),
    }
}

fn block_comment(rest: &str) -> usize {
    let (mut depth, mut at) = (0, 0);
    while at < rest.len() {
        let here = &rest.as_bytes()[at..];
        if here.starts_with(b"/*") {
            depth += 1;
            at += 2;
        } else if here.starts_with(b"*/") {
            depth -= 1;
            at += 2;
            if depth == 0 {
                return at;
            }
        } else {
            at += 1;
        }
    }
    rest.len()
}

/// A raw string, with or without `b` or `c`.
fn raw_string(rest: &str) -> Option<usize> {
    let prefix = ["r", "br", "cr"].into_iter().find(|prefix| {
        rest.strip_prefix(prefix).is_some_and(|rest| rest.trim_start_matches('#').starts_with('"'))
    })?;
    let hashes = rest[prefix.len()..].bytes().take_while(|&byte| byte == b'#').count();
    let start = prefix.len() + hashes + 1;
    let end = format!("\"{}", "#".repeat(hashes));
    Some(rest[start..].find(&end).map_or(rest.len(), |len| start + len + end.len()))
}

/// Bytes up to the closing quote, which a backslash escapes.
fn quoted(rest: &str, quote: char) -> usize {
    let mut escaped = false;
    for (at, c) in rest.char_indices().skip(1) {
        if !escaped && c == quote {
            return at + 1;
        }
        escaped = !escaped && c == '\\';
    }
    rest.len()
}

/// A character; `None` for a lifetime.
fn character(rest: &str) -> Option<usize> {
    let mut chars = rest.chars().skip(1);
    let first = chars.next()?;
    if first == '\\' || chars.next() == Some('\'') { Some(quoted(rest, '\'')) } else { None }
}

/// Where the item after an attribute ends.
fn item_end(code: &str, from: usize) -> usize {
    let mut at = from;
    // Further attributes are the item's.
    while code[at..].trim_start().starts_with("#[") {
        let open = at + code[at..].find('[').expect("it starts with one");
        at = closing(code, open) + 1;
    }
    while let Some(found) = code[at..].find(['(', '[', '{', '}', ';']) {
        let place = at + found;
        match code.as_bytes()[place] {
            b'{' => return (closing(code, place) + 1).min(code.len()),
            b';' => return place + 1,
            b'}' => return place,
            _ => at = (closing(code, place) + 1).min(code.len()),
        }
    }
    code.len()
}

/// A function's name, and the lines from its signature to its closing brace.
#[derive(Debug, PartialEq, Eq)]
pub struct Function {
    pub name: String,
    pub first: usize,
    pub last: usize,
}

/// The functions of some code that have a body.
pub fn functions(code: &str) -> Vec<Function> {
    let mut functions = Vec::new();
    for found in regex(r"\bfn\s+(\w+)").captures_iter(code) {
        let whole = found.get(0).expect("the whole match");
        let mut at = whole.end();
        while let Some(next) = code[at..].find(['(', '[', '{', ';']) {
            let place = at + next;
            match code.as_bytes()[place] {
                b';' => break,
                b'{' => {
                    let line = |at| super::text::line_of(code, at);
                    let (first, last) = (line(whole.start()), line(closing(code, place).min(code.len() - 1)));
                    functions.push(Function { name: found[1].to_string(), first, last });
                    break;
                }
                _ => at = (closing(code, place) + 1).min(code.len()),
            }
        }
    }
    functions
}

#[test]
fn strings_comments_and_lifetimes_are_told_apart() {
    let text =
        "let a: &'a str = \"// no\"; // yes \"x\"\nlet c = '\"'; /* /* in */ out */ r#\"}\"#; '\\'' b'{'";
    let source = Source::of(text);
    let code = source.only(Kind::Code);
    assert!(code.contains("&'a str =") && !code.contains(['"', '}', '{']), "{code}");
    assert_eq!(source.comment_lines()[0], (1, "yes \"x\"".into()));
    assert!(source.only(Kind::Comment).contains("/* /* in */ out */"));
    assert!(source.only(Kind::Literal).contains("// no"));
    assert_eq!(code.len(), text.len());
}

#[test]
fn what_only_tests_compile_is_left_out() {
    let text = "use a;\n#[cfg(test)]\n#[path = \"x\"]\nmod tests {\n use b; }\nuse c;\n#[cfg(all(test, unix))]\n\
                use d::{e};\nfn f() {}\n#[test]\nfn g(x: [u8; 2]) { h() }\nuse i;";
    let code = Source::of(text).code_without_tests();
    assert!(["use a", "use c", "fn f", "use i"].iter().all(|part| code.contains(part)), "{code}");
    assert!(!["use b", "use d", "fn g"].iter().any(|part| code.contains(part)), "{code}");
}

#[test]
fn functions_have_names_and_lines() {
    let code = "trait T {\n fn declared(&self) -> [u8; 2];\n fn given(&self) {\n  if x {\n }\n }\n}\n\
                fn last<T>()\nwhere\nT: Copy,\n{\n}";
    let found = functions(code);
    let lines: Vec<_> = found.iter().map(|f| (f.name.as_str(), f.first, f.last)).collect();
    assert_eq!(lines, [("given", 3, 6), ("last", 8, 12)]);
}
