//! How pictures are encoded.

use crate::film::{ExrCompression, PngBits, WriteOptions};
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};

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
}

impl PictureArgs {
    /// The options.
    pub fn options(&self) -> WriteOptions {
        WriteOptions::default()
            .with_png_bits(self.png_bits)
            .with_exr_compression(self.exr_compression)
            .with_exr_half(self.exr_half)
    }
}

fn png_bits(text: &str) -> Result<PngBits, &'static str> {
    match text {
        "8" => Ok(PngBits::Eight),
        "16" => Ok(PngBits::Sixteen),
        _ => Err("a channel of a .png has 8 or 16 bits"),
    }
}

fn compression() -> impl TypedValueParser<Value = ExrCompression> {
    let named = |name: String| ExrCompression::ALL.into_iter().find(|compression| compression.name() == name);
    PossibleValuesParser::new(ExrCompression::ALL.map(ExrCompression::name))
        .map(move |name| named(name).expect("one of the possible values"))
}
