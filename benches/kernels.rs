//! The kernels by themselves, at each SIMD level of this processor: `cargo bench`, or `cargo bench -- NAME`.
//!
//! Items are ray/triangle tests, rays, samples, directions or splats. For speed beside peers see `raystream bench`.

use divan::counter::ItemsCount;
use divan::{Bencher, Divan, black_box};
use glam::Vec3;
use raystream::bvh::Bvh;
use raystream::engine::{PreparedScene, Units};
use raystream::film::Film;
use raystream::geom::{Sampler, warp};
use raystream::lanes::{Int, LaneTask, Lanes, Mask, Num, SimdLevel, Vector};
use raystream::render::{AovSet, Integrator, Settings};
use raystream::scene::{Camera, Effects, Finish, generate};
use raystream::schedule::{JobOptions, Service, ServiceOptions};
use raystream::shade::Bsdf;
use raystream::shade::bsdf::{Matte, Principled, Smoothness};
use raystream::stream::{Hit, Ray, Tracer};
use raystream::trace::cpu::CpuTracer;
use raystream_bench::triangle_test::{InLanes, count_hits};
use raystream_bench::{Kind, Order, Workload};
use std::sync::Arc;
use std::time::Duration;

fn main() {
    Divan::from_args().max_time(Duration::from_millis(400)).main();
}

/// Items of a task in lanes.
const COUNT: usize = 4096;

/// The canonical ray/triangle test, rays in lanes.
mod triangle_test {
    use super::*;

    #[divan::bench(args = SimdLevel::available())]
    fn hit(bencher: Bencher, level: SimdLevel) {
        test(bencher, level, Vec3::ZERO);
    }

    #[divan::bench(args = SimdLevel::available())]
    fn miss(bencher: Bencher, level: SimdLevel) {
        test(bencher, level, Vec3::X * 40.0);
    }

    fn test(bencher: Bencher, level: SimdLevel, shift: Vec3) {
        const EDGE: usize = 128;
        let ray = |i: usize| Ray::new(Vec3::new(0.01 * i as f32, 0.0, -1.0), Vec3::new(0.01, 0.02, 1.0));
        let triangle = |i: usize| {
            let z = 0.01 * i as f32;
            [Vec3::new(-9.0, -9.0, z), Vec3::new(9.0, -9.0, z), Vec3::new(0.0, 9.0, z)]
                .map(|corner| corner + shift)
        };
        let (rays, triangles): (Vec<_>, Vec<_>) = (0..EDGE).map(|i| (ray(i), triangle(i))).unzip();
        let tests = || count_hits(level, InLanes::Rays, black_box(&rays), black_box(&triangles));
        bencher.counter(ItemsCount::new(EDGE * EDGE)).bench_local(tests);
    }
}

/// Closest hits of up to 16 thousand rays on hills of 80 thousand triangles.
mod traversal {
    use super::*;

    #[divan::bench(args = SimdLevel::available())]
    fn camera_rays(bencher: Bencher, level: SimdLevel) {
        closest(bencher, level, |workload, _| workload.rays(Kind::Camera, Order::Blocks));
    }

    #[divan::bench(args = SimdLevel::available())]
    fn bounces(bencher: Bencher, level: SimdLevel) {
        closest(bencher, level, |workload, _| workload.rays(Kind::Bounce, Order::Blocks));
    }

    /// Rays that skim the hilltops: most of their visits are to inner nodes.
    #[divan::bench(args = SimdLevel::available())]
    fn nodes(bencher: Bencher, level: SimdLevel) {
        closest(bencher, level, |_, bvh| {
            let bounds = bvh.bounds();
            let size = bounds.max - bounds.min;
            let ray = |i: u32| {
                let [u, v] = Sampler::new(0, i, 0).pair(0);
                Ray::new(bounds.min + size * Vec3::new(-0.01, 1.0 - 0.1 * v, u), Vec3::X)
            };
            (0..1 << 14).map(ray).collect()
        });
    }

    fn closest(bencher: Bencher, level: SimdLevel, rays: impl Fn(&Workload, &Bvh) -> Vec<Ray>) {
        let scene = generate::matte(generate::terrain(200));
        let bvh = Arc::new(Bvh::build(&scene.mesh.positions, &scene.mesh.triangles, |_| false));
        let tracer = CpuTracer::new(bvh.clone(), None, level).expect("an available level");
        let camera = Camera::framing(&bvh.bounds(), 1.0);
        let workload = Workload::new(&scene, &bvh, &tracer, &camera, (128, 128)).expect("a view");
        let rays = rays(&workload, &bvh);
        let mut hits = vec![Hit::NONE; rays.len()];
        let trace = || tracer.closest(black_box(&rays), &mut hits);
        bencher.counter(ItemsCount::new(rays.len())).bench_local(trace);
    }
}

/// Owen-scrambled Sobol points in two dimensions.
#[divan::bench(args = SimdLevel::available())]
fn sampler(bencher: Bencher, level: SimdLevel) {
    bencher.counter(ItemsCount::new(COUNT)).bench(|| level.run(Samples));
}

struct Samples;

impl LaneTask for Samples {
    type Output = f32;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> f32 {
        let mut sum = Num::splat(l, 0.0);
        for first in (0..COUNT as u32).step_by(L::LANES) {
            let [u, v] = points(l, first, 0);
            sum = sum + u + v;
        }
        sum.to_array()[0]
    }
}

/// The first sample of as many pixels as there are lanes.
#[inline(always)]
fn points<L: Lanes>(l: L, first: u32, dimension: u32) -> [Num<L>; 2] {
    Sampler::of(Int::iota(l) + Int::splat(l, first), Int::splat(l, 0), 0).two(Int::splat(l, dimension))
}

/// BSDFs; the time includes that of sampling a cosine-weighted `wo`, and `wi` or its random numbers.
mod bsdf {
    use super::*;

    #[divan::bench(args = SimdLevel::available())]
    fn matte_evaluate(bencher: Bencher, level: SimdLevel) {
        scatter(bencher, level, Scatter { is_principled: false, samples: false });
    }

    #[divan::bench(args = SimdLevel::available())]
    fn matte_sample(bencher: Bencher, level: SimdLevel) {
        scatter(bencher, level, Scatter { is_principled: false, samples: true });
    }

    #[divan::bench(args = SimdLevel::available())]
    fn principled_evaluate(bencher: Bencher, level: SimdLevel) {
        scatter(bencher, level, Scatter { is_principled: true, samples: false });
    }

    #[divan::bench(args = SimdLevel::available())]
    fn principled_sample(bencher: Bencher, level: SimdLevel) {
        scatter(bencher, level, Scatter { is_principled: true, samples: true });
    }

    fn scatter(bencher: Bencher, level: SimdLevel, task: Scatter) {
        bencher.counter(ItemsCount::new(COUNT)).bench(|| level.run(black_box(task)));
    }

    #[derive(Clone, Copy)]
    struct Scatter {
        is_principled: bool,
        samples: bool,
    }

    impl LaneTask for Scatter {
        type Output = f32;

        #[inline(always)]
        fn run<L: Lanes>(self, l: L) -> f32 {
            let number = Num::splat(l, 0.5);
            let bsdf = if self.is_principled {
                let [metallic, roughness, clearcoat] = [number; 3];
                let matte = Finish::around(Vector::zero(l));
                let finish = Finish { colour: Vector::grey(number), metallic, roughness, clearcoat, ..matte };
                let (effects, outside) = (Effects::default(), Mask::splat(l, true));
                Bsdf::Principled(Principled::finished(&finish, &effects, &None, outside, Smoothness::EXACT))
            } else {
                Bsdf::Matte(Matte { reflectance: Vector::grey(number) })
            };
            let mut sum = Num::splat(l, 0.0);
            for first in (0..COUNT as u32).step_by(L::LANES) {
                let wo = warp::lanes::cosine_hemisphere(points(l, first, 0));
                let u2 = points(l, first, 1);
                if self.samples {
                    let sample = bsdf.sample(wo, points(l, first, 2)[0], u2);
                    sum = sum + sample.weight.x + sample.wi.z;
                } else {
                    let (value, density) = bsdf.evaluate(wo, warp::lanes::cosine_hemisphere(u2));
                    sum = sum + value.x + density;
                }
            }
            sum.to_array()[0]
        }
    }
}

/// Splats to neighbouring pixels.
#[divan::bench(args = SimdLevel::available())]
fn film_splat(bencher: Bencher, level: SimdLevel) {
    let film = Film::new(COUNT as u32, 1, 1 << 20).expect("not too many splats");
    bencher.counter(ItemsCount::new(COUNT)).bench(|| level.run(Splats(&film)));
}

/// The filter of a moving frame of 768×432 pixels, on two threads.
#[divan::bench(args = SimdLevel::available())]
fn moving_filter(bencher: Bencher, level: SimdLevel) {
    let prepared =
        PreparedScene::new(generate::matte(generate::terrain(200)), &Units::cpu()).expect("a scene");
    let camera = Camera::framing(&prepared.scene.bounds(), 16.0 / 9.0);
    let settings = Settings::new(768, 432).with_spp(1).with_max_bounces(1);
    let path = prepared.path(&camera, settings).expect("a frame");
    let path = Arc::new(path.with_aovs(&AovSet::guides()).expect("layers"));
    let service = Service::new(ServiceOptions::default()).expect("threads");
    let job = prepared.submit(&service, Arc::clone(&path), JobOptions::default()).expect("a job");
    job.wait().expect("rendered");
    let frame = path.frame().with_pass(path.frame().pass().clone()).with_simd(level);
    bencher.counter(ItemsCount::new(768_usize * 432)).bench(|| frame.develop_filtered(path.film(), 2));
}

struct Splats<'a>(&'a Film);

impl LaneTask for Splats<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        for first in (0..COUNT as u32).step_by(L::LANES) {
            let pixel = Int::iota(l) + Int::splat(l, first);
            self.0.splat_lanes(Mask::splat(l, true), pixel, Vector::grey(Num::splat(l, 0.25)));
        }
    }
}

/// A scene from its own files, and from a flat file.
mod flat {
    use super::*;
    use raystream::memory::MemoryBudget;
    use raystream::scene::{flat, load};
    use std::fmt::Write;

    /// A grid of 320 thousand triangles as OBJ, and a shipped scene with textures.
    const SCENES: [&str; 2] = ["a grid.obj", "showcase.json"];
    const EDGE: usize = 400;

    /// The scene's file in a folder, which is made if need be.
    fn file(folder: &tempfile::TempDir, name: &str) -> std::path::PathBuf {
        if !name.ends_with(".obj") {
            return [env!("CARGO_MANIFEST_DIR"), "../../scenes", name].iter().collect();
        }
        let mut text = String::new();
        let at = |x: usize, y: usize| 1 + x + y * (EDGE + 1);
        for (y, x) in (0..=EDGE).flat_map(|y| (0..=EDGE).map(move |x| (y, x))) {
            writeln!(text, "v {x} {y} {}\nvt {} {}", (x * y) % 7, x as f32 * 0.01, y as f32 * 0.01)
                .expect("memory");
        }
        for (y, x) in (0..EDGE).flat_map(|y| (0..EDGE).map(move |x| (y, x))) {
            let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
            writeln!(text, "f {a}/{a} {b}/{b} {c}/{c}\nf {a}/{a} {c}/{c} {d}/{d}").expect("memory");
        }
        let path = folder.path().join(name);
        std::fs::write(&path, text).expect("a disk");
        path
    }

    #[divan::bench(args = SCENES)]
    fn own_files(bencher: Bencher, name: &str) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = file(&folder, name);
        bencher.bench_local(|| load::load(black_box(&path)).expect("a scene"));
    }

    #[divan::bench(args = SCENES)]
    fn flat_file(bencher: Bencher, name: &str) {
        let folder = tempfile::tempdir().expect("a folder");
        let scene = load::load(file(&folder, name)).expect("a scene");
        let path = folder.path().join("scene.flat");
        flat::write(&scene, std::fs::File::create(&path).expect("a file")).expect("a disk");
        bencher.bench_local(|| flat::read(black_box(&path), &MemoryBudget::of_machine()).expect("a scene"));
    }
}
