//! Shading of one ray at a time, in plain numbers. It runs the same operations as many lanes do, with one
//! lane, and so gives the same bits.

use super::{bsdf, light, lookup};
use crate::geom::Basis;
use crate::lanes::{Num, SingleLane, Vector};
use crate::scene::{Emission, Footprint, Material, Scene, Surface, TexturePoint};
use crate::shade::Lights;
use crate::stream::{Hit, Ray};
use glam::{Vec2, Vec3};

/// A [`super::Interaction`] of one ray.
#[derive(Clone, Copy, Debug)]
pub struct Interaction {
    /// The point on the triangle.
    pub position: Vec3,
    /// Unit direction back along the ray.
    pub wo: Vec3,
    /// Unit normal of the triangle, on `wo`'s side.
    pub normal: Vec3,
    /// Shading basis.
    pub basis: Basis,
    /// Mesh texture coordinates of set 0.
    pub uv: Vec2,
    /// True if the front is hit: `wo` is on the side from which the triangle's vertices run
    /// counter-clockwise.
    pub front: bool,
    /// True if `wo` is outside of the body.
    pub outside: bool,
    /// Start of scattered rays.
    pub raised: Vec3,
    pub(super) lane: super::Interaction<SingleLane>,
}

impl Interaction {
    /// The interaction of a ray with the triangle that it hit, of material `material`.
    pub fn new(scene: &Scene, material: &Material, ray: &Ray, hit: &Hit) -> Self {
        let direction = Vector::from(Vec3::from_array(ray.direction)).normalize();
        let lane = super::Interaction::new(scene, material, direction, &(*hit).into(), 0.0.into());
        Self {
            position: lane.position.into(),
            wo: lane.wo.into(),
            normal: lane.normal.into(),
            basis: lane.basis,
            uv: lane.texture.uv.map(Num::get).into(),
            front: lane.front.get(),
            outside: lane.outside.get(),
            raised: lane.raised.into(),
            lane,
        }
    }

    /// [`super::Interaction::smooth_direction`]; a direction below the basis crosses the surface.
    pub fn smooth_direction(&self, local: Vec3) -> Vec3 {
        self.lane.smooth_direction(local.into(), local.z.is_sign_negative().into()).into()
    }

    /// [`super::Interaction::computed_emission`]; 0 if there is none.
    pub fn computed_emission(&self, scene: &Scene, material: &Material) -> Vec3 {
        self.lane.computed_emission(scene, material).map_or(Vec3::ZERO, Vec3::from)
    }

    /// The point as a receiver of light.
    pub fn receiver(&self) -> Receiver {
        Receiver::of(&self.lane)
    }

    /// [`super::Interaction::origin`].
    pub fn origin(&self, point: Vec3, wi: Vec3) -> Vec3 {
        self.lane.origin(point.into(), wi.into()).into()
    }
}

/// [`light::Receiver`] of one ray.
pub type Receiver = light::Receiver<SingleLane>;

impl From<Hit> for super::Hits<SingleLane> {
    fn from(hit: Hit) -> Self {
        Self { t: hit.t.into(), u: hit.u.into(), v: hit.v.into(), primitive: hit.primitive.into() }
    }
}

/// A [`bsdf::Bsdf`] at one point.
#[derive(Clone, Copy, Debug)]
pub struct Bsdf<'s>(pub(super) bsdf::Bsdf<'s, SingleLane>);

/// A [`bsdf::Sample`] of one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Direction from which the light arrives.
    pub wi: Vec3,
    /// BSDF × |cosine| / density.
    pub weight: Vec3,
    /// Density per solid angle; +∞ where `specular`.
    pub pdf: f32,
    /// True if `wi` is one of finitely many possible directions.
    pub specular: bool,
    /// Index of refraction of the medium that `wi` points into relative to that of `wo`.
    pub eta: f32,
}

/// The specular directions of [`bsdf::Smooth`], each with the factor for its radiance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Smooth {
    /// Mirrored direction and its factor.
    pub reflection: Option<(Vec3, Vec3)>,
    /// Refracted direction, or straight on through a thin wall, and its factor.
    pub transmission: Option<(Vec3, Vec3)>,
    /// [`Sample::eta`] of the transmission.
    pub eta: f32,
}

impl<'s> Bsdf<'s> {
    /// The BSDF of `surface` at a point: [`bsdf::Bsdf::new`].
    pub fn new(scene: &'s Scene, surface: &Surface, at: &Interaction, smoothness: bsdf::Smoothness) -> Self {
        Self(bsdf::Bsdf::new(scene, surface, &at.lane, smoothness))
    }

    /// [`bsdf::Bsdf::evaluate`].
    pub fn evaluate(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        let (value, pdf) = self.0.evaluate(wo.into(), wi.into());
        (value.into(), pdf.get())
    }

    /// [`bsdf::Bsdf::sample`]; `None` if no light comes from there.
    pub fn sample(&self, wo: Vec3, u: f32, u2: [f32; 2]) -> Option<Sample> {
        let sample = self.0.sample(wo.into(), u.into(), u2.map(Num::from));
        sample.valid.get().then(|| Sample {
            wi: sample.wi.into(),
            weight: sample.weight.into(),
            pdf: sample.pdf.get(),
            specular: sample.specular.get(),
            eta: sample.eta.get(),
        })
    }

    /// [`bsdf::Bsdf::smooth`].
    pub fn smooth(&self, wo: Vec3) -> Smooth {
        let smooth = self.0.smooth(wo.into());
        let there = |way: Vector<SingleLane>, weight: Vector<SingleLane>| {
            let weight = Vec3::from(weight);
            (weight != Vec3::ZERO).then(|| (way.into(), weight))
        };
        Smooth {
            reflection: there(smooth.reflected, smooth.reflection),
            transmission: there(smooth.transmitted, smooth.transmission),
            eta: smooth.eta.get(),
        }
    }

    /// True if light sampling must also consider light from below the surface.
    pub fn is_frosted(&self) -> bool {
        self.0.is_frosted()
    }

    /// True if the BSDF is purely specular, so that light sampling never contributes.
    pub fn is_smooth(&self) -> bool {
        self.0.is_smooth()
    }
}

/// Radiance that a surface emits towards the viewer of `at`; 0 without an emission.
pub fn emission(scene: &Scene, emission: Option<&Emission>, at: &Interaction) -> Vec3 {
    match emission {
        None => Vec3::ZERO,
        Some(emission) => {
            let point = TexturePoint { footprint: Footprint::point(SingleLane), ..at.lane.texture };
            lookup::emission(scene, emission, &point, at.front.into()).into()
        }
    }
}

/// A [`light::LightSample`] at one point.
#[derive(Clone, Copy, Debug)]
pub struct LightSample {
    /// Unit direction towards the light.
    pub wi: Vec3,
    /// Position of the light; `None` if it is infinitely far away.
    pub target: Option<Vec3>,
    /// Radiance; where `delta`, irradiance on a surface that faces the light.
    pub radiance: Vec3,
    /// Density per solid angle; where `delta`, the probability of choosing the light.
    pub pdf: f32,
    /// True if only light sampling can find this light.
    pub delta: bool,
    lane: light::LightSample<SingleLane>,
}

impl LightSample {
    fn of(lane: light::LightSample<SingleLane>) -> Option<Self> {
        lane.valid.get().then(|| Self {
            wi: lane.wi.into(),
            target: lane.near.get().then(|| lane.target.into()),
            radiance: lane.radiance.into(),
            pdf: lane.pdf.get(),
            delta: lane.delta.get(),
            lane,
        })
    }

    /// [`Lights::sample`]; `None` if no light reaches the receiver.
    pub fn any(lights: &Lights, scene: &Scene, to: &Receiver, u: f32, u2: [f32; 2]) -> Option<Self> {
        Self::of(lights.sample(scene, to, Some(u.into()), u2.map(Num::from)))
    }

    /// [`Lights::sample_surfaces`].
    pub fn surface(lights: &Lights, scene: &Scene, to: &Receiver, u: f32, u2: [f32; 2]) -> Option<Self> {
        Self::of(lights.sample_surfaces(scene, to, u.into(), u2.map(Num::from)))
    }

    /// [`Lights::sample_punctual`].
    pub fn punctual(lights: &Lights, to: &Receiver, u: f32) -> Option<Self> {
        Self::of(lights.sample_punctual(to, u.into()))
    }

    /// [`Lights::illuminate`].
    pub fn of_light(lights: &Lights, index: usize, from: Vec3) -> Option<Self> {
        Self::of(lights.illuminate(index, from.into()))
    }

    /// The shadow ray from a surface to this light.
    pub fn ray(&self, at: &Interaction) -> Ray {
        let (origin, direction, t_max) = self.lane.rays(&at.lane);
        Ray { t_max: t_max.get(), ..Ray::new(Vec3::from(origin), Vec3::from(direction)) }
    }
}

/// Radiance of the environment along a unit direction, and the density of sampling it: [`Lights::sky`].
pub fn sky(lights: &Lights, direction: Vec3) -> (Vec3, f32) {
    let (radiance, pdf) = lights.sky(Vector::from(direction));
    (radiance.into(), pdf.get())
}
