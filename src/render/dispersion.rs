//! Dispersion: bodies that refract red, green and blue light differently.
//!
//! A path carries all three channels until it crosses the boundary of such a body, or scatters inside of one. From
//! there on it carries one channel, with three times its weight. The channel is a function of pixel and sample, the
//! same for all surfaces of a path. So the mean over paths is right in each channel, and a path that does not enter
//! such a body is not noisier than without.

use super::path_state::PathState;
use crate::geom::Sampler;
use crate::lanes::{Lanes, Mask, Vector};
use crate::scene::{Material, Surface};

/// The channels: red, green and blue.
const CHANNELS: usize = 3;

/// The sampler's dimension of the channel. Path tracers count dimensions from 0, and dimensions from 2³¹ on belong to
/// surfaces that rays pass.
const DIMENSION: u32 = (1 << 31) - 1;

/// Rays that hit a dispersive surface, sorted by the channels of their paths.
pub(super) struct ByChannel {
    rays: [Vec<u32>; CHANNELS],
    channels: [OneChannel; CHANNELS],
}

/// A dispersive surface as paths of one channel see it.
pub(super) struct OneChannel {
    channel: usize,
    pub surface: Surface,
}

impl ByChannel {
    /// Sorts `rays`, which all hit `material`. `None` if the material is not dispersive.
    #[inline]
    pub fn sorted(material: &Material, rays: &[u32], states: &[PathState], seed: u64) -> Option<Self> {
        match &material.surface {
            Surface::Principled(surface) if surface.is_dispersive() => {
                let of = |channel| Surface::Principled(surface.of_channel(channel));
                Some(Self::of(of, rays, states, seed))
            }
            Surface::OpenPbr(surface) if surface.is_dispersive() => {
                Some(Self::of(|channel| Surface::OpenPbr(surface.of_channel(channel)), rays, states, seed))
            }
            _ => None,
        }
    }

    /// Out of line: few materials are dispersive.
    #[cold]
    fn of(surface: impl Fn(usize) -> Surface, rays: &[u32], states: &[PathState], seed: u64) -> Self {
        let channels = std::array::from_fn(|channel| OneChannel { channel, surface: surface(channel) });
        let mut sorted = Self { rays: Default::default(), channels };
        for &ray in rays {
            let state = &states[ray as usize];
            let u = Sampler::new(state.pixel(), state.sample(), seed).single(DIMENSION);
            sorted.rays[((u * CHANNELS as f32) as usize).min(CHANNELS - 1)].push(ray);
        }
        sorted
    }

    /// The rays of a channel, with the surface that they see.
    #[inline]
    pub fn part(&self, channel: usize) -> (&[u32], Option<&OneChannel>) {
        (&self.rays[channel], Some(&self.channels[channel]))
    }

    /// The number of parts.
    pub const PARTS: usize = CHANNELS;
}

impl OneChannel {
    /// `light`, and in the lanes of `takes` three times the channel and nothing else.
    #[inline(always)]
    pub fn of<L: Lanes>(&self, light: Vector<L>, takes: Mask<L>) -> Vector<L> {
        let mut weights = glam::Vec3::ZERO;
        weights[self.channel] = CHANNELS as f32;
        let one = light * Vector::splat(light.lanes(), weights);
        Vector::select(takes, one, light)
    }
}
