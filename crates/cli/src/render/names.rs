//! File names of several pictures.

use anyhow::{Context, Result, ensure};
use std::path::{Path, PathBuf};

/// A pattern of file names: `%d` or `%04d` stands for a picture's number, `%s` for its name.
#[derive(Debug)]
pub struct Names(Vec<Part>);

#[derive(Debug, PartialEq)]
enum Part {
    Text(String),
    /// With at least so many digits.
    Number(usize),
    Name,
}

impl Names {
    /// Parses a pattern.
    fn new(pattern: &Path) -> Result<Self> {
        let wrong = || {
            let path = pattern.display();
            format!("{path}: write %d or %04d for a picture's number and %s for its name, and no other %")
        };
        let mut rest = pattern.to_str().with_context(wrong)?;
        let mut parts = Vec::new();
        while let Some((text, after)) = rest.split_once('%') {
            parts.push(Part::Text(text.into()));
            let end = after.find(|c: char| !c.is_ascii_digit()).with_context(wrong)?;
            let digits = &after[..end];
            let (part, length) = match after[end..].chars().next() {
                Some('d') if digits.is_empty() => (Part::Number(0), 1),
                Some('d') => (Part::Number(digits.parse().ok().filter(|&n| n <= 32).with_context(wrong)?), 1),
                Some('s') if digits.is_empty() => (Part::Name, 1),
                _ => return Err(anyhow::anyhow!(wrong())),
            };
            parts.push(part);
            rest = &after[end + length..];
        }
        parts.push(Part::Text(rest.into()));
        Ok(Self(parts))
    }

    /// The pattern of an animation's frames: one number.
    pub fn of_frames(pattern: &Path) -> Result<Self> {
        let wrong = || {
            let path = pattern.display();
            format!("{path}: the output of an animation needs a frame number in its name, as in out.%04d.png")
        };
        let names = Self::new(pattern).with_context(wrong)?;
        ensure!(names.count(|part| matches!(part, Part::Number(_))) == 1 && !names.has_name(), wrong());
        Ok(names)
    }

    /// The pattern of several cameras' pictures: a number, a name, or both.
    pub fn of_cameras(pattern: &Path) -> Result<Self> {
        let names = Self::new(pattern)?;
        ensure!(
            names.count(|part| *part != Part::Name && !matches!(part, Part::Text(_))) <= 1
                && !names.is_single(),
            "{}: the output for several cameras needs a number or a name in its name, as in out.%04d.png or out.%s.png",
            pattern.display()
        );
        Ok(names)
    }

    /// True if a file name has a place for a number or a name.
    pub fn is_pattern(path: &Path) -> bool {
        Self::new(path)
            .map_or(path.to_str().is_some_and(|text| text.contains('%')), |names| !names.is_single())
    }

    fn count(&self, is: impl Fn(&Part) -> bool) -> usize {
        self.0.iter().filter(|part| is(part)).count()
    }

    fn has_name(&self) -> bool {
        self.count(|part| *part == Part::Name) > 0
    }

    fn is_single(&self) -> bool {
        self.count(|part| !matches!(part, Part::Text(_))) == 0
    }

    /// The file of a picture. Characters of its name that no file name should have become `_`.
    pub fn of(&self, number: u32, name: &str) -> PathBuf {
        let mut text = String::new();
        for part in &self.0 {
            match part {
                Part::Text(part) => text.push_str(part),
                Part::Number(digits) => text.push_str(&format!("{number:0digits$}")),
                Part::Name => text.extend(name.chars().map(|c| if is_plain(c) { c } else { '_' })),
            }
        }
        text.into()
    }
}

/// True if file names of all systems may have a character.
fn is_plain(c: char) -> bool {
    !(c.is_control() || "/\\:*?\"<>|".contains(c))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_numbered() {
        let name = |pattern: &str| Names::of_frames(Path::new(pattern)).map(|names| names.of(7, "x"));
        assert_eq!(name("a/out.%04d.png").unwrap(), PathBuf::from("a/out.0007.png"));
        assert_eq!(name("%d.exr").unwrap(), PathBuf::from("7.exr"));
        for bad in ["out.png", "out.%04x.png", "%d.%d.png", "%99d.png", "%-3d.png", "%d.%s.png", "%"] {
            assert!(name(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn cameras_may_be_numbered_and_named() {
        let name = |pattern: &str| Names::of_cameras(Path::new(pattern)).map(|names| names.of(7, "a/b c"));
        assert_eq!(name("%03d.%s.png").unwrap(), PathBuf::from("007.a_b c.png"));
        assert_eq!(name("x/%s.png").unwrap(), PathBuf::from("x/a_b c.png"));
        for bad in ["out.png", "%3s.png", "%d.%d.png"] {
            assert!(name(bad).is_err(), "{bad}");
        }
        assert!(Names::is_pattern(Path::new("%s.png")) && !Names::is_pattern(Path::new("s.png")));
    }
}
