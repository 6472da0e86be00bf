//! Surfaces whose finish is computed at each hit by user code.

use super::erased_lanes::run_in;
use super::finish::FinishColumns;
use super::points::PointColumns;
use super::{AttributeRequest, BlockSurface, BoundTexture, Effects, Finish, OwnSurface, Points, Scene};
use crate::lanes::{LaneTask, Lanes, OutlinedTask};
use std::fmt::{self, Debug, Formatter};
use std::sync::Arc;

/// A surface whose finish is a function of position, normal and texture coordinates, like RA's wood (Figure 6). It is
/// computed for 8 or 16 hits at a time, and every integrator supports it. The result is the finish of a
/// metallic-roughness surface, so evaluation and sampling need no further code. A surface with a BSDF of its own
/// implements [`super::Scattering`] instead.
///
/// All arithmetic on [`Num`](crate::lanes::Num) gives the same bits with any instruction set, and so does a surface
/// that uses nothing else: no `f32` functions of the platform, no state. Mark functions over lanes
/// `#[inline(always)]`, so that they are compiled for each instruction set.
///
/// A surface may also emit light, let rays pass, bend its normals or transmit light. It declares this in
/// [`Procedural::effects`]:
///
/// - *Emission* is found by rays that hit the surface, not by light sampling. It suits large and dim surfaces. A small
///   bright lamp of constant radiance has less noise as [`super::Emission`].
/// - *Opacity* acts at the hit: a random number decides whether the ray continues as if nothing had been hit. Passing
///   is no bounce. Shadow rays pass by the same choice.
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

    /// Effects that [`Procedural::finish`] computes of emission, opacity, normals and transmission. By default nothing.
    fn effects(&self) -> Effects {
        Effects::default()
    }

    /// True if the surface starts from that of the material itself: see [`Points::base`].
    fn starts_from_material(&self) -> bool {
        false
    }

    /// True if the surface asks for the moment that a picture shows ([`Points::time`], [`Points::frame`]). Frames of an
    /// animation then have scenes of their own; without it they may all show the same moment.
    fn reads_moment(&self) -> bool {
        false
    }

    /// Textures that the surface has itself, beside the scene's: their memory counts as the scene's.
    fn textures(&self) -> &[BoundTexture] {
        &[]
    }

    /// Vertex attributes that the surface reads. A scene whose mesh lacks one is refused.
    fn attributes(&self) -> &[AttributeRequest] {
        &[]
    }

    /// The surface as it is on a material of this surface, if that may cost less or have other effects.
    ///
    /// # Errors
    /// When it cannot be on such a material.
    fn over(&self, _own: &OwnSurface) -> Result<Option<ProceduralSurface>, String> {
        Ok(None)
    }

    /// The surface as one that is computed for blocks of many hits, if that costs less. Its finishes must have the same
    /// bits.
    fn in_blocks(&self) -> Option<&dyn BlockSurface> {
        None
    }
}

/// A shared [`Procedural`] with its type erased.
#[derive(Clone)]
pub struct ProceduralSurface {
    surface: Arc<dyn ErasedLanes>,
    effects: Effects,
    /// The material's own surface, if this one starts from it.
    own: Option<Arc<OwnSurface>>,
}

impl Debug for ProceduralSurface {
    // The fingerprint of a scene contains this text.
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let mut text = f.debug_tuple("ProceduralSurface");
        text.field(&self.surface);
        self.own.iter().for_each(|own| {
            text.field(own);
        });
        text.finish()
    }
}

impl ProceduralSurface {
    /// Erases the surface's type.
    pub fn new(surface: impl Procedural) -> Self {
        Self { effects: surface.effects(), surface: Arc::new(surface), own: None }
    }

    /// Calls [`Procedural::starts_from_material`].
    pub fn starts_from_material(&self) -> bool {
        self.surface.starts_from_material()
    }

    /// Calls [`Procedural::reads_moment`].
    pub fn reads_moment(&self) -> bool {
        self.surface.reads_moment()
    }

    /// Calls [`Procedural::textures`].
    pub fn textures(&self) -> &[BoundTexture] {
        self.surface.textures()
    }

    /// Calls [`Procedural::attributes`].
    pub fn attributes(&self) -> &[AttributeRequest] {
        self.surface.attributes()
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

    /// Effects that [`Procedural::effects`] returned.
    #[inline]
    pub fn effects(&self) -> &Effects {
        &self.effects
    }

    /// Calls [`Procedural::in_blocks`].
    pub fn in_blocks(&self) -> Option<&dyn BlockSurface> {
        self.surface.in_blocks()
    }

    /// Calls [`Procedural::finish`].
    ///
    /// # Panics
    /// If the surface computes what its [`Effects`] do not declare.
    #[inline(always)]
    pub fn finish<L: Lanes>(&self, points: &Points<'_, L>) -> Finish<L> {
        points.lanes().outlined(FinishTask { surface: self, points })
    }
}

/// [`ProceduralSurface::finish`] out of line: it copies all columns of points and finishes.
struct FinishTask<'a, 's, L: Lanes> {
    surface: &'a ProceduralSurface,
    points: &'a Points<'s, L>,
}

impl<L: Lanes> OutlinedTask<L> for FinishTask<'_, '_, L> {
    type Output = Finish<L>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, l: L) -> Finish<L> {
        let Self { surface, points } = self;
        let finish = surface.surface.finish(L::LANES, (points.scene, surface.own()), &points.columns());
        Finish::of_columns(l, &finish)
    }
}

/// The scene, and the material's own surface if the procedural one starts from it.
type Surroundings<'a> = (&'a Scene, Option<&'a OwnSurface>);

/// [`Procedural`] over arrays instead of lanes.
trait ErasedLanes: Debug + Send + Sync {
    fn finish(&self, lanes: usize, scene: Surroundings<'_>, points: &PointColumns) -> FinishColumns;
    fn starts_from_material(&self) -> bool;
    fn reads_moment(&self) -> bool;
    fn textures(&self) -> &[BoundTexture];
    fn attributes(&self) -> &[AttributeRequest];
    fn over(&self, own: &OwnSurface) -> Result<Option<ProceduralSurface>, String>;
    fn in_blocks(&self) -> Option<&dyn BlockSurface>;
}

impl<P: Procedural> ErasedLanes for P {
    fn finish(&self, lanes: usize, scene: Surroundings<'_>, points: &PointColumns) -> FinishColumns {
        run_in(lanes, Computation { surface: self, scene, points })
    }

    fn starts_from_material(&self) -> bool {
        Procedural::starts_from_material(self)
    }

    fn reads_moment(&self) -> bool {
        Procedural::reads_moment(self)
    }

    fn textures(&self) -> &[BoundTexture] {
        Procedural::textures(self)
    }

    fn attributes(&self) -> &[AttributeRequest] {
        Procedural::attributes(self)
    }

    fn over(&self, own: &OwnSurface) -> Result<Option<ProceduralSurface>, String> {
        Procedural::over(self, own)
    }

    fn in_blocks(&self) -> Option<&dyn BlockSurface> {
        Procedural::in_blocks(self)
    }
}

struct Computation<'a, P> {
    surface: &'a P,
    scene: Surroundings<'a>,
    points: &'a PointColumns,
}

impl<P: Procedural> LaneTask for Computation<'_, P> {
    type Output = FinishColumns;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> FinishColumns {
        let points = Points::of_columns(l, self.scene, self.points);
        let finish = self.surface.finish(&points);
        if let Some(what) = finish.undeclared(&points, &self.surface.effects()) {
            refuse(self.surface, what);
        }
        finish.columns()
    }
}

#[cold]
fn refuse(surface: &dyn Debug, what: &str) -> ! {
    panic!("{surface:?} computes {what}, which its Procedural::effects does not declare");
}
