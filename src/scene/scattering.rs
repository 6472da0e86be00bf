//! Surfaces whose BSDF is user code.

use super::erased_lanes::{LaneColumns, from_columns, run_in, to_columns};
use super::points::PointColumns;
use super::{AttributeRequest, BoundTexture, OwnSurface, Points, Scene};
use crate::lanes::{LaneTask, Lanes, Num, Vector};
use std::fmt::{self, Debug, Formatter};
use std::sync::Arc;

/// A surface that is its own BSDF. It evaluates and samples directions for 8 or 16 hits at a time, and every
/// integrator supports it. If a metallic-roughness surface suffices, a [`super::Procedural`] is less work.
///
/// Directions are unit vectors in the shading basis and point away from the surface. The normal is the z axis. `wo`
/// is the direction that light leaves in and has `z > 0`; `wi` is the direction that light comes from. The BSDF,
/// which is what `evaluate` returns without the cosine, must be symmetric in the two directions, and it must not
/// return more light than arrives. Perfect mirrors cannot be expressed.
///
/// Textures of the scene are read by [`Points::texture`].
///
/// Use only the arithmetic of [`Num`], as [`super::Procedural`] says, so that all machines give the same bits. Mark
/// functions over lanes `#[inline(always)]`. [`super::Scene::fingerprint`] hashes the surface's `Debug` text, as a
/// procedural's.
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
    /// BSDF × |cosine of `wi`|, and the density per solid angle with which [`Scattering::sample`] chooses `wi`. Both
    /// are 0 where no light is scattered. This includes directions below the surface, unless the surface
    /// [transmits](Scattering::transmits) light.
    fn evaluate<L: Lanes>(&self, at: &Points<L>, wo: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>);

    /// Samples directions with a density roughly proportional to BSDF × |cosine|. `u` chooses among lobes and `u2`
    /// the direction; all are in [0, 1).
    fn sample<L: Lanes>(&self, at: &Points<L>, wo: Vector<L>, u: Num<L>, u2: [Num<L>; 2]) -> Scattered<L>;

    /// True if the surface transmits light from below, from directions with `wi.z < 0`.
    fn transmits(&self) -> bool {
        false
    }

    /// True if the surface starts from that of the material itself: see [`Points::base`].
    fn starts_from_material(&self) -> bool {
        false
    }

    /// The surface as it is on a material of this surface, if that is another.
    ///
    /// # Errors
    /// When it cannot be on such a material.
    fn over(&self, _own: &OwnSurface) -> Result<Option<ScatteringSurface>, String> {
        Ok(None)
    }

    /// Textures that the surface has itself, beside the scene's: their memory counts as the scene's.
    fn textures(&self) -> &[BoundTexture] {
        &[]
    }

    /// Vertex attributes that the surface reads: see [`super::Procedural::attributes`].
    fn attributes(&self) -> &[AttributeRequest] {
        &[]
    }

    /// True if the surface asks for the moment that a picture shows: see [`super::Procedural::reads_moment`].
    fn reads_moment(&self) -> bool {
        false
    }
}

/// Sampled directions, one in each lane.
#[derive(Clone, Copy, Debug)]
pub struct Scattered<L: Lanes> {
    /// Unit directions that light comes from, in the shading basis.
    pub wi: Vector<L>,
    /// BSDF × |cosine| / density: the factor of the radiance from `wi`.
    pub weight: Vector<L>,
    /// Density per solid angle of `wi`. Lanes in which it is not above 0 have no sample.
    pub pdf: Num<L>,
}

impl<L: Lanes> Scattered<L> {
    /// Makes samples from directions and what [`Scattering::evaluate`] returned for them.
    #[inline(always)]
    pub fn evaluated(wi: Vector<L>, (value, pdf): (Vector<L>, Num<L>)) -> Self {
        let has_sample = pdf.above(0.0);
        Self { wi, weight: (value / pdf).only(has_sample), pdf: pdf.only(has_sample) }
    }
}

/// A shared [`Scattering`] with its type erased.
#[derive(Clone)]
pub struct ScatteringSurface {
    surface: Arc<dyn ErasedLanes>,
    /// The material's own surface, if this one starts from it.
    own: Option<Arc<OwnSurface>>,
}

impl Debug for ScatteringSurface {
    // The fingerprint of a scene contains this text.
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let mut text = f.debug_tuple("ScatteringSurface");
        text.field(&self.surface);
        self.own.iter().for_each(|own| {
            text.field(own);
        });
        text.finish()
    }
}

impl ScatteringSurface {
    /// Erases the surface's type.
    pub fn new(surface: impl Scattering) -> Self {
        Self { surface: Arc::new(surface), own: None }
    }

    /// Calls [`Scattering::starts_from_material`].
    pub fn starts_from_material(&self) -> bool {
        self.surface.starts_from_material()
    }

    /// The surface on a material of this surface.
    ///
    /// # Errors
    /// When it cannot be on such a material.
    pub fn over(&self, own: OwnSurface) -> Result<Self, String> {
        let over = self.surface.over(&own)?.unwrap_or_else(|| self.clone());
        Ok(Self { own: Some(Arc::new(own)), ..over })
    }

    /// The surface that the material has itself, if this one starts from it.
    #[inline]
    pub fn own(&self) -> Option<&OwnSurface> {
        self.own.as_deref()
    }

    /// Points of a scene, as the surface is given them.
    #[inline(always)]
    fn points<'a>(&'a self, scene: &'a Scene, columns: &'a PointColumns) -> PointsOf<'a> {
        PointsOf { scene, own: self.own(), columns }
    }

    /// Calls [`Scattering::evaluate`].
    #[inline(always)]
    pub fn evaluate<L: Lanes>(
        &self,
        at: &Points<'_, L>,
        wo: Vector<L>,
        wi: Vector<L>,
    ) -> (Vector<L>, Num<L>) {
        let arguments = [wo.x, wo.y, wo.z, wi.x, wi.y, wi.z];
        let columns = at.columns();
        let points = self.points(at.scene, &columns);
        let result = self.surface.evaluate(L::LANES, points, &to_columns(arguments));
        let [r, g, b, pdf] = from_columns(wo.lanes(), &result);
        (Vector::new(r, g, b), pdf)
    }

    /// Calls [`Scattering::sample`].
    #[inline(always)]
    pub fn sample<L: Lanes>(
        &self,
        at: &Points<'_, L>,
        wo: Vector<L>,
        u: Num<L>,
        [x, y]: [Num<L>; 2],
    ) -> Scattered<L> {
        let arguments = [wo.x, wo.y, wo.z, u, x, y];
        let columns = at.columns();
        let points = self.points(at.scene, &columns);
        let result = self.surface.sample(L::LANES, points, &to_columns(arguments));
        let [x, y, z, r, g, b, pdf] = from_columns(wo.lanes(), &result);
        Scattered { wi: Vector::new(x, y, z), weight: Vector::new(r, g, b), pdf }
    }

    /// Calls [`Scattering::transmits`].
    #[inline]
    pub fn transmits(&self) -> bool {
        self.surface.transmits()
    }

    /// Calls [`Scattering::textures`].
    pub fn textures(&self) -> &[BoundTexture] {
        self.surface.textures()
    }

    /// Calls [`Scattering::attributes`].
    pub fn attributes(&self) -> &[AttributeRequest] {
        self.surface.attributes()
    }

    /// Calls [`Scattering::reads_moment`].
    pub fn reads_moment(&self) -> bool {
        self.surface.reads_moment()
    }
}

/// [`Scattering`] over arrays instead of lanes.
trait ErasedLanes: Debug + Send + Sync {
    fn evaluate(&self, lanes: usize, at: PointsOf<'_>, arguments: &LaneColumns<6>) -> LaneColumns<4>;
    fn sample(&self, lanes: usize, at: PointsOf<'_>, arguments: &LaneColumns<6>) -> LaneColumns<7>;
    fn transmits(&self) -> bool;
    fn starts_from_material(&self) -> bool;
    fn over(&self, own: &OwnSurface) -> Result<Option<ScatteringSurface>, String>;
    fn reads_moment(&self) -> bool;
    fn textures(&self) -> &[BoundTexture];
    fn attributes(&self) -> &[AttributeRequest];
}

/// Points of a scene.
#[derive(Clone, Copy)]
struct PointsOf<'a> {
    scene: &'a Scene,
    own: Option<&'a OwnSurface>,
    columns: &'a PointColumns,
}

impl<'a> PointsOf<'a> {
    #[inline(always)]
    fn points<L: Lanes>(&self, l: L) -> Points<'a, L> {
        Points::of_columns(l, (self.scene, self.own), self.columns)
    }
}

impl<S: Scattering> ErasedLanes for S {
    fn evaluate(&self, lanes: usize, at: PointsOf<'_>, arguments: &LaneColumns<6>) -> LaneColumns<4> {
        run_in(lanes, Evaluation { surface: self, at, arguments })
    }

    fn sample(&self, lanes: usize, at: PointsOf<'_>, arguments: &LaneColumns<6>) -> LaneColumns<7> {
        run_in(lanes, Sampling { surface: self, at, arguments })
    }

    fn transmits(&self) -> bool {
        Scattering::transmits(self)
    }

    fn starts_from_material(&self) -> bool {
        Scattering::starts_from_material(self)
    }

    fn over(&self, own: &OwnSurface) -> Result<Option<ScatteringSurface>, String> {
        Scattering::over(self, own)
    }

    fn reads_moment(&self) -> bool {
        Scattering::reads_moment(self)
    }

    fn textures(&self) -> &[BoundTexture] {
        Scattering::textures(self)
    }

    fn attributes(&self) -> &[AttributeRequest] {
        Scattering::attributes(self)
    }
}

struct Evaluation<'a, S> {
    surface: &'a S,
    at: PointsOf<'a>,
    arguments: &'a LaneColumns<6>,
}

impl<S: Scattering> LaneTask for Evaluation<'_, S> {
    type Output = LaneColumns<4>;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> LaneColumns<4> {
        let [x, y, z, to_x, to_y, to_z] = from_columns(l, self.arguments);
        let (wo, wi) = (Vector::new(x, y, z), Vector::new(to_x, to_y, to_z));
        let (value, pdf) = self.surface.evaluate(&self.at.points(l), wo, wi);
        to_columns([value.x, value.y, value.z, pdf])
    }
}

struct Sampling<'a, S> {
    surface: &'a S,
    at: PointsOf<'a>,
    arguments: &'a LaneColumns<6>,
}

impl<S: Scattering> LaneTask for Sampling<'_, S> {
    type Output = LaneColumns<7>;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> LaneColumns<7> {
        let [x, y, z, u, first, second] = from_columns(l, self.arguments);
        let wo = Vector::new(x, y, z);
        let Scattered { wi, weight, pdf } = self.surface.sample(&self.at.points(l), wo, u, [first, second]);
        to_columns([wi.x, wi.y, wi.z, weight.x, weight.y, weight.z, pdf])
    }
}
