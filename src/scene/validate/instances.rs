//! Checks shapes and their instances.

use super::{FINITE, SceneError, ScenePart};
use crate::scene::{Instance, Scene, Shape, mesh};
use rayon::prelude::*;

impl Scene {
    /// Checks that shapes are valid geometry, and that each instance has its own triangles of the mesh, which are where
    /// its placement moves the shape's and have the same alpha modes.
    ///
    /// Of the corners only those of the first and the last triangle are compared.
    pub(super) fn validate_instances(&self) -> Result<(), SceneError> {
        let masked = self.masked_materials();
        let mut taken = Vec::new();
        for (index, shape) in self.shapes.iter().enumerate() {
            let part = ScenePart::Shape(index);
            let Shape { positions, triangles, instances } = shape;
            let error = |problem| SceneError::Instance { part: part.clone(), problem };
            if instances.is_empty() || triangles.is_empty() {
                return Err(error("it has no instances or no triangles; leave it out of Scene::shapes"));
            }
            mesh::check_positions(positions)
                .and_then(|()| mesh::check_indices(triangles, positions.len()))
                .map_err(|_| {
                error("a position is not finite, or a triangle names a vertex that does not exist")
            })?;
            for (number, instance) in instances.iter().enumerate() {
                let part = ScenePart::Instance { shape: index, index: number };
                self.check_instance(&part, shape, instance)?;
                taken.push((instance.first, instance.first + triangles.len() as u32, part));
            }
            if masked.contains(&true) {
                self.check_masks(index, shape, &masked)?;
            }
        }
        taken.par_sort_unstable_by_key(|&(first, ..)| first);
        match taken.windows(2).find(|pair| pair[0].1 > pair[1].0) {
            None => Ok(()),
            Some(pair) => {
                let problem = "its triangles also belong to another instance; give each instance its own";
                Err(SceneError::Instance { part: pair[1].2.clone(), problem })
            }
        }
    }

    fn check_instance(&self, part: &ScenePart, shape: &Shape, instance: &Instance) -> Result<(), SceneError> {
        let Instance { placement, first } = *instance;
        FINITE.check(part, "an element of its placement", placement.rows.into_iter().flatten())?;
        let count = shape.triangles.len();
        let error = |problem| Err(SceneError::Instance { part: part.clone(), problem });
        if first as usize + count > self.mesh.triangles.len() {
            return error("its triangles lie beyond the mesh's; write all instances out in Scene::mesh");
        }
        for place in [0, count - 1] {
            let moved =
                shape.triangles[place].map(|corner| placement.point(shape.positions[corner as usize]));
            if moved != self.mesh.corners(first + place as u32) {
                return error("the mesh's triangles are not where its placement moves the shape's");
            }
        }
        Ok(())
    }

    /// Instances share a tree, and the tree knows which triangles are masked.
    fn check_masks(&self, index: usize, shape: &Shape, masked: &[bool]) -> Result<(), SceneError> {
        let is_masked = |primitive: u32| masked[self.mesh.materials[primitive as usize] as usize];
        let first = shape.instances[0].first;
        let differs = |instance: &Instance| {
            (0..shape.triangles.len() as u32).any(|i| is_masked(first + i) != is_masked(instance.first + i))
        };
        match shape.instances.par_iter().position_first(differs) {
            None => Ok(()),
            Some(number) => {
                let problem = "its materials are opaque where those of the shape's first instance are not, or vice \
                               versa; leave the shape out of Scene::shapes";
                Err(SceneError::Instance {
                    part: ScenePart::Instance { shape: index, index: number },
                    problem,
                })
            }
        }
    }
}
