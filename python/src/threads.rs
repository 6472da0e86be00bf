//! Threads of this process, and long calls that can be interrupted.
//!
//! A forked child has the memory of its parent, but none of its threads. So pools belong to a process: a child makes
//! its own at its first call, and never looks at locks that a thread of its parent may have held.

use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use raystream::schedule::ServiceOptions;
use std::ops::Range;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Arc, LazyLock, Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

/// The most rays of a call that stay on the calling thread: waking others takes longer.
pub const FEW: usize = 1024;

/// Number of rays of the first block of a call.
pub const FIRST_RAYS: usize = 1 << 17;

/// Number of points of the first block of a call: a point may take as long as a hundred rays.
pub const FIRST_POINTS: usize = 1 << 12;

/// Time between two looks for Ctrl-C, about.
const BLOCK_TIME: Duration = Duration::from_millis(50);

/// Stack of a thread: recursive shaders are deep. Pages are taken where they are used.
const STACK_BYTES: usize = 16 << 20;

/// The pools of a process, by their number of threads.
struct Pools {
    process: u32,
    pools: Mutex<Vec<(usize, Arc<ThreadPool>)>>,
    /// Those of a child that was forked from this process, or of its child.
    child: OnceLock<Box<Pools>>,
}

static POOLS: LazyLock<Pools> = LazyLock::new(Pools::of_this_process);

impl Pools {
    fn of_this_process() -> Self {
        Self { process: std::process::id(), pools: Mutex::default(), child: OnceLock::new() }
    }

    fn current() -> &'static Self {
        let (process, mut pools) = (std::process::id(), &*POOLS);
        while pools.process != process {
            pools = pools.child.get_or_init(|| Box::new(Self::of_this_process()));
        }
        pools
    }

    fn get(&self, threads: usize) -> PyResult<Arc<ThreadPool>> {
        let mut pools = self.pools.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, pool)) = pools.iter().find(|(count, _)| *count == threads) {
            return Ok(pool.clone());
        }
        let named = |index| format!("raystream-{index}");
        let pool = ThreadPoolBuilder::new().num_threads(threads).thread_name(named).stack_size(STACK_BYTES);
        let pool = pool.build();
        let pool = Arc::new(pool.map_err(|error| PyRuntimeError::new_err(error.to_string()))?);
        pools.push((threads, pool.clone()));
        Ok(pool)
    }
}

/// Makes what a fork must not find half made.
pub fn prepare() {
    LazyLock::force(&POOLS);
    crossbeam_epoch::default_collector();
}

/// The number of threads of a call without `threads=`: that of `RAYON_NUM_THREADS`, else of the processors that this
/// process may use.
pub fn usual() -> usize {
    static USUAL: LazyLock<usize> = LazyLock::new(|| {
        let set = std::env::var("RAYON_NUM_THREADS").ok().and_then(|value| value.parse().ok());
        set.filter(|&threads| threads > 0)
            .unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from))
    });
    *USUAL
}

/// Threads of a call, as its argument `threads=` says.
pub struct Threads {
    /// `None`: the calling one alone.
    pool: Option<Arc<ThreadPool>>,
}

impl Threads {
    /// For a call over `items`; up to `few` stay on the calling thread.
    ///
    /// # Errors
    /// For no thread, or more than 65536.
    pub fn new(threads: Option<usize>, items: usize, few: usize) -> PyResult<Self> {
        if threads.is_some_and(|threads| !(1..=1 << 16).contains(&threads)) {
            return Err(PyValueError::new_err("threads must be 1 to 65536, or None for all processors"));
        }
        let pool =
            if items <= few { None } else { Some(Pools::current().get(threads.unwrap_or_else(usual))?) };
        Ok(Self { pool })
    }

    /// All threads.
    ///
    /// # Errors
    /// If the system gives none.
    pub fn all() -> PyResult<Self> {
        Self::new(None, usize::MAX, 0)
    }

    /// Runs a function with the interpreter released, on these threads.
    pub fn run<T: Send>(&self, py: Python<'_>, function: impl FnOnce() -> T + Send) -> T {
        py.detach(|| match &self.pool {
            Some(pool) => pool.install(function),
            None => function(),
        })
    }

    /// These threads for a service; the calling one alone has none to give.
    pub fn service_options(&self, options: ServiceOptions) -> ServiceOptions {
        match &self.pool {
            Some(pool) => options.with_rayon_pool(Arc::clone(pool)),
            None => options.with_host_threads(1),
        }
    }

    /// Runs a function on these threads with the interpreter released. Meanwhile the calling thread looks for signals
    /// and calls `look`, about twenty times a second. After an error it calls `stop`, waits for the function's end and
    /// returns that error.
    ///
    /// # Errors
    /// That of `look`, or of a signal's handler, such as KeyboardInterrupt.
    pub fn watched<T: Send>(
        &self,
        py: Python<'_>,
        function: impl FnOnce() -> T + Send,
        mut look: impl FnMut(Python<'_>) -> PyResult<()> + Send,
        stop: impl Fn() + Sync,
    ) -> PyResult<T> {
        let Some(pool) = &self.pool else { return Ok(py.detach(function)) };
        py.detach(|| {
            let (sender, receiver) = mpsc::channel();
            let (mut looked, mut done) = (Ok(()), None);
            pool.in_place_scope(|scope| {
                // The receiver outlives the task.
                scope.spawn(move |_| drop(sender.send(function())));
                loop {
                    match receiver.recv_timeout(BLOCK_TIME) {
                        Err(RecvTimeoutError::Timeout) if looked.is_ok() => {
                            looked = Python::attach(|py| py.check_signals().and_then(|()| look(py)));
                            if looked.is_err() {
                                stop();
                            }
                        }
                        Err(RecvTimeoutError::Timeout) => {}
                        // Without a value it has panicked, which the scope goes on with.
                        received => return done = received.ok(),
                    }
                }
            });
            looked.map(|()| done.expect("the function has returned"))
        })
    }

    /// Calls a function for one block of `0..items` after the other, with the interpreter released. Between blocks it
    /// looks for signals; after the first they take some 50 ms.
    ///
    /// # Errors
    /// That of the function, or of a signal's handler, such as KeyboardInterrupt.
    pub fn in_blocks(
        &self,
        py: Python<'_>,
        items: usize,
        first_block: usize,
        mut function: impl FnMut(Range<usize>) -> PyResult<()> + Send,
    ) -> PyResult<()> {
        let (mut first, mut length) = (0, first_block);
        while first < items {
            let begun = Instant::now();
            let block = first..items.min(first.saturating_add(length));
            first = block.end;
            self.run(py, || function(block))?;
            if first < items {
                py.check_signals()?;
                length = next_length(length, begun.elapsed());
            }
        }
        Ok(())
    }
}

/// Length of the block after one of `length` items.
fn next_length(length: usize, took: Duration) -> usize {
    let wanted = length as f64 * BLOCK_TIME.as_secs_f64() / took.as_secs_f64().max(1e-6);
    (wanted as usize).clamp(length / 4, length.saturating_mul(4)).max(FEW)
}
