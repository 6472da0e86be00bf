//! Geometric normals of many hits: corners that are still to come are prefetched, and eight normals computed at once.

use super::columns::Divide;
use crate::bvh::{Bvh, WIDTH};
use crate::lanes::{LaneTask, Lanes, Prefetch, SimdLevel};
use crate::stream::Hit;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Number of hits between the prefetch of a triangle's place and its use.
const PREFETCH_PLACE: usize = 4 * WIDTH;

/// Number of hits between the prefetch of a triangle and its use.
const PREFETCH_TRIANGLE: usize = 2 * WIDTH;

/// Writes the normals of hits, with the bits of [`super::Mesh::normal`]; 0 for misses.
///
/// # Panics
/// If there is not one row for each hit, or the tree has no such primitive.
pub(super) fn write_normals(bvh: &Bvh, hits: &[Hit], column: &mut [[f32; 3]]) {
    assert_eq!(hits.len(), column.len(), "one row per hit");
    SimdLevel::run_eight(Normals { bvh, hits, column });
}

/// Number of hits between the prefetch of a stored normal and its use.
const PREFETCH_NORMAL: usize = 16;

/// The normals of all triangles of a tree.
#[derive(Debug)]
pub(super) struct TriangleNormals {
    /// By the index of the triangle.
    normals: Vec<[f32; 3]>,
}

impl TriangleNormals {
    /// Computes the normals of a tree without instances; `None` if there is not enough memory.
    fn new(bvh: &Bvh) -> Option<Self> {
        let mut normals = Vec::new();
        normals.try_reserve_exact(bvh.len()).ok()?;
        normals.resize(bvh.len(), [0.0; 3]);
        let mut hits = [Hit::NONE; COMPUTED_AT_ONCE];
        for (at, some) in normals.chunks_mut(COMPUTED_AT_ONCE).enumerate() {
            for (index, hit) in (at * COMPUTED_AT_ONCE..).zip(&mut hits[..some.len()]) {
                hit.primitive = bvh.primitive_of(index);
            }
            write_normals(bvh, &hits[..some.len()], some);
        }
        Some(Self { normals })
    }

    /// Writes the normals of hits; 0 for misses.
    ///
    /// # Panics
    /// If there is not one row for each hit, or the tree has no such primitive.
    pub fn write(&self, bvh: &Bvh, hits: &[Hit], column: &mut [[f32; 3]]) {
        assert_eq!(hits.len(), column.len(), "one row per hit");
        let normals = self.normals.as_slice();
        for (at, to) in column.iter_mut().enumerate() {
            if let Some(ahead) = hits.get(at + PREFETCH_NORMAL)
                && !ahead.is_miss()
            {
                Prefetch::First.each([normals.as_ptr().wrapping_add(bvh.index_of(ahead.primitive))]);
            }
            let hit = &hits[at];
            *to = if hit.is_miss() { [0.0; 3] } else { normals[bvh.index_of(hit.primitive)] };
        }
    }
}

/// Number of triangles whose normals are computed before those of the next.
const COMPUTED_AT_ONCE: usize = 1024;

/// The normals of a tree's triangles, computed once as many have been asked for as there are triangles: a triangle that
/// is looked up costs more than one that is computed in order, and each mesh that is asked again and again repays it.
#[derive(Debug, Default)]
pub(super) struct KeptNormals {
    /// Number of normals that have been asked for.
    asked: AtomicUsize,
    kept: OnceLock<TriangleNormals>,
}

impl KeptNormals {
    /// The normals, if they are kept. `more` are asked for now.
    pub fn get(&self, bvh: &Bvh, more: usize) -> Option<&TriangleNormals> {
        if let Some(normals) = self.kept.get() {
            return Some(normals);
        }
        let before = self.asked.fetch_add(more, Ordering::Relaxed);
        let reached = before < bvh.len() && before + more >= bvh.len();
        // One thread alone gets there. The others do not wait.
        if reached
            && bvh.instances().is_empty()
            && let Some(normals) = TriangleNormals::new(bvh)
        {
            return Some(self.kept.get_or_init(|| normals));
        }
        None
    }
}

struct Normals<'a> {
    bvh: &'a Bvh,
    hits: &'a [Hit],
    column: &'a mut [[f32; 3]],
}

impl LaneTask for Normals<'_> {
    type Output = ();

    /// In `f64`, which has no lanes; but loops of eight become instructions for several.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, _: L) {
        let Self { bvh, hits, mut column } = self;
        for at in (0..hits.len()).step_by(WIDTH) {
            let some = &hits[at..hits.len().min(at + WIDTH)];
            for ahead in at..at + some.len() {
                if let Some(hit) = hits.get(ahead + PREFETCH_PLACE)
                    && !hit.is_miss()
                {
                    bvh.prefetch_reference(hit.primitive);
                }
                if let Some(hit) = hits.get(ahead + PREFETCH_TRIANGLE)
                    && !hit.is_miss()
                {
                    bvh.prefetch_triangle(hit.primitive);
                }
            }
            let (mut ab, mut ac) = ([[0.0; WIDTH]; 3], [[0.0; WIDTH]; 3]);
            for (row, hit) in some.iter().enumerate() {
                if hit.is_miss() {
                    continue;
                }
                let [a, b, c] = bvh.corners_and_mask(hit.primitive).0;
                for axis in 0..3 {
                    ab[axis][row] = f64::from(b[axis]) - f64::from(a[axis]);
                    ac[axis][row] = f64::from(c[axis]) - f64::from(a[axis]);
                }
            }
            let normals = unit_normals(&ab, &ac);
            for (row, to) in column.split_first(some.len()).iter_mut().enumerate() {
                *to = [normals[0][row], normals[1][row], normals[2][row]];
            }
        }
    }
}

/// The cross products of eight pairs of vectors, divided by their lengths; 0 where there is no length.
#[inline(always)]
fn unit_normals(ab: &[[f64; WIDTH]; 3], ac: &[[f64; WIDTH]; 3]) -> [[f32; WIDTH]; 3] {
    let mut normals = [[0.0; WIDTH]; 3];
    for row in 0..WIDTH {
        let x = ab[1][row] * ac[2][row] - ac[1][row] * ab[2][row];
        let y = ab[2][row] * ac[0][row] - ac[2][row] * ab[0][row];
        let z = ab[0][row] * ac[1][row] - ac[0][row] * ab[1][row];
        let scale = 1.0 / (x * x + y * y + z * z).sqrt();
        let is_long = scale < f64::INFINITY && scale > 0.0;
        normals[0][row] = if is_long { (x * scale) as f32 } else { 0.0 };
        normals[1][row] = if is_long { (y * scale) as f32 } else { 0.0 };
        normals[2][row] = if is_long { (z * scale) as f32 } else { 0.0 };
    }
    normals
}
