//! Properties that films must share to be added up.

use super::accumulation::{MAX_FRACTION_BITS, MIN_FRACTION_BITS};
use super::{Film, LayerPlan};
use crate::memory::OutOfMemory;
use serde::{Deserialize, Serialize};

/// Precision and layers of a film. Films of one size and kind can be added.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FilmKind {
    fraction_bits: u32,
    #[serde(default, skip_serializing_if = "LayerPlan::is_empty")]
    layers: LayerPlan,
}

impl FilmKind {
    /// True if there are films of this kind.
    pub fn is_sound(&self) -> bool {
        (MIN_FRACTION_BITS..=MAX_FRACTION_BITS).contains(&self.fraction_bits) && self.layers.is_sound()
    }

    /// Layers that it holds besides radiance.
    pub fn layers(&self) -> &LayerPlan {
        &self.layers
    }

    /// Bytes of a film of this kind, at most.
    pub fn bytes(&self, width: u32, height: u32) -> u64 {
        let pixels = u64::from(width) * u64::from(height);
        Film::bytes(width, height).saturating_add(self.layers.bytes(pixels))
    }

    /// A black film of this kind.
    ///
    /// # Errors
    /// If the system does not give the memory.
    pub fn film(&self, width: u32, height: u32) -> Result<Film, OutOfMemory> {
        Film::black(width, height, self.fraction_bits)?.with_layers(self.layers.clone())
    }
}

impl Film {
    /// Its kind.
    pub fn kind(&self) -> FilmKind {
        FilmKind { fraction_bits: self.fraction_bits(), layers: self.plan().cloned().unwrap_or_default() }
    }
}
