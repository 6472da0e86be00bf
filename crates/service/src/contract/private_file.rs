//! Files of secrets.

use super::{from_hex, random_hex};
use std::fs::OpenOptions;
use std::io::{self, ErrorKind, Write};
use std::path::Path;

/// Writes a file that its owner alone may read.
pub fn write_private(path: &Path, text: &str) -> io::Result<()> {
    let mut options = OpenOptions::new();
    options.write(true).create(true).truncate(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    let mut file = options.open(path)?;
    file.write_all(text.as_bytes())?;
    file.sync_all()
}

/// The key in a file, 256 bits in hexadecimal digits. It is drawn if there is no such file.
pub fn private_key(path: &Path) -> io::Result<[u8; 32]> {
    let text = match std::fs::read_to_string(path) {
        Ok(text) => text,
        Err(error) if error.kind() == ErrorKind::NotFound => {
            let text = random_hex()?;
            write_private(path, &text)?;
            text
        }
        Err(error) => return Err(error),
    };
    let wrong = || io::Error::other(format!("{}: no key; remove it to get a new one", path.display()));
    from_hex(text.trim()).ok_or_else(wrong)
}
