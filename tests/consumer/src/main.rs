//! What a user's first program does, on threads with stacks of 2 MB: a million triangles, a million rays, a frame of
//! each integrator, all of it also inside a rayon pool of one thread.
//!
//! `cargo run -- [small|large] [FILE.json]`: `large` renders a frame of 640 × 480 besides; the file gets the times.

mod frames;
mod queries;
mod surfaces;

use std::error::Error;
use std::time::Instant;

/// The stack of threads that are started without saying a size, and of rayon's threads.
const STACK: usize = 2 << 20;

/// Seconds of each step.
#[derive(Default)]
pub struct Timings(serde_json::Map<String, serde_json::Value>);

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

/// All steps.
fn steps(large: bool) -> Result<Timings, Box<dyn Error + Send + Sync>> {
    let told = |error: Box<dyn Error>| error.to_string();
    let mut timings = Timings::default();
    frames::each_integrator((32, 24), 1, &mut timings).map_err(told)?;
    queries::all(708, 1_000_000, &mut timings).map_err(told)?;
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
    let large = arguments.next().as_deref() == Some("large");
    let thread = std::thread::Builder::new().stack_size(STACK).spawn(move || steps(large))?;
    let timings = thread.join().map_err(|_| "the steps panicked")??;
    if let Some(file) = arguments.next() {
        std::fs::write(file, serde_json::to_string_pretty(&timings.0)?)?;
    }
    Ok(())
}
