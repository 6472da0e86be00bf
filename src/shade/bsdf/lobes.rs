//! The lobes of a principled surface as seen from one direction.

use super::albedo::Reflectance;
use super::coat_stack::StackAlbedo;
use crate::lanes::{Lanes, Num, Vector};

/// The light that each lobe sends towards `wo` under a uniform environment of radiance 1, and the shares that
/// the layers pass.
pub struct Lobes<L: Lanes> {
    /// Reflectances of the facets towards `wo`, and of the coat's facets.
    pub near: Reflectance<L>,
    pub near_coat: Option<Reflectance<L>>,
    /// Share that the sheen reflects towards `wo`.
    pub near_sheen: Option<Num<L>>,
    /// Single-bounce reflection of the coat.
    pub coat: Num<L>,
    /// Share that passes the coat; `base` is the share that also passes the sheen.
    pub under: Num<L>,
    pub base: Num<L>,
    /// Single-bounce reflection of metal and dielectric.
    pub facets: Vector<L>,
    /// Light from the diffuse base, from the sheen and from all further bounces.
    pub scattered: Vector<L>,
    /// Share of `scattered`, in the mean of the channels, that comes from the other side. `None` if the base
    /// transmits nothing.
    pub translucent: Option<Num<L>>,
    /// Share that passes the dielectric layer towards `wo`.
    pub passed: Vector<L>,
    /// Albedo of the further coats.
    pub stack: Option<StackAlbedo<L>>,
}

/// Probabilities of sampling the lobes; `mirrors` is that of all specular ones together.
pub struct LobeProbabilities<L: Lanes> {
    pub coat: Num<L>,
    pub facets: Num<L>,
    pub scattered: Num<L>,
    pub frosted: Num<L>,
    pub stack: Num<L>,
    pub mirrors: Num<L>,
}
