//! Orthonormal bases around a normal.

use crate::lanes::{Lanes, Mask, SingleLane, Vector};
use glam::Vec3;

/// A right-handed orthonormal basis in each lane; the normal is its z axis.
#[derive(Clone, Copy, Debug)]
pub struct Basis<L: Lanes = SingleLane> {
    /// x axis.
    pub tangent: Vector<L>,
    /// y axis.
    pub bitangent: Vector<L>,
    /// z axis.
    pub normal: Vector<L>,
}

impl<L: Lanes> Basis<L> {
    /// A basis around a unit `normal`, without a branch at the poles (Duff et al. 2017, *Building an
    /// Orthonormal Basis, Revisited*).
    #[inline(always)]
    pub fn around(normal: Vector<L>) -> Self {
        let Vector { x, y, z } = normal;
        let sign = z.signum();
        let a = -1.0 / (sign + z);
        let b = x * y * a;
        Self {
            tangent: Vector::new(1.0 + sign * x * x * a, sign * b, -sign * x),
            bitangent: Vector::new(b, sign + y * y * a, -y),
            normal,
        }
    }

    /// Converts world directions to coordinates of the basis.
    #[inline(always)]
    pub fn local(&self, v: Vector<L>) -> Vector<L> {
        Vector::new(v.dot(self.tangent), v.dot(self.bitangent), v.dot(self.normal))
    }

    /// Converts coordinates of the basis to world directions.
    #[inline(always)]
    pub fn world(&self, v: Vector<L>) -> Vector<L> {
        self.tangent * v.x + self.bitangent * v.y + self.normal * v.z
    }

    /// `a` in the lanes of `mask`, `b` in the others.
    #[inline(always)]
    pub fn select(mask: Mask<L>, a: Self, b: Self) -> Self {
        Self {
            tangent: Vector::select(mask, a.tangent, b.tangent),
            bitangent: Vector::select(mask, a.bitangent, b.bitangent),
            normal: Vector::select(mask, a.normal, b.normal),
        }
    }
}

impl Basis<SingleLane> {
    /// [`Basis::around`] of one unit normal.
    pub fn from_normal(normal: Vec3) -> Self {
        Self::around(normal.into())
    }

    /// [`Basis::local`] of one direction.
    pub fn to_local(&self, v: Vec3) -> Vec3 {
        self.local(v.into()).into()
    }

    /// [`Basis::world`] of one direction.
    pub fn to_world(&self, v: Vec3) -> Vec3 {
        self.world(v.into()).into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bases_are_orthonormal_everywhere_on_the_sphere() {
        for i in 0..2000 {
            let z = -1.0 + 2.0 * (i as f32) / 1999.0;
            let r = (1.0 - z * z).max(0.0).sqrt();
            let n = Vec3::new(r * libm::cosf(i as f32), r * libm::sinf(i as f32), z).normalize();
            let f = Basis::from_normal(n);
            let [tangent, bitangent] = [f.tangent, f.bitangent].map(Vec3::from);
            assert!(tangent.dot(bitangent).abs() < 1e-5);
            assert!(tangent.dot(n).abs() < 1e-5 && bitangent.dot(n).abs() < 1e-5);
            assert!((tangent.cross(bitangent) - n).length() < 1e-5);
            assert!((f.to_world(f.to_local(Vec3::ONE)) - Vec3::ONE).length() < 1e-5);
        }
    }
}
