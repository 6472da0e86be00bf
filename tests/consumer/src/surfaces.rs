//! Surfaces of the user's own: their code is compiled in the user's crate, with the user's profile.

use raystream::geom::warp::lanes as warp;
use raystream::lanes::{Lanes, Num, Vector};
use raystream::scene::{Finish, Points, Procedural, ProceduralSurface};
use raystream::scene::{Scattered, Scattering, ScatteringSurface, Scene, Surface};
use std::f32::consts::PI;

/// Stripes across the x axis.
#[derive(Debug)]
struct Stripes;

impl Procedural for Stripes {
    #[inline(always)]
    fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
        let x = points.position.x * 4.0;
        Finish { colour: Vector::grey((x - x.floor()).clamp(0.1, 0.9)), ..Finish::matte(points) }
    }
}

/// Dust in a thick layer (Lommel and Seeliger's law).
#[derive(Debug)]
struct Dust;

impl Scattering for Dust {
    #[inline(always)]
    fn evaluate<L: Lanes>(&self, _: &Points<L>, wo: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        let cosine = wi.z.clamp(0.0, 1.0);
        let value = cosine * (0.9 / (4.0 * PI)) / (wo.z + cosine);
        (Vector::grey(value), warp::cosine_hemisphere_pdf(wi.z))
    }

    #[inline(always)]
    fn sample<L: Lanes>(&self, at: &Points<L>, wo: Vector<L>, _: Num<L>, u2: [Num<L>; 2]) -> Scattered<L> {
        let wi = warp::cosine_hemisphere(u2);
        Scattered::evaluated(wi, self.evaluate(at, wo, wi))
    }
}

/// Gives the materials `striped` and `dusty` their surfaces.
pub fn dress(scene: &mut Scene) {
    scene.procedurals.push(ProceduralSurface::new(Stripes));
    scene.scatterings.push(ScatteringSurface::new(Dust));
    for material in &mut scene.materials {
        match material.name.as_str() {
            "striped" => material.surface = Surface::Procedural(0),
            "dusty" => material.surface = Surface::Scattering(0),
            _ => {}
        }
    }
}
