//! Material libraries of OBJ files.

use super::super::session::Session;
use super::super::textures::Textures;
use super::super::warnings::Warnings;
use super::super::{LoadProblem, check_text, named, quote};
use super::{Materials, material, mtl, words};
use std::path::{Path, PathBuf};

/// Reads the materials of the libraries that these statements name, with their textures. `coloured` says whether the
/// mesh has colours.
pub(super) fn read(
    statements: &[String],
    coloured: bool,
    session: &mut Session,
) -> Result<Materials, LoadProblem> {
    let path = session.path.clone();
    let (mut materials, mut textures) = (Materials::default(), Textures::default());
    for library in files(&path, statements, &mut session.warnings) {
        let bytes = session.read_named(&library, u64::MAX);
        let bytes = bytes.map_err(|problem| LoadProblem::Place {
            path: path.clone(),
            place: "a material library".into(),
            problem: problem.to_string(),
        })?;
        check_text(&library, &bytes)?;
        for definition in mtl::parse(&library, &bytes, &mut session.warnings)? {
            let material = material::convert(&library, &definition, coloured, &mut textures, session)?;
            // The first definition of a name is used.
            if !materials.by_name.contains_key(&material.name) {
                materials.by_name.insert(material.name.clone(), materials.list.len() as u32);
                materials.list.push(material);
            }
        }
    }
    materials.textures = textures.into_list();
    Ok(materials)
}

/// The files that `mtllib` statements name. A statement names one file, which may contain spaces, or several.
fn files(path: &Path, statements: &[String], warnings: &mut Warnings) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for statement in statements {
        let whole = named::file(path, statement);
        let names = if whole.is_some() { vec![statement.as_str()] } else { words(statement).collect() };
        for name in names {
            match named::file(path, name) {
                None => warnings.add(format!("The material library {} is missing.", quote(name))),
                Some(library) if !found.contains(&library) => found.push(library),
                Some(_) => {}
            }
        }
    }
    found
}
