//! What films must share to be added up.

use super::Film;
use super::accumulation::{MAX_FRACTION_BITS, MIN_FRACTION_BITS};
use crate::memory::OutOfMemory;
use serde::{Deserialize, Serialize};

/// The precision of a film. Films of one size and kind can be added.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FilmKind {
    fraction_bits: u32,
}

impl FilmKind {
    /// Whether there are films of this kind.
    pub fn is_sound(&self) -> bool {
        (MIN_FRACTION_BITS..=MAX_FRACTION_BITS).contains(&self.fraction_bits)
    }

    /// A black film of this kind.
    ///
    /// # Errors
    /// If the system does not give the memory.
    pub fn film(&self, width: u32, height: u32) -> Result<Film, OutOfMemory> {
        Film::black(width, height, self.fraction_bits)
    }
}

impl Film {
    /// Its kind.
    pub fn kind(&self) -> FilmKind {
        FilmKind { fraction_bits: self.fraction_bits() }
    }
}
