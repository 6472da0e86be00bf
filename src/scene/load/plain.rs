//! Scenes of files that hold one mesh and no materials.

use super::warnings::Warnings;
use crate::scene::{Alpha, AlphaMode, Material, Mesh, Object, Objects, Scene};
use std::path::Path;

/// The objects of a file that is one object: it has the file's name.
pub(super) fn one_object(path: &Path) -> Objects {
    let mut objects = Objects::default();
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let object = objects.add(Object::new(name));
    objects.assign(0, object);
    objects
}

/// The scene of a mesh. All triangles are matte, of the vertices' colours or grey. `has_alpha` says whether the file
/// gives the colours an alpha.
pub(super) fn scene(mut mesh: Mesh, objects: Objects, has_alpha: bool, warnings: &mut Warnings) -> Scene {
    mesh.materials = vec![0; mesh.triangles.len()];
    let materials = vec![material(&mesh, has_alpha, warnings)];
    let (mesh, objects) = (mesh.into(), objects.into());
    Scene { mesh, objects, materials, ..Scene::default() }
}

/// The material of a mesh: of its colours if it has any.
fn material(mesh: &Mesh, has_alpha: bool, warnings: &mut Warnings) -> Material {
    if mesh.colours.is_empty() {
        return Material::fallback();
    }
    let mut material = Material::vertex_coloured();
    if !has_alpha || mesh.colours.iter().all(|colour| colour.w >= 1.0) {
        return material;
    }
    if mesh.colours.iter().all(|colour| colour.w == 0.0) {
        warnings.add("All vertices have an alpha of 0; alpha is ignored.");
        return material;
    }
    material.alpha = Alpha { mode: AlphaMode::Blend, vertex: true, ..Alpha::default() };
    material
}
