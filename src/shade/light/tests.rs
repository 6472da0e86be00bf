//! Light sampling returns the densities that its samples have, and the right irradiance.

use super::{AliasTable, EnvironmentLight, Lights, Receiver};
use crate::geom::{Sampler, warp};
use crate::lanes::{Int, LaneTask, Lanes, Num, SimdLevel, SingleLane, Vector};
use crate::scene::{
    Channel, Colour, ColourSpace, Emission, Environment, EnvironmentMap, Footprint, Light, LightShape,
    Material, Mipmap, Scene, Texture, TextureRef, Wrap,
};
use crate::shade::single::{self, LightSample};
use crate::stream::Ray;
use glam::Vec3;
use std::f32::consts::PI;

mod opacity;

fn look(light: &EnvironmentLight, direction: Vec3) -> (Vec3, f32) {
    let (radiance, pdf) = light.evaluate(Vector::from(direction));
    (radiance.into(), pdf.get())
}

fn receiver(from: Vec3, normal: Vec3) -> Receiver<SingleLane> {
    Receiver::new(from.into(), normal.into())
}

fn pdf_emitter(
    lights: &Lights,
    to: &Receiver<SingleLane>,
    primitive: u32,
    distance2: f32,
    cosine: f32,
) -> f32 {
    lights.pdf_emitter(to, Int::from(primitive), distance2.into(), cosine.into()).get()
}

fn map(width: u32, height: u32, texel: impl Fn(u32, u32) -> Vec3) -> EnvironmentMap {
    let texels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    EnvironmentMap {
        width,
        height,
        texels: texels.map(|(x, y)| texel(x, y).to_array()).collect(),
        rotation_degrees: 0.0,
    }
}

/// A dim sky with a sun, a black half and some noise.
fn outdoor() -> EnvironmentMap {
    map(32, 16, |x, y| match (x, y) {
        (20, 3) => Vec3::splat(5000.0),
        (_, 8..) => Vec3::ZERO,
        _ => Vec3::new(0.3, 0.4, 0.5 + (x * 7 % 5) as f32),
    })
}

#[test]
fn the_image_lies_around_the_scene_as_documented() {
    let image = map(8, 4, |x, y| Vec3::new(x as f32, y as f32, 0.0));
    let at = |rotation_degrees: f32, direction: Vec3| {
        let image = EnvironmentMap { rotation_degrees, ..image.clone() };
        look(&EnvironmentLight::new(&Environment::Map(image)), direction.normalize()).0
    };
    assert_eq!(at(0.0, Vec3::Y).y, 0.0, "row 0 looks up");
    assert_eq!(at(0.0, Vec3::NEG_Y).y, 3.0);
    assert!((at(0.0, Vec3::NEG_Z).x - 3.5).abs() < 1e-4, "the middle faces -z");
    assert!((at(0.0, Vec3::X).x - 5.5).abs() < 1e-4, "columns go to the right");
    assert!((at(90.0, Vec3::NEG_X).x - 3.5).abs() < 1e-4, "the former middle is to the left");
}

#[test]
fn the_environment_is_sampled_by_its_density() {
    for environment in [
        Environment::Map(outdoor()),
        Environment::Map(EnvironmentMap { rotation_degrees: 77.0, ..outdoor() }),
        Environment::Map(map(1, 1, |_, _| Vec3::ONE)),
        Environment::Map(map(3, 2, |x, _| Vec3::splat(x as f32))),
        Environment::Constant(Vec3::new(1.0, 2.0, 0.5)),
    ] {
        let light = EnvironmentLight::new(&environment);
        let n = 1 << 16;
        // The integral of the radiance, by uniform directions and by the environment's own samples.
        let (mut even, mut own, mut density) = (Vec3::ZERO, Vec3::ZERO, 0.0);
        for i in 0..n {
            let u2 = Sampler::new(3, i, 0).pair(0);
            let direction = warp::sphere(u2);
            even += look(&light, direction).0 * (4.0 * PI / n as f32);
            density += look(&light, direction).1 * (4.0 * PI / n as f32);
            let (wi, radiance, pdf) = light.sample(u2.map(Num::from));
            let (wi, radiance, pdf) = (Vec3::from(wi), Vec3::from(radiance), pdf.get());
            assert!(pdf > 0.0);
            assert!((wi.length() - 1.0).abs() < 1e-5);
            assert_eq!((radiance, pdf), look(&light, wi));
            own += radiance / (pdf * n as f32);
        }
        assert!((density - 1.0).abs() < 0.02, "the density integrates to {density}");
        let off = ((even - own) / even).abs().max_element();
        assert!(off < 0.02, "{even} and {own}");
        let mean = lookup_luminance(even) / (4.0 * PI);
        assert!((mean / light.mean() - 1.0).abs() < 0.02, "{mean} and {}", light.mean());
    }
}

fn lookup_luminance(colour: Vec3) -> f32 {
    crate::shade::lookup::luminance(colour)
}

#[test]
fn no_sample_of_the_environment_is_much_brighter_than_its_density() {
    // The bilinear rim of the sun must not be sampled like the dim texels that it covers. In the corner cell
    // beside a bright texel, the lookup reaches 16 times its mean.
    let light = EnvironmentLight::new(&Environment::Map(outdoor()));
    for i in 0..20_000 {
        let (_, radiance, pdf) = light.sample(Sampler::new(1, i, 9).pair(0).map(Num::from));
        let pdf = pdf.get();
        assert!(pdf > 0.0 && lookup_luminance(radiance.into()) / pdf < 20.0 * 4.0 * PI * light.mean());
    }
}

#[test]
fn a_black_environment_is_never_sampled() {
    let scene = Scene { environment: Environment::Map(map(4, 2, |_, _| Vec3::ZERO)), ..Scene::default() };
    let lights = Lights::new(&scene);
    assert!((0..100).all(|i| {
        let s = Sampler::new(0, i, 0);
        LightSample::any(&lights, &scene, &receiver(Vec3::ZERO, Vec3::Y), s.single(0), s.pair(0)).is_none()
    }));
    assert_eq!(single::sky(&lights, Vec3::Y).1, 0.0);
}

/// Adds a square of side 2 at height `y`, with the given material and its front facing down.
fn add_square(scene: &mut Scene, y: f32, material: Material) {
    let base = scene.mesh.positions.len() as u32;
    for (x, z) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
        scene.mesh.positions.push(Vec3::new(x, y, z));
        scene.mesh.uvs.push(glam::Vec2::new(0.5 + 0.5 * x, 0.5 + 0.5 * z));
    }
    scene.mesh.triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
    scene.mesh.materials.extend([scene.materials.len() as u32; 2]);
    scene.materials.push(material);
}

fn shining(radiance: Colour, two_sided: bool) -> Material {
    Material {
        emission: Some(Emission { radiance, two_sided, is_light: true }),
        ..Material::matte("lamp", Vec3::ZERO)
    }
}

fn everything() -> Scene {
    let mut scene = Scene { environment: Environment::Map(outdoor()), ..Scene::default() };
    add_square(&mut scene, 1.0, shining(Colour::constant(Vec3::new(3.0, 2.0, 1.0)), false));
    add_square(&mut scene, -2.0, Material::fallback());
    let checks = Texture {
        name: "checks".into(),
        width: 2,
        height: 1,
        texels: [[255, 255, 255, 255], [0, 0, 0, 255]].into(),
        space: ColourSpace::Linear,
        wrap_u: Wrap::Clamp,
        wrap_v: Wrap::Clamp,
        mipmap: Mipmap::default(),
    };
    scene.textures.push(checks);
    let texture = Some(TextureRef::plain(0));
    add_square(&mut scene, -3.0, shining(Colour { texture, ..Colour::constant(Vec3::splat(5.0)) }, true));
    scene.lights.push(Light {
        name: String::new(),
        intensity: Vec3::splat(2.0),
        shape: LightShape::Point { position: Vec3::new(3.0, 3.0, 0.0) },
    });
    scene
}

/// Irradiance at `from` on a surface that faces up, by light sampling without occlusion.
fn irradiance(scene: &Scene, from: Vec3, samples: u32) -> Vec3 {
    let lights = Lights::new(scene);
    let sum: Vec3 = (0..samples)
        .filter_map(|i| {
            let s = Sampler::new(2, i, 5);
            let light = LightSample::any(&lights, scene, &receiver(from, Vec3::Y), s.single(0), s.pair(1))?;
            Some(light.radiance * (light.wi.y.max(0.0) / light.pdf))
        })
        .sum();
    sum / samples as f32
}

#[test]
fn emissive_triangles_give_the_irradiance_of_their_form_factor() {
    let mut scene = Scene::default();
    add_square(&mut scene, 1.0, shining(Colour::constant(Vec3::new(3.0, 2.0, 1.0)), false));
    // A square of half side 1 at distance 1, seen from below its centre: the sum of four corner form factors.
    let corner = {
        let side = 1.0 / 2.0f32.sqrt();
        2.0 / (2.0 * PI) * side * libm::atanf(side)
    };
    let expected = Vec3::new(3.0, 2.0, 1.0) * (PI * 4.0 * corner);
    let found = irradiance(&scene, Vec3::ZERO, 1 << 13);
    assert!(((found - expected) / expected).abs().max_element() < 0.01, "{found} for {expected}");
    // The back, seen from above, is dark.
    assert_eq!(irradiance(&scene, Vec3::Y * 2.0, 512), Vec3::ZERO);
}

#[test]
fn punctual_lights_obey_the_inverse_square_and_their_cone() {
    let lit = |shape| {
        let intensity = Vec3::new(8.0, 4.0, 2.0);
        let light = Light { name: String::new(), intensity, shape };
        Lights::new(&Scene { lights: vec![light], ..Scene::default() })
    };
    let at = |shape, from| LightSample::of_light(&lit(shape), 0, from);
    let point = at(LightShape::Point { position: Vec3::Y * 2.0 }, Vec3::ZERO).expect("shines");
    assert_eq!((point.wi, point.radiance), (Vec3::Y, Vec3::new(2.0, 1.0, 0.5)));
    let spot = |x: f32| {
        let shape = LightShape::Spot {
            position: Vec3::new(x, 1.0, 0.0),
            direction: Vec3::NEG_Y,
            cos_inner: 0.9,
            cos_outer: 0.6,
        };
        at(shape, Vec3::ZERO)
    };
    assert_eq!(spot(0.0).expect("in the middle").radiance.x, 8.0);
    assert!(spot(2.0).is_none(), "outside of the cone");
    let x = (1.0f32 / 0.75 / 0.75 - 1.0).sqrt();
    let edge = spot(x).expect("half way between the angles").radiance.x;
    assert!((edge - 8.0 * 0.75 * 0.75 * 0.25).abs() < 1e-4);
    let sun = at(LightShape::Directional { direction: Vec3::NEG_Y }, Vec3::splat(7.0));
    let sun = sun.expect("shines everywhere");
    assert_eq!((sun.wi, sun.radiance, sun.target), (Vec3::Y, Vec3::new(8.0, 4.0, 2.0), None));
}

#[test]
fn pdf_emitter_agrees_with_the_density_of_samples() {
    let scene = everything();
    let lights = Lights::new(&scene);
    let tracer = crate::trace::cpu::CpuTracer::new(
        std::sync::Arc::new(crate::bvh::Bvh::build(&scene.mesh.positions, &scene.mesh.triangles, |_| false)),
        None,
        crate::trace::cpu::SimdLevel::detect(),
    )
    .expect("the detected level is available");
    let (mut kinds, from) = ([0u32; 3], Vec3::new(0.2, 0.1, -0.3));
    let lit = receiver(from, Vec3::Y);
    for i in 0..4000 {
        let s = Sampler::new(6, i, 2);
        let Some(light) = LightSample::any(&lights, &scene, &lit, s.single(0), s.pair(1)) else { continue };
        match (light.delta, light.target) {
            (true, _) => kinds[0] += 1,
            (false, None) => {
                kinds[1] += 1;
                assert_eq!(light.pdf, single::sky(&lights, light.wi).1);
            }
            (false, Some(_)) => {
                use crate::stream::{Hit, Tracer};
                let mut hits = [Hit::NONE];
                tracer.closest(&[Ray::new(from, light.wi)], &mut hits);
                let hit = hits[0];
                // The floor hides the textured lamp below it.
                if hit.is_miss() || scene.mesh.materials[hit.primitive as usize] != 0 {
                    continue;
                }
                kinds[2] += 1;
                let found = pdf_emitter(&lights, &lit, hit.primitive, hit.t * hit.t, light.wi.y);
                assert!((found / light.pdf - 1.0).abs() < 1e-3, "{found} and {}", light.pdf);
            }
        }
    }
    assert!(kinds.iter().all(|&k| k > 100), "every kind gets its share: {kinds:?}");
    assert_eq!(pdf_emitter(&lights, &lit, 2, 1.0, 1.0), 0.0, "the floor is no emitter");
}

#[test]
fn textured_emitters_count_where_they_shine() {
    let scene = everything();
    let lights = Lights::new(&scene);
    assert_eq!(lights.emitters().len(), 4);
    let below = receiver(Vec3::Y * -4.0, Vec3::Y);
    let mut sides = [0u32; 2];
    for i in 0..2000 {
        let s = Sampler::new(6, i, 2);
        if let Some(light) = LightSample::surface(&lights, &scene, &below, s.single(0), s.pair(1))
            && let Some(target) = light.target
            && target.y < -2.5
        {
            assert!(light.radiance.x > 0.0 && light.radiance.x <= 5.0);
            sides[usize::from(target.x > 0.5)] += 1;
        }
    }
    assert!(sides[0] > 200 && sides[1] == 0, "only the white half shines: {sides:?}");
    assert_eq!(
        scene.textures[0].channel(Channel::R, [0.9, 0.5].map(Num::from), &Footprint::point(SingleLane)).get(),
        0.0
    );
}

/// Squares of random brightness and position. Some emit upwards, some downwards, some to both sides.
fn thousands() -> Scene {
    let mut scene = Scene::default();
    for i in 0..700 {
        let s = Sampler::new(i, 0, 77);
        let brightness = Vec3::splat(libm::powf(10.0, 3.0 * s.single(0)));
        add_square(&mut scene, 0.0, shining(Colour::constant(brightness), i % 3 == 0));
        let place = Vec3::from(std::array::from_fn(|k| s.single(1 + k as u32) * 40.0 - 20.0));
        let turn = glam::Quat::from_axis_angle(warp::sphere(s.pair(5)), 3.0 * s.single(6));
        let corners = scene.mesh.positions.len() - 4;
        for corner in &mut scene.mesh.positions[corners..] {
            *corner = place + turn * (*corner * (0.1 + s.single(7)));
        }
    }
    scene
}

#[test]
fn lights_are_chosen_with_the_stated_probabilities() {
    let scene = thousands();
    let lights = Lights::new(&scene);
    let emitters = lights.emitters();
    assert_eq!(emitters.len(), 1400);
    for (from, normal) in [(Vec3::ZERO, Vec3::Y), (Vec3::splat(19.0), Vec3::NEG_X), (Vec3::X * 60.0, Vec3::Z)]
    {
        let to = receiver(from, normal);
        let stated: Vec<f32> = (0..1400).map(|p| emitters.probability(&to, Int::from(p)).get()).collect();
        let sum: f32 = stated.iter().sum();
        // A fork whose children both prove out of reach returns no light. A third of the samples may end so
        // if the horizon goes through the lights.
        assert!((0.5..1.0001).contains(&sum), "probabilities add up to {sum}");
        let n = 1 << 18;
        let mut counts = vec![0u32; 1400];
        for i in 0..n {
            let u = (i as f32 + 0.5) / n as f32;
            let (place, probability, _) = emitters.choose(&to, Num::from(u)).expect("there are emitters");
            assert_eq!(probability.get(), stated[place.get() as usize]);
            counts[place.get() as usize] += u32::from(probability.get() > 0.0);
        }
        // The samples are evenly spaced, so the counts are off only by rounding.
        for (&count, &stated) in counts.iter().zip(&stated) {
            assert!((count as f32 - stated * n as f32).abs() < 2.0 + 1e-3 * count as f32, "{count} {stated}");
        }
    }
}

#[test]
fn the_tree_finds_all_light() {
    // All light at a point on a wall, by the tree and by summing over all emitters.
    let scene = thousands();
    let normals = [Vec3::Y, Vec3::NEG_X, Vec3::new(0.6, 0.0, 0.8)];
    for (k, around) in (0..normals.len()).flat_map(|k| [(k, false), (k, true)]) {
        let (from, normal) = (Vec3::splat(k as f32 - 1.0), normals[k]);
        let n = 1 << 16;
        let lights = Lights::new(&scene);
        let to = among((from, normal, around));
        // Lit from one side, or from both through a frosted wall.
        let seen = |cosine: f32| if around { cosine.abs() } else { cosine.max(0.0) };
        let mut by_tree = 0.0;
        for i in 0..n {
            let s = Sampler::new(2, i, 5);
            if let Some(light) = LightSample::any(&lights, &scene, &to, s.single(0), s.pair(1)) {
                by_tree += light.radiance.x * seen(light.wi.dot(normal)) / light.pdf / n as f32;
            }
        }
        let mut all = 0.0;
        for (primitive, &material) in scene.mesh.materials.iter().enumerate() {
            let [a, b, c] = scene.mesh.corners(primitive as u32);
            let emission = scene.materials[material as usize].emission.expect("all shine");
            let area = (b - a).cross(c - a) * 0.5;
            for i in 0..64 {
                let [v, w] = warp::triangle(Sampler::new(primitive as u32, i, 9).pair(0));
                let away = from - (a * (1.0 - v - w) + b * v + c * w);
                let cosine = area.dot(away.normalize());
                let cosine = if emission.two_sided { cosine.abs() } else { cosine.max(0.0) };
                let incidence = seen(away.normalize().dot(-normal));
                all += emission.radiance.factor.x * cosine * incidence / away.length_squared() / 64.0;
            }
        }
        assert!((by_tree / all - 1.0).abs() < 0.02, "{by_tree} and {all}");
    }
}

#[test]
fn thousands_of_emitters_each_have_their_power() {
    let mut scene = Scene::default();
    for i in 0..3000 {
        add_square(&mut scene, 1.0 + i as f32, shining(Colour::constant(Vec3::splat(i as f32)), true));
    }
    let lights = Lights::new(&scene);
    // The first square is black: no power, no entry.
    assert_eq!(lights.emitters().len(), 2 * 2999);
    let expected = 2.0 * f64::from(PI) * 4.0 * (2999.0 * 3000.0 / 2.0);
    assert!((lights.emitters().power() / expected - 1.0).abs() < 1e-5);
    let to = receiver(Vec3::ZERO, Vec3::Y);
    let total: f32 = (0..6000).map(|p| pdf_emitter(&lights, &to, p, 1.0, 1.0) * 2.0).sum();
    assert!((total - 1.0).abs() < 1e-3, "probabilities add up to {total}");
}

/// Points and spots of random brightness, position and direction, one black light, and two suns.
fn thousands_of_points() -> Scene {
    let light = |i: u32| {
        let s = Sampler::new(i, 0, 78);
        let intensity = Vec3::splat(libm::powf(10.0, 2.0 * s.single(0)));
        let position = Vec3::from(std::array::from_fn(|k| s.single(1 + k as u32) * 40.0 - 20.0));
        let direction = warp::sphere(s.pair(5));
        let cos_inner = 1.0 - s.single(6);
        let shape = match i % 3 {
            0 => LightShape::Point { position },
            _ => LightShape::Spot { position, direction, cos_inner, cos_outer: cos_inner * s.single(7) },
        };
        Light { name: String::new(), intensity, shape }
    };
    let sun = |intensity: f32, direction: Vec3| {
        let (intensity, direction) = (Vec3::splat(intensity), direction.normalize());
        Light { name: String::new(), intensity, shape: LightShape::Directional { direction } }
    };
    let mut lights: Vec<Light> = (0..2000).map(light).collect();
    lights[77].intensity = Vec3::ZERO;
    lights.extend([sun(3.0, Vec3::NEG_Y), sun(1.0, Vec3::new(1.0, -1.0, 0.3))]);
    let mut scene = Scene { lights, ..Scene::default() };
    // The power of suns depends on the size of the scene.
    add_square(&mut scene, -1.0, Material::fallback());
    scene.mesh.positions.iter_mut().for_each(|corner| *corner *= 20.0);
    scene
}

/// Receivers among the lights: position, normal, and whether they are lit from both sides.
const AMONG: [(Vec3, Vec3, bool); 2] =
    [(Vec3::ZERO, Vec3::Y, false), (Vec3::new(19.0, 5.0, -7.0), Vec3::NEG_X, false)];

fn among((from, normal, around): (Vec3, Vec3, bool)) -> Receiver<SingleLane> {
    let to = receiver(from, normal);
    if around { to.two_sided() } else { to }
}

#[test]
fn punctual_lights_are_chosen_with_the_stated_probabilities() {
    let scene = thousands_of_points();
    let lights = Lights::new(&scene);
    let n = 1 << 17;
    for to in AMONG.map(among) {
        let (mut counts, mut stated) = (vec![0u32; 2002], vec![0.0; 2002]);
        for i in 0..n {
            let u = Num::from((i as f32 + 0.5) / n as f32);
            let (index, probability) = lights.punctual().choose(&to, u).expect("there are lights");
            let (index, probability) = (index.get() as usize, probability.get());
            if probability > 0.0 {
                assert!(counts[index] == 0 || stated[index] == probability);
                stated[index] = probability;
                counts[index] += 1;
            }
        }
        let sum: f32 = stated.iter().sum();
        // As above. Where spots count as emitting in all directions, half of the descents may end without
        // light.
        assert!((0.3..1.001).contains(&sum), "probabilities add up to {sum}");
        assert!(stated[2000] > stated[2001] && stated[2001] > 0.0 && stated[77] == 0.0);
        // The samples are evenly spaced, so the counts are off only by rounding.
        for (&count, &stated) in counts.iter().zip(&stated) {
            assert!((count as f32 - stated * n as f32).abs() < 2.0 + 1e-3 * count as f32, "{count} {stated}");
        }
    }
}

/// Means and variances of estimates of the light at a receiver, with lights chosen by `choose`.
fn mean_and_variance(
    lights: &Lights,
    (from, normal, around): (Vec3, Vec3, bool),
    mut choose: impl FnMut(&Receiver<SingleLane>, f32) -> (u32, f32),
) -> [f64; 2] {
    let (n, mut sums, to) = (1 << 15, [0.0; 2], among((from, normal, around)));
    for i in 0..n {
        let (index, probability) = choose(&to, Sampler::new(4, i, 1).single(2));
        let light = LightSample::of_light(lights, index as usize, from).filter(|_| probability > 0.0);
        let cosine = light.map_or(0.0, |light| light.wi.dot(normal));
        let seen = if around { cosine.abs() } else { cosine.max(0.0) };
        let value = light.map_or(0.0, |light| f64::from(light.radiance.x * seen / probability));
        sums = [sums[0] + value, sums[1] + value * value];
    }
    let [mean, square] = sums.map(|sum| sum / f64::from(n));
    [mean, square - mean * mean]
}

#[test]
fn the_tree_of_punctual_lights_finds_all_light_with_less_noise_than_power_does() {
    let scene = thousands_of_points();
    let lights = Lights::new(&scene);
    let powers: Vec<f64> = scene
        .lights
        .iter()
        .map(|light| {
            // The suns count as if the scene were a sphere of radius 10.
            let solid_angle = match light.shape {
                LightShape::Directional { .. } => 100.0 * PI,
                _ => 4.0 * PI,
            };
            f64::from(light.intensity.x * solid_angle)
        })
        .collect();
    let table = AliasTable::new(&powers);
    for at in AMONG {
        let (from, normal, around) = at;
        let all: f64 = (0..scene.lights.len())
            .filter_map(|index| LightSample::of_light(&lights, index, from))
            .map(|light| (light.wi.dot(normal), light.radiance.x))
            .map(|(cosine, light)| f64::from(light * if around { cosine.abs() } else { cosine.max(0.0) }))
            .sum();
        let by_tree = mean_and_variance(&lights, at, |to, u| {
            let (index, probability) = lights.punctual().choose(to, u.into()).expect("there are lights");
            (index.get(), probability.get())
        });
        let by_power = mean_and_variance(&lights, at, |_, u| {
            let (index, probability, _) = table.choose(Num::from(u)).expect("there are lights");
            (index.get(), probability.get())
        });
        assert!((by_tree[0] / all - 1.0).abs() < 0.02, "{} and {all}", by_tree[0]);
        assert!(by_tree[1] < 0.5 * by_power[1], "{by_tree:?} and {by_power:?}");
    }
}

/// The choices of lanes among punctual lights.
struct Choices<'a>(&'a Lights);

impl LaneTask for Choices<'_> {
    type Output = Vec<[u32; 2]>;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Self::Output {
        let mut choices = Vec::new();
        for first in (0..1024u32).step_by(L::LANES) {
            let s: Sampler<L> = Sampler::of(Int::iota(l) + first, Int::splat(l, 0), 3);
            let [x, y] = s.two(Int::splat(l, 1));
            let position = Vector::new(x * 40.0 - 20.0, y * 40.0 - 20.0, x - y);
            let to = Receiver::new(position, Vector::new(x, y, x * y + 0.1).normalize());
            let (index, probability) =
                self.0.punctual().choose(&to, s.one(Int::splat(l, 2))).expect("there are lights");
            let (index, probability) = (index.to_array(), probability.to_bits().to_array());
            choices.extend((0..L::LANES).map(|lane| [index[lane], probability[lane]]));
        }
        choices
    }
}

#[test]
fn every_level_chooses_the_same_lights_with_the_same_probabilities() {
    let lights = Lights::new(&thousands_of_points());
    let one = SimdLevel::narrowest().run(Choices(&lights));
    for level in SimdLevel::available() {
        assert_eq!(level.run(Choices(&lights)), one, "{level}");
    }
}
