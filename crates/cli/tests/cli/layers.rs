//! Layers besides the picture: files, statistics, refusals.

use super::trace::{array, write_rays};
use super::{SQUARE, folder, json, run, shipped};
use raystream::scene::{Camera, Projection, load};
use std::path::Path;

/// All AOVs.
pub const ALL: &str = "depth,z,normal,shading-normal,position,albedo,uv,emission,object,material,instance,primitive,\
                       samples,variance,crypto-object,crypto-material,crypto-asset";

fn npy<T: npyz::Deserialize>(path: &Path) -> Vec<T> {
    let bytes = std::fs::read(path).expect("a layer");
    npyz::NpyFile::new(&bytes[..]).expect("header").into_vec().expect("data")
}

#[test]
fn depths_have_the_bits_of_traced_rays() {
    let parallel = |camera: Camera| camera.with_projection(Projection::Orthographic { height: 3.0 });
    let around = |camera: Camera| camera.with_projection(Projection::Panorama);
    assert_depths_have_the_bits_of_traced_rays("cornell.json", &[], |camera| camera);
    assert_depths_have_the_bits_of_traced_rays("showcase.json", &[], |camera| camera);
    assert_depths_have_the_bits_of_traced_rays("showcase.json", &["--orthographic", "3"], parallel);
    assert_depths_have_the_bits_of_traced_rays("glass.json", &["--panorama"], around);
}

/// `change` does to the scene's camera what the options do.
fn assert_depths_have_the_bits_of_traced_rays(name: &str, more: &[&str], change: fn(Camera) -> Camera) {
    let folder = folder();
    let scene = shipped(name);
    let args = ["render", &scene, "-o", "a.npy", "--size", "40x30", "--spp", "1", "--aov", "depth,primitive"];
    run(folder.path(), &[&args, more].concat(), 0);
    let camera = change(load::load(&scene).expect("scene").camera.expect("the scene's own"));
    let lens = camera.lens(40, 30).expect("a camera");
    let mut rays = Vec::new();
    for (x, y) in (0..30).flat_map(|y| (0..40).map(move |x| (x, y))) {
        let (origin, direction) = lens.ray(x, y, [0.5; 2]).expect("the lens sees all");
        rays.extend([
            origin.x,
            origin.y,
            origin.z,
            0.0,
            direction.x,
            direction.y,
            direction.z,
            f32::INFINITY,
        ]);
    }
    write_rays(&folder.path().join("r.npy"), &rays);
    run(folder.path(), &["trace", &scene, "--rays", "r.npy", "-o", "h.npz"], 0);
    let hits = folder.path().join("h.npz");
    let bits = |numbers: Vec<f32>| numbers.into_iter().map(f32::to_bits).collect::<Vec<_>>();
    let depths: Vec<f32> = npy(&folder.path().join("a.depth.npy"));
    assert!(depths.iter().all(|depth| depth.is_finite() || *depth == f32::INFINITY));
    assert_eq!(bits(depths), bits(array(&hits, "t")), "{name} {more:?}");
    let primitives: Vec<u32> = npy(&folder.path().join("a.primitive.npy"));
    assert_eq!(primitives, array::<u32>(&hits, "primitive"));
}

#[test]
fn frames_and_checkpoints_have_layers() {
    let folder = folder();
    std::fs::write(folder.path().join("a.obj"), SQUARE).expect("scene");
    let still = |more: &[&str]| {
        let mut args = vec!["render", "a.obj", "-o", "a.exr", "--size", "32x24", "--spp", "64", "--aov", ALL];
        args.extend(["--transparent", "--stats", "s.json"]);
        args.extend(more);
        run(folder.path(), &args, 0);
        json(&folder.path().join("s.json"))["image"]["layers"].clone()
    };
    let layers = still(&[]);
    assert_eq!(layers.as_object().expect("hashes").len(), 18, "{layers}");
    assert_eq!(still(&["--threads", "1", "--simd", "scalar"]), layers);
    assert_eq!(still(&["--checkpoint", "c", "--save-every", "0.01"]), layers);
    assert_eq!(still(&["--checkpoint", "c", "--resume"]), layers);
    let mut args =
        vec!["render", "a.obj", "-o", "f%d.npy", "--size", "32x24", "--spp", "2", "--frames", "0..2"];
    args.extend(["--turntable", "9", "--aov", "depth,object", "--stats", "s.json"]);
    run(folder.path(), &args, 0);
    let stats = json(&folder.path().join("s.json"));
    let depth = |frame: usize| stats["frames"][frame]["layers"]["depth"].as_str().expect("a hash").to_owned();
    assert_ne!(depth(0), depth(1));
    for name in ["f0.npy", "f0.depth.npy", "f1.depth.npy", "f1.object.npy", "f1.ids.json"] {
        assert!(folder.path().join(name).exists(), "{name}");
    }
}

#[test]
fn layers_that_cannot_be_made_are_refused() {
    let folder = folder();
    std::fs::write(folder.path().join("a.obj"), SQUARE).expect("scene");
    std::fs::create_dir(folder.path().join("a.depth.npy")).expect("folder");
    for (more, says) in [
        (vec!["--aov", "depth,colour"], "there are depth, z, normal, shading-normal, position"),
        (vec!["--aov", "variance", "--spp", "1"], "at least 2 samples"),
        (vec!["--aov", "depth"], "a.depth.npy"),
        (vec!["--aov", ALL, "--size", "8000x8000", "--spp", "4096", "--memory", "9G"], "--memory"),
    ] {
        // The files of layers are checked before the memory.
        let output = if says == "--memory" { "b.npy" } else { "a.npy" };
        let mut args = vec!["render", "a.obj", "-o", output, "--size", "8x8"];
        args.retain(|arg| !more.contains(&"--size") || (*arg != "--size" && *arg != "8x8"));
        args.extend(&more);
        let printed = run(folder.path(), &args, 2);
        assert!(printed.contains(says), "{more:?} does not say {says:?} but:\n{printed}");
        assert!(!folder.path().join("a.npy").exists(), "{more:?} left a file");
    }
}

#[test]
fn layers_may_be_png_files() {
    let folder = folder();
    let path = |name: &str| folder.path().join(name);
    let scene = shipped("cornell.json");
    let render = |more: &[&str], code: i32| {
        let mut args = vec!["render", &*scene, "--size", "40x30", "--spp", "2", "--aov"];
        args.extend(["depth,normal,object,uv,crypto-object", "--aov-format", "png"]);
        args.extend(more);
        run(folder.path(), &args, code)
    };
    render(&["-o", "a.png", "--stats", "s.json", "--partial", "p.rayfilm"], 0);
    for name in ["a.png", "a.depth.png", "a.normal.png", "a.object.png", "a.uv.npy", "a.crypto-object.npy"] {
        assert!(path(name).exists(), "{name}");
    }
    assert!(path("a.ids.json").exists() && !path("a.depth.npy").exists());
    // Distances are those of the array, to half a step.
    let plain = ["render", &*scene, "--size", "40x30", "--spp", "2", "--aov", "depth", "-o", "b.png"];
    run(folder.path(), &plain, 0);
    let depths: Vec<f32> = npy(&path("b.depth.npy"));
    let image = image::open(path("a.depth.png")).expect("a PNG file").into_luma16();
    let furthest = depths.iter().copied().filter(|depth| depth.is_finite()).fold(0.0, f32::max);
    let greatest = image.pixels().map(|pixel| pixel.0[0]).max().expect("pixels");
    assert!(greatest > 26_000, "2 and 5 times a power of ten lose at most a factor of 2.5: {greatest}");
    let unit = furthest / f32::from(greatest);
    for (pixel, depth) in image.pixels().zip(depths) {
        let stored = f32::from(pixel.0[0]);
        assert!(
            if depth.is_finite() { (stored * unit - depth).abs() < unit } else { stored == 0.0 },
            "{depth}"
        );
    }
    run(folder.path(), &["merge", "p.rayfilm", "-o", "m.png", "--aov-format", "png"], 0);
    for layer in ["depth", "object"] {
        let [one, other] =
            ["a", "m"].map(|name| image::open(path(&format!("{name}.{layer}.png"))).expect("PNG"));
        assert!(one == other, "{layer}");
    }
    let printed = render(&["-o", "a.exr"], 2);
    assert!(printed.contains("a.exr holds its layers itself"), "{printed}");
    let printed = render(&["-o", "c.png", "--stats", "c.depth.png"], 2);
    assert!(printed.contains("c.depth.png"), "{printed}");
}
