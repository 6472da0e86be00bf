//! Loads Wavefront OBJ files.
//!
//! This project has its own parser, because errors must name the line, faces must keep the file's order across groups
//! and materials, and faces with and without texture coordinates or normals may be mixed.

mod geometry;
#[cfg(feature = "formats")]
mod libraries;
#[cfg(feature = "formats")]
mod material;
#[cfg(feature = "formats")]
mod mtl;

use super::session::Session;
use super::{LoadProblem, check_text, quote};
use crate::scene::{Material, Scene, Texture};
use geometry::Geometry;
use std::borrow::Cow;
use std::collections::HashMap;

/// Materials of a file's libraries.
#[derive(Default)]
struct Materials {
    list: Vec<Material>,
    /// Indices of materials.
    by_name: HashMap<String, u32>,
    textures: Vec<Texture>,
}

/// Stands in for libraries in a build that reads no textures.
#[cfg(not(feature = "formats"))]
mod libraries {
    use super::*;

    pub(super) fn read(
        statements: &[String],
        _: bool,
        session: &mut Session,
    ) -> Result<Materials, LoadProblem> {
        if !statements.is_empty() {
            session.warnings.add("Materials are ignored: they need the feature `formats`.");
        }
        Ok(Materials::default())
    }
}

/// Bytes of vertices and faces per byte of text, at most about.
const BYTES_PER_BYTE: u64 = 4;

/// Loads an OBJ file with its MTL files and textures.
pub(super) fn load(session: &mut Session) -> Result<Scene, LoadProblem> {
    let path = session.path.clone();
    let bytes = session.read()?;
    check_text(&path, &bytes)?;
    let parsed = session.check("the text with its vertices and faces", BYTES_PER_BYTE * bytes.len() as u64);
    parsed.map_err(|source| session.over(source))?;
    let mut geometry = Geometry::read(&path, &bytes, &mut session.warnings)?;
    drop(bytes);
    let coloured = !geometry.mesh.colours.is_empty();
    let Materials { list: mut materials, by_name, textures } =
        libraries::read(&geometry.libraries, coloured, session)?;
    let mut fallback = None;
    let indices: Vec<u32> = geometry
        .material_names
        .iter()
        .map(|name| {
            let defined = name.as_ref().and_then(|name| by_name.get(name)).copied();
            if let (None, Some(name)) = (defined, name)
                && cfg!(feature = "formats")
            {
                let warning =
                    format!("The material {} is not defined; its faces are matte grey.", quote(name));
                session.warnings.add(warning);
            }
            defined.unwrap_or_else(|| {
                *fallback.get_or_insert_with(|| {
                    materials.push(if coloured { Material::vertex_coloured() } else { Material::fallback() });
                    (materials.len() - 1) as u32
                })
            })
        })
        .collect();
    for material in &mut geometry.mesh.materials {
        *material = indices[*material as usize];
    }
    Ok(Scene {
        mesh: geometry.mesh.into(),
        objects: geometry.objects.into(),
        materials,
        textures,
        ..Scene::default()
    })
}

/// The statements of a text file, each with the number, from 1, of its first line. Comments and blank lines are left
/// out. A line that ends in a backslash continues on the next line.
fn statements(text: &str) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let mut rest = text.strip_prefix('\u{feff}').unwrap_or(text).lines().zip(1..);
    std::iter::from_fn(move || {
        loop {
            let (first, number) = rest.next()?;
            let first = first.trim();
            if first.is_empty() || first.starts_with('#') {
                continue;
            }
            let mut statement = Cow::Borrowed(first);
            while let Some(head) = statement.strip_suffix('\\') {
                let next = rest.next().map_or("", |(next, _)| next.trim());
                statement = Cow::Owned(format!("{head} {next}"));
            }
            return Some((number, statement));
        }
    })
}

/// The words of a statement of numbers, up to a comment.
fn words(arguments: &str) -> impl Iterator<Item = &str> {
    arguments.split_ascii_whitespace().take_while(|word| !word.starts_with('#'))
}

/// A statement's keyword and the rest of the line.
fn split_keyword(line: &str) -> (&str, &str) {
    let end = line.find(char::is_whitespace).unwrap_or(line.len());
    (&line[..end], line[end..].trim_start())
}
