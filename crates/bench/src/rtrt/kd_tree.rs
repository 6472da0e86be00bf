//! The axis-aligned BSP tree with nodes of eight bytes (RTRT, section 4.2).

use super::projected_triangle::ProjectedTriangle;
use super::split::{Reference, Split};
use super::voxel::Voxel;
use glam::Vec3;
use raystream::bvh::Bvh;

/// Marks a leaf where inner nodes have their axis.
const LEAF: u32 = 3;

/// Voxels of more triangles are built by tasks of their own.
const OWN_TASK: usize = 4096;

/// Depth of the deepest tree: 8 + 1.3 log₂ of the most triangles, rounded up.
pub const MAX_DEPTH: usize = 50;

/// An inner node or a leaf.
#[derive(Clone, Copy, Debug)]
pub struct Node {
    /// The plane; of a leaf, the number of its triangles.
    value: u32,
    /// The place of the children, or of a leaf's triangles; in the two lowest bits the axis, or [`LEAF`].
    link: u32,
}

const _: () = assert!(size_of::<Node>() == 8 && size_of::<Pair>() == 16);

impl Node {
    /// The axis of an inner node, its plane and the place of its children.
    #[inline(always)]
    pub fn inner(self) -> Option<(usize, f32, usize)> {
        let axis = self.link & 3;
        (axis != LEAF).then(|| (axis as usize, f32::from_bits(self.value), (self.link >> 2) as usize))
    }
}

/// The children of a node, in half a cache line.
#[derive(Clone, Copy, Debug)]
#[repr(align(16))]
struct Pair([Node; 2]);

/// The tree over the triangles of a scene.
#[derive(Debug)]
pub struct KdTree {
    pub(super) root: Node,
    pub(super) bounds: Voxel,
    pairs: Vec<Pair>,
    /// The triangles of each leaf.
    references: Vec<u32>,
    triangles: Vec<ProjectedTriangle>,
}

impl KdTree {
    /// Builds the tree over the triangles of another.
    pub fn new(bvh: &Bvh) -> Self {
        let corners: Vec<[Vec3; 3]> = (0..bvh.len() as u32).map(|number| bvh.corners(number)).collect();
        // A triangle without an area is never hit.
        let (kept, triangles): (Vec<_>, Vec<_>) =
            corners.iter().filter_map(|corners| Some((corners, ProjectedTriangle::new(corners)?))).unzip();
        let reference = |(number, corners): (usize, &&[Vec3; 3])| Reference {
            triangle: number as u32,
            bounds: Voxel::around(&corners[..]),
        };
        let references: Vec<Reference> = kept.iter().enumerate().map(reference).collect();
        let around = |all: Voxel, part: &Reference| {
            Voxel::around(&[all.min.min(part.bounds.min), all.max.max(part.bounds.max)])
        };
        let bounds = references.iter().fold(Voxel::EMPTY, around);
        let depth = 8 + (1.3 * (references.len().max(1) as f32).log2()).ceil() as usize;
        let builder = Builder { corners: kept };
        let subtree = builder.subtree(references, bounds, depth.min(MAX_DEPTH));
        let root = Node { value: 0, link: LEAF };
        let mut tree = Self { root, bounds, pairs: Vec::new(), references: Vec::new(), triangles };
        tree.root = tree.place(subtree);
        tree
    }

    /// Writes a subtree, and returns its topmost node.
    fn place(&mut self, subtree: Subtree) -> Node {
        match subtree {
            Subtree::Leaf(triangles) => {
                let (value, start) = (triangles.len() as u32, self.references.len() as u32);
                self.references.extend(triangles);
                Node { value, link: start << 2 | LEAF }
            }
            Subtree::Inner(Split { axis, plane }, children) => {
                let place = self.pairs.len();
                self.pairs.push(Pair([self.root; 2]));
                let [before, behind] = *children;
                let pair = [self.place(before), self.place(behind)];
                self.pairs[place] = Pair(pair);
                Node { value: plane.to_bits(), link: (place as u32) << 2 | axis as u32 }
            }
        }
    }

    /// The children at a place: before the plane and behind it.
    #[inline(always)]
    pub(super) fn children(&self, place: usize) -> [Node; 2] {
        self.pairs[place].0
    }

    /// The triangles of a leaf, by number.
    #[inline(always)]
    pub(super) fn leaf(&self, leaf: Node) -> &[u32] {
        &self.references[(leaf.link >> 2) as usize..][..leaf.value as usize]
    }

    #[inline(always)]
    pub(super) fn triangle(&self, number: u32) -> &ProjectedTriangle {
        &self.triangles[number as usize]
    }
}

enum Subtree {
    Leaf(Vec<u32>),
    Inner(Split, Box<[Subtree; 2]>),
}

struct Builder<'a> {
    corners: Vec<&'a [Vec3; 3]>,
}

impl Builder<'_> {
    fn subtree(&self, references: Vec<Reference>, voxel: Voxel, depth: usize) -> Subtree {
        let split = if depth > 0 { Split::best(&references, voxel) } else { None };
        let Some(split) = split else {
            return Subtree::Leaf(references.iter().map(|reference| reference.triangle).collect());
        };
        let halves = voxel.halves(split.axis, split.plane);
        let (mut before, mut behind) = (Vec::new(), Vec::new());
        for reference in &references {
            match split.sides(reference.bounds) {
                [true, true] => {
                    let [first, second] = halves.map(|half| self.part(reference, half));
                    before.push(first);
                    behind.push(second);
                }
                [true, false] => before.push(*reference),
                [false, _] => behind.push(*reference),
            }
        }
        let is_task = references.len() > OWN_TASK;
        drop(references);
        let children = halves.into_iter().zip([before, behind]);
        let mut build = children.map(|(half, parts)| move || self.subtree(parts, half, depth - 1));
        let (Some(first), Some(second)) = (build.next(), build.next()) else { unreachable!("two halves") };
        let (first, second) = if is_task { rayon::join(first, second) } else { (first(), second()) };
        Subtree::Inner(split, Box::new([first, second]))
    }

    /// A reference clipped to a voxel.
    fn part(&self, reference: &Reference, voxel: Voxel) -> Reference {
        let within = reference.bounds.common(voxel);
        let exact = within.around_part(self.corners[reference.triangle as usize]);
        Reference { bounds: exact.unwrap_or(within), ..*reference }
    }
}
