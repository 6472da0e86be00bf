//! Which hits count.

use crate::bvh::Filter;
use crate::stream::Hit;

/// Decides which of the hits that are nearer than the best so far count.
pub(super) trait Accept {
    /// True if a hit of the ray with an index counts; `masked` says whether the triangle is.
    fn accepts(&mut self, ray: usize, hit: &Hit, masked: bool) -> bool;
}

/// The filter decides hits on masked triangles; all others count.
pub(super) struct Filtered<'a>(pub Option<&'a dyn Filter>);

impl Accept for Filtered<'_> {
    #[inline(always)]
    fn accepts(&mut self, _: usize, hit: &Hit, masked: bool) -> bool {
        !masked || self.0.is_none_or(|filter| filter.accepts(hit.primitive, hit.u, hit.v))
    }
}
