//! Media inside closed bodies.

use glam::Vec3;
use serde::{Deserialize, Serialize};

/// The greatest extinction of a medium that is made from distances and colours.
const MOST_EXTINCTION: f32 = 1e30;

/// A homogeneous medium. After a distance `t` the share exp(−(`absorption` + `scattering`) · t) of the light has not
/// met it (Beer and Lambert). Of the rest it absorbs some and scatters the others, by the phase function of Henyey and
/// Greenstein.
///
/// A body's medium belongs to the material of its surface. A ray that meets the surface from inside has travelled
/// through that medium. If bodies overlap or contain each other, the surface at the ray's end determines the medium.
/// Light that travels inwards from a glass to a body inside it is therefore neither absorbed nor scattered. The path
/// tracer alone scatters light in media; for other renderers they only absorb.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Medium {
    /// Absorption coefficient per unit of distance for each channel, ≥ 0.
    pub absorption: Vec3,
    /// Scattering coefficient per unit of distance for each channel, ≥ 0.
    pub scattering: Vec3,
    /// Mean cosine of the angle by which light is deflected when it is scattered, −1 to 1: 0 scatters into all
    /// directions alike, more scatters forwards.
    pub anisotropy: f32,
}

impl Medium {
    /// The medium in which white light becomes `colour` after `distance`, and which scatters none: `attenuationColor`
    /// and `attenuationDistance` of KHR_materials_volume. `None` if nothing is absorbed.
    pub fn tinting(colour: Vec3, distance: f32) -> Option<Self> {
        let absorption = extinction(colour, distance);
        (absorption.max_element() > 0.0).then_some(Self { absorption, ..Self::default() })
    }

    /// The medium of OpenPBR's translucent base: white light that meets no particle becomes `colour` after `distance`,
    /// and `scatter` is the scattering coefficient times the distance. Where light would be scattered more than it is
    /// weakened, the same absorption is added to all channels until none is below 0.
    pub fn translucent(colour: Vec3, distance: f32, scatter: Vec3, anisotropy: f32) -> Option<Self> {
        let scattering = (scatter / distance).min(Vec3::splat(MOST_EXTINCTION));
        let absorption = extinction(colour, distance) - scattering;
        let absorption = absorption - absorption.min_element().min(0.0);
        ((absorption + scattering).max_element() > 0.0).then_some(Self { absorption, scattering, anisotropy })
    }

    /// The medium of mean free paths `radius` whose half-space reflects the shares `colour` of even light that enters
    /// it by diffusion: OpenPBR's `subsurface_color` and radius. The albedo of a single scattering follows from
    /// van de Hulst's approximation (Kulla and Conty 2017, *Revisiting Physically Based Shading at Imageworks*).
    pub fn reflecting(colour: Vec3, radius: Vec3, anisotropy: f32) -> Self {
        let extinction = radius.map(|radius| (1.0 / radius).min(MOST_EXTINCTION));
        Self::of_extinction(extinction, colour, anisotropy)
    }

    /// The medium of an extinction whose half-space reflects the shares `colour`: see [`Medium::reflecting`].
    pub fn of_extinction(extinction: Vec3, colour: Vec3, anisotropy: f32) -> Self {
        let albedo = colour.map(|colour| single_albedo(colour, anisotropy));
        let scattering = extinction * albedo;
        Self { absorption: extinction - scattering, scattering, anisotropy }
    }

    /// The mean of two media, where `other` has the share `share`. A medium that is missing is empty space.
    pub fn mean(one: Option<Self>, other: Option<Self>, share: f32) -> Option<Self> {
        let shares = [(one, 1.0 - share), (other, share)];
        let media = || shares.into_iter().filter_map(|(medium, share)| Some((medium?, share)));
        let sum = |of: fn(&Self) -> Vec3| media().map(|(medium, share)| of(&medium) * share).sum::<Vec3>();
        let (absorption, scattering) = (sum(|medium| medium.absorption), sum(|medium| medium.scattering));
        // Each scattering has the mean cosine of its own medium.
        let scattered = |medium: &Self, share: f32| medium.scattering.element_sum() * share;
        let all: f32 = media().map(|(medium, share)| scattered(&medium, share)).sum();
        let turned: f32 = media().map(|(medium, share)| medium.anisotropy * scattered(&medium, share)).sum();
        let anisotropy = if all > 0.0 { turned / all } else { 0.0 };
        ((absorption + scattering).max_element() > 0.0).then_some(Self { absorption, scattering, anisotropy })
    }

    /// True if it scatters light.
    #[inline]
    pub fn scatters(&self) -> bool {
        self.scattering.max_element() > 0.0
    }
}

/// The extinction at which the share `colour` of light remains after `distance`.
fn extinction(colour: Vec3, distance: f32) -> Vec3 {
    // It is limited to a factor of e³⁰.
    colour.map(|c| -libm::logf(c.clamp(1e-13, 1.0)) / distance).min(Vec3::splat(MOST_EXTINCTION))
}

/// The share of light that a single scattering leaves, in a medium whose half-space reflects the share `colour`.
fn single_albedo(colour: f32, anisotropy: f32) -> f32 {
    // The root of (1 − s) (1 − 0.139 s) = colour (1 + 1.17 s).
    let half = (1.139 + 1.17 * colour) / 0.278;
    let s = half - libm::sqrtf(half * half - (1.0 - colour) / 0.139);
    let s2 = (s * s).clamp(0.0, 1.0);
    (1.0 - s2) / (1.0 - anisotropy * s2).max(1e-6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn albedos_are_those_that_van_de_hulst_inverts() {
        for anisotropy in [-0.7f32, 0.0, 0.5, 0.9] {
            for colour in [0.0, 0.1, 0.37, 0.8, 0.99, 1.0f32] {
                let albedo = f64::from(single_albedo(colour, anisotropy));
                let s = ((1.0 - albedo) / (1.0 - albedo * f64::from(anisotropy))).max(0.0).sqrt();
                let found = (1.0 - s) * (1.0 - 0.139 * s) / (1.0 + 1.17 * s);
                assert!((found - f64::from(colour)).abs() < 2e-3, "{colour} became {found}");
            }
        }
        assert_eq!((single_albedo(1.0, 0.0), single_albedo(1.0, 0.5)), (1.0, 1.0), "nothing is lost");
    }

    #[test]
    fn a_translucent_medium_keeps_what_it_scatters() {
        let absorbing = Medium::tinting(Vec3::new(0.5, 0.25, 1.0), 2.0);
        assert_eq!(Medium::translucent(Vec3::new(0.5, 0.25, 1.0), 2.0, Vec3::ZERO, 0.0), absorbing);
        let milk = Medium::translucent(Vec3::new(0.5, 1.0, 1.0), 2.0, Vec3::new(0.0, 2.0, 1.0), 0.3);
        let milk = milk.expect("a medium");
        // Green would absorb −1, so all channels absorb 1 more.
        assert_eq!(milk.scattering, Vec3::new(0.0, 1.0, 0.5));
        let red = 0.5 * std::f32::consts::LN_2;
        assert!((milk.absorption - Vec3::new(red + 1.0, 0.0, 0.5)).abs().max_element() < 1e-6, "{milk:?}");
        assert_eq!(Medium::translucent(Vec3::ONE, 2.0, Vec3::ZERO, 0.3), None);
    }

    #[test]
    fn means_are_weighted_by_what_is_scattered() {
        let one = Medium { absorption: Vec3::ONE, scattering: Vec3::splat(3.0), anisotropy: 0.8 };
        let other = Medium { absorption: Vec3::ZERO, scattering: Vec3::ONE, anisotropy: 0.0 };
        let mean = Medium::mean(Some(one), Some(other), 0.5).expect("a medium");
        assert_eq!((mean.absorption, mean.scattering), (Vec3::splat(0.5), Vec3::splat(2.0)));
        assert!((mean.anisotropy - 0.6).abs() < 1e-6);
        assert_eq!(Medium::mean(None, None, 0.3), None);
        assert_eq!(Medium::mean(Some(one), None, 0.0), Some(one));
    }
}
