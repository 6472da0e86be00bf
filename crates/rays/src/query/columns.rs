//! Columns of hits: what a call computes and writes.

use super::normals::write_normals;
use super::rays::Rays;
use super::target::Target;
use super::world::WorldHit;
use crate::stream::Hit;
use glam::{DVec3, Vec3};

/// Columns of the first hits of rays, each as long as the rays, in memory of the caller. What is `None` is not
/// computed.
///
/// ```
/// use raystream_rays::query::{HitColumns, Mesh, Ray, RayQueries, Rule};
///
/// let mesh = Mesh::build(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2]])?;
/// let rays = [0.25, 5.0].map(|x| Ray::new([x, 0.5, 2.0], [0.0, 0.0, -1.0]));
/// let (mut t, mut normals) = ([0.0; 2], [[0.0; 3]; 2]);
/// let mut columns = HitColumns { t: Some(&mut t), normal: Some(&mut normals), ..HitColumns::default() };
/// mesh.cast(&rays.as_slice().into(), Rule::Closed, &mut columns);
/// assert_eq!(t, [2.0, f32::INFINITY]);
/// assert_eq!(normals, [[0.0, 0.0, 1.0], [0.0; 3]]);
/// # Ok::<(), raystream_rays::query::GeometryError>(())
/// ```
#[derive(Debug, Default)]
pub struct HitColumns<'a> {
    /// Distance in lengths of the direction; +∞ for a miss.
    pub t: Option<&'a mut [f32]>,
    /// Index of the triangle in its mesh; [`super::MISS`] for a miss.
    pub primitive: Option<&'a mut [u32]>,
    /// Index of the instance in its world, 0 for a mesh; [`super::MISS`] for a miss.
    pub instance: Option<&'a mut [u32]>,
    /// Barycentric weights of the triangle's second and third corner, 0 to 1; 0 for a miss.
    pub uv: Option<&'a mut [[f32; 2]]>,
    /// Geometric normal of length 1, on the side from which the corners are seen in counterclockwise order; 0 for a
    /// miss.
    pub normal: Option<&'a mut [[f32; 3]]>,
    /// The point that is hit, in the caller's units; NaN for a miss.
    pub position: Option<&'a mut [[f32; 3]]>,
    /// The point that is hit, in `f64`, for meshes that are far from the origin.
    pub position64: Option<&'a mut [[f64; 3]]>,
    /// Normal of length 1 interpolated between the corners; 0 for a miss.
    pub shading_normal: Option<Interpolated<'a>>,
    /// A number of the triangle; NaN for a miss.
    pub attribute: Option<Attribute<'a>>,
}

/// Column of normals that are interpolated over triangles, and turned as their instance is.
///
/// ```
/// use raystream_rays::glam::{Affine3A, Vec3};
/// use raystream_rays::query::{HitColumns, Interpolated, Mesh, Ray, RayQueries, Rule, VertexNormals, World};
///
/// let (corners, triangles) = ([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [[0, 1, 2]]);
/// let mesh = Mesh::build(&corners, &triangles)?;
/// // The instance mirrors the mesh; its normals point upwards, the geometric one downwards.
/// let world = World::build(&[(mesh, Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0)))])?;
/// let (up, mut normals, mut shading) = ([[0.0, 0.0, 1.0]; 3], [[0.0; 3]], [[0.0; 3]]);
/// let of_instances = [VertexNormals { normals: &up, triangles: &triangles }];
/// let mut columns = HitColumns {
///     normal: Some(&mut normals),
///     shading_normal: Some(Interpolated { of_instances: &of_instances, column: &mut shading }),
///     ..HitColumns::default()
/// };
/// let ray = [Ray::new([-0.25, 0.5, 2.0], [0.0, 0.0, -1.0])];
/// world.cast(&(&ray).into(), Rule::Closed, &mut columns);
/// assert_eq!((normals, shading), ([[0.0, 0.0, -1.0]], [[0.0, 0.0, 1.0]]));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Interpolated<'a> {
    /// The normals of each instance, empty for those that cannot be hit; one for a mesh.
    pub of_instances: &'a [VertexNormals<'a>],
    /// The column.
    pub column: &'a mut [[f32; 3]],
}

/// Normals of the vertices of a mesh.
#[derive(Clone, Copy, Debug, Default)]
pub struct VertexNormals<'a> {
    /// A normal for each vertex.
    pub normals: &'a [[f32; 3]],
    /// The triangles of the mesh, which index `normals`.
    pub triangles: &'a [[u32; 3]],
}

/// Column of numbers of the triangles that are hit.
#[derive(Debug)]
pub struct Attribute<'a> {
    /// For each instance a number for each of its triangles, none for instances that cannot be hit; one for a mesh.
    pub of_instances: &'a [&'a [f32]],
    /// The column.
    pub column: &'a mut [f32],
}

/// Columns that are divided among threads.
pub(super) trait Divide: Send + Sized {
    /// Splits off the rows of the first `count`.
    fn split_first(&mut self, count: usize) -> Self;
}

impl<T: Send> Divide for &mut [T] {
    fn split_first(&mut self, count: usize) -> Self {
        let (first, rest) = std::mem::take(self).split_at_mut(count);
        *self = rest;
        first
    }
}

impl Divide for () {
    fn split_first(&mut self, _: usize) -> Self {}
}

impl<C: Divide> Divide for Option<C> {
    fn split_first(&mut self, count: usize) -> Self {
        self.as_mut().map(|column| column.split_first(count))
    }
}

impl<A: Divide, B: Divide> Divide for (A, B) {
    fn split_first(&mut self, count: usize) -> Self {
        (self.0.split_first(count), self.1.split_first(count))
    }
}

impl Divide for Interpolated<'_> {
    fn split_first(&mut self, count: usize) -> Self {
        Self { column: self.column.split_first(count), ..*self }
    }
}

impl Divide for Attribute<'_> {
    fn split_first(&mut self, count: usize) -> Self {
        Self { column: self.column.split_first(count), ..*self }
    }
}

impl Divide for HitColumns<'_> {
    fn split_first(&mut self, count: usize) -> Self {
        Self {
            t: self.t.split_first(count),
            primitive: self.primitive.split_first(count),
            instance: self.instance.split_first(count),
            uv: self.uv.split_first(count),
            normal: self.normal.split_first(count),
            position: self.position.split_first(count),
            position64: self.position64.split_first(count),
            shading_normal: self.shading_normal.split_first(count),
            attribute: self.attribute.split_first(count),
        }
    }
}

impl HitColumns<'_> {
    /// The same columns, borrowed.
    pub(super) fn reborrow(&mut self) -> HitColumns<'_> {
        HitColumns {
            t: self.t.as_deref_mut(),
            primitive: self.primitive.as_deref_mut(),
            instance: self.instance.as_deref_mut(),
            uv: self.uv.as_deref_mut(),
            normal: self.normal.as_deref_mut(),
            position: self.position.as_deref_mut(),
            position64: self.position64.as_deref_mut(),
            shading_normal: self
                .shading_normal
                .as_mut()
                .map(|of| Interpolated { of_instances: of.of_instances, column: &mut *of.column }),
            attribute: self
                .attribute
                .as_mut()
                .map(|of| Attribute { of_instances: of.of_instances, column: &mut *of.column }),
        }
    }

    /// Panics unless each column has as many rows as there are rays.
    pub(super) fn check(&self, rays: usize) {
        let lengths = [
            self.t.as_ref().map(|column| column.len()),
            self.primitive.as_ref().map(|column| column.len()),
            self.instance.as_ref().map(|column| column.len()),
            self.uv.as_ref().map(|column| column.len()),
            self.normal.as_ref().map(|column| column.len()),
            self.position.as_ref().map(|column| column.len()),
            self.position64.as_ref().map(|column| column.len()),
            self.shading_normal.as_ref().map(|of| of.column.len()),
            self.attribute.as_ref().map(|of| of.column.len()),
        ];
        assert!(lengths.into_iter().flatten().all(|len| len == rays), "one row per ray in each column");
    }
}

/// Number of hits whose columns are written before those of the next.
const WRITTEN_AT_ONCE: usize = 512;

/// Rays and tree that the columns of hits are computed from.
pub(super) struct ColumnWriter<'a> {
    pub target: Target<'a>,
    pub rays: &'a Rays<'a>,
    /// Index of the first ray.
    pub first: usize,
}

impl ColumnWriter<'_> {
    /// Writes the columns of hits, whose `t` is in the caller's units and whose primitive ids are those of the tree.
    pub fn write(&self, hits: &[Hit], mut columns: HitColumns<'_>) {
        if let Some(column) = columns.normal.take() {
            match self.target.tracers.normals_of_triangles(hits.len()) {
                Some(normals) => normals.write(self.target.tracers.bvh(), hits, column),
                None => write_normals(self.target.tracers.bvh(), hits, column),
            }
        }
        // So few that they stay in the nearest cache while one column after the other is written.
        for (some, first) in hits.chunks(WRITTEN_AT_ONCE).zip((self.first..).step_by(WRITTEN_AT_ONCE)) {
            let columns = columns.split_first(some.len());
            Self { first, ..*self }.write_some(some, columns);
        }
    }

    fn write_some(&self, hits: &[Hit], columns: HitColumns<'_>) {
        let Target { starts, .. } = self.target;
        let HitColumns {
            t,
            primitive,
            instance,
            uv,
            normal: _,
            position,
            position64,
            shading_normal,
            attribute,
        } = columns;
        if let Some(column) = t {
            column.iter_mut().zip(hits).for_each(|(t, hit)| *t = hit.t);
        }
        if let Some(column) = uv {
            column.iter_mut().zip(hits).for_each(|(uv, hit)| *uv = [hit.u, hit.v]);
        }
        if starts.is_none() {
            if let Some(column) = primitive {
                column.iter_mut().zip(hits).for_each(|(primitive, hit)| *primitive = hit.primitive);
            }
            if let Some(column) = instance {
                column
                    .iter_mut()
                    .zip(hits)
                    .for_each(|(i, hit)| *i = if hit.is_miss() { super::MISS } else { 0 });
            }
        } else if primitive.is_some() || instance.is_some() {
            self.write_ids(hits, primitive, instance);
        }
        if let Some(column) = position {
            let at = |i: usize| self.position(i, &hits[i]).as_vec3().to_array();
            column.iter_mut().enumerate().for_each(|(i, position)| *position = at(i));
        }
        if let Some(column) = position64 {
            let at = |i: usize| self.position(i, &hits[i]).to_array();
            column.iter_mut().enumerate().for_each(|(i, position)| *position = at(i));
        }
        if let Some(Interpolated { of_instances, column }) = shading_normal {
            for (normal, hit) in column.iter_mut().zip(hits) {
                *normal = if hit.is_miss() { [0.0; 3] } else { self.shading_normal(hit, of_instances) };
            }
        }
        if let Some(Attribute { of_instances, column }) = attribute {
            for (value, hit) in column.iter_mut().zip(hits) {
                *value = if hit.is_miss() { f32::NAN } else { self.target.number_of(hit, of_instances) };
            }
        }
    }

    /// The unit normal between the corners of the triangle that is hit.
    fn shading_normal(&self, hit: &Hit, of_instances: &[VertexNormals<'_>]) -> [f32; 3] {
        let WorldHit { instance, primitive, u, v, .. } = self.target.world_hit(hit);
        let VertexNormals { normals, triangles } = of_instances[instance as usize];
        let [a, b, c] =
            triangles[primitive as usize].map(|corner| Vec3::from_array(normals[corner as usize]));
        let normal = (1.0 - u - v) * a + u * b + v * c;
        match self.target.tracers.bvh().placement_of(hit.primitive) {
            Some(placement) => placement.normal(normal).normalize_or_zero().as_vec3().to_array(),
            None => normal.normalize_or_zero().to_array(),
        }
    }

    fn write_ids(&self, hits: &[Hit], mut primitive: Option<&mut [u32]>, mut instance: Option<&mut [u32]>) {
        for (i, hit) in hits.iter().enumerate() {
            let hit = self.target.world_hit(hit);
            if let Some(column) = &mut primitive {
                column[i] = hit.primitive;
            }
            if let Some(column) = &mut instance {
                column[i] = hit.instance;
            }
        }
    }

    /// The point of a hit in the caller's units.
    fn position(&self, index: usize, hit: &Hit) -> DVec3 {
        if hit.is_miss() {
            return DVec3::NAN;
        }
        self.rays.at(self.first + index, f64::from(hit.t))
    }
}
