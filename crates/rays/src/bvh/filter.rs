//! The filter between a candidate and a hit.

use super::AlphaTable;

/// Decides whether a candidate hit on a masked triangle counts: the alpha test. Tracers call it only for
/// triangles that were built as masked, and treat a rejected candidate as if the triangle were not there.
///
/// Must be a pure function of its arguments: any unit may call it any number of times, in any order.
///
/// Tracers call it on the thread that traces. It may trace rays itself on that thread; such nested calls of the CPU
/// tracer work in scratch memory of their own, which costs an allocation for each outer call.
pub trait Filter: Send + Sync {
    /// True if the candidate on `primitive` at the barycentric weights `u` of its second vertex and `v` of
    /// its third counts.
    fn accepts(&self, primitive: u32, u: f32, v: f32) -> bool;

    /// The same decisions as data, if it can be said so: a device then makes them itself. Its row of a primitive that
    /// was not built as masked is [`super::AlphaRow::Opaque`]. Without a table, rays that meet a masked triangle before
    /// anything else are traced by the CPU.
    fn alpha_table(&self) -> Option<AlphaTable> {
        None
    }
}
