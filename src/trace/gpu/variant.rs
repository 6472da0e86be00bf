//! How a scene can be laid out on a device.

use std::fmt;

/// The kind of tree that kernels traverse.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum TreeKind {
    /// Two children a node, with boxes at full precision.
    Binary,
    /// Eight children a node, with boxes in bytes.
    Wide,
    /// The device's own tree over boxes, for devices with ray queries.
    Device,
}

/// A layout: the tree and its leaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Variant {
    /// The tree.
    pub tree: TreeKind,
    /// True if triangles of a leaf that share an edge are stored as pairs.
    pub pairs: bool,
}

impl Variant {
    /// All layouts.
    pub const ALL: [Self; 5] = [
        Self { tree: TreeKind::Wide, pairs: true },
        Self { tree: TreeKind::Wide, pairs: false },
        Self { tree: TreeKind::Binary, pairs: true },
        Self { tree: TreeKind::Binary, pairs: false },
        Self { tree: TreeKind::Device, pairs: true },
    ];
}

impl fmt::Display for Variant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let tree = match self.tree {
            TreeKind::Binary => "binary",
            TreeKind::Wide => "wide",
            TreeKind::Device => "ray query",
        };
        write!(f, "{tree}, {}", if self.pairs { "pairs" } else { "no pairs" })
    }
}

impl Default for Variant {
    fn default() -> Self {
        Self { tree: TreeKind::Wide, pairs: true }
    }
}
