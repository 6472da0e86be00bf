//! Builds the tree over a scene: one tree over all triangles, or a two-level tree if instances save enough triangles.
//! Moves the tree of a scene whose parts stand elsewhere.

use crate::bvh::{Bvh, PrimitiveIds, TreeInstance};
use crate::geom::Placement;
use crate::scene::{Instance, Scene, Shape};
use bytemuck::{cast, cast_slice};
use glam::Vec3;
use rayon::prelude::*;
use std::borrow::Cow;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

/// A two-level tree does not pay if it saves fewer triangles. Rays visit overlapping instances one after the other,
/// and the box of a rotated tree is looser than a box around the rotated triangles.
pub const MIN_SAVED_TRIANGLES: usize = 1 << 16;

/// Factor by which a number of [`Fit`] may grow before triangles that have moved get a new tree.
const MAX_GROWTH: f32 = 1.5;

/// How well the boxes of a tree fit its triangles: [`Bvh::cost`], which falls where triangles far away make the whole
/// larger, and [`Bvh::looseness`], which falls where the triangles themselves grow.
pub type Fit = [f32; 2];

/// Triangles that one thread looks at, at least.
const TRIANGLES_AT_ONCE: usize = 1 << 13;

/// Builds the tree of a scene. A shape stays shared if its instances together save at least `min_saved_triangles`
/// triangles. The hits are the same to the bit either way.
pub fn build(scene: &Scene, min_saved_triangles: usize) -> Bvh {
    let parts = Parts::new(scene, min_saved_triangles);
    let single = parts.build_single();
    if parts.shapes.is_empty() {
        return single;
    }
    let is_masked = mask(scene);
    let mut members = vec![TreeInstance::in_world(Arc::new(single))];
    for shape in parts.shapes {
        let masked = |place: u32| is_masked(shape.instances[0].first + place);
        let tree = Arc::new(Bvh::build(&shape.positions, &shape.triangles, masked));
        let placed = shape.instances.par_iter();
        members.par_extend(placed.map(|at| TreeInstance::placed(tree.clone(), at.placement, at.first)));
    }
    Bvh::from_instances(members)
}

/// The tree of a scene, made from that of `former`, which has the same triangles elsewhere; the same tree if none has
/// moved. Triangles of their own are refitted, instances are moved. `built` is the fit that the triangles' own tree
/// was built with, which is found when it is first needed; that of the new tree comes with it. `None` if triangles
/// came or went, or their corners, shapes or alpha modes are others.
pub fn moved(
    tree: &Arc<Bvh>,
    built: &OnceLock<Fit>,
    former: &Scene,
    scene: &Scene,
) -> Option<(Arc<Bvh>, OnceLock<Fit>)> {
    let [old, new] = [former, scene].map(|scene| Parts::new(scene, MIN_SAVED_TRIANGLES));
    if !new.are_like(&old) {
        return None;
    }
    let (placements, single_moves) = (new.placements(), new.single_moves(&old));
    let rows = |placements: &[Placement]| -> Vec<[u32; 12]> {
        placements.iter().map(|placement| cast(placement.rows)).collect()
    };
    if !single_moves && rows(&placements) == rows(&old.placements()) {
        return Some((Arc::clone(tree), built.clone()));
    }
    if new.shapes.is_empty() {
        let (single, built) = new.moved_single(tree, built);
        return Some((Arc::new(single), built));
    }
    let (mut whole, mut built) = (Bvh::clone(tree), built.clone());
    if single_moves {
        let single;
        (single, built) = new.moved_single(&tree.instances()[0].tree, &built);
        whole.set_tree(0, Arc::new(single));
    }
    let in_world = tree.instances().len() - placements.len();
    let placements: Vec<Option<Placement>> =
        std::iter::repeat_n(None, in_world).chain(placements.into_iter().map(Some)).collect();
    whole.move_instances(placements);
    Some((Arc::new(whole), built))
}

/// The parts of a scene's tree.
struct Parts<'a> {
    scene: &'a Scene,
    /// The shapes whose instances share a tree.
    shapes: Vec<&'a Shape>,
    /// The triangles of no such shape, which have one tree; runs of them, ascending.
    single: Vec<Range<u32>>,
}

impl<'a> Parts<'a> {
    fn new(scene: &'a Scene, min_saved_triangles: usize) -> Self {
        let saved = |shape: &&Shape| shape.triangles.len() * (shape.instances.len() - 1);
        let shapes: Vec<&Shape> =
            scene.shapes.iter().filter(|shape| saved(shape) >= min_saved_triangles).collect();
        let mut taken: Vec<_> = shapes.iter().flat_map(|shape| shape.primitives()).collect();
        taken.sort_unstable_by_key(|range| range.start);
        let end = scene.mesh.triangles.len() as u32;
        let starts = std::iter::once(0).chain(taken.iter().map(|range| range.end));
        let ends = taken.iter().map(|range| range.start).chain([end]);
        let single = starts.zip(ends).map(|(start, end)| start..end).collect();
        Self { scene, shapes, single }
    }

    /// The triangles of no shape.
    fn triangles(&self) -> Cow<'a, [[u32; 3]]> {
        let all = &self.scene.mesh.triangles;
        match &self.single[..] {
            [range] if range.len() == all.len() => Cow::Borrowed(all),
            ranges => ranges.iter().flat_map(|range| of(all, range)).copied().collect(),
        }
    }

    /// Builds the tree over the triangles of no shape.
    fn build_single(&self) -> Bvh {
        let ids = PrimitiveIds::from_ranges(self.single.iter().cloned());
        let is_masked = mask(self.scene);
        let triangles = self.triangles();
        let masked = |place: u32| is_masked(ids.primitive(place));
        let tree = Bvh::build(&self.scene.mesh.positions, &triangles, masked);
        tree.with_primitive_ids(ids)
    }

    /// The tree over the triangles of no shape, from one of the same triangles elsewhere: see [`moved`].
    fn moved_single(&self, tree: &Bvh, built: &OnceLock<Fit>) -> (Bvh, OnceLock<Fit>) {
        let fit = |tree: &Bvh| [tree.cost(), tree.looseness()];
        let before = built.get_or_init(|| fit(tree));
        let mut moved = tree.clone();
        let is_moved = moved.refit(&self.scene.mesh.positions, &self.triangles()).is_ok();
        let fits = |moved: Fit| moved.iter().zip(before).all(|(now, before)| *now <= MAX_GROWTH * before);
        if is_moved && fits(fit(&moved)) {
            return (moved, built.clone());
        }
        (self.build_single(), OnceLock::new())
    }

    /// True if the trees of both have the same triangles of the same corners and masks, but for where they stand.
    fn are_like(&self, other: &Self) -> bool {
        let (own, others) = (&self.scene.mesh, &other.scene.mesh);
        let is_like = |(a, b): (&&Shape, &&Shape)| {
            let is_same_run = |(a, b): (&Instance, &Instance)| a.first == b.first;
            a.triangles == b.triangles
                && bits(&a.positions) == bits(&b.positions)
                && a.instances.len() == b.instances.len()
                && a.instances.iter().zip(&b.instances).all(is_same_run)
        };
        self.single == other.single
            && self.shapes.len() == other.shapes.len()
            && own.positions.len() == others.positions.len()
            && own.materials == others.materials
            && self.scene.masked_materials() == other.scene.masked_materials()
            && self.single.iter().all(|range| of(&own.triangles, range) == of(&others.triangles, range))
            && self.shapes.iter().zip(&other.shapes).all(is_like)
    }

    /// True if a triangle of no shape stands elsewhere than in `other`, which is like this.
    fn single_moves(&self, other: &Self) -> bool {
        let (own, others) = (&self.scene.mesh.positions, &other.scene.mesh.positions);
        let moves =
            |corner: &u32| bits(&own[*corner as usize..][..1]) != bits(&others[*corner as usize..][..1]);
        let in_range = |range: &Range<u32>| {
            let triangles = of(&self.scene.mesh.triangles, range).par_iter();
            triangles.with_min_len(TRIANGLES_AT_ONCE).any(|triangle| triangle.iter().any(moves))
        };
        self.single.iter().any(in_range)
    }

    /// Where the instances stand.
    fn placements(&self) -> Vec<Placement> {
        let instances = self.shapes.iter().flat_map(|shape| &shape.instances);
        instances.map(|instance| instance.placement).collect()
    }
}

/// For each triangle of a scene, true if its alpha mode is not opaque.
fn mask(scene: &Scene) -> impl Fn(u32) -> bool + Sync {
    let masked = scene.masked_materials();
    move |primitive| masked[scene.mesh.materials[primitive as usize] as usize]
}

/// The elements of a range.
fn of<'t, T>(all: &'t [T], range: &Range<u32>) -> &'t [T] {
    &all[range.start as usize..range.end as usize]
}

/// Coordinates by their bits: 0 is not −0.
fn bits(positions: &[Vec3]) -> &[u32] {
    cast_slice(positions)
}
