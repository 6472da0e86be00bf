//! Numbers in documents that are constants in the code say the same.
//!
//! [`PINS`] lists phrases of documents and comments with `{n}` where the number stands, and where its value comes from.
//! A phrase is looked for everywhere, so it may move; if it is gone, its pin goes too. Numbers may be written `16384`,
//! `16 384`, `16,384`, `16k` (1024 each), `2¹⁴`, `130 million`, `sixteen`, `a twentieth`.

use super::breach::Breach;
use super::pins::PINS;
use super::rust::Source;
use super::text::{Running, line_of, regex};
use super::tree::{Tree, is_history};
use raystream::picture::Registry;
use raystream_cli::command;
use std::collections::BTreeSet;

/// Pages that tell what was measured, with the numbers of their day.
const RESULTS: &str = "docs/results/";
/// Where the pins are.
const HERE: &str = "tests/tidy/pins.rs";

/// Where a number comes from.
pub enum Value {
    /// The program itself says it.
    Is(fn() -> f64),
    /// A constant of the sources below a folder.
    Constant(&'static str, &'static str),
    /// What a pattern finds in a file: an expression.
    Expression(&'static str, &'static str),
    /// The default of an option of a command.
    Default(&'static str, &'static str),
}

/// Digits, or a word for a number.
fn number_pattern() -> String {
    let words: Vec<&str> = WORDS.iter().map(|(word, _)| *word).collect();
    let digits = r"\d{1,3}(?:[ ,\u{a0}\u{202f}]\d{3})+|2[⁰¹²³⁴-⁹]+|\d+(?:\.\d+)?";
    format!(r"((?:{digits})(?:[kM]\b| million\b)?|(?:{})\b)", words.join("|"))
}

const WORDS: [(&str, f64); 33] = [
    ("one", 1.0),
    ("two", 2.0),
    ("three", 3.0),
    ("four", 4.0),
    ("five", 5.0),
    ("six", 6.0),
    ("seven", 7.0),
    ("eight", 8.0),
    ("nine", 9.0),
    ("ten", 10.0),
    ("eleven", 11.0),
    ("twelve", 12.0),
    ("sixteen", 16.0),
    ("twenty", 20.0),
    ("thirty", 30.0),
    ("thirty-two", 32.0),
    ("sixty-four", 64.0),
    ("a hundred", 100.0),
    ("a thousand", 1000.0),
    ("once", 1.0),
    ("twice", 2.0),
    ("half", 1.0 / 2.0),
    ("a third", 1.0 / 3.0),
    ("a quarter", 1.0 / 4.0),
    ("a fifth", 1.0 / 5.0),
    ("a sixth", 1.0 / 6.0),
    ("an eighth", 1.0 / 8.0),
    ("a tenth", 1.0 / 10.0),
    ("a twelfth", 1.0 / 12.0),
    ("a sixteenth", 1.0 / 16.0),
    ("a twentieth", 1.0 / 20.0),
    ("a fiftieth", 1.0 / 50.0),
    ("a hundredth", 1.0 / 100.0),
];

/// What a number in a document says.
fn number(text: &str) -> f64 {
    if let Some((_, value)) = WORDS.iter().find(|(word, _)| word.eq_ignore_ascii_case(text)) {
        return *value;
    }
    if let Some(exponent) = text.strip_prefix('2').and_then(raised) {
        return f64::from(exponent).exp2();
    }
    let units = [("k", 1024.0), ("M", 1_048_576.0), ("million", 1e6)];
    let factor = units.iter().find(|(unit, _)| text.ends_with(unit)).map_or(1.0, |(_, factor)| *factor);
    let digits: String = text.chars().filter(|c| c.is_ascii_digit() || *c == '.').collect();
    digits.parse().map_or(f64::NAN, |value: f64| value * factor)
}

/// An exponent in raised digits.
fn raised(text: &str) -> Option<u32> {
    let digit = |c| "⁰¹²³⁴⁵⁶⁷⁸⁹".chars().position(|other| other == c);
    let digits: Option<Vec<usize>> = text.chars().map(digit).collect();
    digits
        .filter(|digits| !digits.is_empty())
        .map(|digits| digits.iter().fold(0, |sum, d| 10 * sum + *d as u32))
}

/// The value of an expression of constants: numbers, `+ - * / <<`, durations in seconds, and constants of the same
/// text.
struct Calculation<'a> {
    words: Vec<String>,
    at: usize,
    code: &'a str,
}

impl<'a> Calculation<'a> {
    fn evaluate(expression: &str, code: &'a str) -> Option<f64> {
        let words =
            regex(r"0[xb][0-9a-fA-F_]+|\d[\d_]*(?:\.\d[\d_]*)?(?:e[+-]?\d+)?|[A-Za-z_][\w:]*|<<|[-+*/()]");
        let words = words.find_iter(expression).map(|word| word.as_str().to_string()).collect();
        let mut whole = Self { words, at: 0, code };
        let value = whole.shift()?;
        (whole.at == whole.words.len()).then_some(value)
    }

    fn next_is(&mut self, operators: &[&str]) -> Option<String> {
        let word = self.words.get(self.at).filter(|word| operators.contains(&word.as_str())).cloned();
        self.at += usize::from(word.is_some());
        word
    }

    fn shift(&mut self) -> Option<f64> {
        let mut value = self.sum()?;
        while self.next_is(&["<<"]).is_some() {
            value *= self.sum()?.exp2();
        }
        Some(value)
    }

    fn sum(&mut self) -> Option<f64> {
        let mut value = self.product()?;
        while let Some(operator) = self.next_is(&["+", "-"]) {
            let other = self.product()?;
            value += if operator == "+" { other } else { -other };
        }
        Some(value)
    }

    fn product(&mut self) -> Option<f64> {
        let mut value = self.operand()?;
        while let Some(operator) = self.next_is(&["*", "/"]) {
            let other = self.operand()?;
            value *= if operator == "*" { other } else { 1.0 / other };
        }
        Some(value)
    }

    fn operand(&mut self) -> Option<f64> {
        let word = self.words.get(self.at)?.clone();
        self.at += 1;
        let value = match word.as_str() {
            "-" => -self.operand()?,
            "(" => {
                let value = self.shift()?;
                self.next_is(&[")"])?;
                value
            }
            "Duration::from_secs" | "Duration::from_secs_f64" => self.operand()?,
            "Duration::from_millis" => self.operand()? / 1e3,
            name if name.starts_with(|c: char| c.is_alphabetic()) => {
                let name = name.rsplit(':').next()?;
                let (_, expression) = constant(self.code, name)?;
                Self::evaluate(&expression, self.code)?
            }
            digits => {
                // A type after the digits is a word of its own: `1u64`.
                let value = literal(digits)?;
                let suffix = regex(r"^[iuf](8|16|32|64|128|size)$");
                self.at += usize::from(self.words.get(self.at).is_some_and(|word| suffix.is_match(word)));
                value
            }
        };
        // `as f32`
        while self.next_is(&["as"]).is_some() {
            self.at += 1;
        }
        Some(value)
    }
}

fn literal(digits: &str) -> Option<f64> {
    let digits = digits.replace('_', "");
    match digits.strip_prefix("0x") {
        Some(hexadecimal) => u64::from_str_radix(hexadecimal, 16).ok().map(|value| value as f64),
        None => digits.parse().ok(),
    }
}

/// The line and expression of a constant.
fn constant(code: &str, name: &str) -> Option<(usize, String)> {
    let found = regex(&format!(r"\b(?:const|static)\s+{name}\s*:[^=;]+=\s*([^;]+);")).captures(code)?;
    Some((line_of(code, found.get(0)?.start()), found[1].to_string()))
}

impl Value {
    /// The number, and where it stands.
    fn find(&self, tree: &Tree) -> Result<(f64, String), String> {
        match *self {
            Self::Is(value) => Ok((value(), "the program".into())),
            Self::Default(command, option) => {
                let mut whole = self::command(&Registry::built_in());
                whole.build();
                let found = whole.find_subcommand(command);
                let argument =
                    found.and_then(|command| command.get_arguments().find(|a| a.get_long() == Some(option)));
                let value = argument.and_then(|argument| argument.get_default_values().first().cloned());
                let value = value.ok_or_else(|| format!("`{command} --{option}` has no default"))?;
                Ok((number(&value.to_string_lossy()), format!("the default of `{command} --{option}`")))
            }
            Self::Constant(folder, name) => {
                let files = tree.with_extension("rs").filter(|(path, _)| path.starts_with(folder));
                let found: Vec<_> =
                    files.filter_map(|(path, text)| Some((path, text, constant(text, name)?))).collect();
                let [(path, text, (line, expression))] = found.as_slice() else {
                    return Err(format!("{} constants `{name}` below {folder}, not one", found.len()));
                };
                evaluate(path, *line, expression, text)
            }
            Self::Expression(path, pattern) => {
                let text = tree.text(path);
                let found = regex(pattern)
                    .captures(text)
                    .ok_or_else(|| format!("{path} has nothing like `{pattern}`"))?;
                let place = found.get(1).expect("a pattern of a pin has a group");
                evaluate(path, line_of(text, place.start()), place.as_str(), text)
            }
        }
    }
}

fn evaluate(path: &str, line: usize, expression: &str, text: &str) -> Result<(f64, String), String> {
    let value = Calculation::evaluate(expression, text);
    value
        .map(|value| (value, format!("{path}:{line}")))
        .ok_or_else(|| format!("{path}:{line}: `{expression}` is not understood"))
}

/// Documents and comments that are not of the past.
fn documents(tree: &Tree) -> Vec<(String, Running)> {
    let mut documents = Vec::new();
    for (path, file) in tree.files() {
        if path.starts_with("tests/tidy/") || is_history(path) || path.starts_with(RESULTS) {
            continue;
        }
        let numbered = |(index, line): (usize, &str)| (index + 1, line.to_string());
        let lines: Vec<(usize, String)> = match path.rsplit('.').next() {
            Some("md") => file.text.lines().enumerate().map(numbered).collect(),
            Some("rs" | "wgsl") => Source::of(&file.text).comment_lines(),
            _ => continue,
        };
        documents.push((path.to_string(), Running::of(lines.iter().map(|(n, line)| (*n, line.as_str())))));
    }
    documents
}

fn breaches(tree: &Tree, pins: &[(&str, Value)]) -> Vec<Breach> {
    let documents = documents(tree);
    let mut breaches = Vec::new();
    for (phrase, value) in pins {
        let at = tree.text(HERE).find(phrase).map_or(1, |at| line_of(tree.text(HERE), at));
        let (expected, place) = match value.find(tree) {
            Ok(found) => found,
            Err(what) => {
                breaches.push(Breach::new(HERE, at, format!("the pin \"{phrase}\": {what}")));
                continue;
            }
        };
        let escaped = regex::escape(phrase).replace(r"\{n\}", &number_pattern());
        let start = if phrase.starts_with("{n}") { r"\b" } else { "" };
        let pattern = regex(&format!("(?i){start}{}", escaped.replace(' ', "[ \n]")));
        let mut found = 0;
        for (path, text) in &documents {
            for said in pattern.captures_iter(&text.text) {
                found += 1;
                for says in said.iter().skip(1).flatten() {
                    if (number(says.as_str()) - expected).abs() > 1e-9 * expected.abs() {
                        let what = format!("\"{}\" of \"{phrase}\" is {expected} in {place}", says.as_str());
                        breaches.push(Breach::new(path, text.line_of(says.start()), what));
                    }
                }
            }
        }
        if found == 0 {
            let what = format!("no document says \"{phrase}\" any more: mend or remove the pin");
            breaches.push(Breach::new(HERE, at, what));
        }
    }
    breaches
}

#[test]
fn numbers_in_documents_are_those_of_the_code() {
    super::breach::assert_none("numbers", breaches(Tree::repository(), PINS));
    let phrases: BTreeSet<&str> = PINS.iter().map(|(phrase, _)| *phrase).collect();
    assert_eq!(phrases.len(), PINS.len(), "a phrase is pinned twice");
}

#[test]
fn stale_numbers_are_named() {
    let code = "//! Up to 16k\n//! paths; up to eight paths.\nconst N: usize = 2 * HALF; const HALF: u64 = 1 << 12;\n\
                fn f() { g(Duration::from_millis(1500), 0.05) }\n";
    let tree = Tree::of(&[
        ("src/a.rs", code),
        ("README.md", "Up to 8,192 paths, 1.5 seconds,\n2 seconds; darker than a twentieth.\n"),
        ("docs/lab/a.md", "up to 3 paths"),
    ]);
    let pins = [
        ("up to {n} paths", Value::Constant("src", "N")),
        ("{n} seconds", Value::Expression("src/a.rs", r"g\(([^,]+),")),
        ("than {n}.", Value::Expression("src/a.rs", r", ([\d.]+)\)")),
        ("gone: {n}", Value::Is(|| 1.0)),
        ("{n} lost", Value::Constant("src", "M")),
    ];
    let expected = [
        ("src/a.rs:1", "\"16k\" of \"up to {n} paths\" is 8192 in src/a.rs:3"),
        ("src/a.rs:2", "\"eight\" of"),
        ("README.md:2", "\"2\" of"),
        ("tests/tidy/pins.rs:1", "no document says \"gone: {n}\""),
        ("tests/tidy/pins.rs:1", "0 constants `M`"),
    ];
    super::breach::assert_named(&breaches(&tree, &pins), &expected);
}

#[test]
fn numbers_are_read_however_they_are_written() {
    let written = ["30 000", "65,536", "64k", "2²⁸", "0.05", "sixteen", "A twentieth"];
    assert_eq!(written.map(number), [30_000.0, 65_536.0, 65_536.0, 268_435_456.0, 0.05, 16.0, 0.05]);
    let code = "const A: f32 = 16.0 / (1 << 24) as f32; const B: u64 = 2 * 1_000u64 - A;";
    assert_eq!(Calculation::evaluate("B", code), Some(2000.0 - 16.0 / 16_777_216.0));
    assert_eq!(Calculation::evaluate("f(1)", code), None);
}
