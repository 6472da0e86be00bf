//! Times queries of a million rays and points on one thread, each beside the way that one would go without it.
//!
//! `cargo run --release -p raystream-rays --example query_speed [ROWS]`

use raystream_rays::glam::{Affine3A, Quat, Vec3};
use raystream_rays::query::{
    HitColumns, Mesh, NearestColumns, Points, Range, Ray, RayQueries, Rays, Rule, World,
};
use std::error::Error;
use std::f32::consts::PI;
use std::hint::black_box;
use std::time::Instant;

/// A number of -1 to 1.
fn signed(i: u32) -> f32 {
    let mut x = i.wrapping_mul(0x9e37_79b9) ^ 0x5bd1_e995;
    x = (x ^ (x >> 16)).wrapping_mul(0x85eb_ca6b);
    x = (x ^ (x >> 13)).wrapping_mul(0xc2b2_ae35);
    ((x ^ (x >> 16)) >> 8) as f32 / (1 << 23) as f32 - 1.0
}

fn vector(i: u32) -> Vec3 {
    Vec3::new(signed(3 * i), signed(3 * i + 1), signed(3 * i + 2))
}

/// A sphere with bumps of `2 * rows * rows` triangles.
fn sphere(rows: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let corner = |i: u32| {
        let (u, v) = (i % (2 * rows), i / (2 * rows));
        if v == 0 || v == rows / 2 {
            return if v == 0 { -Vec3::Z } else { Vec3::Z };
        }
        let (a, b) = (u as f32 / rows as f32 * PI, (v as f32 / (rows / 2) as f32 - 0.5) * PI);
        let p = Vec3::new(b.cos() * a.cos(), b.cos() * a.sin(), b.sin());
        p * (1.0 + 0.1 * (9.0 * p.x).sin() * (8.0 * p.y).sin() * (7.0 * p.z).sin() + 0.002 * signed(i))
    };
    let positions = (0..2 * rows * (rows / 2 + 1)).map(corner).collect();
    let square = |i: u32| {
        let (u, v) = (i % (2 * rows), i / (2 * rows));
        let next = (u + 1) % (2 * rows);
        let at = |u: u32, v: u32| v * 2 * rows + u;
        [[at(u, v), at(next, v), at(next, v + 1)], [at(u, v), at(next, v + 1), at(u, v + 1)]]
    };
    (positions, (0..rows * rows).flat_map(square).collect())
}

/// Nanoseconds that this thread has run: what other programs do does not count. (Of the wall clock, where Linux's count
/// is missing.)
fn nanoseconds(start: Instant) -> f64 {
    let count = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let count = count.and_then(|count| count.split(' ').next()?.parse().ok());
    count.unwrap_or_else(|| start.elapsed().as_secs_f64() * 1e9)
}

/// Medians of contenders that take turns, in nanoseconds a row.
fn race(title: &str, rows: usize, contenders: &mut [(&str, &mut dyn FnMut())]) {
    let (mut times, start) = (vec![Vec::new(); contenders.len()], Instant::now());
    for round in 0..6 {
        for (times, (_, run)) in times.iter_mut().zip(contenders.iter_mut()) {
            let begin = nanoseconds(start);
            run();
            if round > 0 {
                times.push((nanoseconds(start) - begin) / rows as f64);
            }
        }
    }
    print!("{title:<34}");
    for (times, (name, _)) in times.iter_mut().zip(contenders) {
        times.sort_by(f64::total_cmp);
        print!("  {name} {:.1} ns", times[times.len() / 2]);
    }
    println!();
}

fn main() -> Result<(), Box<dyn Error + Send + Sync>> {
    let rows: u32 = std::env::args().nth(1).map_or(Ok(400), |rows| rows.parse())?;
    rayon_one()?.install(|| run(rows))
}

fn rayon_one() -> Result<rayon::ThreadPool, rayon::ThreadPoolBuildError> {
    rayon::ThreadPoolBuilder::new().num_threads(1).build()
}

fn run(rows: u32) -> Result<(), Box<dyn Error + Send + Sync>> {
    let (positions, triangles) = sphere(rows);
    let mesh = Mesh::build(&positions, &triangles)?;
    println!(
        "{} triangles, {} open edges, {:?}",
        mesh.triangle_count(),
        mesh.open_edges(),
        mesh.tracer().simd()
    );
    let random: Vec<Ray> = (0..1 << 18)
        .map(|i| {
            let from = 2.0 * vector(2 * i).normalize_or(Vec3::X);
            Ray::new(from, 1.1 * vector(2 * i + 1) - from)
        })
        .collect();
    let coherent: Vec<Ray> = (0..1 << 18u32)
        .map(|i| {
            Ray::new([0.0, 0.1, 3.0], [(i % 512) as f32 / 512.0 - 0.5, (i / 512) as f32 / 512.0 - 0.5, -1.0])
        })
        .collect();
    for (name, rays) in [("random", &random), ("coherent", &coherent)] {
        race_rays(name, &mesh, rays);
    }
    race_points(&mesh);
    race_moves(&mesh)
}

fn race_rays(name: &str, mesh: &Mesh, all: &[Ray]) {
    let count = all.len();
    let rays = Rays::from(all);
    let packed: Vec<[f32; 6]> = all
        .iter()
        .map(|ray| {
            let ([a, b, c], [d, e, f]) = (ray.origin, ray.direction);
            [a, b, c, d, e, f]
        })
        .collect();
    let packed = Rays::Rows(&packed, Range::default());
    let (mut t, mut primitive) = (vec![0.0; count], vec![0; count]);
    let (mut t2, mut primitive2, mut normal) = (vec![0.0; count], vec![0; count], vec![[0.0; 3]; count]);
    let mut normal2 = vec![[0.0f32; 3]; count];
    race(
        &format!("{name}: t, primitive"),
        count,
        &mut [
            ("closest", &mut || drop(black_box(mesh.closest(all)))),
            ("cast", &mut || {
                let columns =
                    HitColumns { t: Some(&mut t), primitive: Some(&mut primitive), ..HitColumns::default() };
                mesh.cast(&packed, Rule::Closed, &mut { columns });
            }),
            ("cast half-open", &mut || {
                let columns = HitColumns {
                    t: Some(&mut t2),
                    primitive: Some(&mut primitive2),
                    ..HitColumns::default()
                };
                mesh.cast(&packed, Rule::HalfOpen, &mut { columns });
            }),
        ],
    );
    race(
        &format!("{name}: t, primitive, normal"),
        count,
        &mut [
            ("cast", &mut || {
                let columns = HitColumns {
                    t: Some(&mut t),
                    primitive: Some(&mut primitive),
                    normal: Some(&mut normal),
                    ..HitColumns::default()
                };
                mesh.cast(&packed, Rule::Closed, &mut { columns });
            }),
            ("normals afterwards", &mut || {
                let hits = mesh.closest(all);
                normal2.iter_mut().zip(&hits).for_each(|(n, hit)| *n = mesh.normal(hit).to_array());
            }),
        ],
    );
    race_all_hits(name, mesh, all, &packed);
    let mut occluded = vec![false; count];
    race(
        &format!("{name}: occluded"),
        count,
        &mut [
            ("cast_occluded", &mut || mesh.cast_occluded(&rays, Rule::Closed, &mut occluded)),
            ("half-open", &mut || mesh.cast_occluded(&rays, Rule::HalfOpen, &mut vec![false; count])),
        ],
    );
}

/// Counts and lists of all hits.
fn race_all_hits(name: &str, mesh: &Mesh, all: &[Ray], packed: &Rays<'_>) {
    let count = all.len();
    let mut counts = vec![0; count];
    let mut counts2 = vec![0usize; count];
    race(
        &format!("{name}: count"),
        count,
        &mut [
            ("count_hits", &mut || mesh.count_hits(packed, Rule::HalfOpen, &mut counts)),
            ("from all_hits", &mut || {
                let (_, ranges) = mesh.all_hits(all);
                counts2.iter_mut().zip(ranges).for_each(|(count, range)| *count = range.len());
            }),
        ],
    );
    println!("{:<34}  {:.2} hits a ray", "", counts.iter().sum::<u32>() as f64 / count as f64);
    race(
        &format!("{name}: all hits"),
        count,
        &mut [
            ("list_hits", &mut || drop(black_box(mesh.list_hits(packed, Rule::HalfOpen, usize::MAX)))),
            ("all_hits", &mut || drop(black_box(mesh.all_hits(all)))),
        ],
    );
}

fn race_points(mesh: &Mesh) {
    let points: Vec<[f32; 3]> = (0..1 << 16).map(|i| (1.2 * vector(i)).to_array()).collect();
    let count = points.len();
    let all = Points::F32(&points);
    let (mut distance, mut inside, mut signed) = (vec![0.0; count], vec![false; count], vec![0.0; count]);
    race(
        "points: nearest",
        count,
        &mut [
            ("nearest_points", &mut || {
                let mut columns =
                    NearestColumns { distance: Some(&mut distance), ..NearestColumns::default() };
                mesh.nearest_points(&all, f32::INFINITY, &mut columns);
            }),
            ("one by one", &mut || {
                for &point in &points {
                    black_box(mesh.nearest_point(point, f32::INFINITY));
                }
            }),
        ],
    );
    race(
        "points: sides",
        count,
        &mut [
            ("contains", &mut || mesh.contains_by_parity(&all, &mut inside)),
            ("signed distance", &mut || mesh.signed_distances_by_parity(&all, &mut signed)),
        ],
    );
}

fn race_moves(mesh: &Mesh) -> Result<(), Box<dyn Error + Send + Sync>> {
    let at = |i: u32, step: u32| {
        Affine3A::from_rotation_translation(
            Quat::from_rotation_y(0.01 * step as f32 + i as f32).normalize(),
            40.0 * vector(i),
        )
    };
    let instances: Vec<(Mesh, Affine3A)> = (0..1000).map(|i| (mesh.clone(), at(i, 0))).collect();
    let mut world = World::build(&instances)?;
    let steps: Vec<Vec<Affine3A>> = (1..100).map(|step| (0..1000).map(|i| at(i, step)).collect()).collect();
    let mut moved = || steps.iter().for_each(|step| world.move_instances(step).expect("finite"));
    race("a move of 1000 instances", steps.len(), &mut [("move_instances", &mut moved)]);
    Ok(())
}
