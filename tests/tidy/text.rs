//! Lines, and places in them.

use regex::Regex;
use std::collections::HashMap;
use std::sync::{LazyLock, Mutex};

/// A pattern of these rules. Compiled once and kept to the end of the program, since rules use it at each line.
pub fn regex(pattern: &str) -> &'static Regex {
    static COMPILED: LazyLock<Mutex<HashMap<String, &Regex>>> = LazyLock::new(Mutex::default);
    let mut compiled = COMPILED.lock().expect("no pattern is wrong");
    let compile = || &*Box::leak(Box::new(Regex::new(pattern).unwrap_or_else(|error| panic!("{error}"))));
    compiled.entry(pattern.to_string()).or_insert_with(compile)
}

/// The line of a place, counted from 1.
pub fn line_of(text: &str, at: usize) -> usize {
    1 + text.as_bytes()[..at].iter().filter(|&&byte| byte == b'\n').count()
}

/// Where the bracket at `open` closes; the end of the text where it does not.
pub fn closing(text: &str, open: usize) -> usize {
    let mut depth = 0;
    for (at, byte) in text.bytes().enumerate().skip(open) {
        match byte {
            b'(' | b'[' | b'{' => depth += 1,
            b')' | b']' | b'}' => depth -= 1,
            _ => continue,
        }
        if depth == 0 {
            return at;
        }
    }
    text.len()
}

/// A document's lines as one running text, so that phrases are found across line breaks.
#[derive(Debug, Default)]
pub struct Running {
    /// The lines, trimmed, with one space between them.
    pub text: String,
    /// Where each begins in `text`, and its number.
    starts: Vec<(usize, usize)>,
}

impl Running {
    /// Of these lines with their numbers; where numbers do not follow each other, a line break stays.
    pub fn of<'a>(lines: impl IntoIterator<Item = (usize, &'a str)>) -> Self {
        let mut running = Self::default();
        for (number, line) in lines {
            if let Some(&(_, last)) = running.starts.last() {
                running.text.push(if number == last + 1 { ' ' } else { '\n' });
            }
            running.starts.push((running.text.len(), number));
            running.text.push_str(line.trim());
        }
        running
    }

    /// The line of a place in the running text.
    pub fn line_of(&self, at: usize) -> usize {
        let next = self.starts.partition_point(|&(start, _)| start <= at);
        next.checked_sub(1).map_or(1, |index| self.starts[index].1)
    }
}

#[test]
fn phrases_are_found_across_lines() {
    let running = Running::of([(3, "  keeps three "), (4, "frames in flight"), (9, "others")]);
    assert_eq!(running.text, "keeps three frames in flight\nothers");
    let at = running.text.find("frames").unwrap();
    assert_eq!((running.line_of(0), running.line_of(at), running.line_of(running.text.len())), (3, 4, 9));
}

#[test]
fn brackets_close_where_they_nest() {
    let text = "f(a[1], {b}) + (c)";
    assert_eq!(closing(text, 1), 11);
    assert_eq!(closing("f((", 1), 3);
}
