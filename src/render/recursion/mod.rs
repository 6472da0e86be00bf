//! Recursive shaders, written as one `async fn` and run on ray streams.
//!
//! RA's loop shaders let a path come back to an earlier hit (section 3.3), but the shader has to be cut into
//! pieces by hand: a hit shader, loop shaders, and the state that each leaves for the next. RA asks for a
//! compiler that does this ("that automatically splits a single recursive shader into one hit shader and
//! possibly multiple loop shaders with minimal state footprint", section 6). Rust has one: an `async fn` is
//! compiled to a state machine that keeps exactly what is needed beyond each `await`.
//!
//! # A first shader
//! A [`Shader`] is a recursive function: given a ray and its hit, what comes along the ray? It asks its context
//! [`Cx`] for other rays ([`Cx::call`] sends one and calls the shader with its hit; [`Cx::trace`] gives the
//! bare hit) and for shadow rays ([`Cx::occluded`]), as often as it likes, in loops and branches, and looks at each
//! answer before it asks on. Here, mirrors that go on to reflect as long as it shows, and a sun:
//!
//! ```
//! use glam::Vec3;
//! use raystream::render::recursion::{Cx, Recursion, Shader};
//! use raystream::engine::{PreparedScene, Units};
//! use raystream::render::Settings;
//! use raystream::scene::{Camera, recipe::Recipe};
//! use raystream::schedule::{JobOptions, Service, ServiceOptions};
//! use raystream::stream::{Hit, Ray};
//! use std::sync::Arc;
//!
//! struct Mirrors {
//!     sun: Vec3,
//! }
//!
//! /// What a ray counts for the pixel, and how often it has been reflected.
//! type Share = (f32, u32);
//!
//! impl Shader for Mirrors {
//!     type Args = Share;            // what a call is given besides the ray and the hit,
//!     type Value = Vec3;            // what it returns,
//!     const SHADOW_RAYS: usize = 1; // and how many shadow rays it sends at once.
//!
//!     fn camera(&self) -> Share {
//!         (1.0, 0)
//!     }
//!
//!     async fn shade(&self, cx: Cx<'_, Self>, ray: Ray, hit: Option<Hit>, (share, depth): Share) -> Vec3 {
//!         let Some(hit) = hit else {
//!             return Vec3::new(0.4, 0.6, 0.9); // the sky
//!         };
//!         let (_material, at) = cx.surface(&ray, &hit);
//!         let towards = |direction| Ray::new(at.origin(at.position, direction), direction);
//!         let mut light = Vec3::splat(0.05);
//!         let facing = at.normal.dot(self.sun);
//!         if facing > 0.0 && !cx.occluded(towards(self.sun)).await {
//!             light += Vec3::splat(0.5 * facing);
//!         }
//!         let share = 0.6 * share;
//!         if share > 0.05 && depth < cx.settings().max_bounces {
//!             let mirrored = 2.0 * at.normal.dot(at.wo) * at.normal - at.wo;
//!             light += 0.6 * cx.call(towards(mirrored), (share, depth + 1)).await;
//!         }
//!         light
//!     }
//! }
//!
//! let recipe = Recipe::parse(r#"{ "environment": [1, 1, 1], "materials": { "any": { "colour": [1, 1, 1] } },
//!     "shapes": [ { "shape": "sphere", "centre": [-1, 0, 0], "radius": 1, "cells": 16, "material": "any" },
//!                 { "shape": "sphere", "centre": [1, 0, 0], "radius": 1, "cells": 16, "material": "any" } ] }"#)?;
//! let prepared = PreparedScene::new(Arc::new(recipe.build()?), &Units::cpu());
//! let camera = Camera::framing(&prepared.scene.bounds(), 1.0);
//! let settings = Settings { width: 64, height: 64, spp: 4, max_bounces: 8, seed: 0 };
//!
//! // The shader is a renderer like any other: a job for the service.
//! let sun = Vec3::new(0.3, 0.9, 0.4).normalize();
//! let mirrors = Arc::new(Recursion::new(Mirrors { sun }, prepared.scene.clone(), &camera, settings)?);
//! let service = Service::new(ServiceOptions { host_threads: 2, ..Default::default() })?;
//! service.submit(mirrors.clone(), prepared.tracers.clone(), JobOptions::default())?.wait()?;
//!
//! let picture = mirrors.film().resolve();
//! assert_eq!(picture[0], [0.4, 0.6, 0.9]);
//! assert!(picture[32 * 64 + 16][0] > 0.1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! What a shader must keep to: it awaits only what its context gives, one thing at a time
//! ([`Cx::trace_with`] sends a ray and shadow rays together); it calls itself at most
//! [`Shader::most_calls`] deep; and it takes its random numbers from [`Cx::sampler`], so that the picture
//! does not depend on the order of things. A shader that breaks its word fails its job, with a message.
//!
//! Radiance that needs not be looked at is cheaper to add where it is found: [`Cx::add`], and
//! [`Cx::add_unless_occluded`], which sends a shadow ray but does not wait for it.
//! [`super::RecursiveWhitted`] does so, and makes the same bytes as the hand-written [`super::Whitted`].
//!
//! # How it runs
//! A camera ray travels alone. When it is back, the first call begins, and has a turn: it runs until it awaits
//! an answer or returns. A call that awaits has a *place* in an arena of recycled buckets
//! ([`crate::shade::arena`]), where its future, the state machine, stays until it returns. The ray that it
//! awaits carries the place's number as its payload, through the streams like any ray. When a batch comes
//! back, the engine sorts it by material and gives each path a turn: a ray sent by [`Cx::call`] begins a call
//! on top of its caller, which goes on when the callee has returned. So a path has one ray in flight, and
//! its calls are RA's stack of loop entries: a call that awaits nothing needs no more memory than a hit
//! shader. There is no executor and no waker: the scheduler's batches say whose turn it is.
//!
//! Shadow rays travel in the stream of the ray that is sent with them and are answered before it is shaded
//! (RA section 3.2). A call that asks for nothing but shadow rays sends a ray that hits nothing along, which
//! brings it back; it counts as a ray.
//!
//! # Memory
//! With N paths in flight there are at most N · [`Shader::most_calls`] calls, each of the size of
//! the future (a number known when the shader is compiled: [`Recursion::call_bytes`]), besides what the places'
//! hands keep:
//! - Each path in flight has one stack; a stack grows only by a call, and no higher than `most_calls`,
//!   which is checked.
//! - A path in flight has exactly one ray in flight: a turn ends by sending one, or by ending the path.
//! - So when N · `most_calls` calls would be more than a GiB, [`Recursion`] has the scheduler keep fewer paths in
//!   flight ([`crate::schedule::Renderer::most_in_flight`]): *spawning waits*, at the cost of smaller streams. One
//!   tile's paths are always let in, without which nothing would go on.
//! - In a turn a path emits at most [`Shader::SHADOW_RAYS`] shadow rays. Callers that go on after a return share the
//!   turn; when there is no room left, *the call waits* for its next turn.
//!
//! Nothing is ever dropped, and nothing waits for what another path holds, so no path waits for ever.
//! Memory is allocated for places only when there are more calls than ever before.
//!
//! # Cost
//! A turn costs an uncontended lock, a few moves between the thread's exchange and the future, and the
//! emission. `docs/results/textures-and-instances.md` has what the recursive Whitted takes beside the one by hand.

mod calls;
mod context;
mod exchange;
mod renderer;

pub use calls::CallState;
pub use context::Cx;
pub use exchange::ShadowState;
pub use renderer::Recursion;

use crate::stream::{Hit, Ray};
use context::Answered;
use glam::Vec3;
use std::future::Future;

/// A recursive shader. The module's page is a tutorial.
pub trait Shader: Send + Sync + Sized + 'static {
    /// What a call is given.
    type Args: Send + 'static;

    /// What a call returns. What the camera ray's call returns is added to its pixel.
    type Value: Radiance;

    /// The most shadow rays of a path on their way at once; beyond, it waits.
    const SHADOW_RAYS: usize;

    /// The most bounces that may be asked for.
    const MAX_BOUNCES: u32 = 64;

    /// The most calls of a path that are begun and have not returned, the first one included. Each path in
    /// flight may take up that many places, so say no more than is true.
    fn most_calls(&self, max_bounces: u32) -> usize {
        max_bounces as usize + 1
    }

    /// The most times that one camera ray adds radiance to its pixel, what its call returns included: the
    /// film's sums have room for that many.
    fn splats(&self, _max_bounces: u32) -> u64 {
        1
    }

    /// What the call for a camera ray is given.
    fn camera(&self) -> Self::Args;

    /// A call: what comes along a ray, seen from its origin, when `hit` is what the ray met, if anything.
    /// Write it as an `async fn`.
    fn shade(
        &self,
        cx: Cx<'_, Self>,
        ray: Ray,
        hit: Option<Hit>,
        args: Self::Args,
    ) -> impl Future<Output = Self::Value> + Send;
}

/// What the first call of a path may return.
pub trait Radiance: Send + 'static {
    /// What it adds to the pixel.
    fn radiance(&self) -> Vec3;
}

impl Radiance for Vec3 {
    fn radiance(&self) -> Vec3 {
        *self
    }
}

/// For shaders that add radiance as they find it.
impl Radiance for () {
    fn radiance(&self) -> Vec3 {
        Vec3::ZERO
    }
}
