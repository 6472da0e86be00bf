//! Surfaces that are computed where they are hit, by code that is not ours.

use crate::lanes::{Kernel, Lanes, Num, SimdLevel, Vector};
use std::fmt::Debug;
use std::sync::Arc;

/// A surface whose look is a function of the place, like RA's wood (Figure 6). It is computed for 8 or 16 hits at
/// a time and used by every integrator: what comes out is the finish of a metallic-roughness surface, whose
/// evaluation and sampling are there already.
///
/// All arithmetic on [`Num`] gives the same bits with any instruction set, and so does a surface that is
/// written in it: keep to it (no `f32` functions of the platform, no state). Mark what handles lanes
/// `#[inline(always)]`, so that it is compiled for each instruction set.
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
        let one = Num::splat(points.position.lanes(), 1.0);
        Self { colour: Vector::grey(one), metallic: one.only(0), roughness: one, clearcoat: one.only(0) }
    }
}

/// A [`Procedural`] of whatever type.
#[derive(Clone, Debug)]
pub struct ProceduralSurface(Arc<dyn Columns>);

impl ProceduralSurface {
    /// Hides the type.
    pub fn new(surface: impl Procedural) -> Self {
        Self(Arc::new(surface))
    }

    /// [`Procedural::finish`].
    #[inline(always)]
    pub fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
        let l = points.position.lanes();
        // Behind a pointer there are no generics: the lanes travel as arrays, which is cheap beside a
        // surface that is worth computing.
        let Points { position: p, normal: n, uv: [u, v] } = *points;
        let columns = [p.x, p.y, p.z, n.x, n.y, n.z, u, v];
        let mut points = [[0.0; 16]; 8];
        for (array, column) in points.iter_mut().zip(columns) {
            array[..L::LANES].copy_from_slice(column.to_array().as_ref());
        }
        let [r, g, b, metallic, roughness, clearcoat] = self.0.finish(L::LANES, &points);
        Finish {
            colour: Vector::new(Num::load(l, &r), Num::load(l, &g), Num::load(l, &b)),
            metallic: Num::load(l, &metallic),
            roughness: Num::load(l, &roughness),
            clearcoat: Num::load(l, &clearcoat),
        }
    }
}

/// A [`Procedural`] on arrays.
trait Columns: Debug + Send + Sync {
    fn finish(&self, lanes: usize, points: &[[f32; 16]; 8]) -> [[f32; 16]; 6];
}

impl<P: Procedural> Columns for P {
    fn finish(&self, lanes: usize, points: &[[f32; 16]; 8]) -> [[f32; 16]; 6] {
        let computation = Computation { surface: self, points };
        match lanes {
            1 => SimdLevel::run_one(computation),
            _ => SimdLevel::of_lanes(lanes).run(computation),
        }
    }
}

struct Computation<'a, P> {
    surface: &'a P,
    points: &'a [[f32; 16]; 8],
}

impl<P: Procedural> Kernel for Computation<'_, P> {
    type Output = [[f32; 16]; 6];

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> [[f32; 16]; 6] {
        let mut columns = [Num::splat(l, 0.0); 8];
        for (column, array) in columns.iter_mut().zip(self.points) {
            *column = Num::load(l, array);
        }
        let [x, y, z, nx, ny, nz, u, v] = columns;
        let (position, normal) = (Vector::new(x, y, z), Vector::new(nx, ny, nz));
        let Finish { colour, metallic, roughness, clearcoat } =
            self.surface.finish(&Points { position, normal, uv: [u, v] });
        let columns = [colour.x, colour.y, colour.z, metallic, roughness, clearcoat];
        let mut finish = [[0.0; 16]; 6];
        for (array, column) in finish.iter_mut().zip(columns) {
            array[..L::LANES].copy_from_slice(column.to_array().as_ref());
        }
        finish
    }
}
