//! Instances of a node's mesh (EXT_mesh_gpu_instancing).

use super::super::LoadProblem;
use super::buffers::Buffers;
use super::{Context, accessor};
use crate::scene::unit_rotation;
use ::gltf::{Accessor, Node};
use glam::{DMat4, DQuat, DVec3};

const NAME: &str = "EXT_mesh_gpu_instancing";

/// The attributes that place instances, in this order.
const ATTRIBUTES: [&str; 3] = ["TRANSLATION", "ROTATION", "SCALE"];

/// The accessors that place the instances of a node's mesh, relative to the node.
pub(super) struct Instancing<'a> {
    accessors: [Option<Accessor<'a>>; 3],
}

impl<'a> Instancing<'a> {
    /// The instances of a node. `None` if the node shows its mesh once.
    ///
    /// # Errors
    /// When an attribute names an accessor that does not exist, or their numbers of elements differ.
    pub(super) fn of(context: &mut Context<'a>, node: &Node<'a>) -> Result<Option<Self>, LoadProblem> {
        let Some(extension) = node.extension_value(NAME) else { return Ok(None) };
        if node.mesh().is_none() {
            let warning = format!("nodes[{}]: {NAME} has no effect on a node without a mesh.", node.index());
            context.session.warnings.add(warning);
            return Ok(None);
        }
        let attributes = &extension["attributes"];
        for (name, _) in attributes.as_object().into_iter().flatten() {
            // Names that begin with an underscore are the application's own.
            if !ATTRIBUTES.contains(&name.as_str()) && !name.starts_with('_') {
                context.session.warnings.add(format!("{NAME}: the attribute {name:?} is ignored."));
            }
        }
        let error = |problem: String| context.error(format!("nodes[{}], {NAME}", node.index()), problem);
        let mut accessors = [None, None, None];
        for (name, accessor) in ATTRIBUTES.into_iter().zip(&mut accessors) {
            let Some(index) = attributes.get(name) else { continue };
            let found = index.as_u64().and_then(|index| context.document.accessors().nth(index as usize));
            let count = context.document.accessors().len();
            *accessor = Some(
                found
                    .ok_or_else(|| error(format!("{name} names accessor {index}, but there are {count}")))?,
            );
        }
        let mut counts = accessors.iter().flatten().map(Accessor::count);
        let Some(count) = counts.next() else {
            return Err(error("has none of the attributes TRANSLATION, ROTATION and SCALE".into()));
        };
        if let Some(other) = counts.find(|&other| other != count) {
            return Err(error(format!("its attributes have {count} and {other} elements")));
        }
        Ok(Some(Self { accessors }))
    }

    /// The number of instances that memory may be taken for.
    pub(super) fn expected_count(&self, buffers: &Buffers) -> u64 {
        self.accessors
            .iter()
            .flatten()
            .map(|accessor| accessor::expected_count(buffers, accessor))
            .min()
            .unwrap_or(0)
    }

    /// Reads the transforms.
    ///
    /// # Errors
    /// When an accessor cannot be read.
    pub(super) fn read(&self, context: &Context) -> Result<Transforms, String> {
        let [translation, rotation, scale] = &self.accessors;
        Ok(Transforms {
            translations: column(context, ATTRIBUTES[0], translation)?,
            rotations: column(context, ATTRIBUTES[1], rotation)?,
            scales: column(context, ATTRIBUTES[2], scale)?,
        })
    }
}

fn column<const N: usize>(
    context: &Context,
    name: &str,
    accessor: &Option<Accessor>,
) -> Result<Vec<[f32; N]>, String> {
    let Some(accessor) = accessor else { return Ok(Vec::new()) };
    accessor::vectors(context.buffers, accessor)
        .map_err(|problem| format!("{NAME}, {name} (accessors[{}]): {problem}", accessor.index()))
}

/// The transforms of instances, relative to their node. Columns that the file leaves out are empty.
pub(super) struct Transforms {
    translations: Vec<[f32; 3]>,
    rotations: Vec<[f32; 4]>,
    scales: Vec<[f32; 3]>,
}

impl Transforms {
    /// Bytes of one transform.
    pub(super) const BYTES: u64 = (3 + 4 + 3) * 4;

    /// The matrices, one an instance.
    pub(super) fn matrices(&self) -> impl Iterator<Item = DMat4> {
        let count = self.translations.len().max(self.rotations.len()).max(self.scales.len());
        let vector =
            |row: Option<&[f32; 3]>, unset| row.map_or(unset, |row| DVec3::from_array(row.map(f64::from)));
        (0..count).map(move |i| {
            let turned = |row: &[f32; 4]| unit_rotation(DQuat::from_array(row.map(f64::from)));
            DMat4::from_scale_rotation_translation(
                vector(self.scales.get(i), DVec3::ONE),
                self.rotations.get(i).map_or(DQuat::IDENTITY, turned),
                vector(self.translations.get(i), DVec3::ZERO),
            )
        })
    }
}
