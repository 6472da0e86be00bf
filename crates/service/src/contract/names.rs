//! Names that come from the other side: of files, scenes, workers. Each is checked before it is used.

use std::path::{Component, Path, PathBuf};

/// The most bytes of a name.
pub const NAME_BYTES: usize = 64;

/// The most bytes of a sentence in a message.
pub const TEXT_BYTES: usize = 1000;

/// True if a text is a SHA-256 in lower-case hexadecimal digits. No other text becomes a name of a folder.
pub fn is_sha256(text: &str) -> bool {
    text.len() == 64 && text.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'))
}

/// The path of a name in a folder, unless it leads out of it.
pub fn inside(folder: &Path, name: &str) -> Option<PathBuf> {
    entry_name(name).map(|name| folder.join(name))
}

/// A name of a file in any folder, unless it leads out of it.
pub fn entry_name(name: &str) -> Option<PathBuf> {
    let name = PathBuf::from(name.replace('\\', "/"));
    let is_plain = |part: Component<'_>| matches!(part, Component::Normal(_) | Component::CurDir);
    let is_inside = name.components().next().is_some() && name.components().all(is_plain);
    is_inside.then_some(name)
}

/// True if a text is a name: of a worker, a machine, a job, a key.
pub fn is_name(text: &str) -> bool {
    !text.is_empty() && text.len() <= NAME_BYTES && !text.chars().any(char::is_control)
}

/// A sentence of the other side as it may stand in a log: one line, and not too long.
pub fn sentence(text: &str) -> String {
    let short: String = text.chars().take(TEXT_BYTES).collect();
    short.chars().map(|char| if char.is_control() { ' ' } else { char }).collect()
}
