//! What a device likes, kept by adapter and driver: a file each in a folder for caches.

use super::calibration::{IN_FLIGHT, RAYS};
use super::{AdapterInfo, Variant};
use crate::files::{NotWritten, write_atomically};
use crate::stream::Sizing;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Counts changes of what is measured or kept; files of another version are not read.
const VERSION: u32 = 2;

/// What a device likes. No choice of it changes a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct TunedSizes {
    /// Sizes of streams.
    pub sizing: Sizing,
    /// How scenes are laid out.
    pub variant: Variant,
}

/// A file of the cache.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Entry {
    version: u32,
    adapter: String,
    driver: String,
    host_threads: usize,
    threshold: usize,
    least: usize,
    in_flight: usize,
    kernels: String,
}

impl Entry {
    fn of(info: &AdapterInfo, tuned: TunedSizes) -> Self {
        let TunedSizes { sizing: Sizing { threshold, least, in_flight }, variant } = tuned;
        let host_threads = std::thread::available_parallelism().map_or(1, usize::from);
        let (adapter, driver, kernels) = (info.to_string(), info.driver.clone(), variant.to_string());
        Self { version: VERSION, adapter, driver, host_threads, threshold, least, in_flight, kernels }
    }

    /// What was measured, if it was this adapter and makes sense.
    fn tuned(&self, info: &AdapterInfo) -> Option<TunedSizes> {
        let &Self { threshold, least, in_flight, .. } = self;
        let variant = info.variants().find(|variant| variant.to_string() == self.kernels)?;
        let tuned = TunedSizes { sizing: Sizing { threshold, least, in_flight }, variant };
        let sound =
            RAYS.contains(&threshold) && (1..=threshold).contains(&least) && IN_FLIGHT.contains(&in_flight);
        (sound && *self == Self::of(info, tuned)).then_some(tuned)
    }
}

fn file(folder: &Path, info: &AdapterInfo) -> PathBuf {
    let key = format!("{info}\n{}", info.driver);
    folder.join(format!("gpu-{:016x}.json", xxhash_rust::xxh3::xxh3_64(key.as_bytes())))
}

/// A file that is not there, cannot be read or holds something else counts as none.
pub(super) fn load(folder: &Path, info: &AdapterInfo) -> Option<TunedSizes> {
    let bytes = std::fs::read(file(folder, info)).ok()?;
    serde_json::from_slice::<Entry>(&bytes).ok()?.tuned(info)
}

/// Keeps what was measured.
pub(super) fn store(folder: &Path, info: &AdapterInfo, tuned: TunedSizes) -> Result<(), NotWritten> {
    let path = file(folder, info);
    std::fs::create_dir_all(folder).map_err(|source| NotWritten { path: path.clone(), source })?;
    write_atomically(&path, |file| Ok(serde_json::to_writer_pretty(file, &Entry::of(info, tuned))?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::gpu::adapters;

    #[test]
    fn files_that_say_something_else_are_not_believed() {
        let folder = tempfile::tempdir().expect("a folder");
        let cache = folder.path().join("not/yet/there");
        let info = adapters().swap_remove(0);
        assert_eq!(load(&cache, &info), None);
        for variant in info.variants() {
            let sizing = Sizing { threshold: 77 * 1024, least: 2048, in_flight: 4 };
            let tuned = TunedSizes { sizing, variant };
            store(&cache, &info, tuned).expect("the folder can be made");
            assert_eq!(load(&cache, &info), Some(tuned));
            assert_eq!(std::fs::read_dir(&cache).expect("a folder").count(), 1, "no crumbs");
        }

        // Another driver, rubbish, sizes out of range, half a file, kernels that the adapter has not.
        let path = file(&cache, &info);
        let text = std::fs::read_to_string(&path).expect("a file");
        assert_eq!(load(&cache, &AdapterInfo { driver: "newer".into(), ..info.clone() }), None);
        for wrong in [
            String::new(),
            "rubbish".into(),
            text[..text.len() / 2].into(),
            text.replace("78848", "99999999"),
            text.replace("78848", "0"),
            text.replace("\"in_flight\": 4", "\"in_flight\": 40"),
            text.replace(&format!("\"version\": {VERSION}"), "\"version\": 1"),
            text.replace(&info.driver, "another"),
            text.replace("pairs\"", "triplets\""),
        ] {
            assert_ne!(wrong, text);
            std::fs::write(&path, wrong).expect("written");
            assert_eq!(load(&cache, &info), None);
        }
    }
}
