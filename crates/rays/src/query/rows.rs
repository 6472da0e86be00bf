//! Rows of rays as the tracer reads them: eight words a ray, which one vector holds.

use super::rays::{Range, Rays};
use crate::lanes::{Int, LaneTask, Lanes, Mask, SimdLevel};
use crate::stream::Ray;

/// Writes rows of an origin and a direction as rays. Returns false if some direction must be scaled before it is
/// traced.
///
/// # Panics
/// If there is not one ray per row.
pub(super) fn write_rays(rows: &[[f32; 6]], range: &Range, rays: &mut [Ray]) -> bool {
    assert_eq!(rows.len(), rays.len(), "one ray per row");
    SimdLevel::run_eight(WriteRays { rows, range, rays })
}

struct WriteRays<'a> {
    rows: &'a [[f32; 6]],
    range: &'a Range,
    rays: &'a mut [Ray],
}

/// Words of a row.
const ROW: usize = 6;

/// Words of a ray.
const WORDS: usize = size_of::<Ray>() / size_of::<u32>();

impl LaneTask for WriteRays<'_> {
    type Output = bool;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) -> bool {
        const { assert!(WORDS == 8) };
        let Self { rows, range: Range { t_min, t_max }, rays } = self;
        let words: &[u32] = bytemuck::cast_slice(rows);
        let places = Int::load(l, &[0, 1, 2, 0, 3, 4, 5, 0]);
        let ends = Int::load(l, &[0, 0, 0, t_min.to_bits(), 0, 0, 0, t_max.to_bits()]);
        let (is_end, is_direction) = (Mask::from_bits(l, 1 << 3 | 1 << 7), 7 << 4);
        let mut scaled = false;
        for (i, ray) in rays.iter_mut().enumerate() {
            // A whole vector, which the last row has not.
            let row = match words.get(ROW * i..ROW * i + WORDS) {
                Some(row) => Int::load(l, row),
                None => {
                    let mut last = [0; WORDS];
                    last[..ROW].copy_from_slice(&words[ROW * i..ROW * i + ROW]);
                    Int::load(l, &last)
                }
            };
            let row = Int::select(is_end, ends, row.permute(places));
            row.store(bytemuck::cast_mut::<Ray, [u32; WORDS]>(ray));
            // Nearly always one component alone tells that the size is usual, and none that it is too large.
            let sizes = row.to_num_bits().abs();
            let usual = sizes.above(Rays::USUAL.0).bits() & is_direction;
            let large = sizes.above(Rays::USUAL.1).bits() & is_direction;
            if usual == 0 || large != 0 {
                scaled |= Rays::must_scale(ray);
            }
        }
        !scaled
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_become_rays_and_unusual_directions_are_found() {
        let range = Range { t_min: 0.5, t_max: 7.0 };
        let row = |i: usize| [i as f32, 1.0, -2.0, 0.0, 1e-3 * i as f32 + 1e-6, -0.0];
        for len in [0, 1, 2, 3, 17] {
            let rows: Vec<[f32; 6]> = (0..len).map(row).collect();
            let mut rays = vec![Ray::default(); len];
            assert!(write_rays(&rows, &range, &mut rays));
            for (ray, &[x, y, z, dx, dy, dz]) in rays.iter().zip(&rows) {
                let expected = Ray { origin: [x, y, z], t_min: 0.5, direction: [dx, dy, dz], t_max: 7.0 };
                assert_eq!(bytemuck::cast::<Ray, [u32; 8]>(*ray), bytemuck::cast::<Ray, [u32; 8]>(expected));
            }
            for at in 0..len {
                for (size, usual) in [
                    (1e-9f32, false),
                    (1e-9f32.next_up(), true),
                    (1e9, true),
                    (1e9f32.next_up(), false),
                    (f32::INFINITY, false),
                    (1e-40, false),
                    (0.0, true),
                    (f32::NAN, true),
                ] {
                    let mut rows = rows.clone();
                    for direction in [[size, 0.0, 0.0], [0.0, -size, 0.0], [0.0, f32::NAN, size]] {
                        rows[at][3..].copy_from_slice(&direction);
                        assert_eq!(
                            write_rays(&rows, &range, &mut rays),
                            usual,
                            "{size:e} in row {at} of {len}"
                        );
                    }
                }
            }
        }
    }
}
