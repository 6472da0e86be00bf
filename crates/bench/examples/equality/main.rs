//! Traces millions of rays at every SIMD level, on one and two threads and in random splits, and asserts that
//! not one bit differs; then explains each difference from Embree's robust mode by exact arithmetic.
//!
//! `cargo run --release --example equality -- SCENE [--size WxH] [--eye X,Y,Z --target X,Y,Z] [--embree EMBREE.so]`;
//! SCENE may be a generated scene, as for `raystream bench rays`; 1840x1360, the default, makes up to ten million rays
//! of four kinds.
//!
//! Unsafe code for loading Embree. Invariant 1: the user vouches for the library that they name.
#![allow(unsafe_code, reason = "loads a foreign library; the invariant above")]

mod exact;

use anyhow::{Context, Result, bail};
use clap::Parser;
use glam::Vec3;
use rayon::prelude::*;
use raystream::bvh::Bvh;
use raystream::engine::{PreparedScene, Units};
use raystream::scene::Camera;
use raystream::scene::generate;
use raystream::stream::{Hit, Ray, Tracer};
use raystream::trace::cpu::{CpuTracer, SimdLevel};
use raystream_bench::embree::{BuildOptions, Device, Embree, EmbreeRays, Mode};
use raystream_bench::{Kind, Workload};
use std::path::PathBuf;
use std::sync::Arc;

/// The most differing rays of a kind that are explained one by one.
const EXPLAINED: usize = 40;

/// Not one bit may differ.
#[derive(Parser)]
struct Arguments {
    /// Scene file, or a generated scene as terrain:N.
    scene: PathBuf,
    /// Size of the picture whose rays are traced.
    #[arg(long, value_name = "WxH", value_parser = size, default_value = "1840x1360")]
    size: (u32, u32),
    /// Camera position [default: the scene's, else one that frames it].
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    eye: Option<Vec3>,
    /// Point that the camera looks at.
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    target: Option<Vec3>,
    /// Embree 4's shared library.
    #[arg(long)]
    embree: Option<PathBuf>,
}

fn size(text: &str) -> Result<(u32, u32)> {
    let (width, height) = text.split_once('x').context("write WxH")?;
    Ok((width.parse()?, height.parse()?))
}

fn vector(text: &str) -> Result<Vec3> {
    let numbers: Vec<f32> = text.split(',').map(str::parse).collect::<Result<_, _>>().context("X,Y,Z")?;
    anyhow::ensure!(numbers.len() == 3, "write X,Y,Z, not {text}");
    Ok(Vec3::from_slice(&numbers))
}

fn main() -> Result<()> {
    let Arguments { scene, size: (width, height), eye, target, embree } = Arguments::parse();
    let prepared = PreparedScene::new(Arc::new(generate::scene(&scene)?), &Units::cpu())?;
    let bounds = prepared.scene.bounds();
    let base =
        prepared.scene.camera.unwrap_or_else(|| Camera::framing(&bounds, width as f32 / height as f32));
    let mut camera = base;
    camera.eye = eye.unwrap_or(base.eye);
    camera.target = target.unwrap_or(base.target);
    let workload =
        Workload::new(&prepared.scene, &prepared.bvh, &*prepared.tracers.host, &camera, (width, height))?;
    let kinds = [Kind::Camera, Kind::Bounce, Kind::ShuffledBounce, Kind::SoftShadow];
    let mut total = 0;
    for kind in kinds {
        let rays = workload.rays(kind, kind.orders()[0]);
        let runs = same_everywhere(&prepared.bvh, &rays)?;
        total += rays.len();
        println!("{kind:?}: {} rays, {runs} runs, 0 differences", rays.len());
    }
    println!("{}: {total} rays, the same bits at every level, thread count and split", scene.display());
    if let Some(library) = embree {
        // SAFETY: invariant 1.
        let embree = unsafe { Embree::load(&library) }?;
        let device = embree.device(2)?;
        for kind in kinds {
            beside_embree(&prepared, &device, &workload.rays(kind, kind.orders()[0]), kind)?;
        }
    }
    Ok(())
}

/// Traces the rays in every way; answers how many ways there were.
fn same_everywhere(bvh: &Arc<Bvh>, rays: &[Ray]) -> Result<usize> {
    let mut reference: Option<(Vec<Hit>, Vec<u32>)> = None;
    let mut runs = 0;
    for level in SimdLevel::available() {
        let tracer = CpuTracer::new(bvh.clone(), None, level)?;
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
            let found = pool.install(|| trace(&tracer, rays, runs));
            match &reference {
                None => reference = Some(found),
                Some((hits, occluded)) => {
                    let differ = |(a, b): (&Hit, &Hit)| bytemuck::bytes_of(a) != bytemuck::bytes_of(b);
                    if let Some(ray) = hits.iter().zip(&found.0).position(differ) {
                        bail!("{level}, {threads} threads: ray {ray} {:?}: {:?}", rays[ray], found.0[ray]);
                    }
                    if let Some(ray) = occluded.iter().zip(&found.1).position(|(a, b)| a != b) {
                        bail!("{level}, {threads} threads: occlusion of ray {ray} {:?}", rays[ray]);
                    }
                }
            }
            runs += 1;
        }
    }
    let (hits, occluded) = reference.context("no level at all")?;
    if let Some(ray) = hits.iter().zip(&occluded).position(|(hit, &o)| hit.is_miss() != (o == 0)) {
        bail!("ray {ray} {:?} hits, or is occluded, but not both", rays[ray]);
    }
    Ok(runs)
}

/// Traces the rays in streams of random lengths.
fn trace(tracer: &CpuTracer, rays: &[Ray], seed: usize) -> (Vec<Hit>, Vec<u32>) {
    let (mut hits, mut occluded) = (vec![Hit::NONE; rays.len()], vec![0; rays.len()]);
    let mut streams = Vec::new();
    let (mut rays, mut hits_left, mut occluded_left) = (rays, hits.as_mut_slice(), occluded.as_mut_slice());
    let mut random = seed as u32;
    while !rays.is_empty() {
        random = random.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        // From one ray to 64 thousand, as often short as long.
        let len = (1 << (random >> 28)) + (random >> 8 & 0x7fff) as usize % (1 << (random >> 28));
        let (stream, rest) = rays.split_at(len.min(rays.len()));
        let (hits, hits_rest) = hits_left.split_at_mut(stream.len());
        let (occluded, occluded_rest) = occluded_left.split_at_mut(stream.len());
        streams.push((stream, hits, occluded));
        (rays, hits_left, occluded_left) = (rest, hits_rest, occluded_rest);
    }
    streams.into_par_iter().for_each(|(rays, hits, occluded)| {
        tracer.closest(rays, hits);
        tracer.occluded(rays, occluded);
    });
    (hits, occluded)
}

/// Who is nearer to the exact answer.
#[derive(Default)]
struct Verdicts {
    ours: usize,
    theirs: usize,
    same: usize,
}

/// Lists the rays on which Embree's robust mode differs in hit, or in distance by more than a part in 10⁴.
fn beside_embree(prepared: &PreparedScene, device: &Device<'_>, rays: &[Ray], kind: Kind) -> Result<()> {
    let (mesh, bvh) = (&prepared.scene.mesh, &prepared.bvh);
    let options = BuildOptions { robust: true, ..BuildOptions::default() };
    let scene = device.build(&mesh.positions, &mesh.triangles, None, options)?;
    let mut theirs = EmbreeRays::new(rays, Mode::Packet);
    scene.trace(&mut theirs, false);
    let tracer = CpuTracer::new(bvh.clone(), None, SimdLevel::detect())?;
    let mut ours = vec![Hit::NONE; rays.len()];
    tracer.closest(rays, &mut ours);
    let differs = |&i: &usize| {
        let (a, b) = (ours[i], scene.hit(&theirs, i));
        a.is_miss() != b.is_miss() || !a.is_miss() && (a.t - b.t).abs() > 1e-4 * a.t.abs().max(b.t.abs())
    };
    let differing: Vec<usize> = (0..rays.len()).filter(differs).collect();
    let mut verdicts = Verdicts::default();
    let answers: Vec<_> =
        differing.par_iter().take(EXPLAINED).map(|&i| exact::nearest(bvh, &rays[i])).collect();
    for (&i, exact) in differing.iter().zip(answers) {
        let (a, b) = (ours[i], scene.hit(&theirs, i));
        let t = exact.map_or(f64::INFINITY, |(t, _)| t);
        let far = |hit: Hit| if f64::from(hit.t) == t { 0.0 } else { (f64::from(hit.t) - t).abs() };
        let verdict = match far(a).total_cmp(&far(b)) {
            std::cmp::Ordering::Less => (&mut verdicts.ours, "ours is nearer"),
            std::cmp::Ordering::Greater => (&mut verdicts.theirs, "theirs is nearer"),
            std::cmp::Ordering::Equal => (&mut verdicts.same, "neither is nearer"),
        };
        *verdict.0 += 1;
        let side = |hit: Hit| {
            let own =
                (!hit.is_miss()).then(|| exact::crossing(&rays[i], bvh.corners(hit.primitive))).flatten();
            format!("t {} on {} (whose exact t is {own:?})", hit.t, hit.primitive as i32)
        };
        println!("  ray {i}: ours {}, Embree {}, exact {exact:?}: {}", side(a), side(b), verdict.1);
    }
    println!(
        "{kind:?}: {} of {} rays differ from Embree robust; of {} explained ours is nearer to the exact answer in {}, \
         Embree's in {}, neither in {}",
        differing.len(),
        rays.len(),
        differing.len().min(EXPLAINED),
        verdicts.ours,
        verdicts.theirs,
        verdicts.same
    );
    Ok(())
}
