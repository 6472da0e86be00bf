//! The choice of a mix's part for each hit.

use super::{Hits, geometry, lookup};
use crate::geom::{mix_lanes, unit};
use crate::lanes::{Lanes, Mask, SingleLane};
use crate::scene::{Scene, Surface, TexturePoint};
use crate::stream::Hit;

/// Makes the choice independent of that of [`Scene::alpha_accepts`].
const SALT: u32 = 0x1f83_d9ab;

/// Lanes whose hits, on the mix `mix` of [`Scene::mixes`], are hits on its second part. A hash of the hit
/// decides, as in alpha blending, so all rays and units agree. A mix within a mix decides independently.
#[inline(always)]
pub(super) fn is_second<L: Lanes>(scene: &Scene, mix: u32, hits: &Hits<L>) -> Mask<L> {
    let uv = geometry::mesh_uv(&scene.mesh, hits);
    let point = TexturePoint::without_width(uv, hits.primitive, [hits.u, hits.v]);
    let share = lookup::share(scene, &scene.mixes[mix as usize].share, &point);
    let bits = mix_lanes(hits.v.to_bits() ^ crate::geom::mix(mix ^ SALT));
    let bits = mix_lanes(hits.primitive ^ mix_lanes(hits.u.to_bits() ^ bits));
    unit(bits).lt(share)
}

/// Index of the material of a hit: that of its triangle or, if this is a mix, that of the chosen part.
pub fn material_of(scene: &Scene, hit: &Hit) -> u32 {
    let mut material = scene.mesh.materials[hit.primitive as usize];
    if !scene.mixes.is_empty() {
        while let Surface::Mix(mix) = scene.materials[material as usize].surface {
            let second = is_second::<SingleLane>(scene, mix, &(*hit).into()).get();
            material = scene.mixes[mix as usize].of[usize::from(second)];
        }
    }
    material
}
