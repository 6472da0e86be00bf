//! A frame: scene, camera, settings and film, which all integrators share.

use super::dropped_splats::DroppedSplats;
use super::frame_layers::FrameLayers;
use super::pixel_filter::FilterTable;
use super::{Blocks, CameraSample, NewRays, Part, Pass, Passable, Settings, SettingsError};
use crate::film::Film;
use crate::geom::{Sampler, mix_lanes};
use crate::lanes::{Int, LaneTask, Lanes, Mask, Num, SimdLevel, SingleLane, Vector};
use crate::scene::{Camera, CameraError, Lens, LensRays, Pinhole, Scene};
use crate::schedule::SceneId;
use crate::shade::bsdf::Smoothness;
use crate::shade::light::Reflectors;
use crate::shade::{Cone, Lights, LitScene};
use crate::stream::Ray;
use std::ops::Range;
use std::sync::Arc;

/// Side of a patch in pixels: the camera rays of a patch are consecutive in a stream.
const PATCH: u32 = 8;

/// The most consecutive samples of a pixel that belong to one half ([`Frame::target`]) if the frame may end early.
const GROUP: u32 = 16;

/// Makes the choice of halves independent of the sampler.
const HALF_SALT: u32 = 0x5be0_cd19;

/// Minimum width of a sample's cone, as a fraction of a pixel. A narrower cone adds no sharpness.
const LEAST_SHARE: f32 = 1.0 / 8.0;

/// A picture to render: a scene, a camera, settings and a film. Frames derived from it share the scene and its
/// lights.
#[derive(Debug)]
pub struct Frame {
    scene: LitScene,
    lens: Lens,
    settings: Settings,
    /// The pixel filter, unless it is the box of one pixel.
    filter: Option<Arc<FilterTable>>,
    film: Arc<Film>,
    dropped: DroppedSplats,
    part: Part,
    pass: Pass,
    simd: SimdLevel,
    layers: Option<Arc<FrameLayers>>,
    /// The surfaces that rays may pass, if there are any.
    passable: Option<Arc<Passable>>,
    /// True if clear walls are among these surfaces.
    passes_panes: bool,
    /// The surfaces in which lamps are sampled, if there are any and the integrator asks for it.
    reflectors: Option<Arc<Reflectors>>,
    mirrors_lamps: bool,
}

impl Frame {
    /// A frame whose integrator adds at most `splats` splats per sample and allows at most `limit` bounces. Its pass
    /// takes all samples.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn new(
        scene: impl Into<LitScene>,
        camera: &Camera,
        settings: Settings,
        limit: u32,
        splats: impl Fn(u32) -> u64,
    ) -> Result<Self, SettingsError> {
        settings.validate(limit)?;
        let Settings { width, height, spp, max_bounces, .. } = settings;
        let lens = camera.lens(width, height)?;
        let film = Arc::new(Film::new(width, height, u64::from(spp) * splats(max_bounces))?);
        let pass = Pass::new(Blocks::new(width, height).in_order(), 0..spp);
        let (dropped, simd) = (DroppedSplats::default(), SimdLevel::detect());
        let filter = FilterTable::of(settings.filter).map(Arc::new);
        let part = Part::whole(&settings);
        let scene = scene.into();
        let passable = Passable::of(scene.scene(), false).map(Arc::new);
        let (layers, passes_panes, reflectors, mirrors_lamps) = (None, false, None, false);
        Ok(Self {
            scene,
            lens,
            settings,
            filter,
            film,
            dropped,
            part,
            pass,
            simd,
            layers,
            passable,
            passes_panes,
            reflectors,
            mirrors_lamps,
        })
    }

    /// A part of the same frame, with its own film. Its pass takes the samples of the part alone. The film has the size
    /// and precision of the whole frame's, so that films of parts can be added; outside the region it has no samples.
    ///
    /// # Errors
    /// If the frame does not have all samples of the part, or the part has none.
    pub fn with_part(&self, part: Part) -> Result<Self, SettingsError> {
        let Settings { width, height, spp, .. } = self.settings;
        if !part.is_of(&self.settings) {
            return Err(SettingsError::Part { part, width, height, spp });
        }
        let blocks = Blocks::new(width, height).within(part.region);
        let pass = Pass::new(blocks.in_order(), part.samples.clone());
        let frame = Self { part, ..self.with_film(self.film.blank()) };
        Ok(Self { pass: frame.whole_pass(pass), ..frame })
    }

    /// The same frame for another camera, with its own film.
    ///
    /// # Errors
    /// If the camera is invalid.
    pub fn seen_by(&self, camera: &Camera) -> Result<Self, CameraError> {
        let lens = camera.lens(self.settings.width, self.settings.height)?;
        Ok(Self { lens, ..self.with_pass(self.pass.clone()) })
    }

    /// [`Frame::with_part`] of the same frame for another camera.
    ///
    /// # Errors
    /// If the frame does not have all samples of the part, or the part has none, or the camera is invalid.
    #[doc(hidden)]
    pub fn part_seen_by(&self, camera: &Camera, part: Part) -> Result<Self, SettingsError> {
        let lens = camera.lens(self.settings.width, self.settings.height)?;
        Ok(Self { lens, ..self.with_part(part)? })
    }

    /// The same frame of the scene with another appearance ([`LitScene::with_scene`]), with its own film.
    pub fn with_scene(&self, scene: &Arc<Scene>) -> Self {
        let passable = Passable::of(scene, self.passes_panes).map(Arc::new);
        let scene = self.scene.with_scene(Arc::clone(scene));
        let reflectors = if self.mirrors_lamps { reflectors(&scene) } else { None };
        Self { scene, passable, reflectors, ..self.with_pass(self.pass.clone()) }
    }

    /// Another pass over the same frame, with its own film, which can be added to this frame's.
    pub fn with_pass(&self, pass: Pass) -> Self {
        Self { pass: self.whole_pass(pass), ..self.with_film(self.film.blank()) }
    }

    /// A pass over this frame at a moment when the scene and the camera are those of another frame. Its film can be
    /// added to this frame's.
    pub fn exposed(&self, moment: &Self, pass: Pass) -> Self {
        let (scene, passable) = (moment.scene.clone(), moment.passable.clone());
        let reflectors = moment.reflectors.clone();
        Self { scene, lens: moment.lens, passable, reflectors, ..self.with_pass(pass) }
    }

    /// The same frame with another film.
    fn with_film(&self, film: Film) -> Self {
        Self {
            scene: self.scene.clone(),
            lens: self.lens,
            settings: self.settings,
            filter: self.filter.clone(),
            film: Arc::new(film),
            dropped: DroppedSplats::default(),
            part: self.part.clone(),
            pass: self.pass.clone(),
            simd: self.simd,
            layers: self.layers.clone(),
            passable: self.passable.clone(),
            passes_panes: self.passes_panes,
            reflectors: self.reflectors.clone(),
            mirrors_lamps: self.mirrors_lamps,
        }
    }

    /// The same frame with these layers, for which the film is made.
    pub(super) fn with_layers(&self, layers: Option<Arc<FrameLayers>>, film: Film) -> Self {
        let frame = Self { layers, ..self.with_film(film) };
        Self { pass: frame.whole_pass(self.pass.clone()), ..frame }
    }

    /// A pass of this frame with all its rays: the one that takes the first samples of the frame's part, or of the step
    /// in the middle if there are several, also takes the rays through the centres of pixels, if a layer needs them.
    pub(super) fn whole_pass(&self, pass: Pass) -> Pass {
        let has_centres = self.layers.as_ref().is_some_and(|layers| layers.aovs.has_centres());
        let first = match self.settings.steps {
            1 => self.part.samples.start,
            steps => self.settings.samples_of_step(steps / 2).start,
        };
        let is_first = pass.samples().start == first;
        pass.with_centres(has_centres && is_first)
    }

    #[inline]
    pub(super) fn layers(&self) -> Option<&Arc<FrameLayers>> {
        self.layers.as_ref()
    }

    pub(super) fn lit_scene(&self) -> &LitScene {
        &self.scene
    }

    /// The same frame, shaded at this SIMD level; with one lane at [`SimdLevel::Scalar`]. The picture is the same.
    pub fn with_simd(self, simd: SimdLevel) -> Self {
        Self { simd, ..self }
    }

    /// The same frame for an integrator that also samples BSDFs: see [`Lights::without_uniform_sky`].
    pub fn without_uniform_sky(self) -> Self {
        Self { scene: self.scene.without_uniform_sky(), ..self }
    }

    /// The same frame for an integrator whose rays pass thin clear walls by chance, each with the share of light that
    /// goes straight on, so that light samples find lamps behind windows. It shades the hits that remain with
    /// [`Frame::smoothness`].
    pub fn passing_panes(self) -> Self {
        let passable = Passable::of(self.scene.scene(), true).map(Arc::new);
        Self { passable, passes_panes: true, ..self }
    }

    /// The same frame for an integrator that also samples lamps as they are mirrored by flat smooth surfaces.
    pub(super) fn mirroring_lamps(self) -> Self {
        let reflectors = reflectors(&self.scene);
        Self { reflectors, mirrors_lamps: true, ..self }
    }

    /// The surfaces in which lamps are sampled, if there are any.
    #[inline]
    pub(super) fn reflectors(&self) -> Option<&Reflectors> {
        self.reflectors.as_deref()
    }

    /// `smoothness` for hits on a material, numbered in the scene: it tells whether rays could have passed it.
    #[inline]
    pub fn smoothness(&self, material: u32, smoothness: Smoothness) -> Smoothness {
        let stayed = self.passable.as_ref().is_some_and(|passable| passable.is_pane(material));
        Smoothness { stayed, ..smoothness }
    }

    #[inline]
    pub(super) fn passable(&self) -> Option<&Passable> {
        self.passable.as_deref()
    }

    /// The SIMD level to shade at.
    pub fn simd(&self) -> SimdLevel {
        self.simd
    }

    /// The cone of camera rays. The samples of a pixel share its width, so pictures of many samples are as sharp as
    /// their textures.
    #[inline]
    pub fn cone(&self) -> Cone<SingleLane> {
        let share = 1.0 / (self.settings.spp as f32).sqrt();
        let [width, spread] = self.lens.cone().map(|size| Num::from(size * share.max(LEAST_SHARE)));
        Cone { width, spread }
    }

    /// The camera with the size of the picture.
    pub fn lens(&self) -> &Lens {
        &self.lens
    }

    /// The scene.
    #[inline]
    pub fn scene(&self) -> &Scene {
        self.scene.scene()
    }

    /// The identity of the scene, for [`crate::schedule::Renderer::scene_id`].
    pub fn scene_id(&self) -> SceneId {
        SceneId::of(self.scene.scene())
    }

    /// Its lights.
    #[inline]
    pub fn lights(&self) -> &Lights {
        self.scene.lights()
    }

    /// The settings.
    #[inline]
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The film that radiance is added to. While a job renders the frame, the film is too dark by what is in flight,
    /// because camera rays count as samples when they are emitted. [`super::Preview`] shows pictures that are right
    /// while [`super::Progressive`] renders.
    #[inline]
    pub fn film(&self) -> &Arc<Film> {
        &self.film
    }

    #[inline]
    pub(super) fn dropped(&self) -> &DroppedSplats {
        &self.dropped
    }

    /// The pixel blocks of the picture, with the pixels of the part's region.
    pub fn blocks(&self) -> Blocks {
        Blocks::new(self.settings.width, self.settings.height).within(self.part.region)
    }

    /// The part of the picture that is rendered: all of it, unless [`Frame::with_part`] says otherwise.
    pub fn part(&self) -> &Part {
        &self.part
    }

    /// The samples that a job takes.
    pub fn pass(&self) -> &Pass {
        &self.pass
    }

    /// Number of tiles in the pass. Each tile takes a few samples of the pixels of some blocks.
    pub fn tiles(&self) -> u64 {
        self.pass.tiles()
    }

    /// Maximum camera rays of a tile.
    pub fn tile_rays(&self) -> usize {
        self.pass.tile_rays(self.blocks())
    }

    /// The sampler of a sample of a pixel.
    pub fn sampler(&self, pixel: u32, sample: u32) -> Sampler {
        Sampler::new(pixel, sample, self.settings.seed)
    }

    /// The pixel to which radiance of a sample is added: a number for [`Frame::splat_lanes`], [`super::Contribution`]
    /// and [`Film::splat`] that also says to which half of the samples it belongs, if the frame has the AOV
    /// [`super::Aov::Variance`].
    #[inline(always)]
    pub fn target<L: Lanes>(&self, pixel: Int<L>, sample: Int<L>) -> Int<L> {
        if self.layers.is_none() || !self.has_halves() { pixel } else { pixel | self.half(pixel, sample) }
    }

    /// [`Frame::target`] of one sample.
    #[inline]
    pub fn target_of(&self, pixel: u32, sample: u32) -> u32 {
        self.target::<SingleLane>(pixel.into(), sample.into()).get()
    }

    #[inline]
    fn has_halves(&self) -> bool {
        self.film.plan().is_some_and(|plan| plan.halves)
    }

    /// [`Film::HALF`] for one half of the samples, 0 for the other.
    ///
    /// The squared difference of two halves estimates the variance of a half less that of all samples
    /// (`docs/lab/noise.md`), so halves should be stratified as well as half of the samples can be: the first and the
    /// second half of the sequence are. If the number of samples is not known, each of the first samples must have a
    /// counterpart soon. Then a half has groups of up to [`GROUP`] consecutive samples, and a random bit decides which
    /// of two neighbouring groups belongs to which half. If samples are of several steps, each of these has both
    /// halves: what moves between steps is no noise.
    #[inline(always)]
    fn half<L: Lanes>(&self, pixel: Int<L>, sample: Int<L>) -> Int<L> {
        let Settings { spp, may_end_early, steps, .. } = self.settings;
        if !may_end_early {
            let l = sample.lanes();
            let mut all = 0..spp;
            if steps > 1 {
                all = self.settings.samples_of_step(self.settings.step_of(self.pass.samples().start));
            }
            return Int::select(
                sample.below(all.end - (all.end - all.start) / 2),
                Int::splat(l, 0),
                Int::splat(l, Film::HALF),
            );
        }
        let bits = (spp / 2).clamp(1, GROUP).ilog2();
        let group = sample >> bits;
        let turned = mix_lanes(pixel ^ mix_lanes((group >> 1) ^ HALF_SALT));
        ((group ^ turned) & 1) << 31
    }

    /// Counts the samples of a pixel on the film.
    #[inline]
    fn count_samples(&self, pixel: u32, samples: &Range<u32>) {
        self.film.add_samples(pixel, samples.len() as u32);
        if self.has_halves() {
            let marked = samples.clone().filter(|&sample| self.target_of(pixel, sample) != pixel).count();
            self.film.add_half_samples(pixel, marked as u32);
        }
    }

    /// Generates the camera rays of a tile, passes them in groups to `emit` with their pixels and samples, and counts
    /// them on the film. Rays through the centres of pixels ([`CameraSample::CENTRE`]) are not counted. Tiles cover the
    /// picture once for every few samples, so a frame that stops early is even. Dimension [`CAMERA_DIMENSION`] of the
    /// sampler is the position in the pixel filter. A sample for which the lens has no ray counts, and stays black.
    pub fn camera_rays(&self, tile: u64, mut emit: impl FnMut(&[Ray], &[u32], &[u32])) {
        let blocks = self.blocks();
        let (places, samples) = self.pass.tile(tile);
        for &block in places {
            let (columns, rows) = blocks.pixels(block);
            for top in rows.clone().step_by(PATCH as usize) {
                for left in columns.clone().step_by(PATCH as usize) {
                    let size = [(columns.end - left).min(PATCH), (rows.end - top).min(PATCH)];
                    let patch = Patch { frame: self, samples: samples.clone(), corner: [left, top], size };
                    let emit = &mut emit;
                    match self.lens.pinhole() {
                        Some(optics) => self.simd.run(PatchRays { patch, optics, emit }),
                        None => self.simd.run(PatchRays { patch, optics: &self.lens, emit }),
                    }
                }
            }
        }
    }
}

/// The surfaces of a scene in which lamps are sampled.
fn reflectors(scene: &LitScene) -> Option<Arc<Reflectors>> {
    if scene.lights().emitters().is_empty() {
        return None;
    }
    Reflectors::of(scene.scene()).map(Arc::new)
}

/// Some pixels of a pixel block.
struct Patch<'a> {
    frame: &'a Frame,
    samples: Range<u32>,
    corner: [u32; 2],
    /// At least 1, at most [`PATCH`].
    size: [u32; 2],
}

/// The camera rays of a patch: all samples of a pixel, then those of the next pixel in its row.
struct PatchRays<'a, O, E> {
    patch: Patch<'a>,
    optics: O,
    emit: &'a mut E,
}

/// Source of camera rays. A pinhole has code of its own.
trait Optics {
    /// True if there is a ray through every point of the picture.
    const SEES_ALL: bool;

    /// The rays through points of pixels. The sampler chooses points of the aperture; without it all rays pass the
    /// middle of the lens.
    fn rays<L: Lanes>(
        &self,
        x: Num<L>,
        y: Num<L>,
        place: [Num<L>; 2],
        sampler: Option<&Sampler<L>>,
    ) -> LensRays<L>;
}

impl Optics for Pinhole {
    const SEES_ALL: bool = true;

    #[inline(always)]
    fn rays<L: Lanes>(
        &self,
        x: Num<L>,
        y: Num<L>,
        place: [Num<L>; 2],
        _: Option<&Sampler<L>>,
    ) -> LensRays<L> {
        let l = x.lanes();
        let (origin, direction) = (Vector::splat(l, self.eye), self.directions(x, y, place));
        LensRays { origin, direction, exist: Mask::splat(l, true) }
    }
}

impl Optics for &Lens {
    const SEES_ALL: bool = false;

    #[inline(always)]
    fn rays<L: Lanes>(
        &self,
        x: Num<L>,
        y: Num<L>,
        place: [Num<L>; 2],
        sampler: Option<&Sampler<L>>,
    ) -> LensRays<L> {
        let mut through = None;
        if let Some(sampler) = sampler
            && self.has_aperture()
        {
            through = Some(sampler.two(Int::splat(x.lanes(), APERTURE_DIMENSION)));
        }
        Lens::rays(self, x, y, place, through)
    }
}

impl<O: Optics, E: FnMut(&[Ray], &[u32], &[u32])> LaneTask for PatchRays<'_, O, E> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) {
        let Patch { frame, samples, corner: [left, top], size } = self.patch;
        let Settings { width, seed, .. } = frame.settings;
        let (mut x, mut y, mut sample) = (left, top, samples.start);
        let mut todo = size[0] * size[1] * samples.len() as u32;
        let is_centre = samples.start == CameraSample::CENTRE;
        while todo > 0 {
            let (mut xs, mut ys, mut taken) = (L::array(0), L::array(0), L::array(0));
            let lanes = todo.min(L::LANES as u32);
            todo -= lanes;
            for lane in 0..lanes as usize {
                (xs[lane], ys[lane], taken[lane]) = (x, y, sample);
                sample += 1;
                if sample == samples.end {
                    if !is_centre {
                        frame.count_samples(y * width + x, &samples);
                    }
                    sample = samples.start;
                    x += 1;
                    if x == left + size[0] {
                        (x, y) = (left, y + 1);
                    }
                }
            }
            let (x, y) = (Int::from_array(l, &xs), Int::from_array(l, &ys));
            let pixel = y * width + x;
            let sampler = Sampler::of(pixel, Int::from_array(l, &taken), seed);
            let mut place = sampler.two(Int::splat(l, CAMERA_DIMENSION));
            if is_centre {
                place = [Num::splat(l, 0.5); 2];
            } else if let Some(filter) = &frame.filter {
                place = filter.positions(place);
            }
            // Without a sampler all rays pass the middle of the lens.
            let through = if is_centre { None } else { Some(&sampler) };
            let rays = self.optics.rays(x.to_num(), y.to_num(), place, through);
            let mut pixels = pixel.to_array();
            let mut lanes = lanes as usize;
            let exist = rays.exist;
            let rays = NewRays::new(rays.origin, rays.direction).rows(exist);
            if !O::SEES_ALL && !exist.all() {
                let there = exist & Mask::first(l, lanes);
                lanes = pixel.append(there, pixels.as_mut());
                Int::from_array(l, &taken.clone()).append(there, taken.as_mut());
            }
            let (rays, pixels) = (&rays.as_ref()[..lanes], &pixels.as_ref()[..lanes]);
            (self.emit)(bytemuck::cast_slice(rays), pixels, &taken.as_ref()[..lanes]);
        }
    }
}

/// Sampler dimension of the position in the pixel filter; integrators use greater dimensions.
pub const CAMERA_DIMENSION: u32 = 0;

/// Sampler dimension of the position in the aperture of a thin lens. No integrator reaches it.
pub const APERTURE_DIMENSION: u32 = 1 << 30;
