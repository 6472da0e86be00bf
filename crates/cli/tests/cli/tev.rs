//! Pictures in tev while they are rendered.

use super::viewer::{listen, wait_for};
use super::{folder, run, shipped};

/// The values of a `.npy`.
fn npy(path: &std::path::Path) -> Vec<f32> {
    let bytes = std::fs::read(path).expect("a picture");
    npyz::NpyFile::new(&bytes[..]).expect("an array").into_vec().expect("numbers")
}

#[test]
fn tev_shows_the_picture_and_its_layers() {
    let (folder, scene) = (folder(), shipped("cornell.json"));
    let common =
        ["render", &*scene, "--size", "140x20", "--aov", "z,object", "-o", "a.npy", "--tracer", "cpu"];
    let (address, images) = listen();
    run(folder.path(), &[&common[..], &["--seconds", "1.5", "--tev", &address]].concat(), 0);
    let images = wait_for(&images);
    let shown = &images["a.npy"];
    assert_eq!((images.len(), shown.width, shown.height), (1, 140, 20));
    assert_eq!(shown.channels.keys().collect::<Vec<_>>(), ["B", "G", "R", "z.Z"], "an id is no number");
    assert!(shown.updates > 2, "it is shown more than once: {} tiles", shown.updates);
    let radiance = npy(&folder.path().join("a.npy"));
    for (channel, name) in ["R", "G", "B"].iter().enumerate() {
        let of_file = radiance.iter().skip(channel).step_by(3).map(|value| value.to_bits());
        assert!(shown.channels[*name].iter().map(|value| value.to_bits()).eq(of_file), "{name}");
    }

    // Frames of an animation are images of their own.
    let (address, images) = listen();
    let frames = ["--frames", "0..2", "--turntable", "9", "-o", "f.%d.npy", "--display-server", &address];
    let common = ["render", &*scene, "--size", "20x10", "--spp", "2", "--tracer", "cpu"];
    run(folder.path(), &[&common[..], &frames].concat(), 0);
    let images = wait_for(&images);
    assert_eq!(images.keys().collect::<Vec<_>>(), ["f.0.npy", "f.1.npy"]);
}

#[test]
fn a_picture_is_the_same_without_its_viewer() {
    let (folder, scene) = (folder(), shipped("cornell.json"));
    let common = ["render", &*scene, "--size", "40x30", "--spp", "16", "--tracer", "cpu"];
    run(folder.path(), &[&common[..], &["-o", "a.npy"]].concat(), 0);
    // A port at which nothing listens.
    let free = std::net::TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr());
    let address = free.expect("an address").to_string();
    let text = run(folder.path(), &[&common[..], &["-o", "b.npy", "--tev", &address]].concat(), 0);
    assert!(text.contains("tev cannot be reached"), "{text}");
    let read = |name: &str| std::fs::read(folder.path().join(name)).expect("a picture");
    assert!(read("a.npy") == read("b.npy"), "the same bytes");
}
