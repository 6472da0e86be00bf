//! Reads vertices and faces of an OBJ file.

use super::super::dropped::Dropped;
use super::super::warnings::Warnings;
use super::super::{LoadProblem, quote};
use super::{split_keyword, statements, words};
use crate::scene::{Object, Objects, TriangleMesh, srgb};
use glam::{Vec2, Vec3, Vec4};
use std::collections::HashMap;
use std::path::Path;

/// The contents of an OBJ file, without the definitions of its materials.
#[derive(Debug, Default)]
pub(super) struct Geometry {
    /// The triangles. Its `materials` are indices into `material_names`.
    pub(super) mesh: TriangleMesh,
    /// Objects and groups.
    pub(super) objects: Objects,
    /// The names that faces use, in order of their first use. `None` for faces before any `usemtl`.
    pub(super) material_names: Vec<Option<String>>,
    /// The arguments of the `mtllib` statements.
    pub(super) libraries: Vec<String>,
}

impl Geometry {
    /// Parses the bytes of a file.
    ///
    /// # Errors
    /// The line, and what is wrong with it.
    pub(super) fn read(path: &Path, bytes: &[u8], warnings: &mut Warnings) -> Result<Self, LoadProblem> {
        let mut reader = Reader::default();
        for (line, statement) in statements(&String::from_utf8_lossy(bytes)) {
            reader.line = line;
            reader.statement(&statement, warnings).map_err(|problem| LoadProblem::Line {
                path: path.to_owned(),
                line,
                problem,
            })?;
        }
        Ok(reader.finish(warnings))
    }
}

/// An index that is not given.
const NONE: u32 = u32::MAX;

/// A corner of a face: indices of its position, texture coordinates and normal.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct Corner {
    position: u32,
    uv: u32,
    normal: u32,
}

/// The statements read so far.
#[derive(Default)]
struct Reader {
    /// The number of the current line.
    line: usize,
    dropped: Dropped,
    /// The number of faces of fewer than three corners, and the line of the first.
    short: (usize, usize),
    positions: Vec<Vec3>,
    /// Colours of the positions up to the last coloured one. Those without a colour are white.
    colours: Vec<Vec4>,
    uvs: Vec<Vec2>,
    normals: Vec<Vec3>,
    /// The mesh's vertex for each distinct corner.
    vertices: HashMap<Corner, u32>,
    /// The corners of the current face, and their vertices.
    corners: Vec<Corner>,
    face: Vec<u32>,
    /// True if any corner has texture coordinates, and true if any has a normal.
    has: [bool; 2],
    /// The name of the last `usemtl`.
    name: Option<String>,
    /// Its index in `material_names`, once a face has used it.
    material: Option<u32>,
    indices: HashMap<Option<String>, u32>,
    /// The names of the last `o` and of the last `g` after it.
    opened: [Option<String>; 2],
    /// Their index in the object table, once a face has used it.
    object: Option<u32>,
    /// Objects by parent and name.
    objects: HashMap<(Option<u32>, String), u32>,
    out: Geometry,
}

impl Reader {
    fn statement(&mut self, statement: &str, warnings: &mut Warnings) -> Result<(), String> {
        let (keyword, arguments) = split_keyword(statement);
        match keyword {
            "v" => {
                let [x, y, z] = numbers(arguments, 3)?;
                let place = || format!("vertex {} in line {}", self.positions.len() + 1, self.line);
                let position = self.dropped.checked(Vec3::new(x, y, z), place);
                if let Some(colour) = colour(arguments, warnings)? {
                    self.colours.resize(self.positions.len(), Vec4::ONE);
                    self.colours.push(colour);
                }
                self.positions.push(position);
            }
            "vt" => {
                // The second and the third coordinate are optional.
                let [u, v, _] = numbers(arguments, 1)?;
                let mut uv = Vec2::new(u, 1.0 - v);
                if !uv.is_finite() {
                    warnings.add("Texture coordinates that are not finite count as 0.");
                    uv = Vec2::ZERO;
                }
                self.uvs.push(uv);
            }
            "vn" => {
                let [x, y, z] = numbers(arguments, 3)?;
                self.normals.push(Vec3::new(x, y, z).normalize_or_zero());
            }
            "f" => self.face(arguments)?,
            "o" => {
                self.opened = [Some(arguments.to_owned()), None];
                self.object = None;
            }
            "g" => {
                self.opened[1] = Some(arguments.to_owned()).filter(|name| !name.is_empty());
                self.object = None;
            }
            "usemtl" => {
                self.name = Some(arguments.to_owned());
                self.material = None;
            }
            "mtllib" => self.out.libraries.push(arguments.to_owned()),
            // Smoothing groups are ignored, because normals in the file are used.
            "s" | "mg" | "vp" => {}
            "l" | "p" => warnings.add("Lines and points are ignored, because they have no surface."),
            _ => {
                warnings.add(format!("The OBJ statement {} is not supported and is ignored.", quote(keyword)))
            }
        }
        Ok(())
    }

    fn face(&mut self, arguments: &str) -> Result<(), String> {
        self.corners.clear();
        self.face.clear();
        for word in words(arguments) {
            let corner = self.corner(word)?;
            self.corners.push(corner);
        }
        if self.corners.len() < 3 {
            let (faces, first) = self.short;
            self.short = (faces + 1, if faces == 0 { self.line } else { first });
            return Ok(());
        }
        let corners = self.corners.iter().map(|corner| self.positions[corner.position as usize]);
        if self.dropped.drops(corners) {
            return Ok(());
        }
        for place in 0..self.corners.len() {
            let vertex = self.vertex(self.corners[place])?;
            self.face.push(vertex);
        }
        let material = match self.material {
            Some(material) => material,
            None => {
                let next = self.indices.len() as u32;
                let material = *self.indices.entry(self.name.clone()).or_insert(next);
                if material == next {
                    self.out.material_names.push(self.name.clone());
                }
                *self.material.insert(material)
            }
        };
        let object = self.object();
        self.out.objects.assign(self.out.mesh.triangles.len() as u32, object);
        let mesh = &mut self.out.mesh;
        for pair in self.face[1..].windows(2) {
            mesh.triangles.push([self.face[0], pair[0], pair[1]]);
            mesh.materials.push(material);
        }
        Ok(())
    }

    /// The object of the next face: the opened group, below the opened object. Faces before the first `o` or `g` belong
    /// to the group "default", as the format calls it.
    fn object(&mut self) -> u32 {
        if let Some(object) = self.object {
            return object;
        }
        let unnamed = self.opened.iter().all(Option::is_none).then(|| "default".to_owned());
        let (names, objects) = (self.opened.clone(), &mut self.out.objects);
        let mut found = None;
        for name in names.into_iter().chain([unnamed]).flatten() {
            let add = |(parent, name): &(Option<u32>, String)| {
                objects.add(Object::new(name.as_str()).below(*parent))
            };
            found = Some(*self.objects.entry((found, name)).or_insert_with_key(add));
        }
        *self.object.insert(found.unwrap_or_default())
    }

    /// Parses `v`, `v/vt`, `v//vn` or `v/vt/vn`.
    fn corner(&self, word: &str) -> Result<Corner, String> {
        let mut parts = word.split('/');
        let [position, uv, normal] = [(); 3].map(|()| parts.next().filter(|part| !part.is_empty()));
        let (Some(position), None) = (position, parts.next()) else {
            return Err(format!(
                "{} is not the corner of a face (such as 7, 7/3, 7//5 or 7/3/5)",
                quote(word)
            ));
        };
        let optional =
            |index: Option<&str>, what, count| index.map_or(Ok(NONE), |index| resolve(index, what, count));
        Ok(Corner {
            position: resolve(position, "vertex", self.positions.len())?,
            uv: optional(uv, "texture coordinate", self.uvs.len())?,
            normal: optional(normal, "normal", self.normals.len())?,
        })
    }

    /// The mesh's vertex for a corner. It is created if the corner is new.
    fn vertex(&mut self, corner: Corner) -> Result<u32, String> {
        if let Some(&vertex) = self.vertices.get(&corner) {
            return Ok(vertex);
        }
        let mesh = &mut self.out.mesh;
        let vertex = u32::try_from(mesh.positions.len()).ok().filter(|&vertex| vertex != NONE);
        let vertex = vertex.ok_or_else(|| format!("the faces have more than {NONE} different corners"))?;
        self.has[0] |= corner.uv != NONE;
        self.has[1] |= corner.normal != NONE;
        if !self.colours.is_empty() {
            mesh.colours.resize(mesh.positions.len(), Vec4::ONE);
            mesh.colours.push(self.colours.get(corner.position as usize).copied().unwrap_or(Vec4::ONE));
        }
        mesh.positions.push(self.positions[corner.position as usize]);
        mesh.uvs.push(self.uvs.get(corner.uv as usize).copied().unwrap_or_default());
        mesh.normals.push(self.normals.get(corner.normal as usize).copied().unwrap_or_default());
        self.vertices.insert(corner, vertex);
        Ok(vertex)
    }

    fn finish(mut self, warnings: &mut Warnings) -> Geometry {
        self.dropped.finish(&mut self.out.mesh.positions, warnings);
        if let (faces @ 1.., first) = self.short {
            warnings.add(format!(
                "A face needs at least 3 corners: {faces} faces have fewer and are left out, the first in line {first}."
            ));
        }
        let [uvs, normals] = self.has;
        if !uvs {
            self.out.mesh.uvs = Vec::new();
        }
        if !normals {
            self.out.mesh.normals = Vec::new();
        }
        self.out
    }
}

/// Converts an OBJ index to an index from 0. OBJ counts from 1, or backwards from −1, among `count` elements so far.
fn resolve(index: &str, what: &str, count: usize) -> Result<u32, String> {
    let number: i64 = index.parse().map_err(|_| format!("{} is not the index of a {what}", quote(index)))?;
    let from_zero = if number > 0 { number - 1 } else { number.saturating_add(count as i64) };
    let in_range = number != 0 && (0..count as i64).contains(&from_zero);
    u32::try_from(from_zero).ok().filter(|&index| in_range && index != NONE).ok_or_else(|| {
        if count == 0 {
            format!("a face names {what} {number}, but none is defined above it")
        } else {
            format!(
                "a face names {what} {number}, but {count} are defined above it (1 to {count}, or -{count} \
                 to -1)"
            )
        }
    })
}

/// The first three numbers of a statement. At least `required` must be given; the others are 0 if left out.
fn numbers(arguments: &str, required: usize) -> Result<[f32; 3], String> {
    let mut list = [0.0; 3];
    let mut found = 0;
    for (slot, word) in list.iter_mut().zip(words(arguments)) {
        *slot = word.parse().map_err(|_| format!("{} is not a number", quote(word)))?;
        found += 1;
    }
    if found < required {
        return Err(format!("{found} numbers; {required} are needed"));
    }
    Ok(list)
}

/// The colour after the position of a vertex, `v x y z r g b`, which is not part of the original format: red, green and
/// blue from 0 to 1, as sRGB.
fn colour(arguments: &str, warnings: &mut Warnings) -> Result<Option<Vec4>, String> {
    let mut numbers = words(arguments).skip(3);
    let [Some(r), Some(g), Some(b)] = [numbers.next(), numbers.next(), numbers.next()] else {
        return Ok(None);
    };
    if numbers.next().is_some() {
        warnings.add("Numbers after the colour of a vertex are ignored.");
    }
    let mut colour = [1.0_f32; 4];
    for (channel, word) in colour.iter_mut().zip([r, g, b]) {
        *channel = word.parse().map_err(|_| format!("{} is not a number", quote(word)))?;
        if !(0.0..=1.0).contains(channel) {
            warnings.add("Colours of vertices must be from 0 to 1; others are clamped.");
        }
    }
    Ok(Some(srgb::decoded(colour)))
}
