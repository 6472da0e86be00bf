//! `raystream mesh`.

use super::args::MeshArgs;
use super::arrays::{Array, write_npz};
use crate::scene::{AlphaMode, Colour, Material, Principled, Surface, load};
use anyhow::Result;

/// No texture.
const NONE: u32 = u32::MAX;

/// Writes a scene's triangles as arrays, and of its materials what other programs know, too.
pub fn run(args: &MeshArgs) -> Result<()> {
    let scene = load::load(&args.scene)?;
    let mesh = &scene.mesh;
    let looks: Vec<Look> = scene.materials.iter().map(Look::of).collect();
    let emission: Vec<[f32; 3]> = (scene.materials.iter())
        .map(|material| material.emission.map_or([0.0; 3], |emission| emission.radiance.factor.to_array()))
        .collect();
    let base_colour: Vec<[f32; 3]> = looks.iter().map(|look| look.base.factor.to_array()).collect();
    let numbers = |number: fn(&Look) -> f32| -> Vec<f32> { looks.iter().map(number).collect() };
    let textures = |texture: fn(&Look) -> u32| -> Vec<u32> { looks.iter().map(texture).collect() };
    let [metallic, roughness] = [numbers(|look| look.metallic), numbers(|look| look.roughness)];
    let [specular, transmission] = [numbers(|look| look.specular), numbers(|look| look.transmission)];
    let [ior, opacity] = [numbers(|look| look.ior), numbers(|look| look.opacity)];
    let thin = textures(|look| look.thin);
    let base_texture = textures(|look| look.base.texture.map_or(NONE, |texture| texture.texture));
    let opacity_texture = textures(|look| look.opacity_texture);
    let opacity_channel = textures(|look| look.opacity_channel);
    let mut arrays: Vec<(String, u64, Array<'_>)> = [
        ("vertices", 3, Array::F32(bytemuck::cast_slice(&mesh.positions))),
        ("normals", 3, Array::F32(bytemuck::cast_slice(&mesh.normals))),
        ("uvs", 2, Array::F32(bytemuck::cast_slice(&mesh.uvs))),
        ("triangles", 3, Array::U32(mesh.triangles.as_flattened())),
        ("material", 0, Array::U32(&mesh.materials)),
        ("emission", 3, Array::F32(emission.as_flattened())),
        ("base_colour", 3, Array::F32(base_colour.as_flattened())),
        ("base_texture", 0, Array::U32(&base_texture)),
        ("metallic", 0, Array::F32(&metallic)),
        ("roughness", 0, Array::F32(&roughness)),
        ("specular", 0, Array::F32(&specular)),
        ("transmission", 0, Array::F32(&transmission)),
        ("ior", 0, Array::F32(&ior)),
        ("thin", 0, Array::Bool(&thin)),
        ("opacity", 0, Array::F32(&opacity)),
        ("opacity_texture", 0, Array::U32(&opacity_texture)),
        ("opacity_channel", 0, Array::U32(&opacity_channel)),
    ]
    .map(|(name, columns, array)| (name.to_owned(), columns, array))
    .into();
    for (i, texture) in scene.textures.iter().enumerate().filter(|_| args.images) {
        let texels = Array::U32(bytemuck::cast_slice(texture.image()));
        arrays.push((format!("texture{i}"), texture.width.into(), texels));
    }
    write_npz(&args.output, &arrays)?;
    println!(
        "{}: {} vertices, {} triangles",
        args.output.display(),
        mesh.positions.len(),
        mesh.triangles.len()
    );
    Ok(())
}

/// What most renderers know of a surface: numbers without their textures.
struct Look {
    base: Colour,
    metallic: f32,
    roughness: f32,
    specular: f32,
    transmission: f32,
    ior: f32,
    /// Of what is transmitted: 1 where it passes straight through, 0 where it enters a body.
    thin: u32,
    opacity: f32,
    opacity_texture: u32,
    /// Of that texture: red, green, blue, alpha, or 4, the mean of the first three.
    opacity_channel: u32,
}

impl Look {
    fn of(material: &Material) -> Self {
        let matte = Principled::default();
        let mut look = Self {
            base: matte.base_colour,
            metallic: 0.0,
            roughness: 1.0,
            specular: 0.0,
            transmission: 0.0,
            ior: matte.ior,
            thin: 0,
            opacity: 1.0,
            opacity_texture: NONE,
            opacity_channel: 0,
        };
        if material.alpha.mode != AlphaMode::Opaque {
            look.opacity = material.alpha.value.factor;
            if let Some((texture, channel)) = &material.alpha.value.texture {
                (look.opacity_texture, look.opacity_channel) = (texture.texture, *channel as u32);
            }
        }
        match &material.surface {
            Surface::Matte { reflectance } => look.base = *reflectance,
            Surface::Mirror { reflectance } => {
                (look.base, look.metallic, look.roughness) = (*reflectance, 1.0, 0.0);
            }
            Surface::Dielectric { ior, transmittance } => {
                (look.base, look.ior) = (Colour::constant(*transmittance), *ior);
                (look.transmission, look.specular, look.roughness) = (1.0, 1.0, 0.0);
            }
            Surface::Principled(surface) => {
                (look.base, look.ior) = (surface.base_colour, surface.ior);
                (look.metallic, look.roughness) = (surface.metallic.factor, surface.roughness.factor);
                (look.specular, look.transmission) = (surface.specular.factor, surface.transmission.factor);
                look.thin = surface.thin.into();
            }
            Surface::Procedural(_) | Surface::Scattering(_) | Surface::Mix(_) => {}
        }
        look
    }
}
