//! Layers besides the picture: the same bytes however they are rendered, and right on scenes with known answers.

use super::harness::{render, tracer};
use super::scenes::{add_material, add_mix, add_quad, camera, of, one_of_everything, room, shining};
use crate::film::{Film, LayerValues, Picture};
use crate::lanes::{Lanes, Num, SimdLevel, Vector};
use crate::render::{
    AmbientOcclusion, Aov, AovError, AovSet, Frame, HitShader, HitShading, Integrator, PathTracer, PerRay,
    RayByRay, RayHit, RayShader, RecursiveWhitted, Settings, Whitted, recursion::Recursion,
};
use crate::scene::{
    Colour, ColourSpace, Effects, Environment, Finish, Material, Mipmap, Object, Points, Procedural,
    ProceduralSurface, Scalar, Scene, Surface, Texture, TextureRef, Wrap,
};
use crate::schedule::{Batch, Output};
use crate::stream::{Hit, MISS, Ray, Tracer};
use glam::{Vec2, Vec3};
use std::sync::Arc;

const SETTINGS: Settings = Settings::new(40, 30).with_spp(8).with_max_bounces(3).with_seed(5);

fn all() -> AovSet {
    Aov::ALL.iter().fold(AovSet::default(), |set, aov| set.with(*aov))
}

/// Objects of six triangles each, in groups of three.
fn with_objects(mut scene: Scene) -> Scene {
    let mut objects = crate::scene::Objects::default();
    let mut group = None;
    for (i, first) in (0..scene.mesh.triangles.len() as u32).step_by(6).enumerate() {
        if i % 3 == 0 {
            group = Some(objects.add(Object::new(format!("group {i}"))));
        }
        let mut object = Object::new("part").below(group);
        object.instance = (i % 2 == 0).then_some(i as u32 / 2);
        let object = objects.add(object);
        objects.assign(first, object);
    }
    scene.objects = objects.into();
    scene
}

/// A picture with its layers.
fn picture<I: Integrator + crate::schedule::Renderer>(
    integrator: &I,
    aovs: &AovSet,
    batch: usize,
    tracer: &dyn Tracer,
) -> Picture {
    let integrator = integrator.with_aovs(aovs).expect("layers");
    render(&integrator, batch, tracer);
    integrator.frame().develop(integrator.frame().film())
}

fn floats<'a>(picture: &'a Picture, name: &str) -> &'a [f32] {
    let layer = picture.layers.iter().find(|layer| layer.name == name).expect("the layer");
    let LayerValues::Floats { values, .. } = &layer.values else { panic!("{name} has numbers") };
    values
}

fn vectors(picture: &Picture, name: &str) -> Vec<Vec3> {
    floats(picture, name).chunks_exact(3).map(Vec3::from_slice).collect()
}

fn path(scene: &Arc<Scene>, settings: Settings) -> PathTracer {
    PathTracer::new(Arc::clone(scene), &camera(), settings, Some(2)).expect("settings")
}

/// White, and shines a shadow ray upwards.
struct Plain;

impl RayShader for Plain {
    const SHADOW_RAYS: usize = 1;

    fn shade(&self, hit: &mut RayHit<'_>) -> Vec3 {
        hit.send_shadow(Ray::new(Vec3::new(0.0, 0.0, 9.0), Vec3::Z), Vec3::ONE);
        if hit.surface().is_some() { Vec3::ONE } else { hit.sky() }
    }
}

#[test]
fn all_integrators_lanes_and_batches_give_the_same_bytes() {
    let scene = Arc::new(with_objects(one_of_everything()));
    let tracer = tracer(&scene);
    let mut layers = Vec::new();
    fn each<I: Integrator + crate::schedule::Renderer>(make: &dyn Fn() -> I, tracer: &dyn Tracer) -> Picture {
        let first = picture(&make(), &all(), 8192, tracer);
        for simd in SimdLevel::available() {
            for batch in [8192, 97] {
                let other = picture(&make().with_simd(simd), &all(), batch, tracer);
                assert!(
                    other.layers == first.layers && other.image == first.image,
                    "{simd}, batches of {batch}"
                );
            }
        }
        let plain = make();
        render(&plain, 8192, tracer);
        assert_eq!(plain.frame().film().resolve(), first.image.pixels, "layers change no picture");
        first
    }
    layers.push(each(&|| path(&scene, SETTINGS), &tracer));
    layers.push(each(&|| Whitted::new(scene.clone(), &camera(), SETTINGS).expect("settings"), &tracer));
    let occlusion = || AmbientOcclusion::new(scene.clone(), &camera(), SETTINGS, 1.0).expect("settings");
    layers.push(each(&occlusion, &tracer));
    layers.push(each(
        &|| PerRay::shading(Plain, scene.clone(), &camera(), SETTINGS).expect("settings"),
        &tracer,
    ));
    let recursive =
        || Recursion::new(RecursiveWhitted, scene.clone(), &camera(), SETTINGS).expect("settings");
    layers.push(each(&recursive, &tracer));
    for layer in 0..layers[0].layers.len() {
        let name = layers[0].layers[layer].name;
        let same = layers.iter().all(|picture| picture.layers[layer] == layers[0].layers[layer]);
        // Radiance differs, and the path tracer alone follows mirrors.
        let differs = ["variance", "noisy", "denoising-albedo", "denoising-normal"].contains(&name);
        assert_eq!(same, !differs, "{name} of all integrators");
    }
    assert_eq!(layers[0].layers.len(), layers[0].layer_hashes().len());
    let single = RayByRay(Arc::new(path(&scene, SETTINGS).with_aovs(&all()).expect("layers")));
    render(&single, 64, &tracer);
    assert!(single.0.frame().develop(single.0.film()).layers == layers[0].layers, "ray by ray");
}

#[test]
fn depths_and_ids_are_those_of_rays_through_the_centres() {
    let scene = Arc::new(with_objects(one_of_everything()));
    let tracer = tracer(&scene);
    let seen = picture(&path(&scene, SETTINGS), &all(), 8192, &tracer);
    let lens = camera().lens(SETTINGS.width, SETTINGS.height).expect("a camera");
    let pixels = (0..SETTINGS.height).flat_map(|y| (0..SETTINGS.width).map(move |x| (x, y)));
    let rays = pixels.map(|(x, y)| lens.ray(x, y, [0.5; 2]).expect("a pinhole sees all"));
    let rays: Vec<Ray> = rays.map(|(origin, direction)| Ray::new(origin, direction)).collect();
    let mut hits = vec![Hit::NONE; rays.len()];
    tracer.closest(&rays, &mut hits);
    let ids = |name: &str| {
        let layer = seen.layers.iter().find(|layer| layer.name == name).expect("the layer");
        let LayerValues::Ids { ids, names } = &layer.values else { panic!("{name} has ids") };
        (ids.clone(), names.clone())
    };
    let (depths, zs) = (floats(&seen, "depth"), floats(&seen, "z"));
    let [objects, materials, instances, primitives] =
        ["object", "material", "instance", "primitive"].map(ids);
    for (i, (ray, hit)) in rays.iter().zip(&hits).enumerate() {
        assert_eq!(depths[i].to_bits(), hit.t.to_bits(), "pixel {i}");
        assert_eq!(zs[i], if hit.is_miss() { f32::INFINITY } else { hit.t * -ray.direction[2] });
        assert_eq!(primitives.0[i], hit.primitive);
        let object = scene.objects.of(hit.primitive).filter(|_| !hit.is_miss());
        assert_eq!(objects.0[i], object.unwrap_or(LayerValues::NO_ID));
        let instance = object.and_then(|object| scene.objects.get(object)?.instance);
        assert_eq!(instances.0[i], instance.unwrap_or(LayerValues::NO_ID));
        let material = if hit.is_miss() { MISS } else { crate::shade::material_of(&scene, hit) };
        assert_eq!(materials.0[i], material);
    }
    assert!(hits.iter().any(Hit::is_miss) && instances.0.iter().any(|&id| id != LayerValues::NO_ID));
    let mut names = objects.1.clone();
    names.sort();
    names.dedup();
    assert_eq!(names.len(), scene.objects.len(), "names are unique: {:?}", objects.1);
    assert!(names.contains(&"group 0/part".to_owned()) && names.contains(&"group 0/part#2".to_owned()));
    assert_eq!(materials.1.len(), scene.materials.len());
}

/// A square of half the picture's height in the plane z = 0, textured, below a lamp, before an even sky.
fn square() -> Scene {
    let mut scene =
        Scene { environment: Environment::Constant(Vec3::new(0.5, 1.0, 2.0)), ..Scene::default() };
    scene.textures.push(Texture {
        name: "halves".into(),
        width: 2,
        height: 1,
        texels: vec![[255, 0, 0, 255], [0, 0, 255, 255]].into(),
        space: ColourSpace::Linear,
        wrap_u: Wrap::Clamp,
        wrap_v: Wrap::Clamp,
        mipmap: Mipmap::default(),
    });
    let texture = Some(TextureRef::plain(0));
    let reflectance = Colour { texture, ..Colour::constant(Vec3::splat(0.5)) };
    let paper = Material { surface: Surface::Matte { reflectance }, ..Material::fallback() };
    let paper = add_material(&mut scene, paper);
    let lamp = add_material(&mut scene, shining(3.0, 0.25));
    add_quad(&mut scene, Vec3::new(-0.7, -0.7, 0.0), Vec3::X * 1.4, Vec3::Y * 1.4, paper);
    add_quad(&mut scene, Vec3::new(-0.7, 1.0, 0.0), Vec3::X * 1.4, Vec3::Y * 0.3, lamp);
    scene.mesh.uvs = scene.mesh.positions.iter().map(|p| Vec2::new(p.x, p.y) / 1.4 + 0.5).collect();
    scene
}

#[test]
fn means_are_right_on_a_square() {
    let scene = Arc::new(square());
    let settings = Settings { width: 64, height: 48, spp: 16, ..SETTINGS };
    let aovs = all().with_transparent(true);
    let seen = picture(&path(&scene, settings), &aovs, 8192, &tracer(&scene));
    let alpha = seen.alpha.as_ref().expect("asked for");
    let [normals, shading, positions] =
        ["normal", "shading-normal", "position"].map(|name| vectors(&seen, name));
    let [albedos, emissions] = ["albedo", "emission"].map(|name| vectors(&seen, name));
    let uvs = floats(&seen, "uv");
    let half = libm::tanf(20f32.to_radians()) * 4.0;
    let (mut inside, mut edges) = (0, 0);
    for (pixel, &alpha) in alpha.iter().enumerate() {
        let centre = Vec2::new((pixel % 64) as f32 - 31.5, 23.5 - (pixel / 64) as f32) * (half / 24.0);
        if alpha == 0.0 {
            assert!(
                normals[pixel] == Vec3::ZERO
                    && albedos[pixel] == Vec3::ZERO
                    && positions[pixel] == Vec3::ZERO
            );
            continue;
        }
        assert!((normals[pixel] - Vec3::Z).length() < 1e-6 && (shading[pixel] - Vec3::Z).length() < 1e-6);
        assert!(positions[pixel].z.abs() < 1e-6);
        let away = (positions[pixel].truncate() - centre).abs().max_element();
        assert!(away < 0.5 * half / 24.0, "pixel {pixel} lies at {}", positions[pixel]);
        let uv = Vec2::new(uvs[2 * pixel], uvs[2 * pixel + 1]);
        assert!((uv - (positions[pixel].truncate() / 1.4 + 0.5)).length() < 1e-5, "{uv}");
        if alpha < 1.0 {
            edges += 1;
            continue;
        }
        inside += 1;
        // Samples are stratified, so their mean lies near the centre.
        assert!(away < 0.1 * half / 24.0, "pixel {pixel} lies at {}", positions[pixel]);
        if centre.y > 0.9 {
            assert!((albedos[pixel] - 0.25).length() < 1e-6 && (emissions[pixel] - 3.0).length() < 1e-5);
        } else if centre.x.abs() > 0.5 {
            // The texture is filtered between the middles of its texels, a quarter from the edges.
            let expected = if centre.x < 0.0 { Vec3::X } else { Vec3::Z } * 0.5;
            assert!((albedos[pixel] - expected).length() < 0.01, "{} at {centre}", albedos[pixel]);
            assert_eq!(emissions[pixel], Vec3::ZERO);
        }
    }
    assert!(inside > 200 && edges > 60, "{inside} and {edges} pixels");
    assert!(floats(&seen, "samples").iter().all(|&samples| samples == 16.0));
}

#[test]
fn a_transparent_picture_over_an_even_sky_is_the_opaque_one() {
    let scene = Arc::new(room());
    let Environment::Constant(sky) = scene.environment else { panic!("an even sky") };
    let tracer = tracer(&scene);
    let settings = Settings { spp: 16, ..SETTINGS };
    fn both<I: Integrator + crate::schedule::Renderer>(integrator: &I, tracer: &dyn Tracer, sky: Vec3) {
        let opaque = picture(integrator, &AovSet::default(), 8192, tracer);
        let transparent = picture(integrator, &AovSet::default().with_transparent(true), 8192, tracer);
        let alpha = transparent.alpha.expect("asked for");
        for (pixel, &alpha) in alpha.iter().enumerate() {
            let over = Vec3::from(transparent.image.pixels[pixel]) + sky * (1.0 - alpha);
            let expected = Vec3::from(opaque.image.pixels[pixel]);
            assert!((over - expected).length() < 1e-5, "pixel {pixel}: {over} and {expected}");
        }
        let share = alpha.iter().sum::<f32>() / alpha.len() as f32;
        assert!(alpha.contains(&0.0) && alpha.contains(&1.0) && share > 0.5 && share < 1.0, "{share}");
        assert!(alpha.iter().any(|&alpha| alpha > 0.0 && alpha < 1.0));
    }
    both(&path(&scene, settings), &tracer, sky);
    both(&Whitted::new(scene.clone(), &camera(), settings).expect("settings"), &tracer, sky);
    both(
        &Recursion::new(RecursiveWhitted, scene.clone(), &camera(), settings).expect("settings"),
        &tracer,
        sky,
    );
    let occlusion = AmbientOcclusion::new(scene.clone(), &camera(), settings, 1.0).expect("settings");
    both(&occlusion, &tracer, Vec3::ONE);
}

#[derive(Debug)]
struct Veil(f32);

impl Procedural for Veil {
    #[inline(always)]
    fn finish<L: Lanes>(&self, points: &Points<'_, L>) -> Finish<L> {
        let colour = Vector::grey(Num::splat(points.lanes(), 0.25));
        Finish { colour, opacity: Num::splat(points.lanes(), self.0), ..Finish::matte(points) }
    }

    fn effects(&self) -> Effects {
        Effects::default().opacity()
    }
}

#[test]
fn rays_that_pass_a_surface_hit_what_is_behind_first() {
    let mut scene = Scene { environment: Environment::Constant(Vec3::ONE), ..Scene::default() };
    scene.procedurals.push(ProceduralSurface::new(Veil(0.25)));
    let veil = Material { surface: Surface::Procedural(0), ..Material::fallback() };
    let veil = add_material(&mut scene, veil);
    let wall = add_material(&mut scene, Material::matte("wall", Vec3::ONE));
    add_quad(&mut scene, Vec3::new(-9.0, -9.0, 1.0), Vec3::X * 18.0, Vec3::Y * 18.0, veil);
    add_quad(&mut scene, Vec3::new(-9.0, -9.0, 0.0), Vec3::X * 9.0, Vec3::Y * 18.0, wall);
    let scene = Arc::new(scene);
    let settings = Settings { spp: 64, ..SETTINGS };
    let aovs = all().with_transparent(true);
    let seen = picture(&path(&scene, settings), &aovs, 8192, &tracer(&scene));
    let (alpha, albedos) = (seen.alpha.as_ref().expect("asked for"), vectors(&seen, "albedo"));
    let crypto = seen.layers.iter().find(|layer| layer.name == "crypto-material").expect("the layer");
    let LayerValues::Coverage(coverage) = &crypto.values else { panic!("counts") };
    for pixel in 0..alpha.len() {
        let left = pixel % 40 < 20;
        let expected = if left { 1.0 } else { 0.25 };
        // Where both triangles of the veil are seen their decisions are stratified separately.
        assert!((alpha[pixel] - expected).abs() < 0.15, "{} in pixel {pixel}", alpha[pixel]);
        let expected = if left { 0.25 * 0.25 + 0.75 } else { 0.25 * 0.25 };
        assert!((albedos[pixel].x - expected).abs() < 0.15, "{}", albedos[pixel]);
        let entries = &coverage.entries[coverage.starts[pixel] as usize..coverage.starts[pixel + 1] as usize];
        let counted: u32 = entries.iter().map(|entry| entry.1).sum();
        assert_eq!(counted as f32 / 64.0, alpha[pixel]);
        assert_eq!(entries[0].0, veil);
        assert_eq!(entries.len(), if left { 2 } else { 1 });
    }
    let share = alpha.iter().sum::<f32>() / alpha.len() as f32;
    assert!((share - 0.625).abs() < 0.003, "{share}");
}

#[test]
fn coverage_counts_every_sample_that_hits() {
    let mut scene = square();
    let mix = add_mix(&mut scene, [0, 1], Scalar::constant(0.5));
    scene.mesh.materials[0] = mix;
    let scene = Arc::new(with_objects(scene));
    let aovs = AovSet::default().with(Aov::CryptoMaterial).with(Aov::CryptoObject).with(Aov::CryptoAsset);
    let seen = picture(&path(&scene, SETTINGS), &aovs.with_transparent(true), 8192, &tracer(&scene));
    let alpha = seen.alpha.as_ref().expect("asked for");
    let mut mixed = 0;
    for layer in &seen.layers {
        let LayerValues::Coverage(coverage) = &layer.values else { panic!("counts") };
        assert!(coverage.samples.iter().all(|&samples| samples == SETTINGS.spp));
        for (pixel, &alpha) in alpha.iter().enumerate() {
            let entries =
                &coverage.entries[coverage.starts[pixel] as usize..coverage.starts[pixel + 1] as usize];
            let counted: u32 = entries.iter().map(|entry| entry.1).sum();
            assert_eq!(counted as f32 / SETTINGS.spp as f32, alpha, "{} of pixel {pixel}", layer.name);
            assert!(entries.windows(2).all(|pair| pair[0].0 < pair[1].0));
            mixed += usize::from(layer.name == "crypto-material" && entries.len() > 1);
            // One object and the group above it have all triangles.
            let id = match layer.name {
                "crypto-object" => 1,
                "crypto-asset" => 0,
                _ => continue,
            };
            assert!(entries.iter().all(|entry| entry.0 == id));
        }
    }
    assert!(mixed > 10, "{mixed} pixels show both parts of the mix");
}

#[test]
fn features_are_those_of_what_is_seen_in_mirrors_and_behind_glass() {
    // A wall behind the camera's back, seen in a mirror on the left and, through a pane, directly on the right.
    let mut scene = Scene { environment: Environment::Constant(Vec3::ONE), ..Scene::default() };
    let mirror = add_material(
        &mut scene,
        of(Surface::Mirror { reflectance: Colour::constant(Vec3::new(0.5, 1.0, 1.0)) }),
    );
    let glass = add_material(
        &mut scene,
        of(Surface::Dielectric { ior: 1.0, transmittance: Vec3::new(1.0, 0.5, 1.0) }),
    );
    let back = add_material(&mut scene, Material::matte("back", Vec3::new(0.8, 0.6, 0.4)));
    let front = add_material(&mut scene, Material::matte("front", Vec3::new(0.2, 0.4, 0.6)));
    let (up, right) = (Vec3::Y * 40.0, Vec3::X * 20.0);
    add_quad(&mut scene, Vec3::new(-20.0, -20.0, 0.0), right, up, mirror);
    add_quad(&mut scene, Vec3::new(0.0, -20.0, 0.0), right, up, glass);
    add_quad(&mut scene, Vec3::new(20.0, -20.0, 8.0), -2.0 * right, up, back);
    add_quad(&mut scene, Vec3::new(-20.0, -20.0, -8.0), 2.0 * right, up, front);
    let scene = Arc::new(scene);
    let aovs = AovSet::default().with(Aov::DenoisingAlbedo).with(Aov::DenoisingNormal).with(Aov::Albedo);
    let picture = picture(&path(&scene, SETTINGS), &aovs, 64, &tracer(&scene));
    let near = |name: &str, x: usize, expected: [f32; 3]| {
        let found = &floats(&picture, name)[3 * (15 * 40 + x)..][..3];
        let differs = found.iter().zip(expected).any(|(a, b)| (a - b).abs() > 1e-5);
        assert!(!differs, "{name} in column {x}: {found:?} where {expected:?} is expected");
    };
    near("denoising-albedo", 8, [0.4, 0.6, 0.4]);
    near("denoising-normal", 8, [0.0, 0.0, -1.0]);
    near("albedo", 8, [0.5, 1.0, 1.0]);
    near("denoising-albedo", 32, [0.2, 0.2, 0.6]);
    near("denoising-normal", 32, [0.0, 0.0, 1.0]);
    near("albedo", 32, [1.0, 0.5, 1.0]);
}

#[test]
fn variance_agrees_with_the_spread_between_seeds() {
    let scene = Arc::new(room());
    let tracer = tracer(&scene);
    for (spp, may_end_early, most) in [(16, false, 2.0), (64, false, 3.0), (256, false, 3.0), (64, true, 6.0)]
    {
        let pictures: Vec<Picture> = (0..12)
            .map(|seed| {
                let settings = Settings::new(32, 24).with_spp(spp).with_max_bounces(2).with_seed(seed);
                let settings = settings.with_early_end(may_end_early);
                let aovs = AovSet::default().with(Aov::Variance);
                picture(&path(&scene, settings), &aovs, 8192, &tracer)
            })
            .collect();
        let count = pictures.len() as f64;
        let (mut spread, mut estimate) = (0.0, 0.0);
        for i in 0..3 * 32 * 24 {
            let values = pictures.iter().map(|picture| f64::from(picture.image.pixels[i / 3][i % 3]));
            let mean = values.clone().sum::<f64>() / count;
            spread += values.map(|value| (value - mean) * (value - mean)).sum::<f64>() / (count - 1.0);
            let estimates = pictures.iter().map(|picture| f64::from(floats(picture, "variance")[i]));
            estimate += estimates.sum::<f64>() / count;
        }
        let ratio = estimate / spread;
        println!("{spp} samples, may end early {may_end_early}: {ratio:.2} times the spread");
        // The samples of a pixel are stratified together, so their mean varies less than two halves tell.
        assert!((0.9..most).contains(&ratio), "{ratio} of the spread with {spp} samples, {may_end_early}");
    }
}

/// A hit shader that does not tell its camera rays.
#[derive(Debug)]
struct Silent;

impl HitShader for Silent {
    type Payload = u32;
    type ShadowPayload = ();
    type Memory = ();
    const MAX_BOUNCES: u32 = 8;

    fn splats(&self, _: u32) -> u64 {
        1
    }

    fn camera(&self, _: &Frame) -> impl Fn(u32, u32) -> u32 {
        |pixel, _| pixel
    }

    fn shade(&self, _: &Frame, _: &(), _: Batch<'_, u32>, _: &mut Output<'_, u32, ()>) {}

    fn shadow(&self, _: &Frame, _: &[Ray], _: &[()], _: &[u32]) {}
}

#[test]
fn what_cannot_be_made_is_refused() {
    let scene = Arc::new(room());
    let one = path(&scene, SETTINGS.with_spp(1));
    let refused = one.with_aovs(&all()).expect_err("variance of one sample");
    assert!(matches!(refused, AovError::Variance) && refused.to_string().contains("at least 2"), "{refused}");
    let silent = HitShading::of(Silent, scene, &camera(), SETTINGS).expect("settings");
    assert_eq!(silent.with_aovs(&all()).err(), Some(AovError::NoFirstHits));
    assert!(silent.with_aovs(&AovSet::default()).is_ok());
    let layers = |aovs: &str| aovs.parse::<AovSet>().map(|set| set.to_string());
    assert_eq!(layers("uv, depth,uv").as_deref(), Ok("uv,depth"));
    assert!(layers("").is_err() && layers("depth,,z").is_err() && layers("alpha").is_err());
}

#[test]
fn nothing_is_held_for_layers_that_are_not_asked_for() {
    let scene = Arc::new(with_objects(room()));
    let film = |names: &str| {
        let aovs: AovSet = names.parse().expect("names");
        let frame = path(&scene, SETTINGS).with_aovs(&aovs).expect("layers");
        let film: &Film = frame.film();
        film.plan().map_or(0, |plan| plan.bytes(1 << 20) >> 20)
    };
    assert_eq!([film("samples"), film("depth,z,object"), film("variance")], [0, 12, 28]);
    assert_eq!([film("normal"), film("normal,uv,position")], [4 + 24, 4 + 64]);
    let most = all().most_bytes(1 << 20, SETTINGS.spp) >> 20;
    assert!((448..478).contains(&most), "{most} bytes a pixel for everything");
    assert!(path(&scene, SETTINGS).film().plan().is_none());
}
