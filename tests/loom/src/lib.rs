//! Model checking: every interleaving of a few threads over the film's spin locks, the arena of loop entries and the
//! bundles with a device, with the memory model's stale reads. The files under test are compiled here with loom's
//! primitives as `crate::sync`.
#![cfg(test)]

mod sync {
    pub(crate) use loom::hint::spin_loop;
    pub(crate) use loom::sync::{Arc, Mutex, MutexGuard, atomic};
    pub(crate) use loom::thread::yield_now;
    pub(crate) use std::sync::PoisonError;
}

#[allow(dead_code, reason = "the models call a part of the file")]
#[path = "../../../src/shade/arena.rs"]
mod arena;
#[allow(dead_code, reason = "the models call a part of the files")]
mod schedule;
#[allow(dead_code, unused_imports, reason = "the models call a part of the files")]
mod stream;
#[allow(dead_code, reason = "the models call a part of the file")]
#[path = "../../../src/film/stripe.rs"]
mod stripe;

use arena::{Arena, BUCKET};
use loom::sync::atomic::{AtomicU64, Ordering::Relaxed};
use loom::sync::{Arc, Mutex};
use loom::thread;
use stripe::{STRIPE_PIXELS, Stripes};

/// Threads besides the model's own: `RAYSTREAM_LOOM_THREADS`, or two, which takes seconds.
fn thread_count() -> usize {
    std::env::var("RAYSTREAM_LOOM_THREADS").map_or(2, |count| count.parse().expect("a number of threads"))
}

/// Tries the interleavings of a model whose threads visit a lock often: those in which a thread is interrupted at most
/// `RAYSTREAM_LOOM_PREEMPTIONS` times, or four.
fn check(model: impl Fn() + Send + Sync + 'static) {
    let mut builder = loom::model::Builder::new();
    let most = std::env::var("RAYSTREAM_LOOM_PREEMPTIONS");
    builder.preemption_bound = Some(most.map_or(4, |most| most.parse().expect("a number of interruptions")));
    builder.check(model);
}

/// Tries every interleaving of two threads, and those of more threads as [`check`] does: all of three threads, which
/// take four locks each, are too many. Faults of real programs have shown within two interruptions (Musuvathi and
/// Qadeer 2007, "Iterative Context Bounding for Systematic Testing of Multithreaded Programs").
fn check_whole(model: impl Fn() + Send + Sync + 'static) {
    if thread_count() > 2 { check(model) } else { loom::model(model) }
}

/// Threads that want the same stripe: always two, besides the model's own, which wants another. Of three, two may wait
/// and yield to each other without end, so loom, which tries that too, never ends.
const CONTENDERS: u32 = 2;

#[test]
fn a_locked_stripe_excludes_other_threads_and_shows_what_they_wrote() {
    loom::model(|| {
        let stripes = Arc::new(Stripes::new(2 * STRIPE_PIXELS as usize));
        let sum = Arc::new(AtomicU64::new(0));
        let threads: Vec<_> = (0..CONTENDERS)
            .map(|thread| {
                let (stripes, sum) = (stripes.clone(), sum.clone());
                thread::spawn(move || {
                    let stripe = stripes.lock(STRIPE_PIXELS + thread);
                    assert!(stripe.has(STRIPE_PIXELS) && !stripe.has(0));
                    // Not atomic together: a second owner, or a stale read, would lose a count.
                    sum.store(sum.load(Relaxed) + 1, Relaxed);
                })
            })
            .collect();
        drop(stripes.lock(0));
        threads.into_iter().for_each(|thread| thread.join().expect("no panic"));
        let _stripe = stripes.lock(STRIPE_PIXELS);
        assert_eq!(sum.load(Relaxed), u64::from(CONTENDERS));
    });
}

#[test]
fn no_slot_of_an_arena_has_two_owners_and_every_count_ends_at_zero() {
    check_whole(|| {
        let arena: Arc<Arena<()>> = Arc::new(Arena::new());
        let owned = Arc::new(Mutex::new(Vec::new()));
        let threads: Vec<_> = (0..thread_count())
            .map(|_| {
                let (arena, owned) = (arena.clone(), owned.clone());
                thread::spawn(move || {
                    let mut free = arena.local_free_list();
                    let slot = free.take(|| ());
                    {
                        let mut owned = owned.lock().expect("no panic");
                        assert!(!owned.contains(&slot), "slot {slot} has two owners");
                        owned.push(slot);
                    }
                    assert_eq!(*arena.at(slot).0, ());
                    owned.lock().expect("no panic").retain(|other| *other != slot);
                    free.give_back(slot);
                })
            })
            .collect();
        threads.into_iter().for_each(|thread| thread.join().expect("no panic"));
        let usage = arena.usage(1);
        assert_eq!(usage.live_entries, 0);
        assert!(usage.peak_entries <= thread_count());
        assert!((BUCKET..=thread_count() * BUCKET).contains(&usage.allocated_bytes));
    });
}
