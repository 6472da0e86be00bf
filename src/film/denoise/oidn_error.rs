//! Reasons for which Open Image Denoise cannot be used.

/// Reason for which Open Image Denoise (OIDN) cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum OidnError {
    /// There is no library.
    #[error(
        "OIDN: no library {} can be loaded; install Open Image Denoise 2, or name its file with --oidn or \
         RAYSTREAM_OIDN ({why})",
        tried.join(" or ")
    )]
    NotFound {
        /// The names that were tried.
        tried: Vec<String>,
        /// The loader's error.
        why: String,
    },
    /// The library is another one.
    #[error("OIDN: {name} is not Open Image Denoise; name its library with --oidn or RAYSTREAM_OIDN ({why})")]
    Foreign {
        /// The file.
        name: String,
        /// The loader's error.
        why: String,
    },
    /// The library has another version.
    #[error(
        "OIDN: {name} has version {version}, and raystream calls version 2; name a library of that version"
    )]
    Version {
        /// The file.
        name: String,
        /// Its version.
        version: String,
    },
    /// The library reports an error.
    #[error("OIDN: {0}")]
    Device(String),
    /// This build cannot load libraries.
    #[error("OIDN: this build of raystream cannot load it; build with the feature `oidn`")]
    LeftOut,
}
