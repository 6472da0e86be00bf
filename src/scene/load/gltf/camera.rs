//! Cameras and their animations.

use super::super::LoadProblem;
use super::Context;
use super::animation::camera_motion;
use crate::scene::{Camera, NamedCamera, Projection};
use ::gltf::camera::Projection as SourceProjection;
use ::gltf::{Document, Node};
use glam::DMat4;
use std::collections::BTreeSet;

/// The cameras of the nodes, in file order.
#[derive(Default)]
pub(super) struct Cameras {
    /// Each with its node.
    found: Vec<(NamedCamera, usize)>,
    names: BTreeSet<String>,
}

impl Cameras {
    /// Adds the camera of a node, if it has one.
    pub(super) fn add(&mut self, context: &mut Context, node: &Node, matrix: &DMat4) {
        let Some(source) = node.camera() else { return };
        let name =
            node.name().or(source.name()).map_or_else(|| format!("camera {}", source.index()), str::to_owned);
        let camera = Camera::transformed(matrix, 40.0).with_projection(projection(&source));
        if let Err(error) = camera.lens(1, 1) {
            context.session.warnings.add(format!("The camera {name:?} is ignored: {error}."));
            return;
        }
        let mut unique = name.clone();
        for number in 2.. {
            if self.names.insert(unique.clone()) {
                break;
            }
            unique = format!("{name} {number}");
        }
        self.found.push((NamedCamera::new(unique, camera), node.index()));
    }

    /// The cameras with their animations.
    ///
    /// # Errors
    /// When keys are missing or out of order.
    pub(super) fn finish(self, context: &mut Context) -> Result<Vec<NamedCamera>, LoadProblem> {
        let mut cameras = Vec::new();
        for (named, node) in self.found {
            let chain = path_from_root(context.document, node);
            let source = chain.last().and_then(Node::camera).expect("the node has a camera");
            let motion = camera_motion(context, &chain, &source, named.camera)?;
            cameras.push(named.with_motion(motion));
        }
        Ok(cameras)
    }
}

/// The width follows from the picture, not from the file's aspect ratio or `xmag`.
fn projection(camera: &::gltf::Camera) -> Projection {
    match camera.projection() {
        SourceProjection::Perspective(lens) => {
            Projection::Perspective { fov_degrees: lens.yfov().to_degrees() }
        }
        // `ymag` is half the height. Negative values mirror in OpenGL; the specification advises against them.
        SourceProjection::Orthographic(view) => Projection::Orthographic { height: 2.0 * view.ymag().abs() },
    }
}

/// The nodes on the path from a root to `node`.
fn path_from_root(document: &Document, node: usize) -> Vec<Node<'_>> {
    let mut parents = vec![None; document.nodes().len()];
    for parent in document.nodes() {
        for child in parent.children() {
            parents[child.index()] = Some(parent.index());
        }
    }
    let ancestors = std::iter::successors(Some(node), |&node| parents[node]);
    let mut path: Vec<_> = ancestors.filter_map(|node| document.nodes().nth(node)).collect();
    path.reverse();
    path
}
