//! Kernels in SPIR-V, which no driver may contract or reorder.
//!
//! naga writes the module; words are added to it. `NoContraction` on a result forbids that the operation is joined with
//! others or rearranged (SPIR-V 1.6, section 3.20). Where a device offers float controls (Vulkan 1.2), the entry points
//! also ask for rounding to nearest, subnormal numbers, and signed zeros, infinities and NaN as they are.
//!
//! The module is read instruction by instruction: sums, differences and products must be its only operations on
//! numbers. So no other rounding can reach a result, whatever naga makes of the text.

use naga::back::spv;
use naga::compact::KeepUnused;
use naga::proc::{BoundsCheckPolicies, BoundsCheckPolicy};
use naga::valid::{Capabilities, ValidationFlags, Validator};

/// What a device offers of float controls for numbers of 32 bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct FloatControls {
    /// Rounding to nearest, ties to even, can be requested.
    pub rounding: bool,
    /// Subnormal numbers can be kept.
    pub subnormals: bool,
    /// Signed zeros, infinities and NaN can be kept.
    pub special: bool,
}

/// Words before the first instruction.
const HEADER: usize = 5;

const OP_EXTENSION: u32 = 10;
const OP_EXT_INST: u32 = 12;
const OP_ENTRY_POINT: u32 = 15;
const OP_EXECUTION_MODE: u32 = 16;
const OP_CAPABILITY: u32 = 17;
const OP_DECORATE: u32 = 71;
const OP_F_ADD: u32 = 129;
const OP_F_SUB: u32 = 131;
const OP_F_MUL: u32 = 133;
const NO_CONTRACTION: u32 = 42;

/// Conversions and arithmetic of numbers, and their comparisons.
const ON_NUMBERS: [std::ops::RangeInclusive<u32>; 9] =
    [109..=112, 115..=116, 127..=127, 129..=129, 131..=131, 133..=133, 136..=136, 140..=148, 156..=191];

/// Comparisons of integers and truth values among them.
const ON_OTHERS: std::ops::RangeInclusive<u32> = 164..=179;

/// The fused multiply-add of GLSL.std.450.
const FMA: u32 = 50;

/// Functions of GLSL.std.450 on integers: least, greatest, clamped, lowest and highest bit.
const ON_INTEGERS: [u32; 9] = [38, 39, 41, 42, 44, 45, 73, 74, 75];

/// Whether a kernel may have a fused multiply-add of GLSL.std.450, which only some devices round once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Fma {
    /// It may not.
    Refused,
    /// It may: a probe has to tell what the device makes of it.
    Probed,
}

/// Checks of a kernel's own indices and loops.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Checks {
    /// Indices are clamped, and loops end.
    Kept,
    /// Its author proves that indices are in range and that loops end: a traversal would pay in every turn.
    Proven,
}

/// Compiles a kernel's WGSL: all its entry points, or one of them with what it calls. Drivers optimise the whole module
/// for each pipeline, which some do slowly.
///
/// # Errors
/// When naga refuses it, or when it has an operation on numbers that is no sum, difference or product.
pub(crate) fn spirv(
    source: &str,
    entry: Option<&str>,
    controls: FloatControls,
    fma: Fma,
    checks: Checks,
) -> Result<Vec<u32>, String> {
    let mut module = naga::front::wgsl::parse_str(source).map_err(|error| error.emit_to_string(source))?;
    if let Some(name) = entry {
        module.entry_points.retain(|entry| entry.name == name);
        naga::compact::compact(&mut module, KeepUnused::No);
    }
    let info = Validator::new(ValidationFlags::all(), Capabilities::empty())
        .validate(&module)
        .map_err(|error| error.emit_to_string(source))?;
    let policy = match checks {
        Checks::Kept => BoundsCheckPolicy::Restrict,
        Checks::Proven => BoundsCheckPolicy::Unchecked,
    };
    let bounds = BoundsCheckPolicies { index: policy, buffer: policy, ..BoundsCheckPolicies::default() };
    let options = spv::Options {
        lang_version: (1, 3),
        flags: spv::WriterFlags::empty(),
        bounds_check_policies: bounds,
        force_loop_bounding: checks == Checks::Kept,
        // The device has been opened with nothing else: without this, bytes would be integers of eight bits.
        capabilities: Some(std::iter::once(spv::Capability::Shader).collect()),
        ..spv::Options::default()
    };
    let words = spv::write_vec(&module, &info, &options, None).map_err(|error| error.to_string())?;
    exact(&words, controls, fma)
}

/// The instructions of a module: where each begins, its number and its words.
fn instructions(words: &[u32]) -> impl Iterator<Item = (usize, u32, &[u32])> {
    let mut at = HEADER;
    std::iter::from_fn(move || {
        let first = *words.get(at)?;
        let (start, end) = (at, at + (first >> 16).max(1) as usize);
        at = end;
        Some((start, first & 0xffff, words.get(start..end)?))
    })
}

/// Adds to a module what makes its arithmetic exact.
fn exact(words: &[u32], controls: FloatControls, fma: Fma) -> Result<Vec<u32>, String> {
    let (mut results, mut entries) = (Vec::new(), Vec::new());
    let (mut after_capabilities, mut after_entries, mut annotations) = (HEADER, HEADER, None);
    for (at, number, instruction) in instructions(words) {
        let end = at + instruction.len();
        match number {
            OP_CAPABILITY => after_capabilities = end,
            OP_ENTRY_POINT => {
                entries.push(instruction[2]);
                after_entries = end;
            }
            OP_DECORATE => annotations = annotations.or(Some(at)),
            OP_F_ADD | OP_F_SUB | OP_F_MUL => results.push(instruction[2]),
            OP_EXT_INST if instruction[4] == FMA && fma == Fma::Probed => results.push(instruction[2]),
            OP_EXT_INST if !ON_INTEGERS.contains(&instruction[4]) => {
                return Err(format!("the kernel has function {} of GLSL.std.450", instruction[4]));
            }
            _ if !ON_OTHERS.contains(&number) && ON_NUMBERS.iter().any(|range| range.contains(&number)) => {
                return Err(format!(
                    "the kernel has operation {number}, which is no sum, difference or product"
                ));
            }
            _ => {}
        }
    }
    let annotations = annotations.ok_or("the kernel has no decorations")?;
    // Capability and execution mode of each control.
    let wanted =
        [(controls.rounding, 4467, 4462), (controls.subnormals, 4464, 4459), (controls.special, 4466, 4461)];
    let wanted: Vec<(u32, u32)> = wanted.iter().filter(|w| w.0).map(|&(_, c, mode)| (c, mode)).collect();
    let mut exact = words[..after_capabilities].to_vec();
    exact.extend(wanted.iter().flat_map(|&(capability, _)| [2 << 16 | OP_CAPABILITY, capability]));
    if !wanted.is_empty() {
        exact.extend(extension("SPV_KHR_float_controls"));
    }
    exact.extend(&words[after_capabilities..after_entries]);
    for entry in entries {
        exact.extend(wanted.iter().flat_map(|&(_, mode)| [4 << 16 | OP_EXECUTION_MODE, entry, mode, 32]));
    }
    exact.extend(&words[after_entries..annotations]);
    exact.extend(results.iter().flat_map(|&result| [3 << 16 | OP_DECORATE, result, NO_CONTRACTION]));
    exact.extend(&words[annotations..]);
    Ok(exact)
}

/// The instruction that names an extension.
fn extension(name: &str) -> Vec<u32> {
    let mut bytes = name.as_bytes().to_vec();
    // Strings end with at least one 0.
    bytes.resize((bytes.len() + 1).next_multiple_of(4), 0);
    let words = bytes.chunks_exact(4).map(|c| u32::from_le_bytes([c[0], c[1], c[2], c[3]]));
    let length = bytes.len() as u32 / 4 + 1;
    std::iter::once(length << 16 | OP_EXTENSION).chain(words).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const KERNEL: &str = "
        @group(0) @binding(0) var<storage, read_write> words: array<f32>;
        @compute @workgroup_size(1) fn main(@builtin(global_invocation_id) id: vec3u) {
            words[id.x] = OPERATION;
        }";

    #[test]
    fn every_operation_on_numbers_is_decorated_and_others_are_refused() {
        let compiled = |operation: &str, controls| {
            spirv(&KERNEL.replace("OPERATION", operation), None, controls, Fma::Refused, Checks::Kept)
        };
        let plain = compiled("words[0] * words[1] + words[2] - words[3]", FloatControls::default());
        let plain = plain.expect("sums and products only");
        let decorated: Vec<u32> = instructions(&plain)
            .filter(|(_, number, words)| *number == OP_DECORATE && words[2] == NO_CONTRACTION)
            .map(|(_, _, words)| words[1])
            .collect();
        let results: Vec<u32> = instructions(&plain)
            .filter(|(_, number, _)| [OP_F_ADD, OP_F_SUB, OP_F_MUL].contains(number))
            .map(|(_, _, words)| words[2])
            .collect();
        assert_eq!((results.len(), &decorated), (3, &results));
        let all = FloatControls { rounding: true, subnormals: true, special: true };
        let controlled = compiled("words[0] + words[1]", all).expect("a sum");
        let modes = instructions(&controlled).filter(|(_, number, _)| *number == OP_EXECUTION_MODE).count();
        assert_eq!(modes, 4, "the workgroup's size and three float controls");
        for other in [
            "words[0] / words[1]",
            "-words[0]",
            "sqrt(words[0])",
            "min(words[0], words[1])",
            "f32(id.y)",
            "fma(words[0], words[1], words[2])",
            "select(0.0, 1.0, words[0] < words[1])",
            "floor(words[0])",
            "words[0] % words[1]",
            "dot(vec2f(words[0]), vec2f(words[1]))",
            "bitcast<f32>(u32(words[0]))",
        ] {
            assert!(compiled(other, all).is_err(), "{other}");
        }
    }

    #[test]
    fn a_module_of_one_entry_point_has_nothing_else() {
        let other = "fn twice(x: f32) -> f32 { return x + x; }
            @compute @workgroup_size(1) fn other() { words[0] = twice(words[1]); }";
        let source = KERNEL.replace("OPERATION", "words[0] * words[1]") + other;
        let counts = |entry| {
            let words = spirv(&source, entry, FloatControls::default(), Fma::Refused, Checks::Kept);
            let words = words.expect("a sum and a product");
            let count = |of| instructions(&words).filter(|(_, number, _)| *number == of).count();
            [OP_ENTRY_POINT, OP_F_ADD, OP_F_MUL].map(count)
        };
        assert_eq!(counts(None), [2, 1, 1]);
        assert_eq!(counts(Some("main")), [1, 0, 1]);
        assert_eq!(counts(Some("other")), [1, 1, 0]);
    }

    #[test]
    fn kernels_ask_for_nothing_that_devices_are_not_opened_with() {
        let source = KERNEL
            .replace("array<f32>", "array<u32>")
            .replace("OPERATION", "pack4xU8(unpack4xU8(words[0]) + unpack4xU8(words[1]))");
        let words = spirv(&source, None, FloatControls::default(), Fma::Refused, Checks::Kept);
        let words = words.expect("integers");
        let asked: Vec<u32> = instructions(&words)
            .filter(|(_, number, _)| *number == OP_CAPABILITY)
            .map(|(_, _, words)| words[1])
            .collect();
        assert_eq!(asked, [spv::Capability::Shader as u32]);
    }
}
