//! Scratch.
use glam::Vec3;
use raystream::bench::{self, Kind, Workload};
use raystream::bvh::Bvh;
use raystream::scene::{Camera, load};
use raystream::stream::{Hit, Tracer};
use raystream::trace::cpu::*;
use std::sync::Arc;
use std::time::Instant;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let s = "/work/shared/scenes/";
    let cam = |e: [f32; 3], t: [f32; 3], f: f32| Camera {
        eye: e.into(),
        target: t.into(),
        up: Vec3::Y,
        fov_degrees: f,
    };
    let var = |n: &str, d: usize| std::env::var(n).map_or(d, |r| r.parse().unwrap());
    let rounds = var("ROUNDS", 5);
    let stream = var("STREAM", 131072);
    let levels: Vec<SimdLevel> = std::env::var("SIMD")
        .map_or(vec![SimdLevel::detect()], |l| l.split(',').map(|x| x.parse().unwrap()).collect());
    let kinds = std::env::var("KINDS").unwrap_or("camera,bounce,shuffled,shadow,occluded".into());
    for name in a[1].split(',') {
        let file = |p: &str| {
            let s = load::load(std::path::Path::new(p)).unwrap();
            (s.mesh.positions.clone(), s.mesh.triangles.clone())
        };
        let ((p, t), c) = match name {
            "terrain" => (bench::meshes::terrain(750), cam([-30.0, 14.0, 60.0], [0.0, 0.0, 0.0], 50.0)),
            "fur" => (bench::meshes::fur(230_000), cam([0.0, 0.5, 3.2], [0.0; 3], 45.0)),
            "sponza" => {
                (file(&format!("{s}sponza/sponza.obj")), cam([-115.0, 15.0, -2.0], [60.0, 30.0, 2.0], 60.0))
            }
            "dragon" => (
                file(&format!("{s}stanford-dragon/dragon_vrip.ply")),
                cam([-0.12, 0.2, 0.36], [-0.006, 0.122, 0.0], 30.0),
            ),
            "kitchen" => (
                file(&format!("{s}country-kitchen/country-kitchen.glb")),
                cam([1.21101, 1.80475, 3.85239], [-0.1033, 1.6797, 1.1585], 35.98),
            ),
            "ship" => (
                file(&format!("{s}dutch-ship/dutch_ship_medium_1k.gltf")),
                cam([-26.0, 11.0, 36.0], [1.5, 9.5, 0.0], 35.0),
            ),
            "tujunga" => (
                file(&format!("{s}tujunga-terrain/tujunga-terrain.glb")),
                cam([-9000.0, 3000.0, 9400.0], [2000.0, 700.0, -2500.0], 40.0),
            ),
            x => panic!("{x}"),
        };
        let bvh = Arc::new(Bvh::build(&p, &t, |_| false));
        let tracer = CpuTracer::new(bvh.clone(), None, SimdLevel::detect()).unwrap();
        let w = Workload::new(&bvh, &tracer, &c, 1024, 1024).unwrap();
        for level in &levels {
            let tracer = CpuTracer::new(bvh.clone(), None, *level).unwrap();
            let mut line = format!("{name:8} {level}");
            for k in kinds.split(',') {
                let kind = match k {
                    "camera" => Kind::Camera,
                    "bounce" => Kind::Bounce,
                    "shuffled" => Kind::ShuffledBounce,
                    "shadow" => Kind::SoftShadow,
                    _ => Kind::OccludedBounce,
                };
                let rays = w.rays(kind);
                let mut hits = vec![Hit::NONE; rays.len()];
                let mut occ = vec![0u32; rays.len()];
                let mut best = f64::INFINITY;
                for _ in 0..rounds {
                    let start = Instant::now();
                    for i in (0..rays.len()).step_by(stream) {
                        let e = (i + stream).min(rays.len());
                        if kind.is_any_hit() {
                            tracer.occluded(&rays[i..e], &mut occ[i..e])
                        } else {
                            tracer.closest(&rays[i..e], &mut hits[i..e])
                        }
                    }
                    best = best.min(start.elapsed().as_secs_f64());
                }
                let h = if kind.is_any_hit() {
                    xxhash_rust::xxh3::xxh3_64(bytemuck::cast_slice(&occ))
                } else {
                    xxhash_rust::xxh3::xxh3_64(bytemuck::cast_slice(&hits))
                };
                line += &format!("  {k} {:.2} {:04x}", rays.len() as f64 / best / 1e6, h & 0xffff);
            }
            println!("{line}");
        }
    }
}
