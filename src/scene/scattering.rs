//! Surfaces that scatter light in a way of their own, by code that is not ours.

use super::Points;
use super::erased_lanes::{LaneColumns, from_columns, run_in, to_columns};
use crate::lanes::{LaneTask, Lanes, Num, Vector};
use std::fmt::Debug;
use std::sync::Arc;

/// A surface that is its own BSDF, used by every integrator: it evaluates and samples directions for 8 or 16 hits at a
/// time. Where metallic-roughness will do, a [`super::Procedural`] is less work.
///
/// Directions are unit vectors in the shading basis, away from the surface, its normal along z; `wo` goes where the
/// light goes and has `z > 0`, `wi` to where it comes from. For light to be the same whichever way it goes, the BSDF
/// (what `evaluate` gives, without the cosine) must not change when they trade places, and it must not return more
/// light than there is. Perfect mirrors have no place here.
///
/// Keep to the arithmetic of [`Num`], as [`super::Procedural`] says, and no machine gives other bits. Mark what handles
/// lanes `#[inline(always)]`. Its `Debug` text stands for it in [`super::Scene::fingerprint`], as a procedural's does.
///
/// ```
/// use raystream::geom::warp::lanes as warp;
/// use raystream::lanes::{Lanes, Num, Vector};
/// use raystream::scene::{Points, Scattered, Scattering, ScatteringSurface, Scene, Surface};
///
/// /// Dust on a moon (Lommel and Seeliger's law): seen from the sun's side it is as bright at the rim as in the
/// /// middle.
/// #[derive(Debug)]
/// struct Dust;
///
/// impl Scattering for Dust {
///     #[inline(always)]
///     fn evaluate<L: Lanes>(&self, _: &Points<L>, wo: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>) {
///         let cosine = wi.z.clamp(0.0, 1.0);
///         (Vector::grey(cosine * 0.05 / (wo.z + cosine)), warp::cosine_hemisphere_pdf(wi.z))
///     }
///
///     #[inline(always)]
///     fn sample<L: Lanes>(&self, at: &Points<L>, wo: Vector<L>, _: Num<L>, u2: [Num<L>; 2]) -> Scattered<L> {
///         let wi = warp::cosine_hemisphere(u2);
///         Scattered::evaluated(wi, self.evaluate(at, wo, wi))
///     }
/// }
///
/// let mut scene = Scene::default();
/// scene.scatterings.push(ScatteringSurface::new(Dust));
/// let surface = Surface::Scattering(0); // of any material
/// # let _ = surface;
/// ```
pub trait Scattering: Debug + Send + Sync + 'static {
    /// BSDF × |cosine of `wi`|, and the density per solid angle with which [`Scattering::sample`] gives `wi`. Where
    /// light cannot go both are 0, as below the surface unless it [lets light through](Scattering::transmits).
    fn evaluate<L: Lanes>(&self, at: &Points<L>, wo: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>);

    /// Samples directions about as the BSDF × cosine is distributed: `u` is for a choice among lobes, `u2` for the
    /// direction, both in
    /// [0, 1).
    fn sample<L: Lanes>(&self, at: &Points<L>, wo: Vector<L>, u: Num<L>, u2: [Num<L>; 2]) -> Scattered<L>;

    /// Whether light from below, `wi.z < 0`, comes through.
    fn transmits(&self) -> bool {
        false
    }
}

/// Sampled directions.
#[derive(Clone, Copy, Debug)]
pub struct Scattered<L: Lanes> {
    /// Where the light comes from.
    pub wi: Vector<L>,
    /// BSDF × |cosine| / density: what the radiance from `wi` counts.
    pub weight: Vector<L>,
    /// Density per solid angle of `wi`; lanes in which it is not above 0 have no sample.
    pub pdf: Num<L>,
}

impl<L: Lanes> Scattered<L> {
    /// Of directions and what [`Scattering::evaluate`] says of them.
    #[inline(always)]
    pub fn evaluated(wi: Vector<L>, (value, pdf): (Vector<L>, Num<L>)) -> Self {
        let there = pdf.above(0.0);
        Self { wi, weight: (value / pdf).only(there), pdf: pdf.only(there) }
    }
}

/// A [`Scattering`] of whatever type.
#[derive(Clone, Debug)]
pub struct ScatteringSurface(Arc<dyn ErasedLanes>);

impl ScatteringSurface {
    /// Hides the type.
    pub fn new(surface: impl Scattering) -> Self {
        Self(Arc::new(surface))
    }

    /// [`Scattering::evaluate`].
    #[inline(always)]
    pub fn evaluate<L: Lanes>(&self, at: &Points<L>, wo: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        let asked = [wo.x, wo.y, wo.z, wi.x, wi.y, wi.z];
        let answer = self.0.evaluate(L::LANES, &to_columns(at.columns()), &to_columns(asked));
        let [r, g, b, pdf] = from_columns(wo.lanes(), &answer);
        (Vector::new(r, g, b), pdf)
    }

    /// [`Scattering::sample`].
    #[inline(always)]
    pub fn sample<L: Lanes>(
        &self,
        at: &Points<L>,
        wo: Vector<L>,
        u: Num<L>,
        [x, y]: [Num<L>; 2],
    ) -> Scattered<L> {
        let asked = [wo.x, wo.y, wo.z, u, x, y];
        let answer = self.0.sample(L::LANES, &to_columns(at.columns()), &to_columns(asked));
        let [x, y, z, r, g, b, pdf] = from_columns(wo.lanes(), &answer);
        Scattered { wi: Vector::new(x, y, z), weight: Vector::new(r, g, b), pdf }
    }

    /// [`Scattering::transmits`].
    pub fn transmits(&self) -> bool {
        self.0.transmits()
    }
}

/// A [`Scattering`] on arrays.
trait ErasedLanes: Debug + Send + Sync {
    fn evaluate(&self, lanes: usize, at: &LaneColumns<8>, asked: &LaneColumns<6>) -> LaneColumns<4>;
    fn sample(&self, lanes: usize, at: &LaneColumns<8>, asked: &LaneColumns<6>) -> LaneColumns<7>;
    fn transmits(&self) -> bool;
}

impl<S: Scattering> ErasedLanes for S {
    fn evaluate(&self, lanes: usize, at: &LaneColumns<8>, asked: &LaneColumns<6>) -> LaneColumns<4> {
        run_in(lanes, Evaluation { surface: self, at, asked })
    }

    fn sample(&self, lanes: usize, at: &LaneColumns<8>, asked: &LaneColumns<6>) -> LaneColumns<7> {
        run_in(lanes, Sampling { surface: self, at, asked })
    }

    fn transmits(&self) -> bool {
        Scattering::transmits(self)
    }
}

struct Evaluation<'a, S> {
    surface: &'a S,
    at: &'a LaneColumns<8>,
    asked: &'a LaneColumns<6>,
}

impl<S: Scattering> LaneTask for Evaluation<'_, S> {
    type Output = LaneColumns<4>;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> LaneColumns<4> {
        let [x, y, z, to_x, to_y, to_z] = from_columns(l, self.asked);
        let (wo, wi) = (Vector::new(x, y, z), Vector::new(to_x, to_y, to_z));
        let (value, pdf) = self.surface.evaluate(&Points::of_columns(from_columns(l, self.at)), wo, wi);
        to_columns([value.x, value.y, value.z, pdf])
    }
}

struct Sampling<'a, S> {
    surface: &'a S,
    at: &'a LaneColumns<8>,
    asked: &'a LaneColumns<6>,
}

impl<S: Scattering> LaneTask for Sampling<'_, S> {
    type Output = LaneColumns<7>;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> LaneColumns<7> {
        let [x, y, z, u, first, second] = from_columns(l, self.asked);
        let at = Points::of_columns(from_columns(l, self.at));
        let Scattered { wi, weight, pdf } =
            self.surface.sample(&at, Vector::new(x, y, z), u, [first, second]);
        to_columns([wi.x, wi.y, wi.z, weight.x, weight.y, weight.z, pdf])
    }
}
