//! The tuning cache: keeps the sizes that were measured for a device, one file for each adapter and driver.

use super::{AdapterInfo, Variant};
use crate::files::{self, NotWritten};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Version of what is measured and of the file; files of other versions are not read.
const VERSION: u32 = 4;

/// The sizes of bundles that a calibration may choose, in rays.
pub(super) const BUNDLE_RAYS: std::ops::RangeInclusive<usize> = 1024..=1 << 18;

/// The size and the layout with which a device is fastest. They do not change a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct TunedSizes {
    /// Rays of a bundle.
    pub bundle_rays: usize,
    /// Layout of scenes.
    pub variant: Variant,
}

/// The content of a file.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct CacheFile {
    version: u32,
    adapter: String,
    driver: String,
    bundle_rays: usize,
    kernels: String,
}

impl CacheFile {
    fn of(info: &AdapterInfo, tuned: TunedSizes) -> Self {
        let TunedSizes { bundle_rays, variant } = tuned;
        let (adapter, driver, kernels) = (info.to_string(), info.driver.clone(), variant.to_string());
        Self { version: VERSION, adapter, driver, bundle_rays, kernels }
    }

    /// The sizes, if they were measured for this adapter and are in range.
    fn tuned(&self, info: &AdapterInfo) -> Option<TunedSizes> {
        let &Self { bundle_rays, .. } = self;
        let variant = info.variants().find(|variant| variant.to_string() == self.kernels)?;
        let tuned = TunedSizes { bundle_rays, variant };
        (BUNDLE_RAYS.contains(&bundle_rays) && *self == Self::of(info, tuned)).then_some(tuned)
    }
}

fn path(folder: &Path, info: &AdapterInfo) -> PathBuf {
    let key = format!("{info}\n{}", info.driver);
    folder.join(format!("gpu-{:016x}.json", xxhash_rust::xxh3::xxh3_64(key.as_bytes())))
}

/// Reads the sizes of an adapter. `None` if the file does not exist, cannot be read, or is not valid.
pub(super) fn load(folder: &Path, info: &AdapterInfo) -> Option<TunedSizes> {
    let bytes = std::fs::read(path(folder, info)).ok()?;
    serde_json::from_slice::<CacheFile>(&bytes).ok()?.tuned(info)
}

/// Writes the sizes of an adapter.
pub(super) fn store(folder: &Path, info: &AdapterInfo, tuned: TunedSizes) -> Result<(), NotWritten> {
    let path = path(folder, info);
    std::fs::create_dir_all(folder).map_err(|source| NotWritten { path: path.clone(), source })?;
    files::write(&path, |file| Ok(serde_json::to_writer_pretty(file, &CacheFile::of(info, tuned))?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::gpu::adapters;

    #[test]
    fn invalid_files_are_ignored() {
        let folder = tempfile::tempdir().expect("a folder");
        let cache = folder.path().join("not/yet/there");
        let info = adapters().swap_remove(0);
        assert_eq!(load(&cache, &info), None);
        for variant in info.variants() {
            let tuned = TunedSizes { bundle_rays: 77 * 1024, variant };
            store(&cache, &info, tuned).expect("the folder can be made");
            assert_eq!(load(&cache, &info), Some(tuned));
            assert_eq!(
                std::fs::read_dir(&cache).expect("a folder").count(),
                1,
                "one file for each adapter and driver"
            );
        }

        // Another driver, no JSON, sizes out of range, half a file, kernels that the adapter does not support.
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
            text.replace("pairs\"", "triplets\""),
        ] {
            assert_ne!(wrong, text);
            std::fs::write(&path, wrong).expect("written");
            assert_eq!(load(&cache, &info), None);
        }
    }
}
