//! Options of reading scenes.

use super::SpecArgs;
use clap::Args;
use raystream::memory::MemoryBudget;
use raystream::picture::LoadingSpec;
use raystream::scene::load::LoadOptions;

/// The most memory of a command.
#[derive(Clone, Copy, Debug, Default, Args)]
pub struct MemoryArgs {
    /// Most memory for scene, tree and picture, in bytes or as 500M, 12G; what needs more is refused
    /// [default: 7/8 of the machine's, or of its control group].
    #[arg(id = "memory", long = "memory", value_name = "BYTES", value_parser = bytes)]
    bytes: Option<u64>,
}

impl MemoryArgs {
    /// The budget.
    pub fn budget(&self) -> MemoryBudget {
        self.bytes.map_or_else(MemoryBudget::of_machine, MemoryBudget::of_bytes)
    }
}

/// Options of reading a scene.
#[derive(Debug, Default, Args)]
pub struct SceneArgs {
    /// The most memory.
    #[command(flatten)]
    pub memory: MemoryArgs,
    /// Options of the loaders.
    #[command(flatten)]
    pub spec: SpecArgs<LoadingSpec>,
}

impl SceneArgs {
    /// Options of the loaders.
    pub fn options(&self) -> LoadOptions {
        self.spec.options(&self.memory.budget())
    }
}

/// A number of bytes, with K, M, G or T for powers of 1024.
pub fn bytes(text: &str) -> Result<u64, String> {
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
