//! Frames of a scene that moves: each is of the scene at its own time, or at several while the shutter is open.

use super::checked::afford;
use super::{AnyIntegrator, CheckedSpec, Rendering, scene_file};
use crate::engine::{PreparedScene, Units};
use crate::memory::MemoryBudget;
use crate::render::{Integrator, PASSES_IN_FLIGHT, Pass};
use crate::scene::Scene;
use crate::scene::load::{LoadOptions, load_with};
use anyhow::{Context, Result, ensure};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

/// Scenes of other frames that are kept: workers render several units of a frame, and several frames at a time.
const KEPT: usize = 4;

/// Scenes that are kept where each is of one moment of a frame; that of the frame's own time comes to them.
const KEPT_MOMENTS: usize = PASSES_IN_FLIGHT;

/// The way to the scene at the time of each frame, and at each moment while the shutter is open.
#[derive(Clone, Debug)]
pub struct Moving {
    options: LoadOptions,
    memory: MemoryBudget,
    units: Units,
    /// Each with its time.
    kept: Arc<Mutex<VecDeque<(f64, PreparedScene)>>>,
}

impl Moving {
    /// Reads the scene's file anew for each time, with these options but for the time.
    pub fn new(options: LoadOptions, memory: MemoryBudget, units: Units) -> Self {
        Self { options, memory, units, kept: Arc::default() }
    }

    /// The scene at a time. Its light is that of the scene that the rendering was opened with: what that lacked, and
    /// was assumed, is assumed for all times.
    fn scene(&self, seconds: f64, opened: &Rendering) -> Result<PreparedScene> {
        let kept = || self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        {
            let mut kept = kept();
            let known = kept.iter().position(|(kept, _)| *kept == seconds);
            if let Some(found) = known.and_then(|known| kept.remove(known)) {
                // What was used last is kept longest.
                kept.push_back(found.clone());
                return Ok(found.1);
            }
        }
        let checked: &CheckedSpec = opened.checked();
        let path = checked.scene_file()?;
        ensure!(
            !scene_file::is_standard_input(path),
            "a scene that moves is read anew for each frame; name a file"
        );
        // Its warnings have been told.
        let mut scene = load_with(path, &self.options.clone().with_time(seconds))?;
        drop(checked.change_materials(&mut scene)?);
        scene.environment = opened.prepared().scene.environment.clone();
        let bytes = PreparedScene::building_bytes(&scene);
        afford(&self.memory, format!("the scene at {seconds} s and its tree"), bytes)?;
        let has_frames = opened.spec().animation.frames.is_some();
        let most = if opened.steps() > 1 { KEPT_MOMENTS + usize::from(has_frames) } else { KEPT };
        {
            let mut kept = kept();
            let more = (kept.len() + 1).saturating_sub(most);
            kept.drain(..more);
        }
        let prepared = PreparedScene::new(scene, &self.units)?;
        kept().push_back((seconds, prepared.clone()));
        Ok(prepared)
    }
}

impl Rendering {
    /// The same with the way to the scenes of frames, if the spec has frames of a scene that moves.
    pub fn with_moving(self, moving: impl FnOnce() -> Moving) -> Self {
        let has_times = self.spec().animation.frames.is_some() || self.steps() > 1;
        match self.start() {
            Some(_) if has_times => self.moved_by(moving()),
            _ => self,
        }
    }

    /// The time of frame 0, if the scene looks different at other times.
    fn start(&self) -> Option<f64> {
        self.spec().loading.time.filter(|_| self.prepared().scene.is_animated)
    }

    /// The time of a frame, if the scene looks different at other times.
    fn time(&self, frame: u32) -> Option<f64> {
        let spec = self.spec();
        let frame = spec.animation.frames.as_ref().map_or(0, |_| frame);
        Some(self.start()? + f64::from(frame) / spec.animation.rate())
    }

    /// Moments at which each frame is seen: one, unless the shutter is open for a time.
    pub fn steps(&self) -> u32 {
        self.spec().animation.steps()
    }

    /// True if its frames have different scenes, and this is the rendering of all of them.
    pub fn moves(&self) -> bool {
        self.moving().is_some() && !self.is_of_frame() && self.spec().animation.frames.is_some()
    }

    /// The rendering of a frame's scene: this one, if the scene does not move.
    ///
    /// # Errors
    /// If the scene cannot be read.
    pub fn of_frame(&self, frame: u32) -> Result<Self> {
        let (true, Some(moving), Some(seconds)) = (self.moves(), self.moving(), self.time(frame)) else {
            return Ok(self.clone());
        };
        let prepared = moving.scene(seconds, self).with_context(|| format!("frame {frame}"))?;
        Ok(self.with_prepared(prepared))
    }

    /// The rendering and the integrator of a pass of a frame, whose own integrator is given. If the shutter is open for
    /// a time, they are those of the moment of the pass's samples: scene and camera are where they are then.
    ///
    /// # Errors
    /// If the scene cannot be read, or the camera is invalid at that time.
    pub fn exposed(
        &self,
        integrator: &AnyIntegrator,
        frame: u32,
        pass: Pass,
    ) -> Result<(Self, Arc<AnyIntegrator>)> {
        if self.steps() == 1 {
            return Ok((self.clone(), integrator.with_pass(pass).into()));
        }
        let step = integrator.frame().settings().step_of(pass.samples().start);
        let offset = self.spec().animation.offset(step);
        let moment = || format!("frame {frame}, {offset:+} s from its time");
        let mut own = self.clone();
        if let (Some(moving), Some(time)) = (self.moving(), self.time(frame)) {
            own = self.with_prepared(moving.scene(time + offset, self).with_context(moment)?);
            ensure!(
                integrator.frame().aovs().is_empty()
                    || has_same_ids(&self.prepared().scene, &own.prepared().scene),
                "{}: objects or materials come or go while the shutter is open, and layers number them; leave out the \
                 layers, or choose another time",
                moment()
            );
        }
        let camera = self.frames().camera_at(self.spec(), frame, offset).with_context(moment)?;
        let bare = own.bare_integrator(&camera).with_context(moment)?;
        let exposed = integrator.frame().exposed(bare.frame(), pass);
        Ok((own, bare.with_frame(exposed).into()))
    }
}

/// True if layers number the objects and materials of two scenes alike.
fn has_same_ids(a: &Scene, b: &Scene) -> bool {
    let objects = |scene: &Scene| -> Vec<(String, Option<u32>)> {
        scene.objects.iter().map(|object| (object.name.clone(), object.parent)).collect()
    };
    a.materials.len() == b.materials.len() && objects(a) == objects(b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::Film;
    use crate::picture::{RenderSpec, open};
    use crate::render::{Gathered, PassOptions, Patch, Progressive};
    use crate::schedule::{JobOptions, Service, ServiceOptions};
    use serde_json::{Value, json};
    use std::path::Path;

    /// An object with the keys of another.
    fn with(mut object: Value, more: Value) -> Value {
        let Value::Object(more) = more else { panic!("an object") };
        object.as_object_mut().expect("an object").extend(more);
        object
    }

    /// A lit quad that moves to the right, before a wall, and a camera that moves up.
    fn write_scene(folder: &Path) {
        let corners = [
            [-1.0, -1.0, 0.0, 1.0, -1.0, 0.0, 1.0, 1.0, 0.0, -1.0, 1.0, 0.0_f32].map(|x| 0.25 * x),
            [-2.0, -2.0, -1.0, 2.0, -2.0, -1.0, 2.0, 2.0, -1.0, -2.0, 2.0, -1.0],
        ];
        let places = [-1.0, 0.0, 0.0, 1.0, 0.0, 0.0_f32];
        let views = [0.0, 0.0, 3.0, 0.0, 1.0, 3.0_f32];
        let floats: Vec<f32> = [corners.as_flattened(), &[0.0, 2.0], &places, &views].concat();
        let mut bytes: Vec<u8> = floats.iter().flat_map(|value| value.to_le_bytes()).collect();
        bytes.extend([0, 1, 2, 0, 2, 3]);
        std::fs::write(folder.join("a.bin"), &bytes).expect("a file");
        let accessor = |offset: u32, kind: &str, count: u32| {
            let place = json!({ "bufferView": 0, "byteOffset": offset, "componentType": 5126 });
            with(place, json!({ "type": kind, "count": count }))
        };
        let mesh = |positions: u32, material: u32| {
            let attributes = json!({ "POSITION": positions });
            json!({ "primitives": [{ "attributes": attributes, "indices": 5, "material": material }] })
        };
        let mut indices = accessor(152, "SCALAR", 6);
        indices["componentType"] = json!(5121);
        let channel = |sampler: u32, node: u32| {
            let target = json!({ "node": node, "path": "translation" });
            json!({ "sampler": sampler, "target": target })
        };
        let document = json!({
            "asset": { "version": "2.0" },
            "buffers": [{ "byteLength": bytes.len(), "uri": "a.bin" }],
            "bufferViews": [{ "buffer": 0, "byteLength": bytes.len() }],
            "accessors": [accessor(0, "VEC3", 4), accessor(48, "VEC3", 4), accessor(96, "SCALAR", 2),
                accessor(104, "VEC3", 2), accessor(128, "VEC3", 2), indices],
            "meshes": [mesh(0, 0), mesh(1, 1)],
            "materials": [{ "emissiveFactor": [1.0, 0.5, 0.25] }, {}],
            "cameras": [{ "type": "perspective", "perspective": { "yfov": 0.8, "znear": 0.1 } }],
            "nodes": [{ "mesh": 0, "name": "quad" }, { "mesh": 1, "name": "wall" }, { "camera": 0 }],
            "animations": [{ "samplers": [{ "input": 2, "output": 3 }, { "input": 2, "output": 4 }],
                "channels": [channel(0, 0), channel(1, 2)] }]
        });
        std::fs::write(folder.join("a.gltf"), document.to_string()).expect("a file");
    }

    struct Studio {
        folder: tempfile::TempDir,
        service: Service,
    }

    impl Studio {
        fn new() -> Self {
            let folder = tempfile::tempdir().expect("a folder");
            write_scene(folder.path());
            let options = ServiceOptions::default().with_host_threads(2).with_max_jobs(PASSES_IN_FLIGHT);
            Self { folder, service: Service::new(options).expect("threads") }
        }

        fn rendering(&self, more: Value) -> Rendering {
            let spec = json!({ "scene": "a.gltf", "size": [32, 24], "spp": 8, "max-bounces": 2,
                "aov": ["normal", "crypto-object"], "transparent": true });
            let spec: RenderSpec = serde_json::from_value(with(spec, more)).expect("a spec");
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
            let crate::film::LayerValues::Floats { values, .. } = &picture.layers[0].values else { panic!() };
            values.iter().map(|value| f64::from(*value)).sum::<f64>() / values.len() as f64
        };
        let (still, moving) = (noise(&still), noise(&moving));
        assert!(
            moving < 4.0 * still,
            "{moving} is the variance of what moves, {still} that of what stands still"
        );
    }
}
