//! Linear blend skinning: vertices that follow several joints, each by its weight.

use glam::{DMat3, DMat4, DVec3, Vec3, Vec4};

/// The pose of joints, and how much each vertex follows which of them.
///
/// A vertex is moved by the weighted sum of its joints' matrices. All of it is computed in `f64`, joint after joint in
/// the order given, without fused operations, and rounded once: the bits depend on no processor and no thread count.
#[derive(Clone, Debug)]
pub struct Skin {
    joints: Vec<Affine>,
    /// Joints and weights, `per_vertex` of them for each vertex.
    influences: Vec<(u16, f32)>,
    per_vertex: usize,
}

/// An affine map.
#[derive(Clone, Copy, Debug)]
struct Affine {
    linear: DMat3,
    translation: DVec3,
}

impl Affine {
    #[inline]
    fn new(matrix: &DMat4) -> Self {
        Self { linear: DMat3::from_mat4(*matrix), translation: matrix.w_axis.truncate() }
    }
}

/// An error of the influences of a skin.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SkinError {
    /// A joint that is followed does not exist.
    #[error("vertex {vertex} follows joint {joint}, but there are {joints}")]
    NoSuchJoint {
        /// The vertex.
        vertex: usize,
        /// The joint.
        joint: u16,
        /// The number of joints.
        joints: usize,
    },
    /// A weight is negative, infinite or NaN.
    #[error("vertex {vertex} follows joint {joint} by {weight}; weights are finite and not negative")]
    Weight {
        /// The vertex.
        vertex: usize,
        /// The joint.
        joint: u16,
        /// The weight.
        weight: f32,
    },
}

impl Skin {
    /// A skin of joints, each with the matrix that moves a vertex at rest to where the joint takes it. Each vertex has
    /// `per_vertex` influences: a joint and its weight, 0 or more. Weights are divided by their sum; a vertex whose
    /// weights are all 0 follows its first joint.
    ///
    /// # Errors
    /// The first influence whose joint does not exist or whose weight is none.
    ///
    /// # Panics
    /// If `per_vertex` is 0, or there are no joints.
    pub fn new(
        joints: &[DMat4],
        mut influences: Vec<(u16, f32)>,
        per_vertex: usize,
    ) -> Result<Self, SkinError> {
        assert!(per_vertex > 0 && !joints.is_empty(), "a skin has joints");
        for (vertex, own) in influences.chunks_exact_mut(per_vertex).enumerate() {
            for &(joint, weight) in &*own {
                if !(weight >= 0.0 && weight.is_finite()) {
                    return Err(SkinError::Weight { vertex, joint, weight });
                }
                // Files name any joint where the weight is 0.
                if weight > 0.0 && joint as usize >= joints.len() {
                    return Err(SkinError::NoSuchJoint { vertex, joint, joints: joints.len() });
                }
            }
            let sum: f32 = own.iter().map(|(_, weight)| weight).sum();
            if sum > 0.0 {
                own.iter_mut().for_each(|(_, weight)| *weight /= sum);
            } else {
                let joint = if (own[0].0 as usize) < joints.len() { own[0].0 } else { 0 };
                own[0] = (joint, 1.0);
            }
        }
        Ok(Self { joints: joints.iter().map(Affine::new).collect(), influences, per_vertex })
    }

    /// The number of vertices.
    pub fn vertices(&self) -> usize {
        self.influences.len() / self.per_vertex
    }

    /// The map of a vertex.
    ///
    /// # Panics
    /// If there is no such vertex.
    pub fn bend(&self, vertex: usize) -> Bend {
        let mut sum = Affine { linear: DMat3::ZERO, translation: DVec3::ZERO };
        for &(joint, weight) in &self.influences[vertex * self.per_vertex..][..self.per_vertex] {
            if weight > 0.0 {
                let (joint, weight) = (&self.joints[joint as usize], f64::from(weight));
                sum.linear += joint.linear * weight;
                sum.translation += joint.translation * weight;
            }
        }
        Bend::of(sum)
    }
}

/// An affine map of positions, normals and tangents: of one vertex of a skin, or of a whole mesh.
#[derive(Clone, Copy, Debug)]
pub struct Bend {
    map: Affine,
    /// Inverse transpose of the linear part, up to a positive factor.
    normals: DMat3,
    mirrors: bool,
}

impl Bend {
    /// The map of a matrix, whose last row is 0 0 0 1.
    #[inline]
    pub fn new(matrix: &DMat4) -> Self {
        Self::of(Affine::new(matrix))
    }

    #[inline]
    fn of(map: Affine) -> Self {
        let DMat3 { x_axis, y_axis, z_axis } = map.linear;
        let mirrors = x_axis.cross(y_axis).dot(z_axis) < 0.0;
        let sign = if mirrors { -1.0 } else { 1.0 };
        // The cofactors, which are defined even if the matrix has no inverse.
        let cofactors = DMat3::from_cols(y_axis.cross(z_axis), z_axis.cross(x_axis), x_axis.cross(y_axis));
        Self { map, normals: cofactors * sign, mirrors }
    }

    /// A moved position.
    #[inline]
    pub fn position(&self, position: DVec3) -> Vec3 {
        (self.map.linear * position + self.map.translation).as_vec3()
    }

    /// The unit normal; zero if it has no direction.
    #[inline]
    pub fn normal(&self, normal: DVec3) -> Vec3 {
        unit(self.normals * normal)
    }

    /// The tangent, whose last number is the sign of the bitangent; zero if it has no direction.
    #[inline]
    pub fn tangent(&self, tangent: DVec3, sign: f32) -> Vec4 {
        let moved = unit(self.map.linear * tangent);
        let sign = if self.mirrors { -sign } else { sign };
        if moved == Vec3::ZERO { Vec4::ZERO } else { moved.extend(sign) }
    }

    /// True if it turns the orientation of a triangle round.
    #[inline]
    pub fn mirrors(&self) -> bool {
        self.mirrors
    }
}

#[inline]
fn unit(direction: DVec3) -> Vec3 {
    direction.try_normalize().unwrap_or(DVec3::ZERO).as_vec3()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    #[test]
    fn a_vertex_between_two_joints_is_between_where_they_take_it() {
        let turn = DMat4::from_quat(DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2));
        let joints = [DMat4::IDENTITY, DMat4::from_translation(DVec3::Z) * turn];
        // The last one's joint does not exist, and counts nothing.
        let influences = vec![(0, 1.0), (1, 3.0), (1, 0.5), (9, 0.0), (0, 0.0), (9, 0.0)];
        let skin = Skin::new(&joints, influences, 2).expect("a skin");
        assert_eq!(skin.vertices(), 3);
        let moved = [0, 1, 2].map(|vertex| skin.bend(vertex).position(DVec3::X));
        assert!((moved[0] - Vec3::new(0.25, 0.75, 0.75)).length() < 1e-6, "{moved:?}");
        assert!((moved[1] - Vec3::new(0.0, 1.0, 1.0)).length() < 1e-6, "{moved:?}");
        assert_eq!(moved[2], Vec3::X);
        let bend = skin.bend(1);
        assert!((bend.normal(DVec3::X) - Vec3::Y).length() < 1e-6 && !bend.mirrors());
        assert!((bend.tangent(DVec3::Y, 1.0) - Vec4::new(-1.0, 0.0, 0.0, 1.0)).length() < 1e-6);
    }

    #[test]
    fn normals_stay_upright_on_what_is_stretched_and_mirrored() {
        let joints = [DMat4::from_scale(DVec3::new(-4.0, 1.0, 1.0))];
        let skin = Skin::new(&joints, vec![(0, 1.0)], 1).expect("a skin");
        let bend = skin.bend(0);
        // A plane through x + y = const becomes one through −x / 4 + y = const.
        let expected = Vec3::new(-0.25, 1.0, 0.0).normalize();
        assert!((bend.normal(DVec3::new(1.0, 1.0, 0.0)) - expected).length() < 1e-6);
        assert!(bend.mirrors() && bend.tangent(DVec3::Y, 1.0).w == -1.0);
    }

    #[test]
    fn wrong_influences_are_named() {
        let joints = [DMat4::IDENTITY];
        let error = |influences| Skin::new(&joints, influences, 1).expect_err("wrong");
        assert_eq!(
            error(vec![(0, 1.0), (1, 0.5)]),
            SkinError::NoSuchJoint { vertex: 1, joint: 1, joints: 1 }
        );
        for weight in [-0.5, f32::NAN, f32::INFINITY] {
            assert!(matches!(error(vec![(0, weight)]), SkinError::Weight { vertex: 0, joint: 0, .. }));
        }
    }
}
