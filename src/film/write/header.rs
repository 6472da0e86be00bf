//! The header of an EXR file.

use std::io::{self, Read, Seek, SeekFrom, Write};

/// Bytes before the first attribute: magic number and version.
const START: u64 = 8;

/// Sorts the attributes of a file with one part by their names. The crate that writes them keeps them in an order that
/// changes from run to run; equal pictures have equal files.
pub fn sort_attributes(file: &mut (impl Read + Write + Seek)) -> io::Result<()> {
    file.seek(SeekFrom::Start(START))?;
    let mut reader = io::BufReader::new(&mut *file);
    let mut attributes = Vec::new();
    while let Some(attribute) = read_attribute(&mut reader)? {
        attributes.push(attribute);
    }
    attributes.sort_unstable();
    file.seek(SeekFrom::Start(START))?;
    file.write_all(&attributes.concat())?;
    file.seek(SeekFrom::End(0))?;
    Ok(())
}

/// The bytes of an attribute: its name and its type, each with a zero at the end, the length and the bytes of its
/// value. `None` where an empty name ends the header.
fn read_attribute(file: &mut impl io::BufRead) -> io::Result<Option<Vec<u8>>> {
    let mut bytes = Vec::new();
    file.read_until(0, &mut bytes)?;
    if bytes == [0] {
        return Ok(None);
    }
    file.read_until(0, &mut bytes)?;
    let mut length = [0; 4];
    file.read_exact(&mut length)?;
    bytes.extend(length);
    let start = bytes.len();
    bytes.resize(start + u32::from_le_bytes(length) as usize, 0);
    file.read_exact(&mut bytes[start..])?;
    Ok(Some(bytes))
}
