//! A loop shader: every surface is a pane of glass. Half of the light is mirrored, half passes straight on, so a path
//! branches at each hit. A ray stream has one continuation ray for each ray: the *hit shader* sends the mirrored ray on
//! and pushes the other one onto the path's *loop stack*. When the path ends, the *loop shader* pops an entry and sends
//! its ray (Ray Accelerator, section 3.3).
//! `cargo run --release --example panes -- render scenes/showcase.json --integrator panes --env 1,1,1 --max-bounces 6`

use bytemuck::{Pod, Zeroable};
use raystream::picture::Registry;
use raystream::render::{Frame, HitShader};
use raystream::schedule::{Batch, Output};
use raystream::shade::loop_stack::{EMPTY, LoopStack};
use raystream::shade::{material_of, single};
use raystream::stream::Ray;
use raystream_cli::run_with;
use std::process::ExitCode;

struct Panes;

/// The payload, which travels with a ray: 16 bytes.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct State {
    pixel: u32,
    depth: u32,
    /// The weight in the pixel of light along the ray.
    share: f32,
    /// The topmost entry of the path's loop stack.
    head: u32,
}

/// A loop entry: a ray that waits until the path before it has ended.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Pending {
    ray: Ray,
    depth: u32,
    share: f32,
}

impl HitShader for Panes {
    type Payload = State;
    type ShadowPayload = (); // no shadow rays
    type Memory = LoopStack<Pending>;
    /// The most panes that a path passes.
    const MAX_BOUNCES: u32 = 12;

    /// A camera ray grows a tree: 2^depth paths leave the scene, and each adds to the film once.
    fn splats(&self, max_bounces: u32) -> u64 {
        1 << max_bounces
    }

    /// One entry for each depth that a hit can have; beyond this many paths, spawning waits.
    fn most_in_flight(&self, frame: &Frame) -> usize {
        LoopStack::<Pending>::most_paths(frame.settings().max_bounces as usize)
    }

    fn camera(&self, _: &Frame) -> impl Fn(u32, u32) -> State {
        |pixel, _sample| State { pixel, depth: 0, share: 1.0, head: EMPTY }
    }

    fn shade(
        &self,
        frame: &Frame,
        stack: &LoopStack<Pending>,
        batch: Batch<'_, State>,
        out: &mut Output<'_, State, ()>,
    ) {
        let scene = frame.scene();
        let mut session = stack.session();
        for ((ray, hit), state) in batch.rays.iter().zip(batch.hits).zip(batch.payloads) {
            if !hit.is_miss() && state.depth < frame.settings().max_bounces {
                let material = &scene.materials[material_of(scene, hit) as usize];
                let at = single::Interaction::new(scene, material, ray, hit);
                let towards = |direction| Ray::new(at.origin(at.position, direction), direction);
                let (depth, share) = (state.depth + 1, 0.5 * state.share);
                let head = session.push(state.head, &Pending { ray: towards(-at.wo), depth, share });
                let mirrored = towards(2.0 * at.normal.dot(at.wo) * at.normal - at.wo);
                out.ray(mirrored, State { depth, share, head, ..*state });
                continue;
            }
            if hit.is_miss() {
                let (sky, _) = single::sky(frame.lights(), glam::Vec3::from(ray.direction).normalize());
                frame.splat(None, state.pixel, state.share * sky);
            }
            // The loop shader: the path has ended and takes up what it left.
            if let Some((Pending { ray, depth, share }, head)) = session.pop(state.head) {
                out.ray(ray, State { depth, share, head, ..*state });
            }
        }
    }

    fn shadow(&self, _: &Frame, _: &[Ray], _: &[()], _: &[u32]) {}

    fn depth(&self, state: &State) -> u32 {
        state.depth
    }
}

fn main() -> ExitCode {
    let about = "Every surface is a pane of glass";
    run_with(Registry::built_in().with("panes", about, |params| params.hit_shading(Panes)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use raystream::engine::{PreparedScene, Units};
    use raystream::render::{HitShading, Settings};
    use raystream::scene::recipe::Recipe;
    use raystream::schedule::{JobOptions, Service, ServiceOptions};
    use std::sync::Arc;

    #[test]
    fn panes_mirror_half_and_let_half_through() {
        // Two panes before a bright sky: mirrored light comes from there, too.
        let recipe = Recipe::parse(
            r#"{ "camera": { "eye": [0, 0, 5], "target": [0, 0, 0], "fov_degrees": 40 }, "environment": [1, 1, 1],
                 "materials": { "any": { "colour": [1, 1, 1] } },
                 "shapes": [ { "shape": "quad", "corner": [-1, -1, 0], "u": [2, 0, 0], "v": [0, 2, 0],
                               "material": "any" },
                             { "shape": "quad", "corner": [-1, -1, -1], "u": [2, 0, 0], "v": [0, 2, 0],
                               "material": "any" } ] }"#,
        );
        let scene = Arc::new(recipe.and_then(|recipe| recipe.build()).expect("a scene"));
        let prepared = PreparedScene::new(scene, &Units::cpu()).expect("a valid scene");
        let camera = prepared.scene.camera.expect("has one");
        let service = Service::new(ServiceOptions::default()).expect("threads");
        let middle = |max_bounces| {
            let settings = Settings::new(33, 33).with_spp(1).with_max_bounces(max_bounces);
            let panes =
                HitShading::of(Panes, prepared.scene.clone(), &camera, settings).expect("valid settings");
            let panes = Arc::new(panes);
            let job = prepared.submit(&service, panes.clone(), JobOptions::default());
            job.expect("a job").wait().expect("no panic");
            assert_eq!(panes.memory().usage().live_entries, 0, "every entry was taken up");
            panes.film().resolve()[16 * 33 + 16][0]
        };
        // Of one bounce: the front pane mirrors half; the other half meets the second pane and is lost.
        assert_eq!(middle(1), 0.5);
        // Of two: a quarter passes both panes; a quarter is mirrored by the second, and lost at the first.
        assert_eq!(middle(2), 0.75);
        // Of twelve: nearly all.
        assert!((middle(12) - 1.0).abs() < 2e-3, "{}", middle(12));
    }
}
