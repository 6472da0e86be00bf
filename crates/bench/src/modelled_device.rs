//! A modelled device: threads of its own trace its rays, and it answers when a device of some rate, latency and bus
//! would.

use rayon::prelude::*;
use raystream::stream::{
    DeviceError, DeviceReport, DeviceStream, DeviceTracer, Hit, Ray, Resolve, Ticket, Tracer,
};
use std::fmt::{Display, Formatter};
use std::str::FromStr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A description of the device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Model {
    /// Millions of rays a second.
    pub mray_per_s: f64,
    /// Seconds from the end of a bundle's work until its answers are there.
    pub latency_s: f64,
    /// Gigabytes a second, each way.
    pub gb_per_s: f64,
}

/// A text that is no model.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{0:?} is no model of a device; write three numbers above 0: Mray/s, seconds, GB/s, as in 2,0.0001,16"
)]
pub struct NoModel(String);

impl FromStr for Model {
    type Err = NoModel;

    fn from_str(text: &str) -> Result<Self, NoModel> {
        let wrong = || NoModel(text.to_owned());
        let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse()).collect();
        match numbers.map_err(|_| wrong())?[..] {
            [mray_per_s, latency_s, gb_per_s]
                if [mray_per_s, latency_s, gb_per_s].iter().all(|&n: &f64| n > 0.0 && n.is_finite()) =>
            {
                Ok(Self { mray_per_s, latency_s, gb_per_s })
            }
            _ => Err(wrong()),
        }
    }
}

impl Display for Model {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        let Self { mray_per_s, latency_s, gb_per_s } = self;
        write!(f, "modelled: {mray_per_s} Mray/s, {latency_s} s, {gb_per_s} GB/s")
    }
}

impl Model {
    /// Seconds for which a bundle occupies the bus upwards, the device, the bus downwards.
    fn stages(self, rays: usize, shadow_rays: usize) -> [f64; 3] {
        let bytes = |count: usize, size: usize| (count * size) as f64 / (self.gb_per_s * 1e9);
        let all = rays + shadow_rays;
        let kernel = all as f64 / (self.mray_per_s * 1e6);
        let down = bytes(rays, size_of::<Hit>()) + bytes(shadow_rays, size_of::<u32>());
        [bytes(all, size_of::<Ray>()), kernel, down]
    }

    /// Nanoseconds a ray, by the slowest stage.
    pub fn ray_ns(self) -> f64 {
        self.stages(1 << 20, 0).into_iter().fold(0.0, f64::max) * 1e9 / f64::from(1 << 20)
    }
}

/// The device.
pub struct ModelledDevice {
    name: String,
    work: Mutex<Sender<Work>>,
    bundle_rays: usize,
}

impl std::fmt::Debug for ModelledDevice {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ModelledDevice").field("name", &self.name).finish_non_exhaustive()
    }
}

/// A bundle, and when it was submitted.
struct Work {
    bundle: Vec<DeviceStream>,
    submitted: Instant,
    state: Arc<(Mutex<Option<Instant>>, Condvar)>,
}

/// Rays that a thread of the device traces at once.
const PIECE: usize = 4096;

impl ModelledDevice {
    /// A device whose rays `threads` threads trace; they must be faster than the model.
    pub fn new(model: Model, tracer: Arc<dyn Tracer>, threads: usize) -> Self {
        let (work, received) = channel::<Work>();
        // A submission takes about as long as the latency; an eighth of a bundle's time.
        let bundle_rays = ((7.0 * model.latency_s * 1e9 / model.ray_ns()) as usize).clamp(1024, 1 << 18);
        let run = move || {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            let mut free = [Instant::now(); 3];
            for Work { bundle, submitted, state } in received {
                let rays = bundle.iter().map(|stream| stream.rays().len()).sum();
                let shadow_rays = bundle.iter().map(|stream| stream.shadow_rays().len()).sum();
                let mut at = submitted;
                for (free, seconds) in free.iter_mut().zip(model.stages(rays, shadow_rays)) {
                    at = at.max(*free) + Duration::from_secs_f64(seconds);
                    *free = at;
                }
                pool.install(|| bundle.iter().for_each(|stream| trace(stream, &*tracer)));
                drop(bundle);
                // A pool that is slower than the model holds all that follows up.
                free[1] = free[1].max(Instant::now());
                let readable = (at + Duration::from_secs_f64(model.latency_s)).max(Instant::now());
                *state.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(readable);
                state.1.notify_one();
            }
        };
        std::thread::Builder::new().name("modelled device".into()).spawn(run).expect("a thread");
        Self { name: model.to_string(), work: Mutex::new(work), bundle_rays }
    }
}

fn trace(stream: &DeviceStream, tracer: &dyn Tracer) {
    let mut answers = stream.answers();
    let (hits, occluded) = answers.slices();
    let closest = stream.rays().par_chunks(PIECE).zip(hits.par_chunks_mut(PIECE));
    closest.for_each(|(rays, hits)| tracer.closest(rays, hits));
    let any = stream.shadow_rays().par_chunks(PIECE).zip(occluded.par_chunks_mut(PIECE));
    any.for_each(|(rays, occluded)| tracer.occluded(rays, occluded));
}

impl DeviceTracer for ModelledDevice {
    fn name(&self) -> &str {
        &self.name
    }

    fn bundle_rays(&self) -> Option<usize> {
        Some(self.bundle_rays)
    }

    fn submit(&self, bundle: Vec<DeviceStream>) -> Result<Box<dyn Ticket>, DeviceError> {
        let (streams, state) = (bundle.len(), Arc::default());
        let work = Work { bundle, submitted: Instant::now(), state: Arc::clone(&state) };
        let sent = self.work.lock().unwrap_or_else(PoisonError::into_inner).send(work);
        sent.map_err(|_| DeviceError::Lost("its thread is gone".into()))?;
        Ok(Box::new(Bundle { streams, state }))
    }
}

/// Threads that trace rays over and over at the rate of a model, until this is dropped: a device's cores are as busy,
/// and take as much of what cores share.
#[derive(Debug)]
pub struct BusyCores {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl BusyCores {
    /// `threads` threads that trace these rays.
    pub fn start(model: Model, tracer: Arc<dyn Tracer>, rays: Vec<Ray>, threads: usize) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let run = move || {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            let (mut hits, mut due) = (vec![Hit::NONE; rays.len()], Instant::now());
            while !stopped.load(Ordering::Relaxed) {
                for (rays, hits) in rays.chunks(PIECE * threads).zip(hits.chunks_mut(PIECE * threads)) {
                    let pieces = rays.par_chunks(PIECE).zip(hits.par_chunks_mut(PIECE));
                    pool.install(|| pieces.for_each(|(rays, hits)| tracer.closest(rays, hits)));
                    due += Duration::from_secs_f64(rays.len() as f64 / (model.mray_per_s * 1e6));
                    std::thread::sleep(due.saturating_duration_since(Instant::now()));
                }
            }
        };
        let thread = std::thread::Builder::new().name("busy cores".into()).spawn(run).expect("a thread");
        Self { stop, thread: Some(thread) }
    }
}

impl Drop for BusyCores {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // What it traced means nothing.
            let _ = thread.join();
        }
    }
}

/// A bundle under way, and when it can be read, once that is known.
struct Bundle {
    streams: usize,
    state: Arc<(Mutex<Option<Instant>>, Condvar)>,
}

impl Ticket for Bundle {
    fn wait(&mut self, timeout: Duration) -> Result<Option<Vec<Box<dyn Resolve>>>, DeviceError> {
        let (began, (readable, traced)) = (Instant::now(), &*self.state);
        let state = readable.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = traced.wait_timeout_while(state, timeout, |readable| readable.is_none());
        let readable = *waited.unwrap_or_else(PoisonError::into_inner).0;
        let Some(readable) = readable else { return Ok(None) };
        let left = readable.saturating_duration_since(Instant::now());
        if left > timeout.saturating_sub(began.elapsed()) {
            std::thread::sleep(timeout.saturating_sub(began.elapsed()));
            return Ok(None);
        }
        std::thread::sleep(left);
        Ok(Some((0..self.streams).map(|_| Box::new(Canonical) as Box<dyn Resolve>).collect()))
    }
}

/// Answers that are canonical as they are.
struct Canonical;

impl Resolve for Canonical {
    fn resolve(self: Box<Self>, _: &DeviceStream) -> Result<DeviceReport, DeviceError> {
        Ok(DeviceReport::default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_are_three_numbers_above_0() {
        let model: Model = "2, 0.0001,16".parse().expect("a model");
        assert_eq!(model, Model { mray_per_s: 2.0, latency_s: 0.0001, gb_per_s: 16.0 });
        assert!((model.ray_ns() - 500.0).abs() < 1e-6, "the kernel is the slowest stage");
        for bad in ["", "2,1", "2,x,1,3", "2,1,3,4", "0,1,1", "1,-1,1", "1,1,inf", "1,1,NaN"] {
            assert_eq!(bad.parse::<Model>(), Err(NoModel(bad.to_owned())));
        }
    }
}
