//! The four lists and the job slot of one job: where streams are while no thread has them.

use super::Limits;
use super::limits::BUNDLE_STREAMS;
use crate::stream::{Answered, Chunk, Empty, Filling, Full, RayStream, Traced, TracedChunk, Tracing, paths};
use std::collections::VecDeque;

/// EMPTY, NEEDMORE, TRACE, the job slot and SHADE. All but TRACE are stacks, because the stream used last is still in
/// the cache. A thread takes the last stream that it used itself, if there is one: others are in other cores' caches.
pub(super) struct Lists<P, S> {
    limits: Limits,
    empty: Vec<Used<RayStream<Empty, P, S>>>,
    need_more: Vec<Used<RayStream<Filling, P, S>>>,
    /// The device takes the oldest stream, a host thread the newest that it has filled, or else the newest.
    trace: VecDeque<Waiting<P, S>>,
    /// Rays and shadow rays in TRACE.
    trace_rays: usize,
    /// The job slot: the stream whose chunks are being handed out to host threads.
    slot: Option<RayStream<Tracing, P, S>>,
    /// Streams that host threads have taken from a device, and that follow the one in the job slot.
    reclaimed: Vec<RayStream<Full, P, S>>,
    /// Streams whose chunks have all been handed out. A host thread has a chunk of each.
    handed_out: Vec<RayStream<Tracing, P, S>>,
    /// Streams that the device has traced and that are not resolved.
    answered: VecDeque<(RayStream<Answered, P, S>, Waits)>,
    /// Streams of SHADE that have not been shaded at all.
    shade: Vec<Used<RayStream<Traced, P, S>>>,
    /// Streams of SHADE that have been shaded in part. They are taken before all others, so they are few.
    begun: Vec<Used<RayStream<Traced, P, S>>>,
    /// Streams allocated so far, in the lists or with threads.
    made: usize,
}

/// Nanoseconds that a stream waited until it was submitted, and from there until its answers could be read.
pub(super) type Waits = [u64; 2];

/// A full stream, and when it entered TRACE, if it did.
pub(super) type FullSince<P, S> = (RayStream<Full, P, S>, Option<u64>);

/// A stream of TRACE, and when it entered.
struct Waiting<P, S> {
    stream: RayStream<Full, P, S>,
    /// The thread that has filled it.
    thread: usize,
    since_ns: u64,
}

/// A stream, and the thread that has used it last.
struct Used<T> {
    stream: T,
    thread: usize,
}

/// Takes the last stream that a thread has used, or else the last one.
fn take_last<T>(list: &mut Vec<Used<T>>, thread: usize) -> Option<T> {
    let last = list.len().checked_sub(1)?;
    let index = list.iter().rposition(|used| used.thread == thread).unwrap_or(last);
    Some(list.remove(index).stream)
}

impl<P, S> Lists<P, S> {
    /// Lists that start with the streams that another job has left.
    pub fn new(limits: Limits, streams: Vec<RayStream<Empty, P, S>>) -> Self {
        let mut empty = Vec::with_capacity(limits.streams);
        let streams = streams.into_iter().take(limits.streams);
        empty.extend(streams.map(|stream| Used { stream, thread: usize::MAX }));
        let made = empty.len();
        Self {
            limits,
            empty,
            need_more: Vec::with_capacity(limits.streams),
            trace: VecDeque::with_capacity(limits.streams),
            trace_rays: 0,
            slot: None,
            reclaimed: Vec::with_capacity(limits.streams),
            handed_out: Vec::with_capacity(limits.streams),
            answered: VecDeque::with_capacity(limits.streams),
            shade: Vec::with_capacity(limits.streams),
            begun: Vec::with_capacity(limits.streams),
            made,
        }
    }

    pub fn need_more(&self) -> usize {
        self.need_more.len()
    }

    pub fn trace(&self) -> usize {
        self.trace.len()
    }

    /// True if the job slot has a stream, or will have one at once.
    pub fn slot(&self) -> bool {
        self.slot.is_some() || !self.reclaimed.is_empty()
    }

    pub fn answered(&self) -> usize {
        self.answered.len()
    }

    pub fn shade(&self) -> usize {
        self.shade.len() + self.begun.len()
    }

    pub fn made(&self) -> usize {
        self.made
    }

    /// Rays and shadow rays in TRACE.
    pub fn trace_rays(&self) -> usize {
        self.trace_rays
    }

    /// Rays and shadow rays in TRACE, in the job slot and in what follows it.
    pub fn rays_to_trace(&self) -> usize {
        let reclaimed: usize = self.reclaimed.iter().map(weight).sum();
        self.trace_rays + self.slot.as_ref().map_or(0, RayStream::left) + reclaimed
    }

    /// Rays and shadow rays in the fullest stream of NEEDMORE.
    pub fn need_more_rays(&self) -> usize {
        let sizes = self.need_more.iter().map(|used| weight(&used.stream));
        sizes.max().unwrap_or(0)
    }

    /// A stream with room for one more tile or batch: the fullest of NEEDMORE that the thread has filled, or else of
    /// all, so that small streams stay few; or one of EMPTY.
    ///
    /// # Panics
    /// If there is none. The README proves that there is always one.
    pub fn output(&mut self, thread: usize) -> RayStream<Filling, P, S> {
        if let Some(stream) = self.take_fullest(thread) {
            return stream;
        }
        let empty = take_last(&mut self.empty, thread).unwrap_or_else(|| {
            assert!(self.made < self.limits.streams, "there is always an output stream");
            self.made += 1;
            RayStream::new()
        });
        empty.fill()
    }

    /// Puts an output stream back: into TRACE if it has at least `threshold` paths, into EMPTY if it has none, else
    /// into NEEDMORE.
    pub fn put_back_output(
        &mut self,
        stream: RayStream<Filling, P, S>,
        threshold: usize,
        (thread, now_ns): (usize, u64),
    ) {
        match paths(stream.rays(), stream.shadow_rays(), self.limits.shadow_rays_per_path) {
            0 => self.empty.push(Used { stream: stream.unfill(), thread }),
            paths if paths < threshold => self.need_more.push(Used { stream, thread }),
            _ => {
                self.trace_rays += weight(&stream);
                self.trace.push_back(Waiting { stream: stream.seal(), thread, since_ns: now_ns });
            }
        }
    }

    /// The next stream to shade.
    ///
    /// # Panics
    /// If SHADE is empty.
    pub fn next_to_shade(&mut self, thread: usize) -> RayStream<Traced, P, S> {
        let begun = take_last(&mut self.begun, thread);
        begun.or_else(|| take_last(&mut self.shade, thread)).expect("SHADE has a stream")
    }

    /// Puts a stream back that has been shaded: into EMPTY if no rays are left, else into SHADE.
    pub fn put_back_shaded(&mut self, stream: RayStream<Traced, P, S>, thread: usize) {
        if stream.rays_left() == 0 {
            self.empty.push(Used { stream: stream.recycle(), thread });
        } else {
            self.begun.push(Used { stream, thread });
        }
    }

    /// A chunk of at most `most` rays of the stream in the job slot. An empty slot is filled with what has been taken
    /// from a device, or else from TRACE, or else from NEEDMORE.
    ///
    /// # Panics
    /// If all of these are empty.
    pub fn next_chunk(&mut self, most: usize, thread: usize) -> Chunk {
        let reclaimed = self.slot.take().or_else(|| self.reclaimed.pop().map(RayStream::open));
        let mut slot = reclaimed.unwrap_or_else(|| {
            let own = self.trace.iter().rposition(|waiting| waiting.thread == thread);
            let newest = own.or(self.trace.len().checked_sub(1)).and_then(|index| self.trace.remove(index));
            let newest = newest.map(|waiting| waiting.stream);
            self.trace_rays -= newest.as_ref().map_or(0, weight);
            newest.or_else(|| self.flush(thread)).expect("there is a stream to trace").open()
        });
        // Equal chunks: a small rest at the end would not be worth a task.
        let parts = slot.left().div_ceil(most);
        let chunk = slot.next_chunk(slot.left().div_ceil(parts));
        if slot.left() > 0 {
            self.slot = Some(slot);
        } else {
            self.handed_out.push(slot);
        }
        chunk
    }

    /// Puts a traced chunk back. With its last chunk a stream goes to SHADE.
    pub fn put_back_chunk(&mut self, chunk: TracedChunk, thread: usize) {
        if let Some(slot) = self.slot.as_mut().filter(|stream| stream.owns(&chunk)) {
            slot.put_back(chunk);
            return;
        }
        let index = self.handed_out.iter().position(|stream| stream.owns(&chunk));
        let index = index.expect("a stream stays until its chunks are back");
        self.handed_out[index].put_back(chunk);
        if self.handed_out[index].is_traced() {
            let stream = self.handed_out.swap_remove(index).close();
            self.shade.push(Used { stream, thread });
        }
    }

    /// The next bundle for the device, of at most `most` streams: the oldest of TRACE until it is full, or else the
    /// fullest of NEEDMORE. Tells when each entered TRACE, if
    /// it did.
    ///
    /// # Panics
    /// If both are empty.
    pub fn next_bundle(&mut self, most: usize, thread: usize) -> Vec<FullSince<P, S>> {
        let (mut bundle, mut rays) = (Vec::new(), 0);
        let flushes = self.trace.is_empty();
        while rays < self.limits.bundle_rays && bundle.len() < most.min(BUNDLE_STREAMS) {
            let stream = if flushes {
                self.flush(thread).map(|stream| (stream, None))
            } else {
                self.trace.pop_front().map(|Waiting { stream, since_ns, .. }| {
                    self.trace_rays -= weight(&stream);
                    (stream, Some(since_ns))
                })
            };
            let Some((stream, since_ns)) = stream else { break };
            rays += weight(&stream);
            bundle.push((stream, since_ns));
        }
        assert!(!bundle.is_empty(), "there is a stream for the device");
        bundle
    }

    /// Puts a stream back for which the device has written what its answers are made of.
    pub fn put_back_answered(&mut self, stream: RayStream<Answered, P, S>, waits: Waits) {
        self.answered.push_back((stream, waits));
    }

    /// The next stream to resolve.
    ///
    /// # Panics
    /// If there is none.
    pub fn next_to_resolve(&mut self) -> (RayStream<Answered, P, S>, Waits) {
        self.answered.pop_front().expect("the device has traced a stream")
    }

    /// Puts a stream back that has been resolved.
    pub fn put_back_resolved(&mut self, stream: RayStream<Traced, P, S>, thread: usize) {
        self.shade.push(Used { stream, thread });
    }

    /// Puts a stream back that the device failed to trace.
    pub fn put_back_untraced(&mut self, stream: RayStream<Full, P, S>, (thread, now_ns): (usize, u64)) {
        self.trace_rays += weight(&stream);
        self.trace.push_front(Waiting { stream, thread, since_ns: now_ns });
    }

    /// Puts a stream back that a host thread has taken from a device: host threads trace it.
    pub fn put_back_reclaimed(&mut self, stream: RayStream<Full, P, S>) {
        self.reclaimed.push(stream);
    }

    fn flush(&mut self, thread: usize) -> Option<RayStream<Full, P, S>> {
        self.take_fullest(thread).map(RayStream::seal)
    }

    fn take_fullest(&mut self, thread: usize) -> Option<RayStream<Filling, P, S>> {
        let order = self.need_more.iter().map(|used| (used.thread == thread, weight(&used.stream)));
        let (index, _) = order.enumerate().max_by_key(|&(_, order)| order)?;
        Some(self.need_more.swap_remove(index).stream)
    }

    /// All streams of the lists, emptied.
    pub fn into_empty(self) -> Vec<RayStream<Empty, P, S>> {
        let Self { empty, need_more, trace, slot, reclaimed, handed_out, answered, shade, begun, .. } = self;
        let mut empty: Vec<_> = empty.into_iter().map(|used| used.stream).collect();
        empty.extend(need_more.into_iter().map(|used| used.stream.discard()));
        empty.extend(trace.into_iter().map(|waiting| waiting.stream.discard()));
        empty.extend(reclaimed.into_iter().map(RayStream::discard));
        empty.extend(slot.into_iter().chain(handed_out).map(RayStream::discard));
        empty.extend(answered.into_iter().map(|(stream, _)| stream.discard()));
        empty.extend(shade.into_iter().chain(begun).map(|used| used.stream.discard()));
        empty
    }

    /// The number of streams in the lists, and of paths in those streams.
    #[cfg(test)]
    pub fn count(&self) -> (usize, usize) {
        let weigh = |rays, shadow_rays| paths(rays, shadow_rays, self.limits.shadow_rays_per_path);
        let mut sizes = vec![0; self.empty.len()];
        sizes.extend(self.need_more.iter().map(|s| weigh(s.stream.rays(), s.stream.shadow_rays())));
        sizes.extend(self.trace.iter().map(|w| weigh(w.stream.rays(), w.stream.shadow_rays())));
        sizes.extend(self.slot.iter().chain(&self.handed_out).map(|s| weigh(s.rays(), s.shadow_rays())));
        sizes.extend(self.reclaimed.iter().map(|s| weigh(s.rays(), s.shadow_rays())));
        sizes.extend(self.answered.iter().map(|(s, _)| weigh(s.rays(), s.shadow_rays())));
        let traced = self.shade.iter().chain(&self.begun);
        sizes.extend(traced.map(|s| weigh(s.stream.rays_left(), s.stream.shadow_rays_left())));
        assert_eq!(
            self.trace_rays,
            self.trace.iter().map(|w| weight(&w.stream)).sum::<usize>(),
            "the rays of TRACE are counted"
        );
        (sizes.len(), sizes.iter().sum())
    }
}

/// Rays and shadow rays of a stream.
pub(super) fn weight<State, P, S>(stream: &RayStream<State, P, S>) -> usize {
    stream.rays() + stream.shadow_rays()
}

#[cfg(test)]
mod tests {
    use super::{Used, take_last};

    #[test]
    fn a_thread_takes_its_own_last_stream_or_else_the_last() {
        let mut list: Vec<_> =
            [(10, 0), (11, 1), (12, 0), (13, 1)].map(|(stream, thread)| Used { stream, thread }).into();
        let taken = [0, 0, 0, 7, 7].map(|thread| take_last(&mut list, thread));
        assert_eq!(taken, [Some(12), Some(10), Some(13), Some(11), None]);
    }
}
