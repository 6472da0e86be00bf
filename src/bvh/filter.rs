//! What stands between a candidate and a hit.

/// Decides whether a masked triangle is there at a point: the alpha test. Asked only for triangles
/// built as masked; a refused candidate is as if the triangle were not there. Must be a pure function
/// of its arguments, for it may be asked any number of times, in any order, by any unit.
pub trait Filter: Send + Sync {
    /// Whether the surface of `primitive` is there at barycentric (`u`, `v`), the weights of its
    /// second and third vertex.
    fn accepts(&self, primitive: u32, u: f32, v: f32) -> bool;
}
