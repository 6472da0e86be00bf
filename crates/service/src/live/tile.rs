//! Rows of a moving frame: rendered, shown as a display shows them, and encoded.

use super::encoder::MOVING_QUALITY;
use super::live_spec::LiveSpec;
use super::strips;
use crate::contract::{Tile, TileAsk};
use raystream::engine::PreparedScene;
use raystream::film::{DisplayTable, FILTER_REACH, Image, Light, Look, Region, View};
use raystream::picture::TimedScene;
use raystream::render::{
    AovSet, Integrator, Part, PassOptions, PathTracer, Progressive, ROULETTE_BOUNCES, Settings,
};
use raystream::scene::Camera;
use raystream::schedule::{JobOptions, Priority, Service};
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How often a tile under way looks whether it is still wanted.
const LOOK: Duration = Duration::from_millis(5);

/// A scene, as a worker renders tiles of it.
pub struct TileScene {
    prepared: PreparedScene,
    /// The way to the scene at other times, if it has animations.
    timed: Option<TimedScene>,
    service: Arc<Service>,
    /// What was wanted last.
    ready: Mutex<Ready>,
}

/// The scene at a time, with edits, and its frames of one size. A tile's film takes the memory of the one before it.
struct Ready {
    spec: LiveSpec,
    /// Without edits.
    moved: PreparedScene,
    prepared: PreparedScene,
    path: Option<PathTracer>,
}

impl std::fmt::Debug for TileScene {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TileScene").field("scene", &self.prepared).finish_non_exhaustive()
    }
}

/// All samples of these rows of a picture.
fn part(settings: &Settings, rows: Range<u32>) -> Part {
    let Settings { width, spp, .. } = *settings;
    let region = Region { x: 0, y: rows.start, width, height: rows.len() as u32 };
    Part { region, samples: 0..spp }
}

/// Rows that are rendered for these rows of a picture: more of them if noise is removed from them.
pub(super) fn wider(rows: &Range<u32>, height: u32, is_denoised: bool) -> Range<u32> {
    let reach = if is_denoised { FILTER_REACH } else { 0 };
    rows.start.saturating_sub(reach)..(rows.end + reach).min(height)
}

/// Some rows of a picture whose own first row is `first`.
pub(super) fn cropped(image: Image, first: u32, rows: &Range<u32>) -> Image {
    let region = Region { x: 0, y: rows.start - first, width: image.width, height: rows.len() as u32 };
    image.cropped(region)
}

/// A frame of these rows of a picture, from its first sample, without any job.
pub(super) fn rows_of(path: PathTracer, rows: Range<u32>) -> Result<Progressive<PathTracer>, String> {
    let part = path.with_part(part(path.frame().settings(), rows)).map_err(|error| error.to_string())?;
    Ok(Progressive::new(part, PassOptions::default()))
}

/// A path tracer of frames with layers.
pub(super) fn path_tracer(
    prepared: &PreparedScene,
    camera: &Camera,
    settings: Settings,
    layers: &AovSet,
) -> Result<PathTracer, String> {
    let path = PathTracer::new(prepared.lit(), camera, settings, Some(ROULETTE_BOUNCES));
    let path = path.map_err(|error| error.to_string())?;
    if layers.is_empty() {
        return Ok(path);
    }
    path.with_aovs(layers).map_err(|error| error.to_string())
}

/// The layers of moving frames, from which noise is removed or not.
pub(super) fn moving_layers(is_denoised: bool) -> AovSet {
    if is_denoised { AovSet::guides() } else { AovSet::default() }
}

/// Rows of a moving frame as a JPEG with restart markers.
pub(super) fn jpeg_of(image: &Image, look: &Look) -> Result<Vec<u8>, String> {
    let colours = DisplayTable::of(look.view()).bytes(image, look);
    let encoded = strips::encode(&colours, [image.width, image.height], MOVING_QUALITY);
    encoded.map_err(|error| error.to_string())
}

impl TileScene {
    /// A scene without edits.
    pub fn new(prepared: &PreparedScene, service: &Arc<Service>) -> Self {
        // The first tile has no time to make it.
        DisplayTable::of(View::default());
        let (spec, moved) = (LiveSpec::default(), prepared.clone());
        let ready = Ready { spec, moved, prepared: prepared.clone(), path: None };
        let (prepared, service) = (prepared.clone(), Arc::clone(service));
        Self { prepared, timed: None, service, ready: Mutex::new(ready) }
    }

    /// The same, at any time of its animations.
    pub fn with_times(self, timed: Option<TimedScene>) -> Self {
        Self { timed, ..self }
    }

    /// The scene at the spec's time with its materials, and the rows of a frame that are asked for, with their own
    /// film.
    fn rows(&self, ask: &TileAsk) -> Result<(PreparedScene, PathTracer), String> {
        let mut ready = self.ready.lock().unwrap_or_else(PoisonError::into_inner);
        let spec = LiveSpec::of_tile(&ask.spec, &ask.shaders, &ready.spec)?;
        let camera = spec.camera(&self.prepared.scene)?;
        let settings = spec.spec().settings();
        let is_moved = !ready.spec.has_same_time(&spec);
        if is_moved || !ready.spec.has_same_materials(&spec) {
            let moved = || spec.moved(&self.prepared, self.timed.as_ref());
            let moved = if is_moved { moved()? } else { ready.moved.clone() };
            let prepared = spec.edit(&moved)?;
            *ready = Ready { spec, moved, prepared, path: None };
        }
        let layers = moving_layers(ask.is_denoised);
        let is_right =
            |path: &PathTracer| *path.frame().settings() == settings && *path.frame().aovs() == layers;
        let path = match ready.path.take().filter(is_right) {
            Some(path) => path,
            None => path_tracer(&ready.prepared, &camera, settings, &layers)?,
        };
        let rendered = wider(&ask.rows, settings.height, ask.is_denoised);
        let frame = path.frame().part_seen_by(&camera, part(&settings, rendered));
        let rows = frame.map(|frame| path.with_frame(frame)).map_err(|error| error.to_string());
        ready.path = Some(path);
        Ok((ready.prepared.clone(), rows?))
    }

    /// Renders a tile at interactive priority. `None` if it was no longer wanted before it was ready.
    ///
    /// # Errors
    /// Why it cannot be rendered.
    pub fn tile(&self, ask: &TileAsk, is_wanted: impl Fn() -> bool) -> Result<Option<Tile>, String> {
        let began = Instant::now();
        let (prepared, path) = self.rows(ask)?;
        let path = Arc::new(path);
        let options = JobOptions::default().with_name("live tile").with_priority(Priority::Interactive);
        let job = prepared.submit(&self.service, Arc::clone(&path), options);
        let job = job.map_err(|error| error.to_string())?;
        while !job.wait_for(LOOK) {
            if !is_wanted() {
                // Dropping its handle cancels the job.
                return Ok(None);
            }
        }
        job.wait().map_err(|error| error.to_string())?;
        let image = path.frame().develop_filtered(path.frame().film(), self.service.host_threads());
        let image = cropped(image, path.frame().part().region.y, &ask.rows);
        let look = ask.spec.look.look();
        let light = if ask.is_metered { Light::of(&image) } else { Light::default() };
        let jpeg = Arc::new(jpeg_of(&image, &look)?);
        let seconds = began.elapsed().as_secs_f64();
        let rows = ask.rows.clone();
        Ok(Some(Tile { rows, light: (light.lightness, light.pixels), seconds, jpeg }))
    }
}
