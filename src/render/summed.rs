//! A writer that hashes what it writes.

use std::io::{self, Write};
use xxhash_rust::xxh3::Xxh3;

/// Hashes all bytes on their way to a writer.
pub(super) struct Summed<W> {
    to: W,
    sum: Xxh3,
}

impl<W: Write> Summed<W> {
    pub fn new(to: W) -> Self {
        Self { to, sum: Xxh3::new() }
    }

    /// Writes the XXH3 (u64, little-endian) of all that has been written.
    pub fn finish(mut self) -> io::Result<()> {
        self.to.write_all(&self.sum.digest().to_le_bytes())?;
        self.to.flush()
    }
}

impl<W: Write> Write for Summed<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.to.write(bytes)?;
        self.sum.update(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.to.flush()
    }
}
