//! Rows of a moving frame: rendered, shown as a display shows them, and encoded.

use super::edit::Edits;
use super::encoder::{MOVING_QUALITY, table};
use super::{EditList, strips};
use crate::engine::PreparedScene;
use crate::farm::{Tile, TileAsk};
use crate::film::{Exposure, Image, Light, Look, Region, View};
use crate::render::{Integrator, Part, PassOptions, PathTracer, Progressive, ROULETTE_BOUNCES, Settings};
use crate::scene::Camera;
use crate::schedule::{JobOptions, Priority, Service};
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How often a tile under way looks whether it is still wanted.
const LOOK: Duration = Duration::from_millis(5);

/// A scene, as a worker renders tiles of it.
pub struct TileScene {
    prepared: PreparedScene,
    /// What a pose does not say of a camera.
    camera: Camera,
    service: Arc<Service>,
    /// The scene with the edits that were wanted last.
    edited: Mutex<(EditList, PreparedScene)>,
}

impl std::fmt::Debug for TileScene {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TileScene").field("camera", &self.camera).finish_non_exhaustive()
    }
}

/// The camera that views of a scene begin with.
pub(super) fn first_camera(prepared: &PreparedScene) -> Camera {
    let scene = &prepared.scene;
    scene.camera.unwrap_or_else(|| Camera::framing(&scene.bounds(), 16.0 / 9.0))
}

/// A frame of these rows of a picture, from its first sample, without any job.
pub(super) fn rows_of(path: PathTracer, rows: Range<u32>) -> Result<Progressive<PathTracer>, String> {
    let Settings { width, spp, .. } = *path.frame().settings();
    let region = Region { x: 0, y: rows.start, width, height: rows.len() as u32 };
    let part = path.with_part(Part { region, samples: 0..spp }).map_err(|error| error.to_string())?;
    Ok(Progressive::new(part, PassOptions::default()))
}

/// A path tracer of moving frames.
pub(super) fn path_tracer(
    prepared: &PreparedScene,
    camera: &Camera,
    settings: Settings,
) -> Result<PathTracer, String> {
    let path = PathTracer::new(prepared.lit(), camera, settings, Some(ROULETTE_BOUNCES));
    path.map_err(|error| error.to_string())
}

/// Rows of a moving frame as a JPEG with restart markers.
pub(super) fn jpeg_of(image: &Image, look: &Look) -> Result<Vec<u8>, String> {
    let colours = table(look.view()).bytes(image, look);
    let encoded = strips::encode(&colours, [image.width, image.height], MOVING_QUALITY);
    encoded.map_err(|error| error.to_string())
}

impl TileScene {
    /// A scene without edits.
    pub fn new(prepared: &PreparedScene, service: &Arc<Service>) -> Self {
        // The first tile has no time to make it.
        table(View::default());
        let camera = first_camera(prepared);
        let edited = Mutex::new((EditList::default(), prepared.clone()));
        Self { prepared: prepared.clone(), camera, service: Arc::clone(service), edited }
    }

    /// The scene with edits.
    fn edited(&self, list: &EditList) -> Result<PreparedScene, String> {
        let mut edited = self.edited.lock().unwrap_or_else(PoisonError::into_inner);
        if edited.0 != *list {
            let scene = Edits::new(list)?.of(&self.prepared.scene)?;
            let prepared = self.prepared.with_scene(scene).map_err(|error| error.to_string())?;
            *edited = (list.clone(), prepared);
        }
        Ok(edited.1.clone())
    }

    /// Renders a tile at interactive priority. `None` if it was no longer wanted before it was ready.
    ///
    /// # Errors
    /// Why it cannot be rendered.
    pub fn tile(&self, ask: &TileAsk, is_wanted: impl Fn() -> bool) -> Result<Option<Tile>, String> {
        let began = Instant::now();
        let prepared = self.edited(&ask.edits)?;
        let camera = ask.pose.camera(&self.camera, ask.size).map_err(|error| error.to_string())?;
        let view = View::ALL.into_iter().find(|view| view.name() == ask.transform);
        let view = view.ok_or_else(|| format!("{:?} is no view transform", ask.transform))?;
        let [width, height] = ask.size;
        let settings = Settings::new(width, height).with_seed(ask.seed).with_spp(ask.spp);
        let path = path_tracer(&prepared, &camera, settings.with_max_bounces(ask.max_bounces))?;
        let mut frame = rows_of(path, ask.rows.clone())?;
        let options = JobOptions::default().with_name("live tile").with_priority(Priority::Interactive);
        let begun = frame.begin(|pass| prepared.submit(&self.service, Arc::clone(pass), options.clone()));
        begun.map_err(|error| error.to_string())?;
        while !frame.wait_for(LOOK) {
            if !is_wanted() {
                // Dropping a frame cancels its jobs.
                return Ok(None);
            }
        }
        frame.finish_pass().map_err(|error| error.to_string())?;
        let image = frame.develop().image;
        let look = Look::default().with_view(view).with_exposure(Exposure::Stops(ask.stops));
        let light = if ask.is_metered { Light::of(&image) } else { Light::default() };
        let jpeg = Arc::new(jpeg_of(&image, &look)?);
        let seconds = began.elapsed().as_secs_f64();
        let rows = ask.rows.clone();
        Ok(Some(Tile { rows, light: (light.logarithms, light.pixels), seconds, jpeg }))
    }
}
