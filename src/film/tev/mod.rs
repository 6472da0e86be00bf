//! Sends pictures to [tev](https://github.com/Tom94/tev), a viewer, while they are rendered.
//!
//! [`Tev::show`] returns at once: a thread compares the picture with what it has sent and sends the tiles that have
//! changed, as PBRT does. A viewer that is slow, leaves or never comes delays nothing but what it shows.

mod canvas;
mod packet;
#[cfg(test)]
mod tests;

use crate::film::Picture;
use canvas::{Canvas, TILE};
use std::collections::VecDeque;
use std::fmt;
use std::io::{self, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Pictures while they are rendered are worth sending this often.
pub const INTERVAL: Duration = Duration::from_millis(250);

/// The longest time of a connection and of one packet.
const PATIENCE: Duration = Duration::from_secs(3);

/// The pause between two tries to connect.
const PAUSE: Duration = Duration::from_secs(2);

/// Pictures of different names that wait. Of more the oldest is dropped.
const WAITING: usize = 8;

/// Pictures whose sent pixels are remembered. One that was forgotten is sent whole again.
const REMEMBERED: usize = 4;

/// A viewer at an address. Dropping it sends what waits, if the viewer is there.
pub struct Tev {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

struct Shared {
    address: String,
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    waiting: VecDeque<(String, Canvas)>,
    is_over: bool,
}

impl fmt::Debug for Tev {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Tev").field("address", &self.shared.address).finish_non_exhaustive()
    }
}

impl Tev {
    /// A viewer at `HOST:PORT`; tev listens at port 14158. It need not run yet.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn new(address: impl Into<String>) -> io::Result<Self> {
        let shared = Shared { address: address.into(), state: Mutex::default(), changed: Condvar::new() };
        let shared = Arc::new(shared);
        let own = Arc::clone(&shared);
        let thread = std::thread::Builder::new().name("tev".into()).spawn(move || Sender::new(own).run())?;
        Ok(Self { shared, thread: Some(thread) })
    }

    /// Shows a picture and its layers of numbers under a name. An earlier picture of the name that still waits is
    /// replaced.
    pub fn show(&self, name: &str, picture: &Picture) {
        let canvas = Canvas::of(picture);
        let mut state = self.shared.lock();
        match state.waiting.iter_mut().find(|(waiting, _)| waiting == name) {
            Some((_, old)) => *old = canvas,
            None => {
                if state.waiting.len() >= WAITING {
                    state.waiting.pop_front();
                }
                state.waiting.push_back((name.to_owned(), canvas));
            }
        }
        drop(state);
        self.shared.changed.notify_one();
    }
}

impl Drop for Tev {
    fn drop(&mut self) {
        self.shared.lock().is_over = true;
        self.shared.changed.notify_one();
        if let Some(thread) = self.thread.take() {
            // A panic has been printed, and pictures are in their files.
            thread.join().ok();
        }
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The picture that waits longest. `None` once it is over and none waits.
    fn next(&self) -> Option<(String, Canvas)> {
        let mut state = self.lock();
        loop {
            if let Some(next) = state.waiting.pop_front() {
                return Some(next);
            }
            if state.is_over {
                return None;
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Puts back a picture that could not be sent, unless a newer one of its name waits, and waits a while. False if
    /// it is over: then nothing is tried again.
    fn put_back(&self, name: String, canvas: Canvas) -> bool {
        let mut state = self.lock();
        if !state.waiting.iter().any(|(waiting, _)| *waiting == name) {
            state.waiting.push_front((name, canvas));
        }
        let until = Instant::now() + PAUSE;
        while !state.is_over {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            let waited = self.changed.wait_timeout(state, left);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
        !state.is_over
    }
}

/// The thread's side: the connection, and what the viewer has.
struct Sender {
    shared: Arc<Shared>,
    connection: Option<TcpStream>,
    sent: VecDeque<(String, Canvas)>,
    is_told: bool,
}

impl Sender {
    fn new(shared: Arc<Shared>) -> Self {
        Self { shared, connection: None, sent: VecDeque::new(), is_told: false }
    }

    fn run(mut self) {
        while let Some((name, canvas)) = self.shared.next() {
            match self.send(&name, &canvas) {
                Ok(()) => {
                    self.is_told = false;
                    self.remember(name, canvas);
                }
                Err(error) => {
                    self.tell(&error);
                    (self.connection, self.sent) = (None, VecDeque::new());
                    if !self.shared.put_back(name, canvas) {
                        return;
                    }
                }
            }
        }
    }

    /// Says once that the viewer is not there.
    fn tell(&mut self, error: &io::Error) {
        if !std::mem::replace(&mut self.is_told, true) {
            let address = &self.shared.address;
            log::warn!(
                "{address}: tev cannot be reached ({error}); rendering goes on, and it is tried again"
            );
        }
    }

    fn send(&mut self, name: &str, canvas: &Canvas) -> io::Result<()> {
        let connection = match &mut self.connection {
            Some(connection) => connection,
            none => none.insert(connect(&self.shared.address)?),
        };
        let old = self.sent.iter().find(|(sent, _)| sent == name).map(|(_, canvas)| canvas);
        let old = old.filter(|old| old.has_shape_of(canvas));
        if old.is_none() {
            connection.write_all(&packet::create(name, canvas)?)?;
        }
        for tile in canvas.tiles(TILE).filter(|&tile| old.is_none_or(|old| old.differs(canvas, tile))) {
            connection.write_all(&packet::update(name, canvas, tile)?)?;
        }
        connection.flush()
    }

    fn remember(&mut self, name: String, canvas: Canvas) {
        self.sent.retain(|(sent, _)| *sent != name);
        if self.sent.len() >= REMEMBERED {
            self.sent.pop_front();
        }
        self.sent.push_back((name, canvas));
    }
}

fn connect(address: &str) -> io::Result<TcpStream> {
    let mut last = io::Error::other("the address has no host");
    for address in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, PATIENCE) {
            Ok(connection) => {
                connection.set_write_timeout(Some(PATIENCE))?;
                connection.set_nodelay(true)?;
                return Ok(connection);
            }
            Err(error) => last = error,
        }
    }
    Err(last)
}
