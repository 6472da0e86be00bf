//! Options of reading scenes.

use crate::memory::MemoryBudget;
use crate::scene::load::LoadOptions;
use anyhow::{Result, anyhow};
use clap::Args;
#[cfg(feature = "serve")]
use std::path::PathBuf;

/// How a scene is read.
#[derive(Debug, Default, Args)]
pub struct SceneArgs {
    /// Most memory for scene, tree and picture, in bytes or as 500M, 12G; what needs more is refused
    /// [default: 7/8 of the machine's, or of its control group].
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    pub memory: Option<u64>,
    /// Show a magenta checker in place of textures that are missing or broken.
    #[arg(long)]
    pub allow_missing: bool,
    /// Show the glTF file's material variant of this name (KHR_materials_variants); `mesh` lists them.
    #[arg(long, value_name = "NAME")]
    pub variant: Option<String>,
    /// The folder that a scene's files lie in.
    #[cfg(feature = "serve")]
    #[arg(skip)]
    pub root: Option<PathBuf>,
}

impl SceneArgs {
    /// The most memory.
    pub fn memory(&self) -> MemoryBudget {
        self.memory.map_or_else(MemoryBudget::of_machine, MemoryBudget::of_bytes)
    }

    /// Checks that a number of bytes can be had. `what` begins the message.
    pub fn afford(&self, what: String, bytes: u64) -> Result<()> {
        let checked = self.memory().check(what, bytes);
        checked.map_err(|error| anyhow!("{error}; make it smaller, or raise the limit (--memory)"))
    }

    /// What the loaders are asked.
    pub fn options(&self) -> LoadOptions {
        let options =
            LoadOptions::default().with_memory(self.memory()).with_allow_missing(self.allow_missing);
        #[cfg(feature = "serve")]
        let options = self.root.iter().fold(options, |options, root| options.with_root(root));
        match &self.variant {
            None => options,
            Some(variant) => options.with_variant(variant),
        }
    }
}

/// A number of bytes, with K, M, G or T for powers of 1024.
pub(super) fn bytes(text: &str) -> Result<u64, String> {
    let (number, shift) = match text.char_indices().last() {
        Some((end, 'k' | 'K')) => (&text[..end], 10),
        Some((end, 'm' | 'M')) => (&text[..end], 20),
        Some((end, 'g' | 'G')) => (&text[..end], 30),
        Some((end, 't' | 'T')) => (&text[..end], 40),
        _ => (text, 0),
    };
    let number: Option<u64> = number.parse().ok();
    let bytes = number.and_then(|number| number.checked_mul(1 << shift)).filter(|&bytes| bytes > 0);
    bytes.ok_or_else(|| "write a number of bytes above 0, such as 8000000000, 500M or 12G".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_have_units() {
        assert_eq!(bytes("4096"), Ok(4096));
        assert_eq!(bytes("12G"), Ok(12 << 30));
        assert_eq!(bytes("3k"), Ok(3072));
        for bad in ["", "G", "-1", "1.5G", "0", "99999999T", "1 G", "1GB"] {
            assert!(bytes(bad).is_err(), "{bad}");
        }
    }
}
