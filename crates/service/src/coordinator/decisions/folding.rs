//! When the sums of a frame's units are written into one file.

/// Files of units of a frame before they are added up into one; and the bytes of them, where those are more.
pub const MOST_FILES: usize = 256;
const LEAST_BYTES: u64 = 32 << 20;

/// True if so many files of so many bytes are to be added up into the file of sums, which has `sums_bytes` now.
pub fn is_to_be_folded(files: usize, most_files: usize, bytes: u64, sums_bytes: u64) -> bool {
    bytes >= LEAST_BYTES.max(2 * sums_bytes) || files >= most_files
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_small_files_stay() {
        assert!(!is_to_be_folded(MOST_FILES - 1, MOST_FILES, LEAST_BYTES - 1, 0));
        assert!(is_to_be_folded(MOST_FILES, MOST_FILES, 0, 0));
        assert!(is_to_be_folded(1, MOST_FILES, LEAST_BYTES, 0));
        assert!(!is_to_be_folded(1, MOST_FILES, LEAST_BYTES, LEAST_BYTES));
    }
}
