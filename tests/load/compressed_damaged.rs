//! Damaged compressed data: whatever happened to them, a loader returns, with a scene or with one error.
//!
//! `RAYSTREAM_COMPRESSED_INPUTS` inputs (by default [`INPUTS`]) are tried, and as many more as fit into
//! `RAYSTREAM_COMPRESSED_SECONDS`.

use crate::compressed::{EDGEBREAKER, ETC1S, PLAIN_UASTC, SEQUENTIAL, UASTC, draco, ktx2, meshopt};
use crate::document::Document;
use crate::random::Random;
use raystream::memory::MemoryBudget;
use raystream::scene::load::{LoadOptions, load_from};
use std::time::{Duration, Instant};

const INPUTS: u64 = 8000;

/// The most memory that a damaged file may take.
const BUDGET: u64 = 1 << 26;

/// Flips bits, writes extreme numbers, repeats and removes pieces; at times cuts the end off.
fn damage(bytes: &mut Vec<u8>, random: &mut Random) {
    const BYTES: [u8; 6] = [0, 1, 0x7f, 0x80, 0xfe, 0xff];
    for _ in 0..=random.below(6) {
        if bytes.is_empty() {
            return;
        }
        // The first bytes say what follows.
        let reach = if random.below(3) == 0 { bytes.len().min(128) } else { bytes.len() };
        let at = random.below(reach);
        let end = (at + 1 + random.below(8)).min(bytes.len());
        match random.below(8) {
            0..=2 => bytes[at] ^= 1 << random.below(8),
            3 => bytes[at] = random.below(256) as u8,
            4 => bytes[at..end].fill(BYTES[random.below(BYTES.len())]),
            5 => drop(bytes.drain(at..end)),
            6 => {
                let piece = bytes[at..end].to_vec();
                drop(bytes.splice(at..at, piece));
            }
            _ => bytes[at] = BYTES[random.below(BYTES.len())],
        }
    }
    if random.below(8) == 0 {
        bytes.truncate(random.below(bytes.len()));
    }
}

/// One of the compressed documents, damaged.
fn document(kind: u64, random: &mut Random) -> Document {
    let damaged = |bytes: &[u8], random: &mut Random| {
        let mut bytes = bytes.to_vec();
        damage(&mut bytes, random);
        bytes
    };
    match kind {
        0 => draco(&damaged(EDGEBREAKER, random)),
        1 => draco(&damaged(SEQUENTIAL, random)),
        2 => ktx2(&damaged(ETC1S, random)),
        3 => ktx2(&damaged(UASTC, random)),
        4 => ktx2(&damaged(PLAIN_UASTC, random)),
        _ => {
            let name = ["EXT_meshopt_compression", "KHR_meshopt_compression"][random.below(2)];
            let which = random.below(3);
            let random = std::cell::RefCell::new(random);
            meshopt(name, |i, stream| {
                if i == which {
                    damage(stream, &mut random.borrow_mut());
                }
            })
        }
    }
}

fn from_environment(name: &str, unset: u64) -> u64 {
    std::env::var(name).map_or(unset, |text| text.parse().expect("a whole number"))
}

#[test]
fn damaged_compressed_data_are_scenes_or_errors() {
    let inputs = from_environment("RAYSTREAM_COMPRESSED_INPUTS", INPUTS);
    let seconds = Duration::from_secs(from_environment("RAYSTREAM_COMPRESSED_SECONDS", 0));
    let seed = from_environment("RAYSTREAM_FUZZ_SEED", 1);
    let options = LoadOptions::default().with_memory(MemoryBudget::of_bytes(BUDGET));
    let began = Instant::now();
    let (mut tried, mut refused, mut panics) = (0, [0_u64; 6], [0_u64; 6]);
    while tried < inputs || began.elapsed() < seconds {
        let kind = tried % 6;
        let mut random = Random((seed << 40 | tried).wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
        let file = document(kind, &mut random).glb();
        // A panic that leaves the loader fails the test, and the round is told.
        let load = || load_from(&*file, "a.glb".as_ref(), &options);
        let result =
            std::panic::catch_unwind(load).unwrap_or_else(|_| panic!("input {tried} of seed {seed}"));
        if let Err(error) = result {
            refused[kind as usize] += 1;
            panics[kind as usize] += u64::from(error.to_string().contains("gave up"));
        }
        tried += 1;
    }
    println!("{tried} inputs, refused {refused:?} of each kind, of these decoders gave up on {panics:?}");
    assert!(refused.iter().all(|&refused| refused > tried / 50), "{refused:?}");
}
