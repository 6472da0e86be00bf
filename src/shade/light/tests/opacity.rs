//! Light samples of emitters that rays may pass: alpha counts, and those whose opacity is computed are left out.

use super::*;
use crate::lanes::Lanes;
use crate::scene::{
    Alpha, AlphaMode, Effects, Finish, Mix, Points, Procedural, ProceduralSurface, Scalar, Surface,
};
use crate::shade::LitScene;
use crate::stream::{Hit, Tracer};
use crate::trace::cpu::CpuTracer;
use std::sync::Arc;

/// Alpha that is the red channel of texture 0.
fn by_texture() -> Scalar {
    Scalar { factor: 1.0, texture: Some((TextureRef::plain(0), Channel::R)) }
}

/// A lamp of radiance 4 above the origin.
fn lamp(alpha: Alpha) -> Scene {
    let mut scene = Scene { textures: everything().textures, ..Scene::default() };
    add_square(&mut scene, 1.0, Material { alpha, ..shining(Colour::constant(Vec3::splat(4.0)), false) });
    scene
}

/// [`irradiance`] by rays that find the lamp by chance.
fn irradiance_by_chance(scene: Scene, from: Vec3, samples: u32) -> f32 {
    let mesh = &scene.mesh;
    let bvh = crate::bvh::Bvh::build(&mesh.positions, &mesh.triangles, |triangle| scene.is_masked(triangle));
    let scene = Arc::new(scene);
    let filter = Some(Arc::clone(&scene) as Arc<dyn crate::bvh::Filter>);
    let tracer = CpuTracer::new(Arc::new(bvh), filter, SimdLevel::detect()).expect("an available level");
    let upwards = |i| warp::cosine_hemisphere(Sampler::new(9, i, 4).pair(0));
    let rays: Vec<Ray> =
        (0..samples).map(upwards).map(|wi| Ray::new(from, Vec3::new(wi.x, wi.z, wi.y))).collect();
    let mut hits = vec![Hit::NONE; rays.len()];
    tracer.closest(&rays, &mut hits);
    PI * 4.0 * hits.iter().filter(|hit| !hit.is_miss()).count() as f32 / samples as f32
}

#[test]
fn emitters_shine_as_far_as_alpha_covers_them() {
    let whole = irradiance(&lamp(Alpha::default()), Vec3::ZERO, 1 << 16).x;
    let half = Alpha { mode: AlphaMode::Blend, value: Scalar::constant(0.5), vertex: false };
    let masked = |cutoff| Alpha { mode: AlphaMode::Mask { cutoff }, value: by_texture(), vertex: false };
    let blended = Alpha { mode: AlphaMode::Blend, ..masked(0.0) };
    for (alpha, share) in [(half, 0.5), (masked(0.5), 0.5), (masked(0.0), 1.0), (blended, 0.5)] {
        let found = irradiance(&lamp(alpha), Vec3::ZERO, 1 << 16).x / whole;
        assert!((found - share).abs() < 0.01, "{found} for {share}: {alpha:?}");
        // Seen from a side, where the halves differ.
        let from = Vec3::new(0.7, 0.2, -0.3);
        let found = irradiance(&lamp(alpha), from, 1 << 15).x;
        let by_chance = irradiance_by_chance(lamp(alpha), from, 1 << 17);
        assert!((found / by_chance - 1.0).abs() < 0.015, "{found} and {by_chance}: {alpha:?}");
    }
    let gone = Alpha { value: Scalar::constant(0.0), ..half };
    assert!(Lights::new(&lamp(gone)).emitters().is_empty(), "nothing is left to sample");
}

#[test]
fn emitters_follow_the_alpha_of_another_appearance() {
    let alpha = Alpha { mode: AlphaMode::Blend, value: by_texture(), vertex: false };
    let old = Arc::new(lamp(alpha));
    let change = |change: fn(&mut Scene)| {
        let mut scene = Scene::clone(&old);
        change(&mut scene);
        let scene = Arc::new(scene);
        let power =
            LitScene::from(Arc::clone(&old)).with_scene(Arc::clone(&scene)).lights().emitters().power();
        assert_eq!(power, Lights::new(&scene).emitters().power());
        power
    };
    let powers = [
        change(|_| ()),
        change(|scene| scene.materials[0].alpha.value.factor = 0.25),
        change(|scene| scene.materials[0].alpha = Alpha::default()),
        change(|scene| scene.textures[0].texels = [[255; 4]; 2].into()),
    ];
    assert!(powers[1] < powers[0] && powers[0] < powers[2] && powers[2] == powers[3], "{powers:?}");
}

/// A surface that is there by chance.
#[derive(Debug)]
struct Gauze;

impl Procedural for Gauze {
    fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
        Finish { opacity: Num::splat(points.lanes(), 0.3), ..Finish::matte(points) }
    }

    fn effects(&self) -> Effects {
        Effects::default().opacity()
    }
}

#[test]
fn emitters_of_computed_opacity_are_not_sampled() {
    let gauze = |surface| {
        let mut scene = lamp(Alpha::default());
        scene.procedurals.push(ProceduralSurface::new(Gauze));
        let of = Surface::Procedural(0);
        scene.materials.push(Material { surface: of, ..scene.materials[0].clone() });
        scene.mixes.push(Mix { of: [1, 1], share: Scalar::constant(0.5) });
        scene.materials[0].surface = surface;
        Arc::new(scene)
    };
    let plain = LitScene::from(gauze(Surface::Matte { reflectance: Colour::constant(Vec3::ONE) }));
    assert_eq!(plain.lights().emitters().len(), 2);
    for surface in [Surface::Procedural(0), Surface::Mix(0)] {
        let scene = gauze(surface);
        for lights in [Lights::new(&scene), Lights::clone(plain.with_scene(Arc::clone(&scene)).lights())] {
            assert!(lights.emitters().is_empty());
            let to = receiver(Vec3::ZERO, Vec3::Y);
            assert_eq!(pdf_emitter(&lights, &to, 0, 1.0, 1.0), 0.0);
            let (up, far) = (Vector::from(Vec3::Y), Num::from(f32::MAX));
            assert!(lights.emitter_bounds().lies_ahead(Vec3::ZERO.into(), up, far).get(), "rays find it");
        }
    }
}
