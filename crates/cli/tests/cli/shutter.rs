//! A shutter that is open for a time, through the library: the sums of stills, and patches of moments.

use super::gltf::{self, Array};
use raystream::engine::Units;
use raystream::film::{Film, LayerValues};
use raystream::picture::{RenderSpec, Rendering, open};
use raystream::render::{Gathered, Integrator, PASSES_IN_FLIGHT, Pass, PassOptions, Patch, Progressive};
use raystream::schedule::{JobOptions, Service, ServiceOptions};
use serde_json::{Value, json};
use std::sync::Arc;

/// A lit quad that moves to the right, before a wall, and a camera that moves up.
fn scene() -> String {
    let quad = [-0.25, -0.25, 0.0, 0.25, -0.25, 0.0, 0.25, 0.25, 0.0, -0.25, 0.25, 0.0];
    let wall = [-2.0, -2.0, -1.0, 2.0, -2.0, -1.0, 2.0, 2.0, -1.0, -2.0, 2.0, -1.0];
    let arrays = [
        Array::floats("VEC3", &quad),
        Array::floats("VEC3", &wall),
        Array::floats("SCALAR", &[0.0, 2.0]),
        Array::floats("VEC3", &[-1.0, 0.0, 0.0, 1.0, 0.0, 0.0]),
        Array::floats("VEC3", &[0.0, 0.0, 3.0, 0.0, 1.0, 3.0]),
        Array { kind: "SCALAR", component: 5121, bytes: vec![0, 1, 2, 0, 2, 3] },
    ];
    let mesh = |number: u32| {
        let attributes = json!({ "POSITION": number });
        json!({ "primitives": [{ "attributes": attributes, "indices": 5, "material": number }] })
    };
    let channel = |sampler: u32, node: u32| {
        let target = json!({ "node": node, "path": "translation" });
        json!({ "sampler": sampler, "target": target })
    };
    let rest = json!({
        "meshes": [mesh(0), mesh(1)],
        "materials": [{ "emissiveFactor": [1.0, 0.5, 0.25] }, {}],
        "cameras": [{ "type": "perspective", "perspective": { "yfov": 0.8, "znear": 0.1 } }],
        "nodes": [{ "mesh": 0, "name": "quad" }, { "mesh": 1, "name": "wall" }, { "camera": 0 }],
        "animations": [{ "samplers": [{ "input": 2, "output": 3 }, { "input": 2, "output": 4 }],
            "channels": [channel(0, 0), channel(1, 2)] }]
    });
    gltf::file(&arrays, rest)
}

struct Studio {
    folder: tempfile::TempDir,
    service: Service,
}

impl Studio {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("a.gltf"), scene()).expect("a file");
        let options = ServiceOptions::default().with_host_threads(2).with_max_jobs(PASSES_IN_FLIGHT);
        Self { folder, service: Service::new(options).expect("threads") }
    }

    fn rendering(&self, more: Value) -> Rendering {
        let mut spec = json!({ "scene": "a.gltf", "size": [32, 24], "spp": 8, "max-bounces": 2,
            "aov": ["normal", "crypto-object"], "transparent": true });
        spec.as_object_mut().expect("an object").extend(more.as_object().expect("an object").clone());
        let spec: RenderSpec = serde_json::from_value(spec).expect("a spec");
        open(&spec, self.folder.path(), &Units::cpu()).expect("a rendering")
    }

    fn film(&self, rendering: &Rendering, frame: u32, options: PassOptions) -> Arc<Film> {
        let own = rendering.of_frame(frame).expect("a scene");
        let camera = own.camera(frame).expect("a camera");
        let integrator = own.integrator(&camera).expect("an integrator");
        let mut picture = Progressive::new(integrator, options);
        loop {
            let begun = picture.begin_exposed(|integrator, pass| {
                let (posed, exposed) = own.exposed(integrator, frame, pass)?;
                let job = posed.submit(&self.service, &exposed, JobOptions::default())?;
                anyhow::Ok((exposed, job))
            });
            begun.expect("a job");
            if picture.finish_pass().expect("no failure").is_none() {
                return picture.picture();
            }
        }
    }
}

fn bytes(film: &Film) -> Vec<u8> {
    let mut bytes = Vec::new();
    film.save(&mut bytes).expect("memory");
    bytes
}

#[test]
fn a_blurred_picture_is_the_sum_of_stills_to_the_bit() {
    let studio = Studio::new();
    let rendering = studio.rendering(json!({ "time": 1.0, "shutter": 0.5, "shutter-steps": 4 }));
    let blurred = studio.film(&rendering, 0, PassOptions::default());
    let sum = blurred.blank();
    let mut stills = Vec::new();
    for (step, seconds) in [0.8125, 0.9375, 1.0625, 1.1875].into_iter().enumerate() {
        let samples = format!("{}..{}", 2 * step, 2 * step + 2);
        let still = studio.rendering(json!({ "time": seconds, "samples": samples }));
        let still = studio.film(&still, 0, PassOptions::default());
        sum.add(&still);
        stills.push(bytes(&still));
    }
    assert!(bytes(&sum) == bytes(&blurred), "the sum of stills is another picture");
    stills.dedup();
    assert_eq!(stills.len(), 4, "all stills differ");
    // Many small passes end at the same moments.
    let passes = PassOptions::default().with_pass_time(std::time::Duration::from_nanos(1));
    assert!(bytes(&studio.film(&rendering, 0, passes)) == bytes(&blurred));
    // One step is the still itself.
    let one = studio.rendering(json!({ "time": 1.0, "shutter": 0.5, "shutter-steps": 1 }));
    let still = studio.rendering(json!({ "time": 1.0 }));
    let [one, still] = [one, still].map(|one| bytes(&studio.film(&one, 0, PassOptions::default())));
    assert!(one == still && one != bytes(&blurred));
}

#[test]
fn a_blurred_frame_is_gathered_from_patches_in_any_order() {
    let studio = Studio::new();
    let spec = json!({ "frames": "0..3", "fps": 2, "shutter": 0.25, "shutter-steps": 4, "denoise": true,
        "aov": ["depth", "variance"] });
    let rendering = studio.rendering(spec);
    let whole = studio.film(&rendering, 2, PassOptions::default());
    let own = rendering.of_frame(2).expect("a scene");
    let integrator = || own.integrator(&own.camera(2).expect("a camera")).expect("an integrator");
    let mut gathered = Gathered::new(integrator(), PassOptions::default());
    while !gathered.is_complete() {
        let passes: Vec<(u64, Pass)> =
            gathered.passes().map(|(number, pass)| (number, pass.clone())).collect();
        for (number, pass) in passes.into_iter().rev() {
            let (blocks, samples) = (pass.blocks().to_vec(), pass.samples());
            assert_eq!(samples.len(), 2, "a pass is of one moment");
            let half = samples.start + 1;
            for piece in [half..samples.end, samples.start..half] {
                let piece = Pass::new(blocks[..].into(), piece);
                let (posed, piece) = own.exposed(&integrator(), 2, piece).expect("a scene");
                let job = posed.submit(&studio.service, &piece, JobOptions::default());
                job.expect("a job").wait().expect("no failure");
                gathered.add(number, &Patch::of(piece.frame())).expect("a patch of it");
            }
        }
    }
    assert!(bytes(&gathered.film()) == bytes(&whole));
    // What moves is no noise: both halves of the samples see all moments.
    let still = studio.rendering(json!({ "time": 1.0, "shutter": 0.001, "shutter-steps": 4, "spp": 64,
        "aov": ["variance"] }));
    let moving = studio.rendering(json!({ "time": 1.0, "shutter": 1.0, "shutter-steps": 4, "spp": 64,
        "aov": ["variance"] }));
    let noise = |rendering: &Rendering| {
        let film = studio.film(rendering, 0, PassOptions::default());
        let camera = rendering.camera(0).expect("a camera");
        let integrator = rendering.integrator(&camera).expect("an integrator");
        let picture = integrator.frame().develop(&film);
        let LayerValues::Floats { values, .. } = &picture.layers[0].values else {
            panic!("variances are numbers")
        };
        values.iter().map(|value| f64::from(*value)).sum::<f64>() / values.len() as f64
    };
    let (still, moving) = (noise(&still), noise(&moving));
    assert!(
        moving < 4.0 * still,
        "{moving} is the variance of what moves, {still} that of what stands still"
    );
}
