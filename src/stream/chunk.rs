//! A chunk: the part of a stream that one host thread traces at once (RA section 3, the job slot).

use super::device_memory::Memory;
use super::{Column, Hit, InPlace, Ray, Tracer};
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

/// What tracers see of a stream. While chunks are out the rays are read by several threads at once;
/// answers are written under their lock, copied in from the thread's own [`Scratch`].
#[derive(Debug, Default)]
pub(super) struct Body {
    pub(super) rays: Column,
    pub(super) shadow_rays: Column,
    pub(super) answers: Mutex<Answers>,
}

/// Answers to rays and shadow rays. There is a place for each; what is there before tracing is of earlier rays.
#[derive(Debug, Default)]
pub(super) struct Answers {
    pub(super) hits: Memory<Hit>,
    pub(super) occluded: Memory<u32>,
}

impl Body {
    pub(super) fn answers(&mut self) -> &mut Answers {
        self.answers.get_mut().unwrap_or_else(PoisonError::into_inner)
    }

    /// Everything, if a device has lent the memory for it.
    pub(super) fn in_place(&mut self) -> Option<InPlace<'_>> {
        let Answers { hits, occluded } = self.answers.get_mut().unwrap_or_else(PoisonError::into_inner);
        Some(InPlace {
            ray_count: self.rays.len(),
            rays: self.rays.memory.device_mut()?,
            hits: hits.device_mut()?,
            shadow_ray_count: self.shadow_rays.len(),
            shadow_rays: self.shadow_rays.memory.device_mut()?,
            occluded: occluded.device_mut()?,
        })
    }

    /// Gives answers other places, in host memory: where they were, a lost device may still be writing.
    pub(super) fn renew_answers(&mut self) {
        let (rays, shadow_rays) = (self.rays.memory.len(), self.shadow_rays.memory.len());
        *self.answers() = Answers { hits: Memory::host(rays), occluded: Memory::host(shadow_rays) };
    }
}

fn grow<T: Copy>(column: &mut Vec<T>, len: usize, value: T) {
    if column.len() < len {
        column.resize(len, value);
    }
}

/// A host thread's own answers, kept from chunk to chunk so that nothing is allocated.
#[derive(Debug, Default)]
pub struct Scratch {
    hits: Vec<Hit>,
    occluded: Vec<u32>,
}

/// Part of a stream, to be traced.
#[derive(Debug)]
pub struct Chunk {
    body: Arc<Body>,
    rays: Range<usize>,
    shadow_rays: Range<usize>,
}

/// A chunk whose answers are in its stream.
#[derive(Debug)]
pub struct TracedChunk {
    body: Arc<Body>,
    rays: usize,
}

impl Chunk {
    /// The rays `range` of a stream whose shadow rays are numbered on after its rays.
    pub(super) fn new(body: Arc<Body>, range: Range<usize>) -> Self {
        let rays = body.rays.len();
        Self {
            rays: range.start.min(rays)..range.end.min(rays),
            shadow_rays: range.start.max(rays) - rays..range.end.max(rays) - rays,
            body,
        }
    }

    /// Rays and shadow rays together.
    pub fn len(&self) -> usize {
        self.rays.len() + self.shadow_rays.len()
    }

    /// Whether there is nothing to trace; no chunk handed out is.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Traces the rays on the calling thread and writes the answers into the stream.
    pub fn trace(self, tracer: &dyn Tracer, scratch: &mut Scratch) -> TracedChunk {
        let body = &*self.body;
        let (rays, shadow_rays) =
            (&body.rays[self.rays.clone()], &body.shadow_rays[self.shadow_rays.clone()]);
        if self.len() == body.rays.len() + body.shadow_rays.len() {
            // Nobody else has a chunk of this stream: write in place.
            let mut answers = body.answers.lock().unwrap_or_else(PoisonError::into_inner);
            let Answers { hits, occluded } = &mut *answers;
            trace(tracer, rays, &mut hits[self.rays], shadow_rays, &mut occluded[self.shadow_rays]);
        } else {
            grow(&mut scratch.hits, rays.len(), Hit::NONE);
            grow(&mut scratch.occluded, shadow_rays.len(), 0);
            let hits = &mut scratch.hits[..rays.len()];
            let occluded = &mut scratch.occluded[..shadow_rays.len()];
            trace(tracer, rays, hits, shadow_rays, occluded);
            let mut answers = body.answers.lock().unwrap_or_else(PoisonError::into_inner);
            answers.hits[self.rays].copy_from_slice(hits);
            answers.occluded[self.shadow_rays].copy_from_slice(occluded);
        }
        TracedChunk { rays: rays.len() + shadow_rays.len(), body: self.body }
    }
}

fn trace(tracer: &dyn Tracer, rays: &[Ray], hits: &mut [Hit], shadow_rays: &[Ray], occluded: &mut [u32]) {
    if !rays.is_empty() {
        tracer.closest(rays, hits);
    }
    if !shadow_rays.is_empty() {
        tracer.occluded(shadow_rays, occluded);
    }
}

impl TracedChunk {
    /// Rays and shadow rays traced.
    pub fn rays(&self) -> usize {
        self.rays
    }

    pub(super) fn is_of(&self, body: &Arc<Body>) -> bool {
        Arc::ptr_eq(&self.body, body)
    }
}
