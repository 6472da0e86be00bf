//! Surfaces that materials have themselves, from which surfaces of user code may start.

use super::{
    Colour, FINISH_FIELDS, Finish, Material, PointSink, Points, Principled, Scalar, Scene, Surface,
    Transmission, lookup,
};
use crate::lanes::{Int, Lanes, MAX_LANES, Mask, Num, SingleLane, Vector};

/// The surface that a material has itself, as metallic-roughness. A procedural surface in its place starts from its
/// finish ([`Points::base`]). Dispersion and coats over the clear coat are no part of it.
#[derive(Clone, Debug, PartialEq)]
pub struct OwnSurface {
    surface: Principled,
    /// True if the coats do not share the material's normals.
    has_own_coat: bool,
    /// True if a normal map roughens the surface where it is seen from afar.
    has_bumps: bool,
}

impl OwnSurface {
    /// The surface of a material. `None` if it is a mix, or has a surface of user code.
    pub fn of(material: &Material) -> Option<Self> {
        let surface = match material.surface {
            Surface::Dielectric { ior, transmittance } => {
                Principled::glass(ior.max(1.0), transmittance, Scalar::constant(0.0))
            }
            _ => material.principled()?,
        };
        let has_own_coat = surface.has_own_coat(material.normal_map.as_ref());
        Some(Self { surface, has_own_coat, has_bumps: material.normal_map.is_some() })
    }

    /// The surface.
    #[inline]
    pub fn surface(&self) -> &Principled {
        &self.surface
    }

    /// The way in which it transmits light.
    pub fn transmission(&self) -> Option<Transmission> {
        match self.surface.transmission.factor != 0.0 {
            false => None,
            true if self.surface.thin => Some(Transmission::ThinWall),
            true => Some(Transmission::Body { ior: self.surface.ior.max(1.0) }),
        }
    }

    /// The finish at points. Emission, opacity and normal are those of a surface that has none of its own.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn finish<L: Lanes>(&self, points: &Points<'_, L>) -> Finish<L> {
        let (surface, scene, at) = (&self.surface, points.scene, &points.own_texture_point());
        let l = points.lanes();
        let [metallic, mut roughness] = lookup::shares(scene, [&surface.metallic, &surface.roughness], at);
        if let Some(glossiness) = &surface.glossiness {
            roughness = 1.0 - lookup::share(scene, glossiness, at);
        }
        let ior = surface.ior.max(1.0);
        let f0 = (ior - 1.0) / (ior + 1.0);
        let mut coat = lookup::share(scene, &surface.clearcoat_roughness, at);
        if !self.has_own_coat {
            coat = at.footprint.roughened(coat);
        }
        let mut finish = Finish {
            colour: lookup::albedo(scene, &surface.base_colour, at),
            metallic,
            roughness: at.footprint.roughened(roughness),
            specular: lookup::share(scene, &surface.specular, at),
            specular_tint: lookup::colour(scene, &surface.specular_colour, at),
            reflectance: Num::splat(l, f0 * f0),
            transmission: lookup::share(scene, &surface.transmission, at),
            clearcoat: lookup::share(scene, &surface.clearcoat, at),
            clearcoat_roughness: coat,
            ..Finish::matte(points)
        };
        if let Some(anisotropy) = &surface.anisotropy {
            finish.anisotropy = lookup::share(scene, &anisotropy.strength, at);
        }
        if let Some(sheen) = &surface.sheen {
            finish.sheen = lookup::albedo(scene, &sheen.colour, at);
            finish.sheen_roughness = lookup::share(scene, &sheen.roughness, at);
        }
        if let Some(film) = &surface.iridescence {
            finish.film = lookup::share(scene, &film.strength, at);
            finish.film_thickness = lookup::film_thickness(scene, film, at);
            finish.film_ior = Num::splat(l, film.ior);
        }
        if let Some(through) = &surface.diffuse_transmission {
            finish.diffuse_transmission = lookup::share(scene, &through.share, at);
            finish.diffuse_transmission_colour = lookup::albedo(scene, &through.colour, at);
        }
        finish
    }

    /// For each scalar of the finish its value, if that is the same at all points.
    pub fn constants(&self) -> Vec<Option<f32>> {
        let even = Self { surface: without_textures(self.surface), ..self.clone() };
        let scene = Scene::default();
        let (l, zero) = (SingleLane, Num::zero(SingleLane));
        let up = Vector::new(zero, zero, Num::splat(l, 1.0));
        let finish = even.finish(&Points {
            position: Vector::zero(l),
            normal: up,
            geometric_normal: up,
            wo: up,
            uv: [zero; 2],
            barycentric: [zero; 2],
            width: zero,
            area: zero,
            primitive: Int::splat(l, 0),
            front: Mask::splat(l, true),
            bumps: zero,
            scene: &scene,
            own: None,
        });
        let mut numbers = Numbers(Vec::new());
        finish.write_to(0, &mut numbers);
        let mut numbers = numbers.0.into_iter();
        let fields = FINISH_FIELDS.iter().flat_map(|field| {
            let differs = self.differs(field.name);
            std::iter::repeat_n(differs, field.kind.numbers())
        });
        fields.map(|differs| numbers.next().filter(|_| !differs)).collect()
    }

    /// True if a field of the finish may differ from point to point.
    fn differs(&self, field: &str) -> bool {
        let Principled { sheen, iridescence, anisotropy, diffuse_transmission, glossiness, .. } =
            &self.surface;
        let surface = &self.surface;
        let scalar = |scalar: &Scalar| scalar.texture.is_some();
        let colour = |colour: &Colour| !colour.is_constant();
        match field {
            "colour" => colour(&surface.base_colour),
            "metallic" => scalar(&surface.metallic),
            "roughness" => self.has_bumps || scalar(glossiness.as_ref().unwrap_or(&surface.roughness)),
            "clearcoat" => scalar(&surface.clearcoat),
            "clearcoat_roughness" => self.has_bumps || scalar(&surface.clearcoat_roughness),
            "transmission" => scalar(&surface.transmission),
            "specular" => scalar(&surface.specular),
            "specular_tint" => colour(&surface.specular_colour),
            "anisotropy" => anisotropy.is_some_and(|of| scalar(&of.strength)),
            "sheen" => sheen.is_some_and(|of| colour(&of.colour)),
            "sheen_roughness" => sheen.is_some_and(|of| scalar(&of.roughness)),
            "film" => iridescence.is_some_and(|of| scalar(&of.strength)),
            "film_thickness" => iridescence.is_some_and(|of| of.thickness_texture.is_some()),
            "diffuse_transmission" => diffuse_transmission.is_some_and(|of| scalar(&of.share)),
            "diffuse_transmission_colour" => diffuse_transmission.is_some_and(|of| colour(&of.colour)),
            "normal" => true,
            _ => false,
        }
    }
}

/// The numbers of a finish at one point.
struct Numbers(Vec<f32>);

impl PointSink for Numbers {
    fn put(&mut self, _: usize, column: &[f32; MAX_LANES]) {
        self.0.push(column[0]);
    }
}

/// A surface whose inputs are their factors alone.
fn without_textures(mut surface: Principled) -> Principled {
    let plain = |scalar: &mut Scalar| scalar.texture = None;
    let even = |colour: &mut Colour| *colour = Colour::constant(colour.factor);
    for scalar in [
        &mut surface.metallic,
        &mut surface.roughness,
        &mut surface.specular,
        &mut surface.transmission,
        &mut surface.clearcoat,
        &mut surface.clearcoat_roughness,
    ] {
        plain(scalar);
    }
    even(&mut surface.base_colour);
    even(&mut surface.specular_colour);
    surface.glossiness.as_mut().into_iter().for_each(plain);
    surface.anisotropy.as_mut().into_iter().for_each(|of| plain(&mut of.strength));
    if let Some(of) = &mut surface.sheen {
        even(&mut of.colour);
        plain(&mut of.roughness);
    }
    if let Some(of) = &mut surface.iridescence {
        plain(&mut of.strength);
        of.thickness_texture = None;
    }
    if let Some(of) = &mut surface.diffuse_transmission {
        plain(&mut of.share);
        even(&mut of.colour);
    }
    surface
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Channel, TextureRef};
    use glam::Vec3;

    #[test]
    fn even_inputs_are_known_and_others_are_not() {
        let mut stone = Material::matte("stone", Vec3::new(0.25, 0.5, 0.75));
        let names = FINISH_FIELDS.iter().flat_map(|field| (0..field.kind.numbers()).map(|i| (field.name, i)));
        let names: Vec<_> = names.collect();
        let known = |material: &Material, name: &str| {
            let constants = OwnSurface::of(material).expect("a surface").constants();
            assert_eq!(constants.len(), names.len());
            let at = names.iter().position(|(other, _)| *other == name).expect(name);
            constants[at]
        };
        assert_eq!((known(&stone, "colour"), known(&stone, "specular")), (Some(0.25), Some(0.0)));
        assert_eq!((known(&stone, "normal"), known(&stone, "opacity")), (None, Some(1.0)));
        let image = TextureRef::plain(0);
        stone.surface = Surface::Principled(Principled {
            base_colour: Colour { texture: Some(image), ..Colour::constant(Vec3::ONE) },
            roughness: Scalar { factor: 0.5, texture: Some((image, Channel::G)) },
            ior: 2.0,
            ..Principled::default()
        });
        assert_eq!((known(&stone, "colour"), known(&stone, "roughness")), (None, None));
        assert_eq!((known(&stone, "metallic"), known(&stone, "sheen")), (Some(0.0), Some(0.0)));
        assert!((known(&stone, "reflectance").expect("even") - 1.0 / 9.0).abs() < 1e-6);
        stone.surface = Surface::Mix(0);
        assert_eq!(OwnSurface::of(&stone), None);
    }
}
