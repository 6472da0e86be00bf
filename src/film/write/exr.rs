//! OpenEXR: one part whose channels hold the picture and all of its layers.

use super::super::{LayerValues, Picture};
use super::cryptomatte::{self, LEVELS};
use super::header::sort_attributes;
use super::metadata::{SOFTWARE, name_in_file, names, numbers};
use super::{ExrCompression, WriteOptions};
use exr::meta::attribute::{AttributeValue, Chromaticities, Matrix4x4};
use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, ImageAttributes, IntegerBounds,
    LayerAttributes, LineOrder, SmallVec, Text, Vec2, WritableImage, f16,
};
use std::io::{self, Read, Seek, Write};

/// Writes a picture into an empty file.
pub fn write(mut file: impl Read + Write + Seek, picture: &Picture, options: WriteOptions) -> io::Result<()> {
    let size = Vec2(picture.image.width as usize, picture.image.height as usize);
    let (position, whole) = windows(picture);
    let mut layer = exr::image::Layer::new(
        size,
        LayerAttributes { layer_position: position, ..attributes(picture) },
        Encoding {
            compression: compression(options.exr_compression),
            blocks: Blocks::ScanLines,
            line_order: LineOrder::Increasing,
        },
        AnyChannels::sort(channels(picture, options.exr_half)),
    );
    // No channel holds colours of half the size that lossy compressions may round on a curve.
    layer.channel_data.list.iter_mut().for_each(|channel| channel.quantize_linearly = false);
    let display = IntegerBounds::new((0, 0), whole.unwrap_or(size));
    let shared = ImageAttributes { chromaticities: Some(REC_709), ..ImageAttributes::new(display) };
    let image = exr::image::Image::new(shared, layer);
    let written = image.write().to_unbuffered(&mut file);
    written.map_err(|error| match error {
        exr::error::Error::Io(error) => error,
        error => io::Error::other(error),
    })?;
    sort_attributes(&mut file)
}

/// The colours that R, G and B mean.
const REC_709: Chromaticities = Chromaticities {
    red: Vec2(0.64, 0.33),
    green: Vec2(0.3, 0.6),
    blue: Vec2(0.15, 0.06),
    white: Vec2(0.3127, 0.329),
};

fn compression(compression: ExrCompression) -> Compression {
    match compression {
        ExrCompression::None => Compression::Uncompressed,
        ExrCompression::Rle => Compression::RLE,
        ExrCompression::Zips => Compression::ZIP1,
        ExrCompression::Zip => Compression::ZIP16,
        ExrCompression::Piz => Compression::PIZ,
    }
}

/// Place of the picture in a larger one, and that one's size.
fn windows(picture: &Picture) -> (Vec2<i32>, Option<Vec2<usize>>) {
    let fact = |name: &str| picture.metadata.get(name).map(String::as_str);
    let region = fact(Picture::REGION).and_then(numbers::<u32, 4>);
    let whole = fact(Picture::WHOLE_SIZE).and_then(numbers::<u32, 2>);
    match (region, whole) {
        (Some([x, y, ..]), Some([width, height])) => {
            (Vec2(x as i32, y as i32), Some(Vec2(width as usize, height as usize)))
        }
        _ => (Vec2(0, 0), None),
    }
}

/// A text in UTF-8.
fn text(text: &str) -> Text {
    Text::from_bytes_unchecked(SmallVec::from_slice(text.as_bytes()))
}

fn attributes(picture: &Picture) -> LayerAttributes {
    let mut attributes =
        LayerAttributes { software_name: Some(text(SOFTWARE)), ..LayerAttributes::default() };
    attributes.world_to_camera = world_to_camera(picture);
    attributes.world_to_normalized_device = world_to_ndc(picture);
    let mut put = |name: &str, value: &str| {
        attributes.other.insert(text(name), AttributeValue::Text(text(value)));
    };
    for (name, value) in &picture.metadata {
        put(&name_in_file(name), value);
    }
    for layer in &picture.layers {
        match &layer.values {
            LayerValues::Coverage(coverage) => {
                let name = cryptomatte::type_name(layer.name);
                let key = cryptomatte::key(&name);
                put(&format!("cryptomatte/{key}/name"), &name);
                put(&format!("cryptomatte/{key}/hash"), "MurmurHash3_32");
                put(&format!("cryptomatte/{key}/conversion"), "uint32_to_float32");
                put(&format!("cryptomatte/{key}/manifest"), &cryptomatte::manifest(&coverage.names));
            }
            LayerValues::Ids { .. } | LayerValues::Floats { .. } => {
                if let Some(names) = names(layer) {
                    let names = serde_json::to_string(names).expect("texts are JSON");
                    put(&format!("raystream/{}_names", layer.name), &names);
                }
            }
        }
    }
    attributes
}

/// OpenEXR's matrix from the world to the camera: points are rows, y is up and z is forward, where the fact has
/// columns, y down and z forward.
fn world_to_camera(picture: &Picture) -> Option<Matrix4x4> {
    let rows = numbers::<f32, 16>(picture.metadata.get(Picture::WORLD_TO_CAMERA)?)?;
    let row_sign = [1.0, -1.0, 1.0, 1.0];
    Some(std::array::from_fn(|i| row_sign[i % 4] * rows[i % 4 * 4 + i / 4]))
}

/// OpenEXR's matrix from the world to the picture, whose corners are (0, 0), above on the left, and (1, 1). There is
/// one for cameras without distortion only.
fn world_to_ndc(picture: &Picture) -> Option<Matrix4x4> {
    let rows = numbers::<f32, 16>(picture.metadata.get(Picture::WORLD_TO_CAMERA)?)?;
    let [fx, fy, cx, cy] = numbers::<f32, 4>(picture.metadata.get(Picture::INTRINSICS)?)?;
    let whole =
        windows(picture).1.unwrap_or(Vec2(picture.image.width as usize, picture.image.height as usize));
    let (width, height) = (whole.0 as f32, whole.1 as f32);
    let column = |i: usize| std::array::from_fn::<f32, 4, _>(|row| rows[4 * row + i]);
    let projected = |[x, y, z, w]: [f32; 4]| {
        // The third coordinate is 0 at distance 1 and 1 at infinity.
        [(fx * x + cx * z) / width, (fy * y + cy * z) / height, z - w, z]
    };
    let columns: [[f32; 4]; 4] = std::array::from_fn(|i| projected(column(i)));
    Some(std::array::from_fn(|i| columns[i / 4][i % 4]))
}

/// The name of a layer before the dots of its channels.
fn prefix(layer: &str) -> String {
    match layer {
        "z" => String::new(),
        "normal" => "N.".into(),
        "shading-normal" => "Ns.".into(),
        "position" => "P.".into(),
        other => format!("{other}."),
    }
}

/// True if half-precision floats suffice for a layer.
fn may_be_half(layer: &str) -> bool {
    matches!(
        layer,
        "normal"
            | "shading-normal"
            | "albedo"
            | "emission"
            | "denoising-albedo"
            | "denoising-normal"
            | "noisy"
    )
}

type Channels = SmallVec<[AnyChannel<FlatSamples>; 4]>;

fn channels(picture: &Picture, half: bool) -> Channels {
    let mut channels = Channels::new();
    let mut put = |name: String, samples| channels.push(AnyChannel::new(text(&name), samples));
    for (i, name) in ["R", "G", "B"].into_iter().enumerate() {
        put(name.into(), floats(picture.image.pixels.iter().map(|pixel| pixel[i]), half));
    }
    if let Some(alpha) = &picture.alpha {
        put("A".into(), floats(alpha.iter().copied(), half));
    }
    for layer in &picture.layers {
        let prefix = prefix(layer.name);
        match &layer.values {
            LayerValues::Floats { channels, values } => {
                for (i, channel) in channels.iter().enumerate() {
                    let values = values.iter().skip(i).step_by(channels.len()).copied();
                    put(format!("{prefix}{channel}"), floats(values, half && may_be_half(layer.name)));
                }
            }
            LayerValues::Ids { ids, .. } => put(format!("{prefix}X"), FlatSamples::U32(ids.clone())),
            LayerValues::Coverage(coverage) => {
                let name = cryptomatte::type_name(layer.name);
                let names =
                    (0..LEVELS).flat_map(|level| ["R", "G", "B", "A"].map(|channel| (level, channel)));
                for ((level, channel), values) in names.zip(cryptomatte::ranks(coverage)) {
                    put(format!("{name}{level:02}.{channel}"), FlatSamples::F32(values));
                }
            }
        }
    }
    channels
}

/// Floats, or the nearest finite half-precision floats.
fn floats(values: impl Iterator<Item = f32>, half: bool) -> FlatSamples {
    let nearest = |value: f32| match value {
        value if value.is_finite() => f16::from_f32(value.clamp(f16::MIN.to_f32(), f16::MAX.to_f32())),
        value => f16::from_f32(value),
    };
    if half { FlatSamples::F16(values.map(nearest).collect()) } else { FlatSamples::F32(values.collect()) }
}
