//! How pictures are encoded.

use crate::film::{ExrCompression, Format, LayerFormat, PngBits, WriteOptions};
use crate::render::{Aov, AovSet};
use anyhow::{Result, ensure};
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use std::path::Path;

/// How pictures are encoded.
#[derive(Debug, Args)]
pub struct PictureArgs {
    /// Bits of a channel in a .png.
    #[arg(long, value_name = "8|16", default_value = "8", value_parser = png_bits)]
    pub png_bits: PngBits,
    /// Lossless compression of an .exr: none, rle, zips (deflate by rows), zip (by 16 rows) or piz (for noise).
    #[arg(long, value_name = "NAME", default_value = ExrCompression::default().name(), value_parser = compression())]
    pub exr_compression: ExrCompression,
    /// Store colours, alpha and normals of an .exr as half-precision floats.
    #[arg(long)]
    pub exr_half: bool,
    /// Files of layers beside a .png, .hdr or .npy: npy, or png with depths, normals, ids and colours for viewers.
    #[arg(long, value_name = "NAME", default_value = LayerFormat::default().name(), value_parser = layer_format())]
    pub aov_format: LayerFormat,
}

impl PictureArgs {
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

fn png_bits(text: &str) -> Result<PngBits, &'static str> {
    match text {
        "8" => Ok(PngBits::Eight),
        "16" => Ok(PngBits::Sixteen),
        _ => Err("a channel of a .png has 8 or 16 bits"),
    }
}

fn layer_format() -> impl TypedValueParser<Value = LayerFormat> {
    let named = |name: String| LayerFormat::ALL.into_iter().find(|format| format.name() == name);
    PossibleValuesParser::new(LayerFormat::ALL.map(LayerFormat::name))
        .map(move |name| named(name).expect("one of the possible values"))
}

fn compression() -> impl TypedValueParser<Value = ExrCompression> {
    let named = |name: String| ExrCompression::ALL.into_iter().find(|compression| compression.name() == name);
    PossibleValuesParser::new(ExrCompression::ALL.map(ExrCompression::name))
        .map(move |name| named(name).expect("one of the possible values"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_that_three_bytes_cannot_number_are_refused() {
        let args = |aov_format| PictureArgs {
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
