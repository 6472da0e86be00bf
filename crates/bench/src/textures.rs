//! `raystream bench textures`: the cost of texturing (RTRT section 5). The same frame with the means of its textures,
//! with the textures themselves, and with their mipmaps, in one process, in interleaved rounds.

use super::Spread;
use super::frame::FrameError;
use glam::Vec3;
use raystream::engine::PreparedScene;
use raystream::lanes::{Num, SingleLane};
use raystream::render::{PathTracer, Settings};
use raystream::scene::{
    Anisotropy, Camera, Colour, DiffuseTransmission, Emission, Footprint, Iridescence, Mipmap, OpenPbr,
    OpenPbrCoat, OpenPbrFuzz, OpenPbrSubsurface, Principled, Scalar, Scene, Sheen, Surface, Texture,
    TextureRef,
};
use raystream::schedule::{JobOptions, Service, TaskKind};
use serde::Serialize;
use std::sync::Arc;
use std::time::Instant;

/// The frame, and how often it is rendered.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Size, samples, depth and seed of the frame. Paths end by depth alone, so that the number of rays does not depend
    /// on colours.
    pub settings: Settings,
    /// The camera.
    pub camera: Camera,
    /// Rounds.
    pub rounds: usize,
}

/// Results of one way of texturing.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The way of texturing.
    pub configuration: &'static str,
    /// Host threads.
    pub threads: usize,
    /// Bytes of texels.
    pub texel_bytes: usize,
    /// Rays of the frame.
    pub rays: u64,
    /// Seconds of the frame.
    pub seconds: Spread,
    /// Nanoseconds of the frame for each ray.
    pub ns_per_ray: Spread,
    /// Thread time of shade tasks for each ray, in nanoseconds.
    pub shade_ns_per_ray: Spread,
    /// Median of `ns_per_ray` divided by the first row's.
    pub ratio: f64,
}

/// A prepared scene and the service that renders it.
#[derive(Debug, Clone, Copy)]
pub struct Bench<'a> {
    /// The scene with its tree and tracers.
    pub prepared: &'a PreparedScene,
    /// The threads.
    pub service: &'a Service,
    /// The frame.
    pub options: Options,
}

impl Bench<'_> {
    /// Measures all three ways.
    ///
    /// # Errors
    /// When a frame cannot be rendered.
    pub fn run(&self) -> Result<Vec<Row>, FrameError> {
        let scene = &self.prepared.scene;
        let texels = |scene: &Scene| scene.textures.iter().map(|t| 4 * t.texels.len()).sum::<usize>();
        let images = scene.textures.iter().map(|t| 4 * t.image().len()).sum();
        let ways = [
            ("the textures' means", Arc::new(constant(scene)), 0),
            ("textures", Arc::new(plain(scene)), images),
            ("textures with mipmaps", Arc::clone(scene), texels(scene)),
        ];
        let mut rounds = ways.each_ref().map(|_| Vec::new());
        let mut rays = [0; 3];
        for round in 0..=self.options.rounds {
            for (((_, scene, _), rounds), rays) in ways.iter().zip(&mut rounds).zip(&mut rays) {
                let measured = self.frame(scene)?;
                *rays = measured.rays;
                // The first round warms caches and allocates streams.
                if round > 0 {
                    rounds.push(measured);
                }
            }
        }
        let mut rows: Vec<Row> = Vec::new();
        for (((configuration, _, texel_bytes), measured), rays) in ways.iter().zip(rounds).zip(rays) {
            let spread = |of: &dyn Fn(&Measured) -> f64| Spread::of_times(measured.iter().map(of).collect());
            let ns_per_ray = spread(&|m| m.seconds * 1e9 / m.rays as f64);
            rows.push(Row {
                configuration,
                threads: self.service.host_threads(),
                texel_bytes: *texel_bytes,
                rays,
                seconds: spread(&|m| m.seconds),
                ns_per_ray,
                shade_ns_per_ray: spread(&|m| m.shade_s * 1e9 / m.rays as f64),
                ratio: ns_per_ray.median
                    / rows.first().map_or(ns_per_ray.median, |row| row.ns_per_ray.median),
            });
        }
        Ok(rows)
    }

    fn frame(&self, scene: &Arc<Scene>) -> Result<Measured, FrameError> {
        let Options { settings, camera, .. } = self.options;
        let path = Arc::new(PathTracer::new(Arc::clone(scene), &camera, settings, None)?);
        let options = JobOptions::default().with_timeline(true);
        let started = Instant::now();
        let report = self.service.submit(path, self.prepared.tracers.clone(), options)?.wait();
        let seconds = started.elapsed().as_secs_f64();
        let report = report.map_err(|error| FrameError::Job { configuration: "a frame", error })?;
        let shading = report.timeline.iter().filter(|task| task.kind == TaskKind::Shade);
        let shade_ns: u64 = shading.map(|task| task.end_ns - task.start_ns).sum();
        Ok(Measured { seconds, shade_s: shade_ns as f64 * 1e-9, rays: report.rays.total() })
    }
}

/// Measurements of one frame.
struct Measured {
    seconds: f64,
    shade_s: f64,
    rays: u64,
}

/// The scene without mipmaps.
fn plain(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    for texture in &mut scene.textures {
        texture.mipmap = Mipmap::default();
    }
    scene
}

/// The scene with the means of its textures and without normal maps. Alpha is kept, because it decides where rays
/// end.
fn constant(scene: &Scene) -> Scene {
    let (mut even, means) = (scene.clone(), Means { scene });
    for mix in &mut even.mixes {
        mix.share = means.scalar(mix.share);
    }
    for material in &mut even.materials {
        material.normal_map = None;
        material.emission =
            material.emission.map(|of| Emission { radiance: means.colour(of.radiance), ..of });
        match &mut material.surface {
            Surface::Matte { reflectance } | Surface::Mirror { reflectance } => {
                *reflectance = means.colour(*reflectance);
            }
            Surface::Principled(of) => *of = means.principled(*of),
            Surface::OpenPbr(of) => *of = means.openpbr(*of),
            _ => {}
        }
    }
    even
}

/// Parameters with the means of their textures.
struct Means<'a> {
    scene: &'a Scene,
}

impl Means<'_> {
    fn colour(&self, of: Colour) -> Colour {
        Colour::constant(of.factor * of.texture.map_or(Vec3::ONE, |texture| mean(self.scene, texture)))
    }

    fn scalar(&self, of: Scalar) -> Scalar {
        let texel = of.texture.map_or(1.0, |(texture, channel)| {
            let texture = &self.scene.textures[texture.texture as usize];
            texture.channel(channel, MIDDLE.map(Num::from), &everything()).get()
        });
        Scalar::constant(of.factor * texel)
    }

    fn film(&self, of: Iridescence) -> Iridescence {
        let [thin, thick] = of.thickness_nm;
        let share = self.scalar(Scalar { factor: 1.0, texture: of.thickness_texture }).factor;
        let thickness_nm = [thin + (thick - thin) * share; 2];
        Iridescence { strength: self.scalar(of.strength), thickness_nm, thickness_texture: None, ..of }
    }

    fn anisotropy(&self, of: Anisotropy) -> Anisotropy {
        Anisotropy { strength: self.scalar(of.strength), direction: None, ..of }
    }

    fn principled(&self, of: Principled) -> Principled {
        let sheen =
            |of: Sheen| Sheen { colour: self.colour(of.colour), roughness: self.scalar(of.roughness) };
        Principled {
            base_colour: self.colour(of.base_colour),
            metallic: self.scalar(of.metallic),
            roughness: self.scalar(of.roughness),
            transmission: self.scalar(of.transmission),
            clearcoat: self.scalar(of.clearcoat),
            clearcoat_roughness: self.scalar(of.clearcoat_roughness),
            coat_normal_map: None,
            specular: self.scalar(of.specular),
            specular_colour: self.colour(of.specular_colour),
            anisotropy: of.anisotropy.map(|of| self.anisotropy(of)),
            sheen: of.sheen.map(sheen),
            iridescence: of.iridescence.map(|of| self.film(of)),
            glossiness: of.glossiness.map(|of| self.scalar(of)),
            diffuse_transmission: of.diffuse_transmission.map(|of| DiffuseTransmission {
                share: self.scalar(of.share),
                colour: self.colour(of.colour),
            }),
            ..of
        }
    }

    fn openpbr(&self, of: OpenPbr) -> OpenPbr {
        let coat = |of: OpenPbrCoat| OpenPbrCoat {
            weight: self.scalar(of.weight),
            color: self.colour(of.color),
            roughness: self.scalar(of.roughness),
            anisotropy: self.scalar(of.anisotropy),
            ..of
        };
        let fuzz = |of: OpenPbrFuzz| OpenPbrFuzz {
            weight: self.scalar(of.weight),
            color: self.colour(of.color),
            roughness: self.scalar(of.roughness),
        };
        let subsurface = |of: OpenPbrSubsurface| OpenPbrSubsurface { weight: self.scalar(of.weight), ..of };
        OpenPbr {
            base_weight: self.scalar(of.base_weight),
            base_color: self.colour(of.base_color),
            base_diffuse_roughness: self.scalar(of.base_diffuse_roughness),
            base_metalness: self.scalar(of.base_metalness),
            specular_weight: self.scalar(of.specular_weight),
            specular_color: self.colour(of.specular_color),
            specular_roughness: self.scalar(of.specular_roughness),
            specular_anisotropy: of.specular_anisotropy.map(|of| self.anisotropy(of)),
            transmission_weight: self.scalar(of.transmission_weight),
            transmission_color: self.colour(of.transmission_color),
            subsurface: of.subsurface.map(subsurface),
            coat: of.coat.map(coat),
            fuzz: of.fuzz.map(fuzz),
            thin_film: of.thin_film.map(|of| self.film(of)),
            ..of
        }
    }
}

const MIDDLE: [f32; 2] = [0.5; 2];

/// A footprint that covers all of any texture.
fn everything() -> Footprint<SingleLane> {
    Footprint { width: f32::MAX.into(), ..Footprint::point(SingleLane) }
}

fn mean(scene: &Scene, texture: TextureRef) -> Vec3 {
    let texture: &Texture = &scene.textures[texture.texture as usize];
    let [r, g, b, _] = texture.look_up(MIDDLE.map(Num::from), &everything()).map(Num::get);
    Vec3::new(r, g, b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use raystream::scene::{Channel, ColourSpace, Material, NormalMap, Wrap};

    #[test]
    fn constants_are_the_textures_means() {
        let mut scene = Scene::default();
        scene.textures.push(Texture {
            name: String::new(),
            width: 2,
            height: 1,
            texels: [[255, 0, 100, 255], [0, 0, 100, 255]].into(),
            space: ColourSpace::Linear,
            wrap_u: Wrap::Repeat,
            wrap_v: Wrap::Repeat,
            mipmap: Mipmap::default(),
        });
        let texture = TextureRef::plain(0);
        let surface = Principled {
            base_colour: Colour { texture: Some(texture), ..Colour::constant(Vec3::splat(0.5)) },
            roughness: Scalar { factor: 1.0, texture: Some((texture, Channel::B)) },
            ..Principled::default()
        };
        scene.materials.push(Material { surface: Surface::Principled(surface), ..Material::fallback() });
        scene.add_mipmaps();
        let map = Some(NormalMap { texture, scale: 1.0 });
        scene.materials[0].normal_map = map;
        let even = constant(&scene);
        assert_eq!(even.materials[0].normal_map, None);
        let Surface::Principled(of) = even.materials[0].surface else { panic!("still principled") };
        assert_eq!((of.base_colour.texture, of.roughness.texture), (None, None));
        assert!((of.base_colour.factor - Vec3::new(0.251, 0.0, 0.196)).abs().max_element() < 1e-3);
        assert!((of.roughness.factor - 100.0 / 255.0).abs() < 1e-6);
    }
}
