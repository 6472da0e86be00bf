//! The ray stream: a large buffer of arbitrary rays (RA section 3). Its state is part of its type and says
//! what may be done with it. A stream is a value that moves from state to state and from list to list. So it
//! is in exactly one place, and shading a stream that is not traced does not compile.
//!
//! ```text
//! Empty ─fill→ Filling ─seal→ Full ─open→ Tracing (chunks out) ─close→ Traced ─recycle→ Empty
//!                                └─give→ OnDevice ─answered→ Answered ─resolve─┘
//! ```

use super::chunk::{StreamAnswers, StreamData};
use super::device_memory::Memory;
use super::{
    Capacity, Chunk, DeviceReport, DeviceStream, DeviceTracer, Hit, Ray, RayAppender, RayArray, Resolve,
    StreamMemory, TracedChunk, panic_message,
};
use crate::sync::{Arc, PoisonError};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Duration;

/// State of a stream without rays.
#[derive(Debug)]
pub struct Empty;

/// State of a stream to which one thread at a time appends rays.
#[derive(Debug)]
pub struct Filling;

/// State of a stream that accepts no more rays and waits to be traced.
#[derive(Debug)]
pub struct Full;

/// State of a stream that host threads trace, a chunk each.
#[derive(Debug)]
pub struct Tracing {
    /// Index of the first ray that is in no chunk yet. Shadow rays are numbered after the rays.
    next: usize,
    /// Number of chunks that are not yet put back.
    chunks_out: usize,
}

/// State of a stream that a device traces.
#[derive(Debug)]
pub struct OnDevice;

/// State of a stream for which a device has written what its answers are made of.
pub struct Answered {
    resolve: Box<dyn Resolve>,
}

impl std::fmt::Debug for Answered {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Answered").finish_non_exhaustive()
    }
}

/// State of a stream with an answer for each ray and shadow ray, which is being shaded.
#[derive(Debug)]
pub struct Traced {
    /// Number of rays taken for shading.
    shaded: usize,
    /// True if the shadow rays have been taken.
    shadows_taken: bool,
}

/// Rays with a payload and a hit each, and the shadow rays of the same paths, with a payload and an answer
/// each. `State` is [`Empty`], [`Filling`], [`Full`], [`Tracing`], [`OnDevice`], [`Answered`] or [`Traced`];
/// `P` is the payload of rays, `S` that of shadow rays.
#[derive(Debug)]
pub struct RayStream<State, P, S> {
    /// Data that tracers use. Shared with chunks in the state [`Tracing`], and with a device in the state [`OnDevice`].
    data: Arc<StreamData>,
    payloads: Vec<P>,
    shadow_payloads: Vec<S>,
    state: State,
}

/// Appends rays with their payloads; see [`RayStream::append`].
#[derive(Debug)]
pub struct StreamAppender<'a, P, S> {
    /// Rays. One is appended for each payload.
    pub rays: RayAppender<'a>,
    /// Payloads of the rays.
    pub payloads: &'a mut Vec<P>,
    /// Shadow rays. One is appended for each shadow payload.
    pub shadow_rays: RayAppender<'a>,
    /// Payloads of the shadow rays.
    pub shadow_payloads: &'a mut Vec<S>,
}

/// Consecutive traced rays of a stream; see [`RayStream::next_batch`]. The taker may change their order.
#[derive(Debug)]
pub struct TracedRays<'a, P> {
    /// The rays.
    pub rays: &'a mut [Ray],
    /// Their nearest hits.
    pub hits: &'a mut [Hit],
    /// Their payloads.
    pub payloads: &'a mut [P],
}

/// The traced shadow rays of a stream; see [`RayStream::take_shadows`].
#[derive(Debug)]
pub struct TracedShadows<'a, S> {
    /// The shadow rays.
    pub rays: &'a [Ray],
    /// Their payloads.
    pub payloads: &'a [S],
    /// 1 where something was hit, else 0. The taker may change it.
    pub occluded: &'a mut [u32],
}

/// A stream that a device has traced, and what it cost.
pub type Dispatched<P, S> = (RayStream<Traced, P, S>, DeviceReport);

/// A stream that a device failed to trace. If it traced a part, that part is traced again.
#[derive(Debug)]
pub struct Untraced<P, S> {
    /// The stream.
    pub stream: RayStream<Full, P, S>,
    /// Reason of the device's failure.
    pub reason: String,
}

impl<State, P, S> RayStream<State, P, S> {
    /// Number of rays, shaded ones included.
    pub fn rays(&self) -> usize {
        self.payloads.len()
    }

    /// Number of shadow rays, taken ones included.
    pub fn shadow_rays(&self) -> usize {
        self.shadow_payloads.len()
    }

    fn data(&mut self) -> &mut StreamData {
        Arc::get_mut(&mut self.data).expect("chunks live no longer than the state Tracing")
    }

    fn into_state<Next>(self, state: Next) -> RayStream<Next, P, S> {
        let Self { data, payloads, shadow_payloads, .. } = self;
        RayStream { data, payloads, shadow_payloads, state }
    }

    /// Removes all rays, whatever their state, when the job has been cancelled. The memory is kept.
    ///
    /// # Panics
    /// If a thread still has a chunk of the stream.
    pub fn discard(mut self) -> RayStream<Empty, P, S> {
        self.payloads.clear();
        self.shadow_payloads.clear();
        let data = self.data();
        data.rays.clear();
        data.shadow_rays.clear();
        self.into_state(Empty)
    }
}

impl<P, S> RayStream<Empty, P, S> {
    /// A stream without memory. [`RayStream::append`] allocates, so this may be called under a lock.
    #[expect(clippy::new_without_default, reason = "streams are counted: creating one is a decision")]
    pub fn new() -> Self {
        Self { data: Arc::default(), payloads: Vec::new(), shadow_payloads: Vec::new(), state: Empty }
    }

    /// Opens the stream for appending.
    pub fn fill(self) -> RayStream<Filling, P, S> {
        self.into_state(Filling)
    }
}

impl<P, S> RayStream<Filling, P, S> {
    /// Appends the rays that `emit` emits, and returns its value. If the stream has no rays yet, memory for
    /// `capacity` is provided first: from `device` if it offers any, else from the host.
    ///
    /// # Panics
    /// If the stream then holds more than `capacity`, or not as many rays as payloads.
    pub fn append<T>(
        &mut self,
        capacity: Capacity,
        device: Option<&dyn DeviceTracer>,
        emit: impl FnOnce(StreamAppender<'_, P, S>) -> T,
    ) -> T {
        let Self { data, payloads, shadow_payloads, .. } = self;
        let data = Arc::get_mut(data).expect("chunks live no longer than the state Tracing");
        if data.rays.is_empty() && data.shadow_rays.is_empty() {
            provide_memory(data, capacity, device);
            reserve(payloads, capacity.rays);
            reserve(shadow_payloads, capacity.shadow_rays);
        }
        let value = emit(StreamAppender {
            rays: data.rays.appender(),
            payloads,
            shadow_rays: data.shadow_rays.appender(),
            shadow_payloads,
        });
        let (rays, shadow_rays) = (data.rays.len(), data.shadow_rays.len());
        assert!(
            rays == payloads.len() && shadow_rays == shadow_payloads.len(),
            "every ray has a payload: {rays} rays have {}, {shadow_rays} shadow rays have {}",
            payloads.len(),
            shadow_payloads.len()
        );
        assert!(
            rays <= capacity.rays && shadow_rays <= capacity.shadow_rays,
            "a stream that takes {} rays and {} shadow rays was given {rays} and {shadow_rays}",
            capacity.rays,
            capacity.shadow_rays
        );
        value
    }

    /// Ends appending.
    pub fn seal(self) -> RayStream<Full, P, S> {
        self.into_state(Full)
    }

    /// Makes an unused stream empty again.
    ///
    /// # Panics
    /// If it holds rays.
    pub fn unfill(self) -> RayStream<Empty, P, S> {
        assert!(self.rays() == 0 && self.shadow_rays() == 0, "rays may not be lost");
        self.into_state(Empty)
    }
}

/// Provides memory for an empty stream, unless the memory that it has is sound and large enough.
fn provide_memory(data: &mut StreamData, capacity: Capacity, device: Option<&dyn DeviceTracer>) {
    let offered = device.and_then(|device| device.stream_memory(capacity, data.rays.memory.device()));
    if let Some(StreamMemory { rays, hits, shadow_rays, occluded }) = offered {
        data.rays = RayArray::of(Memory::Device(rays));
        data.shadow_rays = RayArray::of(Memory::Device(shadow_rays));
        *data.answers() = StreamAnswers { hits: Memory::Device(hits), occluded: Memory::Device(occluded) };
        return;
    }
    let suffices = |memory: &Memory<Ray>, capacity| {
        memory.device().is_none_or(|memory| memory.is_sound()) && memory.len() >= capacity
    };
    if !suffices(&data.rays.memory, capacity.rays)
        || !suffices(&data.shadow_rays.memory, capacity.shadow_rays)
    {
        data.rays = RayArray::with_capacity(capacity.rays);
        data.shadow_rays = RayArray::with_capacity(capacity.shadow_rays);
        data.move_answers_to_host();
    }
}

fn reserve<T>(payloads: &mut Vec<T>, capacity: usize) {
    payloads.reserve_exact(capacity.saturating_sub(payloads.len()));
}

impl<P, S> RayStream<Full, P, S> {
    /// Opens the stream for tracing in chunks.
    pub fn open(self) -> RayStream<Tracing, P, S> {
        self.into_state(Tracing { next: 0, chunks_out: 0 })
    }

    /// Shares the stream with a device.
    pub fn give(self) -> (RayStream<OnDevice, P, S>, DeviceStream) {
        let share = DeviceStream::new(&self.data);
        (self.into_state(OnDevice), share)
    }

    /// Traces the stream on a device and waits for the answers.
    ///
    /// # Errors
    /// [`Untraced`] if the device is lost or its tracer panics.
    pub fn trace_on(self, device: &dyn DeviceTracer) -> Result<Dispatched<P, S>, Untraced<P, S>> {
        let (stream, share) = self.give();
        let answers = catching(move || {
            let mut ticket = device.submit(vec![share]).map_err(|error| error.to_string())?;
            loop {
                if let Some(answers) = ticket.wait(Duration::MAX).map_err(|error| error.to_string())? {
                    return Ok(answers);
                }
            }
        });
        match answers.map(|mut answers| answers.pop()) {
            Ok(Some(resolve)) => stream.answered(resolve).resolve(),
            Ok(None) => Err(Untraced { stream: stream.take_back(), reason: NO_ANSWER.to_owned() }),
            Err(reason) => Err(Untraced { stream: stream.take_back(), reason }),
        }
    }
}

const NO_ANSWER: &str = "it did not answer for each stream";

/// Runs a device's code; a panic is an error.
pub fn catching<T>(work: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(work))
        .unwrap_or_else(|payload| Err(format!("it panicked: {}", panic_message(payload))))
}

impl<P, S> RayStream<OnDevice, P, S> {
    /// Ends the device's work. The stream has what its answers are made of.
    pub fn answered(self, resolve: Box<dyn Resolve>) -> RayStream<Answered, P, S> {
        self.into_state(Answered { resolve })
    }

    /// Takes the stream back, whatever the device has written. If the device does not drop its share, the rays are
    /// copied.
    pub fn take_back(self) -> RayStream<Full, P, S> {
        self.into_state(Full).own()
    }
}

impl<P, S> RayStream<Full, P, S> {
    /// The stream without memory to which a device may still write. Devices only read rays, so those stay.
    fn own(mut self) -> Self {
        let StreamData { rays, shadow_rays, .. } = &*self.data;
        if Arc::strong_count(&self.data) > 1 {
            self.data = Arc::new(StreamData::copy_of(rays, shadow_rays));
        } else if self.data().answers().hits.device().is_some() {
            self.data().move_answers_to_host();
        }
        self
    }
}

impl<P, S> RayStream<Answered, P, S> {
    /// Makes canonical answers of what the device has written.
    ///
    /// # Errors
    /// [`Untraced`] if the device has answered wrongly or its tracer panics.
    pub fn resolve(self) -> Result<Dispatched<P, S>, Untraced<P, S>> {
        let Self { data, payloads, shadow_payloads, state: Answered { resolve } } = self;
        let share = DeviceStream::new(&data);
        let resolved = catching(move || resolve.resolve(&share).map_err(|error| error.to_string()));
        let stream = RayStream { data, payloads, shadow_payloads, state: Full };
        let is_own = Arc::strong_count(&stream.data) == 1;
        match resolved {
            Ok(report) if is_own => {
                Ok((stream.into_state(Traced { shaded: 0, shadows_taken: false }), report))
            }
            Ok(_) => Err(Untraced { stream: stream.own(), reason: "it keeps a stream".to_owned() }),
            Err(reason) => Err(Untraced { stream: stream.own(), reason }),
        }
    }
}

impl<P, S> RayStream<Tracing, P, S> {
    /// Number of rays and shadow rays that are in no chunk yet.
    pub fn left(&self) -> usize {
        self.rays() + self.shadow_rays() - self.state.next
    }

    /// The next chunk, of at most `most` ≥ 1 rays and shadow rays together.
    ///
    /// # Panics
    /// If nothing is left.
    pub fn next_chunk(&mut self, most: usize) -> Chunk {
        let len = self.left().min(most);
        assert!(len > 0, "there is a ray left");
        let chunk = Chunk::new(Arc::clone(&self.data), self.state.next..self.state.next + len);
        self.state.next += len;
        self.state.chunks_out += 1;
        chunk
    }

    /// True if a chunk belongs to this stream.
    pub fn owns(&self, chunk: &TracedChunk) -> bool {
        chunk.is_of(&self.data)
    }

    /// Puts a traced chunk back.
    ///
    /// # Panics
    /// If it belongs to another stream.
    pub fn put_back(&mut self, chunk: TracedChunk) {
        assert!(self.owns(&chunk), "a chunk returns to its stream");
        self.state.chunks_out -= 1;
    }

    /// True if all rays were in chunks, and all chunks are back.
    pub fn is_traced(&self) -> bool {
        self.left() == 0 && self.state.chunks_out == 0
    }

    /// Ends tracing.
    ///
    /// # Panics
    /// Unless [`RayStream::is_traced`].
    pub fn close(self) -> RayStream<Traced, P, S> {
        assert!(self.is_traced(), "every chunk is back");
        self.into_state(Traced { shaded: 0, shadows_taken: false })
    }
}

impl<P, S> RayStream<Traced, P, S> {
    /// Number of rays not yet taken for shading.
    pub fn rays_left(&self) -> usize {
        self.rays() - self.state.shaded
    }

    /// Number of shadow rays not yet taken.
    pub fn shadow_rays_left(&self) -> usize {
        if self.state.shadows_taken { 0 } else { self.shadow_rays() }
    }

    /// Takes the shadow rays: all of them the first time, then none.
    pub fn take_shadows(&mut self) -> TracedShadows<'_, S> {
        let len = self.shadow_rays_left();
        self.state.shadows_taken = true;
        let Self { data, shadow_payloads, .. } = self;
        let data = Arc::get_mut(data).expect("chunks live no longer than the state Tracing");
        let answers = data.answers.get_mut().unwrap_or_else(PoisonError::into_inner);
        TracedShadows {
            rays: &data.shadow_rays[..len],
            payloads: &shadow_payloads[..len],
            occluded: &mut answers.occluded[..len],
        }
    }

    /// Takes the next rays for shading, at most `most`; none once all have been taken.
    ///
    /// # Panics
    /// If the shadow rays have not been taken: their answers are used first (RA section 3.2).
    pub fn next_batch(&mut self, most: usize) -> TracedRays<'_, P> {
        assert!(self.state.shadows_taken, "shadow rays are taken before rays are shaded");
        let range = self.state.shaded..self.state.shaded + self.rays_left().min(most);
        self.state.shaded = range.end;
        let Self { data, payloads, .. } = self;
        let data = Arc::get_mut(data).expect("chunks live no longer than the state Tracing");
        let answers = data.answers.get_mut().unwrap_or_else(PoisonError::into_inner);
        TracedRays {
            rays: &mut data.rays[range.clone()],
            hits: &mut answers.hits[range.clone()],
            payloads: &mut payloads[range],
        }
    }

    /// Makes the stream empty again. The memory is kept.
    ///
    /// # Panics
    /// If a ray or shadow ray has not been taken.
    pub fn recycle(self) -> RayStream<Empty, P, S> {
        assert!(self.rays_left() == 0 && self.shadow_rays_left() == 0, "rays may not be lost");
        self.discard()
    }
}
