//! The path tracer against known answers and against a plainer path tracer.

use super::harness::{self, render};
use super::scenes::*;
use crate::geom::Sampler;
use crate::lanes::SimdLevel;
use crate::render::{Integrator, PathTracer, ROULETTE_BOUNCES, Settings, SettingsError};
use crate::scene::{
    Alpha, AlphaMode, Averaging, CameraError, Channel, Colour, ColourSpace, DiffuseTransmission, Emission,
    Environment, EnvironmentMap, Light, LightShape, Material, NormalMap, Scalar, Scene, Sheen, Surface,
    Texture, TextureRef,
};
use crate::schedule::Renderer;
use crate::shade::bsdf::Smoothness;
use crate::shade::single::{Bsdf, Interaction, emission};
use crate::shade::{Lights, material_of};
use crate::stream::{Hit, Ray, Tracer};
use glam::{Vec2, Vec3, Vec4};
use std::sync::Arc;

const SETTINGS: Settings = Settings::new(24, 24).with_spp(64).with_max_bounces(4);

fn path(scene: Scene, settings: Settings) -> PathTracer {
    PathTracer::new(Arc::new(scene), &camera(), settings, Some(ROULETTE_BOUNCES)).expect("valid settings")
}

/// Renders a scene; the pixels.
fn picture(scene: Scene, settings: Settings) -> Vec<Vec3> {
    let tracer = harness::tracer(&scene);
    let path = path(scene, settings);
    render(&path, 8192, &tracer);
    assert_eq!(path.film().dropped_splats(), 0);
    path.film().resolve().into_iter().map(Vec3::from).collect()
}

fn mean(pixels: &[Vec3]) -> Vec3 {
    pixels.iter().sum::<Vec3>() / pixels.len() as f32
}

/// White materials that transmit diffusely.
fn translucent_bodies() -> [(&'static str, Material); 3] {
    [("leaf", true, 0.0), ("wax", false, 0.0), ("milk", false, 0.5)].map(|(name, thin, transmission)| {
        let material = principled(|s| {
            (s.thin, s.transmission, s.roughness) =
                (thin, Scalar::constant(transmission), Scalar::constant(0.3));
            let (share, colour) = (Scalar::constant(0.6), Colour::constant(Vec3::ONE));
            s.diffuse_transmission = Some(DiffuseTransmission { share, colour });
        });
        (name, material)
    })
}

#[test]
fn white_bodies_vanish_in_a_white_furnace() {
    let mut materials = vec![
        ("matte", Material::matte("", Vec3::ONE)),
        ("mirror", of(Surface::Mirror { reflectance: Colour::constant(Vec3::ONE) })),
        ("glass", of(Surface::Dielectric { ior: 1.5, transmittance: Vec3::ONE })),
        (
            "solid",
            principled(|s| {
                s.transmission = Scalar::constant(1.0);
                s.thin = false;
                s.roughness = Scalar::constant(0.0);
            }),
        ),
        (
            "coat",
            principled(|s| {
                s.clearcoat = Scalar::constant(1.0);
                s.clearcoat_roughness = Scalar::constant(0.2);
                s.metallic = Scalar::constant(1.0);
            }),
        ),
    ];
    materials.extend(translucent_bodies());
    for roughness in [0.0, 0.1, 0.4, 1.0] {
        materials.push(("plastic", principled(|s| s.roughness = Scalar::constant(roughness))));
        materials.push((
            "metal",
            principled(|s| {
                s.roughness = Scalar::constant(roughness);
                s.metallic = Scalar::constant(1.0);
            }),
        ));
        materials.push((
            "frosted",
            principled(|s| {
                s.roughness = Scalar::constant(roughness);
                s.transmission = Scalar::constant(1.0);
                s.thin = false;
            }),
        ));
        materials.push((
            "pane",
            principled(|s| {
                s.roughness = Scalar::constant(roughness);
                s.transmission = Scalar::constant(0.8);
            }),
        ));
    }
    for (name, material) in materials {
        let surface = material.surface;
        // Faces are flat: a bent normal loses the light that would come from below the face.
        let pixels = picture(furnace(material, 2, false), Settings { max_bounces: 100, ..SETTINGS });
        let off = mean(&pixels) - Vec3::ONE;
        // A coat over rough facets loses some; what a body's facets lose at each of many events is interpolated.
        let is_frosted = ["frosted", "milk"].contains(&name);
        let least = if is_frosted || name == "coat" { -0.02 } else { -4e-3 };
        let most = if is_frosted { 0.02 } else { 4e-3 };
        assert!(off.max_element() < most && off.min_element() > least, "{name}: {off} from {surface:?}");
        let worst = pixels.iter().fold(0.0f32, |w, p| w.max((*p - Vec3::ONE).abs().max_element()));
        // Its paths meet many facets, each with a weight of its own.
        let noise = if is_frosted { 0.6 } else { 0.25 };
        assert!(worst < noise, "{name}: a pixel is off by {worst}");
    }
}

/// The sum of what the pixels of two spheres show where the light's cosine on the finer one is within bounds: first of
/// 320 triangles, then of 20,480.
fn near_the_terminator(cosines: std::ops::Range<f32>, sun: impl Fn(&mut Scene)) -> [f32; 2] {
    let [coarse, fine] = [2, 5].map(|levels| {
        let mut scene = furnace(Material::matte("", Vec3::ONE), levels, true);
        scene.environment = Environment::Constant(Vec3::ZERO);
        sun(&mut scene);
        let settings = Settings { width: 96, height: 96, max_bounces: 0, spp: 16, ..SETTINGS };
        picture(scene, settings)
    });
    let cosine = |pixel: &Vec3| pixel.x * std::f32::consts::PI;
    let band = coarse.iter().zip(&fine).filter(|(_, fine)| cosines.contains(&cosine(fine)));
    band.fold([0.0; 2], |[a, b], (coarse, fine)| [a + coarse.x, b + fine.x])
}

#[test]
fn the_shadow_terminator_of_few_triangles_is_that_of_a_smooth_body() {
    // Across the view: at the silhouette normals are bent towards the viewer.
    for direction in [Vec3::new(1.0, 0.0, 0.2), Vec3::new(-0.3, -1.0, 0.0), Vec3::new(0.7, 0.6, -0.1)] {
        let direction = direction.normalize();
        let sun = |scene: &mut Scene| {
            let shape = LightShape::Directional { direction };
            scene.lights.push(Light { name: String::new(), intensity: Vec3::ONE, shape });
        };
        let [coarse, fine] = near_the_terminator(0.02..0.1, sun);
        assert!(fine > 1.0, "few pixels: {fine}");
        assert!((coarse / fine - 1.0).abs() < 0.2, "{direction}: {coarse}, not {fine}");
    }
}

#[test]
fn a_smooth_body_of_few_triangles_vanishes_in_a_white_furnace() {
    for material in [Material::matte("", Vec3::ONE), principled(|s| s.roughness = Scalar::constant(0.6))] {
        let surface = material.surface;
        let pixels = picture(furnace(material, 2, true), SETTINGS);
        let off = mean(&pixels) - Vec3::ONE;
        assert!(off.abs().max_element() < 4e-3, "{off} from {surface:?}");
    }
}

#[test]
fn velvet_loses_little_in_a_white_furnace() {
    for fibres in [0.2, 0.5, 0.8, 1.0] {
        let material = principled(|s| {
            let (colour, roughness) = (Colour::constant(Vec3::ONE), Scalar::constant(fibres));
            s.sheen = Some(Sheen { colour, roughness });
        });
        let off =
            mean(&picture(furnace(material, 3, true), Settings { max_bounces: 100, ..SETTINGS })) - Vec3::ONE;
        assert!(off.abs().max_element() < 0.02, "fibres of roughness {fibres}: {off}");
    }
}

#[test]
fn bounces_count_as_documented() {
    // In a closed box whose walls shine with radiance 1 and reflect half, the k-th ray adds 2^−k, and
    // max bounces n sees n + 2 rays.
    for max_bounces in 0..4 {
        let mut scene = Scene::default();
        let walls = add_material(&mut scene, shining(1.0, 0.5));
        add_cube(&mut scene, 10.0, walls);
        let settings = Settings { max_bounces, spp: 256, ..SETTINGS };
        let expected = 2.0 - 0.5f32.powi(max_bounces as i32 + 1);
        let found = mean(&picture(scene, settings)).x;
        assert!((found / expected - 1.0).abs() < 5e-3, "{max_bounces} bounces: {found}, not {expected}");
    }
}

/// Radiance along a ray by sampling the BSDF alone: no light sampling, no weights, no roulette.
fn plain(scene: &Scene, tracer: &dyn Tracer, mut ray: Ray, bounces: u32, sampler: &Sampler) -> Vec3 {
    let (mut sum, mut throughput) = (Vec3::ZERO, Vec3::ONE);
    for depth in 0..bounces + 2 {
        let mut hits = [Hit::NONE];
        tracer.closest(&[ray], &mut hits);
        let hit = hits[0];
        if hit.is_miss() {
            let Environment::Constant(sky) = scene.environment else { unreachable!("the scenes' own") };
            return sum + throughput * sky;
        }
        let material = &scene.materials[scene.mesh.materials[hit.primitive as usize] as usize];
        let at = Interaction::new(scene, material, &ray, &hit);
        sum += throughput * emission(scene, material.emission.as_ref(), &at);
        let bsdf = Bsdf::new(scene, &material.surface, &at, Smoothness::EXACT);
        let u = sampler.single(100 + 2 * depth);
        let Some(sample) = bsdf.sample(at.basis.to_local(at.wo), u, sampler.pair(101 + 2 * depth)) else {
            return sum;
        };
        let wi = at.basis.to_world(sample.wi);
        throughput *= sample.weight;
        ray = Ray::new(at.origin(at.position, wi), wi);
    }
    sum
}

#[test]
fn light_sampling_changes_the_noise_and_not_the_mean() {
    light_sampling_agrees(&room());
}

#[test]
fn light_sampling_finds_what_shines_through_frosted_panes() {
    let mut scene = room();
    let frosted = principled(|s| {
        s.roughness = Scalar::constant(0.5);
        s.transmission = Scalar::constant(0.8);
    });
    let pane = add_material(&mut scene, frosted);
    add_quad(&mut scene, Vec3::new(-1.0, 1.2, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0, pane);
    light_sampling_agrees(&scene);
}

#[test]
fn light_sampling_finds_what_shines_through_leaves() {
    for thin in [true, false] {
        let mut scene = room();
        let leaf = principled(|s| {
            s.thin = thin;
            s.base_colour = Colour::constant(Vec3::new(0.2, 0.5, 0.1));
            s.roughness = Scalar::constant(0.4);
            let (share, colour) = (Scalar::constant(0.7), Colour::constant(Vec3::new(0.6, 0.9, 0.2)));
            s.diffuse_transmission = Some(DiffuseTransmission { share, colour });
        });
        let leaf = add_material(&mut scene, leaf);
        add_quad(&mut scene, Vec3::new(-1.0, 1.2, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0, leaf);
        light_sampling_agrees(&scene);
    }
}

pub fn light_sampling_agrees(scene: &Scene) {
    let settings = Settings { spp: 256, max_bounces: 3, ..SETTINGS };
    let tracer = harness::tracer(scene);
    let lens = camera().lens(settings.width, settings.height).expect("a view");
    let mut expected = Vec3::ZERO;
    let samples = 1024;
    for y in 0..settings.height {
        for x in 0..settings.width {
            for s in 0..samples {
                let sampler = Sampler::new(y * settings.width + x, s, 99);
                let (origin, direction) = lens.ray(x, y, sampler.pair(0)).expect("a ray");
                let ray = Ray::new(origin, direction);
                expected += plain(scene, &tracer, ray, settings.max_bounces, &sampler);
            }
        }
    }
    expected /= (settings.width * settings.height * samples) as f32;
    for roulette in [None, Some(0), Some(2)] {
        let path = PathTracer::new(Arc::new(scene.clone()), &camera(), settings, roulette).expect("valid");
        render(&path, 8192, &tracer);
        let pixels: Vec<Vec3> = path.film().resolve().into_iter().map(Vec3::from).collect();
        let off = ((mean(&pixels) - expected) / expected).abs().max_element();
        assert!(off < 0.01, "{} for {expected}, roulette {roulette:?}", mean(&pixels));
    }
}

#[test]
fn a_point_light_and_a_sun_light_a_wall_as_computed() {
    let mut scene = Scene::default();
    let wall = add_material(&mut scene, Material::matte("", Vec3::splat(0.5)));
    add_quad(&mut scene, Vec3::new(-9.0, -9.0, 0.0), Vec3::X * 18.0, Vec3::Y * 18.0, wall);
    let light = |shape| Light { name: String::new(), intensity: Vec3::splat(3.0), shape };
    scene.lights.push(light(LightShape::Directional { direction: Vec3::new(0.0, -0.6, -0.8) }));
    let settings = Settings { width: 1, height: 1, max_bounces: 0, ..SETTINGS };
    let narrow = camera().with_fov(0.01);
    let pixel = |scene: &Scene, spp: u32| {
        let settings = Settings { spp, ..settings };
        let path = PathTracer::new(Arc::new(scene.clone()), &narrow, settings, None).expect("valid");
        render(&path, 8192, &harness::tracer(scene));
        path.film().resolve()[0][0]
    };
    let sun = 0.5 / std::f32::consts::PI * 3.0 * 0.8;
    assert!((pixel(&scene, 1) / sun - 1.0).abs() < 1e-4);
    scene.lights.push(light(LightShape::Point { position: Vec3::new(0.0, 0.0, 2.0) }));
    let both = sun + 0.5 / std::f32::consts::PI * 3.0 / 4.0;
    assert!((pixel(&scene, 4096) / both - 1.0).abs() < 5e-3);
    // Something in between.
    add_quad(&mut scene, Vec3::new(-0.5, 0.5, 1.0), Vec3::X, Vec3::Y * 0.5, wall);
    let point = 0.5 / std::f32::consts::PI * 3.0 / 4.0;
    assert!((pixel(&scene, 4096) / point - 1.0).abs() < 0.02, "the sun is hidden");
}

#[test]
fn an_even_sky_takes_one_ray_a_point_and_leaves_no_noise() {
    let wall = |emission: f32| {
        let mut scene =
            Scene { environment: Environment::Constant(Vec3::new(3.0, 2.0, 1.0)), ..Scene::default() };
        let wall = add_material(&mut scene, Material::matte("", Vec3::splat(0.5)));
        add_quad(&mut scene, Vec3::new(-9.0, -9.0, 0.0), Vec3::X * 18.0, Vec3::Y * 18.0, wall);
        if emission > 0.0 {
            let lamp = add_material(&mut scene, shining(emission, 0.0));
            add_quad(&mut scene, Vec3::new(-9.0, -9.0, 1.0), Vec3::X, Vec3::Y, lamp);
        }
        let settings = Settings::new(16, 16).with_spp(1).with_max_bounces(0).with_seed(3);
        let narrow = camera().with_fov(0.01);
        let path = PathTracer::new(Arc::new(scene.clone()), &narrow, settings, None).expect("valid");
        let counts = render(&path, 8192, &harness::tracer(&scene));
        (counts, path.film().resolve())
    };
    let (counts, pixels) = wall(0.0);
    assert_eq!((counts.shadow, counts.continuation), (256, 0));
    assert!(pixels.iter().all(|&p| (Vec3::from(p) - Vec3::new(1.5, 1.0, 0.5)).abs().max_element() < 1e-5));
    // A lamp in front of the wall is looked for as ever.
    assert!(wall(1.0).0.shadow > 300);
}

#[test]
fn rays_beyond_the_last_bounce_are_followed_only_to_what_shines() {
    // A sliver that no ray meets, whose box is around everything, makes all of them go on if it counts as a lamp.
    let scene = |environment: &Environment, shines: bool| {
        let mut scene = Scene { environment: environment.clone(), ..one_of_everything() };
        let mut lamp = shining(1.0, 0.5);
        if !shines {
            lamp.emission = None;
        } else if let Some(emission) = &mut lamp.emission {
            // It is black, but the factor does not tell.
            emission.radiance.texture = Some(TextureRef::plain(scene.textures.len() as u32));
            let texels = vec![[0, 0, 0, 255]; 64].into();
            scene.textures.push(Texture { name: "black".into(), texels, ..bumps() });
        }
        let sliver = add_material(&mut scene, lamp);
        let (from, to) = (Vec3::new(-10.0, 30.0, -10.0), Vec3::new(30.0, -10.0, 30.0));
        add_quad(&mut scene, from, to - from, Vec3::X * 1e-5, sliver);
        let vertices = scene.mesh.positions.len();
        scene.mesh.uvs.resize(vertices, Vec2::ZERO);
        scene
    };
    let image = EnvironmentMap {
        width: 4,
        height: 2,
        texels: (0..8).map(|i| [i as f32 * 0.1, 0.3, 0.2]).collect(),
        rotation_degrees: 20.0,
    };
    let even = Environment::Constant(Vec3::new(0.1, 0.2, 0.3));
    for environment in [Environment::default(), even, Environment::Map(image)] {
        for max_bounces in [0, 3] {
            let picture = |shines: bool| {
                let path = path(scene(&environment, shines), Settings { max_bounces, ..SETTINGS });
                let counts = render(&path, 8192, &harness::tracer(path.frame().scene()));
                (path.film().resolve(), counts)
            };
            let ((all, followed), (some, ended)) = (picture(true), picture(false));
            assert!(all == some, "{max_bounces} bounces, {environment:?}");
            let most = if max_bounces == 0 { followed.continuation / 4 } else { followed.continuation - 1 };
            assert!(ended.continuation <= most, "{ended:?}, {followed:?}");
            let to_the_sky = ended.shadow - followed.shadow;
            let black = matches!(environment, Environment::Constant(Vec3::ZERO));
            assert_eq!(to_the_sky > 0, !black);
            assert!(to_the_sky <= followed.continuation - ended.continuation);
        }
    }
}

#[test]
fn batches_and_order_do_not_change_a_byte() {
    let scene = room();
    let tracer = harness::tracer(&scene);
    let settings = Settings { width: 150, height: 131, spp: 2, ..SETTINGS };
    let picture = |batch: usize| {
        let path = path(scene.clone(), settings);
        let counts = render(&path, batch, &tracer);
        (path.film().resolve(), counts)
    };
    let (whole, counts) = picture(8192);
    assert_eq!(counts.camera, 150 * 131 * 2);
    assert!(counts.shadow > counts.camera / 2 && counts.continuation > counts.camera);
    assert_eq!((whole, counts), picture(77));
}

#[test]
fn tiles_go_over_the_picture_once_for_every_few_samples() {
    // 171 blocks; 5 of 3 samples a tile, or 1 of 14 samples.
    for (spp, tiles, together, tile_rays) in [(3, 35, 3, 15 * 256), (28, 171, 14, 14 * 256)] {
        let settings = Settings { width: 300, height: 129, spp, ..SETTINGS };
        let path = path(furnace(Material::fallback(), 0, false), settings);
        assert_eq!(path.tiles(), tiles * u64::from(spp / together));
        assert_eq!(path.tile_rays(), tile_rays);
        let (mut rays, mut payloads) = (Vec::new(), Vec::new());
        for tile in 0..path.tiles() {
            harness::spawn(&path, tile, &mut rays, &mut payloads);
            assert!(rays.len() <= path.tile_rays());
            rays.clear();
            payloads.clear();
            if (tile + 1) % tiles == 0 {
                let done = (tile + 1) / tiles * u64::from(together);
                assert!(path.film().sample_counts().iter().all(|&n| u64::from(n) == done));
            }
        }
    }
}

#[test]
fn bodies_absorb_by_the_way_through_them() {
    let pixels = picture(ink(), Settings { width: 25, height: 25, spp: 4, ..SETTINGS });
    let (middle, beside) = (pixels[12 * 25 + 12], pixels[0]);
    assert!((middle - Vec3::new(0.5, 0.25, 1.0)).abs().max_element() < 2e-3, "{middle}");
    assert_eq!(beside, Vec3::ONE);
}

#[test]
fn a_mix_is_on_average_its_parts_in_proportion() {
    // A quarter of a third, three quarters of it, and the rest.
    for texture in [false, true] {
        let mut scene = furnace(Material::matte("a", Vec3::new(0.8, 0.2, 0.4)), 2, false);
        let b = add_material(&mut scene, Material::matte("b", Vec3::new(0.1, 0.9, 0.5)));
        let c = add_material(&mut scene, of(Surface::Mirror { reflectance: Colour::constant(Vec3::X) }));
        scene.textures.push(Texture { texels: [[51, 0, 0, 255]; 64].into(), ..bumps() });
        let mut quarter = Scalar::constant(0.25);
        if texture {
            quarter = Scalar { factor: 1.25, texture: Some((TextureRef::plain(0), Channel::R)) };
        }
        let inner = add_mix(&mut scene, [b, c], quarter);
        let mix = add_mix(&mut scene, [0, inner], Scalar::constant(1.0 / 3.0));
        scene.mesh.materials.fill(mix);
        // The sphere fills the middle of the picture.
        let pixels = picture(scene, Settings { spp: 1024, max_bounces: 1, ..SETTINGS });
        let light = (8..16).map(|y| mean(&pixels[24 * y + 8..24 * y + 16])).sum::<Vec3>() / 8.0;
        let expected = Vec3::new(1.6 + 0.075 + 0.25, 0.4 + 0.675, 0.8 + 0.375) / 3.0;
        assert!((light - expected).abs().max_element() < 5e-3, "{light} for {expected}");
    }
}

#[test]
fn what_alpha_leaves_is_mixed_as_it_was() {
    // The two decisions about a hit are independent.
    let mut scene = room();
    let (mut counts, n) = ([0u32; 4], 100_000u32);
    let halves = add_mix(&mut scene, [0, 1], Scalar::constant(0.5));
    scene.materials[halves as usize].alpha =
        Alpha { mode: AlphaMode::Blend, value: Scalar::constant(0.5), vertex: false };
    scene.mesh.materials.fill(halves);
    for i in 0..n {
        let [u, v] = Sampler::new(i, 0, 0).pair(0);
        let hit = Hit { t: 1.0, u: 0.5 * u, v: 0.5 * v, primitive: i % 3 };
        let is_there = scene.alpha_accepts(hit.primitive, hit.u, hit.v);
        counts[2 * usize::from(is_there) + material_of(&scene, &hit) as usize] += 1;
    }
    assert!(counts.iter().all(|count| count.abs_diff(n / 4) < n / 100), "{counts:?}");
}

#[test]
fn low_polygons_with_smooth_or_mapped_normals_have_no_black_patches() {
    for surface in [
        Surface::Matte { reflectance: Colour::constant(Vec3::ONE) },
        Surface::Mirror { reflectance: Colour::constant(Vec3::ONE) },
        Surface::Dielectric { ior: 1.5, transmittance: Vec3::ONE },
        principled(|s| s.roughness = Scalar::constant(0.3)).surface,
    ] {
        for mapped in [false, true] {
            let mut scene = furnace(of(surface), 1, true);
            scene.mesh.uvs = scene.mesh.positions.iter().map(|p| Vec2::new(p.x + p.z, p.y - p.z)).collect();
            if mapped {
                scene.textures.push(bumps());
                let texture = TextureRef { scale: Vec2::splat(4.0), ..TextureRef::plain(0) };
                scene.materials[0].normal_map = Some(NormalMap { texture, scale: 1.0 });
            }
            let pixels = picture(scene, Settings { max_bounces: 30, ..SETTINGS });
            let darkest = pixels.iter().fold(f32::INFINITY, |d, p| d.min(p.min_element()));
            let brightest = pixels.iter().fold(0.0f32, |d, p| d.max(p.max_element()));
            assert!(darkest > 0.35, "{surface:?}, mapped {mapped}: a pixel of {darkest}");
            assert!(brightest < 2.0, "{surface:?}, mapped {mapped}: a pixel of {brightest}");
            assert!(mean(&pixels).min_element() > 0.9, "{surface:?}, mapped {mapped}: {}", mean(&pixels));
        }
    }
}

#[test]
fn what_is_far_away_does_not_flicker() {
    // A lamp with a pattern much finer than a pixel, one sample each.
    let picture = |mipmap: bool| {
        let mut scene = Scene::default();
        let mut checks = bumps();
        checks.texels = (0..64u32).map(|i| if (i + i / 8) % 2 == 0 { [255; 4] } else { [0; 4] }).collect();
        if mipmap {
            checks.add_mipmap(Averaging::Light);
        }
        scene.textures.push(checks);
        let mut lamp = shining(1.0, 0.0);
        let radiance = Colour { texture: Some(TextureRef::plain(0)), ..Colour::constant(Vec3::ONE) };
        lamp.emission = lamp.emission.map(|emission| Emission { radiance, ..emission });
        let id = add_material(&mut scene, lamp);
        add_quad(&mut scene, Vec3::new(-9.0, -9.0, -3.0), Vec3::X * 18.0, Vec3::Y * 18.0, id);
        scene.mesh.uvs = scene.mesh.positions.iter().map(|p| Vec2::new(p.x, p.y) * 4.1).collect();
        let pixels = picture(scene, Settings { spp: 1, max_bounces: 0, ..SETTINGS });
        let mean = mean(&pixels).x;
        let spread = pixels.iter().map(|p| (p.x - mean).powi(2)).sum::<f32>() / pixels.len() as f32;
        (mean, spread.sqrt())
    };
    let ((plain, flicker), (filtered, rest)) = (picture(false), picture(true));
    assert!((plain - 0.5).abs() < 0.05 && (filtered - 0.5).abs() < 0.01, "{plain} and {filtered}");
    assert!(flicker > 0.15 && rest < 0.02, "{flicker} without smaller copies, {rest} with them");
}

#[test]
fn smaller_copies_do_not_change_the_light_in_a_room() {
    // Walls of black and white texels, in colours whose bytes have another mean than their light. Whoever looks
    // them up, the camera or a bounce, must see as much light as in the image itself.
    let picture = |mipmap: bool| {
        let mut scene = room();
        let mut checks = bumps();
        checks.space = ColourSpace::Srgb;
        checks.texels = (0..64u32).map(|i| if (i + i / 8) % 2 == 0 { [250; 4] } else { [20; 4] }).collect();
        scene.textures.push(checks);
        let texture = Some(TextureRef { scale: Vec2::splat(0.7), ..TextureRef::plain(0) });
        for material in &mut scene.materials {
            if let Surface::Matte { reflectance } = &mut material.surface {
                *reflectance = Colour { texture, ..Colour::constant(Vec3::ONE) };
            }
        }
        scene.mesh.uvs = scene.mesh.positions.iter().map(|p| Vec2::new(p.x + p.z, p.y - 0.7 * p.z)).collect();
        if mipmap {
            scene.add_mipmaps();
        }
        picture(scene, Settings { spp: 256, ..SETTINGS })
    };
    let [plain, filtered] = [false, true].map(picture);
    assert_ne!(plain, filtered);
    let [plain, filtered] = [plain, filtered].map(|pixels| mean(&pixels));
    assert!((filtered / plain - 1.0).abs().max_element() < 0.005, "{plain} and {filtered}");
}

#[test]
fn every_instruction_set_and_every_batch_size_shades_the_same_picture() {
    let scene = Arc::new(one_of_everything());
    let tracer = harness::tracer(&scene);
    let settings = Settings { spp: 16, max_bounces: 6, ..SETTINGS };
    let picture = |simd: SimdLevel, batch: usize| {
        let path =
            PathTracer::new(scene.clone(), &camera(), settings, Some(2)).expect("valid").with_simd(simd);
        render(&path, batch, &tracer);
        path.film().resolve()
    };
    let expected = picture(SimdLevel::narrowest(), 8192);
    assert!(expected.iter().flatten().sum::<f32>() > 10.0);
    for level in SimdLevel::available() {
        for batch in [8192, 37, 1] {
            assert!(picture(level, batch) == expected, "{level}, batches of {batch}");
        }
    }
}

#[test]
fn settings_out_of_range_are_refused_with_what_is_allowed() {
    let error = |settings: Settings| {
        let scene = Arc::new(furnace(Material::fallback(), 0, false));
        PathTracer::new(scene, &camera(), settings, None).expect_err("out of range").to_string()
    };
    assert_eq!(
        error(Settings { width: 0, ..SETTINGS }),
        "a picture of 0x24 pixels; each side must be at least 1 and the area at most 268435456 pixels"
    );
    assert!(error(Settings { width: 1 << 20, height: 1 << 20, ..SETTINGS }).contains("1048576x1048576"));
    assert!(error(Settings { spp: 0, ..SETTINGS }).starts_with("0 samples per pixel; ask for 1 to 1048576"));
    assert!(error(Settings { spp: u32::MAX, ..SETTINGS }).contains("4294967295"));
    assert!(error(Settings { max_bounces: 5000, ..SETTINGS }).contains("at most 1024"));
    let scene = Arc::new(furnace(Material::fallback(), 0, false));
    let blind = crate::scene::Camera { target: camera().eye, ..camera() };
    assert!(matches!(
        PathTracer::new(scene, &blind, SETTINGS, None),
        Err(SettingsError::Camera(CameraError::View(..)))
    ));
}

#[test]
fn surfaces_that_are_no_lights_show_their_colours_and_light_others_by_chance() {
    let mut scene = Scene::default();
    let radiance = Colour { vertex: true, ..Colour::constant(Vec3::new(1.0, 0.5, 0.25)) };
    let emission = Some(Emission { radiance, two_sided: true, is_light: false });
    let unlit = add_material(&mut scene, Material { emission, ..Material::matte("unlit", Vec3::ZERO) });
    add_cube(&mut scene, 100.0, unlit);
    let white = add_material(&mut scene, Material::matte("white", Vec3::ONE));
    add_cube(&mut scene, 0.5, white);
    scene.mesh.colours = vec![Vec4::new(0.5, 1.0, 1.0, 1.0); scene.mesh.positions.len()];
    assert!(Lights::new(&scene).emitters().is_empty(), "light sampling leaves them out");
    for pixel in picture(scene, Settings { spp: 4, ..SETTINGS }) {
        assert!((pixel - Vec3::new(0.5, 0.5, 0.25)).abs().max_element() < 1e-4, "{pixel}");
    }
}
