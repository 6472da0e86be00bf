//! Guard around decoders of other projects, which may panic on damaged bytes.

use std::panic::{AssertUnwindSafe, catch_unwind};

/// The result of a decoder. A panic is one of its errors.
///
/// # Errors
/// Those of the decoder.
pub(super) fn guarded<T>(decode: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    // The decoder owns what it works on, and nothing of it is used after a panic.
    catch_unwind(AssertUnwindSafe(decode))
        .unwrap_or_else(|_| Err("is damaged: its decoder gave up on it".into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panics_are_errors() {
        assert_eq!(guarded(|| Ok(3)), Ok(3));
        assert_eq!(guarded::<()>(|| Err("no".into())), Err("no".into()));
        let bytes: &[u8] = &[];
        assert!(guarded(|| Ok(bytes[1])).is_err());
    }
}
