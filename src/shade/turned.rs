//! Shading bases that a computed finish turns.

use super::normals::bend_where;
use crate::geom::Basis;
use crate::lanes::{Lanes, Mask, Vector};
use crate::scene::{Effects, Finish};

/// A shading basis whose normals are bent, and whose x axis is the rougher direction, as a finish says; and the lanes
/// in which it is another. The triangle's normal and `wo` limit the bending.
#[cfg_attr(not(unoptimised), inline(always))]
pub fn turned<L: Lanes>(
    old: &Basis<L>,
    finish: &Finish<L>,
    effects: &Effects,
    (triangle, wo): (Vector<L>, Vector<L>),
) -> (Basis<L>, Mask<L>) {
    let mut basis = *old;
    let mut changed = Mask::splat(wo.lanes(), effects.has_normals);
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
