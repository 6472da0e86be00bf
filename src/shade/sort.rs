//! The batch sort (RA section 3.1): misses first, then hits by material.

use crate::stream::Hit;
use std::cell::Cell;

thread_local! {
    /// Storage of the last batch that the thread sorted: batch after batch nothing is allocated.
    static SPARE: Cell<Storage> = const { Cell::new(Storage::NONE) };
}

/// A batch in shading order.
#[derive(Debug)]
pub struct Sorted(Storage);

#[derive(Debug)]
struct Storage {
    keys: Vec<u32>,
    order: Vec<u32>,
    scratch: Vec<u32>,
    /// (key, start in `order`), one for each run; keys ascend.
    runs: Vec<(u32, u32)>,
}

impl Storage {
    const NONE: Self = Self { keys: Vec::new(), order: Vec::new(), scratch: Vec::new(), runs: Vec::new() };
}

impl Default for Storage {
    fn default() -> Self {
        Self::NONE
    }
}

/// Rays of a batch that share an outcome.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run<'a> {
    /// Index of the material they hit; `None` for the rays that missed.
    pub material: Option<u32>,
    /// Places in the batch, ascending.
    pub rays: &'a [u32],
}

/// Sorts a batch: `materials` gives the material of each primitive. Stable, so the order of rays
/// within a run is that of the batch. Linear time: a radix sort by bytes that skips the bytes in
/// which all keys agree.
pub fn sort(hits: &[Hit], materials: &[u32]) -> Sorted {
    let Storage { mut keys, mut order, mut scratch, mut runs } = SPARE.take();
    // Key 0 is a miss, key m + 1 is material m.
    keys.clear();
    keys.extend(hits.iter().map(|hit| if hit.is_miss() { 0 } else { materials[hit.primitive as usize] + 1 }));
    order.clear();
    order.extend(0..hits.len() as u32);
    let first = keys.first().copied().unwrap_or(0);
    let varying = keys.iter().fold(0, |bits, &key| bits | (key ^ first));
    for shift in [0, 8, 16, 24] {
        if (varying >> shift) & 0xff == 0 {
            continue;
        }
        let digit = |ray: u32| ((keys[ray as usize] >> shift) & 0xff) as usize;
        let mut next = [0u32; 256];
        order.iter().for_each(|&ray| next[digit(ray)] += 1);
        let mut start = 0;
        for slot in &mut next {
            start += std::mem::replace(slot, start);
        }
        scratch.resize(order.len(), 0);
        for &ray in &order {
            let slot = &mut next[digit(ray)];
            scratch[*slot as usize] = ray;
            *slot += 1;
        }
        std::mem::swap(&mut order, &mut scratch);
    }
    runs.clear();
    for (place, &ray) in order.iter().enumerate() {
        let key = keys[ray as usize];
        if runs.last().is_none_or(|&(last, _)| last != key) {
            runs.push((key, place as u32));
        }
    }
    Sorted(Storage { keys, order, scratch, runs })
}

impl Sorted {
    /// The runs: misses first if there are any, then materials in ascending order.
    pub fn runs(&self) -> impl Iterator<Item = Run<'_>> {
        let Storage { order, runs, .. } = &self.0;
        runs.iter().enumerate().map(|(i, &(key, start))| {
            let end = runs.get(i + 1).map_or(order.len(), |next| next.1 as usize);
            Run { material: key.checked_sub(1), rays: &order[start as usize..end] }
        })
    }
}

impl Drop for Sorted {
    fn drop(&mut self) {
        SPARE.set(std::mem::take(&mut self.0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::MISS;

    fn hit(primitive: u32) -> Hit {
        Hit { t: 1.0, u: 0.0, v: 0.0, primitive }
    }

    #[test]
    fn every_ray_is_in_the_run_of_its_material_in_batch_order() {
        for materials in [1u32, 3, 300, 70_000] {
            let of: Vec<u32> = (0..100_000u32).map(|p| crate::geom::mix(p) % materials).collect();
            let hits: Vec<Hit> = (0..8192u32)
                .map(|i| if i % 7 == 3 { hit(MISS) } else { hit(crate::geom::mix(i ^ 0x55) % 100_000) })
                .collect();
            let sorted = sort(&hits, &of);
            let mut seen = vec![false; hits.len()];
            let mut last = None;
            for run in sorted.runs() {
                assert!(last.is_none_or(|l| l < run.material), "runs ascend and are not split");
                last = Some(run.material);
                assert!(run.rays.windows(2).all(|w| w[0] < w[1]), "stable");
                for &ray in run.rays {
                    let h = hits[ray as usize];
                    let expected = (!h.is_miss()).then(|| of[h.primitive as usize]);
                    assert_eq!(run.material, expected);
                    assert!(!std::mem::replace(&mut seen[ray as usize], true));
                }
            }
            assert!(seen.iter().all(|&s| s));
        }
    }

    #[test]
    fn an_empty_batch_has_no_runs() {
        assert_eq!(sort(&[], &[]).runs().count(), 0);
    }
}
