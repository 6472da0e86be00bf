//! What a shader's call may ask for.

use super::Shader;
use super::exchange::{Exchange, Wish};
use crate::geom::Sampler;
use crate::render::{Frame, Settings};
use crate::scene::{Material, Scene};
use crate::shade::single::Interaction;
use crate::shade::{Lights, material_of};
use crate::stream::{Hit, Ray};
use glam::Vec3;
use std::future::Future;
use std::marker::PhantomData;
use std::pin::Pin;
use std::task::{Context, Poll};

/// The answers to what was sent out together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Answered {
    pub hit: Option<Hit>,
    /// One bit for each question, set when it is occluded.
    pub occluded: u32,
}

/// A ray that hits nothing: it brings a call back that has no ray of its own to send.
pub(super) const NO_RAY: Ray = Ray { origin: [0.0; 3], t_min: 0.0, direction: [1.0, 0.0, 0.0], t_max: -1.0 };

/// A call's way to the scene, to rays and to other calls. It works only inside of the shader, while the
/// engine runs it; elsewhere its methods panic.
#[derive(Debug)]
pub struct Cx<'a, S: ?Sized> {
    frame: &'a Frame,
    shader: PhantomData<fn(&S)>,
}

impl<S: ?Sized> Clone for Cx<'_, S> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<S: ?Sized> Copy for Cx<'_, S> {}

impl<'a, S: Shader> Cx<'a, S> {
    pub(in crate::render) fn new(frame: &'a Frame) -> Self {
        Self { frame, shader: PhantomData }
    }

    /// The frame at work.
    pub fn frame(self) -> &'a Frame {
        self.frame
    }

    /// The scene.
    pub fn scene(self) -> &'a Scene {
        self.frame.scene()
    }

    /// Its lights.
    pub fn lights(self) -> &'a Lights {
        self.frame.lights()
    }

    /// The frame's settings.
    pub fn settings(self) -> &'a Settings {
        self.frame.settings()
    }

    /// The random numbers of this sample of this pixel; dimension 0 is taken by the place in the pixel.
    /// Give each use a dimension of its own, in each branch of the recursion, or they are correlated.
    pub fn sampler(self) -> Sampler {
        Exchange::call(|_, path| self.frame.sampler(path.pixel, path.sample))
    }

    /// What a ray met at its hit, and of what material that is.
    pub fn surface(self, ray: &Ray, hit: &Hit) -> (&'a Material, Interaction) {
        let scene = self.scene();
        let material = &scene.materials[material_of(scene, hit) as usize];
        (material, Interaction::new(scene, material, ray, hit))
    }

    /// Sends a ray; the nearest hit, if there is one.
    pub async fn trace(self, ray: Ray) -> Option<Hit> {
        self.trace_with(ray, []).await.0
    }

    /// Whether anything lies on a ray between its ends.
    pub async fn occluded(self, ray: Ray) -> bool {
        self.occluded_each([ray]).await[0]
    }

    /// The same for several rays that travel together: at most [`Shader::SHADOW_RAYS`].
    pub async fn occluded_each<const N: usize>(self, rays: [Ray; N]) -> [bool; N] {
        self.trace_with(NO_RAY, rays).await.1
    }

    /// Sends a ray and, together with it, shadow rays: at most [`Shader::SHADOW_RAYS`].
    pub fn trace_with<const N: usize>(
        self,
        ray: Ray,
        shadows: [Ray; N],
    ) -> impl Future<Output = (Option<Hit>, [bool; N])> + Send + use<'a, N, S> {
        const { assert!(N <= S::SHADOW_RAYS && N <= 32, "more shadow rays at once than Shader::SHADOW_RAYS") };
        Rays { ray, shadows, sent: false }
    }

    /// Adds radiance to the pixel.
    pub fn add(self, radiance: Vec3) {
        if radiance != Vec3::ZERO {
            Exchange::call(|_, path| self.frame.film().splat(path.pixel, radiance));
        }
    }

    /// Adds radiance to the pixel unless something lies on a shadow ray. The call does not wait for the
    /// ray; only, if need be, for room to send it: each turn, the time from one ray of the path to the next,
    /// has room for [`Shader::SHADOW_RAYS`].
    pub fn add_unless_occluded(self, ray: Ray, radiance: Vec3) -> impl Future<Output = ()> + Send + use<S> {
        const { assert!(S::SHADOW_RAYS > 0, "Shader::SHADOW_RAYS leaves no room for shadow rays") };
        LightRay { ray, radiance }
    }

    /// Sends a ray, calls the shader with its hit, and waits for what it returns: recursion.
    pub fn call(self, ray: Ray, args: S::Args) -> impl Future<Output = S::Value> + Send + use<S> {
        Callee::<S> { ray, stage: Stage::Called(args) }
    }
}

/// Rays on their way.
struct Rays<const N: usize> {
    ray: Ray,
    shadows: [Ray; N],
    sent: bool,
}

impl<const N: usize> Future for Rays<N> {
    type Output = (Option<Hit>, [bool; N]);

    fn poll(mut self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<Self::Output> {
        Exchange::call(|exchange, _| {
            if self.sent {
                let Answered { hit, occluded } = exchange.answered.get();
                let bits = std::array::from_fn(|question| occluded >> question & 1 != 0);
                return Poll::Ready((hit, bits));
            }
            if exchange.make_room(N) {
                for (question, &ray) in self.shadows.iter().enumerate() {
                    exchange.question(ray, question);
                }
                exchange.wish(Wish::Rays(self.ray));
                self.sent = true;
            } else {
                exchange.wish(Wish::Turn);
            }
            Poll::Pending
        })
    }
}

/// Light that arrives unless it is occluded.
struct LightRay {
    ray: Ray,
    radiance: Vec3,
}

impl Future for LightRay {
    type Output = ();

    fn poll(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<()> {
        Exchange::call(|exchange, path| {
            if exchange.make_room(1) {
                exchange.light(self.ray, self.radiance, path.pixel);
                return Poll::Ready(());
            }
            exchange.wish(Wish::Turn);
            Poll::Pending
        })
    }
}

/// A call of the shader by itself.
struct Callee<S: Shader> {
    ray: Ray,
    stage: Stage<S::Args>,
}

enum Stage<A> {
    Called(A),
    /// The ray is on its way.
    Sent(A),
    /// The callee is above its caller.
    Begun,
}

// The arguments are moved out, never pinned.
impl<S: Shader> Unpin for Callee<S> {}

impl<S: Shader> Future for Callee<S> {
    type Output = S::Value;

    fn poll(mut self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<S::Value> {
        Exchange::call(|exchange, _| match std::mem::replace(&mut self.stage, Stage::Begun) {
            Stage::Called(args) => {
                exchange.wish(Wish::Rays(self.ray));
                self.stage = Stage::Sent(args);
                Poll::Pending
            }
            Stage::Sent(args) => {
                exchange.wish(Wish::Call);
                exchange.parcel::<S::Args, S::Value, _>(|parcel| parcel.args = Some(args));
                Poll::Pending
            }
            Stage::Begun => {
                let value = exchange.parcel::<S::Args, S::Value, _>(|parcel| parcel.value.take());
                Poll::Ready(value.expect("a call is resumed when its callee has returned"))
            }
        })
    }
}
