//! `raystream bench rays`: our tracer at each SIMD level beside the scalar reference, obvhs and
//! Embree, and devices, on the same rays, in one process, in rounds that take turns.

use super::embree::{Embree, EmbreeError, EmbreeRays, EmbreeScene, Mode};
use super::{Kind, Spread, Workload};
use crate::bvh::Bvh;
use crate::query::in_shares;
use crate::stream::{Capacity, DeviceError, DeviceTracer, Empty, Hit, Ray, RayStream, Traced, Tracer};
use crate::trace::cpu::{CpuTracer, Oracle, SimdLevel, SingleRayTracer};
use glam::{Vec3, Vec3A};
use obvhs::cwbvh::CwBvh;
use obvhs::triangle::Triangle;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// What to measure.
#[derive(Clone, Debug)]
pub struct Options {
    /// Kinds of rays.
    pub kinds: Vec<Kind>,
    /// Rounds; each unit is timed once a round.
    pub rounds: usize,
    /// Numbers of threads.
    pub threads: Vec<usize>,
    /// Levels of our tracer.
    pub levels: Vec<SimdLevel>,
    /// The most rays that a thread gets at a time.
    pub share_rays: usize,
    /// Embree's shared library; without it its rows are missing.
    pub embree: Option<PathBuf>,
    /// Whether the slow units (the scalar reference and obvhs) take part, on one ray in eight.
    pub slow_units: bool,
    /// Whether runs on one thread count the time for which it ran, not the time that passed: on a busy
    /// machine that leaves out most of what others do. Only Linux tells.
    pub processor_time: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            kinds: Kind::ALL.to_vec(),
            rounds: 7,
            threads: vec![1],
            levels: SimdLevel::available(),
            share_rays: 32 * 1024,
            embree: None,
            slow_units: true,
            processor_time: false,
        }
    }
}

/// One unit's speed on one kind of ray.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Kind of ray.
    pub kind: Kind,
    /// Who traced.
    pub unit: String,
    /// Number of threads.
    pub threads: usize,
    /// Our SIMD level, if it is ours.
    pub simd: Option<&'static str>,
    /// How fast: millions of rays per second over the rounds.
    pub mray_per_s: Spread,
    /// Ratio of medians against each of: `embree` (its best mode), `embree_robust` (its best robust
    /// mode), `obvhs`, `scalar`, and, where a device takes part, `cpu` (our tracer's best level), with as many threads; and
    /// against itself with `one_thread`, where that was measured.
    pub ratio: BTreeMap<&'static str, f64>,
}

/// How our hits compare with those of Embree's robust mode.
#[derive(Clone, Debug, Serialize)]
pub struct Agreement {
    /// Kind of ray.
    pub kind: Kind,
    /// Number of rays.
    pub rays: usize,
    /// Rays of which one hit something and the other nothing.
    pub hit_or_miss: usize,
    /// Rays with hits whose `t` differ by more than a part in 10⁴.
    pub distance: usize,
    /// Largest relative difference of `t` among the other hits.
    pub largest_t_difference: f32,
    /// The first rays that disagree, by index.
    pub examples: Vec<usize>,
}

/// All results for one scene.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Report {
    /// Speeds.
    pub rows: Vec<Row>,
    /// Comparisons of hits; empty without Embree.
    pub agreement: Vec<Agreement>,
}

/// A participant: traces all rays once and answers the seconds that took.
struct Unit<'a> {
    name: String,
    threads: usize,
    simd: Option<&'static str>,
    robust: bool,
    rays: usize,
    round: Box<dyn FnMut() -> f64 + 'a>,
}

/// Why there are no results.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// Embree was asked for and is not there.
    #[error(transparent)]
    Embree(#[from] EmbreeError),
    /// The device is lost.
    #[error(transparent)]
    Device(#[from] DeviceError),
}

/// Measures every unit on every kind of ray. `bvh` must have been built from these triangles; `devices`
/// trace them.
///
/// # Errors
/// When Embree was asked for and is not there, or a device is lost.
pub fn run(
    bvh: &Arc<Bvh>,
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    workload: &Workload,
    devices: &[Arc<dyn DeviceTracer>],
    options: &Options,
) -> Result<Report, BenchError> {
    let mut report = Report::default();
    let threads = options.threads.iter().copied().max().unwrap_or(1);
    let embree = options.embree.as_deref().map(|path| Embree::load(path, threads)).transpose()?;
    let mut scenes = Vec::new();
    if let Some(embree) = &embree {
        for robust in [false, true] {
            scenes.push(embree.scene(positions, triangles, robust)?);
        }
    }
    let obvhs = options.slow_units.then(|| Obvhs::new(bvh));
    let pool = |&threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pools: Result<Vec<_>, _> = options.threads.iter().map(pool).collect();
    let pools = pools.expect("threads can be started");
    for &kind in &options.kinds {
        let rays = workload.rays(kind);
        let few: Vec<Ray> = rays.chunks(1024).step_by(8).flatten().copied().collect();
        let mut units = Vec::new();
        for (pool, &threads) in pools.iter().zip(&options.threads) {
            let clock = Clock { pool, processor_time: options.processor_time && threads == 1 };
            let mut with_these = our_units(bvh, rays, kind, clock, options);
            for device in devices {
                with_these.push(device_unit(&**device, rays, kind, clock)?);
            }
            with_these.extend(embree_units(&scenes, rays, kind, clock));
            if let Some(obvhs) = &obvhs {
                with_these.extend(slow_units(bvh, obvhs, &few, kind, clock));
            }
            units.extend(with_these.into_iter().enumerate());
        }
        // The same contender with one and with more threads is timed one after the other, so that what others
        // do to the machine meanwhile changes their ratio little.
        units.sort_by_key(|&(place, _)| place);
        let units = units.into_iter().map(|(_, unit)| unit).collect();
        report.rows.extend(measure(units, kind, options.rounds));
    }
    if let Some(robust) = scenes.last() {
        report.agreement = options.kinds.iter().map(|&kind| compare(bvh, robust, workload, kind)).collect();
    }
    Ok(report)
}

/// How rounds are timed.
#[derive(Clone, Copy)]
struct Clock<'a> {
    pool: &'a rayon::ThreadPool,
    processor_time: bool,
}

impl Clock<'_> {
    fn threads(&self) -> usize {
        self.pool.current_num_threads()
    }

    /// Seconds that `work` takes on the pool.
    fn seconds(&self, work: impl FnOnce() + Send) -> f64 {
        self.pool.install(|| {
            // Who sleeps is woken first: that may take a millisecond, where the system puts two threads on one core.
            rayon::broadcast(|_| ());
            let ran = self.processor_time.then(processor_seconds).flatten();
            let start = Instant::now();
            work();
            let wall = start.elapsed().as_secs_f64();
            let ran = ran.and_then(|before| Some(processor_seconds()? - before));
            ran.filter(|&seconds| seconds > 0.0).unwrap_or(wall)
        })
    }
}

/// Seconds for which the calling thread has run, where the system tells.
fn processor_seconds() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    Some(text.split_whitespace().next()?.parse::<f64>().ok()? * 1e-9)
}

fn our_units<'a>(
    bvh: &Arc<Bvh>,
    rays: &'a [Ray],
    kind: Kind,
    clock: Clock<'a>,
    options: &Options,
) -> Vec<Unit<'a>> {
    let most = options.share_rays;
    let unit = |name: &str, level: SimdLevel, tracer: Box<dyn Tracer>| {
        let (mut hits, mut occluded) = (vec![Hit::NONE; rays.len()], vec![0; rays.len()]);
        let round = move || {
            clock.seconds(|| {
                if kind.is_any_hit() {
                    in_shares(rays, &mut occluded, most, |rays, occluded| tracer.occluded(rays, occluded));
                } else {
                    in_shares(rays, &mut hits, most, |rays, hits| tracer.closest(rays, hits));
                }
            })
        };
        let (name, simd) = (name.to_owned(), Some(level.name()));
        Unit { name, threads: clock.threads(), simd, robust: true, rays: rays.len(), round: Box::new(round) }
    };
    let mut units = Vec::new();
    for &level in &options.levels {
        if let Ok(tracer) = CpuTracer::new(bvh.clone(), None, level) {
            units.push(unit("raystream", level, Box::new(tracer)));
        }
        if let Ok(tracer) = SingleRayTracer::new(bvh.clone(), None, level) {
            units.push(unit("raystream single", level, Box::new(tracer)));
        }
    }
    units
}

/// A device, whole streams at a time: from rays where streams have them to canonical hits there.
fn device_unit<'a>(
    device: &'a dyn DeviceTracer,
    rays: &'a [Ray],
    kind: Kind,
    clock: Clock<'a>,
) -> Result<Unit<'a>, DeviceError> {
    let most = device.max_rays().min(rays.len()).max(1);
    let room = |any_hit: bool| if kind.is_any_hit() == any_hit { most } else { 0 };
    let capacity = Capacity { rays: room(false), shadow_rays: room(true) };
    let fill = move |(stream, rays): (Stream<Empty>, &[Ray])| {
        let mut stream = stream.fill();
        stream.append(capacity, Some(device), |mut columns| {
            let (column, payloads) = match kind.is_any_hit() {
                true => (&mut columns.shadow_rays, columns.shadow_payloads),
                false => (&mut columns.rays, columns.payloads),
            };
            rays.iter().for_each(|&ray| column.push(ray));
            payloads.resize(rays.len(), ());
        });
        stream.seal()
    };
    let mut streams: Vec<Stream<Empty>> = rays.chunks(most).map(|_| RayStream::new()).collect();
    let mut trace = move || -> Result<f64, String> {
        if streams.len() < rays.len().div_ceil(most) {
            return Err("lost in an earlier round".to_owned());
        }
        let full: Vec<_> = streams.drain(..).zip(rays.chunks(most)).map(fill).collect();
        let mut traced = Ok(Vec::new());
        let seconds = clock.seconds(|| {
            traced = full.into_par_iter().map(|stream| stream.trace_on(device)).collect::<Result<_, _>>();
        });
        let traced: Vec<(Stream<Traced>, _)> = traced.map_err(|untraced| untraced.reason)?;
        streams.extend(traced.into_iter().map(|(stream, _)| stream.discard()));
        Ok(seconds)
    };
    // A loss shows before anything is timed; one that comes later makes the round endless, that is, its speed 0.
    trace().map_err(DeviceError::Lost)?;
    let round = move || trace().unwrap_or(f64::INFINITY);
    let name = format!("gpu: {}", device.name());
    let threads = clock.threads();
    Ok(Unit { name, threads, simd: None, robust: true, rays: rays.len(), round: Box::new(round) })
}

/// Rays and nothing with them.
type Stream<State> = RayStream<State, (), ()>;

/// Rays that a thread gives Embree at a time: it takes them sixteen by sixteen, so few do, and threads end together.
const EMBREE_RAYS: usize = 1024;

fn embree_units<'a>(
    scenes: &'a [EmbreeScene<'_>],
    rays: &'a [Ray],
    kind: Kind,
    clock: Clock<'a>,
) -> Vec<Unit<'a>> {
    let mut units = Vec::new();
    for scene in scenes {
        for mode in Mode::ALL {
            let fresh: Vec<EmbreeRays> =
                rays.chunks(EMBREE_RAYS).map(|rays| EmbreeRays::new(rays, mode)).collect();
            let mut used = fresh.clone();
            let round = move || {
                used.clone_from(&fresh);
                let shares = used.par_iter_mut().with_max_len(1);
                clock.seconds(|| shares.for_each(|rays| scene.trace(rays, kind.is_any_hit())))
            };
            let name = format!("embree {}{}", mode.name(), if scene.is_robust() { ", robust" } else { "" });
            let (threads, robust) = (clock.threads(), scene.is_robust());
            units.push(Unit { name, threads, simd: None, robust, rays: rays.len(), round: Box::new(round) });
        }
    }
    units
}

/// obvhs' own tree and traversal.
struct Obvhs {
    tree: CwBvh,
    triangles: Vec<Triangle>,
}

impl Obvhs {
    fn new(bvh: &Bvh) -> Self {
        let triangle = |primitive| {
            let [v0, v1, v2] = bvh.corners(primitive).map(Vec3A::from);
            Triangle { v0, v1, v2 }
        };
        let triangles: Vec<Triangle> = (0..bvh.len() as u32).map(triangle).collect();
        let tree = obvhs::cwbvh::builder::build_cwbvh_from_tris(
            &triangles,
            obvhs::BvhBuildParams::medium_build(),
            &mut Default::default(),
        );
        let triangles = tree.primitive_indices.iter().map(|&i| triangles[i as usize]).collect();
        Self { tree, triangles }
    }

    /// Distance of the nearest hit, or whether there is any as 0; +∞ for none.
    fn trace(&self, ray: &Ray, any: bool) -> f32 {
        use obvhs::ray::{Ray as ObvhsRay, RayHit};
        let ray = ObvhsRay::new(ray.origin.into(), ray.direction.into(), ray.t_min.max(0.0), ray.t_max);
        let test = |ray: &ObvhsRay, id: usize| self.triangles[id].intersect(ray);
        if any {
            return if self.tree.ray_traverse_miss(ray, test) { f32::INFINITY } else { 0.0 };
        }
        let mut hit = RayHit::none();
        if self.tree.ray_traverse(ray, &mut hit, test) { hit.t } else { f32::INFINITY }
    }
}

fn slow_units<'a>(
    bvh: &Arc<Bvh>,
    obvhs: &'a Obvhs,
    rays: &[Ray],
    kind: Kind,
    clock: Clock<'a>,
) -> Vec<Unit<'a>> {
    let oracle = Oracle::new(bvh.clone(), None);
    let any = kind.is_any_hit();
    let rays: Arc<[Ray]> = rays.into();
    let (mut reference, mut theirs) = (vec![0.0; rays.len()], vec![0.0; rays.len()]);
    let same = rays.clone();
    let count = rays.len();
    let scalar = move || {
        let one = |ray: &Ray| if any { oracle.occluded_one(ray).into() } else { oracle.closest_one(ray).t };
        clock.seconds(|| rays.par_iter().map(one).collect_into_vec(&mut reference))
    };
    let other =
        move || clock.seconds(|| same.par_iter().map(|r| obvhs.trace(r, any)).collect_into_vec(&mut theirs));
    let unit = |name: &str, round| {
        let (name, threads) = (name.to_owned(), clock.threads());
        Unit { name, threads, simd: None, robust: false, rays: count, round }
    };
    vec![unit("scalar", Box::new(scalar)), unit("obvhs", Box::new(other))]
}

/// Times the units in turns, whatever their threads.
fn measure(mut units: Vec<Unit<'_>>, kind: Kind, rounds: usize) -> Vec<Row> {
    let mut speeds = vec![Vec::new(); units.len()];
    for round in 0..=rounds {
        for (unit, speeds) in units.iter_mut().zip(&mut speeds) {
            let seconds = (unit.round)();
            // The first round warms caches and scratch memory.
            if round > 0 {
                speeds.push(unit.rays as f64 / seconds * 1e-6);
            }
        }
    }
    let speeds: Vec<Spread> = speeds.into_iter().map(Spread::of_rates).collect();
    let best = |among: &dyn Fn(&Unit<'_>) -> bool| {
        let medians = units.iter().zip(&speeds).filter(|(unit, _)| among(unit)).map(|(_, s)| s.median);
        medians.max_by(f64::total_cmp)
    };
    let ratio = |of: &Unit<'_>, speed: &Spread| {
        let beside = |among: &dyn Fn(&Unit<'_>) -> bool| best(&|u| u.threads == of.threads && among(u));
        let device = units.iter().any(|u| u.name.starts_with("gpu"));
        let alone = |u: &Unit<'_>| u.threads == 1 && (&u.name, u.simd) == (&of.name, of.simd);
        let peers = [
            ("embree", beside(&|u| u.name.starts_with("embree"))),
            ("embree_robust", beside(&|u| u.name.starts_with("embree") && u.robust)),
            ("obvhs", beside(&|u| u.name == "obvhs")),
            ("scalar", beside(&|u| u.name == "scalar")),
            ("cpu", beside(&|u| u.name == "raystream").filter(|_| device)),
            ("one_thread", best(&alone).filter(|_| of.threads > 1)),
        ];
        peers.into_iter().filter_map(|(peer, median)| Some((peer, speed.median / median?))).collect()
    };
    let row = |(unit, speed): (&Unit<'_>, &Spread)| Row {
        kind,
        unit: unit.name.clone(),
        threads: unit.threads,
        simd: unit.simd,
        mray_per_s: *speed,
        ratio: ratio(unit, speed),
    };
    units.iter().zip(&speeds).map(row).collect()
}

fn compare(bvh: &Arc<Bvh>, robust: &EmbreeScene<'_>, workload: &Workload, kind: Kind) -> Agreement {
    let rays = workload.rays(kind);
    let tracer = CpuTracer::new(bvh.clone(), None, SimdLevel::detect()).expect("what is detected is there");
    let mut theirs = EmbreeRays::new(rays, Mode::Packet);
    robust.trace(&mut theirs, kind.is_any_hit());
    let mut result = Agreement {
        kind,
        rays: rays.len(),
        hit_or_miss: 0,
        distance: 0,
        largest_t_difference: 0.0,
        examples: Vec::new(),
    };
    let (mut hits, mut occluded) = (vec![Hit::NONE; rays.len()], vec![0; rays.len()]);
    if kind.is_any_hit() {
        tracer.occluded(rays, &mut occluded);
    } else {
        tracer.closest(rays, &mut hits);
    }
    for i in 0..rays.len() {
        let (ours, other) = (hits[i], theirs.hit(i));
        let difference = (ours.t - other.t).abs() / ours.t.abs().max(other.t.abs()).max(f32::MIN_POSITIVE);
        if kind.is_any_hit() && (occluded[i] == 1) != theirs.is_occluded(i)
            || !kind.is_any_hit() && ours.is_miss() != other.is_miss()
        {
            result.hit_or_miss += 1;
        } else if !kind.is_any_hit() && !ours.is_miss() && difference > 1e-4 {
            result.distance += 1;
        } else {
            if difference > result.largest_t_difference {
                result.largest_t_difference = difference;
            }
            continue;
        }
        if result.examples.len() < 16 {
            result.examples.push(i);
        }
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Camera;

    #[test]
    fn every_unit_gets_a_row_with_its_ratios() {
        let (positions, triangles) = crate::bench::meshes::terrain(20);
        let bvh = Arc::new(Bvh::build(&positions, &triangles, |_| false));
        let camera = Camera::framing(&bvh.bounds(), 1.0);
        let tracer = Oracle::new(bvh.clone(), None);
        let workload = Workload::new(&bvh, &tracer, &camera, 64, 48).expect("a view");
        for kind in Kind::ALL {
            assert!(workload.rays(kind).len() > 100, "{kind:?}");
        }
        let options = Options { rounds: 2, threads: vec![1, 2], ..Options::default() };
        let report =
            run(&bvh, &positions, &triangles, &workload, &[], &options).expect("no Embree asked for");
        assert_eq!(report.rows.len(), 2 * 5 * (2 * SimdLevel::available().len() + 2));
        for row in &report.rows {
            let Spread { median, best, worst } = row.mray_per_s;
            assert!(0.0 < worst && worst <= median && median <= best);
            assert!(row.ratio["scalar"] > 0.0 && !row.ratio.contains_key("embree"));
            assert_eq!(row.ratio.contains_key("one_thread"), row.threads == 2);
            let same = |r: &&Row| (r.kind, &r.unit, r.simd, r.threads) == (row.kind, &row.unit, row.simd, 1);
            let alone = report.rows.iter().find(same).expect("a row of one thread").mray_per_s.median;
            assert!(row.ratio.get("one_thread").is_none_or(|&ratio| ratio == median / alone));
        }
        let missing = Options { embree: Some("nowhere.so".into()), ..options };
        let error = run(&bvh, &positions, &triangles, &workload, &[], &missing).expect_err("no such file");
        assert!(error.to_string().starts_with("nowhere.so: cannot use this"));
    }
}
