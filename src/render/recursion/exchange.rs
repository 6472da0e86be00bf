//! Communication between a call and the engine that polls it. There is one exchange for each thread, because a thread
//! polls one call at a time. Calls therefore need no reference to the engine.

use super::Answers;
use crate::stream::Ray;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use std::any::Any;
use std::cell::{Cell, RefCell};

thread_local! {
    static EXCHANGE: Exchange = const { Exchange::new() };
}

/// A path as its calls see it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PathId {
    pub pixel: u32,
    pub sample: u32,
    /// The pixel as [`crate::render::Frame::target`] gives it.
    pub target: u32,
}

/// Request that a call waits for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Request {
    /// The hit of this ray, and the answers of the shadow rays emitted with it.
    Rays(Ray),
    /// Another turn, in which shadow rays may be emitted again.
    Turn,
    /// The value of a recursive call, which gets the ray just traced and the arguments in the transfer.
    Call,
}

/// The payload of a shadow ray.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct ShadowState {
    /// Radiance to add to a pixel if the ray is not occluded.
    pub(super) radiance: [f32; 3],
    /// The pixel, or the slot of the call that awaits the answer.
    pub(super) target: u32,
    /// [`RADIANCE`], or the number of the answer's bit.
    pub(super) bit: u32,
}

/// [`ShadowState::bit`] of a ray that carries radiance.
pub(super) const RADIANCE: u32 = u32::MAX;

/// Arguments on their way to a call, or its value on the way back.
pub(super) struct Transfer<A, V> {
    pub args: Option<A>,
    pub value: Option<V>,
}

pub(super) struct Exchange {
    /// The path whose call is being polled.
    pub path: Cell<Option<PathId>>,
    /// The slot of that call.
    pub slot: Cell<u32>,
    /// Number of shadow rays that may still be emitted in this turn.
    pub shadow_rays_left: Cell<usize>,
    pub request: Cell<Option<Request>>,
    pub answers: Cell<Answers>,
    pub shadows: RefCell<Vec<(Ray, ShadowState)>>,
    /// A [`Transfer`], reused so that only the first one allocates.
    transfer: RefCell<Option<Box<dyn Any>>>,
}

impl Exchange {
    const fn new() -> Self {
        Self {
            path: Cell::new(None),
            slot: Cell::new(0),
            shadow_rays_left: Cell::new(0),
            request: Cell::new(None),
            answers: Cell::new(Answers { hit: None, occluded: 0 }),
            shadows: RefCell::new(Vec::new()),
            transfer: RefCell::new(None),
        }
    }

    /// Resets this thread's exchange and passes it to the engine.
    pub fn engine<T>(work: impl FnOnce(&Self) -> T) -> T {
        EXCHANGE.with(|exchange| {
            // A shader that panicked may have left requests or shadow rays.
            exchange.request.set(None);
            exchange.shadows.borrow_mut().clear();
            let done = work(exchange);
            exchange.path.set(None);
            done
        })
    }

    /// Passes this thread's exchange to a call that is being polled.
    pub fn call<T>(work: impl FnOnce(&Self, PathId) -> T) -> T {
        EXCHANGE.with(|exchange| {
            let path = exchange
                .path
                .get()
                .expect("a shader's futures and context work only while the engine polls the shader");
            work(exchange, path)
        })
    }

    /// Records what the call waits for.
    pub fn request(&self, request: Request) {
        let before = self.request.replace(Some(request));
        assert!(before.is_none(), "a call must await one future at a time; `trace_with` sends rays together");
    }

    /// Reserves shadow rays of this turn. Returns false if too few are left.
    pub fn reserve(&self, rays: usize) -> bool {
        let left = self.shadow_rays_left.get().checked_sub(rays);
        left.inspect(|&left| self.shadow_rays_left.set(left)).is_some()
    }

    pub fn send_radiance(&self, ray: Ray, radiance: Vec3, pixel: u32) {
        let state = ShadowState { radiance: radiance.into(), target: pixel, bit: RADIANCE };
        self.shadows.borrow_mut().push((ray, state));
    }

    pub fn send_query(&self, ray: Ray, bit: usize) {
        let state = ShadowState { radiance: [0.0; 3], target: self.slot.get(), bit: bit as u32 };
        self.shadows.borrow_mut().push((ray, state));
    }

    /// Gives access to the transfer.
    pub fn transfer<A: 'static, V: 'static, T>(&self, open: impl FnOnce(&mut Transfer<A, V>) -> T) -> T {
        let mut transfer = self.transfer.borrow_mut();
        if !transfer.as_ref().is_some_and(|stored| stored.is::<Transfer<A, V>>()) {
            *transfer = Some(Box::new(Transfer::<A, V> { args: None, value: None }));
        }
        let transfer = transfer.as_mut().and_then(|stored| stored.downcast_mut::<Transfer<A, V>>());
        open(transfer.expect("has this type, see above"))
    }
}
