//! A scene: a triangle mesh with materials and textures, lights, an environment and a camera. `scene::load` reads
//! scenes from files. This module knows neither streams nor the BVH.

mod animation_span;
mod assembly;
mod block;
mod bound_texture;
mod camera;
mod camera_motion;
mod camera_path;
mod coat;
mod coded_surface;
pub(crate) mod corners;
mod effects;
mod emitted;
mod environment;
mod erased_lanes;
mod fingerprint;
mod finish;
#[cfg(feature = "flat")]
#[cfg_attr(not(feature = "unstable"), doc(hidden))]
pub mod flat;
mod footprint;
#[cfg(feature = "formats")]
#[cfg_attr(not(feature = "unstable"), doc(hidden))]
pub mod generate;
mod instance;
mod light;
#[cfg(feature = "meshes")]
pub mod load;
pub mod lookup;
mod material;
mod material_edit;
mod medium;
mod mesh;
mod mesh_size;
mod mip_weights;
mod mipmap;
mod mix;
mod moment;
mod named_camera;
mod object;
mod object_bounds;
mod openpbr;
mod own_surface;
mod points;
mod principled;
mod procedural;
#[cfg(feature = "formats")]
pub mod recipe;
mod scattering;
mod scattering_report;
mod shared;
mod srgb;
mod studio;
mod surface_field;
#[cfg(feature = "formats")]
mod surface_name;
mod texture;
mod texture_image;
mod texture_point;
mod validate;
mod vertex_attribute;

pub use animation_span::AnimationSpan;
pub use assembly::{Assembly, AssemblyError, Part};
pub use block::{BlockColumns, BlockFinishes, BlockSurface, WantedFields};
pub use bound_texture::{BoundTexture, NoTexture, TEXTURED_INPUTS};
pub(crate) use camera::Pinhole;
pub use camera::{
    Aperture, Camera, CameraError, Distortion, FULL_FRAME_HEIGHT, Intrinsics, Lens, LensRays, Projection,
};
#[cfg(feature = "formats")]
pub(crate) use camera_motion::unit_rotation;
pub use camera_motion::{AnimatedNode, CameraMotion, Interpolate, Interpolation, Key, Track};
pub use camera_path::{CameraPath, CameraPathError};
pub use coat::{Coat, Coats};
pub use coded_surface::{CodedSurface, GiveSurfaceError, NoSuchMaterial, SurfaceRequest};
pub use effects::{Effects, Transmission};
pub use environment::{Environment, EnvironmentMap};
pub use fingerprint::FINGERPRINT_VERSION;
pub(crate) use finish::FinishSource;
pub use finish::{FINISH_FIELDS, Finish};
pub use footprint::Footprint;
pub use instance::{Instance, Shape};
pub use light::{Light, LightShape};
pub use material::{Alpha, AlphaMode, Colour, Emission, Material, NormalMap, Scalar, Surface};
pub use material_edit::{Appearance, MAX_EDITED_RADIANCE, MaterialEdit, MaterialEditError};
pub use medium::Medium;
pub use mesh::{MAX_TRIANGLES, MeshError, TriangleMesh};
pub(crate) use mesh_size::MeshSize;
pub use mip_weights::Averaging;
pub use mipmap::Mipmap;
pub use mix::Mix;
pub use moment::Moment;
pub use named_camera::NamedCamera;
pub use object::{Object, Objects};
pub use openpbr::{OpenPbr, OpenPbrCoat, OpenPbrFuzz, OpenPbrSubsurface};
pub use own_surface::OwnSurface;
pub(crate) use points::{BASE, PointSink};
pub use points::{POINT_FIELDS, Points};
use principled::index_for_channel;
pub use principled::{Anisotropy, DiffuseTransmission, Iridescence, Principled, Sheen};
pub use procedural::{Procedural, ProceduralSurface};
pub use scattering::{Scattered, Scattering, ScatteringSurface};
pub use scattering_report::{Direction, ScatteringFault, ScatteringReport};
pub use shared::Shared;
pub use surface_field::{FieldType, SurfaceField};
#[cfg(feature = "formats")]
pub use surface_name::SurfaceName;
pub(crate) use texture::taps;
pub use texture::{Channel, ColourSpace, Texture, TextureRef, Wrap};
pub use texture_image::{TextureImage, TextureImageError, TextureUse};
pub use texture_point::TexturePoint;
pub use validate::{SceneError, ScenePart};
pub use vertex_attribute::{AttributeRequest, MAX_ATTRIBUTE_WIDTH, VertexAttribute};

use crate::geom::Aabb;
use crate::lanes::Num;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// A scene, from which a tree can be built and whose hits can be shaded.
///
/// World space is right-handed. Radiance is linear Rec. 709. Invariants, kept by the loaders and checked by
/// [`Scene::validate`]: every index is in range; coordinates are finite and at most [`crate::geom::MAX_COORDINATE`];
/// other numbers are finite and in the ranges that their fields state; there is at least one triangle.
///
/// A scene is shared geometry (`mesh`, `shapes`, `objects`), shared images (the texels of `textures` and of an
/// environment map) and a small *appearance*: all other fields. A clone therefore copies neither geometry nor texels,
/// and changing the clone's appearance leaves the geometry shared.
/// [`crate::engine::PreparedScene::with_scene`] then keeps the tree.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct Scene {
    /// All triangles in world space, in file order. Instances are written out.
    pub mesh: Shared<TriangleMesh>,
    /// Geometry that the file instances. The mesh holds a moved copy for each instance.
    pub shapes: Shared<Vec<Shape>>,
    /// The objects of the file, and which triangles belong to each. Empty if no loader has filled it.
    pub objects: Shared<Objects>,
    /// Materials, indexed by [`TriangleMesh::materials`].
    pub materials: Vec<Material>,
    /// Textures, indexed by [`TextureRef::texture`].
    pub textures: Vec<Texture>,
    /// Surfaces whose finish user code computes, indexed by [`Surface::Procedural`].
    pub procedurals: Vec<ProceduralSurface>,
    /// Surfaces whose BSDF is user code, indexed by [`Surface::Scattering`].
    pub scatterings: Vec<ScatteringSurface>,
    /// Mixes of two materials, indexed by [`Surface::Mix`].
    pub mixes: Vec<Mix>,
    /// Point, spot and directional lights. Emissive triangles are not listed here.
    pub lights: Vec<Light>,
    /// Radiance of rays that miss all triangles.
    pub environment: Environment,
    /// The file's camera. `None` if the file has none.
    pub camera: Option<Camera>,
    /// The animation of that camera. `None` if it does not move.
    pub camera_motion: Option<CameraMotion>,
    /// All cameras of the file, in file order, that one included.
    pub cameras: Vec<NamedCamera>,
    /// Surfaces of user code that the file asks for by name. The command line resolves them.
    pub surface_requests: Vec<SurfaceRequest>,
    /// Options of integrators by name, as a recipe sets them.
    pub options: BTreeMap<String, String>,
    /// Features of the file that the loader ignored or changed, one sentence each.
    pub warnings: Vec<String>,
    /// True if an animation of the file moves more than cameras ([`load::LoadOptions::with_time`]).
    pub is_animated: bool,
    /// The animations of the file that move more than cameras, in its order.
    pub animations: Vec<AnimationSpan>,
    /// The width in world units of the balls and tubes that stand for a glTF file's points and lines, if it has some.
    pub stroke_width: Option<f32>,
    /// Names of the material variants of the file (KHR_materials_variants). [`load::LoadOptions::with_variant`]
    /// chooses one.
    pub variants: Vec<String>,
    /// The files that the scene's file names and the loader read or looked for: material libraries, buffers, textures.
    pub files: Vec<PathBuf>,
    /// The moment that pictures show.
    pub moment: Moment,
    /// The boxes of the objects, found when first needed.
    pub(crate) object_bounds: object_bounds::ObjectBounds,
}

impl Scene {
    /// A scene of a mesh and its materials, without light: set [`Scene::environment`] or [`Scene::lights`], or give a
    /// material emission.
    pub fn new(mesh: impl Into<Shared<TriangleMesh>>, materials: Vec<Material>) -> Self {
        Self { mesh: mesh.into(), materials, ..Self::default() }
    }

    /// The bounding box of all vertices that triangles use.
    pub fn bounds(&self) -> Aabb {
        self.mesh.bounds()
    }

    /// True if both scenes have the same mesh and shapes in memory.
    pub fn shares_geometry(&self, other: &Self) -> bool {
        Shared::is_same(&self.mesh, &other.mesh) && Shared::is_same(&self.shapes, &other.shapes)
    }

    /// For each material, true if its alpha mode is not opaque.
    pub(crate) fn masked_materials(&self) -> Vec<bool> {
        self.materials.iter().map(|material| material.alpha.mode.is_masked()).collect()
    }

    /// Bytes of triangles and textures, by far the largest parts.
    pub fn bytes(&self) -> u64 {
        let mut images: Vec<&[[u8; 4]]> = self.textures.iter().map(|texture| &*texture.texels).collect();
        let of_patterns = self.procedurals.iter().flat_map(ProceduralSurface::textures);
        let of_code = of_patterns.chain(self.scatterings.iter().flat_map(ScatteringSurface::textures));
        images.extend(of_code.map(BoundTexture::texels));
        // Textures may share texels.
        images.sort_by_key(|image| image.as_ptr());
        images.dedup_by_key(|image| image.as_ptr());
        let textures: usize = images.into_iter().map(size_of_val).sum();
        let shape = |shape: &Shape| {
            size_of_val(&*shape.positions) + size_of_val(&*shape.triangles) + size_of_val(&*shape.instances)
        };
        let map = match &self.environment {
            Environment::Constant(_) => 0,
            Environment::Map(map) => size_of_val(&*map.texels),
        };
        (self.mesh.bytes() + self.shapes.iter().map(shape).sum::<usize>() + textures + map) as u64
    }

    /// True if the material of `primitive` has an alpha mode other than opaque. Only such triangles need
    /// [`Scene::alpha_accepts`] during traversal.
    pub fn is_masked(&self, primitive: u32) -> bool {
        self.material_of(primitive).alpha.mode.is_masked()
    }

    /// The alpha test: whether a candidate hit on `primitive` at barycentric (`u`, `v`) counts. It is a pure function
    /// of its arguments, so all rays and all units agree. `Mask` compares alpha with the cutoff. `Blend` keeps the
    /// hit with probability alpha, decided by a hash of the arguments.
    pub fn alpha_accepts(&self, primitive: u32, u: f32, v: f32) -> bool {
        match self.material_of(primitive).alpha.mode {
            AlphaMode::Opaque => true,
            AlphaMode::Mask { cutoff } => self.alpha_at(primitive, u, v) >= cutoff,
            AlphaMode::Blend => {
                let bits = crate::geom::mix(
                    primitive ^ crate::geom::mix(u.to_bits() ^ crate::geom::mix(v.to_bits())),
                );
                self.alpha_at(primitive, u, v) > (bits >> 8) as f32 * (1.0 / (1 << 24) as f32)
            }
        }
    }

    /// The share of candidate hits around a point of `primitive` that [`Scene::alpha_accepts`], 0..=1.
    pub fn coverage(&self, primitive: u32, u: f32, v: f32) -> f32 {
        match self.material_of(primitive).alpha.mode {
            AlphaMode::Opaque => 1.0,
            AlphaMode::Mask { .. } => f32::from(self.alpha_accepts(primitive, u, v)),
            AlphaMode::Blend => self.alpha_at(primitive, u, v).clamp(0.0, 1.0),
        }
    }

    fn material_of(&self, primitive: u32) -> &Material {
        &self.materials[self.mesh.materials[primitive as usize] as usize]
    }

    /// Alpha at a point of a triangle, whatever its alpha mode.
    fn alpha_at(&self, primitive: u32, u: f32, v: f32) -> f32 {
        let alpha = &self.material_of(primitive).alpha;
        let texel = alpha.value.texture.map_or(1.0, |(texture, channel)| {
            let uv = self.mesh.uv_at(texture.set, primitive, u, v).to_array().map(Num::from);
            let point = Footprint::point(uv[0].lanes());
            self.textures[texture.texture as usize].channel(channel, texture.transform(uv), &point).get()
        });
        let value = alpha.value.factor * texel;
        if alpha.vertex { value * self.mesh.colour_at(primitive, u, v).w } else { value }
    }

    /// True if a material computes opacity.
    pub(crate) fn computes_opacity(&self, material: &Material) -> bool {
        match material.surface {
            Surface::Procedural(index) => self.procedurals[index as usize].effects().has_opacity,
            _ => false,
        }
    }
}
