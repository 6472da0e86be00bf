//! The connections that are open. There is room for so many; when it is used up, the one that has been open longest
//! without ever showing the token leaves for a new one, so no number of strangers keeps others out.

use axum_server::accept::Accept;
use futures_util::task::AtomicWaker;
use std::collections::{BTreeMap, HashMap};
use std::future::{Ready, ready};
use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::sync::{Arc, Mutex, MutexGuard};
use std::task::{Context, Poll};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;

/// The connections of a service.
#[derive(Debug)]
pub struct Connections {
    most: usize,
    open: Mutex<Open>,
}

#[derive(Debug, Default)]
struct Open {
    /// In the order of their arrival.
    all: BTreeMap<u64, Arc<Entry>>,
    numbers: HashMap<SocketAddr, u64>,
    next: u64,
}

/// A connection.
#[derive(Debug)]
struct Entry {
    number: u64,
    peer: SocketAddr,
    is_trusted: AtomicBool,
    is_closed: AtomicBool,
    task: AtomicWaker,
}

impl Connections {
    /// Room for so many connections, at least one.
    pub fn new(most: usize) -> Self {
        Self { most: most.max(1), open: Mutex::default() }
    }

    fn open(&self) -> MutexGuard<'_, Open> {
        self.open.lock().expect("no holder panics")
    }

    /// Remembers that the token was shown on a connection. It does not leave for others then.
    pub fn trust(&self, peer: SocketAddr) {
        let open = self.open();
        if let Some(entry) = open.numbers.get(&peer).and_then(|number| open.all.get(number)) {
            entry.is_trusted.store(true, SeqCst);
        }
    }

    /// Takes a new connection; `None` if all that are open have shown the token.
    fn admit(&self, peer: SocketAddr) -> Option<Arc<Entry>> {
        let mut open = self.open();
        if open.all.len() >= self.most {
            let stranger = open.all.values().find(|entry| !entry.is_trusted.load(SeqCst));
            let stranger = stranger.map(Arc::clone);
            metrics::counter!("raystream_connections_closed_for_others_total").increment(1);
            let stranger = stranger?;
            open.remove(&stranger);
            stranger.is_closed.store(true, SeqCst);
            stranger.task.wake();
        }
        let number = open.next;
        open.next += 1;
        let (is_trusted, is_closed) = (AtomicBool::new(false), AtomicBool::new(false));
        let entry = Arc::new(Entry { number, peer, is_trusted, is_closed, task: AtomicWaker::new() });
        open.all.insert(number, Arc::clone(&entry));
        open.numbers.insert(peer, number);
        Some(entry)
    }

    fn forget(&self, entry: &Entry) {
        self.open().remove(entry);
    }
}

impl Open {
    fn remove(&mut self, entry: &Entry) {
        self.all.remove(&entry.number);
        // The system may have given the address to a later connection.
        if self.numbers.get(&entry.peer) == Some(&entry.number) {
            self.numbers.remove(&entry.peer);
        }
    }
}

/// Admits connections.
#[derive(Clone, Debug)]
pub struct Admission(pub Arc<Connections>);

impl<S> Accept<TcpStream, S> for Admission {
    type Stream = Counted<TcpStream>;
    type Service = S;
    type Future = Ready<io::Result<(Self::Stream, S)>>;

    fn accept(&self, stream: TcpStream, service: S) -> Self::Future {
        let admitted = || {
            // Frames of live views are to be sent at once.
            stream.set_nodelay(true)?;
            let entry = self.0.admit(stream.peer_addr()?);
            let entry = entry.ok_or_else(|| io::Error::other("there are too many connections"))?;
            Ok(Counted { stream, entry, connections: Arc::clone(&self.0) })
        };
        ready(admitted().map(|stream| (stream, service)))
    }
}

/// A connection that is counted while it is open.
#[derive(Debug)]
pub struct Counted<I> {
    stream: I,
    entry: Arc<Entry>,
    connections: Arc<Connections>,
}

impl<I> Drop for Counted<I> {
    fn drop(&mut self) {
        self.connections.forget(&self.entry);
    }
}

impl<I> Counted<I> {
    /// An error once the connection is to leave; the task is woken when it is.
    fn check(&self, context: &Context<'_>) -> io::Result<()> {
        self.entry.task.register(context.waker());
        match self.entry.is_closed.load(SeqCst) {
            true => Err(io::ErrorKind::ConnectionAborted.into()),
            false => Ok(()),
        }
    }
}

impl<I: AsyncRead + Unpin> AsyncRead for Counted<I> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        self.check(context)?;
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl<I: AsyncWrite + Unpin> AsyncWrite for Counted<I> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        self.check(context)?;
        Pin::new(&mut self.stream).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        self.check(context)?;
        Pin::new(&mut self.stream).poll_write_vectored(context, slices)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }
}

/// Lets this process open as many files as its owner may, and returns how many connections that leaves room for.
pub fn room_for(most: usize) -> usize {
    #[cfg(unix)]
    {
        use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
        /// Files besides connections: the ledger, films, scenes, libraries.
        const OTHERS: u64 = 256;
        let Rlimit { maximum, .. } = getrlimit(Resource::Nofile);
        // The system may allow less than it says.
        let _ = setrlimit(Resource::Nofile, Rlimit { current: maximum, maximum });
        let files = getrlimit(Resource::Nofile).current.unwrap_or(u64::MAX);
        // A connection has one file, and a few more are accepted before they are refused.
        most.min(usize::try_from(files.saturating_sub(OTHERS) / 2).unwrap_or(usize::MAX))
    }
    #[cfg(not(unix))]
    most
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strangers_leave_first_and_the_oldest_of_them() {
        let connections = Connections::new(3);
        let peer = |port: u16| SocketAddr::from(([127, 0, 0, 1], port));
        let [first, second, third] =
            [1, 2, 3].map(|port| connections.admit(peer(port)).expect("there is room"));
        connections.trust(peer(1));
        let fourth = connections.admit(peer(4)).expect("a stranger leaves");
        let closed = [&first, &second, &third, &fourth].map(|entry| entry.is_closed.load(SeqCst));
        assert_eq!(closed, [false, true, false, false]);
        connections.forget(&second);
        connections.trust(peer(3));
        connections.trust(peer(4));
        assert!(connections.admit(peer(5)).is_none(), "all are trusted");
        connections.forget(&first);
        assert!(connections.admit(peer(5)).is_some());
    }
}
