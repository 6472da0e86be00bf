//! What a view has for its client: the newest frame, and messages.

use super::{Frame, Reply};
use std::collections::VecDeque;
use std::fmt;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The most messages that wait for the client. Of more, the oldest statistics and timelines are dropped first.
const MOST_REPLIES: usize = 64;

/// Holds one frame, since only the newest is worth sending, and messages in their order.
pub(super) struct Outbox {
    content: Mutex<Content>,
    wake: Box<dyn Fn() + Send + Sync>,
}

#[derive(Default)]
struct Content {
    frame: Option<Frame>,
    files: VecDeque<Frame>,
    replies: VecDeque<Reply>,
}

impl fmt::Debug for Outbox {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Outbox").field("replies", &self.lock().replies.len()).finish_non_exhaustive()
    }
}

impl Outbox {
    /// An empty outbox that calls `wake` whenever something is put into it.
    pub fn new(wake: impl Fn() + Send + Sync + 'static) -> Self {
        Self { content: Mutex::default(), wake: Box::new(wake) }
    }

    fn lock(&self) -> MutexGuard<'_, Content> {
        self.content.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Replaces the frame that waits.
    pub fn put_frame(&self, frame: Frame) {
        let mut content = self.lock();
        content.frame = Some(frame);
        drop(content);
        (self.wake)();
    }

    /// Adds a file, which no frame replaces.
    pub fn put_file(&self, file: Frame) {
        self.lock().files.push_back(file);
        (self.wake)();
    }

    /// Adds a message.
    pub fn put(&self, reply: Reply) {
        let mut content = self.lock();
        if content.replies.len() >= MOST_REPLIES {
            let is_stale = |reply: &Reply| matches!(reply, Reply::Statistics(_) | Reply::Timeline(_));
            let stale = content.replies.iter().position(is_stale).unwrap_or(0);
            content.replies.remove(stale);
        }
        content.replies.push_back(reply);
        drop(content);
        (self.wake)();
    }

    /// Takes the frame that waits.
    pub fn take_frame(&self) -> Option<Frame> {
        self.lock().frame.take()
    }

    /// Takes the oldest file.
    pub fn take_file(&self) -> Option<Frame> {
        self.lock().files.pop_front()
    }

    /// Takes the oldest message.
    pub fn take(&self) -> Option<Reply> {
        self.lock().replies.pop_front()
    }
}
