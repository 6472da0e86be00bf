//! Finishes of procedural surfaces, computed for blocks of hits before these hits are shaded. A pattern in WGSL pays
//! for choosing each of its operations once a block instead of once in 8 or 16 hits.

use super::{Hits, Interaction};
use crate::lanes::{Int, Lanes, Num, OutlinedTask, Vector};
use crate::scene::{
    BlockColumns, BlockFinishes, BlockSurface, Material, OwnSurface, PointSink, Points, Scene, Surface,
    WantedFields,
};
use std::cell::Cell;

/// The source of a batch's hits for blocks.
pub trait HitSource {
    /// Unit directions of rays, their hits, and the widths of their cones there.
    fn hits<L: Lanes>(&self, ids: Int<L>) -> (Vector<L>, Hits<L>, Num<L>);
}

/// The finishes of a run of hits on one material, a block at a time.
#[derive(Debug)]
pub struct FinishBlocks<'s> {
    scene: &'s Scene,
    material: &'s Material,
    surface: &'s dyn BlockSurface,
    own: Option<&'s OwnSurface>,
    columns: Box<Columns>,
    /// Points of the present block, counted from the start of the run.
    begin: usize,
    end: usize,
}

#[derive(Debug, Default)]
struct Columns {
    points: BlockColumns,
    finishes: BlockColumns,
}

thread_local! {
    /// The columns of the run before, so that none are allocated while a frame is rendered.
    static SPARE: Cell<Option<Box<Columns>>> = const { Cell::new(None) };
}

impl<'s> FinishBlocks<'s> {
    /// The blocks of a run on a material; `None` if its surface is not computed in blocks.
    pub fn of(scene: &'s Scene, material: &'s Material) -> Option<Self> {
        let Surface::Procedural(index) = material.surface else { return None };
        let procedural = &scene.procedurals[index as usize];
        let surface = procedural.in_blocks()?;
        let mut columns = SPARE.take().unwrap_or_default();
        columns.points.for_points(surface.wanted(), surface.block());
        columns.finishes.for_finishes(surface.block());
        Some(Self { scene, material, surface, own: procedural.own(), columns, begin: 0, end: 0 })
    }

    /// The finishes for the rays of a run from index `at` on, one in each lane, if the run has blocks. `at` grows from
    /// call to call.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn reach<'a, L: Lanes>(
        blocks: &'a mut Option<Self>,
        l: L,
        rays: &[u32],
        at: usize,
        source: &impl HitSource,
    ) -> Option<BlockFinishes<'a>> {
        let blocks = blocks.as_mut()?;
        if at >= blocks.end {
            blocks.begin = at;
            blocks.end = rays.len().min(at + blocks.surface.block());
            l.outlined(Filling { rays: &rays[at..blocks.end], blocks, source });
        }
        Some(BlockFinishes { columns: &blocks.columns.finishes, at: at - blocks.begin })
    }
}

impl Drop for FinishBlocks<'_> {
    fn drop(&mut self) {
        SPARE.set(Some(std::mem::take(&mut self.columns)));
    }
}

/// Computes the next block.
struct Filling<'a, 's, S> {
    blocks: &'a mut FinishBlocks<'s>,
    rays: &'a [u32],
    source: &'a S,
}

impl<L: Lanes, S: HitSource> OutlinedTask<L> for Filling<'_, '_, S> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, l: L) {
        let Self { blocks: FinishBlocks { scene, material, surface, own, columns, .. }, rays, source } = self;
        let Columns { points, finishes } = &mut **columns;
        for (i, some) in rays.chunks(L::LANES).enumerate() {
            let (ids, _) = Int::some(l, some, some[0]);
            let sink = &mut points.sink(i * L::LANES, L::LANES);
            let wanted = surface.wanted();
            l.outlined(Seeing { scene, material, own: *own, hits: source.hits(ids), wanted, sink });
        }
        surface.compute(L::LANES, rays.len(), points, finishes);
    }
}

/// Computes what a surface wants to know of some hits: [`HitSource::hits`]. It is the same for all sources.
struct Seeing<'a, 's, L: Lanes> {
    scene: &'s Scene,
    material: &'s Material,
    own: Option<&'s OwnSurface>,
    hits: (Vector<L>, Hits<L>, Num<L>),
    wanted: WantedFields<'a>,
    sink: &'a mut dyn PointSink,
}

impl<L: Lanes> OutlinedTask<L> for Seeing<'_, '_, L> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) {
        let Self { scene, material, own, hits: (direction, hits, width), wanted, sink } = self;
        let at = Interaction::without_finish(scene, material, direction, &hits, width);
        Points { own, ..at.points(scene) }.write_to(wanted, sink);
    }
}
