//! Flattens the node hierarchy: meshes, lights and the camera in world space.

use super::super::LoadProblem;
use super::bent::Bending;
use super::camera::Cameras;
use super::instancing::{Instancing, Transforms};
use super::mesh::{self, Flattened, Materials};
use super::object::ObjectsByNode;
use super::pose::{self, Pose};
use super::{Context, accessor};
use crate::scene::{
    Instance, Light, LightShape, MeshSize, NamedCamera, Objects, Shape, TriangleMesh, unit_rotation,
};
use ::gltf::khr_lights_punctual::Kind;
use ::gltf::scene::Transform;
use ::gltf::{Document, Node};
use glam::{DMat4, DQuat, DVec3, Vec3};
use std::collections::BTreeMap;

/// The contents of a scene's nodes, in world space.
pub(super) struct World {
    pub(super) mesh: TriangleMesh,
    pub(super) shapes: Vec<Shape>,
    pub(super) objects: Objects,
    pub(super) lights: Vec<Light>,
    pub(super) cameras: Vec<NamedCamera>,
    /// True if the animation moves more than cameras.
    pub(super) is_animated: bool,
    /// See [`crate::scene::Scene::stroke_width`].
    pub(super) stroke_width: Option<f32>,
    /// True if triangles without a material use index `materials.len()`, the fallback material.
    pub(super) uses_fallback: bool,
}

/// Visits the nodes of the default scene, or else of the first scene. Parents come before children, in file order.
///
/// # Errors
/// When the nodes do not form trees, or a mesh is wrong.
pub(super) fn flatten<'a>(context: &mut Context<'a>, materials: Materials) -> Result<World, LoadProblem> {
    let pose = Pose::new(context)?;
    let nodes = in_world(context, &pose)?;
    let places = places(context.document, &pose, &nodes);
    let mut flattened = Flattened::new(materials);
    reserve(context, &mut flattened, &nodes, materials)?;
    let mut lights = Vec::new();
    let mut cameras = Cameras::default();
    let mut objects = ObjectsByNode::default();
    for WorldNode { node, matrix, parent, visible, instancing } in nodes {
        objects.add(&node, parent, &matrix);
        if let Some(mesh) = node.mesh().filter(|_| visible) {
            let joints = node.skin().map(|skin| joints(context, &skin, &places)).transpose()?;
            let bending = Bending { weights: pose.weights(&node, &mesh), joints };
            let transforms = match instancing {
                None => None,
                Some(instancing) => {
                    let place = || format!("nodes[{}]", node.index());
                    Some(instancing.read(context).map_err(|problem| context.error(place(), problem))?)
                }
            };
            match transforms {
                None => {
                    objects.assign(mesh.index(), flattened.triangles());
                    flattened.append(context, &mesh, &matrix, &bending)?;
                }
                Some(transforms) => {
                    for instance in transforms.matrices() {
                        let matrix = matrix * instance;
                        objects.add_instance(&node, &matrix);
                        objects.assign(mesh.index(), flattened.triangles());
                        flattened.append(context, &mesh, &matrix, &bending)?;
                    }
                }
            }
        }
        if let Some(light) = node.light().filter(|_| visible) {
            lights.extend(place_light(context, &light, &matrix));
        }
        cameras.add(context, &node, &matrix);
    }
    let (mesh, shapes, uses_fallback, stroke_width) = flattened.finish(context)?;
    let cameras = cameras.finish(context)?;
    let objects = objects.finish();
    let is_animated = pose::is_animated(context)?;
    Ok(World { mesh, shapes, objects, lights, cameras, is_animated, stroke_width, uses_fallback })
}

/// A node of the scene.
struct WorldNode<'a> {
    node: Node<'a>,
    matrix: DMat4,
    /// The place of its parent in the list of nodes.
    parent: Option<u32>,
    /// True if its mesh and its light are shown.
    visible: bool,
    /// Places at which its mesh is shown, if it is not shown once.
    instancing: Option<Instancing<'a>>,
}

/// The nodes of the scene. Parents come before children, in file order.
fn in_world<'a>(context: &mut Context<'a>, pose: &Pose) -> Result<Vec<WorldNode<'a>>, LoadProblem> {
    let document = context.document;
    let mut visited = vec![false; document.nodes().len()];
    let mut pending = Vec::new();
    pending.extend(roots(document).into_iter().rev().map(|node| (node, DMat4::IDENTITY, None, true)));
    let mut found = Vec::new();
    while let Some((node, matrix, parent, visible)) = pending.pop() {
        if std::mem::replace(&mut visited[node.index()], true) {
            let problem = "is reached twice; a node must have at most one parent, and cycles are not allowed";
            return Err(context.error(format!("nodes[{}]", node.index()), problem));
        }
        let matrix = matrix * pose.matrix(&node).unwrap_or_else(|| local_matrix(&node));
        let visible = visible && !is_hidden(&node);
        let own = Some(found.len() as u32);
        let children: Vec<Node> = node.children().collect();
        pending.extend(children.into_iter().rev().map(|node| (node, matrix, own, visible)));
        let instancing = Instancing::of(context, &node)?;
        found.push(WorldNode { node, matrix, parent, visible, instancing });
    }
    Ok(found)
}

/// The matrices of the scene's nodes; where a skin has joints outside the scene, of those in other trees, too.
fn places(document: &Document, pose: &Pose, nodes: &[WorldNode]) -> BTreeMap<usize, DMat4> {
    let mut places: BTreeMap<usize, DMat4> =
        nodes.iter().map(|found| (found.node.index(), found.matrix)).collect();
    if document.skins().flat_map(|skin| skin.joints()).all(|joint| places.contains_key(&joint.index())) {
        return places;
    }
    let mut is_root = vec![true; document.nodes().len()];
    for child in document.nodes().flat_map(|node| node.children()) {
        is_root[child.index()] = false;
    }
    let roots = document.nodes().filter(|node| is_root[node.index()]);
    let mut pending: Vec<(Node, DMat4)> = roots.map(|node| (node, DMat4::IDENTITY)).collect();
    while let Some((node, matrix)) = pending.pop() {
        if places.contains_key(&node.index()) {
            continue;
        }
        let matrix = matrix * pose.matrix(&node).unwrap_or_else(|| local_matrix(&node));
        places.insert(node.index(), matrix);
        pending.extend(node.children().map(|child| (child, matrix)));
    }
    places
}

/// The matrices of a skin's joints, from a mesh at rest to the world. The place of the mesh's own node does not matter.
///
/// # Errors
/// When a joint is in no tree of nodes, or the matrices of the joints at rest cannot be read.
fn joints(
    context: &Context,
    skin: &::gltf::Skin,
    places: &BTreeMap<usize, DMat4>,
) -> Result<Vec<DMat4>, LoadProblem> {
    let wrong = |problem: String| context.error(format!("skins[{}]", skin.index()), problem);
    let rest = skin.inverse_bind_matrices();
    let rest = rest.map(|accessor| accessor::matrices(context.buffers, &accessor)).transpose();
    let rest = rest.map_err(|problem| wrong(format!("inverseBindMatrices: {problem}")))?;
    let count = skin.joints().count();
    if rest.as_ref().is_some_and(|rest| rest.len() < count) || count == 0 {
        return Err(wrong(format!("has {count} joints; there must be some, and a matrix for each")));
    }
    let matrix = |(number, joint): (usize, Node)| {
        let place = places.get(&joint.index());
        let place = place
            .ok_or_else(|| wrong(format!("its joint nodes[{}] is in no tree of nodes", joint.index())))?;
        let rest = rest.as_ref().map(|rest| DMat4::from_cols_array(&rest[number].map(f64::from)));
        let matrix = *place * rest.unwrap_or(DMat4::IDENTITY);
        let is_finite = matrix.is_finite();
        is_finite
            .then_some(matrix)
            .ok_or_else(|| wrong(format!("the matrix of joint {number} is not finite")))
    };
    skin.joints().enumerate().map(matrix).collect()
}

/// True if KHR_node_visibility hides the node and all nodes below. Cameras count all the same.
fn is_hidden(node: &Node) -> bool {
    let extension = node.extension_value("KHR_node_visibility");
    extension.is_some_and(|visibility| visibility["visible"].as_bool() == Some(false))
}

/// Takes the memory for the meshes of all nodes, and counts that for their instances.
///
/// # Errors
/// When there are too many triangles, or the memory cannot be had.
fn reserve(
    context: &mut Context,
    flattened: &mut Flattened,
    nodes: &[WorldNode],
    materials: Materials,
) -> Result<(), LoadProblem> {
    let size = |mesh| mesh::size(context.buffers, &mesh, materials);
    let sizes: Vec<MeshSize> = context.document.meshes().map(size).collect();
    let (mut all, mut instances, mut bytes) = (MeshSize::default(), 0_u64, 0_u64);
    for found in nodes.iter().filter(|found| found.visible) {
        let Some(mesh) = found.node.mesh() else { continue };
        let mut count = 1;
        if let Some(instancing) = &found.instancing {
            count = instancing.expected_count(context.buffers);
            let primitives = mesh.primitives().len() as u64;
            // Lists grow by doubling.
            let each = 2 * ObjectsByNode::instance_bytes(&found.node)
                + 2 * primitives * size_of::<Instance>() as u64
                + Transforms::BYTES;
            instances = instances.saturating_add(count);
            bytes = bytes.saturating_add(count.saturating_mul(each));
        }
        all += sizes[mesh.index()] * count;
    }
    if instances > 0 {
        let held = context.session.hold(format!("the transforms and names of {instances} instances"), bytes);
        held.map_err(|source| context.session.over(source))?;
    }
    flattened.reserve(context, all)
}

/// The root nodes. A document without scenes shows all its nodes.
fn roots(document: &Document) -> Vec<Node<'_>> {
    if let Some(scene) = document.default_scene().or_else(|| document.scenes().next()) {
        return scene.nodes().collect();
    }
    let mut is_child = vec![false; document.nodes().len()];
    for child in document.nodes().flat_map(|node| node.children()) {
        is_child[child.index()] = true;
    }
    document.nodes().filter(|node| !is_child[node.index()]).collect()
}

/// A node's matrix in double precision, so that long products of matrices do not displace distant vertices.
fn local_matrix(node: &Node) -> DMat4 {
    match node.transform() {
        Transform::Matrix { matrix } => {
            DMat4::from_cols_array_2d(&matrix.map(|column| column.map(f64::from)))
        }
        Transform::Decomposed { translation, rotation, scale } => {
            let rotation = unit_rotation(DQuat::from_array(rotation.map(f64::from)));
            DMat4::from_scale_rotation_translation(
                DVec3::from_array(scale.map(f64::from)),
                rotation,
                DVec3::from_array(translation.map(f64::from)),
            )
        }
    }
}

/// Transforms a direction to a unit vector in world space. `None` if the matrix makes it zero.
fn world_direction(matrix: &DMat4, direction: DVec3) -> Option<Vec3> {
    matrix.transform_vector3(direction).try_normalize().map(|d| d.as_vec3())
}

/// Converts a light. A candela counts as a watt per steradian, a lux as a watt per square metre.
fn place_light(
    context: &mut Context,
    light: &::gltf::khr_lights_punctual::Light,
    matrix: &DMat4,
) -> Option<Light> {
    let name = light.name().map_or_else(|| format!("light {}", light.index()), str::to_owned);
    if light.range().is_some() {
        context
            .session
            .warnings
            .add(format!("Light {name:?}: its range is ignored; its light reaches any distance."));
    }
    let clamped = |v: f32| {
        context.session.warnings.clamp(format_args!("Light {name:?}: its intensity"), v, 0.0, f32::MAX)
    };
    let intensity = (Vec3::from(light.color()) * light.intensity()).map(clamped);
    let position = matrix.w_axis.truncate().as_vec3();
    let direction = world_direction(matrix, DVec3::NEG_Z);
    let is_point = matches!(light.kind(), Kind::Point);
    if !position.is_finite() || direction.is_none() && !is_point {
        context.session.warnings.add(format!(
            "Light {name:?}: its node gives it no finite position or no direction; it is left out."
        ));
        return None;
    }
    let direction = direction.unwrap_or(Vec3::NEG_Z);
    let shape = match light.kind() {
        Kind::Point => LightShape::Point { position },
        Kind::Directional => LightShape::Directional { direction },
        Kind::Spot { inner_cone_angle, outer_cone_angle } => {
            let quarter_turn = std::f32::consts::FRAC_PI_2;
            let mut angle = |what, v| {
                context.session.warnings.clamp(
                    format_args!("Light {name:?}: its {what}"),
                    v,
                    0.0,
                    quarter_turn,
                )
            };
            let cos_inner = libm::cosf(angle("innerConeAngle", inner_cone_angle));
            let cos_outer = libm::cosf(angle("outerConeAngle", outer_cone_angle));
            // The transition between the cones needs a positive width.
            LightShape::Spot { position, direction, cos_inner, cos_outer: cos_outer.min(cos_inner - 1.0e-4) }
        }
    };
    Some(Light { name, intensity, shape })
}
