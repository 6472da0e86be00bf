//! Packets of tev's protocol (tev, `Ipc.h`): the length of the whole packet, an operation, its fields. Numbers are
//! little-endian, texts end with a zero.

use super::canvas::Canvas;
use crate::film::Region;
use std::io;

/// Operations.
const CREATE_IMAGE: u8 = 4;
const UPDATE_IMAGE_V3: u8 = 6;

/// The viewer keeps showing what it shows.
const GRABS_FOCUS: u8 = 0;

/// An image without pixels.
pub fn create(name: &str, canvas: &Canvas) -> io::Result<Vec<u8>> {
    let mut packet = begin(CREATE_IMAGE, name);
    for number in [canvas.width, canvas.height, canvas.channels.len() as u32] {
        packet.extend(number.to_le_bytes());
    }
    names(&mut packet, canvas);
    finish(packet)
}

/// The pixels of a tile, all channels of a pixel together.
pub fn update(name: &str, canvas: &Canvas, tile: Region) -> io::Result<Vec<u8>> {
    let mut packet = begin(UPDATE_IMAGE_V3, name);
    let count = canvas.channels.len();
    packet.extend((count as u32).to_le_bytes());
    names(&mut packet, canvas);
    for number in [tile.x, tile.y, tile.width, tile.height] {
        packet.extend(number.to_le_bytes());
    }
    let offsets = 0..count as u64;
    let strides = std::iter::repeat_n(count as u64, count);
    packet.extend(offsets.chain(strides).flat_map(u64::to_le_bytes));
    packet.extend(canvas.rows(tile).flatten().flat_map(|value| value.to_le_bytes()));
    finish(packet)
}

fn begin(operation: u8, name: &str) -> Vec<u8> {
    let mut packet = vec![0; 4];
    packet.extend([operation, GRABS_FOCUS]);
    text(&mut packet, name);
    packet
}

fn text(packet: &mut Vec<u8>, text: &str) {
    packet.extend(text.bytes().filter(|&byte| byte != 0));
    packet.push(0);
}

fn names(packet: &mut Vec<u8>, canvas: &Canvas) {
    canvas.channels.iter().for_each(|name| text(packet, name));
}

fn finish(mut packet: Vec<u8>) -> io::Result<Vec<u8>> {
    let length = u32::try_from(packet.len()).map_err(|_| io::Error::other("the packet is too large"))?;
    packet[..4].copy_from_slice(&length.to_le_bytes());
    Ok(packet)
}
