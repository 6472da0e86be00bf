//! The tuning cache: keeps the size of bundles that was measured for a device, one file for each adapter and driver.

use crate::device::AdapterInfo;
use crate::files::{self, NotWritten};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Version of what is measured and of the file; files of other versions are not read.
const VERSION: u32 = 5;

/// The sizes of bundles that a calibration may choose, in rays.
pub(super) const BUNDLE_RAYS: std::ops::RangeInclusive<usize> = 1024..=1 << 18;

/// The content of a file.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct CacheFile {
    version: u32,
    adapter: String,
    driver: String,
    bundle_rays: usize,
}

impl CacheFile {
    fn of(info: &AdapterInfo, bundle_rays: usize) -> Self {
        Self { version: VERSION, adapter: info.to_string(), driver: info.driver.clone(), bundle_rays }
    }

    /// Rays of a bundle, if that was measured for this adapter and is in range.
    fn bundle_rays(&self, info: &AdapterInfo) -> Option<usize> {
        let &Self { bundle_rays: rays, .. } = self;
        (BUNDLE_RAYS.contains(&rays) && *self == Self::of(info, rays)).then_some(rays)
    }
}

fn path(folder: &Path, info: &AdapterInfo) -> PathBuf {
    let key = format!("{info}\n{}", info.driver);
    folder.join(format!("gpu-{:016x}.json", xxhash_rust::xxh3::xxh3_64(key.as_bytes())))
}

/// Reads the rays of a bundle for an adapter. `None` if the file does not exist, cannot be read, or is not valid.
pub(super) fn load(folder: &Path, info: &AdapterInfo) -> Option<usize> {
    let bytes = std::fs::read(path(folder, info)).ok()?;
    serde_json::from_slice::<CacheFile>(&bytes).ok()?.bundle_rays(info)
}

/// Writes the rays of a bundle for an adapter.
pub(super) fn store(folder: &Path, info: &AdapterInfo, bundle_rays: usize) -> Result<(), NotWritten> {
    let path = path(folder, info);
    std::fs::create_dir_all(folder).map_err(|source| NotWritten { path: path.clone(), source })?;
    files::write(&path, |file| Ok(serde_json::to_writer_pretty(file, &CacheFile::of(info, bundle_rays))?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::adapters;

    #[test]
    fn invalid_files_are_ignored() {
        let folder = tempfile::tempdir().expect("a folder");
        let cache = folder.path().join("not/yet/there");
        let info = adapters().swap_remove(0);
        assert_eq!(load(&cache, &info), None);
        for bundle_rays in [1024, 77 * 1024] {
            store(&cache, &info, bundle_rays).expect("the folder can be made");
            assert_eq!(load(&cache, &info), Some(bundle_rays));
            let files = std::fs::read_dir(&cache).expect("a folder").count();
            assert_eq!(files, 1, "one file for each adapter and driver");
        }

        // Another driver, no JSON, sizes out of range, half a file.
        let path = path(&cache, &info);
        let text = std::fs::read_to_string(&path).expect("a file");
        assert_eq!(load(&cache, &AdapterInfo { driver: "newer".into(), ..info.clone() }), None);
        for wrong in [
            String::new(),
            "rubbish".into(),
            text[..text.len() / 2].into(),
            text.replace("78848", "99999999"),
            text.replace("78848", "0"),
            text.replace(&format!("\"version\": {VERSION}"), "\"version\": 1"),
            text.replace(&info.driver, "another"),
        ] {
            assert_ne!(wrong, text);
            std::fs::write(&path, wrong).expect("written");
            assert_eq!(load(&cache, &info), None);
        }
    }
}
