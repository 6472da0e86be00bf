//! The engine: runs a shader's calls as hit and loop shaders.

use super::context::NO_RAY;
use super::exchange::{Exchange, LIGHT, PathId, ShadowState, Wish};
use super::{Answered, Cx, Radiance, Shader};
use crate::render::Frame;
use crate::schedule::{Batch, Output};
use crate::shade::places::{ArenaUse, BUCKET, Hand, NOWHERE, Places};
use crate::shade::sort;
use crate::stream::Hit;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use std::future::Future;
use std::pin::Pin;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};
use std::task::{Context, Poll, Waker};

/// What travels with a ray.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct CallState {
    pixel: u32,
    sample: u32,
    /// The place of the call that waits for the ray: the head of the path's stack of calls.
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
    let begin = |args: S::Args| desk.shader.shade(Cx::new(&desk.frame), args);
    Box::new(Calls { desk, begin, most_calls, places: Places::new() })
}

/// The calls of all paths, each in a place of its own; a path's calls link to the one below, which waits for
/// the one above to return. `F` is the future of a call: its state, as the compiler lays it out.
struct Calls<'a, S, B, F> {
    desk: &'a Desk<S>,
    begin: B,
    most_calls: usize,
    places: Places<Box<[Place<F>]>>,
}

struct Place<F> {
    /// Answers to the call's shadow rays.
    occluded: AtomicU32,
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
        let call = Call { future: Box::pin(None), below: NOWHERE, height: 0 };
        Self { occluded: AtomicU32::new(0), call: Mutex::new(call) }
    }
}

/// What a call did with its turn.
enum Turn<V> {
    Waits(Wish),
    /// The value and the place of the caller.
    Returned(V, u32),
}

impl<S, B, F> Calls<'_, S, B, F>
where
    S: Shader,
    B: Fn(S::Args) -> F + Send + Sync,
    F: Future<Output = S::Value> + Send,
{
    const CALL_BYTES: usize = size_of::<Place<F>>() + size_of::<Option<F>>();

    /// Begins a call on top of the one at `below`; returns its place.
    fn push(&self, hand: &mut Hand<'_, Box<[Place<F>]>>, args: S::Args, below: u32, height: usize) -> u32 {
        assert!(
            height <= self.most_calls,
            "the shader's calls are more than {} deep; Shader::most_calls says how deep they may be",
            self.most_calls
        );
        let place = hand.take(|| std::iter::repeat_with(Place::default).take(BUCKET).collect());
        let (bucket, number) = self.places.at(place);
        let mut call = bucket[number].call.lock().unwrap_or_else(PoisonError::into_inner);
        call.future.set(Some((self.begin)(args)));
        (call.below, call.height) = (below, height);
        place
    }

    /// Lets the call at `place` run until it waits or returns. Its height comes along.
    fn poll(&self, place: u32, exchange: &Exchange) -> (Turn<S::Value>, usize) {
        let (bucket, number) = self.places.at(place);
        // Nobody else looks at the place: its path is with this thread.
        let mut call = bucket[number].call.lock().unwrap_or_else(PoisonError::into_inner);
        exchange.place.set(place);
        let future = call.future.as_mut().as_pin_mut().expect("a call that waits has not returned");
        let turn = match future.poll(&mut Context::from_waker(Waker::noop())) {
            Poll::Ready(value) => {
                call.future.set(None);
                Turn::Returned(value, call.below)
            }
            Poll::Pending => {
                let wish = exchange.wish.take();
                Turn::Waits(wish.expect("a shader awaits only what its context gives"))
            }
        };
        (turn, call.height)
    }

    /// Lets a path run until it sends a ray or ends: hit shader and loop shader in one, since what is left
    /// to do after a return is what the compiler kept of the caller.
    fn resume(
        &self,
        mut path: CallState,
        room: usize,
        exchange: &Exchange,
        hand: &mut Hand<'_, Box<[Place<F>]>>,
        out: &mut Rays<'_>,
    ) {
        exchange.path.set(Some(PathId { pixel: path.pixel, sample: path.sample }));
        exchange.room.set(room);
        loop {
            let (turn, height) = self.poll(path.head, exchange);
            match turn {
                Turn::Waits(Wish::Rays(ray)) => {
                    out.ray(ray, path);
                    break;
                }
                Turn::Waits(Wish::Turn) => {
                    out.ray(NO_RAY, path);
                    break;
                }
                Turn::Waits(Wish::Call) => {
                    let args = exchange.parcel::<S::Args, S::Value, _>(|parcel| parcel.args.take());
                    let args = args.expect("a call comes with its arguments");
                    path.head = self.push(hand, args, path.head, height + 1);
                }
                Turn::Returned(value, below) => {
                    hand.give_back(path.head);
                    if below == NOWHERE {
                        let radiance = value.radiance();
                        if radiance != Vec3::ZERO {
                            self.desk.frame.film().splat(path.pixel, radiance);
                        }
                        break;
                    }
                    exchange.parcel::<S::Args, S::Value, _>(|parcel| parcel.value = Some(value));
                    path.head = below;
                }
            }
        }
        for (ray, state) in exchange.shadows.borrow_mut().drain(..) {
            out.shadow(ray, state);
        }
    }
}

impl<S, B, F> Engine for Calls<'_, S, B, F>
where
    S: Shader,
    B: Fn(S::Args) -> F + Send + Sync,
    F: Future<Output = S::Value> + Send,
{
    fn spawn(&self, tile: u64, out: &mut Rays<'_>) {
        let mut hand = self.places.hand();
        Exchange::engine(|exchange| {
            self.desk.frame.camera_rays(tile, |ray, pixel, sample| {
                exchange.path.set(Some(PathId { pixel, sample }));
                let head = self.push(&mut hand, self.desk.shader.camera(ray), NOWHERE, 1);
                // Spawning makes no room for shadow rays; the first turn after it does.
                self.resume(CallState { pixel, sample, head }, 0, exchange, &mut hand, out);
            });
        });
    }

    fn shade(&self, batch: Batch<'_, CallState>, out: &mut Rays<'_>) {
        let mut hand = self.places.hand();
        let materials = &self.desk.frame.scene().mesh.materials;
        Exchange::engine(|exchange| {
            // Calls that hit the same material run one after the other, whatever else they are about.
            for run in sort(batch.hits, materials).runs() {
                for &i in run.rays {
                    let (hit, path): (Hit, CallState) = (batch.hits[i as usize], batch.payloads[i as usize]);
                    let (bucket, number) = self.places.at(path.head);
                    let answers = &bucket[number].occluded;
                    let occluded = answers.load(Relaxed);
                    if occluded != 0 {
                        answers.store(0, Relaxed);
                    }
                    exchange.answered.set(Answered { hit, occluded });
                    self.resume(path, S::SHADOW_RAYS, exchange, &mut hand, out);
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
