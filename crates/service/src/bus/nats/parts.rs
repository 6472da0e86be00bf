//! Parts of results that have come and are not whole yet.

use super::messages::Reply;
use crate::contract::{Answer, Ask, Coordinator, ResultReply};
use std::collections::HashMap;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// The most bytes of results that have not come whole yet, of all workers and of one; and how long parts are kept for
/// the others.
const MOST_BYTES: usize = 1 << 30;
const MOST_OF_ONE: usize = 1 << 28;
const AGE: Duration = Duration::from_secs(60);

/// Parts by worker and digest. They are collected for units that the coordinator expects from this worker alone.
#[derive(Default)]
pub(super) struct Parts(Mutex<HashMap<(String, String), Part>>);

struct Part {
    bytes: Vec<u8>,
    last: Instant,
}

impl Parts {
    /// Adds a part of a worker's result. Returns all bytes with the last one, else what to answer.
    pub fn add(
        &self,
        coordinator: &dyn Coordinator,
        key: &str,
        ask: &Ask,
        part: Option<(u64, u64)>,
        bytes: &[u8],
    ) -> Result<Vec<u8>, Reply> {
        let (Ask::Result(finished), Some((offset, all))) = (ask, part) else { return Ok(Vec::new()) };
        let refused = |verdict| Err(Reply::Answer(Answer::Result(verdict)));
        if !coordinator.expects(key, finished, all) || all > MOST_OF_ONE as u64 {
            return refused(ResultReply::Refused("no such unit was given to this worker".into()));
        }
        if offset == 0 && bytes.len() as u64 == all {
            return Ok(bytes.to_vec());
        }
        let place = (key.to_owned(), format!("{} {}", finished.held.unit, finished.digest));
        let mut parts = self.0.lock().expect("no holder panics");
        parts.retain(|_, part| part.last.elapsed() < AGE);
        let held = |whose: &dyn Fn(&str) -> bool| -> usize {
            let own = parts.iter().filter(|((key, _), _)| whose(key));
            own.map(|(_, part)| part.bytes.len()).sum::<usize>().saturating_add(bytes.len())
        };
        if held(&|_| true) > MOST_BYTES || held(&|other| other == key) > MOST_OF_ONE {
            return refused(ResultReply::Later);
        }
        let part =
            parts.entry(place.clone()).or_insert_with(|| Part { bytes: Vec::new(), last: Instant::now() });
        part.last = Instant::now();
        let have = &mut part.bytes;
        if have.len() as u64 == offset && offset + bytes.len() as u64 <= all {
            have.extend_from_slice(bytes);
        }
        if (have.len() as u64) < all {
            return Err(Reply::Next(have.len() as u64));
        }
        Ok(parts.remove(&place).map_or(Vec::new(), |part| part.bytes))
    }
}

#[cfg(test)]
mod unit_tests {
    use super::*;
    use crate::contract::{FinishedUnit, Held, UnitId};
    use std::sync::Arc;

    /// Expects what the worker "w" sends.
    struct Only;

    impl Coordinator for Only {
        fn answer(&self, _: &str, _: Ask) -> Answer {
            Answer::Noted
        }

        fn expects(&self, key: &str, _: &FinishedUnit, _: u64) -> bool {
            key == "w"
        }
    }

    fn result(number: u32) -> Ask {
        let unit = UnitId { job: "a".into(), frame: 0, round: 0, pass: 0, number, copy: 0 };
        Ask::Result(FinishedUnit {
            held: Held { unit, token: "t".into() },
            identity: "i".into(),
            blocks: vec![0],
            samples: 0..1,
            digest: "d".into(),
            seconds: 1.0,
            opening_s: 0.0,
            sums: Arc::default(),
        })
    }

    #[test]
    fn parts_of_strangers_are_not_kept_and_those_of_one_are_bounded() {
        let parts = Parts::default();
        let mega = vec![7; 1 << 20];
        let add = |key: &str, number, offset: u64, all: u64| {
            parts.add(&Only, key, &result(number), Some((offset, all)), &mega)
        };
        let refused = |added| matches!(added, Err(Reply::Answer(Answer::Result(ResultReply::Refused(_)))));
        assert!(refused(add("thief", 0, 0, 2 << 20)));
        assert!(refused(add("w", 0, 0, u64::MAX)), "more than any unit has");
        assert!(matches!(add("w", 0, 0, 2 << 20), Err(Reply::Next(next)) if next == 1 << 20));
        assert!(
            matches!(add("w", 0, 0, 2 << 20), Err(Reply::Next(next)) if next == 1 << 20),
            "the same again"
        );
        assert_eq!(add("w", 0, 1 << 20, 2 << 20).map(|bytes| bytes.len()).ok(), Some(2 << 20));
        let of_one = |number| add("w", number, 0, 2 << 20);
        let many = (0..300).filter(|number| matches!(of_one(*number), Err(Reply::Next(_)))).count();
        assert_eq!(many, MOST_OF_ONE >> 20);
    }
}
