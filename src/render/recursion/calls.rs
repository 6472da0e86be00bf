//! The engine, which runs a shader's calls as hit and loop shaders.

use super::context::NO_RAY;
use super::exchange::{Exchange, PathId, RADIANCE, Request, ShadowState};
use super::{Answers, Cx, Radiance, Shader};
use crate::lanes::{Prefetch, SingleLane};
use crate::render::first_hits::GivenRays;
use crate::render::{CameraSample, Frame};
use crate::schedule::{Batch, Output};
use crate::shade::arena::{Arena, ArenaUse, BUCKET, LocalFreeList, NO_SLOT};
use crate::shade::sort;
use crate::stream::{Hit, Ray};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use std::future::Future;
use std::pin::Pin;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker};

/// Number of turns by which a future is prefetched ahead.
const PREFETCH_DISTANCE: usize = 4;

/// The most bytes of a future that are prefetched.
const MAX_PREFETCHED: usize = 512;

/// The payload of a ray.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct CallState {
    pixel: u32,
    sample: u32,
    /// The slot of the call that waits for the ray: the top of the path's stack of calls. The stack is empty while
    /// the camera ray is in flight.
    head: u32,
}

impl CallState {
    /// The sample of the path, and whether the ray is a camera ray.
    pub(super) fn sample(&self) -> (Option<CameraSample>, bool) {
        let Self { pixel, sample, head } = *self;
        (Some(CameraSample { pixel, sample }), head == NO_SLOT)
    }

    fn camera_sample(&self) -> Option<CameraSample> {
        let Self { pixel, sample, head } = *self;
        (head == NO_SLOT).then_some(CameraSample { pixel, sample })
    }
}

type Rays<'a> = Output<'a, CallState, ShadowState>;

/// A shader with its frame, which the shader's calls borrow.
pub(super) struct ShaderFrame<S> {
    pub shader: std::sync::Arc<S>,
    pub frame: Frame,
}

/// An engine with the type of its futures erased, because that type has no name.
pub(super) trait Engine: Send + Sync {
    fn spawn(&self, tile: u64, out: &mut Rays<'_>);
    fn shade(&self, batch: Batch<'_, CallState>, out: &mut Rays<'_>);
    fn shadow(&self, payloads: &[ShadowState], occluded: &[u32]);
    fn usage(&self) -> ArenaUse;
    fn call_bytes(&self) -> usize;
}

/// Makes an engine for a shader.
pub(super) fn engine<S: Shader>(shader_frame: &ShaderFrame<S>) -> Box<dyn Engine + '_> {
    let most_calls = shader_frame.shader.most_calls(shader_frame.frame.settings().max_bounces);
    let shade =
        |ray: &Ray, hit, args| shader_frame.shader.shade(Cx::new(&shader_frame.frame), *ray, hit, args);
    Box::new(Calls { shader_frame, shade, most_calls, slots: Arena::new() })
}

/// The calls of all paths, each in its own slot. Each call links to its caller, the call below it on the path's
/// stack, which waits for it to return. `F` is the future of a call: its state as laid out by the compiler.
struct Calls<'a, S, B, F> {
    shader_frame: &'a ShaderFrame<S>,
    shade: B,
    most_calls: usize,
    slots: Arena<Box<[Slot<F>]>>,
}

struct Slot<F> {
    /// Answers to the call's shadow rays.
    occluded: AtomicU32,
    /// Address of the future, for prefetching it before its turn.
    address: usize,
    call: Mutex<Call<F>>,
}

struct Call<F> {
    /// Pinned once and reused by one call after the other.
    future: Pin<Box<Option<F>>>,
    below: u32,
    /// Number of calls on the stack up to and including this one.
    height: usize,
}

impl<F> Default for Slot<F> {
    fn default() -> Self {
        let call = Call { future: Box::pin(None), below: NO_SLOT, height: 0 };
        let address = std::ptr::from_ref(&*call.future).addr();
        Self { occluded: AtomicU32::new(0), address, call: Mutex::new(call) }
    }
}

/// End of a call's turn.
enum Outcome<V> {
    Waits(Request),
    Returned(V),
}

impl<V, F: Future<Output = V>> Call<F> {
    /// Polls the call until it waits or returns.
    fn run(&mut self, exchange: &Exchange) -> Outcome<V> {
        let future = self.future.as_mut().as_pin_mut().expect("a call that waits has not returned");
        match future.poll(&mut Context::from_waker(Waker::noop())) {
            Poll::Ready(value) => {
                self.future.set(None);
                Outcome::Returned(value)
            }
            Poll::Pending => {
                let request = exchange.request.take();
                Outcome::Waits(request.expect("a shader must await only futures of its context"))
            }
        }
    }
}

type CallGuard<'a, F> = MutexGuard<'a, Call<F>>;

/// A turn of a path, whose ray has been traced.
struct Turn<'a, 'b, F> {
    ray: &'a Ray,
    hit: Option<Hit>,
    exchange: &'a Exchange,
    free_list: &'a mut LocalFreeList<'b, Box<[Slot<F>]>>,
}

impl<S, B, F> Calls<'_, S, B, F>
where
    S: Shader,
    B: Fn(&Ray, Option<Hit>, S::Args) -> F + Send + Sync,
    F: Future<Output = S::Value> + Send,
{
    const CALL_BYTES: usize = size_of::<Slot<F>>() + size_of::<Option<F>>();

    fn lock(&self, slot: u32) -> CallGuard<'_, F> {
        let (bucket, number) = self.slots.at(slot);
        // No other thread uses the slot, because this thread has the path.
        bucket[number].call.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Begins a call for the turn's ray above the call in slot `below`. Returns the call and its slot.
    fn begin(
        &self,
        turn: &mut Turn<'_, '_, F>,
        args: S::Args,
        below: u32,
        height: usize,
    ) -> (CallGuard<'_, F>, u32) {
        assert!(
            height <= self.most_calls,
            "the shader's calls are more than {} deep; Shader::most_calls says how deep they may be",
            self.most_calls
        );
        let slot = turn.free_list.take(|| std::iter::repeat_with(Slot::default).take(BUCKET).collect());
        let mut call = self.lock(slot);
        call.future.set(Some((self.shade)(turn.ray, turn.hit, args)));
        (call.below, call.height) = (below, height);
        (call, slot)
    }

    /// Runs a path until it sends a ray or ends. This serves as both hit shader and loop shader, because the compiler
    /// saves in the caller's future what remains to be done after a call returns.
    fn resume(&self, turn: &mut Turn<'_, '_, F>, mut path: CallState, out: &mut Rays<'_>) {
        let exchange = turn.exchange;
        // The caller of the current call, if the call began in this turn.
        let mut caller = None;
        let mut call = if path.head == NO_SLOT {
            let (call, slot) = self.begin(turn, self.shader_frame.shader.camera(), NO_SLOT, 1);
            path.head = slot;
            call
        } else {
            self.lock(path.head)
        };
        loop {
            exchange.slot.set(path.head);
            match call.run(exchange) {
                Outcome::Waits(Request::Rays(ray)) => return out.ray(ray, path),
                Outcome::Waits(Request::Turn) => return out.ray(NO_RAY, path),
                Outcome::Waits(Request::Call) => {
                    let args = exchange.transfer::<S::Args, S::Value, _>(|transfer| transfer.args.take());
                    let args = args.expect("a call comes with its arguments");
                    let (callee, slot) = self.begin(turn, args, path.head, call.height + 1);
                    caller = Some(std::mem::replace(&mut call, callee));
                    path.head = slot;
                }
                Outcome::Returned(value) => {
                    turn.free_list.give_back(path.head);
                    path.head = call.below;
                    if path.head == NO_SLOT {
                        let radiance = value.radiance();
                        if radiance != Vec3::ZERO {
                            let frame = &self.shader_frame.frame;
                            frame.splat(None, frame.target_of(path.pixel, path.sample), radiance);
                        }
                        return;
                    }
                    exchange.transfer::<S::Args, S::Value, _>(|transfer| transfer.value = Some(value));
                    call = caller.take().unwrap_or_else(|| self.lock(path.head));
                }
            }
        }
    }

    /// Prefetches the calls whose turn comes soon and the slots that will be taken next: first the slots, then the
    /// futures. Between two turns they are seldom in a cache.
    fn prefetch(
        &self,
        paths: impl Fn(usize) -> Option<CallState>,
        free_list: &LocalFreeList<'_, Box<[Slot<F>]>>,
    ) {
        let slot = |slot: u32| {
            let (bucket, number) = self.slots.at(slot);
            &bucket[number]
        };
        let waits = |ahead| paths(ahead).map(|path| path.head).filter(|&head| head != NO_SLOT).map(slot);
        let taken = |ahead| free_list.upcoming(ahead).map(slot);
        [waits(2 * PREFETCH_DISTANCE), taken(2 * PREFETCH_DISTANCE)]
            .into_iter()
            .flatten()
            .for_each(|slot| Prefetch::First.each([&raw const *slot]));
        for slot in [waits(PREFETCH_DISTANCE), taken(PREFETCH_DISTANCE)].into_iter().flatten() {
            for byte in (0..size_of::<Option<F>>().min(MAX_PREFETCHED)).step_by(64) {
                Prefetch::First.each([std::ptr::without_provenance::<u8>(slot.address + byte)]);
            }
        }
    }

    /// Takes the answers to the shadow rays of the call in a slot.
    fn take_answers(&self, slot: u32) -> u32 {
        let (bucket, number) = self.slots.at(slot);
        let answers = &bucket[number].occluded;
        let occluded = answers.load(Relaxed);
        if occluded != 0 {
            answers.store(0, Relaxed);
        }
        occluded
    }
}

impl<S, B, F> Engine for Calls<'_, S, B, F>
where
    S: Shader,
    B: Fn(&Ray, Option<Hit>, S::Args) -> F + Send + Sync,
    F: Future<Output = S::Value> + Send,
{
    fn spawn(&self, tile: u64, out: &mut Rays<'_>) {
        // The first call begins when the camera ray has been traced, so a path without a call needs no slot.
        self.shader_frame.frame.camera_rays(tile, |rays, pixels, samples| {
            for ((&ray, &pixel), &sample) in rays.iter().zip(pixels).zip(samples) {
                out.ray(ray, CallState { pixel, sample, head: NO_SLOT });
            }
        });
    }

    fn shade(&self, batch: Batch<'_, CallState>, out: &mut Rays<'_>) {
        let frame = &self.shader_frame.frame;
        let given = frame.add_first_hits(&batch, true, CallState::camera_sample);
        let batch = given.as_ref().map_or(batch, GivenRays::batch);
        let mut free_list = self.slots.local_free_list();
        let scene = frame.scene();
        Exchange::engine(|exchange| {
            // Calls that hit the same material run one after the other, so that they execute similar code.
            for run in sort(SingleLane, batch.hits, scene).runs() {
                for (turn, i) in run.rays.iter().map(|&i| i as usize).enumerate() {
                    self.prefetch(
                        |ahead| run.rays.get(turn + ahead).map(|&i| batch.payloads[i as usize]),
                        &free_list,
                    );
                    let path = batch.payloads[i];
                    let hit = (!batch.hits[i].is_miss()).then_some(batch.hits[i]);
                    let occluded = if path.head == NO_SLOT { 0 } else { self.take_answers(path.head) };
                    let CallState { pixel, sample, .. } = path;
                    let target = frame.target_of(pixel, sample);
                    exchange.path.set(Some(PathId { pixel, sample, target }));
                    exchange.answers.set(Answers { hit, occluded });
                    exchange.shadow_rays_left.set(S::SHADOW_RAYS);
                    let mut turn = Turn { ray: &batch.rays[i], hit, exchange, free_list: &mut free_list };
                    self.resume(&mut turn, path, out);
                    exchange.shadows.borrow_mut().drain(..).for_each(|(ray, state)| out.shadow(ray, state));
                }
            }
        });
    }

    fn shadow(&self, payloads: &[ShadowState], occluded: &[u32]) {
        for (state, &occluded) in payloads.iter().zip(occluded) {
            match (state.bit, occluded) {
                (RADIANCE, 0) => {
                    self.shader_frame.frame.splat(None, state.target, Vec3::from_array(state.radiance));
                }
                (RADIANCE, _) | (_, 0) => {}
                (bit, _) => {
                    let (bucket, number) = self.slots.at(state.target);
                    bucket[number].occluded.fetch_or(1 << bit, Relaxed);
                }
            }
        }
    }

    fn usage(&self) -> ArenaUse {
        self.slots.usage(Self::CALL_BYTES)
    }

    fn call_bytes(&self) -> usize {
        Self::CALL_BYTES
    }
}
