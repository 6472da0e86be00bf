//! Decodes KTX2 files of Basis Universal (ETC1S and UASTC), as glTF's KHR_texture_basisu allows them.

use super::guard::guarded;
use basisu::{DecodeFlags, SourceFormat, TargetFormat, Transcoder};
use image::RgbaImage;

/// The first bytes of a KTX2 file.
const SIGNATURE: [u8; 12] = *b"\xabKTX 20\xbb\r\n\x1a\n";

/// Bytes of the header, before the first level's place.
const HEADER_BYTES: usize = 80;

/// The supercompression that compresses levels once more.
const ZSTANDARD: u32 = 2;

/// A KTX2 file whose header and places lie within the file.
pub(super) struct Ktx2<'a> {
    bytes: &'a [u8],
    pub(super) width: u32,
    pub(super) height: u32,
    /// Bytes of the first level's blocks, if they are compressed once more. 0 otherwise.
    unpacked: u64,
}

impl<'a> Ktx2<'a> {
    /// True if a file begins like a KTX2 file.
    pub(super) fn is_ktx2(bytes: &[u8]) -> bool {
        bytes.starts_with(&SIGNATURE)
    }

    /// Reads the header of a file that [`Self::is_ktx2`].
    ///
    /// # Errors
    /// When it is truncated, names bytes beyond its end, or holds no texture of Basis Universal.
    pub(super) fn new(bytes: &'a [u8]) -> Result<Self, String> {
        let truncated =
            || format!("is a KTX2 file of {} bytes, which are too few: it is truncated", bytes.len());
        let word = |at: usize| -> Option<u32> {
            Some(u32::from_le_bytes(bytes.get(at..)?.get(..4)?.try_into().ok()?))
        };
        let long = |at| Some(u64::from(word(at)?) | u64::from(word(at + 4)?) << 32);
        let [format, width, height, depth, layers, faces, levels, scheme] =
            [12, 20, 24, 28, 32, 36, 40, 44].map(|at| word(at).unwrap_or(0));
        let first = [0, 8, 16].map(|at| long(HEADER_BYTES + at));
        let [Some(offset), Some(length), Some(unpacked)] = first else { return Err(truncated()) };
        if format != 0 {
            return Err(format!(
                "is a KTX2 file of texels in Vulkan's format {format}; Basis Universal (ETC1S, UASTC) is supported"
            ));
        }
        if depth > 0 || layers > 1 || faces != 1 || levels == 0 {
            return Err(format!(
                "is a KTX2 file of {layers} layers, {faces} faces, {levels} levels and a depth of {depth}; a \
                 texture is one image"
            ));
        }
        let places = [
            (word(48).map(u64::from), word(52).map(u64::from)),
            (word(56).map(u64::from), word(60).map(u64::from)),
            (long(64), long(72)),
            (Some(offset), Some(length)),
        ];
        for (start, length) in places {
            let end = start.zip(length).and_then(|(start, length)| start.checked_add(length));
            if end.is_none_or(|end| end > bytes.len() as u64) {
                return Err(truncated());
            }
        }
        let unpacked = if scheme == ZSTANDARD { unpacked } else { 0 };
        let blocks = u64::from(width.div_ceil(4)) * u64::from(height.div_ceil(4));
        let needed = blocks.saturating_mul(16);
        if unpacked > 0 && unpacked != needed {
            return Err(format!(
                "is a KTX2 file whose first level has {unpacked} bytes when decompressed; its blocks take {needed}"
            ));
        }
        Ok(Self { bytes, width, height, unpacked })
    }

    /// Bytes that decoding takes: the texels, and the blocks of a level that was compressed once more.
    pub(super) fn bytes(&self) -> u64 {
        let texels = u64::from(self.width) * u64::from(self.height);
        texels.saturating_mul(4).saturating_add(self.unpacked)
    }

    /// Decodes the largest level.
    ///
    /// # Errors
    /// When the file is damaged, or has texels of a high dynamic range.
    pub(super) fn decode(&self) -> Result<RgbaImage, String> {
        let texels = guarded(|| {
            let cannot =
                |problem: basisu::Error| format!("is a KTX2 file that cannot be decoded: {problem:?}");
            let transcoder = Transcoder::new(self.bytes).map_err(cannot)?;
            let kind = transcoder.source_format();
            if !matches!(kind, SourceFormat::Etc1s | SourceFormat::UastcLdr) {
                return Err(format!("is a KTX2 file of {kind:?}; ETC1S and UASTC are supported"));
            }
            transcoder.transcode(0, TargetFormat::Rgba32, DecodeFlags::NONE).map_err(cannot)
        })?;
        RgbaImage::from_raw(self.width, self.height, texels)
            .ok_or_else(|| "is a KTX2 file with fewer texels than its header says".into())
    }
}
