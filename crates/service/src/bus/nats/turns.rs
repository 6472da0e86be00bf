//! Turns of workers' questions: one that floods delays the others little.

use crate::contract::ANSWERED_TOGETHER;
use governor::{DefaultKeyedRateLimiter, Quota, RateLimiter};
use std::collections::HashMap;
use std::num::NonZeroU32;
use std::sync::{Arc, Mutex};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// Questions of one worker that wait or are answered at the same time.
const OF_ONE: usize = ANSWERED_TOGETHER / 4;

/// Questions of one worker that are answered in a second, in the long run: 250 MiB of parts.
const A_SECOND: NonZeroU32 = NonZeroU32::new(500).expect("not zero");

/// Questions of one worker that are answered at once after it has asked little.
const AT_ONCE: NonZeroU32 = NonZeroU32::new(1000).expect("not zero");

/// Keys whose rate is remembered before those that ask little are forgotten.
const KEYS: usize = 1000;

/// Turns of all workers.
pub struct Turns {
    /// How many questions of each worker wait or are answered.
    queued: Mutex<HashMap<String, usize>>,
    rates: DefaultKeyedRateLimiter<String>,
    answered: Arc<Semaphore>,
}

/// A question that waits for its turn.
pub struct Queued {
    turns: Arc<Turns>,
    key: String,
}

/// The turn of a question; it ends when this is dropped.
pub struct Turn {
    queued: Queued,
    _answered: OwnedSemaphorePermit,
}

impl Default for Turns {
    fn default() -> Self {
        Self::with_rate(Quota::per_second(A_SECOND).allow_burst(AT_ONCE))
    }
}

impl Turns {
    fn with_rate(rate: Quota) -> Self {
        let answered = Arc::new(Semaphore::new(ANSWERED_TOGETHER));
        Self { queued: Mutex::default(), rates: RateLimiter::keyed(rate), answered }
    }

    /// Queues a question of a key; `None` if too many of the same key wait already.
    pub fn queue(self: &Arc<Self>, key: &str) -> Option<Queued> {
        let mut queued = self.queued.lock().expect("no holder panics");
        let count = queued.entry(key.to_owned()).or_default();
        if *count >= OF_ONE {
            return None;
        }
        *count += 1;
        Some(Queued { turns: Arc::clone(self), key: key.to_owned() })
    }
}

impl Queued {
    /// Waits until the question may be answered.
    pub async fn turn(self) -> Turn {
        if self.turns.rates.len() > KEYS {
            self.turns.rates.retain_recent();
        }
        self.turns.rates.until_key_ready(&self.key).await;
        let answered = Arc::clone(&self.turns.answered).acquire_owned();
        let answered = answered.await.expect("it is never closed");
        Turn { queued: self, _answered: answered }
    }
}

impl Turn {
    /// The key of the worker that asks.
    pub fn key(&self) -> &str {
        &self.queued.key
    }
}

impl Drop for Queued {
    fn drop(&mut self) {
        let mut queued = self.turns.queued.lock().expect("no holder panics");
        if let Some(count) = queued.get_mut(&self.key) {
            *count -= 1;
            if *count == 0 {
                queued.remove(&self.key);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::{Duration, Instant};

    #[tokio::test]
    async fn one_that_floods_waits_and_the_others_do_not() {
        let turns =
            Arc::new(Turns::with_rate(Quota::with_period(Duration::from_secs(3600)).expect("a time")));
        let turn = turns.queue("a").expect("there is room").turn().await;
        assert_eq!(turn.key(), "a");
        drop(turn);
        // Its second question waits for an hour; and as many wait with it as may.
        let waiting: Vec<_> = (0..OF_ONE).map(|_| turns.queue("a").expect("there is room")).collect();
        assert!(turns.queue("a").is_none(), "no more of them wait");
        let wait = Duration::from_millis(50);
        for queued in waiting {
            assert!(tokio::time::timeout(wait, queued.turn()).await.is_err(), "it is answered");
        }
        let began = Instant::now();
        turns.queue("b").expect("there is room").turn().await;
        assert!(began.elapsed() < Duration::from_secs(60), "it waits for the other");
        assert!(turns.queue("a").is_some() && turns.queued.lock().expect("whole").is_empty());
    }

    #[tokio::test]
    async fn so_many_are_answered_together() {
        let turns = Arc::new(Turns::default());
        let mut answered = Vec::new();
        for number in 0..ANSWERED_TOGETHER {
            answered.push(turns.queue(&number.to_string()).expect("there is room").turn().await);
        }
        let wait = Duration::from_millis(50);
        let next = || turns.queue("next").expect("there is room").turn();
        assert!(tokio::time::timeout(wait, next()).await.is_err(), "one more is answered");
        answered.pop();
        next().await;
    }
}
