//! Meshes at many places, which answer ray queries together.

use super::mesh::{Mesh, normal};
use super::shares::{answers, in_shares};
use super::target::{RayQueries, Target};
use super::tree_tracers::{SHARE_RAYS, TreeTracers};
use crate::bvh::{Bvh, PRIMITIVE, TreeInstance};
use crate::geom::{MAX_COORDINATE, Placement, PlacementError};
use crate::stream::{Hit, MISS, Ray};
use crate::trace::cpu::SimdLevel;
use glam::{DVec3, Vec3};
use std::cell::Cell;
use std::fmt;
use std::ops::Range;
use std::sync::Arc;

thread_local! {
    /// Hits before their instances are known.
    static HITS: Cell<Vec<Hit>> = const { Cell::new(Vec::new()) };
}

/// Instances of meshes: each mesh is stored once and stands at any number of places. Cheap to clone: clones share the
/// tree until the instances of one are moved.
///
/// ```
/// use raystream_rays::glam::{Affine3A, Vec3};
/// use raystream_rays::query::{Mesh, Ray, World};
///
/// let mesh = Mesh::build(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2]])?;
/// let at = |z| Affine3A::from_translation(Vec3::Z * z);
/// let mut world = World::build(&[(mesh.clone(), at(-1.0)), (mesh, at(-2.0))])?;
/// let ray = Ray::new([0.25, 0.5, 0.0], [0.0, 0.0, -1.0]);
/// assert_eq!((world.closest_one(&ray).instance, world.closest_one(&ray).t), (0, 1.0));
///
/// world.move_instances(&[at(-3.0), at(-2.0)])?;
/// assert_eq!((world.closest_one(&ray).instance, world.closest_one(&ray).t), (1, 2.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone)]
pub struct World {
    tracers: TreeTracers,
    /// The first primitive id of each instance in the tree, and the number of all.
    firsts: Vec<u32>,
}

/// The nearest hit of a ray in a [`World`], or a miss.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldHit {
    /// Ray parameter of the hit; +∞ for a miss.
    pub t: f32,
    /// Barycentric weight of the triangle's second vertex, 0 to 1; 0 for a miss.
    pub u: f32,
    /// Barycentric weight of the triangle's third vertex, 0 to 1; 0 for a miss.
    pub v: f32,
    /// Index of the instance, or [`MISS`].
    pub instance: u32,
    /// Primitive id in the instance's mesh, or [`MISS`].
    pub primitive: u32,
}

impl WorldHit {
    /// A miss.
    pub const NONE: Self = Self { t: f32::INFINITY, u: 0.0, v: 0.0, instance: MISS, primitive: MISS };

    /// True if the ray hit nothing.
    pub fn is_miss(&self) -> bool {
        self.primitive == MISS
    }
}

impl Default for WorldHit {
    fn default() -> Self {
        Self::NONE
    }
}

/// Error of placing instances.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum WorldError {
    /// A transform places no geometry.
    #[error("instance {instance}: {source}")]
    Transform {
        /// Index of the instance.
        instance: usize,
        /// The error of its transform.
        source: PlacementError,
    },
    /// A moved mesh leaves the range of coordinates.
    #[error(
        "instance {instance}: its transform moves the mesh to coordinates beyond {MAX_COORDINATE:e}; \
         place it nearer or make it smaller"
    )]
    Position {
        /// Index of the instance.
        instance: usize,
    },
    /// The instances have too many triangles.
    #[error("the instances have {found} triangles together; at most {max} can be numbered")]
    TooMany {
        /// Number of triangles of all instances.
        found: u64,
        /// The largest number allowed.
        max: u32,
    },
    /// The number of transforms differs from the world's number of instances.
    #[error("{found} transforms for {expected} instances; give one each, or build a new world")]
    Instances {
        /// Number of transforms given.
        found: usize,
        /// Number of instances.
        expected: usize,
    },
}

impl World {
    /// Builds a tree over instances: a mesh each, with the transform that moves it into the world. The place in
    /// `instances` is [`WorldHit::instance`]. Clones of a mesh share its memory.
    ///
    /// Transforms are [`glam::Affine3A`], [`glam::Mat4`], [`glam::DMat4`] or three rows of four numbers, the last
    /// of them the translation. A hit is to the bit that of a mesh whose corners were moved by
    /// [`Placement::point`].
    ///
    /// # Errors
    /// If a transform is not finite, a perspective or singular, if it moves the box of its mesh beyond
    /// [`MAX_COORDINATE`], or if there are more than a thousand million triangles.
    pub fn build<T>(instances: &[(Mesh, T)]) -> Result<Self, WorldError>
    where
        T: Copy + TryInto<Placement, Error = PlacementError>,
    {
        let total: u64 = instances.iter().map(|(mesh, _)| mesh.triangle_count() as u64).sum();
        if total > u64::from(PRIMITIVE) {
            return Err(WorldError::TooMany { found: total, max: PRIMITIVE });
        }
        let (mut placed, mut firsts, mut first) = (Vec::new(), Vec::with_capacity(instances.len() + 1), 0);
        for (index, (mesh, transform)) in instances.iter().enumerate() {
            let placement = checked(index, *transform, mesh.bvh())?;
            firsts.push(first);
            placed.push(TreeInstance::placed(mesh.bvh().clone(), placement, first));
            first += mesh.triangle_count() as u32;
        }
        firsts.push(first);
        let bvh = Arc::new(Bvh::from_instances(placed));
        Ok(Self { tracers: TreeTracers::new(bvh, SimdLevel::detect()), firsts })
    }

    /// Moves the instances: a new transform for each, in the order of [`World::build`]. Answers are those of a new
    /// world. Clones are not moved.
    ///
    /// # Errors
    /// As for [`World::build`], and if there is not one transform for each instance. The world is then unchanged.
    pub fn move_instances<T>(&mut self, transforms: &[T]) -> Result<(), WorldError>
    where
        T: Copy + TryInto<Placement, Error = PlacementError>,
    {
        if transforms.len() != self.len() {
            return Err(WorldError::Instances { found: transforms.len(), expected: self.len() });
        }
        let mut trees = self.tracers.bvh().instances().iter();
        let mut placements = Vec::with_capacity(transforms.len());
        for (index, (transform, firsts)) in transforms.iter().zip(self.firsts.windows(2)).enumerate() {
            // The tree leaves out meshes without triangles.
            if firsts[0] == firsts[1] {
                placement(index, *transform)?;
            } else {
                let instance = trees.next().expect("an instance for each mesh with triangles");
                placements.push(checked(index, *transform, &instance.tree)?);
            }
        }
        self.tracers.change(|bvh| bvh.move_instances(placements.into_iter()));
        Ok(())
    }

    /// The nearest hit of every ray, or [`WorldHit::NONE`]. Of equally near hits the one of the first instance, and
    /// there the one with the lowest primitive id.
    pub fn closest(&self, rays: &[Ray]) -> Vec<WorldHit> {
        let mut hits = answers(WorldHit::NONE, rays.len());
        self.closest_into(rays, &mut hits);
        hits
    }

    /// [`World::closest`] into memory of the caller, as many hits as rays.
    ///
    /// # Panics
    /// If the two lengths differ.
    pub fn closest_into(&self, rays: &[Ray], hits: &mut [WorldHit]) {
        assert_eq!(rays.len(), hits.len(), "one hit per ray");
        in_shares(rays, hits, SHARE_RAYS, |_, rays, hits| {
            let mut of_tree = HITS.take();
            of_tree.resize(rays.len(), Hit::NONE);
            self.tracers.closest_here(rays, &mut of_tree);
            hits.iter_mut().zip(&of_tree).for_each(|(hit, of_tree)| *hit = self.hit(of_tree));
            HITS.set(of_tree);
        });
    }

    /// [`World::closest`] of a single ray.
    pub fn closest_one(&self, ray: &Ray) -> WorldHit {
        self.hit(&self.tracers.single().closest_one(ray))
    }

    /// The nearest hit of every ray among those that `accepts` returns true for, as for [`Mesh::closest_where`].
    pub fn closest_where(
        &self,
        rays: &[Ray],
        accepts: impl Fn(usize, &WorldHit) -> bool + Sync,
    ) -> Vec<WorldHit> {
        let of_tree = self.tracers.closest_where(rays, &|ray, hit| accepts(ray, &self.hit(hit)));
        of_tree.iter().map(|hit| self.hit(hit)).collect()
    }

    /// All hits of every ray, as for [`Mesh::all_hits`]; those at one distance by ascending instance, then primitive.
    pub fn all_hits(&self, rays: &[Ray]) -> (Vec<WorldHit>, Vec<Range<usize>>) {
        let (of_tree, ranges) = self.tracers.all_hits(rays);
        (of_tree.iter().map(|hit| self.hit(hit)).collect(), ranges)
    }

    /// For each ray, true if it hits anything. Faster than [`World::closest`].
    pub fn occluded(&self, rays: &[Ray]) -> Vec<bool> {
        self.tracers.occluded(rays)
    }

    /// [`World::occluded`] into memory of the caller, as many answers as rays.
    ///
    /// # Panics
    /// If the two lengths differ.
    pub fn occluded_into(&self, rays: &[Ray], occluded: &mut [bool]) {
        self.tracers.occluded_into(rays, occluded);
    }

    /// [`World::occluded`] of a single ray.
    pub fn occluded_one(&self, ray: &Ray) -> bool {
        self.tracers.single().occluded_one(ray)
    }

    /// The geometric normal of a hit in the world, of length 1: that of the moved triangle's plane, on the side from
    /// which its moved corners are seen in counterclockwise order. Zero for a miss.
    ///
    /// # Panics
    /// If there is no such instance or primitive.
    pub fn normal(&self, hit: &WorldHit) -> Vec3 {
        if hit.is_miss() { Vec3::ZERO } else { normal(self.corners(hit.instance, hit.primitive)) }
    }

    /// The corners of a triangle of an instance, in the world.
    ///
    /// # Panics
    /// If there is no such instance or primitive.
    pub fn corners(&self, instance: u32, primitive: u32) -> [Vec3; 3] {
        let at = instance as usize;
        let in_tree = self.firsts[at] + primitive;
        assert!(in_tree < self.firsts[at + 1], "instance {instance} has no primitive {primitive}");
        self.tracers.bvh().corners(in_tree)
    }

    /// Number of instances.
    pub fn len(&self) -> usize {
        self.firsts.len() - 1
    }

    /// True if there are no instances.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A hit by its primitive id in the tree.
    fn hit(&self, &Hit { t, u, v, primitive }: &Hit) -> WorldHit {
        if primitive == MISS {
            return WorldHit::NONE;
        }
        let instance = self.firsts.partition_point(|&first| first <= primitive) - 1;
        let primitive = primitive - self.firsts[instance];
        WorldHit { t, u, v, instance: instance as u32, primitive }
    }
}

impl RayQueries for World {
    fn target(&self) -> Target<'_> {
        Target { tracers: &self.tracers, firsts: Some(&self.firsts), center: DVec3::ZERO }
    }
}

impl fmt::Debug for World {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let bvh = self.tracers.bvh();
        let mut output = f.debug_struct("World");
        output.field("instances", &self.len()).field("triangles", &bvh.len());
        output.field("bounds", &bvh.bounds()).finish_non_exhaustive()
    }
}

/// The placement of an instance.
fn placement<T>(instance: usize, transform: T) -> Result<Placement, WorldError>
where
    T: TryInto<Placement, Error = PlacementError>,
{
    transform.try_into().map_err(|source| WorldError::Transform { instance, source })
}

/// The placement of an instance of a tree, whose moved box must be in range.
fn checked<T>(instance: usize, transform: T, tree: &Bvh) -> Result<Placement, WorldError>
where
    T: TryInto<Placement, Error = PlacementError>,
{
    let placement = placement(instance, transform)?;
    // NaN fails the comparison.
    let in_range = |corner: Vec3| corner.abs().cmple(Vec3::splat(MAX_COORDINATE)).all();
    let bounds = placement.bounds(&tree.bounds());
    if tree.is_empty() || in_range(bounds.min) && in_range(bounds.max) {
        Ok(placement)
    } else {
        Err(WorldError::Position { instance })
    }
}
