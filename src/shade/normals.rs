//! Shading normals: vertex normals, normal maps, and the limits of how far they may bend from the triangle's
//! normal.

use crate::geom::Basis;
use crate::lanes::{Lanes, Mask, Num, Vector};
#[cfg(doc)]
use crate::scene::Footprint;
use crate::scene::{Anisotropy, NormalMap, Scene, TexturePoint};

/// Least cosine between the shading normal and `wo`, and between the triangle's normal and specular
/// directions.
pub const MIN_COSINE: f32 = 1e-3;

/// Shading normals. In the lanes of `bent`, `shading` is turned to `wo`'s side of the triangle and limited by
/// [`bend`]. In the others they are the triangle's `normal`.
#[cfg_attr(not(unoptimised), inline(always))]
pub fn bend_where<L: Lanes>(
    shading: Vector<L>,
    bent: Mask<L>,
    normal: Vector<L>,
    wo: Vector<L>,
    matte: bool,
) -> Vector<L> {
    if bent.none() {
        return normal;
    }
    let shading = Vector::select(shading.dot(normal).below(0.0), -shading, shading);
    Vector::select(bent, bend(shading, normal, wo, matte), normal)
}

/// Turns shading normals on `wo`'s side of the triangle so that `wo` is above them. Unless the surface is
/// matte, the mirrored `wo` also stays above the triangle.
#[cfg_attr(not(unoptimised), inline(always))]
fn bend<L: Lanes>(shading: Vector<L>, normal: Vector<L>, wo: Vector<L>, matte: bool) -> Vector<L> {
    let cosine = shading.dot(wo);
    if matte {
        let low = cosine.below(MIN_COSINE);
        if low.none() {
            return shading;
        }
        let turned = (shading + wo * (MIN_COSINE - cosine)).normalize();
        return Vector::select(low, turned, shading);
    }
    let mirrored = shading * (2.0 * cosine) - wo;
    let height = mirrored.dot(normal);
    let least = (0.5 * wo.dot(normal)).clamp(0.0, 0.01);
    let good = height.ge(least) & cosine.ge(Num::splat(wo.lanes(), 0.0));
    if good.all() {
        return shading;
    }
    // The half vector between `wo` and the mirrored direction, which is lifted to the least height.
    let (lifted, _) = (mirrored + normal * (least - height)).normalize_or(normal);
    let (half, _) = (wo + lifted).normalize_or(normal);
    Vector::select(good, shading, half)
}

/// Normals from a normal map, and their [`Footprint::bumps`].
#[cfg_attr(not(unoptimised), inline(always))]
pub fn map_normal<L: Lanes>(
    scene: &Scene,
    map: &NormalMap,
    at: &TexturePoint<L>,
    basis: &Basis<L>,
) -> (Vector<L>, Num<L>) {
    let texture = &scene.textures[map.texture.texture as usize];
    let [x, y, z, length] = at.look_up(scene, &map.texture);
    let (x, y, z) = (x * 2.0 - 1.0, y * 2.0 - 1.0, z * 2.0 - 1.0);
    let local = Vector::new(x * map.scale, y * map.scale, z.clamp(0.0, 1.0));
    let bumps =
        if texture.stores_roughness() { (1.0 - length) * map.scale.abs() } else { Num::zero(length.lanes()) };
    (basis.world(local).normalize_or(basis.normal).0, bumps)
}

/// World directions along which an anisotropic surface is rougher.
#[cfg_attr(not(unoptimised), inline(always))]
pub fn rough_direction<L: Lanes>(
    scene: &Scene,
    anisotropy: &Anisotropy,
    at: &TexturePoint<L>,
    tangents: &Basis<L>,
) -> Vector<L> {
    let l = at.lanes();
    let (sine, cosine) = (libm::sinf(anisotropy.rotation), libm::cosf(anisotropy.rotation));
    let [mut x, mut y] = [Num::splat(l, 1.0), Num::splat(l, 0.0)];
    if let Some(texture) = &anisotropy.direction {
        let [red, green, _, _] = at.look_up(scene, texture);
        [x, y] = [red * 2.0 - 1.0, green * 2.0 - 1.0];
    }
    tangents.tangent * (x * cosine - y * sine) + tangents.bitangent * (x * sine + y * cosine)
}

#[cfg(test)]
mod tests {
    use crate::geom::{Sampler, warp};
    use glam::Vec3;

    fn bend(shading: Vec3, normal: Vec3, wo: Vec3, matte: bool) -> Vec3 {
        super::bend(shading.into(), normal.into(), wo.into(), matte).into()
    }

    #[test]
    fn bent_normals_keep_the_view_and_its_mirror_image_above() {
        for i in 0..20_000 {
            let s = Sampler::new(i, 0, 0);
            let wo = warp::cosine_hemisphere(s.pair(0)) * Vec3::new(1.0, 1.0, s.single(3)) + Vec3::Z * 1e-4;
            let wo = wo.normalize();
            let mut normal = warp::sphere(s.pair(1));
            normal.z = normal.z.abs();
            let matte = bend(normal, Vec3::Z, wo, true);
            assert!((matte.length() - 1.0).abs() < 1e-5 && matte.dot(wo) > 0.0);
            let glossy = bend(normal, Vec3::Z, wo, false);
            let mirrored = glossy * (2.0 * glossy.dot(wo)) - wo;
            assert!((glossy.length() - 1.0).abs() < 1e-5 && glossy.dot(wo) > 0.0, "{normal} from {wo}");
            assert!(mirrored.z > -1e-6, "{normal} from {wo}: mirrored to {mirrored}");
        }
        // A normal within the limits is not changed.
        let normal = Vec3::new(0.2, 0.1, 1.0).normalize();
        assert_eq!(bend(normal, Vec3::Z, Vec3::new(0.1, -0.2, 1.0).normalize(), false), normal);
    }
}
