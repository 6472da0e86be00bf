//! Stand-in for Open Image Denoise in builds without the feature `oidn`.

use super::NoisyPicture;
use super::oidn_error::OidnError;
use crate::film::Image;
use std::path::Path;

/// The library, which this build never has.
#[derive(Debug)]
pub enum Oidn {}

impl Oidn {
    /// Opens nothing.
    ///
    /// # Errors
    /// Always.
    pub fn open(_: Option<&Path>) -> Result<Self, OidnError> {
        Err(OidnError::LeftOut)
    }

    /// Its version.
    pub fn version(&self) -> String {
        match *self {}
    }

    /// Bytes that denoising a picture takes.
    pub fn denoising_bytes(_: u64) -> u64 {
        0
    }

    /// The picture without noise.
    ///
    /// # Errors
    /// Never: there is no such value.
    pub fn denoise(&self, _: &NoisyPicture, _: usize) -> Result<Image, OidnError> {
        match *self {}
    }
}
