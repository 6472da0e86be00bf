//! Converts mesh primitives to world-space triangles.

use super::super::LoadProblem;
use super::super::dropped::Dropped;
use super::super::strokes::{self, Strokes};
use super::Context;
use super::accessor;
use super::bent::{Bending, Bent, Placed};
use super::buffers::Buffers;
use super::instance::InstancesByGeometry;
use super::material::Converted;
use super::own_attribute::{OwnAttribute, Widths};
use super::variant::MaterialsByPrimitive;
use crate::geom::{Bend, Placement};
use crate::lanes::each;
use crate::scene::{AlphaMode, Instance, MeshSize, Shape, TriangleMesh};
use ::gltf::mesh::Mode;
use ::gltf::{Accessor, Primitive, Semantic};
use bytemuck::Pod;
use glam::{DMat4, Vec2, Vec3, Vec4};
use std::collections::{BTreeMap, BTreeSet};

/// The materials of a document, and which primitive has which.
#[derive(Clone, Copy)]
pub(super) struct Materials<'a> {
    pub(super) converted: &'a [Converted],
    pub(super) chosen: &'a MaterialsByPrimitive,
    /// True if primitives without a material keep all sets of texture coordinates.
    pub(super) all_uv_sets: bool,
    /// Attributes of the file's own.
    pub(super) own_attributes: &'a Widths,
}

impl Materials<'_> {
    /// The sets of texture coordinates that a material uses, the first one first.
    fn uv_sets(&self, material: Option<usize>) -> &[u32] {
        let sets = material.map_or(&[][..], |material| &self.converted[material].uv_sets);
        // Surfaces of user code, for instance, see the first set of meshes without textures.
        if sets.is_empty() { &[0] } else { sets }
    }

    /// The sets of a primitive beside those that its material uses, for surfaces of user code. They follow the others.
    fn further_uv_sets(&self, primitive: &Primitive, material: Option<usize>) -> Vec<u32> {
        let used = self.uv_sets(material);
        if !material.map_or(self.all_uv_sets, |material| self.converted[material].has_all_uv_sets) {
            return Vec::new();
        }
        // Without a first set there are no others.
        if !used.iter().take(1).any(|&set| has_uvs(primitive, set) || has_uvs(primitive, 0)) {
            return Vec::new();
        }
        let further = (0..SEEN_SETS as u32).filter(|set| !used.contains(set));
        further.filter(|&set| has_uvs(primitive, set)).take(SEEN_SETS.saturating_sub(used.len())).collect()
    }
}

/// Sets of texture coordinates that surfaces of user code see.
const SEEN_SETS: usize = 4;

/// True if a primitive has a set of texture coordinates, for each of its vertices.
fn has_uvs(primitive: &Primitive, set: u32) -> bool {
    let count = |semantic| Some(primitive.get(&semantic)?.count());
    count(Semantic::TexCoords(set)).is_some_and(|found| count(Semantic::Positions) == Some(found))
}

/// The triangles of all nodes visited so far.
pub(super) struct Flattened<'a> {
    materials: Materials<'a>,
    mesh: TriangleMesh,
    instances: InstancesByGeometry<'a>,
    strokes: Strokes,
    dropped: Dropped,
    uses_fallback: bool,
}

/// The accessors of a primitive's vertices. Primitives of one mesh often share them.
#[derive(Clone)]
pub(super) struct Attributes<'a> {
    pub(super) positions: Accessor<'a>,
    pub(super) normals: Option<Accessor<'a>>,
    /// The sets of texture coordinates, as the material numbers them, each with its name.
    uvs: Vec<Option<(String, Accessor<'a>)>>,
    pub(super) tangents: Option<Accessor<'a>>,
    colours: Option<Accessor<'a>>,
    own: Vec<OwnAttribute<'a>>,
}

/// Vertices by their accessors: the first, and whether their triangles are turned round.
type Bases = BTreeMap<Vec<Option<usize>>, (u32, bool)>;

/// The transform of a node.
pub(super) struct NodeTransform {
    /// For positions, with the operations that instances use.
    pub(super) placement: Placement,
    /// For normals and tangents.
    pub(super) directions: Bend,
}

impl NodeTransform {
    fn new(matrix: &DMat4) -> Self {
        Self { placement: Placement::new(matrix), directions: Bend::new(matrix) }
    }
}

impl<'a> Flattened<'a> {
    pub(super) fn new(materials: Materials<'a>) -> Self {
        Self {
            materials,
            mesh: TriangleMesh::default(),
            instances: InstancesByGeometry::default(),
            strokes: Strokes::default(),
            dropped: Dropped::default(),
            uses_fallback: false,
        }
    }

    /// The mesh, the instanced shapes, whether any triangle needs the fallback material, and the width of strokes.
    ///
    /// # Errors
    /// When an accessor cannot be read.
    pub(super) fn finish(
        mut self,
        context: &mut Context,
    ) -> Result<(TriangleMesh, Vec<Shape>, bool, Option<f32>), LoadProblem> {
        let mesh = &mut self.mesh;
        let width =
            self.strokes.finish(mesh, context.session.options.stroke_width, &mut context.session.warnings);
        self.dropped.finish(&mut mesh.positions, &mut context.session.warnings);
        let count = mesh.positions.len();
        // An attribute that no vertex has stays empty.
        if !mesh.normals.is_empty() {
            pad(&mut mesh.normals, count);
        }
        let mut has_uvs = !mesh.uvs.is_empty();
        for uvs in mesh.more_uvs.iter_mut().filter(|uvs| !uvs.is_empty()) {
            pad(uvs, count);
            has_uvs = true;
        }
        if has_uvs {
            pad(&mut mesh.uvs, count);
        }
        if !mesh.tangents.is_empty() {
            pad(&mut mesh.tangents, count);
        }
        if !mesh.colours.is_empty() {
            mesh.colours.resize(count, Vec4::ONE);
        }
        mesh.complete_attributes();
        Ok((self.mesh, self.instances.shapes(context)?, self.uses_fallback, width))
    }

    /// Number of triangles so far.
    pub(super) fn triangles(&self) -> u32 {
        self.mesh.triangles.len() as u32
    }

    /// Takes the memory for all instances, before many of them in a small file fill it.
    ///
    /// # Errors
    /// When there are too many triangles, or the memory cannot be had.
    pub(super) fn reserve(&mut self, context: &mut Context, size: MeshSize) -> Result<(), LoadProblem> {
        context.session.reserve(&mut self.mesh, size)
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
        bending: &Bending,
    ) -> Result<(), LoadProblem> {
        let transform = NodeTransform::new(matrix);
        let mut bases = BTreeMap::new();
        for primitive in mesh.primitives() {
            if primitive.get(&Semantic::Colors(1)).is_some() {
                context.session.warnings.add("A mesh has several sets of colours; COLOR_0 is used.");
            }
            let place = || place(mesh, &primitive);
            let added = match is_stroke(primitive.mode()) {
                true => self.strokes(context, mesh, &primitive, (&transform, bending)),
                false => self.primitive(context, mesh, &primitive, (&transform, bending), &mut bases),
            };
            added.map_err(|problem| context.error(place(), problem))?;
        }
        Ok(())
    }

    /// Adds balls or tubes for points or lines.
    fn strokes(
        &mut self,
        context: &mut Context,
        mesh: &::gltf::Mesh<'a>,
        primitive: &Primitive<'a>,
        (transform, bending): (&NodeTransform, &Bending),
    ) -> Result<(), String> {
        let material = self.materials.chosen.of(mesh.index(), primitive);
        let attributes = self.attributes(context, primitive, material)?;
        let placed = Placed { mesh: mesh.index(), of: primitive };
        let bent = bending.bend(context, placed, &attributes, transform)?.positions.into_iter().enumerate();
        let place = |i: usize| format!("vertex {i} of {}, in the world", place(mesh, primitive));
        let positions: Vec<Vec3> =
            bent.map(|(i, position)| self.dropped.checked(position, || place(i))).collect();
        let mut ends = ends(primitive.mode(), &indices(context, primitive, positions.len())?);
        ends.retain(|ends| !self.dropped.drops(ends.map(|end| positions[end as usize])));
        let base = self.mesh.positions.len();
        check_count(base + size_of_strokes(primitive.mode(), ends.len() as u64).vertices as usize)?;
        pad(&mut self.mesh.normals, base);
        let stand_for = self.strokes.add(&mut self.mesh, &ends, &positions);
        self.columns(context, (&attributes, bending, placed), base, Some(&stand_for))?;
        let material = self.material_index(material);
        self.mesh.materials.resize(self.mesh.triangles.len(), material);
        Ok(())
    }

    /// The number of a primitive's material in the scene.
    fn material_index(&mut self, material: Option<usize>) -> u32 {
        let fallback = self.materials.converted.len();
        self.uses_fallback |= material.is_none();
        material.unwrap_or(fallback) as u32
    }

    fn primitive(
        &mut self,
        context: &mut Context,
        mesh: &::gltf::Mesh<'a>,
        primitive: &Primitive<'a>,
        (transform, bending): (&NodeTransform, &Bending),
        bases: &mut Bases,
    ) -> Result<(), String> {
        let material = self.materials.chosen.of(mesh.index(), primitive);
        let attributes = self.attributes(context, primitive, material)?;
        let count = attributes.positions.count();
        let placed = Placed { mesh: mesh.index(), of: primitive };
        let key = [attributes.key(), bending.key(context, placed, &attributes.names())?].concat();
        let (base, mirrors) = match bases.get(&key) {
            Some(&found) => found,
            None => {
                let name = || place(mesh, primitive);
                let bent = bending.bend(context, placed, &attributes, transform)?;
                let mirrors = bent.mirrors;
                let first = self.vertices(context, name, (&attributes, bending, placed), bent)?;
                *bases.entry(key).or_insert((first, mirrors))
            }
        };
        let indices = indices(context, primitive, count)?;
        if primitive.mode() == Mode::Triangles && indices.len() % 3 != 0 {
            context
                .session
                .warnings
                .add("A mesh has indices left over after its last triangle; they are ignored.");
        }
        let converted = self.materials.converted;
        let masked = material.is_some_and(|m| converted[m].material.alpha.mode != AlphaMode::Opaque);
        let material = self.material_index(material);
        let first = self.mesh.triangles.len();
        let count = self.add_triangles(primitive.mode(), &indices, (base, mirrors));
        self.mesh.materials.resize(self.mesh.triangles.len(), material);
        // Instances share all triangles of their shape, and none is bent.
        if self.mesh.triangles.len() == first + count && bending.is_none(primitive) {
            let instance = Instance { placement: transform.placement, first: first as u32 };
            self.instances.add(primitive, mirrors, masked, instance);
        }
        Ok(())
    }

    /// Adds the triangles that a list of vertices from `base` on forms, but those that are dropped. Returns how many
    /// there are with these.
    fn add_triangles(&mut self, mode: Mode, indices: &[u32], (base, mirrors): (u32, bool)) -> usize {
        let oriented = |[a, b, c]: [u32; 3]| {
            let [b, c] = if mirrors { [c, b] } else { [b, c] };
            [base + a, base + b, base + c]
        };
        let Self { mesh: TriangleMesh { positions, triangles: list, .. }, dropped, .. } = self;
        if mode == Mode::Triangles && dropped.is_empty() {
            let (triples, _) = indices.as_chunks::<3>();
            list.extend(triples.iter().map(|&triple| oriented(triple)));
            return triples.len();
        }
        let triangles = triangles(mode, indices);
        for &corners in &triangles {
            let triangle = oriented(corners);
            if !dropped.drops(each(triangle, |corner| positions[corner as usize])) {
                list.push(triangle);
            }
        }
        triangles.len()
    }

    fn attributes<'p>(
        &self,
        context: &mut Context,
        primitive: &Primitive<'p>,
        material: Option<usize>,
    ) -> Result<Attributes<'p>, String> {
        let mut uvs = Vec::new();
        for &set in self.materials.uv_sets(material) {
            let of = |set| Some((format!("TEXCOORD_{set}"), primitive.get(&Semantic::TexCoords(set))?));
            let mut found = of(set);
            if found.is_none() && set != 0 {
                context.session.warnings.add(format!(
                    "A mesh has no TEXCOORD_{set}, which its material uses; TEXCOORD_0 is used instead."
                ));
                found = of(0);
            }
            uvs.push(found);
        }
        for set in self.materials.further_uv_sets(primitive, material) {
            let accessor = primitive.get(&Semantic::TexCoords(set));
            uvs.push(accessor.map(|accessor| (format!("TEXCOORD_{set}"), accessor)));
        }
        let normals = primitive.get(&Semantic::Normals);
        let attributes = Attributes {
            positions: primitive.get(&Semantic::Positions).ok_or("has no POSITION attribute")?,
            // Tangents are ignored without normals, as glTF requires.
            tangents: primitive.get(&Semantic::Tangents).filter(|_| normals.is_some()),
            normals,
            uvs,
            colours: primitive.get(&Semantic::Colors(0)),
            own: self.materials.own_attributes.kept(primitive),
        };
        let count = attributes.positions.count();
        let uvs = attributes.uvs.iter().flatten().map(|(name, uvs)| (&**name, Some(uvs)));
        for (name, accessor) in [
            ("NORMAL", attributes.normals.as_ref()),
            ("TANGENT", attributes.tangents.as_ref()),
            ("COLOR_0", attributes.colours.as_ref()),
        ]
        .into_iter()
        .chain(uvs)
        .chain(attributes.own.iter().map(|own| (&*own.source, Some(&own.accessor))))
        {
            if let Some(found) = accessor.map(Accessor::count).filter(|&found| found != count) {
                return Err(format!("{found} elements of {name} for {count} of POSITION"));
            }
        }
        Ok(attributes)
    }

    /// Adds vertices. Returns the index of the first.
    fn vertices(
        &mut self,
        context: &mut Context,
        place: impl Fn() -> String,
        (attributes, bending, placed): (&Attributes, &Bending, Placed),
        Bent { positions, normals, tangents, .. }: Bent,
    ) -> Result<u32, String> {
        let base = self.mesh.positions.len();
        check_count(base + positions.len())?;
        if Dropped::drops_none_of(&positions) {
            self.mesh.positions.extend_from_slice(&positions);
        } else {
            for (i, position) in positions.into_iter().enumerate() {
                let place = || format!("vertex {i} of {}, in the world", place());
                self.mesh.positions.push(self.dropped.checked(position, place));
            }
        }
        if attributes.normals.is_some() {
            pad(&mut self.mesh.normals, base);
            self.mesh.normals.extend(normals);
        }
        self.columns(context, (attributes, bending, placed), base, None)?;
        if attributes.tangents.is_some() {
            pad(&mut self.mesh.tangents, base);
            self.mesh.tangents.extend(tangents);
        }
        Ok(base as u32)
    }

    /// Adds texture coordinates and colours of the vertices from `base` on: one after the other, or those that new
    /// vertices stand for.
    fn columns(
        &mut self,
        context: &Context,
        (attributes, bending, placed): (&Attributes, &Bending, Placed),
        base: usize,
        stand_for: Option<&[u32]>,
    ) -> Result<(), String> {
        let mesh = &mut self.mesh;
        for (set, accessor) in attributes.uvs.iter().enumerate() {
            let Some((name, accessor)) = accessor else { continue };
            let uvs = read_attribute::<2>(context, name, accessor)?;
            let uvs = bending.displaced_values(context, placed, name, uvs)?;
            mesh.more_uvs.resize(mesh.more_uvs.len().max(set), Vec::new());
            let column = if set == 0 { &mut mesh.uvs } else { &mut mesh.more_uvs[set - 1] };
            pad(column, base);
            let finite = |uv: [f32; 2]| Some(Vec2::from_array(uv)).filter(|uv| uv.is_finite());
            extend(column, uvs, stand_for, |uv| finite(uv).unwrap_or_default());
        }
        if let Some(accessor) = &attributes.colours {
            mesh.colours.resize(base, Vec4::ONE);
            let colours = accessor::colours(context.buffers, accessor)
                .map_err(|problem| format!("COLOR_0 (accessors[{}]): {problem}", accessor.index()))?;
            let colours = colours.into_iter().map(|colour| colour.to_array()).collect();
            let colours = bending.displaced_values(context, placed, "COLOR_0", colours)?;
            // The comparison fails for NaN.
            let clamped = |channel: f32| if channel > 0.0 { channel.min(1.0) } else { 0.0 };
            extend(&mut mesh.colours, colours, stand_for, |colour| Vec4::from_array(colour.map(clamped)));
        }
        for own in &attributes.own {
            let values = own.values(context, (bending, placed), stand_for)?;
            mesh.attribute_from(&own.name, own.width, base).extend(values);
        }
        Ok(())
    }
}

/// Appends values: all of them, or those of some vertices.
fn extend<T: Copy, U>(column: &mut Vec<U>, values: Vec<T>, of: Option<&[u32]>, made: impl Fn(T) -> U) {
    match of {
        None => column.extend(values.into_iter().map(made)),
        Some(vertices) => column.extend(vertices.iter().map(|&vertex| made(values[vertex as usize]))),
    }
}

/// True for points and lines.
fn is_stroke(mode: Mode) -> bool {
    matches!(mode, Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip)
}

/// The size of the balls or tubes of so many points or lines.
fn size_of_strokes(mode: Mode, count: u64) -> MeshSize {
    if mode == Mode::Points { strokes::size_of_points(count) } else { strokes::size_of_lines(count) }
}

/// Checks that a mesh of so many vertices can be indexed.
fn check_count(vertices: usize) -> Result<(), String> {
    match u32::try_from(vertices) {
        Ok(_) => Ok(()),
        Err(_) => Err(format!("the scene has more than {} vertices, the most that are supported", u32::MAX)),
    }
}

/// The two ends of each line that a list of vertices forms; points are lines from a vertex to itself.
fn ends(mode: Mode, indices: &[u32]) -> Vec<[u32; 2]> {
    let mut ends: Vec<[u32; 2]> = match mode {
        Mode::Points => indices.iter().map(|&index| [index; 2]).collect(),
        Mode::Lines => indices.chunks_exact(2).map(|line| [line[0], line[1]]).collect(),
        _ => indices.windows(2).map(|line| [line[0], line[1]]).collect(),
    };
    if let (Mode::LineLoop, [first, .., last]) = (mode, indices) {
        ends.push([*last, *first]);
    }
    ends
}

/// The name of a primitive in messages.
fn place(mesh: &::gltf::Mesh, primitive: &Primitive) -> String {
    format!("meshes[{}].primitives[{}]", mesh.index(), primitive.index())
}

/// The size of one copy of a mesh, before any data is read. Accessors tell it; parts that have no surface, or are
/// wrong, count as empty.
pub(super) fn size(buffers: &Buffers, mesh: &::gltf::Mesh, materials: Materials) -> MeshSize {
    let mut size = MeshSize::default();
    let mut counted = BTreeSet::new();
    for primitive in mesh.primitives() {
        let Some(positions) = primitive.get(&Semantic::Positions) else { continue };
        let vertices = accessor::expected_count(buffers, &positions);
        let indices = primitive.indices();
        let corners = indices.map_or(vertices, |indices| accessor::expected_count(buffers, &indices));
        let lines = if primitive.mode() == Mode::Lines { corners / 2 } else { corners };
        let strokes = size_of_strokes(primitive.mode(), lines);
        let triangles = match primitive.mode() {
            mode if is_stroke(mode) => strokes.triangles,
            Mode::Triangles => corners / 3,
            _ => corners.saturating_sub(2),
        };
        let [mut normals, uvs, tangents, colours] =
            [Semantic::Normals, Semantic::TexCoords(0), Semantic::Tangents, Semantic::Colors(0)]
                .map(|semantic| primitive.get(&semantic).is_some());
        let material = materials.chosen.of(mesh.index(), &primitive);
        let sets = materials.uv_sets(material).len() + materials.further_uv_sets(&primitive, material).len();
        let more_uvs = sets as u32 - 1;
        let numbers = materials.own_attributes.numbers(&primitive);
        // Primitives that share all their attributes share their vertices.
        let attributes: Vec<usize> = primitive.attributes().map(|(_, accessor)| accessor.index()).collect();
        let is_bent =
            primitive.morph_targets().next().is_some() || primitive.get(&Semantic::Joints(0)).is_some();
        let mut vertices = if counted.insert(attributes) || is_bent { vertices } else { 0 };
        if is_stroke(primitive.mode()) {
            (vertices, normals) = (strokes.vertices, true);
        }
        size += MeshSize { vertices, triangles, normals, uvs, tangents, colours, more_uvs, numbers };
    }
    size
}

impl Attributes<'_> {
    fn key(&self) -> Vec<Option<usize>> {
        let index = |accessor: &Option<Accessor>| accessor.as_ref().map(Accessor::index);
        let fixed = [&self.normals, &self.tangents, &self.colours].into_iter().map(index);
        let uvs = self.uvs.iter().map(|uvs| uvs.as_ref().map(|(_, accessor)| accessor.index()));
        let own = self.own.iter().map(|own| Some(own.accessor.index()));
        [self.positions.index(), self.own.len()]
            .map(Some)
            .into_iter()
            .chain(fixed)
            .chain(uvs)
            .chain(own)
            .collect()
    }

    /// The names of the attributes that do not depend on the node's place.
    fn names(&self) -> Vec<String> {
        let uvs = self.uvs.iter().flatten().map(|(name, _)| name.clone());
        let colours = self.colours.iter().map(|_| "COLOR_0".to_owned());
        uvs.chain(colours).chain(self.own.iter().map(|own| own.source.clone())).collect()
    }
}

pub(super) fn read_attribute<const N: usize>(
    context: &Context,
    name: &str,
    accessor: &Accessor,
) -> Result<Vec<[f32; N]>, String> {
    mapped_attribute(context, name, accessor, |vector| vector)
}

/// Reads an attribute, and makes a value of each vector.
pub(super) fn mapped_attribute<const N: usize, T: Pod>(
    context: &Context,
    name: &str,
    accessor: &Accessor,
    made: impl Fn([f32; N]) -> T + Sync,
) -> Result<Vec<T>, String> {
    accessor::mapped(context.buffers, accessor, made)
        .map_err(|problem| format!("{name} (accessors[{}]): {problem}", accessor.index()))
}

/// The indices of a primitive of `count` vertices.
pub(super) fn indices(context: &Context, primitive: &Primitive, count: usize) -> Result<Vec<u32>, String> {
    let indices = match primitive.indices() {
        None => (0..count as u32).collect(),
        Some(accessor) => accessor::indices(context.buffers, &accessor)
            .map_err(|problem| format!("indices (accessors[{}]): {problem}", accessor.index()))?,
    };
    // Folding instead of stopping early lets the compiler use vectors.
    let largest = indices.iter().fold(0, |largest, &index| index.max(largest));
    if (largest as usize) < count {
        return Ok(indices);
    }
    match indices.iter().enumerate().find(|&(_, &i)| i as usize >= count) {
        Some((place, index)) => Err(format!("index {place} names vertex {index}, but there are {count}")),
        None => Ok(indices),
    }
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
