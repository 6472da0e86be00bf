//! Shading bases that a computed finish turns.

use super::normals::bend_where;
use crate::geom::Basis;
use crate::lanes::{Lanes, Mask, OutlinedTask, Vector};
use crate::scene::{Effects, Finish};

/// Turns a shading basis, out of line: its normals are bent, and its x axis becomes the rougher direction, as a finish
/// says. The triangle's normal and `wo` limit the bending. Also returns the lanes in which the basis is another.
pub struct Turn<'a, L: Lanes> {
    pub old: Basis<L>,
    pub finish: &'a Finish<L>,
    pub effects: &'a Effects,
    pub triangle: Vector<L>,
    pub wo: Vector<L>,
}

impl<L: Lanes> OutlinedTask<L> for Turn<'_, L> {
    type Output = (Basis<L>, Mask<L>);

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, l: L) -> (Basis<L>, Mask<L>) {
        let Self { old, finish, effects, triangle, wo } = self;
        let (mut basis, mut changed) = (old, Mask::splat(l, effects.has_normals));
        if effects.has_normals {
            let (normal, there) = finish.normal.normalize_or(old.normal);
            let bent = bend_where(normal, there, triangle, wo, false);
            basis = Basis::around(Vector::select(there, bent, old.normal));
        }
        if effects.has_anisotropy {
            let normal = basis.normal;
            let (x, given) = finish.rough_direction.normalize_or(old.tangent);
            let (tangent, along) = (x - normal * x.dot(normal)).normalize_or(basis.tangent);
            let rough = Basis { tangent, bitangent: normal.cross(tangent), normal };
            let turns = if effects.has_normals { along } else { along & given };
            basis = Basis::select(turns, rough, basis);
            changed |= turns;
        }
        (basis, changed)
    }
}
