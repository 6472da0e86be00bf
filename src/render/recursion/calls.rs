//! The engine: runs a shader's calls as hit and loop shaders.

use super::context::NO_RAY;
use super::exchange::{Exchange, LIGHT, PathId, ShadowState, Wish};
use super::{Answered, Cx, Radiance, Shader};
use crate::lanes::{Prefetch, SingleLane};
use crate::render::Frame;
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

/// How many turns ahead a future is fetched.
const AHEAD: usize = 4;

/// The most bytes of a future that are fetched.
const MOST_FETCHED: usize = 512;

/// What travels with a ray.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct CallState {
    pixel: u32,
    sample: u32,
    /// The place of the call that waits for the ray: the head of the path's stack of calls, which is empty
    /// while a camera ray is on its way.
    head: u32,
}

type Rays<'a> = Output<'a, CallState, ShadowState>;

/// A shader at work on a frame: what its calls borrow.
pub(super) struct Desk<S> {
    pub shader: std::sync::Arc<S>,
    pub frame: Frame,
}

/// An engine whose future's type, which has no name, does not matter.
pub(super) trait Engine: Send + Sync {
    fn spawn(&self, tile: u64, out: &mut Rays<'_>);
    fn shade(&self, batch: Batch<'_, CallState>, out: &mut Rays<'_>);
    fn shadow(&self, payloads: &[ShadowState], occluded: &[u32]);
    fn usage(&self) -> ArenaUse;
    fn call_bytes(&self) -> usize;
}

/// An engine for a shader.
pub(super) fn engine<S: Shader>(desk: &Desk<S>) -> Box<dyn Engine + '_> {
    let most_calls = desk.shader.most_calls(desk.frame.settings().max_bounces);
    let shade = |ray: &Ray, hit, args| desk.shader.shade(Cx::new(&desk.frame), *ray, hit, args);
    Box::new(Calls { desk, shade, most_calls, places: Arena::new() })
}

/// The calls of all paths, each in a place of its own; a path's calls link to the one below, which waits for
/// the one above to return. `F` is the future of a call: its state, as the compiler lays it out.
struct Calls<'a, S, B, F> {
    desk: &'a Desk<S>,
    shade: B,
    most_calls: usize,
    places: Arena<Box<[Place<F>]>>,
}

struct Place<F> {
    /// Answers to the call's shadow rays.
    occluded: AtomicU32,
    /// Where the future is, for fetching it ahead of its turn.
    address: usize,
    call: Mutex<Call<F>>,
}

struct Call<F> {
    /// Pinned once, used for one call after the other.
    future: Pin<Box<Option<F>>>,
    below: u32,
    /// Calls on the stack from here down.
    height: usize,
}

impl<F> Default for Place<F> {
    fn default() -> Self {
        let call = Call { future: Box::pin(None), below: NO_SLOT, height: 0 };
        let address = std::ptr::from_ref(&*call.future).addr();
        Self { occluded: AtomicU32::new(0), address, call: Mutex::new(call) }
    }
}

/// What a call did with its turn.
enum Outcome<V> {
    Waits(Wish),
    Returned(V),
}

impl<V, F: Future<Output = V>> Call<F> {
    /// Runs until it waits or returns.
    fn run(&mut self, exchange: &Exchange) -> Outcome<V> {
        let future = self.future.as_mut().as_pin_mut().expect("a call that waits has not returned");
        match future.poll(&mut Context::from_waker(Waker::noop())) {
            Poll::Ready(value) => {
                self.future.set(None);
                Outcome::Returned(value)
            }
            Poll::Pending => {
                let wish = exchange.wish.take();
                Outcome::Waits(wish.expect("a shader awaits only what its context gives"))
            }
        }
    }
}

type Held<'a, F> = MutexGuard<'a, Call<F>>;

/// A path's turn: its ray has come back.
struct Turn<'a, 'b, F> {
    ray: &'a Ray,
    hit: Option<Hit>,
    exchange: &'a Exchange,
    hand: &'a mut LocalFreeList<'b, Box<[Place<F>]>>,
}

impl<S, B, F> Calls<'_, S, B, F>
where
    S: Shader,
    B: Fn(&Ray, Option<Hit>, S::Args) -> F + Send + Sync,
    F: Future<Output = S::Value> + Send,
{
    const CALL_BYTES: usize = size_of::<Place<F>>() + size_of::<Option<F>>();

    fn lock(&self, place: u32) -> Held<'_, F> {
        let (bucket, number) = self.places.at(place);
        // No other thread uses the place: its path is with this thread.
        bucket[number].call.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Begins a call for the turn's ray on top of the one at `below`; its place comes along.
    fn begin(
        &self,
        turn: &mut Turn<'_, '_, F>,
        args: S::Args,
        below: u32,
        height: usize,
    ) -> (Held<'_, F>, u32) {
        assert!(
            height <= self.most_calls,
            "the shader's calls are more than {} deep; Shader::most_calls says how deep they may be",
            self.most_calls
        );
        let place = turn.hand.take(|| std::iter::repeat_with(Place::default).take(BUCKET).collect());
        let mut call = self.lock(place);
        call.future.set(Some((self.shade)(turn.ray, turn.hit, args)));
        (call.below, call.height) = (below, height);
        (call, place)
    }

    /// Lets a path run until it sends a ray or ends: hit shader and loop shader in one, since what is left
    /// to do after a return is what the compiler kept of the caller.
    fn resume(&self, turn: &mut Turn<'_, '_, F>, mut path: CallState, out: &mut Rays<'_>) {
        let exchange = turn.exchange;
        // The caller of the call, if that has begun in this turn.
        let mut caller = None;
        let mut call = if path.head == NO_SLOT {
            let (call, place) = self.begin(turn, self.desk.shader.camera(), NO_SLOT, 1);
            path.head = place;
            call
        } else {
            self.lock(path.head)
        };
        loop {
            exchange.place.set(path.head);
            match call.run(exchange) {
                Outcome::Waits(Wish::Rays(ray)) => return out.ray(ray, path),
                Outcome::Waits(Wish::Turn) => return out.ray(NO_RAY, path),
                Outcome::Waits(Wish::Call) => {
                    let args = exchange.parcel::<S::Args, S::Value, _>(|parcel| parcel.args.take());
                    let args = args.expect("a call comes with its arguments");
                    let (callee, place) = self.begin(turn, args, path.head, call.height + 1);
                    caller = Some(std::mem::replace(&mut call, callee));
                    path.head = place;
                }
                Outcome::Returned(value) => {
                    turn.hand.give_back(path.head);
                    path.head = call.below;
                    if path.head == NO_SLOT {
                        let radiance = value.radiance();
                        if radiance != Vec3::ZERO {
                            self.desk.frame.film().splat(path.pixel, radiance);
                        }
                        return;
                    }
                    exchange.parcel::<S::Args, S::Value, _>(|parcel| parcel.value = Some(value));
                    call = caller.take().unwrap_or_else(|| self.lock(path.head));
                }
            }
        }
    }

    /// Asks for the memory of calls whose turn comes soon, and of the places that will be taken: first the
    /// places, then the futures. Between two turns they are seldom in a cache.
    fn fetch(&self, paths: impl Fn(usize) -> Option<CallState>, hand: &LocalFreeList<'_, Box<[Place<F>]>>) {
        let place = |place: u32| {
            let (bucket, number) = self.places.at(place);
            &bucket[number]
        };
        let waits = |ahead| paths(ahead).map(|path| path.head).filter(|&head| head != NO_SLOT).map(place);
        let taken = |ahead| hand.upcoming(ahead).map(place);
        [waits(2 * AHEAD), taken(2 * AHEAD)]
            .into_iter()
            .flatten()
            .for_each(|place| Prefetch::First.each([&raw const *place]));
        for place in [waits(AHEAD), taken(AHEAD)].into_iter().flatten() {
            for byte in (0..size_of::<Option<F>>().min(MOST_FETCHED)).step_by(64) {
                Prefetch::First.each([std::ptr::without_provenance::<u8>(place.address + byte)]);
            }
        }
    }

    /// Takes the answers to the shadow rays of the call at a place.
    fn take_answers(&self, place: u32) -> u32 {
        let (bucket, number) = self.places.at(place);
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
        // The first call begins when its ray is back: a path that is only a ray needs no place.
        self.desk.frame.camera_rays(tile, |rays, pixels, samples| {
            for ((&ray, &pixel), &sample) in rays.iter().zip(pixels).zip(samples) {
                out.ray(ray, CallState { pixel, sample, head: NO_SLOT });
            }
        });
    }

    fn shade(&self, batch: Batch<'_, CallState>, out: &mut Rays<'_>) {
        let mut hand = self.places.local_free_list();
        let scene = self.desk.frame.scene();
        Exchange::engine(|exchange| {
            // Calls that hit the same material run one after the other, whatever else they are about.
            for run in sort(SingleLane::default(), batch.hits, scene).runs() {
                for (turn, i) in run.rays.iter().map(|&i| i as usize).enumerate() {
                    self.fetch(
                        |ahead| run.rays.get(turn + ahead).map(|&i| batch.payloads[i as usize]),
                        &hand,
                    );
                    let path = batch.payloads[i];
                    let hit = (!batch.hits[i].is_miss()).then_some(batch.hits[i]);
                    let occluded = if path.head == NO_SLOT { 0 } else { self.take_answers(path.head) };
                    exchange.path.set(Some(PathId { pixel: path.pixel, sample: path.sample }));
                    exchange.answered.set(Answered { hit, occluded });
                    exchange.room.set(S::SHADOW_RAYS);
                    let mut turn = Turn { ray: &batch.rays[i], hit, exchange, hand: &mut hand };
                    self.resume(&mut turn, path, out);
                    exchange.shadows.borrow_mut().drain(..).for_each(|(ray, state)| out.shadow(ray, state));
                }
            }
        });
    }

    fn shadow(&self, payloads: &[ShadowState], occluded: &[u32]) {
        for (state, &occluded) in payloads.iter().zip(occluded) {
            match (state.question, occluded) {
                (LIGHT, 0) => {
                    self.desk.frame.film().splat(state.whom, Vec3::from_array(state.radiance));
                }
                (LIGHT, _) | (_, 0) => {}
                (question, _) => {
                    let (bucket, number) = self.places.at(state.whom);
                    bucket[number].occluded.fetch_or(1 << question, Relaxed);
                }
            }
        }
    }

    fn usage(&self) -> ArenaUse {
        self.places.usage(Self::CALL_BYTES)
    }

    fn call_bytes(&self) -> usize {
        Self::CALL_BYTES
    }
}
