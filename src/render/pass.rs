//! Passes: which samples of a frame a job takes.

use super::CameraSample;
use crate::film::Region;
use std::ops::Range;
use std::sync::Arc;

/// Side of a pixel block, in pixels. Small blocks place samples precisely; a few hundred pixels suffice to estimate
/// noise.
pub const BLOCK: u32 = 16;

/// Samples of a tile, summed over its blocks: 64² camera rays. RA's tiles have 128²; a quarter of that is still in the
/// cache when it is traced.
const TILE_BLOCKS: usize = 16;

/// Maximum samples that a tile takes of each pixel. The rays of a pixel are consecutive and the most coherent: their
/// packets are narrow, and they hit the same surfaces and splat to the same pixel.
const TOGETHER: u32 = 16;

/// A picture divided into blocks of [`BLOCK`]² pixels, fewer at its right and lower edges, numbered row by row.
/// Adaptive sampling decides for each block whether it needs more samples. A region cuts the blocks at its edges, and
/// blocks outside have no pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Blocks {
    width: u32,
    height: u32,
    region: Region,
}

impl Blocks {
    /// The blocks of a picture of `width` × `height` pixels.
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, region: Region::whole(width, height) }
    }

    /// The same blocks with the pixels of a region alone. Their numbers are the same.
    pub fn within(self, region: Region) -> Self {
        Self { region, ..self }
    }

    /// Number of blocks of the whole picture.
    pub fn count(self) -> usize {
        self.columns() as usize * self.height.div_ceil(BLOCK) as usize
    }

    fn columns(self) -> u32 {
        self.width.div_ceil(BLOCK)
    }

    /// Columns and rows of a block's pixels in the region. Both are empty if there are none.
    pub fn pixels(self, block: u32) -> (Range<u32>, Range<u32>) {
        let (left, top) = (block % self.columns() * BLOCK, block / self.columns() * BLOCK);
        let (right, bottom) = ((left + BLOCK).min(self.width), (top + BLOCK).min(self.height));
        let (columns, rows) = (self.region.columns(), self.region.rows());
        let columns = left.max(columns.start)..right.min(columns.end);
        let rows = top.max(rows.start)..bottom.min(rows.end);
        if columns.is_empty() || rows.is_empty() { (left..left, top..top) } else { (columns, rows) }
    }

    /// A block's pixel indices, row by row.
    pub fn indices(self, block: u32) -> impl Iterator<Item = usize> {
        let (columns, rows) = self.pixels(block);
        rows.flat_map(move |y| columns.clone().map(move |x| y as usize * self.width as usize + x as usize))
    }

    /// True if a block has pixels in the region.
    pub fn has(self, block: u32) -> bool {
        !self.pixels(block).0.is_empty()
    }

    /// A block and its neighbours, fewer at the edges of the region.
    pub fn around(self, block: u32) -> impl Iterator<Item = u32> {
        let (columns, rows) = (self.columns(), self.count() as u32 / self.columns());
        let (x, y) = (block % columns, block / columns);
        let row = move |y| (x.saturating_sub(1)..=(x + 1).min(columns - 1)).map(move |x| y * columns + x);
        (y.saturating_sub(1)..=(y + 1).min(rows - 1)).flat_map(row).filter(move |&block| self.has(block))
    }

    /// All blocks with pixels in the region, grouped by squares of 8 × 8 so that camera rays spawned together are
    /// coherent.
    pub fn in_order(self) -> Arc<[u32]> {
        let mut blocks: Vec<u32> = (0..self.count() as u32).filter(|&block| self.has(block)).collect();
        blocks.sort_by_key(|block| {
            let (x, y) = (block % self.columns(), block / self.columns());
            (y / 8, x / 8, y, x)
        });
        blocks.into()
    }
}

/// The samples of a frame that one job takes: the same sample numbers in each of its blocks, or the rest of them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pass {
    blocks: Arc<[u32]>,
    samples: Range<u32>,
    /// True if its first tiles are the rays through the centres of the pixels.
    centres: bool,
    /// Tiles at its start that an earlier job has taken.
    taken: u64,
}

impl Pass {
    /// Takes `samples` in each pixel of `blocks`.
    pub fn new(blocks: Arc<[u32]>, samples: Range<u32>) -> Self {
        Self { blocks, samples, centres: false, taken: 0 }
    }

    /// The same pass, with or without rays through the centres of the pixels.
    pub(super) fn with_centres(self, centres: bool) -> Self {
        Self { centres, ..self }
    }

    /// Rest of the pass when its first `tiles` tiles have been taken. `None` if it has fewer.
    pub(super) fn after(&self, tiles: u64) -> Option<Self> {
        (tiles <= self.tiles()).then(|| Self { taken: self.taken + tiles, ..self.clone() })
    }

    /// Tiles that earlier jobs have taken.
    pub(super) fn taken(&self) -> u64 {
        self.taken
    }

    /// The blocks that are sampled.
    pub fn blocks(&self) -> &[u32] {
        &self.blocks
    }

    /// The sample numbers, the same in each pixel.
    pub fn samples(&self) -> Range<u32> {
        self.samples.clone()
    }

    /// Number of tiles left: the tiles that cover all blocks, once for each round of samples.
    pub(super) fn tiles(&self) -> u64 {
        self.centre_tiles() + self.tiles_per_turn() as u64 * u64::from(self.turns()) - self.taken
    }

    /// Number of tiles of rays through centres, [`TILE_BLOCKS`] blocks each.
    fn centre_tiles(&self) -> u64 {
        if self.centres { self.blocks.len().div_ceil(TILE_BLOCKS) as u64 } else { 0 }
    }

    /// Number of rounds over the blocks.
    fn turns(&self) -> u32 {
        (self.samples.len() as u32).div_ceil(TOGETHER)
    }

    /// Samples of a round; the last round may have fewer.
    fn together(&self) -> u32 {
        (self.samples.len() as u32).div_ceil(self.turns().max(1))
    }

    fn tile_blocks(&self) -> usize {
        TILE_BLOCKS / self.together().max(1) as usize
    }

    fn tiles_per_turn(&self) -> usize {
        self.blocks.len().div_ceil(self.tile_blocks())
    }

    /// A tile's blocks and the samples that it takes of each of their pixels; [`CameraSample::CENTRE`] is one of them.
    pub(super) fn tile(&self, tile: u64) -> (&[u32], Range<u32>) {
        let (tile, per_turn) = (self.taken + tile, self.tiles_per_turn() as u64);
        let Some(tile) = tile.checked_sub(self.centre_tiles()) else {
            let first = tile as usize * TILE_BLOCKS;
            let last = (first + TILE_BLOCKS).min(self.blocks.len());
            return (&self.blocks[first..last], CameraSample::CENTRE..CameraSample::CENTRE + 1);
        };
        let first = (tile % per_turn) as usize * self.tile_blocks();
        let last = (first + self.tile_blocks()).min(self.blocks.len());
        let start = self.samples.start + (tile / per_turn) as u32 * self.together();
        (&self.blocks[first..last], start..(start + self.together()).min(self.samples.end))
    }

    /// The most camera rays of a tile; at least 1.
    pub(super) fn tile_rays(&self, blocks: Blocks) -> usize {
        let pixels = |&block: &u32| {
            let (columns, rows) = blocks.pixels(block);
            columns.len() * rows.len()
        };
        let largest =
            |tile_blocks| self.blocks.chunks(tile_blocks).map(|tile| tile.iter().map(pixels).sum()).max();
        let samples = largest(self.tile_blocks()).unwrap_or(1).max(1) * self.together().max(1) as usize;
        let centres = if self.centres { largest(TILE_BLOCKS) } else { None };
        samples.max(centres.unwrap_or(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pass_takes_each_sample_of_each_pixel_once() {
        for (width, height) in [(1, 1), (33, 31), (300, 200), (128, 128)] {
            for samples in [5..6, 5..8, 1..17, 3..23, 0..33] {
                let blocks = Blocks::new(width, height);
                let pass = Pass::new(blocks.in_order(), samples.clone());
                let mut taken = vec![0u64; (width * height) as usize];
                let most = pass.tile_rays(blocks);
                for tile in 0..pass.tiles() {
                    let (places, some) = pass.tile(tile);
                    let mut rays = 0;
                    for &block in places {
                        let (columns, rows) = blocks.pixels(block);
                        for (x, y) in rows.flat_map(|y| columns.clone().map(move |x| (x, y))) {
                            for sample in some.clone() {
                                let bit = 1 << sample;
                                let pixel = &mut taken[(y * width + x) as usize];
                                assert_eq!(*pixel & bit, 0, "once");
                                *pixel |= bit;
                                rays += 1;
                            }
                        }
                    }
                    assert!((1..=most).contains(&rays) && most <= 64 * 64, "{rays} of at most {most}");
                }
                let all = samples.fold(0, |all, sample| all | 1 << sample);
                assert!(taken.iter().all(|&taken| taken == all), "{width}x{height}");
            }
        }
    }

    #[test]
    fn the_rest_of_a_pass_has_its_last_tiles() {
        let pass = Pass::new(Blocks::new(300, 200).in_order(), 5..40);
        let tiles = pass.tiles();
        let rest = pass.after(7).and_then(|rest| rest.after(4)).expect("more tiles");
        assert_eq!((rest.tiles(), rest.taken()), (tiles - 11, 11));
        assert!((0..rest.tiles()).all(|tile| rest.tile(tile) == pass.tile(tile + 11)));
        assert_eq!(pass.after(tiles).map(|rest| rest.tiles()), Some(0));
        assert_eq!(rest.after(tiles - 10), None);
    }

    #[test]
    fn blocks_have_neighbours_up_to_the_edges() {
        let blocks = Blocks::new(3 * BLOCK, 2 * BLOCK + 1);
        let around = |block| blocks.around(block).collect::<Vec<_>>();
        assert_eq!(around(4), [0, 1, 2, 3, 4, 5, 6, 7, 8]);
        assert_eq!(around(0), [0, 1, 3, 4]);
        assert_eq!(around(8), [4, 5, 7, 8]);
        assert_eq!(Blocks::new(1, 1).around(0).collect::<Vec<_>>(), [0]);
    }

    #[test]
    fn a_region_cuts_the_blocks_at_its_edges() {
        let all = Blocks::new(100, 70);
        for region in ["0,0,100,70", "3,5,30,40", "16,16,16,16", "99,69,1,1", "15,15,2,2"] {
            let region: Region = region.parse().expect("a region");
            let blocks = all.within(region);
            let mut pixels: Vec<usize> =
                blocks.in_order().iter().flat_map(|&block| blocks.indices(block)).collect();
            pixels.sort_unstable();
            let of_row = |y: u32| region.columns().map(move |x| (y * 100 + x) as usize);
            assert_eq!(pixels, region.rows().flat_map(of_row).collect::<Vec<_>>());
            assert_eq!(blocks.count(), all.count());
            let has = |block: &u32| blocks.in_order().contains(block);
            assert!(blocks.in_order().iter().all(|&block| blocks.around(block).all(|near| has(&near))));
        }
    }

    #[test]
    fn nothing_is_taken_where_nothing_is_wanted() {
        let blocks = Blocks::new(64, 64);
        assert_eq!(Pass::new([].into(), 0..9).tiles(), 0);
        assert_eq!(Pass::new(blocks.in_order(), 4..4).tiles(), 0);
        let pass = Pass::new([2].into(), 4..5);
        assert_eq!((pass.tiles(), pass.tile(0), pass.tile_rays(blocks)), (1, (&[2][..], 4..5), 256));
    }
}
