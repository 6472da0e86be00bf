//! Meshes at many places, which answer ray queries together.

use super::instance_starts::InstanceStarts;
use super::mesh::{Mesh, normal};
use super::shares::{answers_in_shares, in_shares};
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
use std::sync::{Arc, OnceLock};

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
#[derive(Clone, Default)]
pub struct World {
    instances: Vec<Instance>,
    /// Built at the first query after a change that needs it.
    built: OnceLock<Built>,
}

/// An instance.
#[derive(Clone)]
struct Instance {
    /// `None` once it has been removed.
    mesh: Option<Mesh>,
    placement: Placement,
    is_visible: bool,
}

/// The tree over the instances that can be hit.
#[derive(Clone)]
struct Built {
    tracers: TreeTracers,
    /// The primitive ids of the instances in the tree. Those that cannot be hit have none.
    starts: InstanceStarts,
}

impl Instance {
    fn new<T>(index: usize, mesh: Mesh, transform: T) -> Result<Self, WorldError>
    where
        T: TryInto<Placement, Error = PlacementError>,
    {
        let placement = checked(index, transform, &mesh)?;
        Ok(Self { mesh: Some(mesh), placement, is_visible: true })
    }

    /// The mesh, if it can be hit.
    fn hittable(&self) -> Option<&Mesh> {
        self.mesh.as_ref().filter(|mesh| self.is_visible && mesh.triangle_count() > 0)
    }
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
    /// There is no such instance.
    #[error("there is no instance {instance}; it was removed, or the world has fewer")]
    Missing {
        /// Index of the instance.
        instance: usize,
    },
    /// The number of transforms differs from the number of instances.
    #[error("{found} transforms for {expected} instances; give one each")]
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
        let mut world = Self::default();
        for (index, (mesh, transform)) in instances.iter().enumerate() {
            world.instances.push(Instance::new(index, mesh.clone(), *transform)?);
        }
        world.check_count()?;
        world.built();
        Ok(world)
    }

    /// Adds an instance and returns its index. The tree over the instances is built at the next query; the trees of the
    /// meshes stay.
    ///
    /// ```
    /// use raystream_rays::glam::{Affine3A, Vec3};
    /// use raystream_rays::query::{Mesh, Ray, World};
    ///
    /// let mesh = Mesh::build(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2]])?;
    /// let mut world = World::default();
    /// let near = world.add(mesh.clone(), Affine3A::from_translation(-Vec3::Z))?;
    /// let far = world.add(mesh, Affine3A::from_translation(-2.0 * Vec3::Z))?;
    /// let ray = Ray::new([0.25, 0.25, 0.0], [0.0, 0.0, -1.0]);
    /// assert_eq!(world.closest_one(&ray).instance, near);
    /// world.set_visible(near, false)?;
    /// assert_eq!(world.closest_one(&ray).instance, far);
    /// world.remove(far)?;
    /// assert!(world.closest_one(&ray).is_miss());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// As for [`World::build`]. The world is then unchanged.
    pub fn add<T>(&mut self, mesh: Mesh, transform: T) -> Result<u32, WorldError>
    where
        T: TryInto<Placement, Error = PlacementError>,
    {
        let index = self.instances.len();
        self.instances.push(Instance::new(index, mesh, transform)?);
        if let Err(error) = self.check_count() {
            self.instances.pop();
            return Err(error);
        }
        self.built = OnceLock::new();
        Ok(index as u32)
    }

    /// Removes an instance. The others keep their indices.
    ///
    /// # Errors
    /// If there is no such instance.
    pub fn remove(&mut self, instance: u32) -> Result<(), WorldError> {
        self.instance(instance)?.mesh = None;
        self.built = OnceLock::new();
        Ok(())
    }

    /// Hides an instance from all queries, or shows it again.
    ///
    /// # Errors
    /// If there is no such instance.
    pub fn set_visible(&mut self, instance: u32, visible: bool) -> Result<(), WorldError> {
        let of = self.instance(instance)?;
        if of.is_visible != visible {
            of.is_visible = visible;
            self.built = OnceLock::new();
        }
        Ok(())
    }

    /// Replaces the mesh of an instance, such as by one that was refitted.
    ///
    /// # Errors
    /// As for [`World::build`], and if there is no such instance. The world is then unchanged.
    pub fn set_mesh(&mut self, instance: u32, mesh: Mesh) -> Result<(), WorldError> {
        let old = self.instance(instance)?.clone();
        let placed = Instance { mesh: Some(mesh), ..old.clone() };
        in_range(instance as usize, &placed.placement, placed.mesh.as_ref())?;
        self.instances[instance as usize] = placed;
        if let Err(error) = self.check_count() {
            self.instances[instance as usize] = old;
            return Err(error);
        }
        self.built = OnceLock::new();
        Ok(())
    }

    /// The mesh of an instance; `None` if there is no such instance.
    pub fn mesh(&self, instance: u32) -> Option<&Mesh> {
        self.instances.get(instance as usize)?.mesh.as_ref()
    }

    /// Moves some instances: a new transform for each of these. Takes as long as moving all.
    ///
    /// # Errors
    /// As for [`World::build`], if there is no such instance, and if there is not one transform for each. The world is
    /// then unchanged.
    pub fn move_some<T>(&mut self, instances: &[u32], transforms: &[T]) -> Result<(), WorldError>
    where
        T: Copy + TryInto<Placement, Error = PlacementError>,
    {
        let (expected, found) = (instances.len(), transforms.len());
        if found != expected {
            return Err(WorldError::Instances { found, expected });
        }
        let mut placements = Vec::with_capacity(found);
        for (&instance, transform) in instances.iter().zip(transforms) {
            let mesh = self.mesh(instance).ok_or(WorldError::Missing { instance: instance as usize })?;
            placements.push(checked(instance as usize, *transform, mesh)?);
        }
        for (&instance, placement) in instances.iter().zip(placements) {
            self.instances[instance as usize].placement = placement;
        }
        self.refit();
        Ok(())
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
        let mut placements = Vec::with_capacity(transforms.len());
        for (index, (transform, instance)) in transforms.iter().zip(&self.instances).enumerate() {
            placements.push(match &instance.mesh {
                Some(mesh) => checked(index, *transform, mesh)?,
                None => placement(index, *transform)?,
            });
        }
        for (instance, placement) in self.instances.iter_mut().zip(placements) {
            instance.placement = placement;
        }
        self.refit();
        Ok(())
    }

    /// Moves the instances in the tree, if it is built, to where they stand.
    fn refit(&mut self) {
        let hittable = self.instances.iter().filter(|instance| instance.hittable().is_some());
        if let Some(built) = self.built.get_mut() {
            built.tracers.change(|bvh| bvh.move_instances(hittable.map(|instance| instance.placement)));
        }
    }

    fn instance(&mut self, instance: u32) -> Result<&mut Instance, WorldError> {
        let of = self.instances.get_mut(instance as usize).filter(|of| of.mesh.is_some());
        of.ok_or(WorldError::Missing { instance: instance as usize })
    }

    fn check_count(&self) -> Result<(), WorldError> {
        let meshes = self.instances.iter().filter_map(|instance| instance.mesh.as_ref());
        let found = meshes.map(|mesh| mesh.triangle_count() as u64).sum();
        if found > u64::from(PRIMITIVE) {
            return Err(WorldError::TooMany { found, max: PRIMITIVE });
        }
        Ok(())
    }

    /// The tree, which is built if it is not.
    fn built(&self) -> &Built {
        self.built.get_or_init(|| {
            let meshes = || self.instances.iter().map(Instance::hittable);
            let starts =
                InstanceStarts::new(meshes().map(|mesh| mesh.map_or(0, Mesh::triangle_count) as u32));
            let placed =
                self.instances.iter().zip(meshes()).enumerate().filter_map(|(at, (instance, mesh))| {
                    let (tree, first) = (mesh?.bvh().clone(), starts.ids(at).start);
                    Some(TreeInstance::placed_roughly(tree, instance.placement, first))
                });
            let bvh = Arc::new(Bvh::from_instances(placed.collect()));
            Built { tracers: TreeTracers::new(bvh, SimdLevel::detect()), starts }
        })
    }

    fn tracers(&self) -> &TreeTracers {
        &self.built().tracers
    }

    /// The nearest hit of every ray, or [`WorldHit::NONE`]. Of equally near hits the one of the first instance, and
    /// there the one with the lowest primitive id.
    pub fn closest(&self, rays: &[Ray]) -> Vec<WorldHit> {
        answers_in_shares(rays, WorldHit::NONE, SHARE_RAYS, |_, rays, hits| self.closest_here(rays, hits))
    }

    /// [`World::closest`] into memory of the caller, as many hits as rays.
    ///
    /// # Panics
    /// If the two lengths differ.
    pub fn closest_into(&self, rays: &[Ray], hits: &mut [WorldHit]) {
        assert_eq!(rays.len(), hits.len(), "one hit per ray");
        in_shares(rays, hits, SHARE_RAYS, |_, rays, hits| self.closest_here(rays, hits));
    }

    /// [`World::closest_into`] on the calling thread.
    fn closest_here(&self, rays: &[Ray], hits: &mut [WorldHit]) {
        let mut of_tree = HITS.take();
        of_tree.resize(rays.len(), Hit::NONE);
        self.tracers().closest_here(rays, &mut of_tree);
        hits.iter_mut().zip(&of_tree).for_each(|(hit, of_tree)| *hit = self.hit(of_tree));
        HITS.set(of_tree);
    }

    /// [`World::closest`] of a single ray.
    pub fn closest_one(&self, ray: &Ray) -> WorldHit {
        self.hit(&self.tracers().single().closest_one(ray))
    }

    /// The nearest hit of every ray among those that `accepts` returns true for, as for [`Mesh::closest_where`].
    pub fn closest_where(
        &self,
        rays: &[Ray],
        accepts: impl Fn(usize, &WorldHit) -> bool + Sync,
    ) -> Vec<WorldHit> {
        let of_tree = self.tracers().closest_where(rays, &|ray, hit| accepts(ray, &self.hit(hit)));
        of_tree.iter().map(|hit| self.hit(hit)).collect()
    }

    /// All hits of every ray, as for [`Mesh::all_hits`]; those at one distance by ascending instance, then primitive.
    pub fn all_hits(&self, rays: &[Ray]) -> (Vec<WorldHit>, Vec<Range<usize>>) {
        let (of_tree, ranges) = self.tracers().all_hits(rays);
        (of_tree.iter().map(|hit| self.hit(hit)).collect(), ranges)
    }

    /// For each ray, true if it hits anything. Faster than [`World::closest`].
    pub fn occluded(&self, rays: &[Ray]) -> Vec<bool> {
        self.tracers().occluded(rays)
    }

    /// [`World::occluded`] into memory of the caller, as many answers as rays.
    ///
    /// # Panics
    /// If the two lengths differ.
    pub fn occluded_into(&self, rays: &[Ray], occluded: &mut [bool]) {
        self.tracers().occluded_into(rays, occluded);
    }

    /// [`World::occluded`] of a single ray.
    pub fn occluded_one(&self, ray: &Ray) -> bool {
        self.tracers().single().occluded_one(ray)
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
        let ids = self.built().starts.ids(instance as usize);
        let in_tree = ids.start + primitive;
        assert!(in_tree < ids.end, "instance {instance} has no primitive {primitive}");
        self.tracers().bvh().corners(in_tree)
    }

    /// Number of instances, those that are hidden or removed included.
    pub fn len(&self) -> usize {
        self.instances.len()
    }

    /// True if there are no instances.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A hit by its primitive id in the tree.
    fn hit(&self, hit: &Hit) -> WorldHit {
        self.target().world_hit(hit)
    }
}

impl RayQueries for World {
    fn target(&self) -> Target<'_> {
        let Built { tracers, starts } = self.built();
        Target { tracers, starts: Some(starts), center: DVec3::ZERO }
    }
}

impl fmt::Debug for World {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let bvh = self.tracers().bvh();
        let mut output = f.debug_struct("World");
        output.field("instances", &self.len()).field("triangles", &bvh.len());
        output.field("bounds", &bvh.bounds()).finish_non_exhaustive()
    }
}

/// The placement of an instance.
#[inline(always)]
fn placement<T>(instance: usize, transform: T) -> Result<Placement, WorldError>
where
    T: TryInto<Placement, Error = PlacementError>,
{
    transform.try_into().map_err(|source| WorldError::Transform { instance, source })
}

/// The placement of an instance of a mesh, whose moved box must be in range. The mesh's centre is part of it.
// Inlined, as is what it calls: copies of results would take more time than the checks.
#[inline(always)]
fn checked<T>(instance: usize, transform: T, mesh: &Mesh) -> Result<Placement, WorldError>
where
    T: TryInto<Placement, Error = PlacementError>,
{
    let mut placement = placement(instance, transform)?;
    if mesh.center() != DVec3::ZERO {
        for row in &mut placement.rows {
            let [a, b, c, d] = row.map(f64::from);
            row[3] = (DVec3::new(a, b, c).dot(mesh.center()) + d) as f32;
        }
    }
    in_range(instance, &placement, Some(mesh))?;
    Ok(placement)
}

/// An error if the moved box of a mesh is out of range.
#[inline(always)]
fn in_range(instance: usize, placement: &Placement, mesh: Option<&Mesh>) -> Result<(), WorldError> {
    let Some(mesh) = mesh.filter(|mesh| mesh.triangle_count() > 0) else { return Ok(()) };
    // NaN fails the comparisons.
    let reach = mesh.bvh().scene_max_abs();
    let row_in_range =
        |&[a, b, c, d]: &[f32; 4]| (a.abs() + b.abs() + c.abs()) * reach + d.abs() < 0.5 * MAX_COORDINATE;
    // Decides nearly always.
    if placement.rows.iter().all(row_in_range) {
        return Ok(());
    }
    let in_range = |corner: Vec3| corner.abs().cmple(Vec3::splat(MAX_COORDINATE)).all();
    let bounds = placement.bounds(&mesh.bvh().bounds());
    if in_range(bounds.min) && in_range(bounds.max) { Ok(()) } else { Err(WorldError::Position { instance }) }
}
