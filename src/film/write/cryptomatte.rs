//! Cryptomatte (Friedman and Jones 2015, specification 1.2): masks of named things with soft edges, for compositing.
//!
//! A thing's id is the MurmurHash3 of its name, its bits read as a float. Each pixel has ranks: ids and the shares of
//! the pixel that they cover, the greatest first.

use super::super::Coverage;
use std::collections::BTreeMap;

/// Layers of four channels; each holds two ranks.
pub const LEVELS: usize = 3;
/// Ranks of a pixel. What covers less is left out of the file.
pub const RANKS: usize = 2 * LEVELS;

/// The name of a layer in Cryptomatte's spelling: `CryptoObject` for `crypto-object`.
pub fn type_name(layer: &str) -> String {
    layer
        .split('-')
        .flat_map(|word| {
            let mut letters = word.chars();
            letters.next().map(|first| first.to_ascii_uppercase()).into_iter().chain(letters)
        })
        .collect()
}

/// The first seven digits of the name's hash, by which attributes of the file are found.
pub fn key(type_name: &str) -> String {
    let mut key = format!("{:08x}", murmur3(type_name.as_bytes()));
    key.truncate(7);
    key
}

/// The bits of a name's id: its hash with the exponent from 1 to 254, so that it is neither denormal nor infinite.
pub fn id_bits(name: &str) -> u32 {
    let hash = murmur3(name.as_bytes());
    match hash >> 23 & 0xff {
        0 | 0xff => hash ^ 1 << 23,
        _ => hash,
    }
}

/// Names and the hexadecimal digits of their ids, as JSON.
pub fn manifest(names: &[String]) -> String {
    let ids: BTreeMap<_, _> = names.iter().map(|name| (name, format!("{:08x}", id_bits(name)))).collect();
    serde_json::to_string(&ids).expect("texts are JSON")
}

/// The channels: for each rank the ids of all pixels, then their coverage. Names of the same id are one thing. Equal
/// shares are ranked by their id's bits.
pub fn ranks(coverage: &Coverage) -> [Vec<f32>; 2 * RANKS] {
    let bits: Vec<u32> = coverage.names.iter().map(|name| id_bits(name)).collect();
    let mut channels = std::array::from_fn(|_| vec![0.0; coverage.samples.len()]);
    let mut things: Vec<(u32, u32)> = Vec::new();
    for (pixel, &samples) in coverage.samples.iter().enumerate() {
        let entries = coverage.starts[pixel] as usize..coverage.starts[pixel + 1] as usize;
        things.clear();
        for &(id, count) in &coverage.entries[entries] {
            let bits = bits[id as usize];
            match things.iter_mut().find(|thing| thing.0 == bits) {
                Some(thing) => thing.1 += count,
                None => things.push((bits, count)),
            }
        }
        things.sort_unstable_by_key(|&(bits, count)| (std::cmp::Reverse(count), bits));
        for (rank, &(bits, count)) in things.iter().take(RANKS).enumerate() {
            channels[2 * rank][pixel] = f32::from_bits(bits);
            channels[2 * rank + 1][pixel] = (f64::from(count) / f64::from(samples)) as f32;
        }
    }
    channels
}

/// MurmurHash3 of 32 bits (Appleby), seed 0.
fn murmur3(bytes: &[u8]) -> u32 {
    let scrambled = |block: u32| block.wrapping_mul(0xcc9e_2d51).rotate_left(15).wrapping_mul(0x1b87_3593);
    let blocks = bytes.chunks_exact(4);
    let rest = blocks.remainder().iter().rev().fold(0, |word, &byte| word << 8 | u32::from(byte));
    let mut hash = blocks.fold(0, |hash: u32, block| {
        let block = u32::from_le_bytes(block.try_into().expect("four bytes"));
        (hash ^ scrambled(block)).rotate_left(13).wrapping_mul(5).wrapping_add(0xe654_6b64)
    });
    hash ^= scrambled(rest) ^ bytes.len() as u32;
    hash = (hash ^ hash >> 16).wrapping_mul(0x85eb_ca6b);
    hash = (hash ^ hash >> 13).wrapping_mul(0xc2b2_ae35);
    hash ^ hash >> 16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_those_of_the_specification() {
        // Its example of a manifest.
        assert_eq!(
            manifest(&["bunny".into(), "default".into()]),
            r#"{"bunny":"13851a76","default":"42c9679f"}"#
        );
        assert_eq!(type_name("crypto-asset"), "CryptoAsset");
        assert_eq!(key("CryptoObject"), "3ae39a5");
        // Published vectors of MurmurHash3_x86_32 with seed 0.
        assert_eq!(
            (murmur3(b""), murmur3(b"test"), murmur3(b"Hello, world!")),
            (0, 0xba6b_d213, 0xc036_3e43)
        );
    }

    #[test]
    fn ids_are_ordinary_floats() {
        assert_eq!(id_bits(""), 1 << 23);
        let unusual = |hash: u32| matches!(hash >> 23 & 0xff, 0 | 0xff);
        let names = (0..10_000).map(|i| i.to_string());
        let changed = names.filter(|name| unusual(murmur3(name.as_bytes()))).map(|name| id_bits(&name));
        assert!(changed.map(f32::from_bits).inspect(|id| assert!(id.is_normal(), "{id}")).count() > 20);
    }

    #[test]
    fn ranks_are_in_the_order_of_coverage() {
        let names = ["a", "b", "a", "c"].map(String::from).to_vec();
        let entries = vec![(0, 1), (1, 2), (2, 3), (3, 2)];
        let coverage = Coverage { names, starts: vec![0, 0, 4], entries, samples: vec![4, 16] };
        let ranks = ranks(&coverage);
        let id = |name: &str| f32::from_bits(id_bits(name));
        let mut equal = [id("b"), id("c")];
        equal.sort_unstable_by_key(|id| id.to_bits());
        let pixel = |i: usize| ranks.each_ref().map(|channel| channel[i]);
        assert_eq!(pixel(0), [0.0; 12], "nothing is hit");
        let wanted = [id("a"), 0.25, equal[0], 0.125, equal[1], 0.125, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        assert_eq!(pixel(1), wanted, "names that are equal are one thing");
    }
}
