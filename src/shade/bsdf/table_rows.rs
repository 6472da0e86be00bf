//! Rows of a table, computed on all cores.

use std::panic::resume_unwind;
use std::thread;

/// The rows of a table, in order. `row` is a pure function of a row's index, so the number of cores does not matter.
///
/// The threads are its own. On a rayon pool, a thread that waits for rows could begin another task of the pool, which
/// may need the very table that is being computed.
pub fn computed<T: Send>(rows: usize, row: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let threads = thread::available_parallelism().map_or(1, usize::from);
    let share = rows.div_ceil(threads).max(1);
    let of_share = |first: usize| (first..rows.min(first + share)).map(&row).collect::<Vec<T>>();
    thread::scope(|scope| {
        let of_share = &of_share;
        let shares: Vec<_> =
            (0..rows).step_by(share).map(|first| scope.spawn(move || of_share(first))).collect();
        shares
            .into_iter()
            .flat_map(|share| share.join().unwrap_or_else(|panic| resume_unwind(panic)))
            .collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_in_order_whatever_the_number() {
        for rows in [0, 1, 2, 3, 7, 100] {
            assert!(computed(rows, |i| 3 * i).into_iter().eq((0..rows).map(|i| 3 * i)), "{rows} rows");
        }
    }
}
