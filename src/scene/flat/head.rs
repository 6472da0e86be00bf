//! The first bytes of a flat scene.

use super::{FlatError, VERSION};
use std::io::{ErrorKind, Read};

/// First bytes of a flat scene. The line break shows whether the file was changed as a text.
const MAGIC: [u8; 8] = *b"RSFLAT\r\n";

/// Bytes of the head, the hash at its end included.
pub const BYTES: usize = 64;
/// Bytes of the head that are hashed.
const HASHED: usize = 48;

/// The head.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Head {
    /// The number of arrays.
    pub arrays: u32,
    /// Bytes of the whole file.
    pub length: u64,
    /// Triangles of the scene.
    pub triangles: u64,
}

impl Head {
    /// The bytes before the hash.
    pub fn hashed(&self) -> [u8; HASHED] {
        let mut bytes = [0; HASHED];
        bytes[..8].copy_from_slice(&MAGIC);
        bytes[8..12].copy_from_slice(&VERSION.to_le_bytes());
        bytes[12..16].copy_from_slice(&self.arrays.to_le_bytes());
        bytes[16..24].copy_from_slice(&self.length.to_le_bytes());
        bytes[24..32].copy_from_slice(&self.triangles.to_le_bytes());
        bytes
    }

    /// All bytes.
    pub fn to_bytes(self, hash: u128) -> [u8; BYTES] {
        let mut bytes = [0; BYTES];
        bytes[..HASHED].copy_from_slice(&self.hashed());
        bytes[HASHED..].copy_from_slice(&hash.to_le_bytes());
        bytes
    }

    /// The head of a file of this length, and the hash that it names.
    pub fn read(file: &mut impl Read, length: u64) -> Result<(Self, u128), FlatError> {
        let mut bytes = [0; BYTES];
        file.read_exact(&mut bytes).map_err(|error| match error.kind() {
            ErrorKind::UnexpectedEof => FlatError::Kind,
            _ => error.into(),
        })?;
        if bytes[..8] != MAGIC {
            return Err(FlatError::Kind);
        }
        let word = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        let long = |at: usize| u64::from(word(at)) | u64::from(word(at + 4)) << 32;
        if word(8) != VERSION {
            return Err(FlatError::Version { found: word(8) });
        }
        let head = Self { arrays: word(12), length: long(16), triangles: long(24) };
        if bytes[..HASHED] != head.hashed() {
            return Err(FlatError::damaged("bytes of its head are not 0"));
        }
        if head.length != length {
            return Err(FlatError::damaged(format!("it has {length} bytes in place of {}", head.length)));
        }
        let hash = u128::from(long(HASHED)) | u128::from(long(HASHED + 8)) << 64;
        Ok((head, hash))
    }
}
