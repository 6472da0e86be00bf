//! Parts that threads make as they come, and one after the other takes in their order.

use std::collections::BTreeMap;
use std::mem;
use std::ops::Range;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// The most parts that are made or wait to be taken, by thread: so few that not all are in memory at once.
const AT_ONCE: usize = 2;

/// Makes parts on all threads of the current rayon pool, each in memory from `spare`, which gets it back. `take` gets
/// them in order, one at a time, by whichever thread has made the one that lacked.
///
/// # Errors
/// The first error of `make` or `take`. Parts that follow are not taken then.
pub(super) fn in_order<M, E>(
    parts: Range<usize>,
    spare: &mut Vec<M>,
    make: impl Fn(usize, &mut M) -> Result<(), E> + Sync,
    mut take: impl FnMut(&M) -> Result<(), E> + Send,
) -> Result<(), E>
where
    M: Default + Send,
    E: Send,
{
    let threads = rayon::current_num_threads().min(parts.len());
    if threads <= 1 {
        let mut memory = spare.pop().unwrap_or_default();
        for part in parts {
            make(part, &mut memory)?;
            take(&memory)?;
        }
        spare.push(memory);
        return Ok(());
    }
    let line = Line {
        state: Mutex::new(State {
            taken: parts.start,
            left: parts,
            made: BTreeMap::new(),
            take: Some(&mut take),
            spare,
            error: None,
        }),
        moved: Condvar::new(),
        at_once: AT_ONCE * threads,
    };
    rayon::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|_| line.work(&make));
        }
    });
    let state = line.state.into_inner().unwrap_or_else(PoisonError::into_inner);
    state.error.map_or(Ok(()), Err)
}

/// Parts on their way.
struct Line<'a, M, E, T> {
    state: Mutex<State<'a, M, E, T>>,
    /// Told when parts have been taken, or no more will be.
    moved: Condvar,
    at_once: usize,
}

struct State<'a, M, E, T> {
    /// Parts that are not begun.
    left: Range<usize>,
    /// The part that is taken next.
    taken: usize,
    /// Parts that wait for it.
    made: BTreeMap<usize, M>,
    /// Lacks while a thread takes parts.
    take: Option<&'a mut T>,
    spare: &'a mut Vec<M>,
    error: Option<E>,
}

impl<'a, M, E, T> Line<'a, M, E, T> {
    /// Begins no more parts.
    fn end(&self) {
        let mut state = self.lock();
        state.left.start = state.left.end;
        self.moved.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, State<'a, M, E, T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<M: Default, E, T: FnMut(&M) -> Result<(), E>> Line<'_, M, E, T> {
    /// Makes parts until none is left.
    fn work(&self, make: &impl Fn(usize, &mut M) -> Result<(), E>) {
        let ends = EndsAtPanic(self);
        while let Some((part, mut memory)) = self.next() {
            match make(part, &mut memory) {
                Ok(()) => self.take_made(part, memory),
                Err(error) => self.fail(error),
            }
        }
        mem::forget(ends);
    }

    /// The next part to make, with memory; waits while too many wait to be taken.
    fn next(&self) -> Option<(usize, M)> {
        let mut state = self.lock();
        while state.left.start >= state.taken + self.at_once && !state.left.is_empty() {
            state = self.moved.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        let part = state.left.next()?;
        Some((part, state.spare.pop().unwrap_or_default()))
    }

    /// Takes a part and those that wait for it when their turn has come, unless another thread takes them.
    fn take_made(&self, part: usize, memory: M) {
        let mut state = self.lock();
        state.made.insert(part, memory);
        let Some(take) = state.take.take() else { return };
        while let State { taken, made, .. } = &mut *state
            && let Some(memory) = made.remove(taken)
        {
            drop(state);
            if let Err(error) = take(&memory) {
                return self.fail(error);
            }
            state = self.lock();
            state.taken += 1;
            state.spare.push(memory);
            self.moved.notify_all();
        }
        state.take = Some(take);
    }

    /// Keeps the first error, and begins no more parts.
    fn fail(&self, error: E) {
        self.lock().error.get_or_insert(error);
        self.end();
    }
}

/// Ends the others when a thread panics, which would wait for its part.
struct EndsAtPanic<'a, 'b, M, E, T>(&'a Line<'b, M, E, T>);

impl<M, E, T> Drop for EndsAtPanic<'_, '_, M, E, T> {
    fn drop(&mut self) {
        self.0.end();
    }
}

#[cfg(test)]
mod tests {
    use super::in_order;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::thread::sleep;
    use std::time::Duration;

    fn on_threads<T: Send>(threads: usize, run: impl FnOnce() -> T + Send) -> T {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads").install(run)
    }

    #[test]
    fn parts_are_taken_in_order_and_few_are_made_ahead() {
        for threads in [1, 2, 5] {
            let (mut found, mut spare) = (Vec::new(), Vec::new());
            let (ahead, most) = (AtomicUsize::new(0), AtomicUsize::new(0));
            let make = |part: usize, memory: &mut usize| {
                most.fetch_max(ahead.fetch_add(1, Ordering::Relaxed), Ordering::Relaxed);
                // The first of each seven takes longest.
                sleep(Duration::from_micros(if part.is_multiple_of(7) { 2000 } else { 100 }));
                *memory = part;
                Ok::<(), ()>(())
            };
            let take = |memory: &usize| {
                ahead.fetch_sub(1, Ordering::Relaxed);
                found.push(*memory);
                Ok(())
            };
            assert_eq!(on_threads(threads, || in_order(3..60, &mut spare, make, take)), Ok(()));
            assert_eq!(found, Vec::from_iter(3..60));
            assert!(most.into_inner() < 2 * threads && spare.len() <= 2 * threads);
        }
    }

    #[test]
    fn the_first_error_ends_all() {
        for threads in [1, 4] {
            let mut taken = 0;
            let make = |part: usize, memory: &mut usize| {
                *memory = part;
                if part == 30 { Err("made") } else { Ok(()) }
            };
            let take = |_: &usize| {
                taken += 1;
                Ok(())
            };
            assert_eq!(on_threads(threads, || in_order(0..1000, &mut vec![], make, take)), Err("made"));
            assert!(taken <= 30);
            let refuse = |&part: &usize| if part == 20 { Err("taken") } else { Ok(()) };
            let make = |part: usize, memory: &mut usize| {
                *memory = part;
                Ok(())
            };
            assert_eq!(on_threads(threads, || in_order(0..1000, &mut vec![], make, refuse)), Err("taken"));
        }
    }

    #[test]
    #[should_panic(expected = "part 5")]
    fn a_panic_ends_all() {
        let make = |part: usize, _: &mut ()| {
            assert_ne!(part, 5, "part 5");
            sleep(Duration::from_micros(200));
            Ok::<(), ()>(())
        };
        on_threads(3, || in_order(0..1000, &mut vec![], make, |_| Ok(()))).expect("a panic");
    }
}
