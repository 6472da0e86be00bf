//! Layers of varnish over a surface.

use super::fingerprint::{Encode, Encoder};
use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::ops::Deref;

/// A transparent dielectric layer over other layers. It may tint light that passes it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Coat {
    /// Coated share of the surface, 0..=1.
    pub weight: f32,
    /// Index of refraction, ≥ 1. Each coat reflects as if it were surrounded by air, as glTF's clear coat does.
    pub ior: f32,
    /// Perceptual roughness of its upper face, 0..=1.
    pub roughness: f32,
    /// Share of white light that remains after passing the coat down and up at normal incidence, 0..=1 for each
    /// channel. The longer the refracted path, the less remains (Beer and Lambert).
    pub tint: Vec3,
}

impl Coat {
    /// A smooth coat like glTF's: index of refraction 1.5, no tint.
    pub const CLEAR: Self = Self { weight: 1.0, ior: 1.5, roughness: 0.0, tint: Vec3::ONE };

    /// Optical depth at normal incidence for one passage, for each channel.
    pub fn depth(&self) -> Vec3 {
        // Absorption is limited to a factor of e³⁰.
        self.tint.map(|c| -0.5 * libm::logf(c.clamp(1e-13, 1.0)))
    }
}

/// Coats over a surface, outermost first.
#[derive(Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<Coat>", into = "Vec<Coat>")]
pub struct Coats {
    coats: [Coat; Coats::MOST],
    count: usize,
}

impl Coats {
    /// The largest number of coats. They are stored inline, so surfaces without coats use the memory too.
    pub const MOST: usize = 8;

    /// No coats.
    pub const NONE: Self = Self { coats: [Coat::CLEAR; Self::MOST], count: 0 };

    /// The given coats. `None` if there are more than [`Coats::MOST`].
    pub fn new(coats: &[Coat]) -> Option<Self> {
        let mut all = Self::NONE;
        all.coats.get_mut(..coats.len())?.copy_from_slice(coats);
        all.count = coats.len();
        Some(all)
    }
}

impl TryFrom<Vec<Coat>> for Coats {
    type Error = String;

    fn try_from(coats: Vec<Coat>) -> Result<Self, String> {
        Self::new(&coats).ok_or_else(|| format!("{} coats; at most {} are possible", coats.len(), Self::MOST))
    }
}

impl From<Coats> for Vec<Coat> {
    fn from(coats: Coats) -> Self {
        coats.to_vec()
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
