//! Primitives that morph targets displace and joints move.

use super::Context;
use super::accessor;
use super::mesh::{Attributes, NodeTransform, mapped_attribute, read_attribute};
use crate::geom::Skin;
use ::gltf::accessor::Dimensions;
use ::gltf::mesh::MorphTarget;
use ::gltf::{Accessor, Primitive, Semantic};
use glam::{DMat4, DVec3, Vec3, Vec4};
use rayon::prelude::*;

/// Displacements of a primitive: a small file can name the same zeros as any number of targets.
const MOST_DISPLACED: usize = 1 << 30;

/// What bends the mesh of a node.
#[derive(Default)]
pub(super) struct Bending {
    /// The weights of its morph targets.
    pub(super) weights: Vec<f64>,
    /// The matrices of its skin's joints: from the mesh at rest to the world.
    pub(super) joints: Option<Vec<DMat4>>,
}

/// Vertices of a primitive, in the world.
pub(super) struct Bent {
    pub(super) positions: Vec<Vec3>,
    pub(super) normals: Vec<Vec3>,
    pub(super) tangents: Vec<Vec4>,
    /// True if triangles are turned round.
    pub(super) mirrors: bool,
}

impl Bending {
    /// True if it does nothing to a primitive.
    pub(super) fn is_none(&self, primitive: &Primitive) -> bool {
        self.joints.is_none() && !self.displaces(primitive)
    }

    fn displaces(&self, primitive: &Primitive) -> bool {
        primitive.morph_targets().zip(&self.weights).any(|(_, weight)| *weight != 0.0)
    }

    /// The accessors of a primitive that say how it is bent: two with the same share their vertices. `names` are those
    /// of its texture coordinates and colours.
    ///
    /// # Errors
    /// When a target names an accessor that does not exist.
    pub(super) fn key(
        &self,
        context: &Context,
        primitive: Placed,
        names: &[String],
    ) -> Result<Vec<Option<usize>>, String> {
        let mut targets = Vec::new();
        for name in ["POSITION", "NORMAL", "TANGENT"].into_iter().chain(names.iter().map(String::as_str)) {
            for (number, target) in primitive.of.morph_targets().enumerate() {
                let accessor = primitive.displacements(context, (number, &target), name)?;
                targets.push(accessor.map(|accessor| accessor.index()));
            }
        }
        let primitive = primitive.of;
        let joints = (0..).map_while(|set| primitive.get(&Semantic::Joints(set)));
        let weights = (0..).map_while(|set| primitive.get(&Semantic::Weights(set)));
        targets.extend(joints.chain(weights).map(|accessor| Some(accessor.index())));
        Ok(targets)
    }

    /// The vertices of a primitive in the world: displaced by morph targets, then moved by joints or placed by the
    /// node's transform.
    ///
    /// # Errors
    /// When targets, joints or weights do not fit its vertices.
    pub(super) fn bend(
        &self,
        context: &mut Context,
        primitive: Placed,
        attributes: &Attributes,
        transform: &NodeTransform,
    ) -> Result<Bent, String> {
        if self.is_none(primitive.of) {
            return placed(context, attributes, transform);
        }
        let directions = |accessor: &Option<Accessor>, name| {
            accessor.as_ref().map_or(Ok(Vec::new()), |accessor| read_attribute::<3>(context, name, accessor))
        };
        let positions = read_attribute::<3>(context, "POSITION", &attributes.positions)?;
        let normals = directions(&attributes.normals, "NORMAL")?;
        let (mut tangents, mut signs) = (Vec::new(), Vec::new());
        if let Some(accessor) = &attributes.tangents {
            let read = read_attribute::<4>(context, "TANGENT", accessor)?;
            (tangents, signs) = read.into_iter().map(|[x, y, z, w]| ([x, y, z], 1.0_f32.copysign(w))).unzip();
        }
        let displaced = |name, rest| -> Result<Vec<DVec3>, String> {
            let vectors = self.displaced::<3>(context, primitive, name, rest)?;
            Ok(vectors.into_iter().map(DVec3::from_array).collect())
        };
        let positions = displaced("POSITION", positions)?;
        let normals = displaced("NORMAL", normals)?;
        let tangents = displaced("TANGENT", tangents)?;
        let skin = match &self.joints {
            Some(joints) => skin(context, primitive.of, joints, positions.len())?,
            None => None,
        };
        Ok(match skin {
            Some(skin) => skinned(&skin, &positions, &normals, &tangents, &signs),
            None => moved(transform, &positions, &normals, &tangents, &signs),
        })
    }

    /// Adds the displacements of an attribute by the morph targets, each as often as its weight says.
    ///
    /// # Errors
    /// When displacements are not those of the vertices, or cannot be read.
    fn displaced<const N: usize>(
        &self,
        context: &Context,
        primitive: Placed,
        name: &str,
        rest: Vec<[f32; N]>,
    ) -> Result<Vec<[f64; N]>, String> {
        let displaced = self.weights.iter().filter(|weight| **weight != 0.0).count();
        if displaced.saturating_mul(rest.len()) > MOST_DISPLACED {
            return Err(format!(
                "{displaced} morph targets of {} vertices; at most {MOST_DISPLACED} displacements are supported",
                rest.len()
            ));
        }
        let mut sums: Vec<[f64; N]> = rest.into_iter().map(|vector| vector.map(f64::from)).collect();
        for (number, (target, &weight)) in primitive.of.morph_targets().zip(&self.weights).enumerate() {
            // A vertex without a normal is not displaced into having one.
            if weight == 0.0 || sums.is_empty() {
                continue;
            }
            let Some(accessor) = primitive.displacements(context, (number, &target), name)? else { continue };
            let place = format!("targets[{number}].{name}");
            if accessor.count() != sums.len() {
                return Err(format!("{place} has {} elements for {} vertices", accessor.count(), sums.len()));
            }
            for (sum, displacement) in sums.iter_mut().zip(displacements::<N>(context, &place, &accessor)?) {
                for (sum, displacement) in sum.iter_mut().zip(displacement) {
                    *sum += f64::from(displacement) * weight;
                }
            }
        }
        Ok(sums)
    }

    /// Texture coordinates or colours with their displacements, rounded once.
    ///
    /// # Errors
    /// When displacements are not those of the vertices, or cannot be read.
    pub(super) fn displaced_values<const N: usize>(
        &self,
        context: &Context,
        primitive: Placed,
        name: &str,
        rest: Vec<[f32; N]>,
    ) -> Result<Vec<[f32; N]>, String> {
        if !self.displaces(primitive.of) {
            return Ok(rest);
        }
        let displaced = self.displaced(context, primitive, name, rest)?;
        Ok(displaced.into_iter().map(|value| value.map(|component| component as f32)).collect())
    }
}

/// A primitive and the number of its mesh.
#[derive(Clone, Copy)]
pub(super) struct Placed<'a, 'p> {
    pub(super) mesh: usize,
    pub(super) of: &'p Primitive<'a>,
}

impl<'a> Placed<'a, '_> {
    /// The displacements of an attribute by a morph target. `None` if it displaces none.
    fn displacements(
        self,
        context: &Context<'a>,
        (number, target): (usize, &MorphTarget<'a>),
        name: &str,
    ) -> Result<Option<Accessor<'a>>, String> {
        match name {
            "POSITION" => Ok(target.positions()),
            "NORMAL" => Ok(target.normals()),
            "TANGENT" => Ok(target.tangents()),
            _ => context.targets.accessor(context.document, [self.mesh, self.of.index(), number], name),
        }
    }
}

/// Displacements of `N` components each. Colours without alpha leave it as it is.
fn displacements<const N: usize>(
    context: &Context,
    place: &str,
    accessor: &Accessor,
) -> Result<Vec<[f32; N]>, String> {
    if N == 4 && accessor.dimensions() == Dimensions::Vec3 {
        let colours = read_attribute::<3>(context, place, accessor)?;
        let widened =
            |colour: [f32; 3]| std::array::from_fn(|channel| colour.get(channel).copied().unwrap_or(0.0));
        return Ok(colours.into_iter().map(widened).collect());
    }
    read_attribute::<N>(context, place, accessor)
}

/// Four joints that each vertex follows, and their weights.
struct InfluenceSet {
    followed: Vec<[f32; 4]>,
    weights: Vec<[f32; 4]>,
}

/// The skin of a primitive. `None`, with a warning, if its vertices follow no joints.
fn skin(
    context: &mut Context,
    primitive: &Primitive,
    joints: &[DMat4],
    count: usize,
) -> Result<Option<Skin>, String> {
    let mut sets: Vec<InfluenceSet> = Vec::new();
    for set in 0.. {
        let found = (primitive.get(&Semantic::Joints(set)), primitive.get(&Semantic::Weights(set)));
        let (Some(followed), Some(weights)) = found else { break };
        for (name, accessor) in [("JOINTS", &followed), ("WEIGHTS", &weights)] {
            if accessor.count() != count {
                return Err(format!("{} elements of {name}_{set} for {count} of POSITION", accessor.count()));
            }
        }
        let followed = accessor::plain_vectors(context.buffers, &followed)
            .map_err(|problem| format!("JOINTS_{set} (accessors[{}]): {problem}", followed.index()))?;
        let weights = read_attribute(context, &format!("WEIGHTS_{set}"), &weights)?;
        sets.push(InfluenceSet { followed, weights });
    }
    if sets.is_empty() {
        context.session.warnings.add("A mesh has a skin but no joints; it keeps its rest shape.");
        return Ok(None);
    }
    let influences = |vertex: usize| {
        let of_set = move |InfluenceSet { followed, weights }: &InfluenceSet| {
            let (followed, weights) = (followed[vertex], weights[vertex]);
            // Joints are integers of at most 16 bits; what is none becomes one that does not exist.
            [0, 1, 2, 3].map(|i| (followed[i].clamp(0.0, f32::from(u16::MAX)) as u16, weights[i]))
        };
        sets.iter().flat_map(of_set)
    };
    let influences = (0..count).flat_map(influences).collect();
    Skin::new(joints, influences, 4 * sets.len()).map(Some).map_err(|error| error.to_string())
}

/// The vertices as joints move them. The node's own place does not matter.
fn skinned(skin: &Skin, positions: &[DVec3], normals: &[DVec3], tangents: &[DVec3], signs: &[f32]) -> Bent {
    let vertex = |vertex: usize| {
        let bend = skin.bend(vertex);
        let normal = normals.get(vertex).map(|normal| bend.normal(*normal));
        let tangent = tangents.get(vertex).map(|tangent| bend.tangent(*tangent, signs[vertex]));
        (bend.position(positions[vertex]), normal, tangent, bend.mirrors())
    };
    let bent: Vec<_> = (0..positions.len()).into_par_iter().map(vertex).collect();
    let mirrored = bent.iter().filter(|(.., mirrors)| *mirrors).count();
    Bent {
        positions: bent.iter().map(|(position, ..)| *position).collect(),
        normals: bent.iter().filter_map(|(_, normal, ..)| *normal).collect(),
        tangents: bent.iter().filter_map(|(_, _, tangent, _)| *tangent).collect(),
        mirrors: 2 * mirrored > positions.len(),
    }
}

/// The displaced vertices as the node's transform places them.
fn moved(
    NodeTransform { placement, directions }: &NodeTransform,
    positions: &[DVec3],
    normals: &[DVec3],
    tangents: &[DVec3],
    signs: &[f32],
) -> Bent {
    let tangents = tangents.iter().zip(signs);
    Bent {
        positions: positions.iter().map(|position| placement.point(position.as_vec3())).collect(),
        normals: normals.iter().map(|normal| directions.normal(*normal)).collect(),
        tangents: tangents.map(|(tangent, sign)| directions.tangent(*tangent, *sign)).collect(),
        mirrors: directions.mirrors(),
    }
}

/// The vertices of a primitive that nothing bends, placed as they are read.
///
/// # Errors
/// When an attribute cannot be read.
fn placed(
    context: &Context,
    Attributes { positions, normals, tangents, .. }: &Attributes,
    NodeTransform { placement, directions }: &NodeTransform,
) -> Result<Bent, String> {
    let point = |position| placement.point(Vec3::from_array(position));
    let normal = |normal| directions.normal(Vec3::from_array(normal).as_dvec3());
    let tangent =
        |[x, y, z, w]: [f32; 4]| directions.tangent(Vec3::new(x, y, z).as_dvec3(), 1.0_f32.copysign(w));
    let positions = mapped_attribute(context, "POSITION", positions, point)?;
    let normals = normals.as_ref().map(|of| mapped_attribute(context, "NORMAL", of, normal)).transpose()?;
    let tangents =
        tangents.as_ref().map(|of| mapped_attribute(context, "TANGENT", of, tangent)).transpose()?;
    Ok(Bent {
        positions,
        normals: normals.unwrap_or_default(),
        tangents: tangents.unwrap_or_default(),
        mirrors: directions.mirrors(),
    })
}
