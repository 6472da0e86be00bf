//! Folders that are kept within a bound of bytes.

use std::path::PathBuf;
use std::time::SystemTime;

/// A file or folder that is kept.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Kept {
    /// The time at which it was last used.
    pub used: SystemTime,
    /// Its bytes.
    pub bytes: u64,
    /// Its place.
    pub path: PathBuf,
}

/// Removes what was not used for the longest time, until the rest has at most so many bytes.
pub fn shrink(kept: impl IntoIterator<Item = Kept>, most_bytes: u64, remove: impl Fn(&Kept)) {
    let mut kept: Vec<Kept> = kept.into_iter().collect();
    kept.sort();
    let mut bytes: u64 = kept.iter().map(|kept| kept.bytes).sum();
    for oldest in kept.iter().take_while(|oldest| {
        let is_too_much = bytes > most_bytes;
        bytes -= oldest.bytes;
        is_too_much
    }) {
        remove(oldest);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;
    use std::time::Duration;

    #[test]
    fn the_oldest_leave_until_the_rest_fits() {
        let kept = |age: u64, bytes: u64| Kept {
            used: SystemTime::UNIX_EPOCH + Duration::from_secs(100 - age),
            bytes,
            path: age.to_string().into(),
        };
        for (most, gone) in [
            (60, vec![]),
            (59, vec!["30"]),
            (30, vec!["30"]),
            (29, vec!["30", "20"]),
            (0, vec!["30", "20", "10"]),
        ] {
            let removed = RefCell::new(Vec::new());
            let remove = |kept: &Kept| removed.borrow_mut().push(kept.path.display().to_string());
            shrink([kept(20, 20), kept(30, 30), kept(10, 10)], most, remove);
            assert_eq!(removed.into_inner(), gone, "{most}");
        }
    }
}
