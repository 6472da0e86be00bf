//! Surfaces that are computed where they are hit, by code that is not ours.

use super::erased_lanes::{LaneColumns, from_columns, run_in, to_columns};
use crate::lanes::{LaneTask, Lanes, Num, Vector};
use std::fmt::Debug;
use std::sync::Arc;

/// A surface whose look is a function of the place, like RA's wood (Figure 6). It is computed for 8 or 16 hits at
/// a time and used by every integrator: what comes out is the finish of a metallic-roughness surface, whose
/// evaluation and sampling are there already. One that scatters light in a way of its own is a [`super::Scattering`].
///
/// All arithmetic on [`Num`] gives the same bits with any instruction set, and so does a surface that is
/// written in it: keep to it (no `f32` functions of the platform, no state). Mark what handles lanes
/// `#[inline(always)]`, so that it is compiled for each instruction set.
///
/// Its `Debug` text stands for it in [`super::Scene::fingerprint`]: print each parameter that changes the picture, as
/// derived implementations do.
///
/// ```
/// use raystream::lanes::{Lanes, Num, Vector};
/// use raystream::scene::{Finish, Points, Procedural, ProceduralSurface, Scene, Surface};
///
/// /// Grey, darker below.
/// #[derive(Debug)]
/// struct Sediment;
///
/// impl Procedural for Sediment {
///     #[inline(always)]
///     fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
///         let grey = (points.position.y * 0.5).clamp(0.1, 0.8);
///         Finish { colour: Vector::grey(grey), ..Finish::matte(points) }
///     }
/// }
///
/// let mut scene = Scene::default();
/// scene.procedurals.push(ProceduralSurface::new(Sediment));
/// let surface = Surface::Procedural(0); // of any material
/// # let _ = surface;
/// ```
pub trait Procedural: Debug + Send + Sync + 'static {
    /// How the surface looks at these points.
    fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L>;
}

/// Points on a surface.
#[derive(Clone, Copy, Debug)]
pub struct Points<L: Lanes> {
    /// Where they are in the world.
    pub position: Vector<L>,
    /// Unit shading normals.
    pub normal: Vector<L>,
    /// Mesh texture coordinates.
    pub uv: [Num<L>; 2],
}

impl<L: Lanes> Points<L> {
    #[inline(always)]
    pub(super) fn columns(&self) -> [Num<L>; 8] {
        let Self { position: p, normal: n, uv: [u, v] } = *self;
        [p.x, p.y, p.z, n.x, n.y, n.z, u, v]
    }

    #[inline(always)]
    pub(super) fn of_columns([x, y, z, nx, ny, nz, u, v]: [Num<L>; 8]) -> Self {
        Self { position: Vector::new(x, y, z), normal: Vector::new(nx, ny, nz), uv: [u, v] }
    }
}

/// How a surface looks at points; what is out of range is clamped.
#[derive(Clone, Copy, Debug)]
pub struct Finish<L: Lanes> {
    /// Diffuse albedo of the dielectric share, reflectance of the metallic one, 0..=1.
    pub colour: Vector<L>,
    /// Share of metal, 0..=1.
    pub metallic: Num<L>,
    /// Perceptual roughness, 0..=1.
    pub roughness: Num<L>,
    /// Strength of a smooth clear coat, 0..=1.
    pub clearcoat: Num<L>,
}

impl<L: Lanes> Finish<L> {
    /// A rough white dielectric without a coat.
    #[inline(always)]
    pub fn matte(points: &Points<L>) -> Self {
        let l = points.position.lanes();
        let (zero, one) = (Num::zero(l), Num::splat(l, 1.0));
        Self { colour: Vector::grey(one), metallic: zero, roughness: one, clearcoat: zero }
    }
}

/// A [`Procedural`] of whatever type.
#[derive(Clone, Debug)]
pub struct ProceduralSurface(Arc<dyn ErasedLanes>);

impl ProceduralSurface {
    /// Hides the type.
    pub fn new(surface: impl Procedural) -> Self {
        Self(Arc::new(surface))
    }

    /// [`Procedural::finish`].
    #[inline(always)]
    pub fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
        let finish = self.0.finish(L::LANES, &to_columns(points.columns()));
        let [r, g, b, metallic, roughness, clearcoat] = from_columns(points.position.lanes(), &finish);
        Finish { colour: Vector::new(r, g, b), metallic, roughness, clearcoat }
    }
}

/// A [`Procedural`] on arrays.
trait ErasedLanes: Debug + Send + Sync {
    fn finish(&self, lanes: usize, points: &LaneColumns<8>) -> LaneColumns<6>;
}

impl<P: Procedural> ErasedLanes for P {
    fn finish(&self, lanes: usize, points: &LaneColumns<8>) -> LaneColumns<6> {
        run_in(lanes, Computation { surface: self, points })
    }
}

struct Computation<'a, P> {
    surface: &'a P,
    points: &'a LaneColumns<8>,
}

impl<P: Procedural> LaneTask for Computation<'_, P> {
    type Output = LaneColumns<6>;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> LaneColumns<6> {
        let points = Points::of_columns(from_columns(l, self.points));
        let Finish { colour, metallic, roughness, clearcoat } = self.surface.finish(&points);
        to_columns([colour.x, colour.y, colour.z, metallic, roughness, clearcoat])
    }
}
