//! Files hold what they are given.

use super::super::{Coverage, Exposure, Layer, LayerValues, View};
use super::*;
use ::exr::meta::attribute::AttributeValue;
use ::exr::prelude::{FlatSamples, Text};
use std::collections::BTreeMap;

fn image() -> Image {
    let pixels = (0..12).map(|i| [i as f32 / 8.0, 0.5, 0.02 * i as f32]).collect();
    Image { width: 4, height: 3, pixels }
}

/// A picture with a layer of each kind.
fn picture() -> Picture {
    let floats = |name, channels: &'static [&'static str]| {
        let values = (0..12 * channels.len()).map(|i| i as f32 / 7.0).collect();
        Layer { name, values: LayerValues::Floats { channels, values } }
    };
    let mut ids: Vec<u32> = (0..12).map(|i| i % 2).collect();
    ids[0] = LayerValues::NO_ID;
    let names = ["Würfel", "floor"].map(String::from).to_vec();
    let mut entries = Vec::new();
    let starts = (0..12).map(|pixel| {
        let start = entries.len() as u32;
        entries.extend((pixel > 0).then_some((0, pixel)));
        entries.extend((pixel % 3 == 1).then_some((1, 12 - pixel)));
        start
    });
    let mut starts: Vec<u32> = starts.collect();
    starts.push(entries.len() as u32);
    let coverage = Coverage { names: names.clone(), starts, entries, samples: vec![12; 12] };
    Picture {
        alpha: Some((0..12).map(|i| i as f32 / 11.0).collect()),
        layers: vec![
            floats("depth", &["Z"]),
            floats("z", &["Z"]),
            floats("normal", &["X", "Y", "Z"]),
            Layer { name: "object", values: LayerValues::Ids { ids, names } },
            Layer { name: "primitive", values: LayerValues::Ids { ids: vec![7; 12], names: Vec::new() } },
            Layer { name: "crypto-object", values: LayerValues::Coverage(coverage) },
        ],
        metadata: [("spp", "12"), ("scene_hash", "0123"), ("camera", "Größe")]
            .map(|(name, value)| (name.into(), value.into()))
            .into(),
        ..Picture::new(image())
    }
}

#[test]
fn pictures_that_another_program_has_denoised_keep_the_noisy_one() {
    let folder = tempfile::tempdir().expect("folder");
    let noisy = image();
    let of = |denoiser: &str| Picture::new(noisy.clone()).with_denoised(image(), denoiser.into());
    let write = |name, denoiser| write_to(folder.path(), name, &of(denoiser), WriteOptions::default());
    let names = |path: &Path| -> Vec<String> {
        read_exr(path).0.channel_data.list.iter().map(|channel| channel.name.to_string()).collect()
    };
    assert_eq!(names(&write("a.exr", "oidn 2.5.1")), ["B", "G", "R", "noisy.B", "noisy.G", "noisy.R"]);
    assert_eq!(names(&write("b.exr", "raystream 1")), ["B", "G", "R"], "which anyone can have again");
    write("c.png", "oidn 2.5.1");
    assert_eq!(std::fs::read_dir(folder.path()).expect("folder").count(), 3, "and no file beside a .png");
}

fn write_to(folder: &Path, name: &str, picture: &Picture, options: WriteOptions) -> PathBuf {
    let path = folder.join(name);
    write_picture(&path, picture, &Look::default(), &options).expect(name);
    path
}

type ExrLayer = ::exr::image::Layer<::exr::prelude::AnyChannels<FlatSamples>>;

/// The part of an EXR file and the window that shows it.
fn read_exr(path: &Path) -> (ExrLayer, ::exr::prelude::IntegerBounds) {
    let image = ::exr::prelude::read_first_flat_layer_from_file(path).expect("an EXR file");
    (image.layer_data, image.attributes.display_window)
}

fn channel<'a>(layer: &'a ExrLayer, name: &str) -> &'a FlatSamples {
    let found = layer.channel_data.list.iter().find(|channel| channel.name.eq(name));
    &found.unwrap_or_else(|| panic!("no channel {name}")).sample_data
}

#[test]
fn every_format_reads_back() {
    let folder = tempfile::tempdir().expect("folder");
    let image = image();
    let look = Look::default();
    let shown = png::samples(&Picture::new(image.clone()), &look, PngBits::Eight);
    for name in ["a.png", "a.exr", "a.hdr"] {
        let path = folder.path().join(name);
        write_image(&path, &image, &look).expect(name);
        let back = ::image::load_from_memory(&std::fs::read(&path).expect(name)).expect(name).to_rgb32f();
        assert_eq!((back.width(), back.height()), (4, 3));
        for (i, p) in back.pixels().enumerate() {
            for c in 0..3 {
                let wanted = image.pixels[i][c];
                let (wanted, bound) = match name {
                    "a.exr" => (wanted, 0.0),
                    "a.hdr" => (wanted, 0.01),
                    _ => (f32::from(shown[3 * i + c]) / 255.0, 1e-6),
                };
                assert!((p[c] - wanted).abs() <= bound, "{name} pixel {i}: {} {wanted}", p[c]);
            }
        }
    }
    let path = folder.path().join("a.npy");
    write_image(&path, &image, &look).expect("npy");
    let npy = npyz::NpyFile::new(std::fs::File::open(&path).expect("file")).expect("header");
    assert_eq!(npy.shape(), &[3, 4, 3]);
    assert_eq!(npy.into_vec::<f32>().expect("data"), image.pixels.as_flattened());
}

#[test]
fn an_exr_file_holds_all_layers() {
    let folder = tempfile::tempdir().expect("folder");
    let picture = picture();
    for compression in ExrCompression::ALL {
        let options = WriteOptions::default().with_exr_compression(compression);
        let path = write_to(folder.path(), "a.exr", &picture, options);
        let (layer, display) = read_exr(&path);
        assert_eq!((layer.size.0, layer.size.1, display.size.0), (4, 3, 4));
        for (i, layer_values) in picture.layers.iter().map(|layer| &layer.values).enumerate() {
            match (picture.layers[i].name, layer_values) {
                (name, LayerValues::Floats { values, channels }) => {
                    let prefix = ["depth.", "", "N."][i];
                    for (c, letter) in channels.iter().enumerate() {
                        let wanted = values.iter().skip(c).step_by(channels.len()).copied().collect();
                        assert_eq!(
                            channel(&layer, &format!("{prefix}{letter}")),
                            &FlatSamples::F32(wanted),
                            "{name}"
                        );
                    }
                }
                (name, LayerValues::Ids { ids, .. }) => {
                    assert_eq!(channel(&layer, &format!("{name}.X")), &FlatSamples::U32(ids.clone()));
                }
                (_, LayerValues::Coverage(coverage)) => {
                    let ranks = cryptomatte::ranks(coverage);
                    assert_eq!(channel(&layer, "CryptoObject00.G"), &FlatSamples::F32(ranks[1].clone()));
                    assert_eq!(channel(&layer, "CryptoObject02.A"), &FlatSamples::F32(ranks[11].clone()));
                }
            }
        }
        assert_eq!(channel(&layer, "A"), &FlatSamples::F32(picture.alpha.clone().expect("alpha")));
        let attribute = |name: &str| match layer.attributes.other.get(&Text::from(name)) {
            Some(AttributeValue::Text(text)) => String::from_utf8(text.as_slice().to_vec()).expect("UTF-8"),
            other => panic!("{name}: {other:?}"),
        };
        assert_eq!(attribute("raystream/camera"), "Größe");
        assert_eq!(attribute("raystream/object_names"), r#"["Würfel","floor"]"#);
        assert_eq!(attribute("cryptomatte/3ae39a5/name"), "CryptoObject");
        assert!(attribute("cryptomatte/3ae39a5/manifest").contains(r#""floor":"#));
    }
}

#[test]
fn equal_pictures_have_equal_files() {
    let folder = tempfile::tempdir().expect("folder");
    for name in ["a.exr", "a.png", "a.npz", "a.npy"] {
        let write = || std::fs::read(write_to(folder.path(), name, &picture(), WriteOptions::default()));
        assert_eq!(write().expect("file"), write().expect("file"), "{name}");
    }
}

#[test]
fn a_region_is_a_data_window() {
    let folder = tempfile::tempdir().expect("folder");
    let mut picture = picture();
    let mut say = |name: &str, value: &str| picture.metadata.insert(name.into(), value.into());
    say(Picture::REGION, "20,10,4,3");
    say(Picture::WHOLE_SIZE, "64,32");
    say(Picture::WORLD_TO_CAMERA, "1,0,0,0, 0,-1,0,2, 0,0,-1,5, 0,0,0,1");
    say(Picture::INTRINSICS, "100,100,32,16");
    let (layer, display) = read_exr(&write_to(folder.path(), "a.exr", &picture, WriteOptions::default()));
    assert_eq!((layer.attributes.layer_position.0, layer.attributes.layer_position.1), (20, 10));
    assert_eq!((display.position.0, display.size.0, display.size.1), (0, 64, 32));
    // A point as a row, times the matrix.
    let times = |[x, y, z]: [f32; 3], m: [f32; 16]| -> [f32; 4] {
        std::array::from_fn(|j| x * m[j] + y * m[4 + j] + z * m[8 + j] + m[12 + j])
    };
    let to_camera = layer.attributes.world_to_camera.expect("a camera");
    assert_eq!(times([1.0, 3.0, -5.0], to_camera), [1.0, 1.0, 10.0, 1.0], "y up, z forward");
    let to_ndc = layer.attributes.world_to_normalized_device.expect("a projection");
    let [x, y, _, w] = times([1.0, 3.0, -5.0], to_ndc);
    assert_eq!([x / w * 64.0, y / w * 32.0], [100.0 * 0.1 + 32.0, 100.0 * -0.1 + 16.0]);
}

#[test]
fn half_floats_are_finite_and_ids_stay_whole() {
    let folder = tempfile::tempdir().expect("folder");
    let mut picture = picture();
    picture.image.pixels[0] = [1e9, -1e9, 0.1];
    let options = WriteOptions::default().with_exr_half(true);
    let (layer, _) = read_exr(&write_to(folder.path(), "a.exr", &picture, options));
    let values = |name| channel(&layer, name).values_as_f32().collect::<Vec<_>>();
    assert_eq!((values("R")[0], values("G")[0]), (65504.0, -65504.0));
    assert!(matches!(channel(&layer, "N.X"), FlatSamples::F16(_)));
    assert!(matches!(channel(&layer, "Z"), FlatSamples::F32(_)));
    assert!(matches!(channel(&layer, "object.X"), FlatSamples::U32(_)));
}

#[test]
fn layers_lie_beside_pictures_without_room() {
    let picture = picture();
    let layers = || picture.layers.iter().map(|layer| layer.name);
    for (name, alpha) in
        [("a.b.png", false), ("a.b.npy", false), ("a.b.hdr", true), ("a.b.exr", false), ("a.b.npz", false)]
    {
        let folder = tempfile::tempdir().expect("folder");
        write_to(folder.path(), name, &picture, WriteOptions::default());
        let mut planned = picture_files(&folder.path().join(name), layers(), true, &WriteOptions::default())
            .expect("a format");
        let there =
            std::fs::read_dir(folder.path()).expect("folder").map(|entry| entry.expect("entry").path());
        let mut there: Vec<_> = there.collect();
        assert_eq!(planned.contains(&folder.path().join("a.b.alpha.npy")), alpha, "{name}");
        planned.sort();
        there.sort();
        assert_eq!(planned, there, "{name}");
        let Ok(text) = std::fs::read(folder.path().join("a.b.ids.json")) else { continue };
        let ids: serde_json::Value = serde_json::from_slice(&text).expect("JSON");
        assert_eq!(
            ids,
            serde_json::json!({"object": ["Würfel", "floor"], "crypto-object": ["Würfel", "floor"]})
        );
        let npy = |layer: &str| {
            let file = std::fs::File::open(folder.path().join(format!("a.b.{layer}.npy"))).expect("a file");
            npyz::NpyFile::new(file).expect("an array")
        };
        assert_eq!((npy("depth").shape(), npy("normal").shape()), (&[3, 4][..], &[3, 4, 3][..]));
        let rows = npy("crypto-object").into_vec::<u32>().expect("uint32");
        assert_eq!(rows[..6], [0, LayerValues::NO_ID, 12, 1, 0, 1], "pixel, id, samples");
        assert_eq!(rows.chunks(3).map(|row| row[2]).sum::<u32>(), 12 * 12, "every sample is told");
    }
}

#[test]
fn png_has_straight_alpha_and_metadata() {
    let folder = tempfile::tempdir().expect("folder");
    let mut picture = Picture::new(Image::new(2, 1, vec![[0.25, 0.0, 0.5], [0.0; 3]]));
    picture.alpha = Some(vec![0.5, 0.0]);
    picture.metadata = [("spp", "12"), ("camera", "Größe")].map(|(n, v)| (n.into(), v.into())).into();
    let look = Look::default().with_view(View::Raw);
    let path = folder.path().join("a.png");
    for (bits, half) in [(PngBits::Eight, 128.0 / 255.0), (PngBits::Sixteen, 32768.0 / 65535.0)] {
        write_picture(&path, &picture, &look, &WriteOptions::default().with_png_bits(bits)).expect("png");
        let back = ::image::load_from_memory(&std::fs::read(&path).expect("png")).expect("png").to_rgba32f();
        assert_eq!(back.as_raw()[..], [half, 0.0, 1.0, half, 0.0, 0.0, 0.0, 0.0]);
    }
    let file = std::io::BufReader::new(std::fs::File::open(&path).expect("file"));
    let mut reader = ::png::Decoder::new(file).read_info().expect("png");
    reader.finish().expect("png");
    let info = reader.info();
    let text =
        info.uncompressed_latin1_text.iter().find(|text| text.keyword == "raystream/spp").expect("spp");
    assert_eq!(text.text, "12");
    assert_eq!(info.utf8_text[0].get_text().expect("text"), "Größe");
}

#[test]
fn srgb_is_exposed_cut_and_rounded() {
    let picture = Picture::new(Image { width: 1, height: 1, pixels: vec![[0.25, 9.0, f32::NAN]] });
    let look = Look::default().with_view(View::Standard);
    let bytes = |look: &Look| png::samples(&picture, look, PngBits::Sixteen);
    assert_eq!(bytes(&look), [0x89, 0x7f, 255, 255, 0, 0]);
    assert_eq!(bytes(&look.with_exposure(Exposure::Stops(2.0)))[..2], [255, 255]);
}

/// A dark gradient has its mean in every small square, and a part has the pixels of the whole.
#[test]
fn eight_bits_are_dithered() {
    let pixels = (0..64 * 64).map(|i| [0.03 + 0.00001 * (i % 64) as f32; 3]).collect();
    let mut picture = Picture::new(Image { width: 64, height: 64, pixels });
    let look = Look::default().with_view(View::Standard);
    let shown = png::samples(&picture, &look, PngBits::Eight);
    let exact: Vec<f32> = look.encode(&picture.image).map(|value| 255.0 * value).collect();
    for corner in (0..8 * 8).map(|i| (i / 8) * 8 * 64 + (i % 8) * 8) {
        let square = (0..8 * 8).map(|i| 3 * (corner + (i / 8) * 64 + i % 8));
        let (mut found, mut wanted) = (0.0, 0.0);
        for at in square {
            found += f32::from(shown[at]) / 64.0;
            wanted += exact[at] / 64.0;
            assert!((f32::from(shown[at]) - exact[at]).abs() < 1.0);
        }
        assert!((found - wanted).abs() < 0.15, "{found} {wanted}");
    }
    assert!(shown.iter().any(|&value| value != shown[0]));
    let part = crate::film::Region { x: 9, y: 5, width: 20, height: 7 };
    picture.image = Image { width: 20, height: 7, pixels: part.crop(&picture.image.pixels, 64, 1) };
    picture.metadata.insert(Picture::REGION.into(), part.to_string());
    assert_eq!(png::samples(&picture, &look, PngBits::Eight), part.crop(&shown, 64, 3));
    // What 8 bits hold, and raw values, stay as they are.
    let exact =
        Image { width: 256, height: 3, pixels: (0..768).map(|i| [(i % 256) as f32 / 255.0; 3]).collect() };
    let raw = png::samples(&Picture::new(exact), &look.with_view(View::Raw), PngBits::Eight);
    assert!(raw.chunks(3).enumerate().all(|(i, pixel)| pixel == [(i % 256) as u8; 3]));
    let grey = Image { width: 9, height: 1, pixels: [[0.0; 3], [1.0; 3], [7.0; 3]].repeat(3) };
    let shown = png::samples(&Picture::new(grey), &look, PngBits::Eight);
    assert_eq!(shown, [[0; 3], [255; 3], [255; 3]].concat().repeat(3));
}

#[test]
fn failed_writes_return_errors() {
    let folder = tempfile::tempdir().expect("folder");
    std::fs::write(folder.path().join("none"), "").expect("a file, no folder");
    let missing = folder.path().join("none/a.png");
    assert!(matches!(write_image(&missing, &image(), &Look::default()), Err(WriteError::NotWritten(_))));
    assert!(matches!(
        write_image(Path::new("a.gif"), &image(), &Look::default()),
        Err(WriteError::Format { .. })
    ));
    assert!(picture_files(Path::new("a.gif"), ["depth"], false, &WriteOptions::default()).is_err());
}

/// No picture without the layers that belong to it.
#[test]
fn the_picture_is_written_last() {
    let folder = tempfile::tempdir().expect("folder");
    std::fs::create_dir(folder.path().join("a.normal.npy")).expect("folder");
    let path = folder.path().join("a.png");
    let failure = write_picture(&path, &picture(), &Look::default(), &WriteOptions::default());
    assert!(failure.expect_err("a folder has the name").to_string().contains("a.normal.npy"));
    assert!(!path.exists());
}

/// The size, bytes and texts of a PNG file.
fn read_png(path: &Path) -> (::png::OutputInfo, Vec<u8>, BTreeMap<String, String>) {
    let file = std::io::BufReader::new(std::fs::File::open(path).expect("a file"));
    let mut reader = ::png::Decoder::new(file).read_info().expect("a PNG file");
    let mut bytes = vec![0; reader.output_buffer_size().expect("a small picture")];
    let info = reader.next_frame(&mut bytes).expect("its rows");
    let texts = &reader.info().uncompressed_latin1_text;
    (info, bytes, texts.iter().map(|text| (text.keyword.clone(), text.text.clone())).collect())
}

/// A layer of numbers with as many channels as letters.
fn numbers(name: &'static str, channels: &'static [&'static str], values: &[f32]) -> Layer {
    Layer::new(name, LayerValues::Floats { channels, values: values.to_vec() })
}

#[test]
fn layers_become_png_files() {
    const RGB: &[&str] = &["R", "G", "B"];
    let folder = tempfile::tempdir().expect("folder");
    let mut picture = Picture::new(Image::new(2, 1, vec![[0.25; 3]; 2]));
    picture.metadata.insert("spp".into(), "12".into());
    picture.alpha = Some(vec![1.0, 0.25]);
    let ids = LayerValues::Ids { ids: vec![0x0003_0201, LayerValues::NO_ID], names: Vec::new() };
    picture.layers = vec![
        numbers("depth", &["Z"], &[12.0, f32::INFINITY]),
        numbers("z", &["Z"], &[1e-9, 65_535.0]),
        numbers("normal", &["X", "Y", "Z"], &[-1.0, 1.0, 0.0, 0.0, 0.0, 0.0]),
        numbers("albedo", RGB, &[0.214_041_14, 0.0, 1.0, 2.0, f32::NAN, 0.0]),
        numbers("emission", RGB, &[0.25, 0.25, 0.25, 0.0, 0.0, 0.0]),
        numbers("samples", &["Y"], &[12.0, 70_000.0]),
        numbers("uv", &["U", "V"], &[0.0; 4]),
        Layer::new("primitive", ids),
    ];
    let look = Look::default().with_exposure(Exposure::Auto);
    let options = WriteOptions::default().with_layer_format(LayerFormat::Png).with_png_bits(PngBits::Sixteen);
    let path = folder.path().join("a.hdr");
    write_picture(&path, &picture, &look, &options).expect("files");
    let mut planned = picture_files(&path, picture.layers.iter().map(|layer| layer.name), true, &options)
        .expect("a format");
    let mut there: Vec<_> =
        std::fs::read_dir(folder.path()).expect("folder").map(|entry| entry.expect("entry").path()).collect();
    planned.sort();
    there.sort();
    assert_eq!(planned, there);
    assert!(there.contains(&folder.path().join("a.uv.npy")), "texture coordinates have no bounds");
    let read = |layer: &str| read_png(&folder.path().join(format!("a.{layer}.png")));
    let words = |layer: &str| {
        let (info, bytes, _) = read(layer);
        assert_eq!((info.width, info.height, info.bit_depth), (2, 1, ::png::BitDepth::Sixteen), "{layer}");
        bytes.as_chunks().0.iter().map(|word| u16::from_be_bytes(*word)).collect::<Vec<_>>()
    };
    // 12 units take 60000 steps of 0.0002.
    assert_eq!((words("depth"), &*read("depth").2["raystream/unit"]), (vec![60_000, 0], "0.0002"));
    assert_eq!((words("z"), &*read("z").2["raystream/unit"]), (vec![1, 65_535], "1"));
    assert_eq!(words("normal"), [0, 65_535, 32_768, 32_768, 32_768, 32_768]);
    assert_eq!(words("albedo"), [32_768, 0, 65_535, 65_535, 0, 0]);
    assert_eq!(words("samples"), [12, 65_535]);
    assert_eq!(words("alpha"), [65_535, 16_384]);
    let (info, bytes, texts) = read("primitive");
    assert_eq!((info.color_type, info.bit_depth), (::png::ColorType::Rgb, ::png::BitDepth::Eight));
    assert_eq!(bytes, [1, 2, 3, 255, 255, 255]);
    assert_eq!((&*texts["raystream/layer"], &*texts["raystream/spp"]), ("primitive", "12"));
    // Emission has the exposure of the picture, as what it is part of.
    write_picture(folder.path().join("b.png"), &Picture { alpha: None, ..picture.clone() }, &look, &options)
        .expect("files");
    let (_, shown, _) = read_png(&folder.path().join("b.png"));
    assert_eq!(read_png(&folder.path().join("b.emission.png")).1[..6], shown[..6]);
    let eight = options.with_png_bits(PngBits::Eight);
    write_picture(&path, &picture, &look, &eight).expect("files");
    assert_eq!(read("normal").1, [0, 255, 128, 128, 128, 128]);
    assert_eq!(words("depth"), [60_000, 0], "depths have 16 bits always");
}

#[test]
fn layers_that_png_files_cannot_hold_are_refused() {
    let folder = tempfile::tempdir().expect("folder");
    let refused = |layer: Layer| {
        let mut picture = Picture::new(Image::new(1, 1, vec![[0.0; 3]]));
        picture.layers = vec![layer];
        let options = WriteOptions::default().with_layer_format(LayerFormat::Png);
        let path = folder.path().join("a.png");
        let error = write_picture(&path, &picture, &Look::default(), &options).expect_err("no such file");
        assert!(!path.exists());
        error.to_string()
    };
    let ids = |id| LayerValues::Ids { ids: vec![id], names: Vec::new() };
    let text = refused(Layer::new("object", ids(LayerFormat::GREATEST_PNG_ID + 1)));
    assert!(text.contains("a.object.png") && text.contains("the id 16777215"), "{text}");
    for layer in
        [Layer::new("depth", ids(1)), numbers("object", &["Y"], &[1.0]), numbers("normal", &["X"], &[1.0])]
    {
        let text = refused(layer);
        assert!(text.contains("values of another kind"), "{text}");
    }
}

#[test]
fn pictures_in_memory_are_those_of_files() {
    let (folder, picture, look) = (tempfile::tempdir().expect("a folder"), picture(), Look::default());
    for bits in [PngBits::Eight, PngBits::Sixteen] {
        let options = WriteOptions::default().with_png_bits(bits);
        let file = write_to(folder.path(), "a.png", &picture, options);
        assert_eq!(encode_png(&picture, &look, bits), std::fs::read(file).expect("a file"));
    }
    let decoder = ::png::Decoder::new(io::Cursor::new(encode_png(&picture, &look, PngBits::Eight)));
    let mut pixels = vec![0; 12 * 4];
    decoder.read_info().expect("a PNG").next_frame(&mut pixels).expect("pixels");
    assert_eq!(shown_pixels(&picture, &look), pixels);

    let mut arrays = Vec::new();
    let all: Result<(), ()> = each_array(&picture, |name, array| {
        assert_eq!(array.shape.iter().product::<u64>(), array.values.count() as u64, "{name}");
        arrays.push((name, array.shape.clone()));
        Ok(())
    });
    all.expect("nothing fails");
    let names: Vec<&str> = arrays.iter().map(|(name, _)| *name).collect();
    assert_eq!(names, ["image", "alpha", "depth", "z", "normal", "object", "primitive", "crypto-object"]);
    assert_eq!((&*arrays[0].1, &*arrays[2].1, &*arrays[4].1), (&[3, 4, 3][..], &[3, 4][..], &[3, 4, 3][..]));
    let mut count = 0;
    let ended = each_array(&picture, |_, _| {
        count += 1;
        if count == 2 { Err("enough") } else { Ok(()) }
    });
    assert_eq!((ended, count), (Err("enough"), 2));
}
