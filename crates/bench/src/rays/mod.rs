//! `raystream bench rays`: the CPU tracer at each SIMD level, the service and `query`, beside the scalar reference,
//! obvhs, RTRT's own method ([`crate::rtrt`]), Embree and tinybvh, and GPUs. All trace the same rays in one process, in
//! interleaved rounds.
//!
//! # Fairness
//! - Each contender gets its rays in the order in which it is fastest: before the rounds it traces each kind of ray
//!   in every [`Order`] that suits the kind.
//! - tinybvh ([`crate::tinybvh`]) is represented by its fastest tree of three: eight children with AVX2, with and
//!   without spatial splits, and four with SSE. It traces single rays.
//! - Embree is represented by its fastest mode (single rays, packets of sixteen, packets flagged as coherent) for each
//!   kind of ray. Rays are converted to its layouts before the clock starts.
//! - Users get rays from the service or from `query`, so these have rows beside the bare tracer's. Their time
//!   includes the memory of the answers.
//! - A GPU has two rows: from rays to canonical hits, and its kernels alone, between timestamps of its own.
//! - Scenes with alpha masks are traced with their alpha test by all: by Embree with filter functions that call the
//!   same test. Contenders without an alpha test (`query`, obvhs, RTRT) are left out there.

mod agreement;
mod contender;
mod device;
mod measure;
mod ours;
mod peers;
mod summary;

pub use agreement::Agreement;
pub use summary::{Summary, summarise};

use super::embree::{BuildOptions, Device, EmbreeError, EmbreeScene, Mask};
use super::{Kind, Order, PeerError, Peers, Spread, Workload};
use contender::{Clock, InOrder};
use peers::PeersOfOpaque;
use raystream::engine::PreparedScene;
use raystream::lanes::SimdLevel;
use raystream::schedule::{Service, ServiceError, ServiceOptions};
use raystream::stream::DeviceError;
use serde::Serialize;
use std::collections::BTreeMap;

/// Settings of the measurement.
#[derive(Clone, Debug)]
pub struct Options {
    /// Kinds of rays.
    pub kinds: Vec<Kind>,
    /// Rounds; each contender is timed once a round.
    pub rounds: usize,
    /// Numbers of threads.
    pub threads: Vec<usize>,
    /// SIMD levels of the CPU tracer.
    pub levels: Vec<SimdLevel>,
}

impl Default for Options {
    fn default() -> Self {
        let (kinds, levels) = (Kind::ALL.to_vec(), SimdLevel::available());
        Self { kinds, rounds: 7, threads: vec![1], levels }
    }
}

/// One contender's speed on one kind of ray.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The kind of ray.
    pub kind: Kind,
    /// The contender.
    pub unit: String,
    /// The order in which it got its rays: its fastest.
    pub order: Order,
    /// Number of threads.
    pub threads: usize,
    /// SIMD level of raystream's CPU tracers.
    pub simd: Option<&'static str>,
    /// True if candidate hits had an alpha test.
    pub alpha_test: bool,
    /// Millions of rays per second over the rounds.
    pub mray_per_s: Spread,
    /// Ratio of medians to each peer with as many threads: `embree` (its fastest mode), `embree_robust` (its fastest
    /// robust mode), `tinybvh` (its fastest tree), `obvhs`, `rtrt`, `scalar`, and, where a GPU takes part, `cpu` (the
    /// CPU tracer's fastest level); and `one_thread`, the ratio to the same contender with one thread, where that was
    /// measured.
    pub ratio: BTreeMap<&'static str, f64>,
}

/// All results for one scene.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Report {
    /// Speeds.
    pub rows: Vec<Row>,
    /// Comparisons of hits; empty without Embree.
    pub agreement: Vec<Agreement>,
}

impl Report {
    /// True if a device has timed its kernels.
    pub fn has_kernel_times(&self) -> bool {
        self.rows.iter().any(|row| row.unit.starts_with(device::KERNELS))
    }
}

/// Error of the measurement.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// A peer reports an error.
    #[error(transparent)]
    Peer(#[from] PeerError),
    /// The GPU is lost.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// The service cannot start its threads.
    #[error(transparent)]
    Service(#[from] ServiceError),
}

/// Measures every contender on every kind of ray, and the scene's GPU if it has one.
///
/// # Errors
/// When a peer reports one, a GPU is lost or threads cannot be started.
pub fn run(
    prepared: &PreparedScene,
    workload: &Workload,
    peers: Peers<'_>,
    options: &Options,
) -> Result<Report, BenchError> {
    let mut report = Report::default();
    let threads = options.threads.iter().copied().max().unwrap_or(1);
    let embree = peers.embree.map(|embree| embree.device(threads)).transpose().map_err(PeerError::from)?;
    let scenes = embree.as_ref().map_or(Ok(Vec::new()), |device| embree_scenes(prepared, device));
    let scenes = scenes.map_err(PeerError::from)?;
    let peers = prepared.filter.is_none().then(|| PeersOfOpaque::new(prepared, peers)).transpose()?;
    let pool = |&threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pools: Result<Vec<_>, _> = options.threads.iter().map(pool).collect();
    let pools = pools.expect("threads can be started");
    let service = |&host_threads| {
        Service::new(ServiceOptions::default().with_host_threads(host_threads).with_device_thread(false))
    };
    let services: Vec<Service> = options.threads.iter().map(service).collect::<Result<_, _>>()?;
    for &kind in &options.kinds {
        let rays: Vec<InOrder> =
            kind.orders().iter().map(|&order| InOrder::new(workload, kind, order)).collect();
        let kernels = match &prepared.tracers.device {
            Some(device) => device::kernels(&**device, kind)?,
            None => None,
        };
        let mut contenders = Vec::new();
        for (pool, service) in pools.iter().zip(&services) {
            let clock = Clock { pool };
            let mut with_these = ours::contenders(prepared, kind, clock, service, &options.levels);
            if let Some(device) = &prepared.tracers.device {
                with_these.push(device::contender(&**device, kind, clock));
            }
            with_these.extend(peers::embree(&scenes, kind, clock));
            with_these.push(peers::scalar(prepared, kind, clock));
            with_these.extend(peers.iter().flat_map(|peers| peers.contenders(kind, clock)));
            contenders.extend(with_these.into_iter().enumerate());
        }
        // No host thread has a part in it.
        contenders.extend(kernels.map(|kernels| (usize::MAX, kernels)));
        // The same contender with one and with more threads is timed one after the other, so that other load on the
        // machine changes their ratio little.
        contenders.sort_by_key(|&(place, _)| place);
        let contenders = contenders.into_iter().map(|(_, contender)| contender).collect();
        let alpha_test = prepared.filter.is_some();
        report.rows.extend(measure::measure(contenders, &rays, kind, alpha_test, options.rounds)?);
    }
    if let Some(robust) = scenes.last() {
        let compare = |&kind: &Kind| agreement::compare(&*prepared.tracers.host, robust, workload, kind);
        report.agreement = options.kinds.iter().map(compare).collect();
    }
    Ok(report)
}

/// Embree's fast scene and its robust one.
fn embree_scenes<'a>(
    prepared: &PreparedScene,
    device: &'a Device<'_>,
) -> Result<Vec<EmbreeScene<'a>>, EmbreeError> {
    let mesh = &prepared.scene.mesh;
    let mask = prepared.filter.as_ref().map(|filter| Mask {
        masked: (0..mesh.triangles.len() as u32).map(|i| prepared.scene.is_masked(i)).collect(),
        filter: filter.clone(),
    });
    let build = |robust| {
        let options = BuildOptions { robust, ..BuildOptions::default() };
        device.build(&mesh.positions, &mesh.triangles, mask.as_ref(), options)
    };
    [false, true].map(build).into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use raystream::engine::Units;
    use raystream::scene::Camera;
    use raystream::scene::generate;
    use std::sync::Arc;

    fn report(source: &str) -> Report {
        let scene = generate::scene(source.as_ref()).expect("a size in range");
        let prepared = PreparedScene::new(Arc::new(scene), &Units::cpu()).expect("a valid scene");
        let camera = prepared.scene.camera.unwrap_or_else(|| Camera::framing(&prepared.bvh.bounds(), 1.0));
        let workload =
            Workload::new(&prepared.scene, &prepared.bvh, &*prepared.tracers.host, &camera, (64, 48));
        let options = Options { rounds: 2, threads: vec![1, 2], ..Options::default() };
        run(&prepared, &workload.expect("a view"), Peers::default(), &options).expect("no libraries to fail")
    }

    #[test]
    fn every_contender_gets_a_row_with_its_order_and_ratios() {
        let report = report("terrain:20");
        assert_eq!(report.rows.len(), 2 * 5 * (2 * SimdLevel::available().len() + 5));
        for row in &report.rows {
            let Spread { median, best, worst } = row.mray_per_s;
            assert!(0.0 < worst && worst <= median && median <= best);
            assert!(row.ratio["scalar"] > 0.0 && !row.ratio.contains_key("embree"));
            assert!(row.kind.orders().contains(&row.order) && !row.alpha_test);
            assert_eq!(row.ratio.contains_key("one_thread"), row.threads == 2);
            let same = |r: &&Row| (r.kind, &r.unit, r.simd, r.threads) == (row.kind, &row.unit, row.simd, 1);
            let alone = report.rows.iter().find(same).expect("a row of one thread");
            assert_eq!(alone.order, row.order);
            assert!(row.ratio.get("one_thread").is_none_or(|&r| r == median / alone.mray_per_s.median));
        }
    }

    #[test]
    fn where_there_is_an_alpha_test_contenders_without_one_are_left_out() {
        let report = report("leaves:40");
        assert_eq!(report.rows.len(), 2 * 5 * (2 * SimdLevel::available().len() + 2));
        let units: Vec<&str> = report.rows.iter().map(|row| row.unit.as_str()).collect();
        assert!(units.contains(&"raystream service") && units.contains(&"scalar"));
        assert!(["raystream query", "obvhs", "rtrt"].iter().all(|unit| !units.contains(unit)));
        assert!(report.rows.iter().all(|row| row.alpha_test));
    }
}
