//! `raystream bench latency`: how long ray queries through the service take, while it is idle and beside frames, and
//! what frames lose while an interactive client is registered.

use super::frame::FrameError;
use super::{Kind, Order, Spread, Workload};
use raystream::engine::PreparedScene;
use raystream::render::{PathTracer, ROULETTE_BOUNCES, Settings};
use raystream::scene::Camera;
use raystream::schedule::{JobHandle, JobOptions, Priority, Service};
use raystream::stream::Ray;
use serde::Serialize;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Settings of the measurement.
#[derive(Clone, Debug)]
pub struct Options {
    /// The frames beside which queries are asked. They are cancelled in the end, so they should be long.
    pub settings: Settings,
    /// Their camera.
    pub camera: Camera,
    /// Numbers of frames; the first `max_jobs` of them run.
    pub frames: Vec<usize>,
    /// Rays of a query.
    pub rays: Vec<usize>,
    /// Queries of each row.
    pub queries: usize,
    /// Rounds of half a second in which the speed of a frame is measured.
    pub rounds: usize,
}

/// Times of one kind of query, or the speed of a frame.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Way in which queries are asked, or what a frame runs beside.
    pub configuration: &'static str,
    /// Frames submitted.
    pub frames: usize,
    /// Host threads.
    pub threads: usize,
    /// Rays of a query.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rays: Option<usize>,
    /// Times of queries.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub latency_us: Option<Times>,
    /// Rays that a frame traced per microsecond.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mray_per_s: Option<Spread>,
    /// Share of its speed that the frame has lost to the client.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub loss: Option<f64>,
}

/// From the call until the answers are there, in microseconds.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Times {
    /// The median.
    pub p50: f64,
    /// 99 of 100 queries were as fast.
    pub p99: f64,
    /// The slowest.
    pub worst: f64,
}

/// Way in which queries are asked.
struct Client {
    name: &'static str,
    priority: Priority,
    /// True if the calling thread may trace them.
    by_caller: bool,
}

const CLIENTS: [Client; 4] = [
    Client { name: "normal, by threads", priority: Priority::Normal, by_caller: false },
    Client { name: "normal", priority: Priority::Normal, by_caller: true },
    Client { name: "interactive, by threads", priority: Priority::Interactive, by_caller: false },
    Client { name: "interactive", priority: Priority::Interactive, by_caller: true },
];

/// Between two queries beside frames, so that they meet tasks at any moment.
const PAUSE: Duration = Duration::from_micros(2300);

/// For as long a frame's speed is measured at once.
const ROUND: Duration = Duration::from_millis(500);

/// A prepared scene and the service that traces it.
#[derive(Clone, Copy, Debug)]
pub struct Bench<'a> {
    /// The scene with its tree and tracers.
    pub prepared: &'a PreparedScene,
    /// The service.
    pub service: &'a Service,
    /// Settings of the measurement.
    pub options: &'a Options,
}

impl Bench<'_> {
    /// Measures queries of each kind beside each number of frames, then a frame beside a client.
    ///
    /// # Errors
    /// When a frame or a query fails.
    pub fn run(&self) -> Result<Vec<Row>, FrameError> {
        let options = self.options;
        let rays = self.rays()?;
        let mut rows = Vec::new();
        for &frames in &options.frames {
            let under_way = self.start(frames)?;
            for client in &CLIENTS {
                for &count in &options.rays {
                    let times = self.ask(client, &rays, count, frames > 0)?;
                    let row = self.row(client.name, frames);
                    rows.push(Row { rays: Some(count), latency_us: Some(times), ..row });
                }
            }
            drop(under_way);
        }
        rows.extend(self.loss()?);
        Ok(rows)
    }

    fn row(&self, configuration: &'static str, frames: usize) -> Row {
        let threads = self.service.host_threads();
        Row { configuration, frames, threads, rays: None, latency_us: None, mray_per_s: None, loss: None }
    }

    /// Bounces of a picture, in random order.
    fn rays(&self) -> Result<Vec<Ray>, FrameError> {
        let PreparedScene { scene, bvh, tracers, .. } = self.prepared;
        let Settings { width, height, .. } = self.options.settings;
        let camera = &self.options.camera;
        let workload = Workload::new(scene, bvh, &*tracers.host, camera, (width, height));
        let workload = workload.map_err(raystream::render::SettingsError::from)?;
        Ok(workload.rays(Kind::ShuffledBounce, Order::Shuffled))
    }

    /// Submits frames, and waits until one of them is under way.
    fn start(&self, frames: usize) -> Result<Vec<JobHandle>, FrameError> {
        let Options { settings, camera, .. } = *self.options;
        let frame = || {
            let path =
                PathTracer::new(self.prepared.scene.clone(), &camera, settings, Some(ROULETTE_BOUNCES))?;
            let tracers = self.prepared.tracers.clone();
            Ok::<_, FrameError>(self.service.submit(Arc::new(path), tracers, JobOptions::default())?)
        };
        let jobs = (0..frames).map(|_| frame()).collect::<Result<Vec<_>, _>>()?;
        while jobs.first().is_some_and(|job| job.progress().rays_traced() == 0) {
            std::thread::sleep(PAUSE);
        }
        Ok(jobs)
    }

    /// Asks queries one after the other.
    fn ask(&self, client: &Client, rays: &[Ray], count: usize, pause: bool) -> Result<Times, FrameError> {
        let _registered = (client.priority == Priority::Interactive).then(|| self.service.interactive());
        let options = JobOptions::default().with_priority(client.priority);
        let options = if client.by_caller { options } else { options.with_caller_rays(0) };
        let mut times = Vec::new();
        for query in 0..self.options.queries {
            let start = (query * count) % rays.len().saturating_sub(count).max(1);
            let some: Arc<[Ray]> = rays[start..(start + count).min(rays.len())].into();
            if pause {
                std::thread::sleep(PAUSE);
            }
            let began = Instant::now();
            let asked = self.service.closest(self.prepared.tracers.clone(), some, options.clone());
            let answer = asked.expect("the default sizes fit").wait();
            times.push(began.elapsed().as_secs_f64() * 1e6);
            answer.map_err(|error| FrameError::Job { configuration: client.name, error })?;
        }
        times.sort_by(f64::total_cmp);
        let share = |share: f64| times[((times.len() - 1) as f64 * share).round() as usize];
        Ok(Times { p50: share(0.5), p99: share(0.99), worst: share(1.0) })
    }

    /// The speed of a frame without and with a registered client, in turns.
    fn loss(&self) -> Result<[Row; 2], FrameError> {
        let frame = self.start(1)?.remove(0);
        let mut rates = [Vec::new(), Vec::new()];
        for _ in 0..self.options.rounds {
            for (is_there, rates) in [false, true].into_iter().zip(&mut rates) {
                let registered = is_there.then(|| self.service.interactive());
                let (began, before) = (Instant::now(), frame.progress().rays_traced());
                std::thread::sleep(ROUND);
                let rays = frame.progress().rays_traced() - before;
                rates.push(rays as f64 / (began.elapsed().as_secs_f64() * 1e6));
                drop(registered);
            }
        }
        let [alone, beside] = rates.map(Spread::of_rates);
        Ok([
            Row { mray_per_s: Some(alone), ..self.row("frame alone", 1) },
            Row {
                mray_per_s: Some(beside),
                loss: Some(1.0 - beside.median / alone.median),
                ..self.row("frame, a client registered", 1)
            },
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use raystream::engine::Units;
    use raystream::scene::load;
    use raystream::schedule::ServiceOptions;

    #[test]
    fn every_kind_of_query_is_measured_beside_every_number_of_frames() {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes/cornell.json");
        let scene = Arc::new(load::load(file).expect("our own scene"));
        let camera = scene.camera.expect("it has a camera");
        let prepared = PreparedScene::new(scene, &Units::cpu()).expect("a valid scene");
        let service =
            Service::new(ServiceOptions::default().with_host_threads(2).with_max_jobs(1)).expect("threads");
        let settings = Settings::new(64, 64).with_spp(4096).with_max_bounces(4).with_seed(1);
        let options =
            Options { settings, camera, frames: vec![0, 2], rays: vec![1, 600], queries: 3, rounds: 1 };
        let rows =
            Bench { prepared: &prepared, service: &service, options: &options }.run().expect("it runs");
        assert_eq!(rows.len(), 2 * CLIENTS.len() * 2 + 2);
        let times: Vec<_> = rows.iter().filter_map(|row| row.latency_us).collect();
        assert!(times.len() == 16 && times.iter().all(|t| t.p50 > 0.0 && t.p50 <= t.p99 && t.p99 <= t.worst));
        assert!(rows[17].loss.is_some_and(|loss| loss < 1.0));
    }
}
