//! Converts mesh primitives to world-space triangles.

use super::super::LoadProblem;
use super::Context;
use super::accessor;
use super::instance::InstancesByGeometry;
use super::material::Converted;
use crate::geom::{MAX_COORDINATE, Placement};
use crate::scene::{AlphaMode, Instance, MAX_TRIANGLES, Mesh, MeshError, Shape};
use ::gltf::mesh::Mode;
use ::gltf::{Accessor, Primitive, Semantic};
use glam::{DMat3, DMat4, DVec3, Vec2, Vec3, Vec4};
use std::collections::BTreeMap;

/// The triangles of all nodes visited so far.
pub(super) struct Flattened<'a> {
    materials: &'a [Converted],
    mesh: Mesh,
    instances: InstancesByGeometry<'a>,
    uses_fallback: bool,
}

/// The accessors of a primitive's vertices. Primitives of one mesh often share them.
#[derive(Clone)]
struct Attributes<'a> {
    positions: Accessor<'a>,
    normals: Option<Accessor<'a>>,
    uvs: Option<Accessor<'a>>,
    tangents: Option<Accessor<'a>>,
}

/// The transform of a node.
struct NodeTransform {
    matrix: DMat4,
    /// The same transform for positions, with the operations that instances use.
    placement: Placement,
    /// Inverse transpose of the linear part, up to a positive factor.
    normals: DMat3,
    /// Whether the transform mirrors, which reverses the orientation of triangles.
    mirrors: bool,
}

impl NodeTransform {
    fn new(matrix: &DMat4) -> Self {
        let linear = DMat3::from_mat4(*matrix);
        let [x, y, z] = [linear.x_axis, linear.y_axis, linear.z_axis];
        let mirrors = x.cross(y).dot(z) < 0.0;
        let sign = if mirrors { -1.0 } else { 1.0 };
        // The cofactors, which are defined even if the matrix has no inverse.
        let normals = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y)) * sign;
        Self { matrix: *matrix, placement: Placement::new(matrix), normals, mirrors }
    }
}

impl<'a> Flattened<'a> {
    pub(super) fn new(materials: &'a [Converted]) -> Self {
        Self {
            materials,
            mesh: Mesh::default(),
            instances: InstancesByGeometry::default(),
            uses_fallback: false,
        }
    }

    /// The mesh, the instanced shapes, and whether any triangle needs the fallback material.
    ///
    /// # Errors
    /// When an accessor cannot be read.
    pub(super) fn finish(mut self, context: &Context) -> Result<(Mesh, Vec<Shape>, bool), LoadProblem> {
        let mesh = &mut self.mesh;
        let count = mesh.positions.len();
        // An attribute that no vertex has stays empty.
        if !mesh.normals.is_empty() {
            pad(&mut mesh.normals, count);
        }
        if !mesh.uvs.is_empty() {
            pad(&mut mesh.uvs, count);
        }
        if !mesh.tangents.is_empty() {
            pad(&mut mesh.tangents, count);
        }
        Ok((self.mesh, self.instances.shapes(context)?, self.uses_fallback))
    }

    /// Number of triangles so far.
    pub(super) fn triangles(&self) -> u32 {
        self.mesh.triangles.len() as u32
    }

    /// Adds one instance of a mesh.
    ///
    /// # Errors
    /// When a primitive names something that does not exist, or a vertex is out of bounds.
    pub(super) fn append(
        &mut self,
        context: &mut Context,
        mesh: &::gltf::Mesh<'a>,
        matrix: &DMat4,
    ) -> Result<(), LoadProblem> {
        let transform = NodeTransform::new(matrix);
        let mut bases = BTreeMap::new();
        for primitive in mesh.primitives() {
            if primitive.morph_targets().next().is_some() {
                context.session.warnings.add("Morph targets are not supported; meshes keep their rest shape.");
            }
            if matches!(primitive.mode(), Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip) {
                context.session.warnings.add("Points and lines are ignored, because they have no surface.");
                continue;
            }
            let place = || format!("meshes[{}].primitives[{}]", mesh.index(), primitive.index());
            self.primitive(context, &primitive, &transform, &mut bases)
                .map_err(|problem| context.error(place(), problem))?;
        }
        Ok(())
    }

    fn primitive(
        &mut self,
        context: &mut Context,
        primitive: &Primitive<'a>,
        transform: &NodeTransform,
        bases: &mut BTreeMap<[Option<usize>; 4], u32>,
    ) -> Result<(), String> {
        let material = primitive.material().index();
        let attributes = self.attributes(context, primitive, material)?;
        let count = attributes.positions.count();
        let base = match bases.get(&attributes.key()) {
            Some(&base) => base,
            None => {
                *bases.entry(attributes.key()).or_insert(self.vertices(context, &attributes, transform)?)
            }
        };
        let indices = indices(context, primitive, count)?;
        if primitive.mode() == Mode::Triangles && indices.len() % 3 != 0 {
            context.session.warnings.add("A mesh has indices left over after its last triangle; they are ignored.");
        }
        let masked = material.is_some_and(|m| self.materials[m].material.alpha.mode != AlphaMode::Opaque);
        let material = material.unwrap_or_else(|| {
            self.uses_fallback = true;
            self.materials.len()
        }) as u32;
        let triangles = triangles(primitive.mode(), &indices);
        let found = self.mesh.triangles.len() + triangles.len();
        if found > MAX_TRIANGLES {
            // Checked here, before many instances in a small file fill the memory.
            return Err(MeshError::TooMany { found, max: MAX_TRIANGLES }.to_string());
        }
        let instance = Instance { placement: transform.placement, first: self.mesh.triangles.len() as u32 };
        self.instances.add(primitive, transform.mirrors, masked, instance);
        for [a, b, c] in triangles {
            let [b, c] = if transform.mirrors { [c, b] } else { [b, c] };
            self.mesh.triangles.push([base + a, base + b, base + c]);
            self.mesh.materials.push(material);
        }
        Ok(())
    }

    fn attributes<'p>(
        &self,
        context: &mut Context,
        primitive: &Primitive<'p>,
        material: Option<usize>,
    ) -> Result<Attributes<'p>, String> {
        let set = material.map_or(0, |material| self.materials[material].uv_set);
        let mut uvs = primitive.get(&Semantic::TexCoords(set));
        if uvs.is_none() && set != 0 {
            context.session.warnings.add(format!(
                "A mesh has no TEXCOORD_{set}, which its material uses; TEXCOORD_0 is used instead."
            ));
            uvs = primitive.get(&Semantic::TexCoords(0));
        }
        let normals = primitive.get(&Semantic::Normals);
        let attributes = Attributes {
            positions: primitive.get(&Semantic::Positions).ok_or("has no POSITION attribute")?,
            // Tangents are ignored without normals, as glTF requires.
            tangents: primitive.get(&Semantic::Tangents).filter(|_| normals.is_some()),
            normals,
            uvs,
        };
        let count = attributes.positions.count();
        for (name, accessor) in [
            ("NORMAL", &attributes.normals),
            ("TEXCOORD", &attributes.uvs),
            ("TANGENT", &attributes.tangents),
        ] {
            if let Some(found) = accessor.as_ref().map(Accessor::count).filter(|&found| found != count) {
                return Err(format!("{found} elements of {name} for {count} of POSITION"));
            }
        }
        Ok(attributes)
    }

    /// Adds vertices. Returns the index of the first.
    fn vertices(
        &mut self,
        context: &mut Context,
        attributes: &Attributes,
        transform: &NodeTransform,
    ) -> Result<u32, String> {
        let base = self.mesh.positions.len();
        let positions = read_attribute::<3>(context, "POSITION", &attributes.positions)?;
        if u32::try_from(base + positions.len()).is_err() {
            return Err(format!(
                "the scene has more than {} vertices, the most that are supported",
                u32::MAX
            ));
        }
        for (i, position) in positions.iter().enumerate() {
            let moved = transform.placement.point(Vec3::from(*position));
            // The comparison fails for NaN, too.
            if !moved.abs().cmple(Vec3::splat(MAX_COORDINATE)).all() {
                let [x, y, z] = position;
                return Err(format!(
                    "vertex {i} is at ({x}, {y}, {z}), {moved} in the world; coordinates must be finite \
                     and at most {MAX_COORDINATE:e} in magnitude"
                ));
            }
            self.mesh.positions.push(moved);
        }
        if let Some(accessor) = &attributes.normals {
            pad(&mut self.mesh.normals, base);
            let world_normal = |n: [f32; 3]| unit(transform.normals * DVec3::from_array(n.map(f64::from)));
            self.mesh
                .normals
                .extend(read_attribute(context, "NORMAL", accessor)?.into_iter().map(world_normal));
        }
        if let Some(accessor) = &attributes.uvs {
            pad(&mut self.mesh.uvs, base);
            let finite = |uv: [f32; 2]| Some(Vec2::from_array(uv)).filter(|uv| uv.is_finite());
            let uvs = read_attribute(context, "TEXCOORD", accessor)?;
            self.mesh.uvs.extend(uvs.into_iter().map(|uv| finite(uv).unwrap_or_default()));
        }
        if let Some(accessor) = &attributes.tangents {
            pad(&mut self.mesh.tangents, base);
            let sign = if transform.mirrors { -1.0 } else { 1.0 };
            let world_tangent = |[x, y, z, w]: [f32; 4]| {
                let tangent = unit(transform.matrix.transform_vector3(Vec3::new(x, y, z).as_dvec3()));
                if tangent == Vec3::ZERO { Vec4::ZERO } else { tangent.extend(1.0_f32.copysign(w) * sign) }
            };
            self.mesh
                .tangents
                .extend(read_attribute(context, "TANGENT", accessor)?.into_iter().map(world_tangent));
        }
        Ok(base as u32)
    }
}

impl Attributes<'_> {
    fn key(&self) -> [Option<usize>; 4] {
        let index = |accessor: &Option<Accessor>| accessor.as_ref().map(Accessor::index);
        [Some(self.positions.index()), index(&self.normals), index(&self.uvs), index(&self.tangents)]
    }
}

fn read_attribute<const N: usize>(
    context: &Context,
    name: &str,
    accessor: &Accessor,
) -> Result<Vec<[f32; N]>, String> {
    accessor::vectors(context.buffers, accessor)
        .map_err(|problem| format!("{name} (accessors[{}]): {problem}", accessor.index()))
}

/// The indices of a primitive of `count` vertices.
pub(super) fn indices(context: &Context, primitive: &Primitive, count: usize) -> Result<Vec<u32>, String> {
    let indices = match primitive.indices() {
        None => (0..count as u32).collect(),
        Some(accessor) => accessor::indices(context.buffers, &accessor)
            .map_err(|problem| format!("indices (accessors[{}]): {problem}", accessor.index()))?,
    };
    match indices.iter().enumerate().find(|&(_, &i)| i as usize >= count) {
        Some((place, index)) => Err(format!("index {place} names vertex {index}, but there are {count}")),
        None => Ok(indices),
    }
}

/// The unit vector, or zero if the length is zero or not finite.
fn unit(v: DVec3) -> Vec3 {
    v.try_normalize().unwrap_or(DVec3::ZERO).as_vec3()
}

/// Appends zeros for vertices that lack the attribute.
fn pad<T: Default + Clone>(list: &mut Vec<T>, count: usize) {
    list.resize(count, T::default());
}

/// The triangles that a list of vertices forms, in glTF's order.
pub(super) fn triangles(mode: Mode, indices: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Mode::TriangleStrip => {
            let triangle =
                |(i, w): (usize, &[u32])| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] };
            indices.windows(3).enumerate().map(triangle).collect()
        }
        Mode::TriangleFan => {
            let Some((&first, rest)) = indices.split_first() else { return Vec::new() };
            rest.windows(2).map(|w| [w[0], w[1], first]).collect()
        }
        _ => indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
    }
}
