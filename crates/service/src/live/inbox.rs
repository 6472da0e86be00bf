//! What other threads tell the render thread of a view.

use super::Request;
use super::tile_dispatch::Arrival;
use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Collects what is told.
#[derive(Debug, Default)]
pub(super) struct Inbox {
    content: Mutex<Content>,
    changed: Condvar,
}

/// What was told.
#[derive(Debug, Default)]
pub(super) struct News {
    /// The client's requests.
    pub requests: VecDeque<Request>,
    /// The workers' answers.
    pub arrivals: Vec<Arrival>,
    /// The time at which a job has ended, if one has.
    pub job_ended: Option<Instant>,
}

#[derive(Debug, Default)]
struct Content {
    news: News,
    is_closed: bool,
}

impl Inbox {
    fn lock(&self) -> MutexGuard<'_, Content> {
        self.content.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn change(&self, change: impl FnOnce(&mut Content)) {
        change(&mut self.lock());
        self.changed.notify_one();
    }

    /// Adds a request.
    pub fn put(&self, request: Request) {
        self.change(|content| content.news.requests.push_back(request));
    }

    /// Adds what a worker has answered.
    pub fn arrive(&self, arrival: Arrival) {
        self.change(|content| content.news.arrivals.push(arrival));
    }

    /// Ends the thread.
    pub fn close(&self) {
        self.change(|content| content.is_closed = true);
    }

    /// Tells that a job has ended.
    pub fn tell_end(&self) {
        self.change(|content| content.news.job_ended = Some(Instant::now()));
    }

    /// Waits for news, at most this long; `None` once the inbox is closed.
    pub fn wait(&self, patience: Duration) -> Option<News> {
        let is_idle = |content: &mut Content| {
            let News { requests, arrivals, job_ended } = &content.news;
            requests.is_empty() && arrivals.is_empty() && job_ended.is_none() && !content.is_closed
        };
        let waited = self.changed.wait_timeout_while(self.lock(), patience, is_idle);
        let (mut content, _) = waited.unwrap_or_else(PoisonError::into_inner);
        let news = std::mem::take(&mut content.news);
        (!content.is_closed).then_some(news)
    }
}
