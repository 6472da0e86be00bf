//! Recursive shaders: the same picture as by hand, any control flow, bounded memory, clear refusals.

use super::harness::{self, Counts, render};
use super::scenes::*;
use crate::render::recursion::{Cx, Recursion, Shader};
use crate::render::{Frame, RecursiveWhitted, Settings, Whitted};
use crate::scene::{Light, LightShape, Material, Scalar, Scene, Surface};
use crate::schedule::{JobOptions, Renderer, Service, ServiceOptions, Tracers};
use crate::shade::arena::{BUCKET, MAX_LOCAL_FREE};
use crate::stream::{Hit, Ray};
use glam::Vec3;
use std::sync::Arc;

const SETTINGS: Settings = Settings::new(24, 20).with_spp(2).with_max_bounces(6).with_seed(3);

fn recursion<S: Shader>(shader: S, scene: &Scene, settings: Settings) -> Recursion<S> {
    Recursion::new(shader, Arc::new(scene.clone()), &camera(), settings).expect("valid settings")
}

fn picture<S: Shader>(shader: S, scene: &Scene, settings: Settings) -> (Vec<[f32; 3]>, Counts) {
    let recursion = recursion(shader, scene, settings);
    let counts = render(&recursion, 700, &harness::tracer(scene));
    assert_eq!(recursion.film().dropped_splats(), 0);
    assert_eq!(recursion.calls().live_entries, 0, "every call has returned");
    (recursion.film().resolve(), counts)
}

/// A room with glass, a pane and more lights than are sampled at once.
fn cabinet(lights: usize) -> Scene {
    let mut scene = room();
    let glass =
        add_material(&mut scene, of(Surface::Dielectric { ior: 1.5, transmittance: Vec3::splat(0.9) }));
    add_sphere(&mut scene, 0.9, 3, false, glass);
    let pane = add_material(
        &mut scene,
        principled(|s| {
            s.roughness = Scalar::constant(0.0);
            s.transmission = Scalar::constant(0.6);
        }),
    );
    let flecked = add_mix(&mut scene, [glass, pane], Scalar::constant(0.7));
    add_quad(&mut scene, Vec3::new(-1.5, -1.5, 1.5), Vec3::X * 2.0, Vec3::Y * 2.0, flecked);
    scene.lights = (0..lights)
        .map(|i| Light {
            name: String::new(),
            intensity: Vec3::new(1.0, 0.8, 0.6),
            shape: LightShape::Point { position: Vec3::new(i as f32 - 1.5, 1.0, 1.8) },
        })
        .collect();
    scene
}

#[test]
fn the_recursive_whitted_gives_the_same_bytes_and_rays_as_the_one_by_hand() {
    for (scene, depth) in
        [(cabinet(0), 0), (cabinet(2), 3), (cabinet(5), 8), (sheets(12, Material::fallback()), 2)]
    {
        let settings = Settings { max_bounces: depth, ..SETTINGS };
        let by_hand = Whitted::new(Arc::new(scene.clone()), &camera(), settings).expect("valid settings");
        let expected = render(&by_hand, 8192, &harness::tracer(&scene));
        let (pixels, counts) = picture(RecursiveWhitted, &scene, settings);
        assert_eq!(counts, expected);
        assert!(pixels == by_hand.film().resolve(), "depth {depth}");
        assert!(depth < 3 || counts.continuation > counts.camera, "{counts:?}");
    }
}

/// Ambient light and one lamp, with every kind of question and control flow.
struct Curious {
    together: bool,
}

impl Shader for Curious {
    type Args = ();
    type Value = Vec3;
    const SHADOW_RAYS: usize = 3;

    fn camera(&self) {}

    async fn shade(&self, cx: Cx<'_, Self>, ray: Ray, hit: Option<Hit>, (): ()) -> Vec3 {
        let Some(hit) = hit else { return Vec3::X };
        let at = cx.surface(&ray, &hit);
        let towards = |to: Vec3| Ray::new(at.origin(at.position, to), to);
        let rays = [at.normal, at.normal + Vec3::X, at.normal - Vec3::Y].map(towards);
        let mut open = 0;
        if self.together {
            open = cx.occluded_each(rays).await.into_iter().filter(|occluded| !occluded).count();
        } else {
            for ray in rays {
                // By the nearest hit, by any hit, or beside another ray: all the same.
                let occluded = match open % 3 {
                    0 => cx.trace(ray).await.is_some(),
                    1 => cx.occluded(ray).await,
                    _ => {
                        let (hit, [occluded]) = cx.trace_with(ray, [ray]).await;
                        assert_eq!(hit.is_some(), occluded);
                        occluded
                    }
                };
                open += usize::from(!occluded);
            }
        }
        Vec3::splat(open as f32)
    }
}

#[test]
fn any_control_flow_gets_the_answers_that_belong_to_it() {
    let scene = cabinet(0);
    let (together, counts) = picture(Curious { together: true }, &scene, SETTINGS);
    let (apart, _) = picture(Curious { together: false }, &scene, SETTINGS);
    assert!(together == apart);
    let seen = |value: f32| together.iter().filter(|p| p[0] == value && p[1] == value).count();
    assert!(seen(1.0) > 2 && seen(2.0) > 20 && seen(3.0) > 20, "{} {} {}", seen(1.0), seen(2.0), seen(3.0));
    // A carrier for each turn that sends nothing but questions.
    assert_eq!(counts.shadow, 3 * counts.continuation);
}

/// Adds light by `LAMPS` shadow rays at each hit, `ROOM` at a time, and goes through all
/// sheets by calling itself `depth` times, each time before or after its own light.
struct Crowd<const ROOM: usize> {
    first: bool,
}

const LAMPS: usize = 7;

impl<const ROOM: usize> Shader for Crowd<ROOM> {
    type Args = u32;
    type Value = Vec3;
    const SHADOW_RAYS: usize = ROOM;

    fn splats(&self, max_bounces: u32) -> u64 {
        1 + LAMPS as u64 * (u64::from(max_bounces) + 1)
    }

    fn camera(&self) -> u32 {
        0
    }

    async fn shade(&self, cx: Cx<'_, Self>, ray: Ray, hit: Option<Hit>, depth: u32) -> Vec3 {
        let Some(hit) = hit else { return Vec3::splat(0.25) };
        let mut beyond = Vec3::ZERO;
        let next = Ray { t_min: hit.t + 1e-3, ..ray };
        if self.first && depth < cx.settings().max_bounces {
            beyond = cx.call(next, depth + 1).await;
        }
        let at = cx.surface(&ray, &hit);
        for lamp in 0..LAMPS {
            let to = at.normal + Vec3::X * (lamp as f32 - 3.0);
            cx.add_unless_occluded(Ray::new(at.origin(at.position, to), to), Vec3::splat(0.5)).await;
        }
        if !self.first && depth < cx.settings().max_bounces {
            beyond = cx.call(next, depth + 1).await;
        }
        beyond + Vec3::Y
    }
}

#[test]
fn shadow_rays_beyond_the_room_for_them_wait_and_none_is_lost() {
    // The sheets leave a gap: lamps are seen from some only.
    let mut scene = sheets(3, Material::fallback());
    add_sphere(&mut scene, 1.0, 2, false, 0);
    let (expected, counts) = picture(Crowd::<64> { first: false }, &scene, SETTINGS);
    let few = picture(Crowd::<2> { first: false }, &scene, SETTINGS);
    let one = picture(Crowd::<1> { first: true }, &scene, SETTINGS);
    assert!(expected == few.0 && expected == one.0);
    assert_eq!((few.1.shadow, one.1.shadow), (counts.shadow, counts.shadow));
    assert!(one.1.continuation > few.1.continuation && few.1.continuation > counts.continuation);
}

#[test]
fn memory_is_bounded_by_paths_in_flight_and_depth_and_spawning_waits_for_it() {
    let scene = Arc::new(sheets(12, Material::fallback()));
    let settings = Settings::new(300, 200).with_spp(2).with_max_bounces(7);
    let service =
        Service::new(ServiceOptions { host_threads: 2, device_thread: false, ..Default::default() })
            .expect("threads");
    let host = Arc::new(harness::tracer(&scene));
    let finish = |in_flight: usize| {
        let crowd = Crowd::<2> { first: true };
        let recursion = Arc::new(Recursion::new(crowd, scene.clone(), &camera(), settings).expect("valid"));
        let options = JobOptions { in_flight: Some(in_flight), ..JobOptions::default() };
        let job = service.submit(recursion.clone(), Tracers::cpu(host.clone()), options).expect("a job");
        let report = job.wait().expect("a picture");
        let used = recursion.calls();
        let tile = recursion.tile_rays();
        assert!(report.max_in_flight <= in_flight && report.max_in_flight >= tile / 2, "{report:?}");
        assert!(used.peak_entries <= 8 * in_flight && used.peak_entries > tile / 2, "{used:?}");
        let spare = 2 * (MAX_LOCAL_FREE + 2 * BUCKET);
        assert!(used.allocated_bytes <= (used.peak_entries + spare) * recursion.call_bytes(), "{used:?}");
        (recursion.film().resolve(), used)
    };
    let (few, small) = finish(8_192);
    let (many, large) = finish(120_000);
    assert!(few == many);
    assert!(small.peak_entries < large.peak_entries, "{small:?} {large:?}");
}

#[test]
fn a_job_of_a_shader_that_breaks_its_word_fails_and_says_why() {
    /// Does what it must not.
    #[derive(Clone, Copy)]
    enum Rude {
        CallsForEver,
        AwaitsTwoThings,
        AwaitsSomethingElse,
    }
    impl Shader for Rude {
        type Args = ();
        type Value = ();
        const SHADOW_RAYS: usize = 0;

        fn camera(&self) {}

        async fn shade(&self, cx: Cx<'_, Self>, ray: Ray, _: Option<Hit>, (): ()) {
            match self {
                Self::CallsForEver => cx.call(ray, ()).await,
                Self::AwaitsTwoThings => {
                    let (mut one, mut two) = (Box::pin(cx.trace(ray)), Box::pin(cx.trace(ray)));
                    std::future::poll_fn(|context| {
                        let first = one.as_mut().poll(context).is_ready();
                        let second = two.as_mut().poll(context).is_ready();
                        if first && second { std::task::Poll::Ready(()) } else { std::task::Poll::Pending }
                    })
                    .await;
                }
                Self::AwaitsSomethingElse => std::future::pending().await,
            }
        }
    }
    use std::future::Future;
    let scene = Arc::new(sheets(2, Material::fallback()));
    let service =
        Service::new(ServiceOptions { host_threads: 1, device_thread: false, ..Default::default() })
            .expect("threads");
    let tracers = Tracers::cpu(Arc::new(harness::tracer(&scene)));
    for (shader, says) in [
        (Rude::CallsForEver, "more than 7 deep"),
        (Rude::AwaitsTwoThings, "one future at a time"),
        (Rude::AwaitsSomethingElse, "only futures of its context"),
    ] {
        let recursion = Recursion::new(shader, scene.clone(), &camera(), SETTINGS).expect("valid settings");
        let job = service.submit(Arc::new(recursion), tracers.clone(), JobOptions::default()).expect("a job");
        let error = job.wait().expect_err("the shader is rude").to_string();
        assert!(error.contains(says), "{error}");
    }
    // The thread's exchange is as new.
    let honest = Arc::new(recursion(RecursiveWhitted, &scene, SETTINGS));
    service.submit(honest, tracers, JobOptions::default()).expect("a job").wait().expect("a picture");
}

#[test]
#[should_panic(expected = "only while the engine polls")]
fn a_context_is_of_no_use_elsewhere() {
    let scene = Arc::new(Scene::default());
    let frame = Frame::new(scene, &camera(), SETTINGS, 9, |_| 1).expect("valid settings");
    Cx::<RecursiveWhitted>::new(&frame).add(Vec3::ONE);
}
