//! Textures that user code looks up: files of its own, and those of materials.

use super::fingerprint::{Encode, Encoder};
use super::{
    Colour, ColourSpace, Footprint, Material, Mipmap, OwnSurface, Principled, Scalar, Scene, Surface,
    Texture, TextureRef, Wrap,
};
use crate::lanes::{Lanes, Num};

/// A texture that user code looks up at coordinates of its choice, filtered like all textures.
#[derive(Clone, Debug)]
pub struct BoundTexture {
    texture: Texture,
    /// The transform of the coordinates.
    reference: TextureRef,
    hash: u64,
}

impl BoundTexture {
    /// A texture whose coordinates are not transformed. Without mipmap levels ([`Texture::add_mipmap`]) every lookup
    /// reads the image itself.
    pub fn new(texture: Texture) -> Self {
        Self::with_transform(texture, TextureRef::plain(0))
    }

    fn with_transform(texture: Texture, reference: TextureRef) -> Self {
        let hash = Encoder::digest_of(&Hashed { texture: &texture, reference: &reference });
        Self { texture, reference, hash }
    }

    /// A texture of a scene, with a material's transform of its coordinates.
    ///
    /// # Panics
    /// If the scene has no such texture.
    pub fn of_scene(scene: &Scene, reference: TextureRef) -> Self {
        Self::with_transform(scene.textures[reference.texture as usize].clone(), reference)
    }

    /// A texture of one white texel.
    pub fn white() -> Self {
        Self::new(Texture {
            name: "white".into(),
            width: 1,
            height: 1,
            texels: [[u8::MAX; 4]].into(),
            space: ColourSpace::Linear,
            wrap_u: Wrap::Repeat,
            wrap_v: Wrap::Repeat,
            mipmap: Mipmap::default(),
        })
    }

    /// Linear RGBA at coordinates, as the mean over squares of this side around them: see [`Texture::look_up`].
    /// `hit` are the barycentrics of the hits.
    #[inline(always)]
    pub fn look_up<L: Lanes>(&self, place: [Num<L>; 2], width: Num<L>, hit: [Num<L>; 2]) -> [Num<L>; 4] {
        let footprint = self.reference.scaled(&Footprint::of_width(width, hit));
        self.texture.look_up(self.reference.transform(place), &footprint)
    }

    /// The texels, with their mipmap levels.
    pub fn texels(&self) -> &[[u8; 4]] {
        &self.texture.texels
    }

    /// A hash of all that a lookup depends on.
    pub fn hash(&self) -> u64 {
        self.hash
    }
}

/// What a lookup depends on.
struct Hashed<'a> {
    texture: &'a Texture,
    reference: &'a TextureRef,
}

impl Encode for Hashed<'_> {
    fn encode(&self, to: &mut Encoder) {
        let Self { texture, reference: TextureRef { texture: _, set: _, offset, rotation, scale } } = self;
        texture.encode(to);
        offset.encode(to);
        rotation.encode(to);
        scale.encode(to);
    }
}

/// The texture of an input of a material. The surface is that of the material itself, if it has one.
type Find = fn(&Material, Option<&Principled>) -> Option<TextureRef>;

fn of_colour(colour: &Colour) -> Option<TextureRef> {
    colour.texture
}

fn of_scalar(scalar: &Scalar) -> Option<TextureRef> {
    scalar.texture.map(|(texture, _)| texture)
}

/// The inputs of materials that may have textures.
const INPUTS: [(&str, Find); 20] = [
    ("base-colour", |_, surface| of_colour(&surface?.base_colour)),
    ("metallic", |_, surface| of_scalar(&surface?.metallic)),
    ("roughness", |_, surface| of_scalar(&surface?.roughness)),
    ("glossiness", |_, surface| of_scalar(surface?.glossiness.as_ref()?)),
    ("specular", |_, surface| of_scalar(&surface?.specular)),
    ("specular-colour", |_, surface| of_colour(&surface?.specular_colour)),
    ("transmission", |_, surface| of_scalar(&surface?.transmission)),
    ("clearcoat", |_, surface| of_scalar(&surface?.clearcoat)),
    ("clearcoat-roughness", |_, surface| of_scalar(&surface?.clearcoat_roughness)),
    ("clearcoat-normal", |_, surface| Some(surface?.coat_normal_map?.texture)),
    ("anisotropy", |_, surface| {
        let of = surface?.anisotropy?;
        of.direction.or(of_scalar(&of.strength))
    }),
    ("sheen", |_, surface| of_colour(&surface?.sheen?.colour)),
    ("sheen-roughness", |_, surface| of_scalar(&surface?.sheen?.roughness)),
    ("film", |_, surface| of_scalar(&surface?.iridescence?.strength)),
    ("film-thickness", |_, surface| surface?.iridescence?.thickness_texture.map(|(texture, _)| texture)),
    ("diffuse-transmission", |_, surface| of_scalar(&surface?.diffuse_transmission?.share)),
    ("diffuse-transmission-colour", |_, surface| of_colour(&surface?.diffuse_transmission?.colour)),
    ("normal", |material, _| Some(material.normal_map?.texture)),
    ("emission", |material, _| of_colour(&material.emission?.radiance)),
    ("alpha", |material, _| of_scalar(&material.alpha.value)),
];

impl Material {
    /// The first input whose texture reads a set of texture coordinates that a mesh of so many sets lacks, and the
    /// set.
    pub(super) fn reads_beyond(&self, sets: usize) -> Option<(&'static str, u32)> {
        let surface = self.principled();
        let read = INPUTS.iter().filter_map(|(name, find)| Some((*name, find(self, surface.as_ref())?)));
        let openpbr = match &self.surface {
            Surface::OpenPbr(surface) => Some(surface.textures()),
            _ => None,
        };
        let mut read = read.chain(openpbr.into_iter().flatten()).map(|(name, texture)| (name, texture.set));
        read.find(|(_, set)| *set as usize >= sets)
    }
}

/// The inputs of materials that may have textures, by name.
pub const TEXTURED_INPUTS: [&str; INPUTS.len()] = {
    let mut names = [""; INPUTS.len()];
    let mut i = 0;
    while i < INPUTS.len() {
        names[i] = INPUTS[i].0;
        i += 1;
    }
    names
};

/// A material has no texture of this name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NoTexture {
    /// Materials have no such input.
    #[error("materials have no input {input:?} with a texture; they have {}", TEXTURED_INPUTS.join(", "))]
    NoInput {
        /// The name.
        input: String,
    },
    /// This material's input has none.
    #[error("{material:?} has no texture of {input:?}; it has {}", listed(.there))]
    Untextured {
        /// The material's name.
        material: String,
        /// The input.
        input: String,
        /// The inputs that have textures.
        there: Vec<&'static str>,
    },
}

fn listed(inputs: &[&str]) -> String {
    if inputs.is_empty() { "none at all".into() } else { format!("those of {}", inputs.join(", ")) }
}

impl Scene {
    /// The texture of an input of a material, by the material's number and the input's name.
    ///
    /// # Errors
    /// If there is no such input, or it has no texture.
    ///
    /// # Panics
    /// If there is no such material.
    pub fn texture_of(&self, material: usize, input: &str) -> Result<TextureRef, NoTexture> {
        let material = &self.materials[material];
        let own = self.own_surface(material);
        let surface = own.as_ref().map(OwnSurface::surface);
        let Some((_, find)) = INPUTS.iter().find(|(name, _)| *name == input) else {
            return Err(NoTexture::NoInput { input: input.to_owned() });
        };
        find(material, surface).ok_or_else(|| {
            let there = INPUTS.iter().filter(|(_, find)| find(material, surface).is_some());
            NoTexture::Untextured {
                material: material.name.clone(),
                input: input.to_owned(),
                there: there.map(|(name, _)| *name).collect(),
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::{Int, Mask, SingleLane, Vector};
    use crate::scene::{Averaging, Channel, Points, Surface, TriangleMesh};
    use glam::{Vec2, Vec3};
    use std::collections::BTreeSet;

    fn checks(side: u32) -> Texture {
        let texel = |i: u32| [if (i + i / side).is_multiple_of(2) { 255 } else { 0 }, i as u8, 77, 200];
        let mut texture = Texture {
            name: String::new(),
            width: side,
            height: side,
            texels: (0..side * side).map(texel).collect(),
            space: ColourSpace::Srgb,
            wrap_u: Wrap::Mirror,
            wrap_v: Wrap::Clamp,
            mipmap: Mipmap::default(),
        };
        texture.add_mipmap(Averaging::Covered);
        texture
    }

    /// A point of the triangle, seen from above by a cone of a width.
    fn point(scene: &Scene, [u, v]: [f32; 2], width: f32) -> Points<'_, SingleLane> {
        let l = SingleLane;
        let n = |x: f32| Num::splat(l, x);
        let up = Vector::new(n(0.0), n(0.0), n(1.0));
        Points {
            position: Vector::new(n(u), n(v), n(0.0)),
            normal: up,
            geometric_normal: up,
            wo: up,
            uv: scene.mesh.uv_at(0, 0, u, v).to_array().map(n),
            barycentric: [n(u), n(v)],
            width: n(width),
            area: n(0.5),
            primitive: Int::splat(l, 0),
            front: Mask::splat(l, true),
            bumps: n(0.0),
            scene,
            own: None,
        }
    }

    fn scene() -> Scene {
        let mut mesh = TriangleMesh {
            positions: [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(Vec3::from).to_vec(),
            ..TriangleMesh::default()
        };
        mesh.uvs = [[0.1, 0.2], [1.4, 0.3], [0.2, 1.7]].map(Vec2::from).to_vec();
        (mesh.triangles, mesh.materials) = (vec![[0, 1, 2]], vec![0]);
        let turned = TextureRef {
            offset: Vec2::new(0.3, -0.2),
            rotation: 0.4,
            scale: Vec2::new(2.0, 0.5),
            ..TextureRef::plain(0)
        };
        let mut wall = Material::matte("wall", Vec3::ONE);
        wall.surface = Surface::Principled(Principled {
            base_colour: Colour { texture: Some(turned), ..Colour::constant(Vec3::ONE) },
            roughness: Scalar { factor: 1.0, texture: Some((TextureRef::plain(0), Channel::G)) },
            ..Principled::default()
        });
        Scene { textures: vec![checks(64)], ..Scene::new(mesh, vec![wall]) }
    }

    /// Bound to a material's input, a texture is looked up with the bits of the material's own lookup, near and far.
    #[test]
    fn lookups_have_the_bits_of_the_materials_own() {
        let scene = scene();
        let reference = scene.texture_of(0, "base-colour").expect("it has one");
        let bound = BoundTexture::of_scene(&scene, reference);
        let mut seen = BTreeSet::new();
        for i in 0..200 {
            let t = i as f32 / 200.0;
            let points = point(&scene, [0.9 * t, 0.1 - 0.1 * t * t], [0.0, 0.01, 0.07, 3.0][i % 4]);
            let native = points.texture(&reference).map(Num::get);
            let found = bound.look_up(points.uv, points.footprint(), points.barycentric).map(Num::get);
            assert_eq!(native.map(f32::to_bits), found.map(f32::to_bits), "{i}");
            seen.insert(native[0].to_bits());
        }
        assert!(seen.len() > 10, "{}", seen.len());
    }

    #[test]
    fn inputs_without_textures_are_told_with_those_that_have_some() {
        let scene = scene();
        let told = |input| scene.texture_of(0, input).expect_err("none").to_string();
        assert_eq!(
            told("sheen"),
            r#""wall" has no texture of "sheen"; it has those of base-colour, roughness"#
        );
        assert!(
            told("colour").starts_with(r#"materials have no input "colour" with a texture; they have base-"#)
        );
        let plain = Scene::new(TriangleMesh::default(), vec![Material::matte("door", Vec3::ONE)]);
        let error = plain.texture_of(0, "normal").expect_err("none").to_string();
        assert_eq!(error, r#""door" has no texture of "normal"; it has none at all"#);
    }

    #[test]
    fn hashes_are_of_texels_filter_and_transform() {
        let scene = scene();
        let bound = |change: fn(&mut Texture)| {
            let mut texture = checks(64);
            change(&mut texture);
            BoundTexture::new(texture).hash()
        };
        let plain = bound(|_| {});
        assert_eq!(plain, bound(|texture| texture.name = "other".into()));
        assert_ne!(plain, bound(|texture| texture.wrap_u = Wrap::Repeat));
        assert_ne!(plain, bound(|texture| texture.space = ColourSpace::Linear));
        assert_ne!(plain, bound(|texture| texture.texels = vec![[0; 4]; 64 * 64].into()));
        let turned = BoundTexture::of_scene(&scene, scene.texture_of(0, "base-colour").expect("one"));
        assert_ne!(plain, turned.hash());
    }
}
