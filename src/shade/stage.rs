//! Surfaces computed for blocks of hits before these hits are shaded. A procedural surface in WGSL pays for choosing
//! each of its operations once a block instead of once in 8 or 16 hits.
//!
//! A device may compute the hits of a whole stream first ([`StageStream`]): finishes of procedural surfaces, and what
//! BSDFs answer to shaders that know beforehand what they will ask. Each ray then has a row of words: the number of the
//! surface, or 0, and the scalars of the results that vary. [`Stage`] reads them.

use super::{Hits, Interaction, sort};
use crate::lanes::{Int, LaneTask, Lanes, Num, OutlinedTask, Vector};
use crate::scene::{
    Asked, BlockColumns, BlockSurface, DeviceCost, DeviceSurface, Material, Scene, Staged, Surface,
};
use crate::stream::Hit;
use std::borrow::Cow;
use std::cell::Cell;

/// The most hits that a device computes at once.
const STREAM_BLOCK: usize = 1 << 15;

/// Hits of a block whose answers a device has computed.
const ANSWERED_BLOCK: usize = 256;

/// Where a stage finds the hits of a batch.
pub trait HitSource {
    /// True if it tells what BSDFs will be asked.
    const ASKS: bool = false;

    /// Unit directions of rays, their hits, and the widths of their cones there.
    fn hits<L: Lanes>(&self, ids: Int<L>) -> (Vector<L>, Hits<L>, Num<L>);

    /// True if the shader will ask the BSDF at the hit of a ray.
    #[inline(always)]
    fn asks(&self, _ray: u32) -> bool {
        Self::ASKS
    }

    /// What the shader will ask the BSDF at hits on a material; `None` if it does not know.
    #[inline(always)]
    fn asked<L: Lanes>(&self, _: Int<L>, _: &Material, _: &Interaction<L>) -> Option<Asked<L>> {
        None
    }
}

/// How the hits on a material are computed in blocks.
#[derive(Clone, Copy, Debug)]
enum Way<'s> {
    /// A procedural surface, by the host or a device.
    Finishes(&'s dyn BlockSurface),
    /// A BSDF, by a device.
    Answers(&'s dyn DeviceSurface),
}

impl<'s> Way<'s> {
    /// The number of a material's surface in rows, and how it is computed; `None` if not in blocks. BSDFs only if
    /// `asks` is true.
    fn of(scene: &'s Scene, material: &Material, asks: bool) -> Option<(u32, Self)> {
        match material.surface {
            Surface::Procedural(index) => {
                Some((index + 1, Self::Finishes(scene.procedurals[index as usize].in_blocks()?)))
            }
            Surface::Scattering(index) if asks => {
                Some((!index, Self::Answers(scene.scatterings[index as usize].on_device()?)))
            }
            _ => None,
        }
    }

    fn device(self) -> Option<&'s dyn DeviceSurface> {
        match self {
            Self::Finishes(surface) => surface.on_device(),
            Self::Answers(device) => Some(device),
        }
    }

    fn wanted(self) -> u64 {
        match self {
            Self::Finishes(surface) => surface.wanted(),
            Self::Answers(device) => device.wanted(),
        }
    }

    /// The most hits of a block that is shaded.
    fn block(self) -> usize {
        match self {
            Self::Finishes(surface) => surface.block(),
            Self::Answers(_) => ANSWERED_BLOCK,
        }
    }
}

/// What a device has computed for the rays of a batch: a row of words for each, or nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct StagedRows<'a> {
    words: &'a [u32],
    width: usize,
}

impl<'a> StagedRows<'a> {
    /// The rows of as many rays; `words` may be empty.
    pub fn new(words: &'a [u32], rays: usize) -> Self {
        Self { words, width: words.len() / rays.max(1) }
    }

    fn row(&self, ray: u32) -> &'a [u32] {
        &self.words[ray as usize * self.width..][..self.width]
    }
}

/// What has been computed for a run of hits on one material, a block at a time.
#[derive(Debug)]
pub struct Stage<'s> {
    scene: &'s Scene,
    material: &'s Material,
    way: Way<'s>,
    /// What stands first in the rows of the surface's hits.
    number: u32,
    rows: StagedRows<'s>,
    columns: Box<Columns>,
    /// The most points of a block.
    block: usize,
    /// Points of the present block, counted from the start of the run.
    begin: usize,
    end: usize,
    /// True if they are computed.
    is_computed: bool,
}

#[derive(Debug, Default)]
struct Columns {
    points: BlockColumns,
    results: BlockColumns,
}

thread_local! {
    /// The columns of the stage before, so that none are allocated while a frame is rendered.
    static SPARE: Cell<Option<Box<Columns>>> = const { Cell::new(None) };
}

impl<'s> Stage<'s> {
    /// The stage of a material; `None` if its surface is not computed in blocks. `rows` are those of the batch.
    pub fn of<S: HitSource>(scene: &'s Scene, material: &'s Material, rows: StagedRows<'s>) -> Option<Self> {
        let (number, way) = Way::of(scene, material, S::ASKS)?;
        Some(Self::with_block(scene, material, (number, way), way.block(), rows))
    }

    fn with_block(
        scene: &'s Scene,
        material: &'s Material,
        (number, way): (u32, Way<'s>),
        block: usize,
        rows: StagedRows<'s>,
    ) -> Self {
        let mut columns = SPARE.take().unwrap_or_default();
        columns.points.for_points(block);
        columns.results.for_results(block);
        Self { scene, material, way, number, rows, columns, block, begin: 0, end: 0, is_computed: false }
    }

    /// The results for the rays of a run from index `at` on, one in each lane, if there are any. `at` grows from call
    /// to call.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn reach<'a, L: Lanes>(
        stage: &'a mut Option<Self>,
        l: L,
        rays: &[u32],
        at: usize,
        source: &impl HitSource,
    ) -> Option<Staged<'a>> {
        let stage = stage.as_mut()?;
        if at >= stage.end {
            stage.begin = at;
            stage.end = rays.len().min(at + stage.block);
            l.outlined(Filling { stage, rays: &rays[at..], source });
        }
        stage.is_computed.then_some(Staged { columns: &stage.columns.results, at: at - stage.begin })
    }

    /// The hits of some rays.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn interaction<L: Lanes>(&self, ids: Int<L>, source: &impl HitSource) -> Interaction<L> {
        let (direction, hits, width) = source.hits(ids);
        Interaction::without_finish(self.scene, self.material, direction, &hits, width)
    }

    /// Computes the points of some rays.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn compute_points<L: Lanes>(&mut self, l: L, rays: &[u32], source: &impl HitSource) {
        let wanted = self.way.wanted();
        for (i, some) in rays.chunks(L::LANES).enumerate() {
            let (ids, _) = Int::some(l, some, some[0]);
            let at = self.interaction(ids, source);
            at.points(self.scene).write_to(wanted, &mut self.columns.points.sink(i * L::LANES, L::LANES));
        }
    }

    /// Computes the points of some rays, and what the BSDF is asked there.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn compute_asked<L: Lanes>(&mut self, l: L, rays: &[u32], source: &impl HitSource) {
        let wanted = self.way.wanted();
        for (i, some) in rays.chunks(L::LANES).enumerate() {
            let (ids, _) = Int::some(l, some, some[0]);
            let at = self.interaction(ids, source);
            at.points(self.scene).write_to(wanted, &mut self.columns.points.sink(i * L::LANES, L::LANES));
            if let Some(asked) = source.asked(ids, self.material, &at) {
                self.columns.points.set_asked(i * L::LANES, &asked);
            }
        }
    }

    /// Reads results from the rows of some rays; returns whether a device has computed all of them.
    fn read_rows(&mut self, device: &dyn DeviceSurface, rays: &[u32]) -> bool {
        let Self { rows, number, columns, .. } = self;
        let is_staged = rows.width > 0 && rays.iter().all(|&ray| rows.row(ray)[0] == *number);
        device.count(is_staged);
        if is_staged {
            for (place, &scalar) in (1..).zip(device.varying()) {
                let column = columns.results.column_mut(scalar as usize);
                for (number, &ray) in column.iter_mut().zip(rays) {
                    *number = f32::from_bits(rows.row(ray)[place]);
                }
            }
            device.fill_others(rays.len(), &mut columns.results);
        }
        is_staged
    }

    /// Writes the rows of some rays, whose results a device has computed.
    fn write_rows(&self, device: &dyn DeviceSurface, rays: &[u32], words: &mut [u32], width: usize) {
        for &ray in rays {
            words[ray as usize * width] = self.number;
        }
        for (place, &scalar) in (1..).zip(device.varying()) {
            for (number, &ray) in self.columns.results.column(scalar as usize).iter().zip(rays) {
                words[ray as usize * width + place] = number.to_bits();
            }
        }
    }
}

impl Drop for Stage<'_> {
    fn drop(&mut self) {
        SPARE.set(Some(std::mem::take(&mut self.columns)));
    }
}

/// Computes the next block.
struct Filling<'a, 's, S> {
    stage: &'a mut Stage<'s>,
    rays: &'a [u32],
    source: &'a S,
}

impl<L: Lanes, S: HitSource> OutlinedTask<L> for Filling<'_, '_, S> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, l: L) {
        let Self { stage, rays, source } = self;
        let rays = &rays[..stage.end - stage.begin];
        let surface = match stage.way {
            Way::Finishes(surface) => surface,
            Way::Answers(device) => {
                let asks = rays.iter().any(|&ray| source.asks(ray));
                stage.is_computed = asks && stage.read_rows(device, rays);
                return;
            }
        };
        stage.is_computed = surface.on_device().is_some_and(|device| stage.read_rows(device, rays));
        if stage.is_computed {
            return;
        }
        stage.compute_points(l, rays, source);
        let Columns { points, results } = &mut *stage.columns;
        surface.compute(L::LANES, rays.len(), points, results);
        stage.is_computed = true;
    }
}

/// Words of a row for each ray of such a source, for what devices compute of a scene; 0 without devices.
pub fn staged_words<S: HitSource>(scene: &Scene) -> usize {
    let finishes = scene.procedurals.iter().filter_map(|surface| surface.in_blocks()?.on_device());
    let answers = scene.scatterings.iter().filter_map(|surface| surface.on_device()).filter(|_| S::ASKS);
    let words =
        finishes.chain(answers).filter(|device| device.is_sound()).map(|device| 1 + device.varying().len());
    words.max().unwrap_or(0)
}

/// Has devices compute the surfaces at a stream's hits: fills the rows of its rays, which are all 0. Returns what it
/// cost, or why a device failed.
#[derive(Debug)]
pub struct StageStream<'a, S> {
    /// The scene.
    pub scene: &'a Scene,
    /// The hits of the stream.
    pub hits: &'a [Hit],
    /// The same with what points need.
    pub source: &'a S,
    /// As many words for each ray.
    pub words: &'a mut [u32],
}

impl<S: HitSource> LaneTask for StageStream<'_, S> {
    type Output = Result<DeviceCost, String>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) -> Self::Output {
        let Self { scene, hits, source, words } = self;
        let width = words.len() / hits.len().max(1);
        let mut cost = DeviceCost::default();
        for run in sort(l, hits, scene).runs() {
            let Some(material) = run.material.map(|number| &scene.materials[number as usize]) else {
                continue;
            };
            let Some((number, way)) = Way::of(scene, material, S::ASKS) else { continue };
            // What has become a device's since the job began may need more words.
            let fits = |device: &&dyn DeviceSurface| device.is_sound() && device.varying().len() < width;
            let Some(device) = way.device().filter(fits) else { continue };
            let mut rays = Cow::Borrowed(run.rays);
            if let Way::Answers(_) = way {
                // Their rows are the surface's even where it is not asked and nothing is computed.
                run.rays.iter().for_each(|&ray| words[ray as usize * width] = number);
                rays.to_mut().retain(|&ray| source.asks(ray));
            }
            if rays.is_empty() {
                continue;
            }
            let block = rays.len().next_multiple_of(L::LANES).min(STREAM_BLOCK);
            let rows = StagedRows::default();
            let mut stage = Stage::with_block(scene, material, (number, way), block, rows);
            for rays in rays.chunks(STREAM_BLOCK) {
                l.outlined(Pointing { stage: &mut stage, rays, source });
                let Columns { points, results } = &mut *stage.columns;
                cost += device.compute(rays.len(), points, results)?;
                stage.write_rows(device, rays, words, width);
            }
        }
        Ok(cost)
    }
}

/// Computes the points of a block for a device.
struct Pointing<'a, 's, S> {
    stage: &'a mut Stage<'s>,
    rays: &'a [u32],
    source: &'a S,
}

impl<L: Lanes, S: HitSource> OutlinedTask<L> for Pointing<'_, '_, S> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, l: L) {
        let Self { stage, rays, source } = self;
        match stage.way {
            Way::Finishes(_) => stage.compute_points(l, rays, source),
            Way::Answers(_) => stage.compute_asked(l, rays, source),
        }
    }
}
