//! Loads glTF 2.0 and GLB files with the data model of the `gltf` crate.
//!
//! The crate parses and checks the JSON. Buffers are read here, because the crate's readers do not check the file's
//! offsets.

mod accessor;
mod animation;
mod bent;
mod buffers;
mod camera;
mod colour;
mod container;
mod draco;
mod extensions;
mod extras;
mod instance;
mod instancing;
mod material;
mod mesh;
mod meshopt;
mod node;
mod object;
mod own_attribute;
mod pointer;
mod pose;
mod span;
mod targets;
mod texture;
mod variant;

use super::session::Session;
use super::textures::{Images, Textures};
use super::warnings::Warnings;
use super::{LoadProblem, check_text};
use crate::scene::{Material, Scene};
use ::gltf::Document;
use ::gltf::json::validation::{Error as Invalid, Validate};
use ::gltf::json::{Path as JsonPath, Root, Value};
use buffers::Buffers;
use mesh::Materials;
use own_attribute::Widths;
use pointer::Pointers;
use serde::Deserialize;
use std::path::Path;
use targets::Targets;
use variant::MaterialsByPrimitive;

/// Context that the parts of the loader share.
struct Context<'a> {
    session: &'a mut Session,
    document: &'a Document,
    buffers: &'a Buffers,
    pointers: &'a Pointers,
    targets: &'a Targets,
}

impl Context<'_> {
    /// An error about one part of the file.
    fn error(&self, place: impl Into<String>, problem: impl Into<String>) -> LoadProblem {
        LoadProblem::Place { path: self.session.path.clone(), place: place.into(), problem: problem.into() }
    }
}

/// A `.gltf` or `.glb` file that has been read, with its buffers.
pub(super) struct File {
    document: Document,
    buffers: Buffers,
    pointers: Pointers,
    targets: Targets,
}

/// Loads a `.gltf` or `.glb` file with its buffers and images.
pub(super) fn load(session: &mut Session) -> Result<Scene, LoadProblem> {
    File::read(session)?.scene(session, &mut Images::default())
}

impl File {
    /// Reads a file and its buffers.
    pub(super) fn read(session: &mut Session) -> Result<Self, LoadProblem> {
        let path = session.path.clone();
        let bytes = session.read()?;
        let container = container::split(&path, &bytes)?;
        check_text(&path, container.json)?;
        let pointers = Pointers::take(session, container.json)?;
        let document = parse(&path, container.json, &pointers, &mut session.warnings)?;
        let targets = Targets::read(container.json);
        let binary = container.binary;
        let buffers = Buffers::read(session, &document, bytes, binary)?;
        Ok(Self { document, buffers, pointers, targets })
    }

    /// Bytes of its buffers, decompressed ones too.
    pub(super) fn bytes(&self) -> u64 {
        self.buffers.bytes()
    }

    /// The scene as the session's options choose it. Images among `images` are not decoded again; the others are added
    /// to them.
    pub(super) fn scene(&self, session: &mut Session, images: &mut Images) -> Result<Scene, LoadProblem> {
        let Self { document, buffers, pointers, targets } = self;
        let mut context = Context { session, document, buffers, pointers, targets };
        let shown = pointers.shown(&mut context)?;
        let document = shown.as_ref().unwrap_or(document);
        let mut context = Context { session, document, buffers, pointers, targets };
        let variants = variant::names(document);
        let chosen = MaterialsByPrimitive::new(&context, &variants)?;
        let colours = colour::by_material(document, &chosen);
        let mut textures = Textures::of_images(std::mem::take(images));
        let wanted = texture::wanted(document, buffers, &context.session.path);
        textures.decode_ahead(context.session, wanted);
        let (mut converted, mut surface_requests) = (Vec::new(), Vec::new());
        for ((number, material), &colours) in (0..).zip(document.materials()).zip(&colours) {
            let mut convert = material::convert(&mut context, &mut textures, &material, colours)?;
            let request = extras::surface_request(number, &material, &mut context.session.warnings);
            convert.has_all_uv_sets |= request.is_some();
            converted.push(convert);
            surface_requests.extend(request);
        }
        let all_uv_sets = context.session.options.all_uv_sets;
        let own_attributes = &Widths::of(document, &mut context.session.warnings);
        let known = Materials { converted: &converted, chosen: &chosen, all_uv_sets, own_attributes };
        let world = node::flatten(&mut context, known)?;
        let mut materials: Vec<Material> = converted.into_iter().map(|m| m.material).collect();
        if world.uses_fallback {
            let is_coloured = colours.last().is_some_and(|colours| colours.rgb);
            materials.push(if is_coloured { Material::vertex_coloured() } else { Material::fallback() });
        }
        let (textures, decoded) = textures.into_parts();
        *images = decoded;
        Ok(Scene {
            mesh: world.mesh.into(),
            shapes: world.shapes.into(),
            objects: world.objects.into(),
            materials,
            textures,
            lights: world.lights,
            camera: world.cameras.first().map(|named| named.camera),
            camera_motion: world.cameras.first().and_then(|named| named.motion.clone()),
            cameras: world.cameras,
            surface_requests,
            is_animated: world.is_animated,
            animations: span::all(&context),
            stroke_width: world.stroke_width,
            variants,
            ..Scene::default()
        })
    }
}

/// Parses and checks the JSON. Afterwards every index in it is in range and every enumeration value is known.
fn parse(
    path: &Path,
    json: &[u8],
    pointers: &Pointers,
    warnings: &mut Warnings,
) -> Result<Document, LoadProblem> {
    let file = |problem| LoadProblem::File { path: path.to_owned(), problem };
    let root = match pointers.json() {
        None => Root::from_slice(json).or_else(|error| bare_scenes(json).ok_or(error)),
        // The places of errors are those in the file.
        Some(changed) => root_of(changed).map_err(|error| Root::from_slice(json).err().unwrap_or(error)),
    };
    let mut root = root.map_err(|error| {
        // A file of another version differs in more than its version.
        let head = ::gltf::json::deserialize::from_slice::<Head>(json);
        let problem = head.ok().and_then(|head| unsupported(&head.asset.version(), None));
        file(problem.unwrap_or_else(|| format!("not valid glTF JSON: {error}")))
    })?;
    if let Some(problem) = unsupported(&root.asset.version, root.asset.min_version.as_deref()) {
        return Err(file(problem));
    }
    for extension in std::mem::take(&mut root.extensions_required) {
        if !extensions::may_be_required(&extension) {
            return Err(LoadProblem::RequiredExtension { path: path.to_owned(), extension });
        }
    }
    extensions::warn_of_ignored(&root.extensions_used, json, warnings);
    check(path, &root)?;
    Ok(Document::from_json_without_validation(root))
}

/// A document with scenes that have no list of nodes, which the crate requires. `None` if something else is wrong.
fn bare_scenes(json: &[u8]) -> Option<Root> {
    let mut root = serde_json::from_slice(json).ok()?;
    fill_scenes(&mut root);
    root_of(&root).ok()
}

/// The document of changed JSON. By way of its text, since reading documents from values would be compiled here anew.
fn root_of(json: &Value) -> serde_json::Result<Root> {
    Root::from_slice(&serde_json::to_vec(json)?)
}

/// Gives scenes without nodes an empty list of them.
fn fill_scenes(root: &mut Value) {
    let scenes = root.get_mut("scenes").and_then(Value::as_array_mut);
    for scene in scenes.into_iter().flatten().filter_map(Value::as_object_mut) {
        scene.entry("nodes").or_insert_with(|| Value::Array(Vec::new()));
    }
}

/// Head of documents of all versions.
#[derive(Deserialize)]
struct Head {
    asset: Asset,
}

#[derive(Deserialize)]
struct Asset {
    version: Value,
}

impl Asset {
    /// The version, which some writers of version 1 give as a number.
    fn version(&self) -> String {
        self.version.as_str().map_or_else(|| self.version.to_string(), str::to_owned)
    }
}

/// The problem if a document needs another version of glTF than 2.0. A later version 2 is read as 2.0 unless the
/// document says that it needs more.
fn unsupported(version: &str, least: Option<&str>) -> Option<String> {
    match least {
        Some("2.0") => None,
        Some(least) => Some(format!("needs at least glTF version {least:?}; 2.0 is supported")),
        None if version.split('.').next() == Some("2") => None,
        None => Some(format!("glTF version {version:?}; 2.0 is supported")),
    }
}

/// Runs the crate's own checks. The bounds of positions are not needed, and elements of accessors without data are 0,
/// so errors of either are ignored.
fn check(path: &Path, root: &Root) -> Result<(), LoadProblem> {
    let place = |place: String, problem: String| LoadProblem::Place { path: path.to_owned(), place, problem };
    // The crate looks up these accessors before it has checked them.
    for (m, mesh) in root.meshes.iter().enumerate() {
        for (p, primitive) in mesh.primitives.iter().enumerate() {
            if let Some(index) = primitive.attributes.values().find(|i| i.value() >= root.accessors.len()) {
                return Err(place(
                    format!("meshes[{m}].primitives[{p}]"),
                    format!("names accessor {index}, but there are {}", root.accessors.len()),
                ));
            }
        }
    }
    let mut first = None;
    root.validate(root, JsonPath::new, &mut |path, error| {
        let at = path().to_string();
        let is_bound = at.ends_with("POSITION\"].min") || at.ends_with("POSITION\"].max");
        let is_data =
            at.starts_with("accessors[") && at.ends_with("].bufferView") && error == Invalid::Missing;
        if first.is_none() && !is_bound && !is_data {
            first = Some((at, error));
        }
    });
    let Some((at, error)) = first else { return Ok(()) };
    Err(place(
        at,
        match error {
            Invalid::IndexOutOfBounds => "refers to an element that does not exist".into(),
            Invalid::Invalid => "has a value that glTF 2.0 does not allow".into(),
            Invalid::Missing => "is missing".into(),
            Invalid::Oversize => "is larger than this machine can address".into(),
            Invalid::Unsupported => "is not supported".into(),
        },
    ))
}
