//! Reads the numbers after a PLY header, one after another.

use super::super::quote;
use super::header::{Element, Encoding, Form, Header, Kind};

/// A position in the rows of a file.
pub(super) struct Values<'a> {
    bytes: &'a [u8],
    /// Offset of the next byte.
    at: usize,
    encoding: Encoding,
}

impl<'a> Values<'a> {
    /// Begins at the first row of the file `bytes`.
    pub(super) fn new(bytes: &'a [u8], header: &Header) -> Self {
        Self { bytes, at: header.length, encoding: header.encoding }
    }

    /// The line, from 1, of the last value read. `None` in binary files.
    pub(super) fn line(&self) -> Option<usize> {
        let is_ascii = self.encoding == Encoding::Ascii;
        is_ascii.then(|| self.bytes[..self.at].iter().filter(|&&b| b == b'\n').count() + 1)
    }

    /// Checks that the rest of the file can contain the rows of an element, before memory is allocated for them.
    ///
    /// # Errors
    /// When the rest of the file is shorter than the shortest possible rows.
    pub(super) fn check_room(&self, element: &Element) -> Result<(), String> {
        if element.properties.is_empty() && element.count > 0 {
            return Err(format!("{} rows without any property", element.count));
        }
        let shortest = |form: &Form| match (self.encoding, form) {
            // A digit and a space. The last value may lack the space.
            (Encoding::Ascii, _) => 2,
            (_, Form::Scalar(kind) | Form::List { count: kind, .. }) => kind.bytes(),
        };
        let row: usize = element.properties.iter().map(|p| shortest(&p.form)).sum();
        let left = self.bytes.len() - self.at + usize::from(self.encoding == Encoding::Ascii);
        match element.count.checked_mul(row) {
            Some(needed) if needed <= left => Ok(()),
            _ => Err(format!(
                "{} rows of at least {row} bytes are promised, but {left} bytes are left; the file is \
                 truncated",
                element.count
            )),
        }
    }

    /// Reads the next number.
    ///
    /// # Errors
    /// When the file ends or, in an ASCII file, the next word is not a number of that type.
    pub(super) fn number(&mut self, kind: Kind) -> Result<f64, String> {
        if self.encoding == Encoding::Ascii {
            return self.word(kind);
        }
        let size = kind.bytes();
        let Some(raw) = self.bytes.get(self.at..self.at + size) else { return Err(self.truncated()) };
        self.at += size;
        let mut b = [0; 8];
        b[..size].copy_from_slice(raw);
        if self.encoding == Encoding::BigEndian {
            b[..size].reverse();
        }
        let [b0, b1, b2, b3, ..] = b;
        Ok(match kind {
            Kind::I8 => f64::from(b0 as i8),
            Kind::U8 => f64::from(b0),
            Kind::I16 => f64::from(i16::from_le_bytes([b0, b1])),
            Kind::U16 => f64::from(u16::from_le_bytes([b0, b1])),
            Kind::I32 => f64::from(i32::from_le_bytes([b0, b1, b2, b3])),
            Kind::U32 => f64::from(u32::from_le_bytes([b0, b1, b2, b3])),
            Kind::F32 => f64::from(f32::from_le_bytes([b0, b1, b2, b3])),
            Kind::F64 => f64::from_le_bytes(b),
        })
    }

    /// Appends the integers of a list to `out`.
    ///
    /// # Errors
    /// The errors of [`Values::number`]. Also when an item is not an integer, or the property is not a list.
    pub(super) fn list(&mut self, form: &Form, out: &mut Vec<i64>) -> Result<(), String> {
        let Form::List { count, item } = *form else { return Err("vertex_indices is not a list".into()) };
        for _ in 0..self.length(count)? {
            let value = self.number(item)?;
            if value.fract() != 0.0 {
                return Err(format!("{value} is not an index"));
            }
            out.push(value as i64);
        }
        Ok(())
    }

    /// Skips a property.
    ///
    /// # Errors
    /// The errors of [`Values::number`].
    pub(super) fn skip(&mut self, form: &Form) -> Result<(), String> {
        match *form {
            Form::Scalar(kind) => self.number(kind).map(drop),
            Form::List { count, item } => {
                (0..self.length(count)?).try_for_each(|_| self.number(item).map(drop))
            }
        }
    }

    /// Reads the length of a list.
    fn length(&mut self, kind: Kind) -> Result<u64, String> {
        let length = self.number(kind)?;
        if length < 0.0 { Err(format!("a list of {length} items")) } else { Ok(length as u64) }
    }

    fn word(&mut self, kind: Kind) -> Result<f64, String> {
        let rest = &self.bytes[self.at..];
        let Some(start) = rest.iter().position(|b| !b.is_ascii_whitespace()) else {
            return Err(self.truncated());
        };
        let rest = &rest[start..];
        let end = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        self.at += start + end;
        let text = std::str::from_utf8(&rest[..end]).unwrap_or("?");
        // Parsed as a float of its own type, so that it is rounded once.
        let value = match kind {
            Kind::F32 => text.parse::<f32>().map(f64::from),
            _ => text.parse::<f64>(),
        };
        value.map_err(|_| format!("{} is not a number", quote(&String::from_utf8_lossy(&rest[..end]))))
    }

    fn truncated(&self) -> String {
        format!("the file ends here, after {} bytes; it is truncated", self.bytes.len())
    }
}
