//! `raystream mesh`.

use super::args::MeshArgs;
use super::arrays::{check_npz, write_npz};
use super::outputs::Outputs;
use anyhow::Result;
use raystream::numpy::Values;
use raystream::picture::scene_file;
use raystream::scene::{AlphaMode, Colour, Material, Principled, Surface};

/// The texture index that stands for no texture.
const NONE: u32 = u32::MAX;

/// Writes a scene's triangles as arrays, with the material factors that other renderers share.
pub fn run(args: &MeshArgs) -> Result<()> {
    check_npz(&args.output)?;
    let outputs = Outputs::check([("-o", Some(&*args.output))], [("the scene", Some(&*args.scene))])?;
    let scene = scene_file::read(&args.scene, &args.loading.options())?;
    outputs.check_files_of(&scene)?;
    let mesh = &scene.mesh;
    let factors: Vec<Factors> = scene.materials.iter().map(Factors::of).collect();
    let emission: Vec<[f32; 3]> = (scene.materials.iter())
        .map(|material| material.emission.map_or([0.0; 3], |emission| emission.radiance.factor.to_array()))
        .collect();
    let base_colour: Vec<[f32; 3]> = factors.iter().map(|factors| factors.base.factor.to_array()).collect();
    let numbers = |number: fn(&Factors) -> f32| -> Vec<f32> { factors.iter().map(number).collect() };
    let textures = |texture: fn(&Factors) -> u32| -> Vec<u32> { factors.iter().map(texture).collect() };
    let [metallic, roughness] = [numbers(|factors| factors.metallic), numbers(|factors| factors.roughness)];
    let [specular, transmission] =
        [numbers(|factors| factors.specular), numbers(|factors| factors.transmission)];
    let [ior, opacity] = [numbers(|factors| factors.ior), numbers(|factors| factors.opacity)];
    let thin = textures(|factors| factors.thin);
    let base_texture = textures(|factors| factors.base.texture.map_or(NONE, |texture| texture.texture));
    let opacity_texture = textures(|factors| factors.opacity_texture);
    let opacity_channel = textures(|factors| factors.opacity_channel);
    let mut arrays: Vec<(String, u64, Values<'_>)> = [
        ("vertices", 3, Values::F32(bytemuck::cast_slice(&mesh.positions))),
        ("normals", 3, Values::F32(bytemuck::cast_slice(&mesh.normals))),
        ("uvs", 2, Values::F32(bytemuck::cast_slice(&mesh.uvs))),
        ("colours", 4, Values::F32(bytemuck::cast_slice(&mesh.colours))),
        ("triangles", 3, Values::U32(mesh.triangles.as_flattened())),
        ("material", 0, Values::U32(&mesh.materials)),
        ("emission", 3, Values::F32(emission.as_flattened())),
        ("base_colour", 3, Values::F32(base_colour.as_flattened())),
        ("base_texture", 0, Values::U32(&base_texture)),
        ("metallic", 0, Values::F32(&metallic)),
        ("roughness", 0, Values::F32(&roughness)),
        ("specular", 0, Values::F32(&specular)),
        ("transmission", 0, Values::F32(&transmission)),
        ("ior", 0, Values::F32(&ior)),
        ("thin", 0, Values::Bool(&thin)),
        ("opacity", 0, Values::F32(&opacity)),
        ("opacity_texture", 0, Values::U32(&opacity_texture)),
        ("opacity_channel", 0, Values::U32(&opacity_channel)),
    ]
    .map(|(name, columns, array)| (name.to_owned(), columns, array))
    .into();
    for (i, texture) in scene.textures.iter().enumerate().filter(|_| args.images) {
        let texels = Values::U32(bytemuck::cast_slice(texture.image()));
        arrays.push((format!("texture{i}"), texture.width.into(), texels));
    }
    write_npz(&args.output, &arrays)?;
    stdout_line!(
        "{}: {} vertices, {} triangles",
        args.output.display(),
        mesh.positions.len(),
        mesh.triangles.len()
    );
    if !scene.variants.is_empty() {
        stdout_line!("variants: {}", scene.variants.join(", "));
    }
    Ok(())
}

/// The factors of a surface that most renderers share, without textures.
struct Factors {
    base: Colour,
    metallic: f32,
    roughness: f32,
    specular: f32,
    transmission: f32,
    ior: f32,
    /// 1 if transmitted light passes straight through (a thin wall), 0 if it enters a body.
    thin: u32,
    opacity: f32,
    opacity_texture: u32,
    /// Channel of the opacity texture: 0 to 3 for RGBA, 4 for the mean of RGB.
    opacity_channel: u32,
}

impl Factors {
    fn of(material: &Material) -> Self {
        let matte = Principled::default();
        let mut factors = Self {
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
            factors.opacity = material.alpha.value.factor;
            if let Some((texture, channel)) = &material.alpha.value.texture {
                (factors.opacity_texture, factors.opacity_channel) = (texture.texture, *channel as u32);
            }
        }
        match &material.surface {
            Surface::Matte { reflectance } => factors.base = *reflectance,
            Surface::Mirror { reflectance } => {
                (factors.base, factors.metallic, factors.roughness) = (*reflectance, 1.0, 0.0);
            }
            Surface::Dielectric { ior, transmittance } => {
                (factors.base, factors.ior) = (Colour::constant(*transmittance), *ior);
                (factors.transmission, factors.specular, factors.roughness) = (1.0, 1.0, 0.0);
            }
            Surface::Principled(surface) => {
                (factors.base, factors.ior) = (surface.base_colour, surface.ior);
                (factors.metallic, factors.roughness) = (surface.metallic.factor, surface.roughness.factor);
                (factors.specular, factors.transmission) =
                    (surface.specular.factor, surface.transmission.factor);
                if let Some(glossiness) = surface.glossiness {
                    factors.roughness = 1.0 - glossiness.factor;
                }
                factors.thin = surface.thin.into();
            }
            Surface::OpenPbr(surface) => {
                (factors.base, factors.ior) = (surface.base_color, surface.specular_ior);
                factors.base.factor *= surface.base_weight.factor;
                (factors.metallic, factors.roughness) =
                    (surface.base_metalness.factor, surface.specular_roughness.factor);
                (factors.specular, factors.transmission) =
                    (surface.specular_weight.factor, surface.transmission_weight.factor);
                factors.thin = surface.thin_walled.into();
            }
            _ => {}
        }
        factors
    }
}
