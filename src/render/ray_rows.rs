//! Rays and hits of a batch in lanes.

use crate::lanes::{Int, Lanes, Mask, Num, Vector};
use crate::schedule::{Batch, Output};
use crate::shade::Hits;
use crate::stream::Ray;

/// Origins and directions of some rays of a batch, one in each lane.
#[inline(always)]
pub fn rays_of<P, L: Lanes>(batch: &Batch<'_, P>, ids: Int<L>) -> (Vector<L>, Vector<L>) {
    let [a, b, c, _, x, y, z, _] = ids.rows_of(bytemuck::cast_slice(batch.rays));
    (Vector::new(a, b, c), Vector::new(x, y, z))
}

/// Hits of some rays of a batch, one in each lane.
#[inline(always)]
pub fn hits_of<P, L: Lanes>(batch: &Batch<'_, P>, ids: Int<L>) -> Hits<L> {
    let [t, u, v, primitive] = ids.rows_of(bytemuck::cast_slice(batch.hits));
    Hits { t, u, v, primitive: primitive.to_bits() }
}

/// Rays that are about to be emitted, one in each lane. They begin at `t_min` 0.
#[derive(Clone, Copy, Debug)]
pub struct NewRays<L: Lanes> {
    /// Origins.
    pub origin: Vector<L>,
    /// Directions.
    pub direction: Vector<L>,
    /// Ends.
    pub t_max: Num<L>,
}

impl<L: Lanes> NewRays<L> {
    /// Rays without an end.
    #[inline(always)]
    pub fn new(origin: Vector<L>, direction: Vector<L>) -> Self {
        Self { origin, direction, t_max: Num::splat(direction.lanes(), f32::INFINITY) }
    }

    /// Rays as rows in memory: the lanes of a mask, packed.
    #[inline(always)]
    pub fn rows(&self, lanes: Mask<L>) -> L::Array<[f32; 8]> {
        let t_min = Num::zero(self.t_max.lanes());
        let (o, d) = (self.origin, self.direction);
        Num::packed_rows(lanes, [o.x, o.y, o.z, t_min, d.x, d.y, d.z, self.t_max])
    }

    /// Emits the rays of a mask. `payloads` are rows of the same lanes, packed: `Num::packed_rows` for payloads of 32
    /// bytes.
    #[inline(always)]
    pub fn emit<P: bytemuck::Pod, S>(&self, out: &mut Output<'_, P, S>, lanes: Mask<L>, payloads: &[P]) {
        let rays = self.rows(lanes);
        out.ray_row(lanes.count(), bytemuck::cast_slice::<_, Ray>(rays.as_ref()), payloads);
    }
}
