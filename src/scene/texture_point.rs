//! The points at which the inputs of materials are looked up.

use super::corners::{self, Weights, blend_uvs, corner_uvs};
use super::{Footprint, Scene, TextureRef, TriangleMesh};
use crate::lanes::{Int, Lanes, Num, OutlinedTask, SingleLane};

/// Points on triangles at which textures and vertex colours are looked up, one in each lane.
#[derive(Clone, Copy, Debug)]
pub struct TexturePoint<L: Lanes> {
    /// The mesh's texture coordinates of set 0 ([`TriangleMesh::uv_set`]); zero without any.
    pub uv: [Num<L>; 2],
    /// Size of the area that the rays' cones cover in set 0.
    pub footprint: Footprint<L>,
    /// Indices of the triangles.
    pub primitive: Int<L>,
    /// Weights of the triangles' second and third corners.
    pub barycentric: [Num<L>; 2],
    /// Diameter of the rays' cones, in world units.
    pub width: Num<L>,
    /// Cosine between the rays and the triangles' normals, of either sign.
    pub cosine: Num<L>,
    /// Area of the triangles.
    pub area: Num<L>,
}

impl TexturePoint<SingleLane> {
    /// The point of a triangle at barycentric (`u`, `v`), seen by a ray without a width.
    pub fn on(mesh: &TriangleMesh, primitive: u32, u: f32, v: f32) -> Self {
        let uv = mesh.uv_at(0, primitive, u, v).to_array().map(Num::from);
        Self::without_width(uv, primitive.into(), [u.into(), v.into()])
    }
}

impl<L: Lanes> TexturePoint<L> {
    /// Points of texture coordinates `uv` that rays without a width see.
    #[inline(always)]
    pub(crate) fn without_width(uv: [Num<L>; 2], primitive: Int<L>, barycentric: [Num<L>; 2]) -> Self {
        let l = uv[0].lanes();
        let one = Num::splat(l, 1.0);
        let footprint = Footprint::point(l);
        Self { uv, footprint, primitive, barycentric, width: Num::zero(l), cosine: one, area: one }
    }

    /// The points' lanes.
    #[inline(always)]
    pub fn lanes(&self) -> L {
        self.width.lanes()
    }

    /// Linear RGBA of a texture of the scene in its own set of texture coordinates: see [`super::Texture::look_up`].
    #[inline(always)]
    pub fn look_up(&self, scene: &Scene, texture: &TextureRef) -> [Num<L>; 4] {
        self.lanes().outlined(LookUp { point: self, scene, texture })
    }

    /// The vertices' colours and alphas, blended. White and opaque if the mesh has none.
    #[inline(always)]
    pub fn vertex_colour(&self, mesh: &TriangleMesh) -> [Num<L>; 4] {
        self.lanes().outlined(VertexColour { point: self, mesh })
    }

    #[inline(always)]
    fn weights(&self) -> Weights<L> {
        let [u, v] = self.barycentric;
        [1.0 - u - v, u, v]
    }
}

/// A lookup, outlined because materials have many lookups.
struct LookUp<'a, L: Lanes> {
    point: &'a TexturePoint<L>,
    scene: &'a Scene,
    texture: &'a TextureRef,
}

impl<L: Lanes> OutlinedTask<L> for LookUp<'_, L> {
    type Output = [Num<L>; 4];

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, l: L) -> [Num<L>; 4] {
        let Self { point, scene, texture } = self;
        let image = &scene.textures[texture.texture as usize];
        if texture.set == 0 {
            return image.filter(texture.transform(point.uv), &texture.scaled(&point.footprint));
        }
        let (uv, footprint) = l.outlined(FurtherSet { point, mesh: &scene.mesh, set: texture.set });
        image.look_up(texture.transform(uv), &texture.scaled(&footprint))
    }
}

/// Coordinates and footprints in another set than the first. Few materials have one.
struct FurtherSet<'a, L: Lanes> {
    point: &'a TexturePoint<L>,
    mesh: &'a TriangleMesh,
    set: u32,
}

impl<L: Lanes> OutlinedTask<L> for FurtherSet<'_, L> {
    type Output = ([Num<L>; 2], Footprint<L>);

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) -> Self::Output {
        let Self { point, mesh, set } = self;
        let uvs = corner_uvs(mesh.uv_set(set), &corners::indices(mesh, point.primitive));
        let (twice_area, hit) = (point.area * 2.0, point.barycentric);
        let cone = Footprint::of_cone(point.width, point.cosine, twice_area, &uvs, hit);
        (blend_uvs(&uvs, &point.weights()), Footprint { bumps: point.footprint.bumps, ..cone })
    }
}

/// [`TexturePoint::vertex_colour`], outlined because few meshes have colours.
struct VertexColour<'a, L: Lanes> {
    point: &'a TexturePoint<L>,
    mesh: &'a TriangleMesh,
}

impl<L: Lanes> OutlinedTask<L> for VertexColour<'_, L> {
    type Output = [Num<L>; 4];

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, l: L) -> [Num<L>; 4] {
        let Self { point, mesh } = self;
        if mesh.colours.is_empty() {
            return [Num::splat(l, 1.0); 4];
        }
        let table: &[f32] = bytemuck::cast_slice(&mesh.colours);
        let ([a, b, c], weights) = (corners::indices(mesh, point.primitive), point.weights());
        let [a, b, c] = [a.rows_of::<4>(table), b.rows_of::<4>(table), c.rows_of::<4>(table)];
        let mut colour = a;
        for (k, colour) in colour.iter_mut().enumerate() {
            *colour = a[k] * weights[0] + b[k] * weights[1] + c[k] * weights[2];
        }
        colour
    }
}
