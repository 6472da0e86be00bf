//! Scenes put together in memory: named meshes at their places, with materials and textures.

use super::mesh::check_positions;
use super::{
    ColourSpace, Instance, Material, MeshError, MeshSize, Object, Objects, Scene, SceneError, Shape, Shared,
    SurfaceRequest, Texture, TextureImage, TextureUse, TriangleMesh, VertexAttribute, Wrap,
};
use crate::geom::{Bend, Placement};
use crate::memory::{MemoryBudget, OutOfMemory};
use glam::{DMat4, Vec2, Vec3, Vec4};
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap, HashSet};

/// A mesh of an [`Assembly`], with its name, its material and its places.
#[derive(Clone, Debug)]
pub struct Part {
    /// Name of the object; no other part has it.
    pub name: String,
    /// The mesh in its own space. All its triangles have the material 0, as [`TriangleMesh::new`] makes them.
    pub mesh: Shared<TriangleMesh>,
    /// Number of its material, which [`Assembly::add_material`] returned. `None` is the material "default": matte, of
    /// the vertices' colours or grey.
    pub material: Option<u32>,
    /// Ways from its own space into the world, one for each instance.
    pub transforms: Vec<DMat4>,
}

impl Part {
    /// A part of the material "default" at one place, where its own space is the world.
    pub fn new(name: impl Into<String>, mesh: impl Into<Shared<TriangleMesh>>) -> Self {
        Self { name: name.into(), mesh: mesh.into(), material: None, transforms: vec![DMat4::IDENTITY] }
    }

    fn is_at_home(&self) -> bool {
        *self.transforms == [DMat4::IDENTITY]
    }
}

/// Error of an [`Assembly`], with its place.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AssemblyError {
    /// An object is refused.
    #[error("object {object:?}: {problem}")]
    Object {
        /// Its name.
        object: String,
        /// The problem, and what is allowed.
        problem: String,
    },
    /// A material is refused.
    #[error("material {material:?}: {problem}")]
    Material {
        /// Its name.
        material: String,
        /// The problem, and what is allowed.
        problem: String,
    },
    /// The scene as a whole is refused.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The scene needs more memory than allowed.
    #[error(transparent)]
    Memory(#[from] OutOfMemory),
}

/// The material of parts without one.
const DEFAULT: &str = "default";

/// Bytes that an instance takes beside its name and its triangles: its object with its space, and its placement.
const INSTANCE_BYTES: u64 = 256;

/// A scene in the making. Parts are checked when they are added; [`Assembly::build`] writes their instances out.
///
/// ```
/// use raystream::glam::{DMat4, DVec3, Vec3};
/// use raystream::memory::MemoryBudget;
/// use raystream::scene::{Assembly, Material, Part, TriangleMesh};
///
/// let mut assembly = Assembly::default();
/// let red = assembly.add_material(Material::matte("red", Vec3::X))?;
/// let sheet = TriangleMesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]]);
/// let transforms = (0..3).map(|i| DMat4::from_translation(DVec3::Z * f64::from(i))).collect();
/// assembly.add(Part { material: Some(red), transforms, ..Part::new("sheets", sheet.clone()) })?;
/// assembly.add(Part::new("ground", sheet))?;
///
/// let scene = assembly.build(MemoryBudget::of_machine())?;
/// assert_eq!((scene.mesh.triangles.len(), scene.objects.len(), scene.shapes.len()), (4, 4, 1));
/// assert_eq!(scene.materials[1].name, "default");
/// # Ok::<(), raystream::scene::AssemblyError>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct Assembly {
    textures: Vec<Texture>,
    /// The images of textures, with what the textures make of them.
    images: Vec<(TextureImage, ColourSpace, [Wrap; 2], u32)>,
    materials: Vec<Material>,
    pub(super) surface_requests: Vec<SurfaceRequest>,
    pub(super) warnings: Vec<String>,
    parts: Vec<Part>,
    /// The names of parts, and whether those have several instances.
    names: HashMap<String, bool>,
    /// The names before the numbers of parts that are called as an instance would be: X for X/0.
    numbered: HashSet<String>,
    material_names: HashSet<String>,
    /// That of all instances.
    size: MeshSize,
    /// Bytes of instances beside the mesh.
    instance_bytes: u64,
    /// Names and widths of vertex attributes.
    attributes: BTreeMap<String, u32>,
}

/// What stands before /NUMBER in a name that ends so.
fn before_number(name: &str) -> Option<&str> {
    let (before, number) = name.rsplit_once('/')?;
    number.parse::<u32>().is_ok().then_some(before)
}

/// What recipes need to leave nothing behind when they are refused.
#[cfg(feature = "formats")]
impl Assembly {
    /// Numbers of textures, images, materials, requests and warnings.
    pub(super) fn lengths(&self) -> [usize; 5] {
        let Self { textures, images, materials, surface_requests, warnings, .. } = self;
        [textures.len(), images.len(), materials.len(), surface_requests.len(), warnings.len()]
    }

    /// Removes what was added since there were so many ([`Assembly::lengths`]).
    pub(super) fn shorten(&mut self, to: [usize; 5]) {
        let [textures, images, materials, requests, warnings] = to;
        self.textures.truncate(textures);
        self.images.truncate(images);
        for removed in self.materials.drain(materials..) {
            self.material_names.remove(&removed.name);
        }
        self.surface_requests.truncate(requests);
        self.warnings.truncate(warnings);
    }
}

impl Assembly {
    /// The parts, in their order.
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// The materials, by number, without "default".
    pub fn materials(&self) -> &[Material] {
        &self.materials
    }

    /// Number of triangles of all instances.
    pub fn triangle_count(&self) -> u64 {
        self.size.triangles
    }

    /// Adds a texture, whose number [`super::TextureRef::texture`] is.
    pub fn add_texture(&mut self, texture: Texture) -> u32 {
        self.textures.push(texture);
        self.textures.len() as u32 - 1
    }

    /// Adds a texture of an image, or finds the one of the same image, colour space and addressing.
    pub fn add_image(&mut self, name: &str, of: &TextureUse, space: ColourSpace) -> u32 {
        let is_same = |(image, its_space, wrap, _): &&(TextureImage, _, _, _)| {
            image.is_same(&of.image) && (its_space, wrap) == (&space, &of.wrap)
        };
        if let Some((.., number)) = self.images.iter().find(is_same) {
            return *number;
        }
        let number = self.add_texture(of.image.texture(name, space, of.wrap));
        self.images.push((of.image.clone(), space, of.wrap, number));
        number
    }

    /// Adds a material, and returns its number. Its textures are numbered by [`Assembly::add_texture`].
    ///
    /// # Errors
    /// If another material has its name, or it is "default".
    pub fn add_material(&mut self, material: Material) -> Result<u32, AssemblyError> {
        self.check_material(&material.name)?;
        self.material_names.insert(material.name.clone());
        self.materials.push(material);
        Ok(self.materials.len() as u32 - 1)
    }

    /// Checks that a material may have a name.
    pub(super) fn check_material(&self, name: &str) -> Result<(), AssemblyError> {
        let problem = match name {
            "" => "a material needs a name",
            DEFAULT => "that is the name of the material of objects without one; choose another",
            _ if self.material_names.contains(name) => "another material has this name; choose another",
            _ => return Ok(()),
        };
        Err(AssemblyError::Material { material: name.into(), problem: problem.into() })
    }

    /// Adds a part, whose normals have length 1 ([`TriangleMesh::normalise_normals`]).
    ///
    /// # Errors
    /// The first thing that is wrong: a name that another part has, a vertex, a face or a number out of range,
    /// colours that are not from 0 to 1, transforms that place no geometry, texture coordinates that the material needs
    /// and the mesh lacks; more triangles or vertices than can be numbered, and more memory than the machine has.
    pub fn add(&mut self, part: Part) -> Result<(), AssemblyError> {
        let size = self
            .checked(&part)
            .map_err(|problem| AssemblyError::Object { object: part.name.clone(), problem })?;
        let (mut whole, instances) = (self.size, part.transforms.len() as u64);
        whole += size * instances;
        let mut attributes = self.attributes.clone();
        attributes.extend(part.mesh.attributes.iter().map(|one| (one.name.clone(), one.width)));
        whole.numbers = attributes.values().sum();
        let bytes = instances.saturating_mul(INSTANCE_BYTES + part.name.len() as u64);
        let instance_bytes = self.instance_bytes.saturating_add(bytes);
        let refused = |problem| AssemblyError::Object { object: part.name.clone(), problem };
        if whole.triangles > super::MAX_TRIANGLES as u64 {
            let (found, max) = (whole.triangles as usize, super::MAX_TRIANGLES);
            return Err(refused(MeshError::TooMany { found, max }.to_string()));
        }
        if whole.vertices > u64::from(u32::MAX) {
            return Err(refused(format!(
                "with it there are {} vertices; at most 2^32 - 1 fit",
                whole.vertices
            )));
        }
        MemoryBudget::of_machine().check(whole.to_string(), whole.bytes().saturating_add(instance_bytes))?;
        (self.size, self.instance_bytes, self.attributes) = (whole, instance_bytes, attributes);
        self.names.insert(part.name.clone(), instances > 1);
        self.numbered.extend(before_number(&part.name).map(String::from));
        self.parts.push(part);
        Ok(())
    }

    /// The size of a part's mesh, if there is nothing wrong with the part.
    fn checked(&self, part: &Part) -> Result<MeshSize, String> {
        let Part { name, mesh, material, transforms } = part;
        if name.is_empty() {
            return Err("an object needs a name".into());
        }
        let is_instance = before_number(name).is_some_and(|of| self.names.get(of) == Some(&true));
        if self.names.contains_key(name)
            || is_instance
            || transforms.len() > 1 && self.numbered.contains(name)
        {
            return Err("another object, or an instance, has this name; choose another".into());
        }
        mesh.check_colours().and_then(|()| mesh.validate(1)).map_err(|error| match error {
            MeshError::Empty => "it has no triangles".into(),
            error => error.to_string(),
        })?;
        for VertexAttribute { name, width, .. } in &mesh.attributes {
            if let Some(other) = self.attributes.get(name).filter(|other| *other != width) {
                return Err(format!(
                    "its attribute {name:?} has {width} numbers a vertex, but that of another object has {other}"
                ));
            }
        }
        if transforms.is_empty() {
            return Err("it has no transforms; leave it out".into());
        }
        for (number, transform) in transforms.iter().enumerate() {
            Placement::try_from(*transform).map_err(|error| match transforms.len() {
                1 => error.to_string(),
                _ => format!("instance {number}: {error}"),
            })?;
        }
        let sets = if mesh.uvs.is_empty() { 0 } else { 1 + mesh.more_uvs.len() };
        if let Some(number) = *material {
            let material = self.materials.get(number as usize).ok_or_else(|| {
                format!("it names material {number}, but there are {}", self.materials.len())
            })?;
            if let Some((input, set)) = material.reads_beyond(sets) {
                let own = &material.name;
                return Err(format!(
                    "the {input} texture of its material {own:?} reads texture coordinates {set}, but the mesh has \
                     {sets} sets of them (uvs), numbered from 0"
                ));
            }
        }
        Ok(MeshSize {
            vertices: mesh.positions.len() as u64,
            triangles: mesh.triangles.len() as u64,
            normals: !mesh.normals.is_empty(),
            uvs: !mesh.uvs.is_empty(),
            tangents: !mesh.tangents.is_empty(),
            colours: !mesh.colours.is_empty(),
            more_uvs: mesh.more_uvs.len() as u32,
            numbers: mesh.attributes.iter().map(|attribute| attribute.width).sum(),
        })
    }

    /// The scene: its objects are the parts, in their order; one of several instances is NAME/0, NAME/1, .. Colours of
    /// vertices multiply the base colour of their material; their alpha counts where it is below 1.
    ///
    /// # Errors
    /// If a transform takes a vertex out of range, what [`Scene::validate`] finds, and if the memory is not allowed.
    pub fn build(&self, memory: MemoryBudget) -> Result<Scene, AssemblyError> {
        let mut warnings = self.warnings.clone();
        let mut scene = Scene {
            textures: self.textures.clone(),
            surface_requests: self.surface_requests.clone(),
            materials: self.coloured_materials(&mut warnings),
            ..Scene::default()
        };
        let shapes: u64 = self.instanced().map(|part| part.mesh.bytes() as u64).sum();
        let bytes = self.size.bytes().saturating_add(self.instance_bytes).saturating_add(shapes);
        let with = if self.textures.is_empty() { "" } else { ", with textures," };
        memory.check(format!("{}{with}", self.size), bytes.saturating_add(scene.mipmap_bytes()))?;
        scene.add_mipmaps();
        let (mut mesh, mut objects, mut shapes) = (TriangleMesh::default(), Objects::default(), Vec::new());
        match self.parts.as_slice() {
            // The only part may be the mesh.
            [part] if part.is_at_home() && self.number_of(part) == 0 => {
                let object = objects.add(Object::new(&part.name));
                objects.assign(0, object);
                scene.mesh = part.mesh.clone();
            }
            parts => {
                self.size.reserve(&mut mesh)?;
                for part in parts {
                    self.write_out(part, &mut mesh, &mut objects, &mut shapes)?;
                }
                mesh.complete_attributes();
                // Shapes are in the order of their first triangles.
                shapes.sort_by_key(|shape: &Shape| shape.instances[0].first);
                scene.mesh = mesh.into();
            }
        }
        (scene.objects, scene.shapes, scene.warnings) = (objects.into(), shapes.into(), warnings);
        scene.validate()?;
        Ok(scene)
    }

    /// Parts with more than one instance.
    fn instanced(&self) -> impl Iterator<Item = &Part> {
        self.parts.iter().filter(|part| part.transforms.len() > 1)
    }

    /// The number of a part's material in the scene. That of the material "default" is the last.
    fn number_of(&self, part: &Part) -> u32 {
        part.material.unwrap_or(self.materials.len() as u32)
    }

    /// The materials, each with what the colours of its parts add.
    fn coloured_materials(&self, warnings: &mut Vec<String>) -> Vec<Material> {
        let mut materials = self.materials.clone();
        if self.parts.iter().any(|part| part.material.is_none()) {
            materials.push(Material::fallback());
        }
        let mut colours: BTreeMap<usize, Vec<&[Vec4]>> = BTreeMap::new();
        for part in self.parts.iter().filter(|part| !part.mesh.colours.is_empty()) {
            colours.entry(self.number_of(part) as usize).or_default().push(&part.mesh.colours);
        }
        for (number, colours) in colours {
            let material = &mut materials[number];
            if number == self.materials.len() {
                *material = Material::vertex_coloured();
            }
            material.count_colours();
            if !material.count_alpha(&colours) {
                warnings.push(IGNORED_ALPHA.into());
            }
        }
        materials
    }

    /// Appends all instances of a part.
    fn write_out(
        &self,
        part: &Part,
        mesh: &mut TriangleMesh,
        objects: &mut Objects,
        shapes: &mut Vec<Shape>,
    ) -> Result<(), AssemblyError> {
        let (has_several, number) = (part.transforms.len() > 1, self.number_of(part));
        // Instances by whether they mirror, which turns triangles round.
        let mut instances = [Vec::new(), Vec::new()];
        for (index, transform) in part.transforms.iter().enumerate() {
            let (first, base) = (mesh.triangles.len() as u32, mesh.positions.len());
            let object = match has_several {
                true => {
                    Object { instance: Some(index as u32), ..Object::new(format!("{}/{index}", part.name)) }
                }
                false => Object::new(&part.name),
            };
            let object = objects.add(object);
            objects.assign(first, object);
            objects.place(object, transform);
            let (placement, bend) = (Placement::new(transform), Bend::new(transform));
            self.append(part, transform, &placement, &bend, mesh);
            check_positions(&mesh.positions[base..]).map_err(|error| {
                let instance = if has_several { format!("instance {index}, ") } else { String::new() };
                AssemblyError::Object {
                    object: part.name.clone(),
                    problem: format!("{instance}in the world: {error}"),
                }
            })?;
            mesh.materials.resize(mesh.triangles.len(), number);
            instances[usize::from(bend.mirrors())].push(Instance { placement, first });
        }
        for (instances, mirrors) in instances.into_iter().zip([false, true]) {
            if instances.len() > 1 {
                let triangles = oriented(&part.mesh.triangles, 0, mirrors).collect();
                shapes.push(Shape { positions: part.mesh.positions.clone(), triangles, instances });
            }
        }
        Ok(())
    }

    /// Appends one instance of a mesh, and what its vertices lack that others have.
    fn append(
        &self,
        part: &Part,
        transform: &DMat4,
        placement: &Placement,
        bend: &Bend,
        mesh: &mut TriangleMesh,
    ) {
        let (of, base) = (&*part.mesh, mesh.positions.len());
        let is_moved = *transform != DMat4::IDENTITY;
        append_moved(&mut mesh.positions, &of.positions, is_moved, |&p| placement.point(p));
        append_moved(&mut mesh.normals, &of.normals, is_moved, |n| bend.normal(n.as_dvec3()));
        let tangent = |t: &Vec4| bend.tangent(t.truncate().as_dvec3(), t.w);
        append_moved(&mut mesh.tangents, &of.tangents, is_moved, tangent);
        mesh.uvs.extend_from_slice(&of.uvs);
        mesh.colours.extend_from_slice(&of.colours);
        let further = mesh.more_uvs.iter_mut().zip(&of.more_uvs);
        further.for_each(|(uvs, own)| uvs.extend_from_slice(own));
        for VertexAttribute { name, width, values } in &of.attributes {
            mesh.attribute_from(name, *width, base).extend_from_slice(values);
        }
        mesh.triangles.extend(oriented(&of.triangles, base as u32, bend.mirrors()));
        let (size, count) = (&self.size, mesh.positions.len());
        if size.normals {
            mesh.normals.resize(count, Vec3::ZERO);
        }
        if size.tangents {
            mesh.tangents.resize(count, Vec4::ZERO);
        }
        if size.uvs {
            mesh.uvs.resize(count, Vec2::ZERO);
        }
        mesh.more_uvs.iter_mut().for_each(|uvs| uvs.resize(count, Vec2::ZERO));
        if size.colours {
            // Objects without colours are grey without a material, beside those whose colours are all there is.
            let grey = Material::fallback().flat_colour().unwrap_or(Vec3::ONE);
            let colour = if part.material.is_none() { grey } else { Vec3::ONE };
            mesh.colours.resize(count, colour.extend(1.0));
        }
    }
}

/// The warning that a mesh's colours have an alpha of 0 everywhere.
pub(super) const IGNORED_ALPHA: &str = "All vertices have an alpha of 0; alpha is ignored.";

/// Elements that one thread moves at a time.
const MOVED_AT_ONCE: usize = 1 << 14;

fn append_moved<T: Copy + Send + Sync>(
    to: &mut Vec<T>,
    from: &[T],
    is_moved: bool,
    moved: impl Fn(&T) -> T + Sync + Send,
) {
    if !is_moved {
        to.extend_from_slice(from);
    } else if from.len() < MOVED_AT_ONCE {
        to.extend(from.iter().map(moved));
    } else {
        to.par_extend(from.par_iter().with_min_len(MOVED_AT_ONCE).map(moved));
    }
}

/// Triangles of vertices from `base` on, turned round if the motion mirrors.
fn oriented(triangles: &[[u32; 3]], base: u32, mirrors: bool) -> impl Iterator<Item = [u32; 3]> {
    triangles.iter().map(move |&[a, b, c]| {
        let [b, c] = if mirrors { [c, b] } else { [b, c] };
        [base + a, base + b, base + c]
    })
}

#[cfg(test)]
mod tests;
