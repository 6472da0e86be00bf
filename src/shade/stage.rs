//! Procedural surfaces computed for blocks of hits before these hits are shaded. Such a surface (one in WGSL) pays for
//! choosing each of its operations once a block instead of once in 8 or 16 hits.
//!
//! A device may compute the hits of a whole stream first ([`StageStream`]). Each ray then has a row of words: the
//! number of the surface, or 0, and the scalars of the finish that vary. [`Stage`] reads them instead of computing.

use super::{Hits, Interaction, sort};
use crate::lanes::{Int, LaneTask, Lanes, Num, OutlinedTask, Vector};
use crate::scene::{
    BlockColumns, BlockSurface, DeviceCost, DeviceSurface, Material, Scene, StagedFinish, Surface,
};
use crate::stream::Hit;
use std::cell::Cell;

/// The most hits that a device computes at once.
const STREAM_BLOCK: usize = 1 << 15;

/// Where a stage finds the hits of a batch.
pub trait HitSource {
    /// Unit directions of rays, their hits, and the widths of their cones there.
    fn hits<L: Lanes>(&self, ids: Int<L>) -> (Vector<L>, Hits<L>, Num<L>);
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

/// The finishes of a run of hits on one material, a block at a time.
#[derive(Debug)]
pub struct Stage<'s> {
    scene: &'s Scene,
    material: &'s Material,
    surface: &'s dyn BlockSurface,
    /// What stands first in the rows of the surface's hits.
    number: u32,
    rows: StagedRows<'s>,
    columns: Box<Columns>,
    /// The most points of a block.
    block: usize,
    /// Points that are computed, counted from the start of the run.
    begin: usize,
    end: usize,
}

#[derive(Debug, Default)]
struct Columns {
    points: BlockColumns,
    finishes: BlockColumns,
}

thread_local! {
    /// The columns of the stage before, so that none are allocated while a frame is rendered.
    static SPARE: Cell<Option<Box<Columns>>> = const { Cell::new(None) };
}

impl<'s> Stage<'s> {
    /// The stage of a material; `None` if its surface is not computed in blocks. `rows` are those of the batch.
    pub fn of(scene: &'s Scene, material: &'s Material, rows: StagedRows<'s>) -> Option<Self> {
        let Surface::Procedural(index) = material.surface else { return None };
        let surface = scene.procedurals[index as usize].in_blocks()?;
        Some(Self::with_block(scene, material, (index, surface), surface.block(), rows))
    }

    fn with_block(
        scene: &'s Scene,
        material: &'s Material,
        (index, surface): (u32, &'s dyn BlockSurface),
        block: usize,
        rows: StagedRows<'s>,
    ) -> Self {
        let mut columns = SPARE.take().unwrap_or_default();
        columns.points.for_points(block);
        columns.finishes.for_finishes(block);
        Self { scene, material, surface, number: index + 1, rows, columns, block, begin: 0, end: 0 }
    }

    /// The finishes of the rays of a run from index `at` on, one in each lane, if there is a stage. `at` grows from
    /// call to call.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn reach<'a, L: Lanes>(
        stage: &'a mut Option<Self>,
        l: L,
        rays: &[u32],
        at: usize,
        source: &impl HitSource,
    ) -> Option<StagedFinish<'a>> {
        let stage = stage.as_mut()?;
        if at >= stage.end {
            stage.begin = at;
            stage.end = rays.len().min(at + stage.block);
            l.outlined(Filling { stage, rays: &rays[at..], source });
        }
        Some(StagedFinish { columns: &stage.columns.finishes, at: at - stage.begin })
    }

    /// Computes the points of some rays.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn compute_points<L: Lanes>(&mut self, l: L, rays: &[u32], source: &impl HitSource) {
        let wanted = self.surface.wanted();
        for (i, some) in rays.chunks(L::LANES).enumerate() {
            let (ids, _) = Int::some(l, some, some[0]);
            let (direction, hits, width) = source.hits(ids);
            let at = Interaction::without_finish(self.scene, self.material, direction, &hits, width);
            at.points(self.scene).write_to(wanted, &mut self.columns.points.sink(i * L::LANES, L::LANES));
        }
    }

    /// Reads finishes from the rows of some rays; returns whether a device has computed all of them.
    fn read_rows(&mut self, device: &dyn DeviceSurface, rays: &[u32]) -> bool {
        let Self { rows, number, columns, .. } = self;
        let is_staged = rows.width > 0 && rays.iter().all(|&ray| rows.row(ray)[0] == *number);
        device.count(is_staged);
        if is_staged {
            for (place, &scalar) in (1..).zip(device.varying()) {
                let column = columns.finishes.column_mut(scalar as usize);
                for (number, &ray) in column.iter_mut().zip(rays) {
                    *number = f32::from_bits(rows.row(ray)[place]);
                }
            }
            device.fill_others(rays.len(), &mut columns.finishes);
        }
        is_staged
    }

    /// Writes the rows of some rays, whose finishes a device has computed.
    fn write_rows(&self, device: &dyn DeviceSurface, rays: &[u32], words: &mut [u32], width: usize) {
        for &ray in rays {
            words[ray as usize * width] = self.number;
        }
        for (place, &scalar) in (1..).zip(device.varying()) {
            for (number, &ray) in self.columns.finishes.column(scalar as usize).iter().zip(rays) {
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
        if stage.surface.on_device().is_some_and(|device| stage.read_rows(device, rays)) {
            return;
        }
        stage.compute_points(l, rays, source);
        let Columns { points, finishes } = &mut *stage.columns;
        stage.surface.compute(L::LANES, rays.len(), points, finishes);
    }
}

/// Words of a row for each ray, for what devices compute of a scene; 0 without devices.
pub fn staged_words(scene: &Scene) -> usize {
    let surfaces = scene.procedurals.iter().filter_map(|surface| surface.in_blocks()?.on_device());
    let words = surfaces.filter(|device| device.is_sound()).map(|device| 1 + device.varying().len());
    words.max().unwrap_or(0)
}

/// Has devices compute the finishes of a stream's hits: fills the rows of its rays, which are all 0. Returns what it
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
            let Surface::Procedural(index) = material.surface else { continue };
            let Some(surface) = scene.procedurals[index as usize].in_blocks() else { continue };
            // What has become a device's since the job began may need more words.
            let fits = |device: &&dyn DeviceSurface| device.is_sound() && device.varying().len() < width;
            let Some(device) = surface.on_device().filter(fits) else { continue };
            let block = run.rays.len().next_multiple_of(L::LANES).min(STREAM_BLOCK);
            let rows = StagedRows::default();
            let mut stage = Stage::with_block(scene, material, (index, surface), block, rows);
            for rays in run.rays.chunks(STREAM_BLOCK) {
                l.outlined(Pointing { stage: &mut stage, rays, source });
                let Columns { points, finishes } = &mut *stage.columns;
                cost += device.compute(rays.len(), points, finishes)?;
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
        self.stage.compute_points(l, self.rays, self.source);
    }
}
