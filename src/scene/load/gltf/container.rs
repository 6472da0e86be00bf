//! Splits GLB files into chunks.

use super::super::{LoadProblem, extension};
use std::ops::Range;
use std::path::Path;

/// The parts of a `.gltf` or `.glb` file.
pub(super) struct Container<'a> {
    /// The JSON document.
    pub(super) json: &'a [u8],
    /// The place of GLB's binary chunk in the file.
    pub(super) binary: Option<Range<usize>>,
}

/// Splits a GLB file into its chunks. Any other file is JSON as a whole.
///
/// # Errors
/// When the file is shorter than its header says, or its first chunk is not JSON.
pub(super) fn split<'a>(path: &Path, bytes: &'a [u8]) -> Result<Container<'a>, LoadProblem> {
    if !bytes.starts_with(b"glTF") {
        if extension(path) == "glb" && !bytes.trim_ascii_start().starts_with(b"{") {
            let problem = "not a GLB file: it does not begin with \"glTF\"".into();
            return Err(LoadProblem::File { path: path.to_owned(), problem });
        }
        return Ok(Container { json: bytes, binary: None });
    }
    chunks(bytes).map_err(|problem| LoadProblem::File { path: path.to_owned(), problem })
}

fn chunks(bytes: &[u8]) -> Result<Container<'_>, String> {
    let (Some(version), Some(length)) = (word(bytes, 4), word(bytes, 8)) else {
        return Err(format!("truncated: a GLB header has 12 bytes, but the file has {}", bytes.len()));
    };
    if version != 2 {
        return Err(format!("GLB version {version}; 2 is supported"));
    }
    let end = length as usize;
    let Some(mut rest) = bytes.get(12..end) else {
        return Err(format!(
            "truncated: its header gives a length of {length} bytes, but the file has {}",
            bytes.len()
        ));
    };
    let mut json = None;
    let mut binary = None;
    while !rest.is_empty() {
        let (Some(length), Some(kind)) = (word(rest, 0), word(rest, 4)) else {
            return Err(format!("truncated: {} bytes are left where a chunk should begin", rest.len()));
        };
        let start = end - rest.len() + 8;
        let Some(data) = rest[8..].get(..length as usize) else {
            return Err(format!("truncated: a chunk of {length} bytes, but {} are left", rest.len() - 8));
        };
        match &kind.to_le_bytes() {
            b"JSON" if json.is_none() => json = Some(data),
            b"BIN\0" if binary.is_none() => binary = Some(start..start + data.len()),
            // The GLB specification requires that unknown chunks are skipped.
            _ => {}
        }
        rest = &rest[8 + data.len()..];
    }
    let json = json.ok_or("a GLB file without a JSON chunk")?;
    Ok(Container { json, binary })
}

/// The little-endian word at a byte offset.
fn word(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(at..)?.get(..4)?.try_into().ok()?))
}
