//! Frames as they are sent: a header of 32 bytes, then the picture or file.

/// The first bytes of every frame.
pub const MAGIC: [u8; 4] = *b"RSF1";

/// Bytes of the header.
pub const HEADER_BYTES: usize = 32;

/// The kind of a frame's payload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Payload {
    /// A JPEG of the whole picture, perhaps smaller than the picture.
    Jpeg = 1,
    /// A PNG file to save.
    Png = 5,
    /// An EXR file to save.
    Exr = 6,
}

/// Flags of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameFlags {
    /// It was rendered while the camera moved, at a lower resolution.
    pub moving: bool,
    /// It has all samples; no better one will come.
    pub last: bool,
    /// Rows of a worker came too late, and coarse ones stand in for them.
    pub coarse: bool,
}

/// An encoded frame.
///
/// Header, little-endian: `RSF1`; payload kind `u8` (1 JPEG, 5 PNG file, 6 EXR file); flags `u8` (1 moving, 2 last,
/// 4 coarse); 2 bytes of zeros; generation `u32`; sequence number `u32`; left, top, width, height of the payload in
/// pixels, each `u16`; samples a pixel `u32`; milliseconds from the change that the frame answers to its encoding
/// `u32`.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Frame {
    /// The generation of the change that it shows: the number that came with the client's request.
    pub generation: u32,
    /// Number of the frame in its view; rises by at least 1.
    pub sequence: u32,
    /// Its flags.
    pub flags: FrameFlags,
    /// Width and height in pixels of the payload.
    pub size: [u32; 2],
    /// Samples of each pixel.
    pub spp: u32,
    /// Milliseconds from the change to this frame's encoding.
    pub time_ms: u32,
    /// What the payload is.
    pub(super) payload: Payload,
    /// The picture.
    pub bytes: Vec<u8>,
}

impl Frame {
    /// Header and payload.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut all = Vec::with_capacity(HEADER_BYTES + self.bytes.len());
        all.extend(MAGIC);
        all.push(self.payload as u8);
        let FrameFlags { moving, last, coarse } = self.flags;
        all.push(u8::from(moving) | u8::from(last) << 1 | u8::from(coarse) << 2);
        all.extend([0; 2]);
        all.extend(self.generation.to_le_bytes());
        all.extend(self.sequence.to_le_bytes());
        for side in [0, 0, self.size[0], self.size[1]] {
            all.extend((side as u16).to_le_bytes());
        }
        all.extend(self.spp.to_le_bytes());
        all.extend(self.time_ms.to_le_bytes());
        debug_assert_eq!(all.len(), HEADER_BYTES);
        all.extend(&self.bytes);
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_have_the_documented_layout() {
        let frame = Frame {
            generation: 0x0102_0304,
            sequence: 7,
            flags: FrameFlags { moving: false, last: true, coarse: true },
            size: [1280, 720],
            spp: 16,
            time_ms: 99,
            payload: Payload::Jpeg,
            bytes: vec![0xff, 0xd8],
        };
        let expected = [
            &b"RSF1\x01\x06\0\0"[..],
            &[4, 3, 2, 1, 7, 0, 0, 0],
            &[0, 0, 0, 0, 0, 5, 0xd0, 2],
            &[16, 0, 0, 0, 99, 0, 0, 0],
            &[0xff, 0xd8],
        ];
        assert_eq!(frame.to_bytes(), expected.concat());
    }
}
