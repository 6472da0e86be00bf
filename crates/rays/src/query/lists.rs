//! Lists of all hits of many rays: found in streams, sorted ray by ray in a cache, appended to rows or columns.

use super::in_order::in_order;
use super::rays::{Rays, Rule};
use super::target::Target;
use super::world::WorldHit;
use crate::memory::huge_vectors::{grow, reserve_huge};
use crate::stream::Hit;
use std::cell::Cell;
use std::collections::TryReserveError;
use std::iter;

thread_local! {
    /// Taken by a call while it lists.
    static LISTINGS: Cell<Vec<Listing>> = const { Cell::new(Vec::new()) };
}

/// The hits of some consecutive rays, and memory to list those of others.
#[derive(Default)]
struct Listing {
    /// Hits with the indices of their rays, in the order in which they are found.
    found: Vec<(u32, Hit)>,
    /// The hits of one ray after those of the ray before: so many at the beginning.
    sorted: Vec<Hit>,
    kept: usize,
    /// Where they end, by ray, and one number more.
    ends: Vec<usize>,
}

/// The most rays whose hits one thread lists at a time: a sub-stream, whose hits stay in the second-level cache.
const LISTED_AT_ONCE: usize = 16 * 1024;

/// So many rays in every so many have their hits counted before memory is reserved.
const COUNTED_AT_ONCE: usize = 16;
const COUNTED_OF: usize = 4096;

/// Room for hits, by the number that is expected.
const MORE_HITS: f64 = 1.1;

/// The most hits that a thread keeps memory for from call to call.
const KEPT_HITS: usize = 1 << 20;

/// All hits of many rays: those of one ray after those of the ray before, nearest first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HitLists {
    /// For each ray the index of its first hit, and the number of all hits: one more than there are rays.
    pub offsets: Vec<usize>,
    /// The hits. Those of a ray at one `t` ascend by instance, then by primitive.
    pub hits: Vec<WorldHit>,
}

impl HitLists {
    /// The hits of a ray, nearest first.
    ///
    /// # Panics
    /// If there is no such ray.
    pub fn of(&self, ray: usize) -> &[WorldHit] {
        &self.hits[self.offsets[ray]..self.offsets[ray + 1]]
    }
}

/// The columns of [`HitLists`]: those that are `Some`, with an element for each hit. More rays can be appended.
///
/// ```
/// use raystream_rays::query::{HitListColumns, Mesh, Ray, RayQueries, Rule};
///
/// let floors = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(|[x, y, z]| [[x, y, z], [x, y, z - 1.0]]);
/// let mesh = Mesh::build(floors.as_flattened(), &[[0, 2, 4], [1, 3, 5]])?;
/// let rays = [0.25, 5.0, 0.5].map(|x| Ray::new([x, 0.25, 2.0], [0.0, 0.0, -1.0]));
/// let mut columns = HitListColumns { ray: Some(vec![]), t: Some(vec![]), ..HitListColumns::default() };
/// mesh.append_hits(&rays.as_slice().into(), Rule::HalfOpen, usize::MAX, &mut columns)?;
/// assert_eq!(columns.offsets, [0, 2, 2, 4]);
/// assert_eq!(columns.ray, Some(vec![0, 0, 2, 2]));
/// assert_eq!(columns.t, Some(vec![2.0, 3.0, 2.0, 3.0]));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HitListColumns {
    /// For each ray the index of its first hit, and the number of all hits: one more than there are rays, or nothing.
    pub offsets: Vec<u64>,
    /// Index of the ray.
    pub ray: Option<Vec<u64>>,
    /// Distance in lengths of the direction.
    pub t: Option<Vec<f32>>,
    /// Index of the triangle in its mesh.
    pub primitive: Option<Vec<u32>>,
    /// Index of the instance in its world, 0 for a mesh.
    pub instance: Option<Vec<u32>>,
    /// Barycentric weights of the triangle's second and third corner, 0 to 1.
    pub uv: Option<Vec<[f32; 2]>>,
}

impl HitListColumns {
    /// The number of hits.
    pub fn len(&self) -> usize {
        self.offsets.last().map_or(0, |&hits| hits as usize)
    }

    /// True if there are no hits.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Makes room for more rays and hits, if there is enough memory. The system provides memory only where it
    /// is written.
    fn reserve(&mut self, rays: usize, hits: usize) {
        let Self { offsets, ray, t, primitive, instance, uv } = self;
        reserve_huge(offsets, rays + 1);
        ray.iter_mut().for_each(|column| reserve_huge(column, hits));
        t.iter_mut().for_each(|column| reserve_huge(column, hits));
        primitive.iter_mut().for_each(|column| reserve_huge(column, hits));
        instance.iter_mut().for_each(|column| reserve_huge(column, hits));
        uv.iter_mut().for_each(|column| reserve_huge(column, hits));
    }
}

/// Lists to which the hits of more rays are appended.
pub(super) trait Lists {
    /// Appends the hits of rays, which end at these indices.
    fn append_sorted(
        &mut self,
        target: &Target<'_>,
        hits: &[Hit],
        ends: &[usize],
    ) -> Result<(), TryReserveError>;
}

impl Lists for HitLists {
    fn append_sorted(
        &mut self,
        target: &Target<'_>,
        hits: &[Hit],
        ends: &[usize],
    ) -> Result<(), TryReserveError> {
        let before = self.begin(ends.len())?;
        self.hits.try_reserve(hits.len())?;
        self.hits.extend(hits.iter().map(|hit| target.world_hit(hit)));
        self.offsets.extend(ends.iter().map(|end| before + end));
        Ok(())
    }
}

impl HitLists {
    /// Makes room for the offsets of more rays. Returns the number of hits before them.
    fn begin(&mut self, rays: usize) -> Result<usize, TryReserveError> {
        self.offsets.try_reserve(rays + 1)?;
        if self.offsets.is_empty() {
            self.offsets.push(0);
        }
        Ok(self.hits.len())
    }
}

impl Lists for HitListColumns {
    fn append_sorted(
        &mut self,
        target: &Target<'_>,
        hits: &[Hit],
        ends: &[usize],
    ) -> Result<(), TryReserveError> {
        self.begin(ends.len())?;
        let (rays, before) = (self.offsets.len() as u64 - 1, self.len() as u64);
        if let Some(column) = &mut self.ray {
            grow(column, hits.len())?;
            let mut start = 0;
            for (ray, &end) in (rays..).zip(ends) {
                column.extend(iter::repeat_n(ray, end - start));
                start = end;
            }
        }
        self.offsets.extend(ends.iter().map(|&end| before + end as u64));
        if let Some(column) = &mut self.t {
            grow(column, hits.len())?;
            column.extend(hits.iter().map(|hit| hit.t));
        }
        if let Some(column) = &mut self.uv {
            grow(column, hits.len())?;
            column.extend(hits.iter().map(|hit| [hit.u, hit.v]));
        }
        if let Some(column) = &mut self.primitive {
            grow(column, hits.len())?;
            match target.starts {
                Some(_) => column.extend(hits.iter().map(|hit| target.world_hit(hit).primitive)),
                None => column.extend(hits.iter().map(|hit| hit.primitive)),
            }
        }
        if let Some(column) = &mut self.instance {
            grow(column, hits.len())?;
            match target.starts {
                Some(_) => column.extend(hits.iter().map(|hit| target.world_hit(hit).instance)),
                None => column.extend(iter::repeat_n(0, hits.len())),
            }
        }
        Ok(())
    }
}

impl HitListColumns {
    /// Makes room for the offsets of more rays.
    fn begin(&mut self, rays: usize) -> Result<(), TryReserveError> {
        grow(&mut self.offsets, rays + 1)?;
        if self.offsets.is_empty() {
            self.offsets.push(0);
        }
        Ok(())
    }
}

impl Target<'_> {
    pub(super) fn list_hits(
        &self,
        rays: &Rays<'_>,
        rule: Rule,
        most: usize,
    ) -> Result<HitLists, TryReserveError> {
        let mut lists = HitLists { offsets: vec![0], hits: Vec::new() };
        self.append_hits(rays, rule, most, &mut lists)?;
        Ok(lists)
    }

    /// Makes room for the first `most` hits of every ray.
    pub(super) fn expect_hits(&self, rays: &Rays<'_>, rule: Rule, most: usize, columns: &mut HitListColumns) {
        let (mut counts, mut hits, mut counted) = ([0; COUNTED_AT_ONCE], 0, 0);
        for first in (0..rays.len().saturating_sub(COUNTED_AT_ONCE)).step_by(COUNTED_OF) {
            self.count_hits(&rays.part(first..first + COUNTED_AT_ONCE), rule, &mut counts);
            hits += counts.iter().map(|&count| most.min(count as usize)).sum::<usize>();
            counted += COUNTED_AT_ONCE;
        }
        if counted > COUNTED_AT_ONCE {
            columns
                .reserve(rays.len(), (hits as f64 * MORE_HITS * rays.len() as f64 / counted as f64) as usize);
        }
    }

    /// Appends the first `most` hits of every ray.
    pub(super) fn append_hits<L: Lists + Send>(
        &self,
        rays: &Rays<'_>,
        rule: Rule,
        most: usize,
        lists: &mut L,
    ) -> Result<(), TryReserveError> {
        let count = rays.len();
        let mut listings = LISTINGS.take();
        let list = |part: usize, listing: &mut Listing| {
            let first = part * LISTED_AT_ONCE;
            self.list_part(rays, first, LISTED_AT_ONCE.min(count - first), (rule, most), listing)
        };
        let append = |listing: &Listing| {
            let rays = listing.ends.len().saturating_sub(1);
            lists.append_sorted(self, &listing.sorted[..listing.kept], &listing.ends[..rays])
        };
        let listed = in_order(0..count.div_ceil(LISTED_AT_ONCE), &mut listings, list, append);
        let mut kept = 0;
        listings.retain(|listing| {
            kept += listing.found.capacity();
            kept <= KEPT_HITS
        });
        LISTINGS.set(listings);
        listed
    }

    /// Lists the first `most` hits of consecutive rays on the calling thread.
    fn list_part(
        &self,
        rays: &Rays<'_>,
        first: usize,
        len: usize,
        (rule, most): (Rule, usize),
        Listing { found, sorted, kept, ends }: &mut Listing,
    ) -> Result<(), TryReserveError> {
        found.clear();
        ends.clear();
        ends.resize(len + 1, 0);
        let mut refused = None;
        let mut list = |ray: u32, hit: &Hit| {
            if found.len() == found.capacity()
                && let Err(error) = found.try_reserve(1)
            {
                refused = Some(error);
                return false;
            }
            found.push((ray, *hit));
            ends[ray as usize + 1] += 1;
            true
        };
        match rule {
            Rule::HalfOpen => self.list_crossings(rays, first, len, list),
            Rule::Closed => {
                self.visit_hits(rays, first, len, rule, &mut |ray, hit| list(ray as u32, hit));
            }
        }
        if let Some(error) = refused {
            return Err(error);
        }
        for ray in 0..len {
            ends[ray + 1] += ends[ray];
        }
        sorted.try_reserve(found.len().saturating_sub(sorted.len()))?;
        sorted.resize(sorted.len().max(found.len()), Hit::NONE);
        // Each goes to the next place of its ray, so that beginnings become ends.
        for (ray, hit) in &*found {
            let place = &mut ends[*ray as usize];
            sorted[*place] = *hit;
            *place += 1;
        }
        *kept = sort_each(sorted, &mut ends[..len], most);
        Ok(())
    }
}

/// Sorts the hits of each ray, which end at these indices, and keeps the first `most`. Returns how many it keeps.
fn sort_each(hits: &mut [Hit], ends: &mut [usize], most: usize) -> usize {
    let (mut start, mut kept) = (0, 0);
    for end in ends {
        let of_ray = &mut hits[start..*end];
        if of_ray.len() > 1 {
            sort(of_ray);
        }
        let len = of_ray.len().min(most);
        if kept < start {
            hits.copy_within(start..start + len, kept);
        }
        (start, kept) = (*end, kept + len);
        *end = kept;
    }
    kept
}

/// The most hits that are sorted by inserting one after the other.
const FEW_HITS: usize = 16;

/// Sorts hits by `t`, then by the primitive id: those of a world ascend by instance.
#[inline]
fn sort(hits: &mut [Hit]) {
    // No `t` is negative, so their bits have their order.
    let key = |hit: &Hit| u64::from(hit.t.to_bits()) << 32 | u64::from(hit.primitive);
    if hits.len() > FEW_HITS {
        return hits.sort_unstable_by_key(key);
    }
    for next in 1..hits.len() {
        let hit = hits[next];
        let (mut place, own) = (next, key(&hit));
        while place > 0 && key(&hits[place - 1]) > own {
            hits[place] = hits[place - 1];
            place -= 1;
        }
        hits[place] = hit;
    }
}
