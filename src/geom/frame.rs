//! Orthonormal frames.

use glam::Vec3;

/// A right-handed orthonormal frame; the normal is its z axis.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// x axis.
    pub tangent: Vec3,
    /// y axis.
    pub bitangent: Vec3,
    /// z axis.
    pub normal: Vec3,
}

impl Frame {
    /// A frame around a unit `normal`, without a branch at the poles (Duff et al. 2017,
    /// *Building an Orthonormal Basis, Revisited*).
    pub fn from_normal(normal: Vec3) -> Self {
        let sign = 1.0_f32.copysign(normal.z);
        let a = -1.0 / (sign + normal.z);
        let b = normal.x * normal.y * a;
        Self {
            tangent: Vec3::new(1.0 + sign * normal.x * normal.x * a, sign * b, -sign * normal.x),
            bitangent: Vec3::new(b, sign + normal.y * normal.y * a, -normal.y),
            normal,
        }
    }

    /// World direction → frame coordinates.
    pub fn to_local(&self, v: Vec3) -> Vec3 {
        Vec3::new(v.dot(self.tangent), v.dot(self.bitangent), v.dot(self.normal))
    }

    /// Frame coordinates → world direction.
    pub fn to_world(&self, v: Vec3) -> Vec3 {
        self.tangent * v.x + self.bitangent * v.y + self.normal * v.z
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_orthonormal_everywhere_on_the_sphere() {
        for i in 0..2000 {
            let z = -1.0 + 2.0 * (i as f32) / 1999.0;
            let r = (1.0 - z * z).max(0.0).sqrt();
            let n = Vec3::new(r * libm::cosf(i as f32), r * libm::sinf(i as f32), z).normalize();
            let f = Frame::from_normal(n);
            assert!(f.tangent.dot(f.bitangent).abs() < 1e-5);
            assert!(f.tangent.dot(n).abs() < 1e-5 && f.bitangent.dot(n).abs() < 1e-5);
            assert!((f.tangent.cross(f.bitangent) - n).length() < 1e-5);
            assert!((f.to_world(f.to_local(Vec3::ONE)) - Vec3::ONE).length() < 1e-5);
        }
    }
}
