//! Reads the bytes of a glTF document: external files, data URIs, and GLB's binary chunk.

use super::super::session::Session;
use super::super::{LoadProblem, named};
use super::{draco, meshopt};
use ::gltf::accessor::{Accessor, DataType};
use ::gltf::buffer::{Source, View};
use ::gltf::{Document, json};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// All buffers, each at least as long as the document says, and what was compressed in them.
#[derive(Default)]
pub(super) struct Buffers {
    list: Vec<Buffer>,
    /// A GLB file; empty if there is no binary chunk.
    file: Vec<u8>,
    /// The decompressed bytes of buffer views, by their index.
    views: BTreeMap<usize, Vec<u8>>,
    /// The decompressed elements of accessors, by their index.
    accessors: BTreeMap<usize, Decompressed>,
}

/// The bytes of a buffer.
enum Buffer {
    Own(Vec<u8>),
    /// They lie there in the GLB file.
    InFile(Range<usize>),
}

/// The elements of an accessor that a compressed mesh holds, without gaps.
pub(super) struct Decompressed {
    pub(super) kind: DataType,
    pub(super) bytes: Vec<u8>,
}

impl Buffers {
    /// Reads the buffers that a document names. The binary chunk stays where it is in the file.
    ///
    /// # Errors
    /// When a buffer is missing, cannot be read, or is too short.
    pub(super) fn read(
        session: &mut Session,
        document: &Document,
        file: Vec<u8>,
        binary: Option<Range<usize>>,
    ) -> Result<Self, LoadProblem> {
        let path = session.path.clone();
        let sizes = document.buffers().map(|buffer| buffer.length() as u64);
        let all = sizes.fold(0, u64::saturating_add);
        session.check("the sum of its buffers", all).map_err(|source| session.over(source))?;
        let file = if binary.is_some() { file } else { Vec::new() };
        let mut buffers = Self { file, ..Self::default() };
        let are_compressed = meshopt::are_compressed(document);
        for buffer in document.buffers() {
            let binary = binary.clone().filter(|_| buffer.index() == 0);
            let has_bytes = matches!(buffer.source(), Source::Uri(_)) || binary.is_some();
            if meshopt::is_fallback(&buffer) || (!has_bytes && are_compressed[buffer.index()]) {
                buffers.list.push(Buffer::Own(Vec::new()));
                continue;
            }
            let place = |problem| LoadProblem::Place {
                path: path.clone(),
                place: format!("buffers[{}]", buffer.index()),
                problem,
            };
            let found = match buffer.source() {
                Source::Bin => binary
                    .map(Buffer::InFile)
                    .ok_or_else(|| place("has no URI, and the file has no binary chunk for it".into()))?,
                Source::Uri(uri) => Buffer::Own(match locate(&path, uri).map_err(place)? {
                    Location::Data(bytes) => bytes,
                    Location::File(file) => {
                        let read = session.read_named(&file, buffer.length() as u64);
                        read.map_err(|problem| place(problem.to_string()))?
                    }
                }),
            };
            let length = buffers.bytes_of(&found).len();
            if length < buffer.length() {
                return Err(place(format!(
                    "should have {} bytes but has {length}; the file is truncated",
                    buffer.length()
                )));
            }
            buffers.list.push(found);
        }
        buffers.views = meshopt::decompress(session, document, &buffers)?;
        buffers.accessors = draco::decompress(session, document, &buffers)?;
        Ok(buffers)
    }

    /// Bytes of all that is held.
    pub(super) fn bytes(&self) -> u64 {
        let own = |buffer: &Buffer| match buffer {
            Buffer::Own(bytes) => bytes.len(),
            Buffer::InFile(_) => 0,
        };
        let list: usize = self.list.iter().map(own).sum();
        let views: usize = self.views.values().map(Vec::len).sum();
        let accessors: usize = self.accessors.values().map(|of| of.bytes.len()).sum();
        (self.file.len() + list + views + accessors) as u64
    }

    fn bytes_of<'a>(&'a self, buffer: &'a Buffer) -> &'a [u8] {
        match buffer {
            Buffer::Own(bytes) => bytes,
            Buffer::InFile(place) => &self.file[place.clone()],
        }
    }

    /// The elements of an accessor that a compressed mesh holds.
    pub(super) fn decompressed(&self, accessor: &Accessor) -> Option<&Decompressed> {
        self.accessors.get(&accessor.index())
    }

    /// The bytes of a buffer view.
    ///
    /// # Errors
    /// When the view exceeds its buffer.
    pub(super) fn view(&self, view: &View) -> Result<&[u8], String> {
        match self.views.get(&view.index()) {
            Some(bytes) => Ok(bytes),
            None => self
                .slice(view.buffer().index(), view.offset(), view.length())
                .map_err(|problem| format!("bufferViews[{}] {problem}", view.index())),
        }
    }

    /// `length` bytes of a buffer.
    ///
    /// # Errors
    /// A sentence about who asks for them, when they are not there.
    pub(super) fn slice(&self, buffer: usize, start: usize, length: usize) -> Result<&[u8], String> {
        let found =
            self.list.get(buffer).ok_or_else(|| format!("names buffers[{buffer}], which does not exist"))?;
        let bytes = self.bytes_of(found);
        start.checked_add(length).and_then(|end| bytes.get(start..end)).ok_or_else(|| {
            format!("has {length} bytes at offset {start}, but buffers[{buffer}] has {} bytes", bytes.len())
        })
    }
}

/// A whole number in an extension. `unset` if it is not there.
///
/// # Errors
/// When it is no number that this machine can address.
pub(super) fn number(extension: &json::Value, key: &str, unset: Option<usize>) -> Result<usize, String> {
    let value = &extension[key];
    if let (true, Some(unset)) = (value.is_null(), unset) {
        return Ok(unset);
    }
    let number = value.as_u64().and_then(|number| usize::try_from(number).ok());
    number.ok_or_else(|| format!("has no valid {key}: {value}"))
}

/// Target of a URI.
pub(super) enum Location {
    /// An external file.
    File(PathBuf),
    /// The decoded bytes of a data URI.
    Data(Vec<u8>),
}

/// Resolves a URI: a data URI, or a percent-encoded path relative to `file`.
///
/// # Errors
/// When the URI has another scheme, or its data is not base64.
pub(super) fn locate(file: &Path, uri: &str) -> Result<Location, String> {
    if let Some(data) = uri.strip_prefix("data:") {
        let Some((header, payload)) = data.split_once(',') else {
            return Err("a data URI without a comma".into());
        };
        return match header.rsplit(';').next() {
            Some("base64") => base64(payload).map(Location::Data),
            _ => Ok(Location::Data(percent_decode(payload))),
        };
    }
    if let Some((scheme, _)) = uri.split_once("://")
        && scheme != "file"
    {
        return Err(format!("its URI has the scheme {scheme:?}; only files and data URIs are supported"));
    }
    let uri = uri.strip_prefix("file://").unwrap_or(uri);
    let decoded = String::from_utf8_lossy(&percent_decode(uri)).into_owned();
    // Some exporters do not encode. In that case the URI itself is the file name.
    let unescaped = named::beside(file, uri);
    let path = if unescaped.is_file() { unescaped } else { named::beside(file, &decoded) };
    Ok(Location::File(named::in_any_case(&path).unwrap_or(path)))
}

/// Decodes `%41` to `A`. An invalid escape sequence stays as it is.
fn percent_decode(text: &str) -> Vec<u8> {
    let bytes = text.as_bytes();
    let digit = |at: usize| bytes.get(at).and_then(|&b| char::from(b).to_digit(16));
    let mut out = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while at < bytes.len() {
        if let (b'%', Some(high), Some(low)) = (bytes[at], digit(at + 1), digit(at + 2)) {
            out.push((high * 16 + low) as u8);
            at += 3;
        } else {
            out.push(bytes[at]);
            at += 1;
        }
    }
    out
}

/// Decodes base64 (RFC 4648, either alphabet), with or without padding. White space is ignored.
fn base64(text: &str) -> Result<Vec<u8>, String> {
    let mut out = Vec::with_capacity(text.len() / 4 * 3);
    let mut bits = 0_u32;
    let mut count = 0;
    for byte in text.trim_end_matches('=').bytes() {
        let value = match byte {
            b'A'..=b'Z' => byte - b'A',
            b'a'..=b'z' => byte - b'a' + 26,
            b'0'..=b'9' => byte - b'0' + 52,
            b'+' | b'-' => 62,
            b'/' | b'_' => 63,
            b' ' | b'\t' | b'\r' | b'\n' => continue,
            _ => {
                return Err(format!(
                    "a data URI contains {:?}, which is not a character of base64",
                    char::from(byte)
                ));
            }
        };
        bits = bits << 6 | u32::from(value);
        count += 6;
        if count >= 8 {
            count -= 8;
            out.push((bits >> count) as u8);
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_and_percent_encoding_decode() {
        assert_eq!(base64("SGVsbG8h").expect("valid"), b"Hello!");
        assert_eq!(base64("SGVsbG8=").expect("padded"), b"Hello");
        assert_eq!(base64("SGVs\nbG8").expect("bare"), b"Hello");
        assert_eq!(base64("_-8").expect("URL alphabet"), [0xff, 0xef]);
        assert!(base64("SG*s").is_err());
        assert_eq!(percent_decode("a%20b%zz%4"), b"a b%zz%4");
    }
}
