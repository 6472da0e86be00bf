//! Boxes of objects in their own spaces, for surfaces of user code. They are found when the first one is asked for.

use super::Scene;
use crate::geom::Aabb;
use crate::lanes::{Int, Lanes, Num, SingleLane, Vector};
use glam::Vec3;
use std::sync::OnceLock;

/// Numbers of a box.
const BOX: usize = 6;

/// The boxes of a scene's objects, then that of the scene. A clone of a scene may have another mesh, so it finds them
/// anew.
#[derive(Debug, Default)]
pub(crate) struct ObjectBounds(OnceLock<Vec<f32>>);

impl Clone for ObjectBounds {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl Scene {
    /// The least and the greatest corner of the boxes of triangles' objects in the objects' own spaces, one in each
    /// lane. Without an object it is the box of the scene.
    #[inline(always)]
    pub(crate) fn object_bounds_at<L: Lanes>(&self, primitive: Int<L>) -> [Vector<L>; 2] {
        let boxes = self.object_bounds.0.get_or_init(|| boxes(self));
        let row = self.objects.at(primitive).at_most(self.objects.len() as u32);
        let [a, b, c, d, e, f] = row.rows_of::<BOX>(boxes);
        [Vector::new(a, b, c), Vector::new(d, e, f)]
    }
}

fn boxes(scene: &Scene) -> Vec<f32> {
    let (l, mesh, objects) = (SingleLane, &scene.mesh, &scene.objects);
    let mut all = vec![Aabb::EMPTY; objects.len()];
    for (triangles, owner) in objects.runs(mesh.triangles.len() as u32) {
        let Some(owner) = owner else { continue };
        let mut found = Aabb::EMPTY;
        for primitive in triangles {
            for Vec3 { x, y, z } in mesh.corners(primitive) {
                let corner = Vector::new(Num::splat(l, x), Num::splat(l, y), Num::splat(l, z));
                let Vector { x, y, z } = objects.local(Int::splat(l, owner), corner);
                found = found.union(Aabb::around([Vec3::new(x.get(), y.get(), z.get())]));
            }
        }
        all[owner as usize] = all[owner as usize].union(found);
    }
    all.push(scene.bounds());
    all.iter().flat_map(|one| [one.min.to_array(), one.max.to_array()].concat()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::{LaneTask, SimdLevel};
    use crate::scene::{Object, TriangleMesh};
    use glam::{DMat4, DVec3};

    struct Bounds<'a>(&'a Scene, u32);

    impl LaneTask for Bounds<'_> {
        type Output = [[f32; 3]; 2];

        #[inline(always)]
        fn run<L: Lanes>(self, l: L) -> Self::Output {
            let [low, high] = self.0.object_bounds_at(Int::splat(l, self.1));
            [low, high].map(|at| [at.x, at.y, at.z].map(|x| x.to_array().as_ref()[0]))
        }
    }

    #[test]
    fn boxes_are_those_of_the_objects_in_their_own_spaces() {
        let positions = [0.0, 1.0, 2.0, 4.0].map(|x| Vec3::new(x, 2.0 * x, -x)).to_vec();
        let triangles = vec![[0, 1, 1], [1, 2, 2], [2, 3, 3], [0, 0, 0]];
        let mesh = TriangleMesh { positions, materials: vec![0; 4], triangles, ..TriangleMesh::default() };
        let mut scene = Scene::new(mesh, Vec::new());
        for first in [1, 2] {
            let object = scene.objects.add(Object::new("part"));
            scene.objects.assign(first, object);
        }
        let placed = DMat4::from_translation(DVec3::X) * DMat4::from_scale(DVec3::splat(0.5));
        scene.objects.place(1, &placed);
        scene.objects.assign(3, 0);
        for simd in SimdLevel::available() {
            let of = |primitive| simd.run(Bounds(&scene, primitive));
            assert_eq!(of(0), [[0.0, 0.0, -4.0], [4.0, 8.0, 0.0]], "no object");
            assert_eq!(of(1), [[0.0, 0.0, -2.0], [2.0, 4.0, 0.0]], "two runs");
            assert_eq!(of(2), [[2.0, 8.0, -8.0], [6.0, 16.0, -4.0]], "its own space");
            assert_eq!(of(3), of(1));
        }
        let mut other = scene.clone();
        other.mesh.positions[3] = Vec3::splat(9.0);
        assert_eq!(SimdLevel::detect().run(Bounds(&other, 0))[1], [9.0, 9.0, 9.0]);
    }
}
