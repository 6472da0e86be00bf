//! Rays of paths that pass surfaces of computed opacity: those of the path itself, and those that follow the light of a
//! punctual light.
//!
//! Shadow rays take such surfaces as opaque. What lies behind is found by rays that pass ([`pass_through`]), but not a
//! punctual light, which no ray hits. Where a scene has both, some paths go on towards the light that they have sampled
//! and not by the BSDF. Such a ray is traced and shaded as the others are, carries the radiance of the light, and adds
//! it if it arrives and has passed a surface: what arrives without is the shadow ray's. Both ways are weighted by their
//! probability.

use super::path_state::States;
use super::{Contribution, NewRays, PathState};
use crate::geom::Sampler;
use crate::lanes::{Int, Lanes, Mask, Num, OutlinedTask, Vector};
use crate::schedule::Output;
use crate::shade::pass_through;

/// Share of the paths that follow light from their first hit. At later hits it is divided by their number: the weights
/// of the paths that go on would else grow with each hit by the same factor.
const FOLLOWING: f32 = 0.25;

/// Lanes whose rays follow light.
#[inline(always)]
pub(super) fn are_of_light<L: Lanes>(state: &States<L>) -> Mask<L> {
    state.pdf.below(0.0)
}

/// Lanes whose rays follow light and have passed a surface.
#[inline(always)]
pub(super) fn have_passed<L: Lanes>(state: &States<L>) -> Mask<L> {
    are_of_light(state) & state.pdf.above(f32::NEG_INFINITY)
}

/// Rays that may pass a surface of computed opacity, without a bounce. Out of line: few materials have one.
pub(super) struct Passing<'a, 'o, L: Lanes> {
    pub out: &'a mut Output<'o, PathState, Contribution>,
    pub sampler: Sampler<L>,
    /// The rays that go on where the surface is passed.
    pub rays: NewRays<L>,
    pub primitive: Int<L>,
    pub opacity: Num<L>,
    /// With the cones at the hits.
    pub state: States<L>,
    pub lanes: Mask<L>,
}

impl<L: Lanes> OutlinedTask<L> for Passing<'_, '_, L> {
    /// The lanes that pass.
    type Output = Mask<L>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) -> Mask<L> {
        let Self { out, sampler, rays, primitive, opacity, state, lanes } = self;
        let (pdf, may) = pass_through::passed(state.pdf.abs());
        let lanes = lanes & may & pass_through::passes(opacity, &sampler, state.depth, primitive);
        let states = States { pdf: pdf.copysign(state.pdf), ..state }.rows(lanes);
        rays.emit(out, lanes, bytemuck::cast_slice(states.as_ref()));
        lanes
    }
}

/// Light of punctual lights that paths have sampled, and the way to it.
pub(super) struct Following<'a, 'o, L: Lanes> {
    pub out: &'a mut Output<'o, PathState, Contribution>,
    pub sampler: Sampler<L>,
    /// From the surface to the light.
    pub rays: NewRays<L>,
    pub radiance: Vector<L>,
    pub state: States<L>,
    pub lanes: Mask<L>,
}

impl<L: Lanes> OutlinedTask<L> for Following<'_, '_, L> {
    /// The lanes whose paths follow light, and the throughputs of the others.
    type Output = (Mask<L>, Vector<L>);

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) -> (Mask<L>, Vector<L>) {
        let Self { out, sampler, rays, radiance, state, lanes } = self;
        let share = Num::splat(radiance.lanes(), FOLLOWING) / (state.depth + 1).to_num();
        let follows = lanes & pass_through::follows_light(share, &sampler, state.depth);
        let throughput = radiance * (1.0 / share);
        let pdf = Num::splat(radiance.lanes(), f32::NEG_INFINITY);
        let states = States { throughput, pdf, depth: state.depth + 1, ..state }.rows(follows);
        // Hits are shaded for rays of unit direction.
        let length = rays.direction.length();
        let direction = rays.direction * (1.0 / length);
        let rays = NewRays { direction, t_max: rays.t_max * length, ..rays };
        rays.emit(out, follows, bytemuck::cast_slice(states.as_ref()));
        (follows, Vector::select(lanes, state.throughput * (1.0 / (1.0 - share)), state.throughput))
    }
}
