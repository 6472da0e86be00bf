//! Rows of SIMD lanes, appended to vectors.
//!
//! # Invariants of the `unsafe` code
//!
//! 1. The length of a vector grows only by elements that were written into its spare capacity just before.

#![allow(unsafe_code, reason = "the invariant above")]

/// Appends the first `count` elements of a row. Where the capacity suffices, the whole row is copied and the excess
/// overwritten later: copying a number of elements that the compiler knows takes a few stores in place of a call.
#[inline(always)]
pub(super) fn extend_from_row<T: Copy>(to: &mut Vec<T>, row: &[T], count: usize) {
    let len = to.len();
    match to.spare_capacity_mut().get_mut(..row.len()) {
        Some(spare) if count <= row.len() => {
            for (i, place) in spare.iter_mut().enumerate() {
                place.write(row[i]);
            }
            // SAFETY: invariant 1. The loop wrote as many elements as the row has, and those are at least `count`.
            unsafe { to.set_len(len + count) };
        }
        _ => to.extend_from_slice(&row[..count]),
    }
}

#[cfg(test)]
mod tests {
    use super::extend_from_row;

    #[test]
    fn rows_are_appended_with_and_without_spare_capacity() {
        for capacity in [0, 3, 4, 5, 64] {
            let mut to = Vec::with_capacity(capacity);
            for row in 0..6_u32 {
                extend_from_row(&mut to, &[4 * row, 4 * row + 1, 4 * row + 2, 4 * row + 3], row as usize % 5);
            }
            assert_eq!(to, [4, 8, 9, 12, 13, 14, 16, 17, 18, 19], "capacity {capacity}");
        }
    }

    #[test]
    #[should_panic(expected = "out of range")]
    fn a_count_beyond_the_row_is_refused() {
        extend_from_row(&mut Vec::with_capacity(64), &[1, 2], 3);
    }
}
