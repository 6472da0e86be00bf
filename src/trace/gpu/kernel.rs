//! The kernels: assembles their sources from the constants, the shared files of `shaders/`, and the kernel's own file.

use super::layout;
use super::pages::ScenePages;
use crate::device::{Fma, OPERATIONS};
use crate::geom::{DIRECTION_RANGE, MAX_COORDINATE, MIN_COMPONENT, SLACK};
use crate::stream::MISS;
use std::fmt::Write as _;

/// A kernel: a compute entry point that traces rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kernel {
    /// Nearest hits.
    TraceClosest,
    /// Occlusion.
    TraceAny,
}

const LAYOUT: &str = include_str!("../../../shaders/shared/layout.wgsl");
const RAY: &str = include_str!("../../../shaders/shared/ray.wgsl");
const NEAR_FMA: &str = include_str!("../../../shaders/shared/near_fma.wgsl");
const EDGES: &str = include_str!("../../../shaders/shared/edges.wgsl");
const PLACEMENT: &str = include_str!("../../../shaders/shared/placement.wgsl");
const VISITS: &str = include_str!("../../../shaders/shared/visits.wgsl");
const LEAF: &str = include_str!("../../../shaders/shared/leaf.wgsl");
const TRAVERSE: &str = include_str!("../../../shaders/shared/traverse.wgsl");
const WIDE: &str = include_str!("../../../shaders/shared/wide.wgsl");
const TRIANGLE: &str = include_str!("../../../shaders/candidates/triangle.wgsl");

impl Kernel {
    /// The name of the entry point and of the file.
    pub fn name(self) -> &'static str {
        match self {
            Self::TraceClosest => "trace_closest",
            Self::TraceAny => "trace_any",
        }
    }

    /// Bytes of one ray's answer.
    pub fn answer_bytes(self) -> usize {
        match self {
            Self::TraceClosest => size_of::<layout::Candidates>(),
            Self::TraceAny => size_of::<u32>(),
        }
    }

    fn body(self) -> &'static str {
        match self {
            Self::TraceClosest => include_str!("../../../shaders/candidates/trace_closest.wgsl"),
            Self::TraceAny => include_str!("../../../shaders/candidates/trace_any.wgsl"),
        }
    }

    /// The whole source for scenes of this shape, of the kernel that answers with candidates.
    pub fn source(self, shape: &Shape) -> String {
        // Its margins allow for what a device does to small numbers.
        traversal(shape, Arithmetic { flushes: false, near_fma: Fma::Probed, sides: Sides::WithinMargins })
            + &[TRIANGLE, self.body()].join("\n")
    }
}

/// The arithmetic of a traversal.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arithmetic {
    /// Rays that come near subnormal numbers are undecided.
    pub flushes: bool,
    /// Use of the device's fused multiply-add for what has margins.
    pub near_fma: Fma,
    pub sides: Sides,
}

/// The way in which most triangles are rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sides {
    /// By edge functions as the device computes them, and their margins.
    WithinMargins,
    /// By the signs of edge functions that are the host's to the bit.
    Exact,
}

/// The source that all kernels share, up to the test of a triangle.
pub(super) fn traversal(shape: &Shape, arithmetic: Arithmetic) -> String {
    let Arithmetic { flushes, near_fma, sides } = arithmetic;
    let near_fma = match near_fma {
        Fma::Probed => NEAR_FMA.to_owned(),
        Fma::Refused => NEAR_FMA.replace("fma(a, b, c)", "a * b + c"),
    };
    let edges = match sides {
        Sides::WithinMargins => EDGES,
        Sides::Exact => include_str!("../../../shaders/exact/sides.wgsl"),
    };
    let kinds = format!(
        "const FLUSHES: bool = {flushes};\nconst OVERFLOWS: bool = false;\nconst COUNTS: bool = {};\n",
        shape.counts
    );
    let (constants, pages) = (constants(shape) + &kinds, shape.pages.source());
    let common = [OPERATIONS, LAYOUT, &pages, RAY, &near_fma, edges, PLACEMENT, VISITS, LEAF, WIDE, TRAVERSE];
    [&[&*constants], &common[..], &[""]].concat().join("\n")
}

/// The properties of a scene that its kernels are compiled for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    /// Entries of a traversal's stack.
    pub stack: usize,
    /// True if it is a two-level tree.
    pub members: bool,
    pub pages: ScenePages,
    /// True if the answers to closest hits are what rays visit.
    pub counts: bool,
    /// True if a table decides about masked triangles.
    pub alpha: bool,
}

/// Declarations of the constants that host and device share; Rust defines them.
fn constants(shape: &Shape) -> String {
    let mut text = format!("const MEMBERS: bool = {};\n", shape.members);
    let integers = [
        ("WORKGROUP_SIZE", layout::WORKGROUP_SIZE),
        ("STACK_SIZE", shape.stack.max(1) as u32),
        ("LEAF", layout::LEAF),
        ("MASKED", layout::MASKED),
        ("PAIRS_SHIFT", layout::PAIRS_SHIFT),
        ("PAIR_INDEX", layout::PAIR_INDEX),
        ("PRIMITIVE", layout::PRIMITIVE),
        ("TURN_SHIFT", layout::TURN_SHIFT),
        ("MISS", MISS),
        ("NOWHERE", layout::NOWHERE),
        ("OCCLUDED", layout::OCCLUDED),
        ("UNDECIDED", layout::UNDECIDED),
        ("MORE", layout::MORE),
        ("MASKED_RAY", layout::MASKED_RAY),
        ("MAX_COORDINATE", MAX_COORDINATE.to_bits()),
        ("DIRECTION_MIN", DIRECTION_RANGE.start().to_bits()),
        ("DIRECTION_MAX", DIRECTION_RANGE.end().to_bits()),
        ("MIN_COMPONENT", MIN_COMPONENT.to_bits()),
        ("SLACK", SLACK.to_bits()),
        ("LEAST_PAD", layout::LEAST_PAD.to_bits()),
    ];
    for (name, value) in integers {
        let _ = writeln!(text, "const {name}: u32 = {value}u;");
    }
    let floats = [
        ("LARGEST_FLOAT", f32::MAX),
        ("MARGIN", layout::MARGIN),
        ("T_ROUNDING", layout::T_ROUNDING),
        ("TINY", layout::TINY),
    ];
    for (name, value) in floats {
        // Rust prints the shortest decimal that reads back as the same number.
        let _ = writeln!(text, "const {name}: f32 = {value:e}f;");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::Ray;
    use crate::trace::gpu::pages::Pages;
    use naga::front::wgsl;
    use naga::valid::{Capabilities, ValidationFlags, Validator};
    use std::mem::offset_of;

    const ALL: [Kernel; 2] = [Kernel::TraceClosest, Kernel::TraceAny];

    fn parse(kernel: Kernel) -> naga::Module {
        parse_shape(kernel, ScenePages::ONE, false)
    }

    fn parse_shape(kernel: Kernel, pages: ScenePages, counts: bool) -> naga::Module {
        let source = kernel.source(&Shape { stack: 24, members: true, pages, counts, alpha: false });
        wgsl::parse_str(&source).unwrap_or_else(|e| panic!("{}", e.emit_to_string(&source)))
    }

    #[test]
    fn every_kernel_is_valid_without_any_optional_capability() {
        let (two, three) = (Pages { bits: 4, count: 2 }, Pages { bits: 5, count: 3 });
        let paged = [ScenePages::ONE, ScenePages { nodes: two, pairs: three, identities: two }];
        let kinds = [false, true];
        let kernels = ALL.into_iter().flat_map(|kernel| kinds.map(|kind| (kernel, kind)));
        for ((kernel, kind), pages) in kernels.flat_map(|kernel| paged.map(|pages| (kernel, pages))) {
            let module = parse_shape(kernel, pages, kind);
            Validator::new(ValidationFlags::all(), Capabilities::empty())
                .validate(&module)
                .unwrap_or_else(|e| panic!("{}: {e:?}", kernel.name()));
            let [entry] = module.entry_points.as_slice() else { panic!("one entry point a kernel") };
            assert_eq!(entry.name, kernel.name());
            assert_eq!(entry.workgroup_size, [layout::WORKGROUP_SIZE, 1, 1]);
        }
    }

    /// A struct's name, its size, and the name and offset of every field.
    type Layout = (&'static str, usize, Vec<(&'static str, usize)>);

    macro_rules! layout_of {
        ($type:ty: $($field:ident),+) => {
            (
                stringify!($type).rsplit(' ').next().expect("a name"),
                size_of::<$type>(),
                vec![$((stringify!($field), offset_of!($type, $field))),+],
            )
        };
    }

    #[test]
    fn structs_lie_in_memory_alike_on_both_sides() {
        use layout::{Candidates, Pair, Params, TreeInstance, WideNode};
        let expected: [Layout; 6] = [
            layout_of!(Ray: origin, t_min, direction, t_max),
            layout_of!(WideNode: corner, x, y, z, children),
            layout_of!(Pair: a, b, c),
            layout_of!(TreeInstance: x, root, y, first, z, spare_0, shift, spare_1),
            layout_of!(Candidates: first, second, third, rest),
            layout_of!(Params: count, scene_max_abs, zero, spare),
        ];
        for kernel in ALL {
            let module = parse(kernel);
            for (name, span, members) in &expected {
                let found = module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name));
                let (handle, found) = found.unwrap_or_else(|| panic!("{name} in {}", kernel.name()));
                let naga::TypeInner::Struct { members: found, span: found_span } = &found.inner else {
                    panic!("{name} is a struct");
                };
                let found: Vec<_> =
                    found.iter().map(|m| (m.name.as_deref().unwrap_or(""), m.offset as usize)).collect();
                assert_eq!(&found, members, "{name}");
                assert_eq!(*found_span as usize, *span, "{name}");
                // The stride of arrays is the struct's size.
                for (_, t) in module.types.iter() {
                    if let naga::TypeInner::Array { base, stride, .. } = t.inner
                        && base == handle
                    {
                        assert_eq!(stride as usize, *span, "array of {name}");
                    }
                }
            }
        }
    }

    #[test]
    fn constants_arrive_to_the_bit() {
        let module = parse(Kernel::TraceClosest);
        let value = |name: &str| {
            let found = module.constants.iter().find(|(_, c)| c.name.as_deref() == Some(name));
            let (_, constant) = found.unwrap_or_else(|| panic!("constant {name}"));
            match module.global_expressions[constant.init] {
                naga::Expression::Literal(naga::Literal::F32(x)) => x.to_bits(),
                naga::Expression::Literal(naga::Literal::U32(x)) => x,
                ref other => panic!("{name} is {other:?}"),
            }
        };
        assert_eq!(value("SLACK"), SLACK.to_bits());
        assert_eq!(value("MIN_COMPONENT"), MIN_COMPONENT.to_bits());
        assert_eq!(value("DIRECTION_MIN"), DIRECTION_RANGE.start().to_bits());
        assert_eq!(value("LARGEST_FLOAT"), f32::MAX.to_bits());
        assert_eq!(value("TINY"), layout::TINY.to_bits());
        assert_eq!(value("MISS"), MISS);
        assert_eq!(value("STACK_SIZE"), 24);
    }
}
