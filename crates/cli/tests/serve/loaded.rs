//! Loaded scenes that the service keeps as flat files.

use crate::{Service, folder, shipped};
use serde_json::json;
use std::path::PathBuf;

#[test]
fn a_second_start_reads_the_flat_file_alone() {
    let data = folder();
    let flats = || -> Vec<PathBuf> {
        let files = std::fs::read_dir(data.path().join("loaded")).expect("a folder");
        files.map(|file| file.expect("a file").path()).collect()
    };
    let render = |seed: u32| {
        let service = Service::start(data.path(), &[]);
        let scene = service.upload_file(&shipped("cornell.json"));
        let id = service.submit(&scene, &json!({ "size": "16x12", "spp": 4, "seed": seed, "aov": "object" }));
        let job = service.wait_for(&id, &["done", "failed"]);
        (scene, job["state"] == "done", job["pictures"][0]["layers"]["object"].clone())
    };
    let (scene, is_done, layer) = render(1);
    let [flat] = &flats()[..] else { panic!("one flat file: {:?}", flats()) };
    assert!(is_done && !layer.is_null());

    // Without the flat file this could not be read.
    let own = data.path().join("scenes").join(scene).join("scene.json");
    let text = std::fs::read(&own).expect("the upload");
    std::fs::write(&own, "nothing").expect("a disk");
    assert_eq!(render(2), (own_name(&own), true, layer.clone()));

    // A damaged file is noticed, and the scene is loaded from its own files, which are no scene now.
    let mut bytes = std::fs::read(flat).expect("the flat file");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(flat, &bytes).expect("a disk");
    assert!(!render(3).1);
    assert!(flats().is_empty(), "it is removed");
    std::fs::write(&own, text).expect("a disk");
    assert_eq!(render(4), (own_name(&own), true, layer));
    assert_eq!(flats(), std::slice::from_ref(flat), "it is written again");
}

/// The hash that names the folder of an upload.
fn own_name(path: &std::path::Path) -> String {
    let folder = path.parent().and_then(|folder| folder.file_name());
    folder.expect("a folder").to_string_lossy().into_owned()
}
