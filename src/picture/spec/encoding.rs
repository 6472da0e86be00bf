//! How pictures are encoded.

use super::form;
use super::option::spec_group;
use crate::film::{ExrCompression, Format, LayerFormat, PngBits, WriteOptions};
use crate::render::{Aov, AovSet};
use anyhow::{Result, ensure};
use std::path::Path;

spec_group! {
    /// Encoding of pictures.
    pub struct EncodingSpec {
        /// Bits of a channel in a .png.
        one "png-bits" png_bits: form::Bits = PngBits::Eight, "8|16";
        /// Lossless compression of an .exr: none, rle, zips (deflate by rows), zip (by 16 rows) or piz (for noise).
        one "exr-compression" exr_compression: form::Compression = ExrCompression::default(), "NAME";
        /// Store colours, alpha and normals of an .exr as half-precision floats.
        flag "exr-half" exr_half;
        /// Files of layers beside a .png, .hdr or .npy: npy, or png with depths, normals, ids and colours for viewers.
        one "aov-format" aov_format: form::LayerFormatName = LayerFormat::default(), "NAME";
    }
}

impl EncodingSpec {
    /// The options.
    pub fn options(&self) -> WriteOptions {
        WriteOptions::default()
            .with_png_bits(self.png_bits)
            .with_exr_compression(self.exr_compression)
            .with_exr_half(self.exr_half)
            .with_layer_format(self.aov_format)
    }

    /// Refuses files of layers beside a picture that has its layers in itself.
    pub fn check(&self, picture: &Path) -> Result<()> {
        ensure!(
            self.aov_format == LayerFormat::default() || !Format::of(picture)?.holds_layers(),
            "--aov-format: {} holds its layers itself; leave the option out, or write a .png, .hdr or .npy",
            picture.display()
        );
        Ok(())
    }

    /// Refuses triangles whose numbers a layer cannot hold, before any is rendered.
    pub fn check_ids(&self, aovs: &AovSet, triangles: u64) -> Result<()> {
        let most = u64::from(LayerFormat::GREATEST_PNG_ID) + 1;
        ensure!(
            self.aov_format != LayerFormat::Png || !aovs.has(Aov::Primitive) || triangles <= most,
            "--aov-format png: the scene has {triangles} triangles, and the layer primitive can number {most}; \
             use npy"
        );
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_that_three_bytes_cannot_number_are_refused() {
        let args = |aov_format| EncodingSpec {
            png_bits: PngBits::Eight,
            exr_compression: ExrCompression::default(),
            exr_half: false,
            aov_format,
        };
        let ids = AovSet::default().with(Aov::Primitive);
        let most = 0x00ff_ffff;
        assert!(args(LayerFormat::Png).check_ids(&ids, most).is_ok());
        let refused = args(LayerFormat::Png).check_ids(&ids, most + 1).expect_err("too many");
        assert!(refused.to_string().contains("16777216 triangles"), "{refused}");
        assert!(args(LayerFormat::Npy).check_ids(&ids, most + 1).is_ok());
        assert!(args(LayerFormat::Png).check_ids(&AovSet::default().with(Aov::Object), most + 1).is_ok());
    }
}
