//! Radiance that is added to the pixel without the weights of the rays above.

use super::HostFunction;
use crate::program::code::{Code, Instruction, Register};
use std::collections::HashSet;

/// The first calls of `splat` and of `shadow` whose radiance depends neither on the payload nor on the depth, in a
/// function that also calls `trace`: the functions, and the calls' first bytes in the parsed text. The payload is the
/// last `payload` inputs.
pub(super) fn unweighted(code: &Code, payload: u32) -> Vec<(HostFunction, u32)> {
    let is_trace = |instruction: &Instruction| {
        matches!(instruction, Instruction::Host { function: HostFunction::Trace(_), .. })
    };
    if !code.instructions.iter().any(is_trace) {
        return Vec::new();
    }
    let known = known_to_callers(code, payload);
    let mut found: Vec<(HostFunction, u32)> = Vec::new();
    for instruction in &code.instructions {
        let Instruction::Host { function, mask, operands, place, .. } = instruction else { continue };
        let first = match function {
            HostFunction::Splat => 0,
            HostFunction::Shadow => 7,
            _ => continue,
        };
        let radiance = &code.list(operands)[first..first + 3];
        let is_weighted = radiance.iter().chain([mask]).any(|register| known.contains(register));
        if !is_weighted && found.iter().all(|(other, _)| other != function) {
            found.push((*function, *place));
        }
    }
    found
}

/// Registers that depend on what the callers have handed on.
fn known_to_callers(code: &Code, payload: u32) -> HashSet<Register> {
    let first = code.inputs.len().saturating_sub(payload as usize);
    let mut known: HashSet<Register> = code.inputs[first..].iter().map(|&(_, register)| register).collect();
    loop {
        let before = known.len();
        for instruction in &code.instructions {
            let asks_depth = matches!(instruction, Instruction::Host { function: HostFunction::Depth, .. });
            if asks_depth || code.reads(instruction).iter().any(|register| known.contains(register)) {
                known.extend(code.writes(instruction));
            }
        }
        if known.len() == before {
            return known;
        }
    }
}
