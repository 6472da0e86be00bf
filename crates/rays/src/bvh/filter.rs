//! The filter between a candidate and a hit.

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
}
