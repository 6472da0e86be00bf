//! What is checked of units and leases on both sides of a bus: who is on the other one is not known.

use super::digits::hex;
use super::names::{entry_name, is_name, is_sha256};
use super::unit::{Unit, UnitId};
use sha2::{Digest, Sha256};
use std::ops::Range;

/// The most units that a worker has at the same time.
pub const MOST_SLOTS: u32 = 64;

/// The most blocks of a unit that a worker renders.
const MOST_BLOCKS: usize = 1 << 16;

/// The SHA-256 of what a worker's sums are a rendering of, and of the sums themselves. Which copy of a unit it is does
/// not count, since two copies are compared.
pub fn digest(id: &UnitId, blocks: &[u32], samples: &Range<u32>, sums: &[u8]) -> String {
    let UnitId { job, frame, round, pass, number, copy: _ } = id;
    let mut hash = Sha256::new();
    hash.update(format!("{job}.{frame}.{round}.{pass}.{number} {}..{} ", samples.start, samples.end));
    blocks.iter().for_each(|block| hash.update(block.to_le_bytes()));
    // No list of blocks is the beginning of sums.
    hash.update((blocks.len() as u64).to_le_bytes());
    hash.update(sums);
    hex(&hash.finalize())
}

impl Unit {
    /// Refuses a unit that no coordinator makes.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn check(&self) -> Result<(), String> {
        let Self { id, scene, entry, blocks, samples, priority, spec: _ } = self;
        let wrong = |what: &str| Err(format!("a unit comes with {what}"));
        if !is_sha256(scene) {
            return wrong("a scene that is no SHA-256");
        }
        if !is_name(&id.job) || !id.job.bytes().all(|byte| byte.is_ascii_alphanumeric()) {
            return wrong("a job that has no name");
        }
        if entry.as_ref().is_some_and(|entry| entry_name(entry).is_none()) {
            return wrong("a scene file outside of the scene's folder");
        }
        if blocks.is_empty() || blocks.len() > MOST_BLOCKS || samples.is_empty() {
            return wrong("no samples, or too many blocks");
        }
        if !is_name(priority) {
            return wrong("a priority without a name");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use raystream::picture::RenderSpec;

    fn unit() -> Unit {
        Unit {
            id: UnitId { job: "a1".into(), frame: 0, round: 0, pass: 0, number: 3, copy: 0 },
            scene: "0".repeat(64),
            entry: Some("a/b.obj".into()),
            spec: RenderSpec::default(),
            priority: "normal".into(),
            blocks: vec![1, 2],
            samples: 0..4,
        }
    }

    #[test]
    fn units_that_no_coordinator_makes_are_refused() {
        assert_eq!(unit().check(), Ok(()));
        let of = |change: fn(&mut Unit)| {
            let mut unit = unit();
            change(&mut unit);
            unit.check().expect_err("it is refused")
        };
        for told in [
            of(|unit| unit.scene = "../../etc".into()),
            of(|unit| unit.scene = "G".repeat(64)),
            of(|unit| unit.id.job = "../x".into()),
            of(|unit| unit.id.job = "a".repeat(1000)),
            of(|unit| unit.entry = Some("/etc/passwd".into())),
            of(|unit| unit.entry = Some("a/../../b".into())),
            of(|unit| unit.blocks.clear()),
            of(|unit| unit.blocks = vec![0; MOST_BLOCKS + 1]),
            of(|unit| unit.samples = 4..4),
            of(|unit| unit.priority = "\n".into()),
        ] {
            assert!(told.starts_with("a unit comes with "), "{told}");
        }
    }

    #[test]
    fn a_digest_names_all_but_the_copy() {
        let Unit { id, blocks, samples, .. } = unit();
        let of = |id: &UnitId, blocks: &[u32], samples: Range<u32>, sums: &[u8]| {
            digest(id, blocks, &samples, sums)
        };
        let own = of(&id, &blocks, samples.clone(), b"sums");
        assert_eq!(of(&UnitId { copy: 1, ..id.clone() }, &blocks, samples.clone(), b"sums"), own);
        for other in [
            of(&UnitId { round: 1, ..id.clone() }, &blocks, samples.clone(), b"sums"),
            of(&UnitId { number: 4, ..id.clone() }, &blocks, samples.clone(), b"sums"),
            of(&UnitId { job: "a2".into(), ..id.clone() }, &blocks, samples.clone(), b"sums"),
            of(&id, &blocks[..1], samples.clone(), b"sums"),
            of(&id, &blocks, 0..8, b"sums"),
            of(&id, &blocks, samples, b"sum"),
        ] {
            assert_ne!(other, own);
        }
    }
}
