//! The library of Open Image Denoise.

use clap::Args;
use raystream::picture::Registry;
use std::path::PathBuf;

/// The library of Open Image Denoise, for commands that write pictures.
#[derive(Clone, Debug, Args)]
pub struct OidnArgs {
    /// Library of Open Image Denoise 2 for `--denoise oidn`. Its code runs [default: $RAYSTREAM_OIDN, else the
    /// system's].
    #[arg(long, value_name = "FILE")]
    pub oidn: Option<PathBuf>,
}

impl OidnArgs {
    /// A registry with this library, if one is named.
    pub fn registry(&self, registry: &Registry) -> Registry {
        let registry = registry.clone();
        if self.oidn.is_some() { registry.with_oidn(self.oidn.clone()) } else { registry }
    }
}
