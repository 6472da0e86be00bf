//! Coats of varnish, one over the other.

use super::fingerprint::{Encode, Encoder};
use glam::Vec3;
use std::ops::Deref;

/// A clear layer that lies on what is below it, and may take colour from light that passes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coat {
    /// Share of the surface that is coated, 0..=1.
    pub weight: f32,
    /// Index of refraction, ≥ 1. Each coat reflects as if it lay in air, as glTF's does.
    pub ior: f32,
    /// Perceptual roughness of its upper face, 0..=1.
    pub roughness: f32,
    /// What white light has become that went down and up through it at right angles, 0..=1; the longer its
    /// refracted way, the less is left (Beer and Lambert).
    pub tint: Vec3,
}

impl Coat {
    /// A smooth coat as glTF's is: index 1.5, without a tint.
    pub const CLEAR: Self = Self { weight: 1.0, ior: 1.5, roughness: 0.0, tint: Vec3::ONE };

    /// What is absorbed on a way as long as the coat is thick, as an exponent of e, per channel.
    pub fn depth(&self) -> Vec3 {
        // Beyond e³⁰ there is nothing left.
        self.tint.map(|c| -0.5 * libm::logf(c.clamp(1e-13, 1.0)))
    }
}

/// Several coats, outermost first.
#[derive(Clone, Copy, PartialEq)]
pub struct Coats {
    coats: [Coat; Coats::MOST],
    count: usize,
}

impl Coats {
    /// The most coats. They lie where their surface lies, so what has none pays for the room.
    pub const MOST: usize = 8;

    /// None.
    pub const NONE: Self = Self { coats: [Coat::CLEAR; Self::MOST], count: 0 };

    /// These, if they are not too many.
    pub fn new(coats: &[Coat]) -> Option<Self> {
        let mut all = Self::NONE;
        all.coats.get_mut(..coats.len())?.copy_from_slice(coats);
        all.count = coats.len();
        Some(all)
    }
}

impl Deref for Coats {
    type Target = [Coat];

    #[inline(always)]
    fn deref(&self) -> &[Coat] {
        &self.coats[..self.count]
    }
}

impl Encode for Coats {
    fn encode(&self, to: &mut Encoder) {
        let Self { coats, count } = self;
        coats[..*count].encode(to);
    }
}

impl std::fmt::Debug for Coats {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        (**self).fmt(f)
    }
}
