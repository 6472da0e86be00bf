//! Records in pages. A scene may have more nodes or pairs than one binding holds, so they lie in as many buffers as
//! they need: pages, each of a power of two records but for the last.

use crate::device::{AdapterInfo, GpuError};
use std::fmt::Write as _;

/// Storage bindings that a kernel needs beside nodes, pairs and identities: members, the alpha test, rays,
/// answers and the list of undecided rays.
const OTHER_BINDINGS: u64 = 5;

/// Records of one kind.
#[derive(Clone, Copy, Debug)]
pub(super) struct Records {
    pub count: usize,
    /// Bytes of one record.
    pub bytes: usize,
}

/// How records of one kind are split into pages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Pages {
    /// A page has `1 << bits` records, the last may have fewer.
    pub bits: u32,
    /// Number of pages.
    pub count: u32,
}

impl Pages {
    /// All records in one page.
    #[cfg(test)]
    pub const ONE: Self = Self { bits: 31, count: 1 };

    /// The fewest pages for records when a binding holds `available` bytes: at least one. `None` when not even one
    /// record fits.
    pub fn of(records: Records, available: u64) -> Option<Self> {
        let fit = available / records.bytes as u64;
        let bits = fit.checked_ilog2()?.min(31);
        let count = records.count.max(1) as u64;
        Some(if count <= fit {
            Self { bits: 31, count: 1 }
        } else {
            Self { bits, count: u32::try_from(count.div_ceil(1 << bits)).ok()? }
        })
    }

    /// The records of each page.
    pub fn split<T>(self, records: &[T]) -> impl Iterator<Item = &[T]> {
        let len = 1usize << self.bits;
        (0..self.count as usize).map(move |page| &records[page * len..records.len().min((page + 1) * len)])
    }

    /// Declares the pages as bindings of group 0, from `first` on.
    fn declare(self, text: &mut String, first: u32, name: &str, record: &str) {
        for page in 0..self.count {
            let binding = first + page;
            let _ = writeln!(
                text,
                "@group(0) @binding({binding}) var<storage, read> {name}_{page}: array<{record}>;"
            );
        }
    }

    /// Defines a function that reads a record, or the part of it that the suffix `part` selects.
    fn read(self, text: &mut String, name: &str, function: &str, result: &str, part: &str) {
        let _ = writeln!(text, "fn {function} -> {result} {{");
        let place = if self.count == 1 { "index" } else { "place" };
        if self.count > 1 {
            let (bits, mask) = (self.bits, (1u32 << self.bits) - 1);
            let _ = writeln!(text, "    let page = index >> {bits}u;\n    let place = index & {mask}u;");
        }
        for page in 1..self.count {
            let _ = writeln!(text, "    if page == {page}u {{ return {name}_{page}[{place}]{part}; }}");
        }
        let _ = writeln!(text, "    return {name}_0[{place}]{part};\n}}");
    }
}

/// The pages of a scene's nodes, pairs of triangles and their identities.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ScenePages {
    pub nodes: Pages,
    pub pairs: Pages,
    pub identities: Pages,
}

impl ScenePages {
    /// Each in one page.
    #[cfg(test)]
    pub const ONE: Self = Self { nodes: Pages::ONE, pairs: Pages::ONE, identities: Pages::ONE };

    /// Pages for a scene's nodes, pairs and identities.
    ///
    /// # Errors
    /// When the adapter has too few bindings, with the bytes that the records need and that all bindings together hold.
    pub fn new(info: &AdapterInfo, records: [Records; 3]) -> Result<Self, GpuError> {
        let one = info.max_binding_bytes.min(info.max_buffer_bytes);
        let bindings = u64::from(info.max_storage_bindings).saturating_sub(OTHER_BINDINGS);
        let [nodes, pairs, identities] = records.map(|records| Pages::of(records, one));
        match (nodes, pairs, identities) {
            (Some(nodes), Some(pairs), Some(identities))
                if u64::from(nodes.count + pairs.count + identities.count) <= bindings =>
            {
                Ok(Self { nodes, pairs, identities })
            }
            _ => Err(GpuError::TooLarge {
                required: records.iter().map(|records| (records.count * records.bytes) as u64).sum(),
                available: one.saturating_mul(bindings),
                adapter: info.to_string(),
            }),
        }
    }

    /// Number of bindings of group 0: the pages, members and the alpha test.
    pub fn bindings(self) -> u32 {
        self.nodes.count + self.pairs.count + self.identities.count + 2
    }

    /// WGSL that declares group 0, and the functions through which kernels read the pages.
    pub fn source(self) -> String {
        let Self { nodes, pairs, identities } = self;
        let mut text = String::from("// Nodes, pairs and identities, in as many bindings as they need.\n");
        nodes.declare(&mut text, 0, "nodes", "WideNode");
        nodes.read(&mut text, "nodes", "node_at(index: u32)", "WideNode", "");
        nodes.read(&mut text, "nodes", "child_at(index: u32, slot: u32)", "u32", ".children[slot]");
        pairs.declare(&mut text, nodes.count, "pairs", "Pair");
        pairs.read(&mut text, "pairs", "pair_at(index: u32)", "Pair", "");
        identities.declare(&mut text, nodes.count + pairs.count, "identities", "vec2<u32>");
        identities.read(&mut text, "identities", "identity_at(index: u32)", "vec2<u32>", "");
        let members = self.bindings() - 2;
        let _ =
            writeln!(text, "@group(0) @binding({members}) var<storage, read> members: array<TreeInstance>;");
        let alpha = members + 1;
        let _ = writeln!(text, "@group(0) @binding({alpha}) var<storage, read> alpha_words: array<u32>;");
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_hold_every_record_once_and_none_exceeds_a_binding() {
        for (count, available) in
            [(0, 480), (1, 480), (10, 480), (11, 480), (100, 480), (1000, 4800), (7, 48)]
        {
            let pages = Pages::of(Records { count, bytes: 48 }, available).expect("a record fits");
            let all: Vec<usize> = (0..count).collect();
            let split: Vec<&[usize]> = pages.split(&all).collect();
            assert_eq!(split.len(), pages.count as usize);
            assert!(split.iter().all(|page| page.len() as u64 * 48 <= available), "{pages:?}");
            assert_eq!(split.concat(), all);
            for (index, page) in split.iter().enumerate().filter(|_| pages.count > 1) {
                assert!(page.iter().all(|record| record >> pages.bits == index));
            }
        }
        assert_eq!(Pages::of(Records { count: 1, bytes: 48 }, 47), None);
    }
}
