//! Lights as a tape: few, many, and an image all around.

use super::{Given, Shading, Words, compare, materials};
use crate::lanes::Lanes;
use crate::scene::{Colour, Emission, Environment, EnvironmentMap, Light, LightShape, Material, Scene};
use crate::shade::light::Receiver;
use crate::shade::{Interaction, LightSample, Lights};
use glam::Vec3;

/// What reaches a hit from the lights of a scene: samples, their rays, the sky, densities.
struct Lighting<'a> {
    name: &'a str,
    scene: &'a Scene,
    lights: Lights,
}

impl<L: Lanes> Words<L> {
    /// The fields of a sample mean nothing where it is not valid.
    fn light(&mut self, at: &Interaction<L>, sample: &LightSample<L>) {
        let LightSample { valid, wi, target, near, radiance, pdf, delta } = *sample;
        [valid, near & valid, delta & valid].into_iter().for_each(|mask| self.mask(mask));
        [wi, target.only(near), radiance].into_iter().for_each(|v| self.vector(v.only(valid)));
        self.numbers(&[pdf.only(valid)]);
        let (origin, direction, t_max) = sample.rays(at);
        [origin, direction].into_iter().for_each(|v| self.vector(v.only(valid)));
        self.numbers(&[t_max.only(valid)]);
    }
}

impl Shading for Lighting<'_> {
    fn name(&self) -> &str {
        self.name
    }

    fn triangles(&self) -> usize {
        self.scene.mesh.triangles.len()
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn words<L: Lanes>(&self, given: &Given<L>) -> Words<L> {
        let Self { scene, lights, .. } = self;
        let Given { direction, hits, width, wi, u, u2 } = given;
        let at = Interaction::new(scene, &Material::fallback(), *direction, hits, *width);
        let (receiver, mut words) = (Receiver::of(&at), Words(Vec::new()));
        words.light(&at, &lights.sample(scene, &receiver, Some(*u), *u2));
        words.light(&at, &lights.sample(scene, &receiver.two_sided(), None, *u2));
        words.light(&at, &lights.sample_surfaces(scene, &receiver, *u, *u2));
        words.light(&at, &lights.sample_punctual(&receiver, *u));
        let (radiance, pdf) = lights.sky(at.basis.world(*wi));
        words.vector(radiance);
        words.numbers(&[pdf, lights.pdf_emitter(&receiver, hits.primitive, hits.t, wi.z)]);
        words
    }
}

/// A scene whose triangles shine, some on both sides, and `count` lamps of each kind.
fn lit(count: usize) -> Scene {
    let mut scene = materials::scene();
    let shining = |radiance: [f32; 3], two_sided| {
        let radiance = Colour::constant(radiance.into());
        Material { emission: Some(Emission { radiance, two_sided, is_light: true }), ..Material::fallback() }
    };
    scene.materials =
        vec![Material::fallback(), shining([3.0, 2.0, 1.0], false), shining([0.5, 4.0, 9.0], true)];
    let few = scene.mesh.triangles.clone();
    scene.mesh.triangles = few.iter().copied().cycle().take(few.len() * count).collect();
    scene.mesh.materials = (0..scene.mesh.triangles.len() as u32).map(|i| i % 3).collect();
    for i in 0..count {
        let place = Vec3::new(i as f32 - 2.0, 1.5, (i % 3) as f32 - 1.0);
        let direction = Vec3::new(0.3, -0.8, 0.1 * i as f32).normalize();
        let shapes = [
            LightShape::Point { position: place },
            LightShape::Directional { direction },
            LightShape::Spot { position: -place, direction, cos_inner: 0.9, cos_outer: 0.2 },
        ];
        let light = |shape| Light { name: String::new(), intensity: Vec3::new(1.0, 2.0, 0.5), shape };
        scene.lights.extend(shapes.map(light));
    }
    scene.environment = Environment::Constant(Vec3::new(0.1, 0.2, 0.3));
    scene
}

/// The scene under an image.
fn under_an_image() -> Scene {
    let (width, height) = (7, 5);
    let texel = |i: u32| [i % 3, i * i % 11, i % 7].map(|x| x as f32 * 0.3);
    let texels = (0..width * height).map(texel).collect();
    let map = EnvironmentMap { texels, width, height, rotation_degrees: 40.0 };
    Scene { environment: Environment::Map(map), ..lit(1) }
}

#[test]
fn recorded_lights_have_the_bits_of_native_ones() {
    let scenes = [("few lights", lit(1)), ("many lights", lit(12)), ("an image", under_an_image())];
    for (seed, (name, scene)) in (500..).zip(&scenes) {
        let lights = Lights::new(scene);
        assert_eq!(lights.are_many(), *name == "many lights");
        let operations = compare(&Lighting { name, scene, lights }, seed << 16);
        assert!(operations > 500, "{name}: {operations} operations");
    }
}
