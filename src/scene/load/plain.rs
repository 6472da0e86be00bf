//! Scenes of files that hold one mesh and no materials.

use super::warnings::Warnings;
use crate::memory::MemoryBudget;
use crate::scene::assembly::IGNORED_ALPHA;
use crate::scene::{Assembly, AssemblyError, Material, Object, Objects, Part, Scene, TriangleMesh};
use std::path::Path;

/// The scene of a mesh in memory, as a file that holds it alone would give it: one object of this name, of the material
/// `default`, which is matte, of the vertices' colours or grey. Normals are normalised. [`Assembly`] puts several
/// meshes together.
///
/// ```
/// use raystream::glam::Vec3;
/// use raystream::scene::{TriangleMesh, load::scene_of_mesh};
///
/// let mesh = TriangleMesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]]);
/// let scene = scene_of_mesh(mesh, "paper")?;
/// assert_eq!(scene.materials[0].name, "default");
/// # Ok::<(), raystream::scene::AssemblyError>(())
/// ```
///
/// # Errors
/// As for [`Assembly::add`].
pub fn scene_of_mesh(mut mesh: TriangleMesh, name: &str) -> Result<Scene, AssemblyError> {
    mesh.materials = vec![0; mesh.triangles.len()];
    mesh.normalise_normals();
    let mut assembly = Assembly::default();
    assembly.add(Part::new(name, mesh))?;
    assembly.build(MemoryBudget::of_machine())
}

/// The objects of a file that is one object: it has the file's name.
pub(super) fn one_object(path: &Path) -> Objects {
    let mut objects = Objects::default();
    let object = objects.add(Object::new(path.file_stem().unwrap_or_default().to_string_lossy()));
    objects.assign(0, object);
    objects
}

/// The scene of a mesh. All triangles are matte, of the vertices' colours or grey. `has_alpha` says whether the file
/// gives the colours an alpha.
pub(super) fn scene(
    mut mesh: TriangleMesh,
    objects: Objects,
    has_alpha: bool,
    warnings: &mut Warnings,
) -> Scene {
    mesh.materials = vec![0; mesh.triangles.len()];
    let materials = vec![material(&mesh, has_alpha, warnings)];
    let (mesh, objects) = (mesh.into(), objects.into());
    Scene { mesh, objects, materials, ..Scene::default() }
}

/// The material of a mesh: of its colours if it has any.
fn material(mesh: &TriangleMesh, has_alpha: bool, warnings: &mut Warnings) -> Material {
    if mesh.colours.is_empty() {
        return Material::fallback();
    }
    let mut material = Material::vertex_coloured();
    if has_alpha && !material.count_alpha(&[&mesh.colours]) {
        warnings.add(IGNORED_ALPHA);
    }
    material
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::AlphaMode;
    use glam::{Vec3, Vec4};

    fn triangle() -> TriangleMesh {
        TriangleMesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]])
    }

    #[test]
    fn meshes_in_memory_are_checked_and_coloured() {
        let plain = scene_of_mesh(triangle(), "a").expect("a scene");
        assert_eq!(plain.materials, [Material::fallback()]);
        let coloured = |colour| scene_of_mesh(TriangleMesh { colours: vec![colour; 3], ..triangle() }, "a");
        let opaque = coloured(Vec4::new(0.0, 0.5, 1.0, 1.0)).expect("a scene");
        assert_eq!(opaque.materials, [Material::vertex_coloured()]);
        let clear = coloured(Vec4::splat(0.5)).expect("a scene");
        assert_eq!(clear.materials[0].alpha.mode, AlphaMode::Blend);
        assert_eq!(coloured(Vec4::ZERO).expect("a scene").warnings.len(), 1, "nothing would be seen");
        let told = |scene: Result<Scene, AssemblyError>| scene.expect_err("refused").to_string();
        assert!(told(coloured(Vec4::splat(255.0))).contains("vertex 0 has 255"));
        assert!(told(coloured(Vec4::splat(f32::NAN))).contains("NaN"));
        let normals = vec![Vec3::Z * 3.0, Vec3::ZERO, Vec3::Z];
        let smooth = scene_of_mesh(TriangleMesh { normals, ..triangle() }, "a").expect("a scene");
        assert_eq!(smooth.mesh.normals, [Vec3::Z, Vec3::ZERO, Vec3::Z]);
        let normals = vec![Vec3::INFINITY; 3];
        assert!(told(scene_of_mesh(TriangleMesh { normals, ..triangle() }, "a")).contains("normals"));
        assert!(told(scene_of_mesh(TriangleMesh::default(), "a")).contains("no triangles"));
    }
}
