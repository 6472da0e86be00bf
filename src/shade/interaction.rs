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
