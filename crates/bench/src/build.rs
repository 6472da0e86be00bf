//! `raystream bench build`: the build of the tree beside Embree's builds of each quality and tinybvh's, of the same
//! triangles, in one process, in interleaved rounds. tinybvh builds with all cores, so it takes part where as many
//! threads are asked for.

use super::embree::{BuildOptions, Quality};
use super::{PeerError, Peers, Spread, tinybvh};
use glam::Vec3;
use raystream::bvh::Bvh;
use serde::Serialize;
use std::time::{Duration, Instant};

/// Settings of the measurement.
#[derive(Clone, Debug)]
pub struct Options {
    /// Rounds; each builder builds once a round.
    pub rounds: usize,
    /// Numbers of threads.
    pub threads: Vec<usize>,
}

/// One builder with one number of threads.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The builder.
    pub unit: String,
    /// Number of threads.
    pub threads: usize,
    /// Seconds of the build, over the rounds.
    pub seconds: Spread,
    /// Bytes of the tree for each triangle. raystream's trees hold the vertices; Embree's trees of indexed triangles
    /// refer to them, so there they are not counted.
    pub bytes_per_triangle: f64,
    /// The most bytes in use during the build for each triangle, where the builder reports them.
    pub peak_bytes_per_triangle: Option<f64>,
    /// Expected cost of a random line, for raystream's trees only: see [`Bvh::cost`].
    pub cost: Option<f32>,
    /// The median divided by that of Embree's medium quality: less than 1 is faster.
    pub ratio: Option<f64>,
}

/// Time without work before each build: worker threads of the builder before look for work for a while, on processors
/// that this one needs.
const PAUSE: Duration = Duration::from_millis(50);

/// The results of one build.
struct Built {
    seconds: f64,
    bytes: usize,
    peak_bytes: Option<usize>,
    cost: Option<f32>,
}

/// A builder's name, and the function that builds once.
type Unit<'a> = (String, Box<dyn FnMut() -> Result<Built, PeerError> + 'a>);

/// Measures every builder.
///
/// # Errors
/// When a peer reports one.
pub fn run(
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    peers: Peers<'_>,
    options: &Options,
) -> Result<Vec<Row>, PeerError> {
    let mut rows = Vec::new();
    for &threads in &options.threads {
        let pool =
            rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be started");
        let device = peers.embree.map(|embree| embree.device(threads)).transpose()?;
        let ours = || {
            let start = Instant::now();
            let bvh = pool.install(|| Bvh::build(positions, triangles, |_| false));
            let seconds = start.elapsed().as_secs_f64();
            Ok(Built { seconds, bytes: bvh.bytes(), peak_bytes: None, cost: Some(bvh.cost()) })
        };
        let mut bvh = pool.install(|| Bvh::build(positions, triangles, |_| false));
        let pool = &pool;
        let refit = move || {
            let start = Instant::now();
            let fits = pool.install(|| bvh.refit(positions, triangles));
            let seconds = start.elapsed().as_secs_f64();
            debug_assert_eq!(fits, Ok(()), "the triangles that it was built of");
            Ok(Built { seconds, bytes: bvh.bytes(), peak_bytes: None, cost: Some(bvh.cost()) })
        };
        let mut units: Vec<Unit<'_>> =
            vec![("raystream".to_owned(), Box::new(ours)), ("raystream, refit".to_owned(), Box::new(refit))];
        for (quality, robust) in Quality::ALL.map(|q| (q, false)).into_iter().chain([(Quality::Medium, true)])
        {
            let Some(device) = &device else { continue };
            let name = format!("embree {}{}", quality.name(), if robust { ", robust" } else { "" });
            let theirs = move || {
                let scene = device.build(positions, triangles, None, BuildOptions { robust, quality })?;
                let (bytes, peak_bytes) = (scene.bytes, Some(scene.peak_bytes));
                Ok(Built { seconds: scene.build_s, bytes, peak_bytes, cost: None })
            };
            units.push((name, Box::new(theirs)));
        }
        let has_all_cores = std::thread::available_parallelism().is_ok_and(|cores| cores.get() == threads);
        if let Some(library) = peers.tinybvh.filter(|_| has_all_cores) {
            for options in tinybvh::BuildOptions::ALL {
                let theirs = move || {
                    let tree = library.build(positions, triangles, options)?;
                    Ok(Built { seconds: tree.build_s, bytes: tree.bytes(), peak_bytes: None, cost: None })
                };
                units.push((library.name(options), Box::new(theirs)));
            }
        }
        rows.extend(measure(units, triangles.len(), threads, options.rounds)?);
    }
    Ok(rows)
}

/// Times the builders in interleaved rounds.
fn measure(
    mut units: Vec<Unit<'_>>,
    triangles: usize,
    threads: usize,
    rounds: usize,
) -> Result<Vec<Row>, PeerError> {
    let mut seconds = vec![Vec::new(); units.len()];
    let mut last = Vec::new();
    for round in 0..=rounds {
        last.clear();
        for ((_, build), seconds) in units.iter_mut().zip(&mut seconds) {
            std::thread::sleep(PAUSE);
            let built = build()?;
            // The first round starts threads.
            if round > 0 {
                seconds.push(built.seconds);
            }
            last.push(built);
        }
    }
    let seconds: Vec<Spread> = seconds.into_iter().map(Spread::of_times).collect();
    let medium = units.iter().position(|(name, _)| *name == format!("embree {}", Quality::Medium.name()));
    let medium = medium.map(|i| seconds[i].median);
    let per_triangle = |bytes: usize| bytes as f64 / triangles.max(1) as f64;
    let row = |(((unit, _), built), seconds): ((Unit<'_>, Built), Spread)| Row {
        unit,
        threads,
        seconds,
        bytes_per_triangle: per_triangle(built.bytes),
        peak_bytes_per_triangle: built.peak_bytes.map(per_triangle),
        cost: built.cost,
        ratio: medium.map(|medium| seconds.median / medium),
    };
    Ok(units.into_iter().zip(last).zip(seconds).map(row).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_embree_there_is_a_row_for_each_number_of_threads() {
        let (positions, triangles) = raystream::scene::generate::terrain(20);
        let options = Options { rounds: 3, threads: vec![1, 2] };
        let rows = run(&positions, &triangles, Peers::default(), &options).expect("no libraries to fail");
        assert_eq!(rows.iter().map(|row| row.threads).collect::<Vec<_>>(), [1, 1, 2, 2]);
        for row in &rows {
            let Spread { median, best, worst } = row.seconds;
            assert!(0.0 < best && best <= median && median <= worst);
            assert!(row.bytes_per_triangle > 40.0 && row.bytes_per_triangle < 200.0);
            assert_eq!(row.cost, rows[0].cost);
            assert_eq!(row.ratio, None);
        }
    }
}
