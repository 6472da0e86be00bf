//! Reads the header of a PLY file.

use super::super::{LoadProblem, quote};
use std::path::Path;

/// The encoding of the rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// The type of a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Kind {
    fn named(name: &str) -> Result<Self, String> {
        Ok(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return Err(format!("{} is not a type of PLY", quote(name))),
        })
    }

    /// Size in a binary file.
    pub(super) fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The value of full light in a colour of this type. Colours of 32-bit integers are bytes in longer words.
    pub(super) fn full_scale(self) -> f64 {
        match self {
            Self::I8 | Self::U8 | Self::I32 | Self::U32 => 255.0,
            Self::I16 | Self::U16 => 65_535.0,
            Self::F32 | Self::F64 => 1.0,
        }
    }

    fn is_integer(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }
}

/// The form of a property: a number or a list.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Form {
    Scalar(Kind),
    List { count: Kind, item: Kind },
}

/// A column of an element's rows.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) form: Form,
}

/// A table of rows.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Element {
    pub(super) name: String,
    /// Number of rows.
    pub(super) count: usize,
    pub(super) properties: Vec<Property>,
}

/// The contents of the header.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
    /// Length of the header in bytes.
    pub(super) length: usize,
}

impl Header {
    /// Parses the lines up to `end_header`.
    ///
    /// # Errors
    /// The line, and what is wrong with it.
    pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<Self, LoadProblem> {
        let file = |problem: &str| LoadProblem::File { path: path.to_owned(), problem: problem.to_owned() };
        let mut encoding = None;
        let mut elements = Vec::new();
        let mut at = 0;
        for number in 1.. {
            let end = bytes[at..].iter().position(|&b| b == b'\n');
            let line = String::from_utf8_lossy(&bytes[at..end.map_or(bytes.len(), |end| at + end)]);
            let line = line.trim();
            if number == 1 && line != "ply" {
                return Err(file("not a PLY file: its first line is not \"ply\""));
            }
            let Some(end) = end else {
                return Err(file("truncated: the header has no line \"end_header\""));
            };
            at += end + 1;
            if line == "end_header" {
                break;
            }
            statement(line, &mut encoding, &mut elements).map_err(|problem| LoadProblem::Line {
                path: path.to_owned(),
                line: number,
                problem,
            })?;
        }
        let encoding = encoding.ok_or_else(|| file("the header has no line \"format\""))?;
        Ok(Self { encoding, elements, length: at })
    }
}

fn statement(line: &str, encoding: &mut Option<Encoding>, elements: &mut Vec<Element>) -> Result<(), String> {
    let words: Vec<&str> = line.split_ascii_whitespace().collect();
    match words[..] {
        [] | ["ply" | "comment" | "obj_info", ..] => {}
        ["format", form, version] => {
            *encoding = Some(match form {
                "ascii" => Encoding::Ascii,
                "binary_little_endian" => Encoding::LittleEndian,
                "binary_big_endian" => Encoding::BigEndian,
                _ => return Err(format!("{} is not a format of PLY", quote(form))),
            });
            if version != "1.0" {
                return Err(format!("PLY version {}; 1.0 is supported", quote(version)));
            }
        }
        ["element", name, count] => {
            let count = count.parse().map_err(|_| format!("{} is not a number of rows", quote(count)))?;
            elements.push(Element { name: name.to_owned(), count, properties: Vec::new() });
        }
        ["property", ref form @ .., name] => {
            let form = match form {
                ["list", count, item] => {
                    let (count, item) = (Kind::named(count)?, Kind::named(item)?);
                    if !count.is_integer() {
                        return Err("the length of a list must be an integer".into());
                    }
                    Form::List { count, item }
                }
                [kind] => Form::Scalar(Kind::named(kind)?),
                _ => return Err(format!("{} is not a property", quote(line))),
            };
            let element = elements.last_mut().ok_or("a property before the first element")?;
            element.properties.push(Property { name: name.to_owned(), form });
        }
        _ => return Err(format!("{} is not a statement of a PLY header", quote(line))),
    }
    Ok(())
}
