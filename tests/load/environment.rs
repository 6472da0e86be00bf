//! Environment maps.

use crate::folder::{Folder, assert_holds};
use image::{DynamicImage, Rgb32FImage};
use raystream::scene::load::{LARGEST_RADIANCE, OVERFLOWED_RADIANCE, environment};

fn save(folder: &Folder, name: &str, width: u32, texels: &[[f32; 3]]) {
    let image = Rgb32FImage::from_raw(width, texels.len() as u32 / width, texels.concat());
    DynamicImage::ImageRgb32F(image.expect("enough texels")).save(folder.path(name)).expect("an image");
}

#[test]
fn texels_keep_their_place_and_value() {
    // Powers of two survive the shared exponent of an HDR file.
    let texels = [[1.0, 0.5, 2.0], [4.0, 0.0, 8.0], [0.25, 0.25, 0.25], [1024.0, 512.0, 2048.0]];
    let folder = Folder::new();
    for name in ["a.hdr", "a.exr", "A.EXR"] {
        save(&folder, name, 2, &texels);
        let map = environment(&folder.path(name)).expect("an environment");
        assert_eq!((map.width, map.height, map.rotation_degrees), (2, 2, 0.0));
        assert_eq!(*map.texels, texels, "{name}: first row first");
    }
}

#[test]
fn what_is_not_radiance_is_replaced() {
    let folder = Folder::new();
    let infinity = f32::INFINITY;
    save(&folder, "a.exr", 2, &[[f32::NAN, -1.0, 1.0], [infinity, -infinity, 3.0e38]]);
    let map = environment(&folder.path("a.exr")).expect("an environment");
    assert_eq!(*map.texels, [[0.0, 0.0, 1.0], [OVERFLOWED_RADIANCE, 0.0, LARGEST_RADIANCE]]);
}

#[test]
fn files_that_are_not_maps_are_refused() {
    let folder = Folder::new();
    let message = |name: &str| {
        let message = environment(&folder.path(name)).expect_err("refused").to_string();
        assert_holds(&message, &[name]);
        message
    };
    assert_holds(&message("lost.hdr"), &["cannot read"]);
    assert_holds(&message("sky.png"), &[".hdr or .exr"]);
    folder.write("noise.exr", "noise");
    assert_holds(&message("noise.exr"), &["cannot be decoded"]);
    let header = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 100000 +X 100000\n";
    folder.write("huge.hdr", header);
    assert_holds(&message("huge.hdr"), &["100000 x 100000", "120000000000", "2147483648"]);
    folder.write("large.hdr", header.replace("100000", "10000"));
    assert_holds(&message("large.hdr"), &["10000 x 10000", "1200000000", "only 53", "damaged"]);
    folder.write("none.hdr", header.replace("100000", "0"));
    assert_holds(&message("none.hdr"), &["0"]);
    save(&folder, "half.exr", 8, &[[1.0; 3]; 64]);
    let bytes = std::fs::read(folder.path("half.exr")).expect("just written");
    folder.write("half.exr", &bytes[..bytes.len() - 100]);
    assert_holds(&message("half.exr"), &["cannot be decoded"]);
}
