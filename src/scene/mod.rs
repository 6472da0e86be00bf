//! What is rendered: a flat triangle mesh with materials and textures, lights, an environment and a
//! camera. `scene::load` reads it from files. Knows neither streams nor the BVH.

mod camera;
mod camera_motion;
mod camera_path;
mod coat;
mod environment;
mod erased_lanes;
mod fingerprint;
mod footprint;
mod instance;
mod light;
#[cfg(feature = "formats")]
pub mod load;
mod material;
mod medium;
mod mesh;
mod mip_weights;
mod mipmap;
mod mix;
mod principled;
mod procedural;
#[cfg(feature = "formats")]
pub mod recipe;
mod scattering;
mod srgb;
mod texture;

pub use camera::{Camera, CameraError, Lens};
#[cfg(feature = "formats")]
pub(crate) use camera_motion::unit_turn;
pub use camera_motion::{CameraMotion, Interpolation, Joint, Key, Track, Tracked};
pub use camera_path::{CameraPath, CameraPathError};
pub use coat::{Coat, Coats};
pub use environment::{Environment, EnvironmentMap};
pub use fingerprint::FINGERPRINT_VERSION;
pub use footprint::Footprint;
pub use instance::{Instance, Shape};
pub use light::{Light, LightShape};
pub use material::{Alpha, AlphaMode, Colour, Emission, Material, NormalMap, Scalar, Surface};
pub use medium::Medium;
pub use mesh::{MAX_TRIANGLES, Mesh, MeshError};
pub use mip_weights::Averaging;
pub use mipmap::Mipmap;
pub use mix::Mix;
pub use principled::{Anisotropy, Iridescence, Principled, Sheen};
pub use procedural::{Finish, Points, Procedural, ProceduralSurface};
pub use scattering::{Scattered, Scattering, ScatteringSurface};
pub(crate) use texture::taps;
pub use texture::{Channel, ColourSpace, Texture, TextureRef, Wrap};

use crate::geom::Aabb;
use crate::lanes::Num;

/// A scene, ready to be built and shaded.
///
/// World space is right-handed; radiance is linear Rec. 709. Invariants (kept by the loaders,
/// checked by [`Mesh::validate`]): every index is in range, coordinates are finite and at most
/// [`crate::geom::MAX_COORDINATE`], and there is at least one material when there are triangles.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// All triangles, instances flattened, in file order.
    pub mesh: Mesh,
    /// Geometry that the mesh has several moved copies of.
    pub shapes: Vec<Shape>,
    /// Materials that [`Mesh::materials`] names.
    pub materials: Vec<Material>,
    /// Textures that materials name.
    pub textures: Vec<Texture>,
    /// Surfaces that code computes.
    pub procedurals: Vec<ProceduralSurface>,
    /// Surfaces that scatter light by code.
    pub scatterings: Vec<ScatteringSurface>,
    /// Surfaces that are two others.
    pub mixes: Vec<Mix>,
    /// Point, spot and directional lights. Emissive triangles are not listed here.
    pub lights: Vec<Light>,
    /// What a ray sees that leaves the scene.
    pub environment: Environment,
    /// The file's camera, if it has one.
    pub camera: Option<Camera>,
    /// How that camera moves, if it does.
    pub camera_motion: Option<CameraMotion>,
    /// What the loader could not honour, one sentence each.
    pub warnings: Vec<String>,
}

impl Scene {
    /// The box around all vertices that triangles use.
    pub fn bounds(&self) -> Aabb {
        self.mesh.bounds()
    }

    /// Whether primitive `primitive` lets light through where its material's alpha says so. Only
    /// such triangles need [`Scene::alpha_accepts`] during traversal.
    pub fn is_masked(&self, primitive: u32) -> bool {
        let material = self.mesh.materials[primitive as usize];
        self.materials[material as usize].alpha.mode != AlphaMode::Opaque
    }

    /// Whether the surface is there at barycentric (`u`, `v`) of a triangle: the alpha test, a pure
    /// function of its arguments. `Mask` compares with the cutoff; `Blend` keeps the hit with
    /// probability alpha, decided by a hash of the arguments, so that all rays and all units agree.
    pub fn alpha_accepts(&self, primitive: u32, u: f32, v: f32) -> bool {
        let material = &self.materials[self.mesh.materials[primitive as usize] as usize];
        let alpha = || {
            let texel = material.alpha.value.texture.map_or(1.0, |(texture, channel)| {
                let uv = self.mesh.uv_at(primitive, u, v).to_array().map(Num::from);
                let point = Footprint::point(uv[0].lanes());
                self.textures[texture.texture as usize].channel(channel, texture.place(uv), &point).get()
            });
            material.alpha.value.factor * texel
        };
        match material.alpha.mode {
            AlphaMode::Opaque => true,
            AlphaMode::Mask { cutoff } => alpha() >= cutoff,
            AlphaMode::Blend => {
                let bits = crate::geom::mix(
                    primitive ^ crate::geom::mix(u.to_bits() ^ crate::geom::mix(v.to_bits())),
                );
                alpha() > (bits >> 8) as f32 * (1.0 / (1 << 24) as f32)
            }
        }
    }
}
