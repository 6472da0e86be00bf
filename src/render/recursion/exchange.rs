//! What passes between a call and the engine that polls it. There is one exchange for each thread, since a
//! thread polls one call at a time; so calls need not carry a way back to the engine with them.

use super::Answered;
use crate::stream::Ray;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use std::any::Any;
use std::cell::{Cell, RefCell};

thread_local! {
    static EXCHANGE: Exchange = const { Exchange::new() };
}

/// A path, as its calls see it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PathId {
    pub pixel: u32,
    pub sample: u32,
}

/// What a call waits for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Wish {
    /// The hit of this ray, and the shadow rays emitted with it.
    Rays(Ray),
    /// Another turn, with room for shadow rays.
    Turn,
    /// What a call returns that is given the ray just traced and the arguments in the parcel.
    Call,
}

/// What travels with a shadow ray.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct ShadowState {
    /// What it adds to a pixel if it is not occluded.
    pub(super) radiance: [f32; 3],
    /// The pixel; or the place of the call that wants to know whether it is occluded.
    pub(super) whom: u32,
    /// [`LIGHT`], or the number of the question.
    pub(super) question: u32,
}

/// [`ShadowState::question`] of a ray that is no question.
pub(super) const LIGHT: u32 = u32::MAX;

/// Arguments on their way to a call, or its value on the way back.
pub(super) struct Parcel<A, V> {
    pub args: Option<A>,
    pub value: Option<V>,
}

pub(super) struct Exchange {
    /// The path whose call is being polled.
    pub path: Cell<Option<PathId>>,
    /// The place of that call.
    pub place: Cell<u32>,
    /// Shadow rays that may still be emitted this turn.
    pub room: Cell<usize>,
    pub wish: Cell<Option<Wish>>,
    pub answered: Cell<Answered>,
    pub shadows: RefCell<Vec<(Ray, ShadowState)>>,
    /// A [`Parcel`], kept for the next: nothing is allocated for it but the first time.
    parcel: RefCell<Option<Box<dyn Any>>>,
}

impl Exchange {
    const fn new() -> Self {
        Self {
            path: Cell::new(None),
            place: Cell::new(0),
            room: Cell::new(0),
            wish: Cell::new(None),
            answered: Cell::new(Answered { hit: None, occluded: 0 }),
            shadows: RefCell::new(Vec::new()),
            parcel: RefCell::new(None),
        }
    }

    /// Hands this thread's exchange to the engine, as new.
    pub fn engine<T>(work: impl FnOnce(&Self) -> T) -> T {
        EXCHANGE.with(|exchange| {
            // A shader that panicked may have left things behind.
            exchange.wish.set(None);
            exchange.shadows.borrow_mut().clear();
            let done = work(exchange);
            exchange.path.set(None);
            done
        })
    }

    /// Hands this thread's exchange to a call that is being polled.
    pub fn call<T>(work: impl FnOnce(&Self, PathId) -> T) -> T {
        EXCHANGE.with(|exchange| {
            let path = exchange
                .path
                .get()
                .expect("a shader's futures and context work only while the engine polls the shader");
            work(exchange, path)
        })
    }

    /// Says what the call waits for.
    pub fn wish(&self, wish: Wish) {
        let before = self.wish.replace(Some(wish));
        assert!(before.is_none(), "a call awaits one thing at a time; `trace_with` sends rays together");
    }

    /// Takes up room for shadow rays, if there is enough.
    pub fn make_room(&self, rays: usize) -> bool {
        let room = self.room.get().checked_sub(rays);
        room.inspect(|&room| self.room.set(room)).is_some()
    }

    pub fn light(&self, ray: Ray, radiance: Vec3, pixel: u32) {
        let state = ShadowState { radiance: radiance.into(), whom: pixel, question: LIGHT };
        self.shadows.borrow_mut().push((ray, state));
    }

    pub fn question(&self, ray: Ray, question: usize) {
        let state = ShadowState { radiance: [0.0; 3], whom: self.place.get(), question: question as u32 };
        self.shadows.borrow_mut().push((ray, state));
    }

    /// Opens the parcel.
    pub fn parcel<A: 'static, V: 'static, T>(&self, open: impl FnOnce(&mut Parcel<A, V>) -> T) -> T {
        let mut parcel = self.parcel.borrow_mut();
        if !parcel.as_ref().is_some_and(|parcel| parcel.is::<Parcel<A, V>>()) {
            *parcel = Some(Box::new(Parcel::<A, V> { args: None, value: None }));
        }
        let parcel = parcel.as_mut().and_then(|parcel| parcel.downcast_mut::<Parcel<A, V>>());
        open(parcel.expect("made above if it was another's"))
    }
}
