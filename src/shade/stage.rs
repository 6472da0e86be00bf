//! Procedural surfaces computed for blocks of hits before these hits are shaded. Such a surface (one in WGSL) pays for
//! choosing each of its operations once a block instead of once in 8 or 16 hits.

use super::{Hits, Interaction};
use crate::lanes::{Int, Lanes, Num, OutlinedTask, Vector};
use crate::scene::{BlockColumns, BlockSurface, Material, Scene, StagedFinish, Surface};
use std::cell::Cell;

/// Where a stage finds the hits of a batch.
pub trait HitSource {
    /// Unit directions of rays, their hits, and the widths of their cones there.
    fn hits<L: Lanes>(&self, ids: Int<L>) -> (Vector<L>, Hits<L>, Num<L>);
}

/// The finishes of a run of hits on one material, a block at a time.
#[derive(Debug)]
pub struct Stage<'s> {
    scene: &'s Scene,
    material: &'s Material,
    surface: &'s dyn BlockSurface,
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
    /// The stage of a material; `None` if its surface is not computed in blocks.
    pub fn of(scene: &'s Scene, material: &'s Material) -> Option<Self> {
        let Surface::Procedural(index) = material.surface else { return None };
        let surface = scene.procedurals[index as usize].in_blocks()?;
        let mut columns = SPARE.take().unwrap_or_default();
        let block = surface.block();
        columns.points.for_points(block);
        columns.finishes.for_finishes(block);
        Some(Self { scene, material, surface, columns, block, begin: 0, end: 0 })
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
        let Stage { scene, material, surface, columns, begin, end, .. } = stage;
        let wanted = surface.wanted();
        let rays = &rays[..*end - *begin];
        for (i, some) in rays.chunks(L::LANES).enumerate() {
            let (ids, _) = Int::some(l, some, some[0]);
            let (direction, hits, width) = source.hits(ids);
            let at = Interaction::without_finish(scene, material, direction, &hits, width);
            at.points(scene).write_to(wanted, &mut columns.points.sink(i * L::LANES, L::LANES));
        }
        surface.compute(L::LANES, rays.len(), &columns.points, &mut columns.finishes);
    }
}
