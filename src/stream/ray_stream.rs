//! The ray stream: a large buffer of arbitrary rays (RA section 3) whose type says what may be done
//! with it. A stream is a value; it moves from state to state and from list to list, so it is in
//! exactly one place, and shading an untraced stream does not compile.
//!
//! ```text
//! Empty ─fill→ Filling ─seal→ Full ─open→ Tracing (chunks out) ─close→ Traced ─recycle→ Empty
//!                                └──── trace_on a device ──────────────┘
//! ```

use super::chunk::{Answers, Body};
use super::device_memory::Memory;
use super::{
    Appender, Chunk, Column, DeviceError, DeviceMemorySource, DeviceReport, DeviceTracer, Hit, Queries, Ray,
    TracedChunk, panic_message,
};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, PoisonError};

/// Holds nothing.
#[derive(Debug)]
pub struct Empty;

/// Takes rays; written by one thread at a time.
#[derive(Debug)]
pub struct Filling;

/// Holds rays that wait to be traced and takes no more.
#[derive(Debug)]
pub struct Full;

/// Is being traced by host threads, each at a chunk of it.
#[derive(Debug)]
pub struct Tracing {
    /// The next ray to hand out; shadow rays are numbered on after the rays.
    next: usize,
    /// Chunks handed out and not yet put back.
    out: usize,
}

/// Holds an answer for each of its rays and shadow rays; on its way through shading.
#[derive(Debug)]
pub struct Traced {
    /// Rays shaded so far.
    shaded: usize,
    /// Whether the shadow rays have been taken.
    shadows_taken: bool,
}

/// How much a stream may hold; see [`RayStream::append`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capacity {
    /// Most rays.
    pub rays: usize,
    /// Most shadow rays.
    pub shadow_rays: usize,
}

impl Capacity {
    /// Bytes of a stream that holds so much, with these payloads.
    pub fn bytes<P, S>(self) -> usize {
        self.rays * (size_of::<Ray>() + size_of::<Hit>() + size_of::<P>())
            + self.shadow_rays * (size_of::<Ray>() + size_of::<u32>() + size_of::<S>())
    }
}

/// Rays with their payloads and hits; beside them the shadow rays of the paths they continue, with
/// payloads and answers of their own. `State` is one of [`Empty`], [`Filling`], [`Full`],
/// [`Tracing`], [`Traced`].
#[derive(Debug)]
pub struct RayStream<State, P, S> {
    /// What tracers see. Shared with chunks only while `Tracing`, otherwise this stream's alone.
    body: Arc<Body>,
    payloads: Vec<P>,
    shadow_payloads: Vec<S>,
    state: State,
}

/// Where rays are appended; see [`RayStream::append`].
#[derive(Debug)]
pub struct Columns<'a, P, S> {
    /// Rays, as many as payloads.
    pub rays: Appender<'a>,
    /// What travels with the rays.
    pub payloads: &'a mut Vec<P>,
    /// Shadow rays, as many as shadow payloads.
    pub shadow_rays: Appender<'a>,
    /// What travels with the shadow rays.
    pub shadow_payloads: &'a mut Vec<S>,
}

/// Consecutive traced rays of a stream; see [`RayStream::next_batch`].
#[derive(Debug)]
pub struct TracedRays<'a, P> {
    /// The rays.
    pub rays: &'a [Ray],
    /// Their nearest hits.
    pub hits: &'a [Hit],
    /// What travelled with them.
    pub payloads: &'a [P],
}

/// The traced shadow rays of a stream; see [`RayStream::take_shadows`].
#[derive(Debug)]
pub struct TracedShadows<'a, S> {
    /// The shadow rays.
    pub rays: &'a [Ray],
    /// What travelled with them.
    pub payloads: &'a [S],
    /// 1 where something was hit, else 0.
    pub occluded: &'a [u32],
}

/// A stream that a device has traced, and at what cost.
pub type Dispatched<P, S> = (RayStream<Traced, P, S>, DeviceReport);

/// A stream that a device has not traced, or only in part, which counts as not at all.
#[derive(Debug)]
pub struct Untraced<P, S> {
    /// The stream.
    pub stream: RayStream<Full, P, S>,
    /// What happened to the device.
    pub reason: String,
}

impl<State, P, S> RayStream<State, P, S> {
    /// Rays held, shaded ones included.
    pub fn rays(&self) -> usize {
        self.payloads.len()
    }

    /// Shadow rays held, taken ones included.
    pub fn shadow_rays(&self) -> usize {
        self.shadow_payloads.len()
    }

    fn body(&mut self) -> &mut Body {
        Arc::get_mut(&mut self.body).expect("chunks live no longer than the state Tracing")
    }

    fn into_state<Next>(self, state: Next) -> RayStream<Next, P, S> {
        let Self { body, payloads, shadow_payloads, .. } = self;
        RayStream { body, payloads, shadow_payloads, state }
    }

    /// Empties the stream whatever is in it, when its job has been given up; its storage is kept.
    ///
    /// # Panics
    /// If a chunk of it is still with a thread.
    pub fn discard(mut self) -> RayStream<Empty, P, S> {
        self.payloads.clear();
        self.shadow_payloads.clear();
        let body = self.body();
        body.rays.clear();
        body.shadow_rays.clear();
        self.into_state(Empty)
    }
}

/// How many paths `rays` rays and `shadow_rays` shadow rays stand for, when every path has at most
/// one ray and `shadow_rays_per_path` ≥ 1 shadow rays. Appending what `n` paths emit raises it by at
/// most `n`.
pub fn paths(rays: usize, shadow_rays: usize, shadow_rays_per_path: usize) -> usize {
    rays.max(shadow_rays.div_ceil(shadow_rays_per_path))
}

impl<P, S> RayStream<Empty, P, S> {
    /// A stream without storage; [`RayStream::append`] makes it, so that this may be called under a
    /// lock.
    #[expect(clippy::new_without_default, reason = "making a stream is a decision")]
    pub fn new() -> Self {
        Self { body: Arc::default(), payloads: Vec::new(), shadow_payloads: Vec::new(), state: Empty }
    }

    /// Opens the stream for appending.
    pub fn fill(self) -> RayStream<Filling, P, S> {
        self.into_state(Filling)
    }
}

impl<P, S> RayStream<Filling, P, S> {
    /// Appends what `emit` emits. The first time, the stream gets room for `capacity`: memory that `device` lends if it
    /// does, else the host's own.
    ///
    /// # Panics
    /// If there is then more in the stream than `capacity`, or a payload without its ray.
    pub fn append<T>(
        &mut self,
        capacity: Capacity,
        device: Option<&dyn DeviceTracer>,
        emit: impl FnOnce(Columns<'_, P, S>) -> T,
    ) -> T {
        let Self { body, payloads, shadow_payloads, .. } = self;
        let body = Arc::get_mut(body).expect("chunks live no longer than the state Tracing");
        if body.rays.is_empty() && body.shadow_rays.is_empty() {
            settle(body, capacity, device);
            reserve(payloads, capacity.rays);
            reserve(shadow_payloads, capacity.shadow_rays);
        }
        let value = emit(Columns {
            rays: body.rays.appender(),
            payloads,
            shadow_rays: body.shadow_rays.appender(),
            shadow_payloads,
        });
        let (rays, shadow_rays) = (body.rays.len(), body.shadow_rays.len());
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

    /// Closes the stream for appending.
    pub fn seal(self) -> RayStream<Full, P, S> {
        self.into_state(Full)
    }

    /// Takes the stream back unused.
    ///
    /// # Panics
    /// If there are rays in it.
    pub fn unfill(self) -> RayStream<Empty, P, S> {
        assert!(self.rays() == 0 && self.shadow_rays() == 0, "rays may not be lost");
        self.into_state(Empty)
    }
}

/// Finds memory for an empty stream, unless what it has will do.
fn settle(body: &mut Body, capacity: Capacity, device: Option<&dyn DeviceTracer>) {
    let lent = device.and_then(|device| device.memory_source(capacity, body.rays.memory.device()));
    if let Some(DeviceMemorySource { rays, hits, shadow_rays, occluded }) = lent {
        body.rays = Column::of(Memory::Lent(rays));
        body.shadow_rays = Column::of(Memory::Lent(shadow_rays));
        *body.answers() = Answers { hits: Memory::Lent(hits), occluded: Memory::Lent(occluded) };
        return;
    }
    let fits = |memory: &Memory<Ray>, room| {
        memory.device().is_none_or(|device| device.is_sound()) && memory.len() >= room
    };
    if !fits(&body.rays.memory, capacity.rays) || !fits(&body.shadow_rays.memory, capacity.shadow_rays) {
        body.rays = Column::with_capacity(capacity.rays);
        body.shadow_rays = Column::with_capacity(capacity.shadow_rays);
        body.renew_answers();
    }
}

fn reserve<T>(column: &mut Vec<T>, capacity: usize) {
    column.reserve_exact(capacity.saturating_sub(column.len()));
}

impl<P, S> RayStream<Full, P, S> {
    /// Opens the stream for tracing in chunks.
    pub fn open(self) -> RayStream<Tracing, P, S> {
        self.into_state(Tracing { next: 0, out: 0 })
    }

    /// Traces the stream on a device: in place if it lies in memory of the device's, else in pieces of at most
    /// [`DeviceTracer::max_rays`].
    ///
    /// # Errors
    /// [`Untraced`] when the device is lost or panics.
    pub fn trace_on(mut self, device: &dyn DeviceTracer) -> Result<Dispatched<P, S>, Untraced<P, S>> {
        let body = self.body();
        let traced = catch_unwind(AssertUnwindSafe(|| {
            let in_place = body.in_place().and_then(|stream| device.trace_in_place(stream));
            in_place.unwrap_or_else(|| trace_in_pieces(body, device))
        }));
        let reason = match traced {
            Ok(Ok(report)) => {
                return Ok((self.into_state(Traced { shaded: 0, shadows_taken: false }), report));
            }
            Ok(Err(error)) => error.to_string(),
            Err(payload) => format!("it panicked: {}", panic_message(payload)),
        };
        // Rays are only read by the device, even by one that has gone astray.
        if self.body().answers().hits.device().is_some() {
            self.body().renew_answers();
        }
        Err(Untraced { stream: self, reason })
    }
}

fn trace_in_pieces(body: &mut Body, device: &dyn DeviceTracer) -> Result<DeviceReport, DeviceError> {
    let most = device.max_rays();
    if most == 0 {
        return Err(DeviceError::Lost("it takes no rays".to_owned()));
    }
    let (rays, shadow_rays) = (body.rays.len(), body.shadow_rays.len());
    let Answers { hits, occluded } = body.answers.get_mut().unwrap_or_else(PoisonError::into_inner);
    let mut report = DeviceReport::default();
    for start in (0..rays.max(shadow_rays)).step_by(most) {
        let piece = |len: usize| start.min(len)..start.saturating_add(most).min(len);
        report += device.trace(Queries {
            rays: &body.rays[piece(rays)],
            hits: &mut hits[piece(rays)],
            shadow_rays: &body.shadow_rays[piece(shadow_rays)],
            occluded: &mut occluded[piece(shadow_rays)],
        })?;
    }
    Ok(report)
}

impl<P, S> RayStream<Tracing, P, S> {
    /// Rays and shadow rays not yet handed out.
    pub fn left(&self) -> usize {
        self.rays() + self.shadow_rays() - self.state.next
    }

    /// Hands out the next chunk, of at most `most` ≥ 1 rays and shadow rays together.
    ///
    /// # Panics
    /// If nothing is left.
    pub fn next_chunk(&mut self, most: usize) -> Chunk {
        let len = self.left().min(most);
        assert!(len > 0, "there is a ray left to hand out");
        let chunk = Chunk::new(Arc::clone(&self.body), self.state.next..self.state.next + len);
        self.state.next += len;
        self.state.out += 1;
        chunk
    }

    /// Whether a chunk is of this stream.
    pub fn owns(&self, chunk: &TracedChunk) -> bool {
        chunk.is_of(&self.body)
    }

    /// Takes a chunk back, traced.
    ///
    /// # Panics
    /// If it is another stream's.
    pub fn put_back(&mut self, chunk: TracedChunk) {
        assert!(self.owns(&chunk), "a chunk returns to its stream");
        self.state.out -= 1;
    }

    /// Whether every chunk has been handed out and put back.
    pub fn is_traced(&self) -> bool {
        self.left() == 0 && self.state.out == 0
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
    /// Rays not yet shaded.
    pub fn rays_left(&self) -> usize {
        self.rays() - self.state.shaded
    }

    /// Shadow rays not yet taken.
    pub fn shadow_rays_left(&self) -> usize {
        if self.state.shadows_taken { 0 } else { self.shadow_rays() }
    }

    /// Takes the shadow rays: all of them the first time, then none.
    pub fn take_shadows(&mut self) -> TracedShadows<'_, S> {
        let len = self.shadow_rays_left();
        self.state.shadows_taken = true;
        let Self { body, shadow_payloads, .. } = self;
        let body = Arc::get_mut(body).expect("chunks live no longer than the state Tracing");
        let answers = body.answers.get_mut().unwrap_or_else(PoisonError::into_inner);
        TracedShadows {
            rays: &body.shadow_rays[..len],
            payloads: &shadow_payloads[..len],
            occluded: &answers.occluded[..len],
        }
    }

    /// Takes the next rays, at most `most`; none when all have been shaded.
    ///
    /// # Panics
    /// If the shadow rays have not been taken: their answers come first (RA section 3.2).
    pub fn next_batch(&mut self, most: usize) -> TracedRays<'_, P> {
        assert!(self.state.shadows_taken, "shadow rays are taken before rays are shaded");
        let range = self.state.shaded..self.state.shaded + self.rays_left().min(most);
        self.state.shaded = range.end;
        let Self { body, payloads, .. } = self;
        let body = Arc::get_mut(body).expect("chunks live no longer than the state Tracing");
        let answers = body.answers.get_mut().unwrap_or_else(PoisonError::into_inner);
        TracedRays {
            rays: &body.rays[range.clone()],
            hits: &answers.hits[range.clone()],
            payloads: &payloads[range],
        }
    }

    /// Makes the stream empty again; its storage is kept.
    ///
    /// # Panics
    /// If anything in it has not been taken.
    pub fn recycle(self) -> RayStream<Empty, P, S> {
        assert!(self.rays_left() == 0 && self.shadow_rays_left() == 0, "rays may not be lost");
        self.discard()
    }
}
