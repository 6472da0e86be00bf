//! Host threads that are the workers of a caller's rayon pool.
//!
//! A host thread of the scheduler's state machine is a *seat* then. A worker sits down when the seat is woken, does
//! tasks, and gets up when there are none, so that rayon's own work finds the worker free. Between two tasks the worker
//! does what else waits in the pool.

use super::service::Inner;
use crate::stream::ChunkScratch;
use rayon::{ThreadPool, Yield};
use std::cell::{Cell, RefCell};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, Weak};
use std::time::Duration;

/// How long a worker that waits, and finds nothing to do, sleeps before it looks again.
const NAP: Duration = Duration::from_micros(200);

/// What a worker of a pool is doing for a service.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    /// Nothing.
    Free,
    /// It has a seat of the service at this address.
    Seated(usize),
    /// It waits for a job or for a service, and does what waits in the pool meanwhile.
    Waiting,
}

thread_local! {
    static ROLE: Cell<Role> = const { Cell::new(Role::Free) };
    /// The seats, with the addresses of their services, that this worker has left to do something else.
    static PAUSED: RefCell<Vec<(usize, usize)>> = const { RefCell::new(Vec::new()) };
}

/// Does something in a role, unless it panics in the former one again.
pub(super) fn in_role<T>(role: Role, work: impl FnOnce(Role) -> T) -> T {
    struct Restore(Role);
    impl Drop for Restore {
        fn drop(&mut self) {
            ROLE.set(self.0);
        }
    }
    let former = Restore(ROLE.replace(role));
    work(former.0)
}

/// The workers and the seats of a service.
pub(super) struct Workers {
    pool: Arc<ThreadPool>,
    /// The service; empty once all that holds it is dropped.
    inner: Weak<Inner>,
    /// Seats that are taken or about to be.
    taken: Mutex<usize>,
    left: Condvar,
    /// One for each seat.
    scratch: Vec<Mutex<ChunkScratch>>,
}

impl Workers {
    pub fn new(pool: Arc<ThreadPool>, inner: Weak<Inner>, seats: usize) -> Self {
        let scratch = (0..seats).map(|_| Mutex::default()).collect();
        Self { pool, inner, taken: Mutex::new(0), left: Condvar::new(), scratch }
    }

    /// Has a worker take a seat.
    pub fn seat(&self, seat: usize) {
        let Some(inner) = self.inner.upgrade() else { return };
        *self.taken() += 1;
        self.pool.spawn(move || {
            inner.serve_seat(seat);
            let workers = inner.workers.as_ref().expect("the service whose seat this was");
            *workers.taken() -= 1;
            workers.left.notify_all();
        });
    }

    /// The memory of a seat, which one worker has at a time.
    pub fn scratch(&self, seat: usize) -> MutexGuard<'_, ChunkScratch> {
        self.scratch[seat].lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Leaves a seat for a while to do something else that waits in the pool, if there is anything.
    pub fn pause(&self, seat: usize) {
        struct Resume;
        impl Drop for Resume {
            fn drop(&mut self) {
                PAUSED.with_borrow_mut(Vec::pop);
            }
        }
        PAUSED.with_borrow_mut(|paused| paused.push((self.service(), seat)));
        let _resume = Resume;
        self.pool.yield_now();
    }

    /// Waits until `is_over`, which `nap` waits for a short while, if this is a worker of the pool: meanwhile it does
    /// tasks of the service, in a seat that it has left, and what else waits in the pool. Others may wait as they like:
    /// `None`.
    pub fn wait_until(&self, is_over: impl Fn() -> bool, nap: impl Fn(Duration)) -> Option<()> {
        self.pool.current_thread_index()?;
        let service = self.service();
        let seats = PAUSED.with_borrow(|paused| paused.clone());
        let seat = seats.into_iter().find(|&(of, _)| of == service).map(|(_, seat)| seat);
        in_role(Role::Waiting, |_| {
            while !is_over() {
                let inner = self.inner.upgrade();
                let worked = seat.zip(inner).is_some_and(|(seat, inner)| inner.do_task(seat).is_some());
                if !worked && self.pool.yield_now() != Some(Yield::Executed) {
                    nap(NAP);
                }
            }
        });
        Some(())
    }

    /// Waits until no worker has a seat but, if it has one, this.
    pub fn wait(&self) {
        let is_own = |&&(service, _): &&(usize, usize)| service == self.service();
        let paused = PAUSED.with_borrow(|paused| paused.iter().filter(is_own).count());
        // A renderer that drops its service runs in a seat too.
        let own = paused.max(usize::from(ROLE.get() == Role::Seated(self.service())));
        let nap = |nap| drop(self.left.wait_timeout(self.taken(), nap));
        let waited = self.wait_until(|| *self.taken() <= own, nap);
        if waited.is_none() {
            let waited = self.left.wait_while(self.taken(), |taken| *taken > own);
            drop(waited.unwrap_or_else(PoisonError::into_inner));
        }
    }

    /// The service's address, which tells it from others.
    fn service(&self) -> usize {
        self.inner.as_ptr() as usize
    }

    fn taken(&self) -> MutexGuard<'_, usize> {
        self.taken.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
