//! Spin locks, one for each stripe of pixels. `tests/loom` checks them in every interleaving.

use crate::sync::atomic::{AtomicBool, Ordering::Acquire, Ordering::Relaxed, Ordering::Release};
use crate::sync::{spin_loop, yield_now};

/// Pixels of a stripe, neighbours in a row. The lanes of a batch then share few stripes, and threads seldom contend.
pub const STRIPE_PIXELS: u32 = 64;

/// Spins on a locked stripe before the thread yields. An owner holds the lock for a few nanoseconds unless the system
/// preempts it.
const SPINS: u32 = 100;

/// The locks of a film, one for each stripe.
#[derive(Debug)]
pub struct Stripes(Vec<AtomicBool>);

/// A locked stripe. Unlocks when dropped.
pub struct Stripe<'a> {
    lock: &'a AtomicBool,
    number: u32,
}

impl Stripes {
    /// Unlocked stripes for this number of pixels.
    pub fn new(pixels: usize) -> Self {
        Self(std::iter::repeat_with(Default::default).take(pixels.div_ceil(STRIPE_PIXELS as usize)).collect())
    }

    /// Bytes of the stripes of this number of pixels.
    pub fn bytes(pixels: u64) -> u64 {
        pixels.div_ceil(u64::from(STRIPE_PIXELS))
    }

    /// Locks the stripe that holds a pixel.
    #[inline]
    pub fn lock(&self, pixel: u32) -> Stripe<'_> {
        let number = pixel / STRIPE_PIXELS;
        let lock = &self.0[number as usize];
        let mut spins = 0;
        while lock.compare_exchange_weak(false, true, Acquire, Relaxed).is_err() {
            spins += 1;
            if spins % SPINS == 0 { yield_now() } else { spin_loop() }
        }
        Stripe { lock, number }
    }
}

impl Stripe<'_> {
    /// True if the stripe holds a pixel.
    #[inline]
    pub fn has(&self, pixel: u32) -> bool {
        pixel / STRIPE_PIXELS == self.number
    }
}

impl Drop for Stripe<'_> {
    #[inline]
    fn drop(&mut self) {
        self.lock.store(false, Release);
    }
}
