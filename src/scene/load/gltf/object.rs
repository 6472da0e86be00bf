//! The object table of a glTF file: one object for each node.

use crate::scene::{Object, Objects};
use ::gltf::Node;
use std::collections::HashMap;

/// The objects of the nodes visited so far.
#[derive(Default)]
pub(super) struct ObjectsByNode {
    objects: Objects,
    /// The objects that show each mesh of the file.
    shown: HashMap<usize, Vec<u32>>,
}

impl ObjectsByNode {
    /// Adds a node below the object `parent`; returns its object. A node without a name has that of its mesh.
    pub(super) fn add(&mut self, node: &Node, parent: Option<u32>) -> u32 {
        let mesh = node.mesh();
        let named = node.name().or_else(|| mesh.as_ref().and_then(|mesh| mesh.name()));
        let name = named.map_or_else(|| format!("node {}", node.index()), str::to_owned);
        let object = self.objects.add(Object::new(name).below(parent));
        if let Some(mesh) = mesh {
            self.shown.entry(mesh.index()).or_default().push(object);
        }
        object
    }

    /// Assigns the triangles from `first` on to an object.
    pub(super) fn assign(&mut self, first: u32, object: u32) {
        self.objects.assign(first, object);
    }

    /// The table, in which objects that show the same mesh are numbered.
    pub(super) fn finish(mut self) -> Objects {
        for same in self.shown.into_values().filter(|same| same.len() > 1) {
            for (number, object) in (0..).zip(same) {
                if let Some(object) = self.objects.get_mut(object) {
                    object.instance = Some(number);
                }
            }
        }
        self.objects
    }
}
