//! The principled BSDF of a finish that user code computes.

use super::coat::{CLEAR_F0, Coat};
use super::facets::Facets;
use super::fresnel::Schlick;
use super::principled::white;
use super::transparency::Transparency;
use super::{Principled, Smoothness};
use crate::lanes::{Lanes, Mask, Num};
use crate::scene::{Finish, Transmission};

impl<L: Lanes> Principled<L> {
    /// The BSDFs of a computed finish. `wo` is outside of the body in the lanes of `outside`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn finished(
        finish: &Finish<L>,
        transmission: Option<Transmission>,
        outside: Mask<L>,
        smoothness: Smoothness,
    ) -> Self {
        let smooth_below = smoothness.mirror_below;
        let l = finish.colour.lanes();
        let one = Num::splat(l, 1.0);
        let base = finish.colour.clamp(0.0, 1.0);
        let metallic = finish.metallic.clamp(0.0, 1.0);
        let facets = Facets::new(finish.roughness.clamp(0.0, 1.0), smooth_below);
        // A wall has the clear coat's index of refraction.
        let (ior, f0, outside) = match transmission {
            Some(Transmission::Body { ior }) => (ior, ((ior - 1.0) / (ior + 1.0)).powi(2), Some(outside)),
            Some(Transmission::ThinWall) | None => (1.5, CLEAR_F0, None),
        };
        let layer = facets.reflection(Schlick { f0: white(l) * f0, f90: one });
        let metal = facets.reflection(Schlick { f0: base, f90: one });
        let (mut outer, mut opaque, mut transparency) = (layer, one - metallic, None);
        if transmission.is_some() {
            let share = finish.transmission.clamp(0.0, 1.0);
            let spread = facets.rougher_than(smoothness.clear_below);
            let through = Transparency::new(opaque * share, base, ior, outside, spread);
            outer = layer.scaled(Num::select(through.has_own_reflection(), one - share, one));
            opaque *= one - share;
            transparency = Some(through);
        }
        Self {
            facets,
            reflection: outer.mix(&metal, metallic),
            layer,
            diffuse: base * opaque,
            translucency: None,
            transparency,
            film: None,
            sheen: None,
            coat: Some(Coat::new(
                finish.clearcoat.clamp(0.0, 1.0),
                Facets::new(Num::zero(l), smooth_below),
                CLEAR_F0,
            )),
            stack: None,
            coat_normal: None,
        }
    }
}
