//! Where a ray met a surface.

use super::offset;
use crate::geom::Frame;
use crate::scene::{Material, NormalMap, Scene, Surface};
use crate::stream::{Hit, Ray};
use glam::{Vec2, Vec3};

/// Least cosine between the shading normal and `wo`.
const MIN_COSINE: f32 = 1e-3;

/// A point on a surface, seen from `wo`. Normals lie on `wo`'s side of the triangle, so BSDFs find
/// `wo` in the upper hemisphere of [`Interaction::frame`], always.
#[derive(Clone, Copy, Debug)]
pub struct Interaction {
    /// The point, on the triangle, from the hit's barycentrics.
    pub position: Vec3,
    /// Unit direction back along the ray.
    pub wo: Vec3,
    /// Unit normal of the triangle.
    pub normal: Vec3,
    /// Shading frame: the interpolated and mapped normal, bent as little as keeps `wo` above it and,
    /// for surfaces with a mirror-like share, the mirrored `wo` above the triangle.
    pub frame: Frame,
    /// Mesh texture coordinates.
    pub uv: Vec2,
    /// Whether `wo` is on the side from which the triangle runs counter-clockwise.
    pub front: bool,
    /// Whether `wo` is outside of the body: the side that the vertex normals, if there are any,
    /// point to; else the front.
    pub outside: bool,
    /// Where scattered (not mirrored or refracted) rays leave: `position`, raised to the surface
    /// that the vertex normals suggest, so that a smooth body of few triangles casts no shadow of
    /// its edges on itself (Hanika 2021, *Hacking the Shadow Terminator*).
    pub raised: Vec3,
    /// Distance that rays start off the triangle.
    offset: f32,
}

impl Interaction {
    /// The interaction of a ray with the triangle it hit, whose material is `material`.
    pub fn new(scene: &Scene, material: &Material, ray: &Ray, hit: &Hit) -> Self {
        let corners = scene.mesh.corners(hit.primitive);
        let weights = [1.0 - hit.u - hit.v, hit.u, hit.v];
        let blend = |of: [Vec3; 3]| of[0] * weights[0] + of[1] * weights[1] + of[2] * weights[2];
        let position = blend(corners);
        let wo = -Vec3::from_array(ray.direction).normalize();
        let winding = offset::normal(&corners).unwrap_or(wo);
        let front = wo.dot(winding) >= 0.0;
        let normal = if front { winding } else { -winding };

        let indices = scene.mesh.triangles[hit.primitive as usize];
        let vertex_normals = (!scene.mesh.normals.is_empty())
            .then(|| indices.map(|i| scene.mesh.normals[i as usize]))
            .filter(|normals| normals.iter().all(|n| *n != Vec3::ZERO));
        let smooth = vertex_normals.and_then(|normals| blend(normals).try_normalize());
        // The side that counts as outside, and the smooth normal on it.
        let outward = smooth.unwrap_or(winding);
        let outside = wo.dot(winding) * outward.dot(winding) >= 0.0;
        let uv = scene.mesh.uv_at(hit.primitive, hit.u, hit.v);

        let mapped = material.normal_map.as_ref().and_then(|map| {
            let frame = tangent_frame(scene, indices, &corners, weights, outward)?;
            Some(map_normal(scene, map, uv, &frame))
        });
        let mut shading = mapped.unwrap_or(outward);
        if shading.dot(normal) < 0.0 {
            shading = -shading;
        }
        if smooth.is_some() || mapped.is_some() {
            let matte = matches!(material.surface, Surface::Matte { .. });
            shading = bend(shading, normal, wo, matte);
        } else {
            shading = normal;
        }
        let raised = match vertex_normals {
            Some(normals) if smooth.is_some() => {
                let side = if outward.dot(normal) < 0.0 { -1.0 } else { 1.0 };
                raise(position, &corners, &normals, weights, side)
            }
            _ => position,
        };
        Self {
            position,
            wo,
            normal,
            frame: Frame::from_normal(shading),
            uv,
            front,
            outside,
            raised,
            offset: offset::distance(&corners),
        }
    }

    /// The world direction of a mirrored or refracted ray that goes to `local` in the shading frame. A
    /// bent normal may send it to the other side of the triangle than of the normal; it is then laid
    /// along the triangle, on the side where it belongs: it would otherwise count as having crossed
    /// a surface that it did not cross.
    pub fn smooth_direction(&self, local: Vec3) -> Vec3 {
        let wi = self.frame.to_world(local).normalize();
        let height = wi.dot(self.normal) * local.z.signum();
        if height >= MIN_COSINE {
            return wi;
        }
        let lift = (MIN_COSINE - height) * local.z.signum();
        (wi + self.normal * lift).try_normalize().unwrap_or(wi)
    }

    /// The start of a ray from `point` ([`Interaction::position`] or [`Interaction::raised`]) towards
    /// `wi`, off the triangle on the side that `wi` points to.
    pub fn origin(&self, point: Vec3, wi: Vec3) -> Vec3 {
        let side = if wi.dot(self.normal) < 0.0 { -self.offset } else { self.offset };
        point + self.normal * side
    }
}

/// Turns a shading normal that lies on the triangle's side of `wo` so that `wo` is above it and,
/// unless the surface is matte, `wo` mirrored at it stays above the triangle.
fn bend(shading: Vec3, normal: Vec3, wo: Vec3, matte: bool) -> Vec3 {
    let cosine = shading.dot(wo);
    if matte {
        return if cosine >= MIN_COSINE {
            shading
        } else {
            (shading + wo * (MIN_COSINE - cosine)).normalize()
        };
    }
    let mirrored = shading * (2.0 * cosine) - wo;
    let height = mirrored.dot(normal);
    let least = (0.5 * wo.dot(normal)).clamp(0.0, 0.01);
    if height >= least && cosine >= 0.0 {
        return shading;
    }
    // The half vector of `wo` and the mirrored direction lifted to the least height.
    let lifted = (mirrored + normal * (least - height)).try_normalize().unwrap_or(normal);
    (wo + lifted).try_normalize().unwrap_or(normal)
}

/// The tangent frame of a normal map around the unit normal `outward`: from the mesh's tangents,
/// else from its texture coordinates; `None` where these give no direction.
fn tangent_frame(
    scene: &Scene,
    indices: [u32; 3],
    corners: &[Vec3; 3],
    weights: [f32; 3],
    outward: Vec3,
) -> Option<Frame> {
    let across = |tangent: Vec3, handedness: f32| {
        let tangent = (tangent - outward * tangent.dot(outward)).try_normalize()?;
        let bitangent = outward.cross(tangent) * handedness;
        Some(Frame { tangent, bitangent, normal: outward })
    };
    if !scene.mesh.tangents.is_empty() {
        let of = indices.map(|i| scene.mesh.tangents[i as usize]);
        let tangent = (0..3).map(|k| of[k].truncate() * weights[k]).sum();
        if let Some(frame) = across(tangent, if of[0].w < 0.0 { -1.0 } else { 1.0 }) {
            return Some(frame);
        }
    }
    if scene.mesh.uvs.is_empty() {
        return None;
    }
    let [a, b, c] = indices.map(|i| scene.mesh.uvs[i as usize]);
    let (d1, d2) = (b - a, c - a);
    let determinant = d1.perp_dot(d2);
    if determinant == 0.0 || !determinant.is_finite() {
        return None;
    }
    let sign = determinant.signum();
    let (e1, e2) = (corners[1] - corners[0], corners[2] - corners[0]);
    let along_u = (e1 * d2.y - e2 * d1.y) * sign;
    // v grows downwards in the image, the map's y upwards.
    let up = (e1 * d2.x - e2 * d1.x) * sign;
    let handedness = if outward.cross(along_u).dot(up) < 0.0 { -1.0 } else { 1.0 };
    across(along_u, handedness)
}

fn map_normal(scene: &Scene, map: &NormalMap, uv: Vec2, frame: &Frame) -> Vec3 {
    let texture = &scene.textures[map.texture.texture as usize];
    let texel = texture.sample(map.texture.apply(uv)).truncate() * 2.0 - 1.0;
    let local = Vec3::new(texel.x * map.scale, texel.y * map.scale, texel.z.max(0.0));
    frame.to_world(local).try_normalize().unwrap_or(frame.normal)
}

/// The point of the surface that the vertex normals suggest above `position`: the mean of its
/// projections onto the planes of those vertices under which it lies. `side` turns the normals.
fn raise(position: Vec3, corners: &[Vec3; 3], normals: &[Vec3; 3], weights: [f32; 3], side: f32) -> Vec3 {
    (0..3).fold(position, |raised, k| {
        let normal = normals[k] * side;
        let under = (position - corners[k]).dot(normal).min(0.0);
        raised - normal * (under * weights[k])
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{Sampler, warp};
    use crate::scene::{Colour, ColourSpace, Texture, TextureRef, Wrap};
    use glam::Vec4;

    /// One triangle in the xy plane, its front towards +z, u to the right, v downwards.
    fn triangle() -> Scene {
        let mut scene = Scene::default();
        scene.mesh.positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
        scene.mesh.uvs = vec![Vec2::new(0.0, 1.0), Vec2::new(1.0, 1.0), Vec2::new(0.0, 0.0)];
        scene.mesh.triangles = vec![[0, 1, 2]];
        scene.mesh.materials = vec![0];
        scene.materials = vec![Material::fallback()];
        scene
    }

    fn seen(scene: &Scene, wo: Vec3) -> Interaction {
        let ray = Ray::new(Vec3::new(0.25, 0.5, 0.0) + wo * 3.0, wo * -2.0);
        let hit = Hit { t: 1.5 * wo.length(), u: 0.25, v: 0.5, primitive: 0 };
        Interaction::new(scene, &scene.materials[0], &ray, &hit)
    }

    #[test]
    fn a_hit_knows_its_place_and_side() {
        let above = seen(&triangle(), Vec3::new(0.3, 0.0, 1.0));
        assert_eq!((above.position, above.uv), (Vec3::new(0.25, 0.5, 0.0), Vec2::new(0.25, 0.5)));
        assert_eq!((above.normal, above.frame.normal, above.raised), (Vec3::Z, Vec3::Z, above.position));
        assert!(above.front && above.outside && (above.wo.length() - 1.0).abs() < 1e-6);
        assert!(above.origin(above.position, Vec3::Z).z > 0.0);
        assert!(above.origin(above.position, Vec3::NEG_Z).z < 0.0);
        let below = seen(&triangle(), Vec3::NEG_Z);
        assert_eq!((below.normal, below.frame.normal), (Vec3::NEG_Z, Vec3::NEG_Z));
        assert!(!below.front && !below.outside);
    }

    #[test]
    fn vertex_normals_say_what_is_outside_and_winding_what_is_the_front() {
        let mut scene = triangle();
        scene.mesh.normals = vec![Vec3::new(0.1, 0.0, -1.0).normalize(); 3];
        let above = seen(&scene, Vec3::Z);
        assert!(above.front && !above.outside);
        assert!(above.frame.normal.z > 0.9, "on the side of wo all the same");
        // A vertex without a normal: the triangle is flat.
        scene.mesh.normals[1] = Vec3::ZERO;
        assert_eq!(seen(&scene, Vec3::Z).frame.normal, Vec3::Z);
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
        // What needs no bending is not bent.
        let normal = Vec3::new(0.2, 0.1, 1.0).normalize();
        assert_eq!(bend(normal, Vec3::Z, Vec3::new(0.1, -0.2, 1.0).normalize(), false), normal);
    }

    #[test]
    fn smooth_rays_stay_on_their_side() {
        let mut scene = triangle();
        scene.materials[0].surface = Surface::Dielectric { ior: 1.5, transmittance: Vec3::ONE };
        scene.mesh.normals = vec![Vec3::new(0.7, 0.0, 0.3).normalize(); 3];
        let at = seen(&scene, Vec3::new(1.0, 0.0, 0.2));
        for i in 0..1000 {
            let local = warp::sphere(Sampler::new(0, i, 0).pair(0));
            let wi = at.smooth_direction(local);
            assert!((wi.length() - 1.0).abs() < 1e-5);
            assert!(wi.z * local.z.signum() > 0.0, "{local} went to {wi}");
        }
    }

    fn mapped(texel: [u8; 4]) -> Scene {
        let mut scene = triangle();
        scene.textures.push(Texture {
            name: String::new(),
            width: 1,
            height: 1,
            texels: [texel].into(),
            space: ColourSpace::Linear,
            wrap_u: Wrap::Repeat,
            wrap_v: Wrap::Repeat,
        });
        scene.materials[0].normal_map = Some(NormalMap { texture: TextureRef::plain(0), scale: 1.0 });
        scene.materials[0].surface = Surface::Matte { reflectance: Colour::constant(Vec3::ONE) };
        scene
    }

    #[test]
    fn normal_maps_have_x_along_u_and_y_up_in_the_image() {
        let right = seen(&mapped([200, 128, 200, 255]), Vec3::Z).frame.normal;
        assert!(right.x > 0.4 && right.y.abs() < 0.01, "{right}");
        let up = seen(&mapped([128, 200, 200, 255]), Vec3::Z).frame.normal;
        assert!(up.y > 0.4 && up.x.abs() < 0.01, "{up}");
        // The same bump, seen from behind.
        let behind = seen(&mapped([200, 128, 200, 255]), Vec3::NEG_Z).frame.normal;
        assert!((behind + right).length() < 1e-5);
        // A mirrored image: u to the left, so is x.
        let mut scene = mapped([200, 200, 200, 255]);
        scene.mesh.uvs.iter_mut().for_each(|uv| uv.x = -uv.x);
        let mirrored = seen(&scene, Vec3::Z).frame.normal;
        assert!(mirrored.x < -0.4 && mirrored.y > 0.4, "{mirrored}");
    }

    #[test]
    fn the_meshs_tangents_come_first() {
        let mut scene = mapped([200, 200, 200, 255]);
        scene.mesh.tangents = vec![Vec4::new(0.0, 1.0, 0.0, -1.0); 3];
        let normal = seen(&scene, Vec3::Z).frame.normal;
        // Bitangent = (z × y) · −1 = +x.
        assert!(normal.x > 0.4 && normal.y > 0.4, "{normal}");
        scene.mesh.tangents = vec![Vec4::ZERO; 3];
        scene.mesh.uvs = vec![Vec2::ZERO; 3];
        assert_eq!(seen(&scene, Vec3::Z).frame.normal, Vec3::Z, "no direction at all: not mapped");
    }

    #[test]
    fn points_are_raised_to_the_sphere_that_the_normals_suggest() {
        let mut scene = triangle();
        let centre = Vec3::new(0.5, 0.5, -1.0);
        scene.mesh.normals = scene.mesh.positions.iter().map(|p| (*p - centre).normalize()).collect();
        let height = seen(&scene, Vec3::Z).raised.z;
        // The sphere is 0.199 above; tangent planes lie outside of it.
        assert!(height > 0.199 && height < 2.5 * 0.199, "{height}");
        // From inside, the surface is hollow: nothing to raise.
        assert_eq!(seen(&scene, Vec3::NEG_Z).raised, Vec3::new(0.25, 0.5, 0.0));
    }
}
