//! `raystream mesh`.

use super::args::MeshArgs;
use super::arrays::{Array, write_npz};
use crate::scene::load;
use anyhow::Result;

/// Writes a scene's triangles as arrays.
pub fn run(args: &MeshArgs) -> Result<()> {
    let scene = load::load(&args.scene)?;
    let mesh = &scene.mesh;
    let vertices: &[f32] = bytemuck::cast_slice(&mesh.positions);
    let triangles = mesh.triangles.as_flattened();
    let emission: Vec<[f32; 3]> = (scene.materials.iter())
        .map(|material| material.emission.map_or([0.0; 3], |emission| emission.radiance.factor.to_array()))
        .collect();
    write_npz(
        &args.output,
        &[
            ("vertices", 3, Array::F32(vertices)),
            ("triangles", 3, Array::U32(triangles)),
            ("material", 0, Array::U32(&mesh.materials)),
            ("emission", 3, Array::F32(emission.as_flattened())),
        ],
    )?;
    println!(
        "{}: {} vertices, {} triangles",
        args.output.display(),
        mesh.positions.len(),
        mesh.triangles.len()
    );
    Ok(())
}
