//! Decompresses the primitives of KHR_draco_mesh_compression.

use super::super::LoadProblem;
use super::super::guard::guarded;
use super::super::session::Session;
use super::buffers::{Buffers, Decompressed, number};
use ::gltf::accessor::{Accessor, DataType};
use ::gltf::json::Value;
use ::gltf::mesh::Mode;
use ::gltf::{Document, Primitive, Semantic};
use draco_core::{DecodeLimits, DecoderBuffer, Mesh, MeshDecoder, PointIndex};
use std::collections::BTreeMap;

const NAME: &str = "KHR_draco_mesh_compression";

/// Bytes that the decoder takes for each face beside its attributes: corner tables, and the order of traversal.
const FACE_BYTES: u64 = 200;

/// The elements of all accessors that compressed primitives fill, by the accessor's index.
///
/// # Errors
/// When a primitive is damaged, or does not have what its accessors promise, or all of them are over the budget.
pub(super) fn decompress(
    session: &Session,
    document: &Document,
    buffers: &Buffers,
) -> Result<BTreeMap<usize, Decompressed>, LoadProblem> {
    let mut filled = Filled::default();
    for mesh in document.meshes() {
        for primitive in mesh.primitives() {
            let Some(extension) = primitive.extension_value(NAME) else { continue };
            let place = |problem: String| LoadProblem::Place {
                path: session.path.clone(),
                place: format!("meshes[{}].primitives[{}]", mesh.index(), primitive.index()),
                problem: format!("compressed by Draco: {problem}"),
            };
            let stream = Stream::new(document, &primitive, extension, buffers).map_err(place)?;
            if filled.has(&stream).map_err(place)? {
                continue;
            }
            // Faces, attributes as they are stored, and as accessors have them.
            let needed =
                stream.bytes.saturating_mul(3).saturating_add(FACE_BYTES.saturating_mul(stream.faces));
            let what = format!("a Draco mesh of {} triangles", stream.faces);
            let room = session.check(what, needed.saturating_add(filled.bytes));
            room.map_err(|source| session.over(source))?;
            filled.bytes += stream.bytes;
            let mesh = guarded(|| stream.decode()).map_err(place)?;
            filled.add(&stream, &mesh).map_err(place)?;
        }
    }
    Ok(filled.accessors)
}

/// A compressed primitive, and the accessors that it fills.
struct Stream<'a> {
    source: &'a [u8],
    view: usize,
    indices: Accessor<'a>,
    /// The name, the accessor and the identifier of each attribute.
    attributes: Vec<(String, Accessor<'a>, u32)>,
    points: u64,
    faces: u64,
    /// Bytes of all accessors.
    bytes: u64,
}

impl<'a> Stream<'a> {
    fn new(
        document: &'a Document,
        primitive: &Primitive<'a>,
        extension: &Value,
        buffers: &'a Buffers,
    ) -> Result<Self, String> {
        if primitive.mode() != Mode::Triangles {
            return Err(format!("its mode is {:?}; only triangles are supported", primitive.mode()));
        }
        let index = number(extension, "bufferView", None)?;
        let view = document
            .views()
            .nth(index)
            .ok_or_else(|| format!("names bufferViews[{index}], which does not exist"))?;
        let indices = primitive.indices().ok_or("has no indices")?;
        let ids = extension["attributes"].as_object().ok_or("has no attributes")?;
        let mut attributes = Vec::new();
        for (semantic, accessor) in primitive.attributes() {
            let name = semantic.to_string();
            let Some(id) = ids.get(&name) else { continue };
            let id = id.as_u64().and_then(|id| u32::try_from(id).ok());
            attributes.push((
                name.clone(),
                accessor,
                id.ok_or_else(|| format!("{name} has no valid identifier"))?,
            ));
        }
        let positions = primitive.get(&Semantic::Positions).ok_or("has no POSITION attribute")?;
        let size = |accessor: &Accessor| (accessor.count() as u64).saturating_mul(accessor.size() as u64);
        let values = attributes.iter().map(|(_, accessor, _)| size(accessor)).fold(0, u64::saturating_add);
        Ok(Self {
            source: buffers.view(&view)?,
            view: index,
            points: positions.count() as u64,
            faces: indices.count() as u64 / 3,
            bytes: values.saturating_add((indices.count() as u64).saturating_mul(4)),
            indices,
            attributes,
        })
    }

    fn decode(&self) -> Result<Mesh, String> {
        let limits = DecodeLimits::default()
            .with_max_points(self.points)
            .with_max_faces(self.faces)
            // Attributes that the file does not name are decoded as well.
            .with_max_decoded_bytes(self.bytes.saturating_mul(2).saturating_add(1 << 20));
        let mut mesh = Mesh::new();
        let mut buffer = DecoderBuffer::new(self.source).with_limits(limits);
        MeshDecoder::new().decode(&mut buffer, &mut mesh).map_err(|problem| problem.to_string())?;
        let (points, faces) = (mesh.num_points() as u64, mesh.num_faces() as u64);
        if (points, faces) != (self.points, self.faces) {
            return Err(format!(
                "it has {points} vertices and {faces} triangles, but its accessors have {} and {}",
                self.points, self.faces
            ));
        }
        Ok(mesh)
    }
}

/// The accessors filled so far.
#[derive(Default)]
struct Filled {
    accessors: BTreeMap<usize, Decompressed>,
    /// The buffer view and the identifier that filled each accessor. Indices have no identifier.
    sources: BTreeMap<usize, (usize, Option<u32>)>,
    bytes: u64,
}

impl Filled {
    /// The accessors of a primitive, with what fills them.
    fn targets<'s>(stream: &'s Stream) -> impl Iterator<Item = (&'s Accessor<'s>, (usize, Option<u32>))> {
        let attributes =
            stream.attributes.iter().map(|(_, accessor, id)| (accessor, (stream.view, Some(*id))));
        attributes.chain([(&stream.indices, (stream.view, None))])
    }

    /// True if an earlier primitive filled all accessors of this one, which some files show several times.
    ///
    /// # Errors
    /// When another stream filled one of them.
    fn has(&self, stream: &Stream) -> Result<bool, String> {
        let mut missing = 0;
        for (accessor, source) in Self::targets(stream) {
            match self.sources.get(&accessor.index()) {
                Some(&known) if known != source => {
                    return Err(format!(
                        "accessors[{}] is filled by bufferViews[{}] and by bufferViews[{}]; give each its own",
                        accessor.index(),
                        known.0,
                        source.0
                    ));
                }
                Some(_) => {}
                None => missing += 1,
            }
        }
        Ok(missing == 0)
    }

    fn add(&mut self, stream: &Stream, mesh: &Mesh) -> Result<(), String> {
        let corners = mesh.faces().as_flattened().iter().flat_map(|&PointIndex(corner)| corner.to_le_bytes());
        let indices = Decompressed { kind: DataType::U32, bytes: corners.collect() };
        self.accessors.insert(stream.indices.index(), indices);
        for (name, accessor, id) in &stream.attributes {
            let bytes = elements(mesh, *id, accessor).map_err(|problem| format!("{name}: {problem}"))?;
            self.accessors.insert(accessor.index(), Decompressed { kind: accessor.data_type(), bytes });
        }
        self.sources.extend(Self::targets(stream).map(|(accessor, source)| (accessor.index(), source)));
        Ok(())
    }
}

/// The elements of an attribute, in the order of the points and in the type of an accessor.
fn elements(mesh: &Mesh, id: u32, accessor: &Accessor) -> Result<Vec<u8>, String> {
    let attribute = mesh.attribute_by_unique_id(id).ok_or_else(|| format!("there is no attribute {id}"))?;
    let width = accessor.dimensions().multiplicity();
    if usize::from(attribute.num_components()) != width {
        return Err(format!("{} components, but its accessor has {width}", attribute.num_components()));
    }
    let points = mesh.num_points();
    if accessor.count() != points {
        return Err(format!(
            "{} elements in accessors[{}], but {points} vertices",
            accessor.count(),
            accessor.index()
        ));
    }
    let kind = accessor.data_type();
    let mut bytes = Vec::with_capacity(points * width * kind.size());
    for value in attribute.read_f32s(points, width) {
        // Conversions to integers saturate.
        match kind {
            DataType::I8 => bytes.extend((value as i8).to_le_bytes()),
            DataType::U8 => bytes.push(value as u8),
            DataType::I16 => bytes.extend((value as i16).to_le_bytes()),
            DataType::U16 => bytes.extend((value as u16).to_le_bytes()),
            DataType::U32 => bytes.extend((value as u32).to_le_bytes()),
            DataType::F32 => bytes.extend(value.to_le_bytes()),
        }
    }
    Ok(bytes)
}
