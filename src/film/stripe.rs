//! Locks for stripes of pixels.

use std::sync::atomic::{AtomicBool, Ordering::Acquire, Ordering::Relaxed, Ordering::Release};

/// Pixels of a stripe: neighbours in a row, so that the lanes of a batch share few stripes and threads
/// seldom meet.
const PIXELS: u32 = 64;

/// How often a thread looks at a locked stripe before it lets others run: whoever has it needs a few
/// nanoseconds, unless it was interrupted.
const SPINS: u32 = 100;

/// A lock for every stripe of a film.
#[derive(Debug)]
pub struct Stripes(Vec<AtomicBool>);

/// A stripe while it is locked.
pub struct Stripe<'a> {
    lock: &'a AtomicBool,
    number: u32,
}

impl Stripes {
    /// For so many pixels.
    pub fn new(pixels: usize) -> Self {
        Self(std::iter::repeat_with(Default::default).take(pixels.div_ceil(PIXELS as usize)).collect())
    }

    /// Locks the stripe of a pixel.
    pub fn lock(&self, pixel: u32) -> Stripe<'_> {
        let number = pixel / PIXELS;
        let lock = &self.0[number as usize];
        let mut spins = 0;
        while lock.compare_exchange_weak(false, true, Acquire, Relaxed).is_err() {
            spins += 1;
            if spins % SPINS == 0 { std::thread::yield_now() } else { std::hint::spin_loop() }
        }
        Stripe { lock, number }
    }
}

impl Stripe<'_> {
    /// Whether a pixel is in it.
    pub fn has(&self, pixel: u32) -> bool {
        pixel / PIXELS == self.number
    }
}

impl Drop for Stripe<'_> {
    fn drop(&mut self) {
        self.lock.store(false, Release);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicU64;

    #[test]
    fn nobody_comes_between() {
        let (stripes, sum) = (Stripes::new(130), AtomicU64::new(0));
        std::thread::scope(|scope| {
            for thread in 0..4 {
                let (stripes, sum) = (&stripes, &sum);
                scope.spawn(move || {
                    for i in 0..20_000 {
                        let stripe = stripes.lock(64 + (i + thread) % 64);
                        assert!(stripe.has(64) && stripe.has(127) && !stripe.has(63) && !stripe.has(128));
                        sum.store(sum.load(Relaxed) + 1, Relaxed);
                    }
                });
            }
        });
        assert_eq!(sum.into_inner(), 80_000);
        drop((stripes.lock(0), stripes.lock(129)));
    }
}
