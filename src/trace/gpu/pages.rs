//! Records in pages: a scene may have more nodes or triangles than one binding takes, so they lie in as many
//! buffers as it needs, each of a power of two records but for the last.

use super::{Gpu, GpuError};
use std::fmt::Write as _;

/// Bindings of storage that a kernel needs beside nodes and triangles: members, rays and answers.
const OTHER_BINDINGS: u64 = 3;

/// How the records of one kind lie in pages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Pages {
    /// A page has `1 << bits` records.
    pub bits: u32,
    /// How many pages there are, at least one.
    pub count: u32,
}

impl Pages {
    /// All records in one page.
    #[cfg(test)]
    pub const ONE: Self = Self { bits: 31, count: 1 };

    /// The fewest pages that take `records` when a binding takes `available` bytes; `None` when not even one
    /// record fits.
    pub fn of(records: usize, record_bytes: usize, available: u64) -> Option<Self> {
        let fit = available / record_bytes as u64;
        let bits = fit.checked_ilog2()?.min(31);
        let records = records.max(1) as u64;
        Some(if records <= fit {
            Self { bits: 31, count: 1 }
        } else {
            Self { bits, count: u32::try_from(records.div_ceil(1 << bits)).ok()? }
        })
    }

    /// The records of each page.
    pub fn split<T>(self, records: &[T]) -> impl Iterator<Item = &[T]> {
        let len = 1usize << self.bits;
        (0..self.count as usize).map(move |page| &records[page * len..records.len().min((page + 1) * len)])
    }

    /// Declares the pages from a binding of group 0 on, and a function `at` that reads a record.
    pub fn declare(self, text: &mut String, first: u32, name: &str, record: &str, at: &str) {
        for page in 0..self.count {
            let binding = first + page;
            let _ = writeln!(
                text,
                "@group(0) @binding({binding}) var<storage, read> {name}_{page}: array<{record}>;"
            );
        }
        let _ = writeln!(text, "fn {at}(index: u32) -> {record} {{");
        let place = if self.count == 1 { "index" } else { "place" };
        if self.count > 1 {
            let (bits, mask) = (self.bits, (1u32 << self.bits) - 1);
            let _ = writeln!(text, "    let page = index >> {bits}u;\n    let place = index & {mask}u;");
        }
        for page in 1..self.count {
            let _ = writeln!(text, "    if page == {page}u {{ return {name}_{page}[{place}]; }}");
        }
        let _ = writeln!(text, "    return {name}_0[{place}];\n}}");
    }
}

/// The pages of a scene's nodes and triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ScenePages {
    pub nodes: Pages,
    pub triangles: Pages,
}

impl ScenePages {
    /// Both in one page.
    #[cfg(test)]
    pub const ONE: Self = Self { nodes: Pages::ONE, triangles: Pages::ONE };

    /// Pages for so many records.
    ///
    /// # Errors
    /// When the adapter has not enough bindings, told in bytes: what the records take and what all bindings
    /// together do.
    pub fn new(gpu: &Gpu, nodes: (usize, usize), triangles: (usize, usize)) -> Result<Self, GpuError> {
        let info = gpu.info();
        let one = info.max_binding_bytes.min(info.max_buffer_bytes);
        let bindings = u64::from(info.max_storage_bindings).saturating_sub(OTHER_BINDINGS);
        let required = (nodes.0 * nodes.1 + triangles.0 * triangles.1) as u64;
        let pages = Pages::of(nodes.0, nodes.1, one).zip(Pages::of(triangles.0, triangles.1, one));
        match pages {
            Some((nodes, triangles)) if u64::from(nodes.count + triangles.count) <= bindings => {
                Ok(Self { nodes, triangles })
            }
            _ => Err(GpuError::TooLarge {
                required,
                available: one.saturating_mul(bindings),
                adapter: info.to_string(),
            }),
        }
    }

    /// Bindings of group 0: nodes, triangles, members.
    pub fn bindings(self) -> u32 {
        self.nodes.count + self.triangles.count + 1
    }

    /// The declarations that kernels read nodes and triangles through.
    pub fn source(self) -> String {
        let mut text = String::from("// Nodes and triangles, in as many bindings as they need.\n");
        self.nodes.declare(&mut text, 0, "nodes", "Node", "node_at");
        self.triangles.declare(&mut text, self.nodes.count, "triangles", "Triangle", "triangle_at");
        let members = self.bindings() - 1;
        let _ = writeln!(text, "@group(0) @binding({members}) var<storage, read> members: array<Member>;");
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_hold_every_record_once_and_none_exceeds_a_binding() {
        for (records, available) in
            [(0, 480), (1, 480), (10, 480), (11, 480), (100, 480), (1000, 4800), (7, 48)]
        {
            let pages = Pages::of(records, 48, available).expect("a record fits");
            let all: Vec<usize> = (0..records).collect();
            let split: Vec<&[usize]> = pages.split(&all).collect();
            assert_eq!(split.len(), pages.count as usize);
            assert!(split.iter().all(|page| page.len() as u64 * 48 <= available), "{pages:?}");
            assert_eq!(split.concat(), all);
            for (place, page) in split.iter().enumerate().filter(|_| pages.count > 1) {
                assert!(page.iter().all(|record| record >> pages.bits == place));
            }
        }
        assert_eq!(Pages::of(1, 48, 47), None);
    }
}
