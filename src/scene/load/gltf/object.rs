//! The object table of a glTF file: one object for each node, and one for each instance below an instancing node.

use crate::scene::{Object, Objects};
use ::gltf::Node;
use glam::DMat4;
use std::collections::HashMap;

/// The objects of the nodes visited so far.
#[derive(Default)]
pub(super) struct ObjectsByNode {
    objects: Objects,
    /// The object of each node, in the order in which nodes are added.
    nodes: Vec<u32>,
    /// The object added last.
    last: u32,
    /// The objects that show each mesh of the file.
    shown: HashMap<usize, Vec<u32>>,
}

impl ObjectsByNode {
    /// Bytes that one instance of a node takes.
    pub(super) fn instance_bytes(node: &Node) -> u64 {
        // Beside object and name: its run of triangles, its entry among those that show the mesh, and its space.
        (size_of::<Object>() + name(node).len() + 15 * size_of::<u32>()) as u64
    }

    /// Adds a node below the node `parent`, counted in the order of the calls. A node without a name has that of its
    /// mesh. `matrix` leads from its space into the world; what joints move has no space of its own.
    pub(super) fn add(&mut self, node: &Node, parent: Option<u32>, matrix: &DMat4) {
        let parent = parent.map(|parent| self.nodes[parent as usize]);
        self.last = self.objects.add(Object::new(name(node)).below(parent));
        self.nodes.push(self.last);
        if node.skin().is_none() {
            self.objects.place(self.last, matrix);
        }
    }

    /// Adds an instance below the node that was added last, of the same name. `matrix` leads from its space into the
    /// world.
    pub(super) fn add_instance(&mut self, node: &Node, matrix: &DMat4) {
        self.last = self.objects.add(Object::new(name(node)).below(self.nodes.last().copied()));
        self.objects.place(self.last, matrix);
    }

    /// Assigns the triangles of `mesh` from `first` on to the object that was added last.
    pub(super) fn assign(&mut self, mesh: usize, first: u32) {
        self.objects.assign(first, self.last);
        self.shown.entry(mesh).or_default().push(self.last);
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

fn name(node: &Node) -> String {
    let mesh = node.mesh();
    let named = node.name().or_else(|| mesh.as_ref().and_then(|mesh| mesh.name()));
    named.map_or_else(|| format!("node {}", node.index()), str::to_owned)
}
