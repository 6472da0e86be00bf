//! A chunk: the part of a ray stream that one host thread traces at once (RA section 3, the job slot).

use super::device_memory::Memory;
use super::{Hit, Ray, RayArray, Tracer};
use crate::sync::{Arc, Mutex, PoisonError};
use std::ops::Range;

/// Data of a stream that tracers use. While chunks are out, several threads read the rays at once. Each computes
/// its answers in its own [`ChunkScratch`] and copies them here under the lock.
#[derive(Debug, Default)]
pub(super) struct StreamData {
    pub(super) rays: RayArray,
    pub(super) shadow_rays: RayArray,
    pub(super) answers: Mutex<StreamAnswers>,
}

/// The answers to all rays and shadow rays. Before tracing they are those of earlier rays.
#[derive(Debug, Default)]
pub(super) struct StreamAnswers {
    pub(super) hits: Memory<Hit>,
    pub(super) occluded: Memory<u32>,
}

impl StreamData {
    pub(super) fn answers(&mut self) -> &mut StreamAnswers {
        self.answers.get_mut().unwrap_or_else(PoisonError::into_inner)
    }

    /// The rays in host memory, with room for as many as before.
    pub(super) fn copy_of(rays: &RayArray, shadow_rays: &RayArray) -> Self {
        let (rays, shadow_rays) = (rays.to_host(), shadow_rays.to_host());
        let mut copy = Self { rays, shadow_rays, answers: Mutex::default() };
        copy.move_answers_to_host();
        copy
    }

    /// Replaces the answers by host memory of the same size. A lost device may still write to the old memory.
    pub(super) fn move_answers_to_host(&mut self) {
        let (rays, shadow_rays) = (self.rays.memory.len(), self.shadow_rays.memory.len());
        *self.answers() = StreamAnswers { hits: Memory::host(rays), occluded: Memory::host(shadow_rays) };
    }
}

fn grow<T: Copy>(answers: &mut Vec<T>, len: usize, value: T) {
    if answers.len() < len {
        answers.resize(len, value);
    }
}

/// A host thread's answers to a chunk. Reused from chunk to chunk, so that nothing is allocated.
#[derive(Debug, Default)]
pub struct ChunkScratch {
    hits: Vec<Hit>,
    occluded: Vec<u32>,
}

/// A part of a stream that is to be traced.
#[derive(Debug)]
pub struct Chunk {
    data: Arc<StreamData>,
    /// Indices of its rays.
    rays: Range<usize>,
    /// Indices of its shadow rays.
    shadow_rays: Range<usize>,
}

/// A chunk that has been traced: its answers are in the stream.
#[derive(Debug)]
pub struct TracedChunk {
    data: Arc<StreamData>,
    rays: usize,
}

impl Chunk {
    /// The rays `range` of a stream, whose shadow rays are numbered after its rays.
    pub(super) fn new(data: Arc<StreamData>, range: Range<usize>) -> Self {
        let rays = data.rays.len();
        Self {
            rays: range.start.min(rays)..range.end.min(rays),
            shadow_rays: range.start.max(rays) - rays..range.end.max(rays) - rays,
            data,
        }
    }

    /// Number of rays and shadow rays.
    pub fn len(&self) -> usize {
        self.rays.len() + self.shadow_rays.len()
    }

    /// True if there is nothing to trace. No chunk of a stream is empty.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Traces the rays on the calling thread and writes the answers into the stream.
    pub fn trace(self, tracer: &dyn Tracer, scratch: &mut ChunkScratch) -> TracedChunk {
        let data = &*self.data;
        let (rays, shadow_rays) =
            (&data.rays[self.rays.clone()], &data.shadow_rays[self.shadow_rays.clone()]);
        if self.len() == data.rays.len() + data.shadow_rays.len() {
            // This chunk is the whole stream, so no other thread waits for the lock: write in place.
            let mut answers = data.answers.lock().unwrap_or_else(PoisonError::into_inner);
            let StreamAnswers { hits, occluded } = &mut *answers;
            trace(tracer, rays, &mut hits[self.rays], shadow_rays, &mut occluded[self.shadow_rays]);
        } else {
            grow(&mut scratch.hits, rays.len(), Hit::NONE);
            grow(&mut scratch.occluded, shadow_rays.len(), 0);
            let hits = &mut scratch.hits[..rays.len()];
            let occluded = &mut scratch.occluded[..shadow_rays.len()];
            trace(tracer, rays, hits, shadow_rays, occluded);
            let mut answers = data.answers.lock().unwrap_or_else(PoisonError::into_inner);
            answers.hits[self.rays].copy_from_slice(hits);
            answers.occluded[self.shadow_rays].copy_from_slice(occluded);
        }
        TracedChunk { rays: rays.len() + shadow_rays.len(), data: self.data }
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
    /// Number of rays and shadow rays.
    pub fn rays(&self) -> usize {
        self.rays
    }

    pub(super) fn is_of(&self, data: &Arc<StreamData>) -> bool {
        Arc::ptr_eq(&self.data, data)
    }
}
