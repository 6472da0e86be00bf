//! The kinds of scene files, by name or by content.

use super::{extension, off, stl};
use serde::Deserialize;
use serde::de::IgnoredAny;
use std::path::Path;

/// A kind of scene file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Obj,
    Gltf,
    Ply,
    Stl,
    Off,
    Recipe,
}

/// Members that tell the JSON of glTF from that of a recipe, which has no `asset`.
#[derive(Deserialize)]
struct Members {
    asset: Option<IgnoredAny>,
}

impl Kind {
    /// The extensions of file names, for messages.
    pub(super) const EXTENSIONS: &str = if cfg!(feature = "formats") {
        ".obj, .gltf, .glb, .ply, .stl, .off or .json"
    } else {
        ".obj, .ply, .stl or .off"
    };

    /// The kind that the extension of a file name tells, in any case of letters.
    pub(super) fn of_name(path: &Path) -> Option<Self> {
        match extension(path).as_str() {
            "obj" => Some(Self::Obj),
            "gltf" | "glb" => Some(Self::Gltf),
            "ply" => Some(Self::Ply),
            "stl" => Some(Self::Stl),
            "off" => Some(Self::Off),
            "json" => Some(Self::Recipe),
            _ => None,
        }
    }

    /// The kind that the content tells. OBJ has no mark by which it could be told.
    pub(super) fn of_content(bytes: &[u8]) -> Option<Self> {
        let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes).trim_ascii_start();
        // In a text the bytes that hold the number of triangles are letters, so its size would have to be gigabytes.
        if stl::is_binary(bytes) {
            return Some(Self::Stl);
        }
        if bytes.starts_with(b"glTF") {
            return Some(Self::Gltf);
        }
        if text.starts_with(b"{") {
            let is_gltf = match serde_json::from_slice::<Members>(text) {
                Ok(members) => members.asset.is_some(),
                // The loader says what is wrong with it.
                Err(_) => text.windows(7).any(|word| word == b"\"asset\""),
            };
            return Some(if is_gltf { Self::Gltf } else { Self::Recipe });
        }
        if text.starts_with(b"ply\n") || text.starts_with(b"ply\r") {
            return Some(Self::Ply);
        }
        if stl::is_text(text) {
            return Some(Self::Stl);
        }
        off::is_off(text).then_some(Self::Off)
    }
}
