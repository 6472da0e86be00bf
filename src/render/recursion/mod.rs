//! Recursive shaders, written as one `async fn` and run on ray streams.
//!
//! RA's loop shaders let a path return to an earlier hit (section 3.3). The shader then has to be split by hand into
//! a hit shader, loop shaders, and the state that each saves for the next. RA asks for a compiler that does this
//! ("that automatically splits a single recursive shader into one hit shader and possibly multiple loop shaders with
//! minimal state footprint", section 6). Rust has such a compiler: an `async fn` becomes a state machine that saves
//! exactly what is needed after each `await`.
//!
//! # A first shader
//! A [`Shader`] is a recursive function that takes a ray and its hit and returns the radiance along the ray. Its
//! context [`Cx`] traces other rays ([`Cx::call`] traces one and calls the shader with its hit; [`Cx::trace`] returns
//! the hit itself) and shadow rays ([`Cx::occluded`]). The shader may trace any number of rays, in loops and
//! branches, and each may depend on earlier answers. This example renders mirrors, which reflect each other until the
//! reflections are too weak to show, and a sun:
//!
//! ```
//! use raystream::glam::Vec3;
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
//! /// A ray's weight in the pixel, and its number of reflections.
//! type Weight = (f32, u32);
//!
//! impl Shader for Mirrors {
//!     type Args = Weight;           // a call's arguments besides the ray and the hit
//!     type Value = Vec3;            // a call's result
//!     const SHADOW_RAYS: usize = 1; // most shadow rays at once
//!
//!     fn camera(&self) -> Weight {
//!         (1.0, 0)
//!     }
//!
//!     async fn shade(&self, cx: Cx<'_, Self>, ray: Ray, hit: Option<Hit>, (weight, depth): Weight) -> Vec3 {
//!         let Some(hit) = hit else {
//!             return Vec3::new(0.4, 0.6, 0.9); // the sky
//!         };
//!         let at = cx.surface(&ray, &hit);
//!         let mut light = Vec3::splat(0.05);
//!         let facing = at.normal.dot(self.sun);
//!         if facing > 0.0 && !cx.occluded(at.ray(self.sun)).await {
//!             light += Vec3::splat(0.5 * facing);
//!         }
//!         let weight = 0.6 * weight;
//!         if weight > 0.05 && depth < cx.settings().max_bounces {
//!             light += 0.6 * cx.call(at.ray(at.mirrored()), (weight, depth + 1)).await;
//!         }
//!         light
//!     }
//! }
//!
//! let recipe = Recipe::parse(r#"{ "environment": [1, 1, 1], "materials": { "any": { "colour": [1, 1, 1] } },
//!     "shapes": [ { "shape": "sphere", "centre": [-1, 0, 0], "radius": 1, "cells": 16, "material": "any" },
//!                 { "shape": "sphere", "centre": [1, 0, 0], "radius": 1, "cells": 16, "material": "any" } ] }"#)?;
//! let prepared = PreparedScene::new(Arc::new(recipe.build()?), &Units::cpu())?;
//! let camera = Camera::framing(&prepared.scene.bounds(), 1.0);
//! let settings = Settings::new(64, 64).with_spp(4).with_max_bounces(8);
//!
//! // The shader is a renderer like any other: a job for the service.
//! let sun = Vec3::new(0.3, 0.9, 0.4).normalize();
//! let mirrors = prepared.recursion(Mirrors { sun }, &camera, settings)?;
//! let service = Service::new(ServiceOptions::default().with_host_threads(2))?;
//! prepared.submit(&service, mirrors.clone(), JobOptions::default())?.wait()?;
//!
//! let picture = mirrors.film().resolve();
//! assert_eq!(picture[0], [0.4, 0.6, 0.9]);
//! assert!(picture[32 * 64 + 16][0] > 0.1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A shader must follow three rules. It awaits only futures of its context, one at a time ([`Cx::trace_with`] sends a
//! ray and shadow rays together). Its recursion is at most [`Shader::most_calls`] deep. Its random numbers come from
//! [`Cx::sampler`], so that the picture does not depend on the order of execution. A shader that breaks one of the
//! first two rules fails its job with a message.
//!
//! If the shader does not need the radiance of a path itself, it is cheaper to add it where it is found, with
//! [`Cx::add`] or [`Cx::add_unless_occluded`], which sends a shadow ray but does not wait for it.
//! [`super::RecursiveWhitted`] does so, and gives the same bytes as the hand-written [`super::Whitted`].
//!
//! # How it runs
//! A camera ray travels without a call. When it has been traced, the first call begins and has a turn: it runs until
//! it awaits an answer or returns. A call that awaits has a *slot* in an arena of recycled buckets
//! ([`crate::shade::arena`]). Its future, the state machine, stays in the slot until it returns. The awaited ray
//! carries the slot's number as its payload through the streams, like any ray. When a batch has been traced, the
//! engine sorts it by material and gives each path a turn. A ray sent by [`Cx::call`] begins a call above its caller
//! on the path's stack; the caller resumes when the callee has returned. A path therefore has one ray in flight, and
//! its calls are RA's stack of loop entries. A call that awaits nothing needs no more memory than a hit shader. There
//! is no executor and no waker: the scheduler's batches determine whose turn it is.
//!
//! Shadow rays travel in the stream of the ray that is sent with them, and are answered before that ray is shaded (RA
//! section 3.2). A call that requests only shadow rays also sends a ray that hits nothing, which gives it another
//! turn. That ray counts as a ray.
//!
//! # Memory
//! With N paths in flight there are at most N · [`Shader::most_calls`] calls. Each has the size of the future, a
//! number known when the shader is compiled ([`Recursion::call_bytes`]). The arena's free lists of the threads add a
//! few slots.
//! - Each path in flight has one stack. A stack grows only by a call, and no higher than `most_calls`, which is
//!   checked.
//! - A path in flight has exactly one ray in flight: a turn ends by sending one, or by ending the path.
//! - If N · `most_calls` calls would take more than a GiB, [`Recursion`] limits the paths in flight
//!   ([`crate::schedule::Renderer::most_in_flight`]): *spawning waits*, at the cost of smaller streams. The paths of
//!   one tile are always allowed, because otherwise no path could begin.
//! - In a turn a path emits at most [`Shader::SHADOW_RAYS`] shadow rays. Callers that resume after a return share the
//!   turn. When none are left, *the call waits* for its next turn.
//!
//! Nothing is ever dropped, and no path waits for a resource that another path holds, so no path waits forever.
//! Memory for slots is allocated only when there are more calls than ever before.
//!
//! # Cost
//! A turn costs an uncontended lock, a few moves between the thread's exchange and the future, and the emission.
//! `docs/lab/older-builds.md` compares the recursive Whitted with the hand-written one.

mod calls;
mod context;
mod exchange;
mod renderer;

pub use calls::CallState;
pub use context::Cx;
pub use exchange::ShadowState;
pub use renderer::Recursion;

use crate::stream::{Hit, Ray};
use context::Answers;
use glam::Vec3;
use std::future::Future;

/// A recursive shader. The [module documentation](self) is a tutorial.
pub trait Shader: Send + Sync + Sized + 'static {
    /// The arguments of a call, besides the ray and the hit.
    type Args: Send + 'static;

    /// The value that a call returns. The value of the camera ray's call is added to its pixel.
    type Value: Radiance;

    /// The most shadow rays of a path in flight at once. A call that emits more waits.
    const SHADOW_RAYS: usize;

    /// The largest setting of max bounces.
    const MAX_BOUNCES: u32 = 64;

    /// The most calls of a path that have begun and not returned, including the first one. Each path in flight may
    /// occupy this many slots, so return no more than the shader needs.
    fn most_calls(&self, max_bounces: u32) -> usize {
        max_bounces as usize + 1
    }

    /// The most times that one camera ray adds radiance to its pixel, including the value of its call. The film's
    /// precision depends on it.
    fn splats(&self, _max_bounces: u32) -> u64 {
        1
    }

    /// The arguments of a camera ray's call.
    fn camera(&self) -> Self::Args;

    /// A call: returns the radiance, or another value, along `ray` as seen from its origin. `hit` is the ray's
    /// closest hit, `None` for a miss. Write it as an `async fn`.
    fn shade(
        &self,
        cx: Cx<'_, Self>,
        ray: Ray,
        hit: Option<Hit>,
        args: Self::Args,
    ) -> impl Future<Output = Self::Value> + Send;
}

/// A value that the first call of a path may return.
pub trait Radiance: Send + 'static {
    /// The radiance that is added to the pixel.
    fn radiance(&self) -> Vec3;
}

impl Radiance for Vec3 {
    fn radiance(&self) -> Vec3 {
        *self
    }
}

/// For shaders that add radiance where they find it.
impl Radiance for () {
    fn radiance(&self) -> Vec3 {
        Vec3::ZERO
    }
}
