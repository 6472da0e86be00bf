//! Whitted ray tracing as one recursive function: the same picture as [`super::Whitted`], to the bit.

use super::recursion::{Cx, Shader};
use super::whitted_node::{MAX_BOUNCES, Node, SHADOW_RAYS, Sent, splats};
use crate::lanes::Int;
use crate::shade::{Cone, material_of, single};
use crate::stream::{Hit, Ray};
use glam::Vec3;

/// Whitted's algorithm (1980) as one recursive function. [`super::Whitted`] is the same algorithm split by hand into a
/// hit shader and a loop shader.
#[derive(Clone, Copy, Debug, Default)]
pub struct RecursiveWhitted;

/// The state of a ray of the tree.
#[derive(Clone, Copy, Debug)]
pub struct Branch {
    throughput: Vec3,
    /// The ray's [`Cone`], packed as in [`super::Whitted`]; `None` for camera rays.
    cone: Option<u32>,
    depth: u32,
    /// Position in the tree, as for [`Node::direct_light`].
    number: u32,
}

impl Shader for RecursiveWhitted {
    type Args = Branch;
    type Value = ();
    const SHADOW_RAYS: usize = SHADOW_RAYS;
    const MAX_BOUNCES: u32 = MAX_BOUNCES;

    fn splats(&self, max_bounces: u32) -> u64 {
        splats(max_bounces)
    }

    fn camera(&self) -> Branch {
        Branch { throughput: Vec3::ONE, cone: None, depth: 0, number: 1 }
    }

    async fn shade(&self, cx: Cx<'_, Self>, ray: Ray, hit: Option<Hit>, branch: Branch) {
        let Branch { throughput, cone, depth, number } = branch;
        let Some(hit) = hit else {
            cx.add(throughput * single::sky(cx.lights(), Vec3::from_array(ray.direction)).0);
            return;
        };
        let mut lights = [None; SHADOW_RAYS];
        let mut ways = [None; 2];
        let met;
        {
            let scene = cx.scene();
            let direction = Vec3::from_array(ray.direction).into();
            let material = &scene.materials[material_of(scene, &hit) as usize];
            let cone = Cone::unpack(cone.map_or_else(|| cx.frame().cone().pack(), Int::from));
            let node = Node::new(cx.frame(), material, direction, &hit.into(), cone, None);
            met = cone.at(hit.t.into()).pack().get();
            cx.add(throughput * Vec3::from(node.emitted));
            for (light, sent) in lights.iter_mut().enumerate().take(node.lights()) {
                *sent = node.lit(light, &cx.sampler(), number.into(), throughput.into()).one();
            }
            if depth < cx.settings().max_bounces {
                ways = node.secondary(throughput.into()).map(Sent::one);
            }
        }
        // By reference: what is moved into an iterator is kept twice beyond an await.
        for &(ray, radiance) in lights.iter().flatten() {
            cx.add_unless_occluded(ray, radiance).await;
        }
        for (side, way) in (0..).zip(&ways) {
            if let &Some((ray, throughput)) = way {
                cx.call(
                    ray,
                    Branch { throughput, cone: Some(met), depth: depth + 1, number: 2 * number + side },
                )
                .await;
            }
        }
    }
}
