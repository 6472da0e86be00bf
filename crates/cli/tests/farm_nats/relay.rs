//! A relay between processes and the NATS server that delays, stalls and resets connections by a seed.

use std::io::{Read, Write};
use std::net::{Ipv4Addr, Shutdown, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::SeqCst};
use std::time::Duration;

/// A random number for each number.
pub fn mix(value: u64) -> u64 {
    let value = (value ^ (value >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let value = (value ^ (value >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    value ^ (value >> 31)
}

/// A relay to a port of this machine.
pub struct Relay {
    at: Ipv4Addr,
    port: u16,
    is_over: Arc<AtomicBool>,
    /// While true, nothing passes and nothing is closed: a cable that is cut.
    is_cut: Arc<AtomicBool>,
}

impl Relay {
    /// One at an address of this machine whose faults follow from a seed.
    pub fn start(at: Ipv4Addr, to: u16, seed: u64) -> Self {
        Self::with(at, to, Some(seed))
    }

    /// One without faults.
    pub fn plain(at: Ipv4Addr, to: u16) -> Self {
        Self::with(at, to, None)
    }

    fn with(at: Ipv4Addr, to: u16, seed: Option<u64>) -> Self {
        let listener = TcpListener::bind((at, 0)).expect("a port");
        let port = listener.local_addr().expect("an address").port();
        let (is_over, is_cut) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicBool::new(false)));
        let own = Self { at, port, is_over: Arc::clone(&is_over), is_cut: Arc::clone(&is_cut) };
        std::thread::spawn(move || {
            let count = seed.map(|seed| Arc::new(AtomicU64::new(seed)));
            for client in listener.incoming().flatten() {
                if is_over.load(SeqCst) {
                    return;
                }
                let Ok(server) = TcpStream::connect((Ipv4Addr::LOCALHOST, to)) else { continue };
                for (from, to) in [(&client, &server), (&server, &client)] {
                    let (from, to) = (from.try_clone(), to.try_clone());
                    let (Ok(from), Ok(to)) = (from, to) else { continue };
                    let (count, is_cut) = (count.clone(), Arc::clone(&is_cut));
                    std::thread::spawn(move || pass(from, to, count.as_deref(), &is_cut));
                }
            }
        });
        own
    }

    pub fn url(&self) -> String {
        format!("nats://{}", self.address())
    }

    /// Address and port.
    pub fn address(&self) -> String {
        format!("{}:{}", self.at, self.port)
    }

    /// Lets nothing pass for a while.
    pub fn cut(&self, time: Duration) {
        self.is_cut.store(true, SeqCst);
        std::thread::sleep(time);
        self.is_cut.store(false, SeqCst);
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.is_over.store(true, SeqCst);
        // Wakes the listener.
        let _ = TcpStream::connect((self.at, self.port));
    }
}

/// Passes bytes on until one side ends, or chance says so.
fn pass(mut from: TcpStream, mut to: TcpStream, count: Option<&AtomicU64>, is_cut: &AtomicBool) {
    let mut bytes = vec![0; 1 << 16];
    while let Ok(read) = from.read(&mut bytes) {
        if read == 0 {
            break;
        }
        while is_cut.load(SeqCst) {
            std::thread::sleep(Duration::from_millis(10));
        }
        match count.map_or(u64::MAX, |count| mix(count.fetch_add(1, SeqCst)) % 1000) {
            0..=2 => break,
            3..=7 => std::thread::sleep(Duration::from_millis(700)),
            8..=60 => std::thread::sleep(Duration::from_millis(20)),
            _ => {}
        }
        if to.write_all(&bytes[..read]).is_err() {
            break;
        }
    }
    // The other direction ends too.
    let _ = (from.shutdown(Shutdown::Both), to.shutdown(Shutdown::Both));
}
