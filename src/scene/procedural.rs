//! Surfaces whose finish is computed at each hit by user code.

use super::erased_lanes::{LaneColumns, from_columns, run_in, to_columns};
use crate::lanes::{LaneTask, Lanes, Num, Vector};
use std::fmt::Debug;
use std::sync::Arc;

/// A surface whose finish is a function of position, normal and texture coordinates, like RA's wood (Figure 6). It is
/// computed for 8 or 16 hits at a time, and every integrator supports it. The result is the finish of a
/// metallic-roughness surface, so evaluation and sampling need no further code. A surface with a BSDF of its own
/// implements [`super::Scattering`] instead.
///
/// All arithmetic on [`Num`] gives the same bits with any instruction set, and so does a surface that uses nothing
/// else: no `f32` functions of the platform, no state. Mark functions over lanes `#[inline(always)]`, so that they
/// are compiled for each instruction set.
///
/// [`super::Scene::fingerprint`] hashes the surface's `Debug` text. The text must contain each parameter that changes
/// the picture, as derived implementations do.
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
    /// The finish of the surface at these points.
    fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L>;
}

/// Points on a surface, one in each lane.
#[derive(Clone, Copy, Debug)]
pub struct Points<L: Lanes> {
    /// Positions in world space.
    pub position: Vector<L>,
    /// Unit shading normals in world space.
    pub normal: Vector<L>,
    /// The mesh's texture coordinates.
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

/// The finish of a surface at points, one in each lane. Values out of range are clamped.
#[derive(Clone, Copy, Debug)]
pub struct Finish<L: Lanes> {
    /// Diffuse albedo of the dielectric share, reflectance of the metallic share, 0..=1, linear Rec. 709.
    pub colour: Vector<L>,
    /// Share of metal, 0..=1.
    pub metallic: Num<L>,
    /// Perceptual roughness, 0..=1.
    pub roughness: Num<L>,
    /// Strength of a smooth clear coat, 0..=1.
    pub clearcoat: Num<L>,
}

impl<L: Lanes> Finish<L> {
    /// A white dielectric of roughness 1 without a coat.
    #[inline(always)]
    pub fn matte(points: &Points<L>) -> Self {
        let l = points.position.lanes();
        let (zero, one) = (Num::zero(l), Num::splat(l, 1.0));
        Self { colour: Vector::grey(one), metallic: zero, roughness: one, clearcoat: zero }
    }
}

/// A shared [`Procedural`] with its type erased.
#[derive(Clone, Debug)]
pub struct ProceduralSurface(Arc<dyn ErasedLanes>);

impl ProceduralSurface {
    /// Erases the surface's type.
    pub fn new(surface: impl Procedural) -> Self {
        Self(Arc::new(surface))
    }

    /// Calls [`Procedural::finish`].
    #[inline(always)]
    pub fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
        let finish = self.0.finish(L::LANES, &to_columns(points.columns()));
        let [r, g, b, metallic, roughness, clearcoat] = from_columns(points.position.lanes(), &finish);
        Finish { colour: Vector::new(r, g, b), metallic, roughness, clearcoat }
    }
}

/// [`Procedural`] over arrays instead of lanes.
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
