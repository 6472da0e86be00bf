//! The batch sort (RA section 3.1): misses first, then hits by material.

use super::{Hits, material_of, mix};
use crate::lanes::{Int, Lanes, MAX_LANES, OutlinedTask, for_parts};
use crate::scene::{Scene, Surface};
use crate::stream::{Hit, MISS};
use std::cell::Cell;

thread_local! {
    /// Storage of the last batch that this thread sorted. It is reused, so that no batch after the first
    /// allocates.
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
    /// (key, start in `order`) of each run; keys ascend.
    runs: Vec<(u32, u32)>,
    /// Number of rays in the batch.
    len: usize,
}

/// A key that no ray has.
const NEVER: u32 = u32::MAX;

impl Storage {
    const NONE: Self =
        Self { keys: Vec::new(), order: Vec::new(), scratch: Vec::new(), runs: Vec::new(), len: 0 };
}

impl Default for Storage {
    fn default() -> Self {
        Self::NONE
    }
}

/// Rays of a batch that hit the same material, or that all missed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run<'a> {
    /// Index of the material; `None` for rays that missed.
    pub material: Option<u32>,
    /// Indices of the rays in the batch, ascending.
    pub rays: &'a [u32],
}

/// Up to this many runs are gathered one after the other, each in lanes. With more runs the radix sort is
/// faster.
const FEW_RUNS: usize = 8;

/// Sorts a batch of hits of a scene by [`material_of`] in linear time. The sort is stable: rays of a run keep
/// the order that they have in the batch.
#[inline(always)]
pub fn sort<L: Lanes>(l: L, hits: &[Hit], scene: &Scene) -> Sorted {
    l.outlined(Sort { hits, scene })
}

struct Sort<'a> {
    hits: &'a [Hit],
    scene: &'a Scene,
}

impl<L: Lanes> OutlinedTask<L> for Sort<'_> {
    type Output = Sorted;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, l: L) -> Sorted {
        let mut storage = SPARE.take();
        if let [hit] = self.hits {
            storage.sort_one(if hit.is_miss() { 0 } else { material_of(self.scene, hit) + 1 });
            return Sorted(storage);
        }
        storage.resize(self.hits.len());
        let keys = storage.look_up(l, self.hits, &self.scene.mesh.materials);
        storage.group(l, keys);
        if !self.scene.mixes.is_empty() {
            // A mix whose part is itself a mix takes another round.
            while storage.resolve(l, self.hits, self.scene) {
                let keys = storage.key_range();
                storage.group(l, keys);
            }
        }
        Sorted(storage)
    }
}

/// The least key of a batch, and the bits in which its keys differ.
#[derive(Clone, Copy)]
struct KeyRange {
    least: u32,
    /// Bits that are set in some keys and clear in others.
    varying: u32,
}

impl Storage {
    /// Makes room for the keys and the order of `rays` rays, and for the lanes that are written past their
    /// end.
    fn resize(&mut self, rays: usize) {
        self.keys.clear();
        self.keys.resize(rays + MAX_LANES, NEVER);
        self.order.resize(rays + MAX_LANES, 0);
        self.len = rays;
    }

    /// Fills the order and the runs from the keys.
    #[inline(always)]
    fn group<L: Lanes>(&mut self, l: L, keys: KeyRange) {
        self.runs.clear();
        if L::LANES == 1 || !self.gather(l, keys) {
            self.radix(keys);
        }
    }

    /// Replaces the keys of hits on mixes by the keys of the chosen parts. Returns whether there were any
    /// such hits.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn resolve<L: Lanes>(&mut self, l: L, hits: &[Hit], scene: &Scene) -> bool {
        let mut found = false;
        for (i, &(key, start)) in self.runs.iter().enumerate() {
            let Some(material) = key.checked_sub(1) else { continue };
            let Surface::Mix(mix) = scene.materials[material as usize].surface else { continue };
            let [first, second] = scene.mixes[mix as usize].of;
            let end = self.runs.get(i + 1).map_or(self.len, |next| next.1 as usize);
            for rays in self.order[start as usize..end].chunks(L::LANES) {
                let (ids, _) = Int::some(l, rays, rays[0]);
                let [t, u, v, primitive] = ids.rows_of(bytemuck::cast_slice(hits));
                let hits = Hits { t, u, v, primitive: primitive.to_bits() };
                let seconds = mix::is_second(scene, mix, &hits);
                for (lane, &ray) in rays.iter().enumerate() {
                    self.keys[ray as usize] = 1 + if seconds.test(lane) { second } else { first };
                }
            }
            found = true;
        }
        found
    }

    fn key_range(&self) -> KeyRange {
        let keys = &self.keys[..self.len];
        let (mut least, mut all, mut any) = (NEVER, NEVER, 0);
        for &key in keys {
            (least, all, any) = (least.min(key), all & key, any | key);
        }
        KeyRange { least, varying: any & !all }
    }

    /// A batch of one ray needs no sort. Shading ray by ray takes this short way.
    fn sort_one(&mut self, key: u32) {
        self.order.clear();
        self.order.push(0);
        self.runs.clear();
        self.runs.push((key, 0));
        self.len = 1;
    }

    /// Looks up the key of each ray: 0 for a miss, m + 1 for material m.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn look_up<L: Lanes>(&mut self, l: L, hits: &[Hit], materials: &[u32]) -> KeyRange {
        let (mut least, mut all, mut any) = (Int::splat(l, NEVER), Int::splat(l, NEVER), Int::splat(l, 0));
        let places = Int::iota(l);
        for_parts(hits.len().min(self.keys.len()), L::LANES, |part| {
            let (hits, keys) = (&hits[part.clone()], &mut self.keys[part]);
            let [_, _, _, primitive] = places.at_most(hits.len() as u32 - 1).rows(bytemuck::cast_slice(hits));
            let hit = !primitive.is(MISS);
            let mut key = Int::splat(l, 0);
            if hit.any() {
                let [material] = Int::select(hit, primitive, key).rows(materials);
                key = Int::select(hit, material + 1, key);
            }
            // Lanes past the last ray repeat that ray.
            (all, any) = (all & key, any | key);
            least = Int::select(key.lt(least), key, least);
            if keys.len() == L::LANES {
                key.store(keys);
            } else {
                keys.copy_from_slice(&key.to_array().as_ref()[..hits.len()]);
            }
        });
        let (all_of, any_of) = (all.to_array(), any.to_array());
        let (mut all, mut any) = (NEVER, 0);
        for lane in 0..L::LANES {
            all &= all_of[lane];
            any |= any_of[lane];
        }
        KeyRange { least: least_of(least), varying: any & !all }
    }

    /// Gathers the rays of one key after the other. Returns false if there are more than [`FEW_RUNS`] runs.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn gather<L: Lanes>(&mut self, l: L, keys: KeyRange) -> bool {
        let (places, none) = (Int::iota(l), Int::splat(l, NEVER));
        let (mut key, mut filled) = (keys.least, 0);
        while filled < self.len {
            if self.runs.len() == FEW_RUNS {
                self.runs.clear();
                return false;
            }
            self.runs.push((key, filled as u32));
            let (mut next, mut rays) = (none, places);
            for keys in self.keys[..self.len.next_multiple_of(L::LANES)].chunks_exact(L::LANES) {
                let keys = Int::load(l, keys);
                filled += rays.append(keys.is(key), &mut self.order[filled..]);
                let later = Int::splat(l, key).lt(keys) & keys.lt(next);
                next = Int::select(later, keys, next);
                rays = rays + L::LANES as u32;
            }
            key = least_of(next);
        }
        true
    }

    /// A radix sort by bytes. It skips bytes in which all keys agree.
    fn radix(&mut self, KeyRange { varying, .. }: KeyRange) {
        let Self { keys, order, scratch, runs, len } = self;
        scratch.resize(order.len(), 0);
        order[..*len].iter_mut().enumerate().for_each(|(place, ray)| *ray = place as u32);
        for shift in [0, 8, 16, 24] {
            if (varying >> shift) & 0xff == 0 {
                continue;
            }
            let digit = |ray: u32| ((keys[ray as usize] >> shift) & 0xff) as usize;
            let mut next = [0u32; 256];
            order[..*len].iter().for_each(|&ray| next[digit(ray)] += 1);
            let mut start = 0;
            for slot in &mut next {
                start += std::mem::replace(slot, start);
            }
            for &ray in &order[..*len] {
                let slot = &mut next[digit(ray)];
                scratch[*slot as usize] = ray;
                *slot += 1;
            }
            std::mem::swap(order, scratch);
        }
        for (place, &ray) in order[..*len].iter().enumerate() {
            let key = keys[ray as usize];
            if runs.last().is_none_or(|&(last, _)| last != key) {
                runs.push((key, place as u32));
            }
        }
    }
}

impl Sorted {
    /// The runs: first the misses, if there are any, then the materials in ascending order.
    #[inline]
    pub fn runs(&self) -> impl Iterator<Item = Run<'_>> {
        let Storage { order, runs, len, .. } = &self.0;
        runs.iter().enumerate().map(move |(i, &(key, start))| {
            let end = runs.get(i + 1).map_or(*len, |next| next.1 as usize);
            Run { material: key.checked_sub(1), rays: &order[start as usize..end] }
        })
    }
}

impl Drop for Sorted {
    fn drop(&mut self) {
        SPARE.set(std::mem::take(&mut self.0));
    }
}

/// The least of the lanes' numbers.
#[cfg_attr(not(unoptimised), inline(always))]
fn least_of<L: Lanes>(numbers: Int<L>) -> u32 {
    let numbers = numbers.to_array();
    let mut least = NEVER;
    for lane in 0..L::LANES {
        least = least.min(numbers[lane]);
    }
    least
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::{LaneTask, SimdLevel};

    fn hit(primitive: u32) -> Hit {
        Hit { t: 1.0, u: 0.0, v: 0.0, primitive }
    }

    struct Sorting<'a>(&'a [Hit], &'a Scene);

    impl LaneTask for Sorting<'_> {
        type Output = Sorted;

        #[inline(always)]
        fn run<L: Lanes>(self, l: L) -> Sorted {
            sort(l, self.0, self.1)
        }
    }

    #[test]
    fn every_ray_is_in_the_run_of_its_material_in_batch_order() {
        for (materials, level) in [1u32, 3, 7, 8, 300, 70_000]
            .into_iter()
            .flat_map(|materials| SimdLevel::available().into_iter().map(move |level| (materials, level)))
        {
            let of: Vec<u32> = (0..100_000u32).map(|p| crate::geom::mix(p) % materials).collect();
            let mut scene = Scene::default();
            scene.mesh.materials = of.clone();
            for (first, rays) in [(0, 8192), (5, 77), (0, 1), (3, 1)] {
                let hits: Vec<Hit> = (first..first + rays)
                    .map(|i| if i % 7 == 3 { hit(MISS) } else { hit(crate::geom::mix(i ^ 0x55) % 100_000) })
                    .collect();
                let sorted = level.run(Sorting(&hits, &scene));
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
    }

    #[test]
    fn an_empty_batch_has_no_runs() {
        for level in SimdLevel::available() {
            assert_eq!(level.run(Sorting(&[], &Scene::default())).runs().count(), 0);
        }
    }
}
