//! The binary tree, as the builder makes it (`sah.rs`) and reinsertion improves it: one primitive a leaf, and
//! a plan for collapsing it into an eight-wide tree.

use super::collapse_plan::{Choice, CollapsePlan, Costs};
use super::huge_pages::HugePages;
use super::packed_bounds::PackedBounds;
use super::reference::Reference;
use bytemuck::{Pod, Zeroable};

/// No leaf lies deeper than this many nodes.
pub const MAX_DEPTH: usize = 96;

/// A binary tree with one primitive a leaf.
pub(super) struct BinaryTree {
    /// The leaves. Those of a subtree that reinsertion has not touched are consecutive.
    pub references: HugePages<Reference>,
    pub inner: InnerNodes,
}

/// The inner nodes of a binary tree.
pub(super) struct InnerNodes {
    /// The builder's nodes.
    pub built: HugePages<InnerNode>,
    /// The nodes that replace the builder's largest ones, the root first. Empty if reinsertion gained
    /// nothing.
    pub reinserted: Vec<ReinsertedNode>,
}

/// An inner node of the builder, 32 bytes. A subtree over `n` primitives is `n` consecutive references and `n
/// - 1` consecutive inner nodes: its root, then the left subtree's nodes, then the right subtree's.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct InnerNode {
    min: [f32; 3],
    /// Number of primitives on the left.
    left_count: u32,
    /// The negated upper corner.
    negated_max: [f32; 3],
    pub choice: Choice,
}

impl InnerNode {
    #[inline(always)]
    pub fn new(bounds: &PackedBounds, left_count: usize, choice: Choice) -> Self {
        let [a, b, c, _, x, y, z, _] = bounds.0;
        Self { min: [a, b, c], left_count: left_count as u32, negated_max: [x, y, z], choice }
    }

    #[inline]
    pub fn bounds(&self) -> PackedBounds {
        let ([a, b, c], [x, y, z]) = (self.min, self.negated_max);
        PackedBounds([a, b, c, 0.0, x, y, z, 0.0])
    }
}

/// An inner node after reinsertion.
#[derive(Clone, Copy, Debug)]
pub(super) struct ReinsertedNode {
    pub bounds: PackedBounds,
    pub children: [Subtree; 2],
    pub choice: Choice,
}

/// A subtree of a [`BinaryTree`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Subtree {
    /// Index of its root: in [`InnerNodes::reinserted`] with the bit [`Subtree::REINSERTED`], else in
    /// [`InnerNodes::built`]. Unspecified for a single primitive.
    root: u32,
    /// Index of its first reference. Unspecified for a reinserted root, whose references are not consecutive.
    pub first: u32,
    /// Number of primitives, at least 1.
    pub count: u32,
}

impl Subtree {
    const REINSERTED: u32 = 1 << 31;

    /// The whole tree of the builder.
    #[inline]
    pub fn built(count: u32) -> Self {
        Self { root: 0, first: 0, count }
    }

    /// The subtree under a reinserted node.
    #[inline]
    pub fn reinserted(index: usize, count: u32) -> Self {
        Self { root: index as u32 | Self::REINSERTED, first: 0, count }
    }

    /// True if its root is a reinserted node.
    #[inline]
    pub fn is_reinserted(self) -> bool {
        self.root & Self::REINSERTED != 0
    }

    #[inline]
    fn index(self) -> usize {
        (self.root & !Self::REINSERTED) as usize
    }

    /// Its references among all of the tree's. Its root must not be a reinserted node.
    #[inline]
    pub fn references(self, all: &[Reference]) -> &[Reference] {
        &all[self.first as usize..][..self.count as usize]
    }
}

impl BinaryTree {
    /// The whole tree; `None` if there are no primitives.
    #[inline]
    pub fn root(&self) -> Option<Subtree> {
        let count = self.references.len() as u32;
        let root = match self.inner.reinserted.is_empty() {
            true => Subtree::built(count),
            false => Subtree::reinserted(0, count),
        };
        (count > 0).then_some(root)
    }

    /// The box around a subtree.
    #[inline]
    pub fn bounds(&self, of: Subtree) -> PackedBounds {
        match of.count {
            1 => self.references[of.first as usize].bounds(),
            _ => self.inner.bounds(of),
        }
    }

    /// The plan of a subtree, computed anew from its leaves.
    pub fn plan(&self, of: Subtree, costs: Costs) -> CollapsePlan {
        let (area, count) = (self.bounds(of).half_area(), of.count as usize);
        if self.inner.is_leaf(of) {
            return CollapsePlan::one_block(costs, area, count);
        }
        let [left, right] = self.inner.children(of).map(|child| self.plan(child, costs));
        CollapsePlan::merge(costs, &left, &right, area, count).0
    }

    /// The primitives of a subtree.
    pub fn primitives(&self, of: Subtree) -> Vec<u32> {
        if of.is_reinserted() {
            self.inner.children(of).iter().flat_map(|&child| self.primitives(child)).collect()
        } else {
            of.references(&self.references).iter().map(Reference::primitive).collect()
        }
    }
}

impl InnerNodes {
    /// The two children of a subtree over at least two primitives.
    #[inline]
    pub fn children(&self, of: Subtree) -> [Subtree; 2] {
        if of.is_reinserted() {
            return self.reinserted[of.index()].children;
        }
        let left = self.built[of.index()].left_count;
        [
            Subtree { root: of.root + 1, first: of.first, count: left },
            Subtree { root: of.root + left, first: of.first + left, count: of.count - left },
        ]
    }

    /// The box around a subtree over at least two primitives.
    #[inline]
    pub fn bounds(&self, of: Subtree) -> PackedBounds {
        if of.is_reinserted() { self.reinserted[of.index()].bounds } else { self.built[of.index()].bounds() }
    }

    /// Choice of the plan for a subtree.
    #[inline]
    fn choice(&self, of: Subtree) -> Choice {
        match of.count {
            1 => Choice::default(),
            _ if of.is_reinserted() => self.reinserted[of.index()].choice,
            _ => self.built[of.index()].choice,
        }
    }

    /// True if no nodes were made below a subtree's root.
    #[inline]
    pub fn is_leaf(&self, of: Subtree) -> bool {
        of.count == 1 || self.choice(of) == Choice::ONE_BLOCK
    }

    /// True if the subtree is a leaf block if it is one child of a wide node.
    #[inline]
    pub fn is_block(&self, of: Subtree) -> bool {
        of.count == 1 || self.choice(of).is_block()
    }

    /// Calls `take` with the subtrees that the plan makes of one where a wide node has room for `room`
    /// children.
    pub fn gather(&self, of: Subtree, mut room: usize, take: &mut impl FnMut(Subtree)) {
        let choice = self.choice(of);
        while room > 1 && choice.on_left(room) == 0 {
            room -= 1;
        }
        if room == 1 {
            return take(of);
        }
        let on_left = choice.on_left(room);
        let [left, right] = self.children(of);
        self.gather(left, on_left, take);
        self.gather(right, room - on_left, take);
    }
}

/// Facts about a subtree that has been built.
#[derive(Debug)]
pub(super) struct BuiltSubtree {
    pub plan: CollapsePlan,
    /// At least the number of nodes on the longest path from its root to a leaf.
    pub height: usize,
    /// The same of its children, if the node may take part in reinsertion.
    pub children: Option<Box<[BuiltSubtree; 2]>>,
}

impl BuiltSubtree {
    /// A small subtree, over `count` primitives.
    #[inline(always)]
    pub fn small(plan: CollapsePlan, count: usize) -> Self {
        Self { plan, height: count, children: None }
    }

    /// A node over two subtrees, with `count` primitives and a box of half the surface `area`. Also returns
    /// what the plan does with the node.
    #[inline(always)]
    pub fn merge(costs: Costs, children: [Self; 2], area: f32, count: usize) -> (Self, Choice) {
        let [left, right] = &children;
        let (plan, choice) = CollapsePlan::merge(costs, &left.plan, &right.plan, area, count);
        let height = 1 + left.height.max(right.height);
        (Self { plan, height, children: costs.may_reinsert(area).then(|| Box::new(children)) }, choice)
    }
}
