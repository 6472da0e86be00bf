//! A worker whose cache is damaged.

use crate::machines::Nats;
use crate::{Worker, coordinator, folder, shipped, still};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Files below a folder with this ending.
pub fn files(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries
        .flat_map(|entry| match entry.path() {
            path if path.is_dir() => files(&path, extension),
            path => vec![path],
        })
        .filter(|path| path.extension().is_some_and(|own| own == extension))
        .collect()
}

/// A worker's cache with a scene in it.
fn filled(service: &crate::Service, nats: &Nats, scene: &str) -> tempfile::TempDir {
    let worker = Worker::start(&nats.url(), "w", &[]);
    let id = service.submit(scene, &json!({ "size": "24x16", "spp": 4 }));
    service.hashes(&id);
    let Worker { process, cache, .. } = worker;
    drop(process);
    cache
}

#[test]
fn a_damaged_scene_is_found_when_it_is_opened() {
    let (job, hash) = still();
    let (nats, data) = (Nats::start(), folder());
    let service = coordinator(data.path(), &nats.url(), &[]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let cache = filled(&service, &nats, &scene);
    // One digit of a colour, and no file of the loaded scene, as a bad disk may have it.
    let [path] = &*files(&cache.path().join("scenes"), "json") else { panic!("one scene") };
    let text = std::fs::read_to_string(path).expect("the scene");
    let damaged = text.replacen("0.725", "0.625", 1);
    assert_ne!(text, damaged);
    std::fs::write(path, damaged).expect("it is written");
    for flat in files(cache.path(), "flat") {
        std::fs::remove_file(flat).expect("it is removed");
    }
    let worker = Worker::with_cache(cache, &nats.url(), "w", &[]);
    let id = service.submit(&scene, &job);
    assert_eq!(service.hashes(&id), [hash]);
    let whole = std::fs::read_to_string(&files(&worker.cache.path().join("scenes"), "json")[0]).expect("it");
    assert_eq!(whole, text, "it was fetched anew");
}

#[test]
fn a_scene_that_makes_another_picture_is_fetched_anew_and_fails_no_job() {
    let (job, hash) = still();
    let (nats, data) = (Nats::start(), folder());
    let service = coordinator(data.path(), &nats.url(), &[]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let other = service.upload_file(&shipped("glass.json"));
    let cache = filled(&service, &nats, &scene);
    let first = files(cache.path(), "flat");
    let worker = Worker::with_cache(cache, &nats.url(), "w", &[]);
    let id = service.submit(&other, &json!({ "size": "24x16", "spp": 1 }));
    service.hashes(&id);
    let Worker { process, cache, .. } = worker;
    drop(process);
    // The loaded scene is another one, and whole: only the picture tells.
    let second = files(cache.path(), "flat").into_iter().find(|path| !first.contains(path)).expect("another");
    std::fs::copy(second, &first[0]).expect("it is copied");
    let _worker = Worker::with_cache(cache, &nats.url(), "w", &[]);
    let id = service.submit(&scene, &job);
    assert_eq!(service.hashes(&id), [hash]);
}
