//! What a user's first program does, on threads with stacks of 2 MB: a million triangles, a million rays, a frame of
//! each integrator, all of it also inside a rayon pool of one thread.
//!
//! `cargo run -- [FILE.json [SECONDS]]` also renders a frame of 640 × 480 and writes all times into the file, for
//! `scripts/results.py`. SECONDS is how long raystream took to compile.

mod frames;
mod queries;
mod surfaces;

use raystream::lanes::SimdLevel;
use raystream::profile::OPT_LEVEL;
use serde_json::{Value, json};
use std::error::Error;
use std::path::PathBuf;
use std::thread;
use std::time::Instant;

/// The stack of threads that are started without saying a size, and of rayon's threads.
const STACK: usize = 2 << 20;

/// Seconds of each step.
#[derive(Default)]
pub struct Timings(serde_json::Map<String, Value>);

impl Timings {
    /// Runs a step and says how long it took.
    pub fn time<T>(&mut self, name: &str, step: impl FnOnce() -> T) -> T {
        let began = Instant::now();
        let result = step();
        let seconds = began.elapsed().as_secs_f64();
        println!("{name:>20} {seconds:9.3} s");
        self.0.insert(format!("{name}_s"), seconds.into());
        result
    }
}

/// All steps, on this thread and inside a rayon pool of one thread; with the large frame if it is to be timed.
fn steps(large: bool) -> Result<Timings, Box<dyn Error + Send + Sync>> {
    let told = |error: Box<dyn Error>| error.to_string();
    let mut timings = Timings::default();
    frames::each_integrator((32, 24), 1, &mut timings).map_err(told)?;
    // Once is enough for the large ones: they run where panics unwind.
    let (cells, rays) = if cfg!(panic = "abort") { (100, 10_000) } else { (708, 1_000_000) };
    queries::all(cells, rays, &mut timings).map_err(told)?;
    if large {
        frames::cornell((640, 480), 16, &mut timings).map_err(told)?;
    }
    println!("inside a rayon pool of one thread:");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).stack_size(STACK).build()?;
    pool.install(|| {
        let mut others = Timings::default();
        queries::all(100, 10_000, &mut others).map_err(told)?;
        frames::each_integrator((8, 6), 1, &mut others).map_err(told)
    })?;
    Ok(timings)
}

fn main() -> Result<(), Box<dyn Error + Send + Sync>> {
    let mut arguments = std::env::args().skip(1);
    let file = arguments.next().map(PathBuf::from);
    let compile_s = arguments.next().map(|seconds| seconds.parse::<f64>()).transpose()?;
    println!(
        "raystream has opt-level {OPT_LEVEL}, panics {}",
        if cfg!(panic = "abort") { "abort" } else { "unwind" }
    );
    let large = file.is_some();
    let steps = thread::Builder::new().stack_size(STACK).spawn(move || steps(large))?;
    let mut timings = steps.join().map_err(|_| "a step panicked")??;
    if let Some(file) = file {
        timings.0.insert("compile_s".into(), json!(compile_s));
        timings.0.insert("opt_level".into(), OPT_LEVEL.into());
        let threads = thread::available_parallelism()?.get();
        let machine = json!({ "threads": threads, "simd": SimdLevel::detect().name() });
        let sheet = json!({ "machine": machine, "rows": [timings.0] });
        std::fs::write(file, serde_json::to_string_pretty(&sheet)?)?;
    }
    Ok(())
}
