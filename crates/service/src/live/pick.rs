//! What is seen at a pixel.

use glam::Vec3;
use raystream::engine::PreparedScene;
use raystream::scene::{Camera, Material, Surface};
use raystream::stream::Ray;
use serde::Serialize;

/// The first hit of a ray through a pixel's centre.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Picked {
    /// Index of the triangle.
    pub primitive: u32,
    /// The place of the hit in world space.
    pub position: Vec3,
    /// Distance from the eye.
    pub distance: f32,
    /// Distance along the view axis, which is that of a sharp plane.
    pub depth: f32,
    /// Path of the object's names. `None` if the file names none.
    pub object: Option<String>,
    /// The material.
    pub material: MaterialFacts,
}

/// A material as editors show it.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct MaterialFacts {
    /// Its index.
    pub index: u32,
    /// Its name.
    pub name: String,
    /// The kind of its surface: `matte`, `mirror`, `dielectric`, `principled`, `OpenPBR`,
    /// `shader`, `user code` or `mix`.
    pub kind: &'static str,
    /// Base colour, linear Rec. 709. `None` if it cannot be edited, as roughness and metallic then.
    pub base_colour: Option<Vec3>,
    /// Perceptual roughness.
    pub roughness: Option<f32>,
    /// Share of metal.
    pub metallic: Option<f32>,
    /// Emitted radiance.
    pub emission: Vec3,
    /// True if textures multiply some of these values.
    pub textured: bool,
}

impl MaterialFacts {
    fn of(index: u32, material: &Material) -> Self {
        let kind = match material.surface {
            Surface::Matte { .. } => "matte",
            Surface::Mirror { .. } => "mirror",
            Surface::Dielectric { .. } => "dielectric",
            Surface::Principled(_) => "principled",
            Surface::Procedural(_) => "shader",
            Surface::Scattering(_) => "user code",
            Surface::Mix(_) => "mix",
            Surface::OpenPbr(_) => "OpenPBR",
            _ => "other",
        };
        let appearance = material.appearance();
        Self {
            index,
            name: material.name.clone(),
            kind,
            base_colour: appearance.map(|appearance| appearance.base_colour),
            roughness: appearance.map(|appearance| appearance.roughness),
            metallic: appearance.map(|appearance| appearance.metallic),
            emission: material.emission.map_or(Vec3::ZERO, |emission| emission.radiance.factor),
            textured: appearance.is_some_and(|appearance| appearance.is_textured),
        }
    }
}

/// What the centre of a pixel of a picture of this size shows. `None` if it is outside, or nothing is hit.
pub(super) fn pick(
    prepared: &PreparedScene,
    camera: &Camera,
    size: [u32; 2],
    [x, y]: [u32; 2],
) -> Option<Picked> {
    if x >= size[0] || y >= size[1] {
        return None;
    }
    let lens = camera.lens(size[0], size[1]).ok()?;
    let (origin, direction) = lens.ray(x, y, [0.5; 2])?;
    let ray = Ray::new(origin, direction);
    let hit = prepared.single_ray.closest_one(&ray);
    if hit.is_miss() {
        return None;
    }
    let scene = &prepared.scene;
    let position = ray.at(hit.t);
    let material = scene.mesh.materials[hit.primitive as usize];
    let axis = (camera.target - camera.eye).normalize_or_zero();
    Some(Picked {
        primitive: hit.primitive,
        position,
        distance: position.distance(camera.eye),
        depth: (position - camera.eye).dot(axis),
        object: scene.objects.of(hit.primitive).map(|object| scene.objects.path(object)),
        material: MaterialFacts::of(material, &scene.materials[material as usize]),
    })
}
