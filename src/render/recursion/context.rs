//! The context of a shader's calls.

use super::Shader;
use super::exchange::{Exchange, Request};
use crate::geom::Sampler;
use crate::render::{Frame, Settings, SurfaceHit};
use crate::scene::Scene;
use crate::shade::{Lights, material_of, single};
use crate::stream::{Hit, Ray};
use glam::Vec3;
use std::future::Future;
use std::marker::PhantomData;
use std::pin::Pin;
use std::task::{Context, Poll};

/// The answers to a ray and the shadow rays sent with it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Answers {
    pub hit: Option<Hit>,
    /// One bit for each shadow ray, set if it is occluded.
    pub occluded: u32,
}

/// A ray that hits nothing. A call that sends only shadow rays sends it as well, so that it gets another turn.
pub(super) const NO_RAY: Ray = Ray { origin: [0.0; 3], t_min: 0.0, direction: [1.0, 0.0, 0.0], t_max: -1.0 };

/// Gives a call access to the scene, to rays and to other calls. It works only within the shader while the engine
/// polls it. Elsewhere its methods panic.
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

    /// The frame that is being rendered.
    pub fn frame(self) -> &'a Frame {
        self.frame
    }

    /// The scene.
    pub fn scene(self) -> &'a Scene {
        self.frame.scene()
    }

    /// The scene's lights.
    pub fn lights(self) -> &'a Lights {
        self.frame.lights()
    }

    /// The frame's settings.
    pub fn settings(self) -> &'a Settings {
        self.frame.settings()
    }

    /// The random numbers of this sample of this pixel. Dimension 0 is used for the position within the pixel. Use a
    /// separate dimension for each decision, also in each branch of the recursion; otherwise they are correlated.
    pub fn sampler(self) -> Sampler {
        Exchange::call(|_, path| self.frame.sampler(path.pixel, path.sample))
    }

    /// The surface that a ray has hit.
    pub fn surface(self, ray: &Ray, hit: &Hit) -> SurfaceHit<'a> {
        let scene = self.scene();
        SurfaceHit::new(scene, &scene.materials[material_of(scene, hit) as usize], ray, hit)
    }

    /// Radiance of the environment in a ray's direction.
    pub fn sky(self, ray: &Ray) -> Vec3 {
        single::sky(self.lights(), Vec3::from_array(ray.direction).normalize()).0
    }

    /// Traces a ray. Returns the closest hit, `None` for a miss.
    pub async fn trace(self, ray: Ray) -> Option<Hit> {
        self.trace_with(ray, []).await.0
    }

    /// True if a ray is occluded between its ends.
    pub async fn occluded(self, ray: Ray) -> bool {
        self.occluded_each([ray]).await[0]
    }

    /// For each ray, true if it is occluded. The rays are sent together, at most [`Shader::SHADOW_RAYS`].
    pub async fn occluded_each<const N: usize>(self, rays: [Ray; N]) -> [bool; N] {
        self.trace_with(NO_RAY, rays).await.1
    }

    /// Traces a ray and, together with it, shadow rays: at most [`Shader::SHADOW_RAYS`].
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
            Exchange::call(|_, path| self.frame.splat(None, path.target, radiance));
        }
    }

    /// Adds radiance to the pixel unless a shadow ray is occluded. The call does not wait for the answer. It may wait
    /// until the ray can be sent: in each turn, the time between two rays of the path, at most
    /// [`Shader::SHADOW_RAYS`] shadow rays are sent.
    pub fn add_unless_occluded(self, ray: Ray, radiance: Vec3) -> impl Future<Output = ()> + Send + use<S> {
        const { assert!(S::SHADOW_RAYS > 0, "Shader::SHADOW_RAYS leaves no room for shadow rays") };
        UnlessOccluded { ray, radiance }
    }

    /// Traces a ray, calls the shader recursively with the hit, and waits for the value that the call returns.
    pub fn call(self, ray: Ray, args: S::Args) -> impl Future<Output = S::Value> + Send + use<S> {
        Callee::<S> { ray, stage: Stage::Called(args) }
    }
}

/// Rays in flight.
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
                let Answers { hit, occluded } = exchange.answers.get();
                let bits = std::array::from_fn(|bit| occluded >> bit & 1 != 0);
                return Poll::Ready((hit, bits));
            }
            if exchange.reserve(N) {
                for (bit, &ray) in self.shadows.iter().enumerate() {
                    exchange.send_query(ray, bit);
                }
                exchange.request(Request::Rays(self.ray));
                self.sent = true;
            } else {
                exchange.request(Request::Turn);
            }
            Poll::Pending
        })
    }
}

/// A shadow ray whose radiance is added unless the ray is occluded.
struct UnlessOccluded {
    ray: Ray,
    radiance: Vec3,
}

impl Future for UnlessOccluded {
    type Output = ();

    fn poll(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<()> {
        Exchange::call(|exchange, path| {
            if exchange.reserve(1) {
                exchange.send_radiance(self.ray, self.radiance, path.target);
                return Poll::Ready(());
            }
            exchange.request(Request::Turn);
            Poll::Pending
        })
    }
}

/// A recursive call of the shader.
struct Callee<S: Shader> {
    ray: Ray,
    stage: Stage<S::Args>,
}

enum Stage<A> {
    /// The ray has not been requested yet.
    Called(A),
    /// The ray is in flight.
    Sent(A),
    /// The callee is on the stack above its caller.
    Begun,
}

// The arguments are moved out and never pinned.
impl<S: Shader> Unpin for Callee<S> {}

impl<S: Shader> Future for Callee<S> {
    type Output = S::Value;

    fn poll(mut self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<S::Value> {
        Exchange::call(|exchange, _| match std::mem::replace(&mut self.stage, Stage::Begun) {
            Stage::Called(args) => {
                exchange.request(Request::Rays(self.ray));
                self.stage = Stage::Sent(args);
                Poll::Pending
            }
            Stage::Sent(args) => {
                exchange.request(Request::Call);
                exchange.transfer::<S::Args, S::Value, _>(|transfer| transfer.args = Some(args));
                Poll::Pending
            }
            Stage::Begun => {
                let value = exchange.transfer::<S::Args, S::Value, _>(|transfer| transfer.value.take());
                Poll::Ready(value.expect("a call is resumed when its callee has returned"))
            }
        })
    }
}
