//! What a thread does between two visits to the lists, without the lock.

use super::result::JobError;
use super::task_times::thread_ns;
use super::{Depths, Limits, Output, RayCounts, Renderer, Tracers, Unit, pass_or_shade, trace_on};
use crate::stream::{
    Answered, Chunk, ChunkScratch, DeviceReport, DeviceState, Filling, Full, OnDevice, RayStream,
    StreamAppender, Ticket, Traced, TracedChunk, Untraced, catching, paths,
};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// A task and its streams.
pub(super) enum Task<P, S> {
    Spawn {
        tile: u64,
        output: RayStream<Filling, P, S>,
    },
    /// Traces a tile's rays where they are.
    InPlace {
        tile: u64,
    },
    /// Ends when the output has `threshold` paths, or when one more batch would be more than `most_rays`.
    Shade {
        input: RayStream<Traced, P, S>,
        output: RayStream<Filling, P, S>,
        threshold: usize,
        most_rays: usize,
    },
    Trace(Chunk),
    Resolve(RayStream<Answered, P, S>),
    Submit(Vec<RayStream<Full, P, S>>),
    /// Takes a stream from a device, whatever the device does.
    Reclaim(RayStream<OnDevice, P, S>),
}

/// A finished task.
pub(super) enum Done<P, S> {
    Spawned {
        output: RayStream<Filling, P, S>,
        emitted: Emitted,
    },
    Shaded {
        input: RayStream<Traced, P, S>,
        output: RayStream<Filling, P, S>,
        emitted: Emitted,
        depths: Depths,
    },
    Traced(TracedChunk),
    TracedInPlace(RayCounts),
    Resolved {
        stream: RayStream<Traced, P, S>,
        report: DeviceReport,
    },
    /// The device has answered wrongly.
    Unresolved(Untraced<P, S>),
    Submitted {
        streams: Vec<RayStream<OnDevice, P, S>>,
        ticket: Box<dyn Ticket>,
    },
    /// The device has refused a bundle, and the host has its streams again.
    Refused {
        streams: Vec<RayStream<Full, P, S>>,
        reason: String,
    },
    Reclaimed(RayStream<Full, P, S>),
    /// The renderer or the host's tracer panicked or stopped, and the task's streams were dropped.
    Failed(JobError),
}

/// Rays that a task has emitted.
#[derive(Clone, Copy, Default)]
pub(super) struct Emitted {
    pub rays: u64,
    pub shadow_rays: u64,
}

/// One thread's task of a job, on its way out of the lists and back. The holder of the lists' lock fills and empties
/// it; between the two only the thread itself uses it.
pub(super) enum TaskSlot<P, S> {
    Empty,
    Task(Task<P, S>),
    Done(Done<P, S>),
}

/// The part of a job that threads use without the lock: all but the lists.
pub(super) struct SharedJob<R: Renderer> {
    pub renderer: Arc<R>,
    pub tracers: Tracers,
    /// For events. Asked for once, since that runs the device tracer's own code.
    pub device_name: String,
    /// Set once the device is ready, or to the reason why it never will be.
    pub joined: OnceLock<Result<(), String>>,
    pub limits: Limits,
    /// Host threads of the service.
    pub hosts: usize,
    /// One for each thread of the service.
    pub slots: Vec<Mutex<TaskSlot<R::Payload, R::ShadowPayload>>>,
    /// Set when the job gets no more tasks; those under way end early.
    pub abandoned: AtomicBool,
}

/// A job of any type, as threads see it.
pub(super) trait Work: Send + Sync {
    /// Does the task in the thread's slot. Returns its CPU time in nanoseconds, if it is what a device costs the host.
    fn work(&self, thread: usize, scratch: &mut ChunkScratch) -> Option<u64>;

    /// [`Renderer::warnings`]; none if it panics.
    fn warnings(&self) -> Vec<String>;
}

impl<R: Renderer> Work for SharedJob<R> {
    fn work(&self, thread: usize, scratch: &mut ChunkScratch) -> Option<u64> {
        let task = match self.swap_slot(thread, TaskSlot::Empty) {
            TaskSlot::Task(task) => task,
            TaskSlot::Empty | TaskSlot::Done(_) => unreachable!("a thread works after it was given a task"),
        };
        self.look_for_device();
        let is_of_device = matches!(task, Task::Resolve(_) | Task::Submit(_));
        let begin_ns = if is_of_device { thread_ns() } else { None };
        let done = catch_unwind(AssertUnwindSafe(|| match task {
            Task::Spawn { tile, output } => self.spawn(tile, output),
            Task::Shade { input, output, threshold, most_rays } => {
                self.shade(input, output, threshold, most_rays)
            }
            Task::InPlace { tile } => {
                let tiles = self.renderer.in_place().expect("only such renderers get such tasks");
                Done::TracedInPlace(tiles.trace(tile, &*self.tracers.host))
            }
            Task::Trace(chunk) => Done::Traced(chunk.trace(&*self.tracers.host, scratch)),
            Task::Resolve(stream) => match stream.resolve() {
                Ok((stream, report)) => Done::Resolved { stream, report },
                Err(untraced) => Done::Unresolved(untraced),
            },
            Task::Submit(bundle) => self.submit(bundle),
            Task::Reclaim(stream) => Done::Reclaimed(stream.take_back()),
        }));
        let done = done.unwrap_or_else(|thrown| Done::Failed(JobError::of(thrown, None)));
        self.swap_slot(thread, TaskSlot::Done(done));
        begin_ns.and_then(|begin_ns| Some(thread_ns()? - begin_ns))
    }

    fn warnings(&self) -> Vec<String> {
        catch_unwind(AssertUnwindSafe(|| self.renderer.warnings())).unwrap_or_default()
    }
}

impl<R: Renderer> SharedJob<R> {
    /// Asks the device whether it is ready, until that is known.
    pub fn look_for_device(&self) {
        let Some(device) = self.tracers.device.as_ref().filter(|_| self.joined.get().is_none()) else {
            return;
        };
        let state = catching(|| match device.state() {
            DeviceState::Ready => Ok(Some(())),
            DeviceState::Opening => Ok(None),
            DeviceState::Unavailable(reason) => Err(reason),
        });
        if let Some(joined) = state.transpose() {
            // Another thread may have been told the same.
            let _ = self.joined.set(joined);
        }
    }

    /// Replaces the content of a thread's slot.
    pub fn swap_slot(
        &self,
        thread: usize,
        with: TaskSlot<R::Payload, R::ShadowPayload>,
    ) -> TaskSlot<R::Payload, R::ShadowPayload> {
        std::mem::replace(&mut *self.slots[thread].lock().unwrap_or_else(PoisonError::into_inner), with)
    }

    fn spawn(
        &self,
        tile: u64,
        mut output: RayStream<Filling, R::Payload, R::ShadowPayload>,
    ) -> Done<R::Payload, R::ShadowPayload> {
        let most = self.limits.tile_rays;
        let emitted = self.emit(&mut output, most, most, |out| self.renderer.spawn(tile, out));
        Done::Spawned { output, emitted }
    }

    fn shade(
        &self,
        mut input: RayStream<Traced, R::Payload, R::ShadowPayload>,
        mut output: RayStream<Filling, R::Payload, R::ShadowPayload>,
        threshold: usize,
        most_rays: usize,
    ) -> Done<R::Payload, R::ShadowPayload> {
        let limits = &self.limits;
        let shadows = input.take_shadows();
        if let Some(surfaces) = self.renderer.see_through() {
            trace_on(surfaces, &*self.tracers.host, shadows.rays, shadows.occluded);
        }
        for start in (0..shadows.rays.len()).step_by(limits.batch_rays) {
            let batch = start..(start + limits.batch_rays).min(shadows.rays.len());
            let (rays, payloads) = (&shadows.rays[batch.clone()], &shadows.payloads[batch.clone()]);
            self.renderer.shadow(rays, payloads, &shadows.occluded[batch]);
        }
        let (mut emitted, mut depths) = (Emitted::default(), Depths::default());
        let batch_rays = limits.batch_rays.min(threshold).min(most_rays);
        let mut done = shadows.rays.len();
        while (done == 0 || done.saturating_add(batch_rays) <= most_rays)
            && !self.abandoned.load(Ordering::Relaxed)
        {
            let batch = input.next_batch(batch_rays);
            let rays = batch.rays.len();
            if rays == 0 {
                break;
            }
            done += rays;
            depths.count(batch.payloads.iter().map(|payload| self.renderer.depth(payload)));
            let shade = |out: &mut Output<'_, _, _>| pass_or_shade(&*self.renderer, batch, out);
            let more = self.emit(&mut output, rays, rays * limits.shadow_rays_per_ray, shade);
            emitted.rays += more.rays;
            emitted.shadow_rays += more.shadow_rays;
            // A full stream is traced before more is shaded (RA section 3).
            if paths(output.rays(), output.shadow_rays(), limits.shadow_rays_per_path) >= threshold {
                break;
            }
        }
        Done::Shaded { input, output, emitted, depths }
    }

    /// Lets the renderer emit rays.
    ///
    /// # Panics
    /// If the renderer emits more than it promised, which fails its job.
    fn emit(
        &self,
        output: &mut RayStream<Filling, R::Payload, R::ShadowPayload>,
        most_rays: usize,
        most_shadow_rays: usize,
        emit: impl FnOnce(&mut Output<'_, R::Payload, R::ShadowPayload>),
    ) -> Emitted {
        let before = (output.rays(), output.shadow_rays());
        let device = self.tracers.device.as_deref().filter(|_| self.tracers.unit != Unit::Cpu);
        output.append(self.limits.stream, device, |StreamAppender { rays, payloads, shadow_rays, shadow_payloads }| {
            let mut output = Output { rays, payloads, shadow_rays, shadow_payloads };
            emit(&mut output);
            let (rays, shadow_rays) = (output.rays.len() - before.0, output.shadow_rays.len() - before.1);
            assert!(
                rays <= most_rays && shadow_rays <= most_shadow_rays,
                "the renderer emitted {rays} rays and {shadow_rays} shadow rays where it promised at most \
                 {most_rays} and {most_shadow_rays}"
            );
            Emitted { rays: rays as u64, shadow_rays: shadow_rays as u64 }
        })
    }

    fn submit(
        &self,
        bundle: Vec<RayStream<Full, R::Payload, R::ShadowPayload>>,
    ) -> Done<R::Payload, R::ShadowPayload> {
        let device = self.tracers.device.as_ref().expect("only jobs with a device submit bundles");
        let (streams, shares): (Vec<_>, _) = bundle.into_iter().map(RayStream::give).unzip();
        match catching(|| device.submit(shares).map_err(|error| error.to_string())) {
            Ok(ticket) => Done::Submitted { streams, ticket },
            Err(reason) => {
                Done::Refused { streams: streams.into_iter().map(RayStream::take_back).collect(), reason }
            }
        }
    }
}
