//! `raystream doctor`.

use super::Outcome;
use super::args::DoctorArgs;
use anyhow::{Context, Result, ensure};
use object::read::archive::ArchiveFile;
use object::{Architecture, Object, ObjectSection, ObjectSymbol, SectionKind, SymbolKind};
use raystream::picture::Registry;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::thread::JoinHandle;

/// Number of instructions that are named for each function.
const NAMED: usize = 4;

/// Looks for vector instructions that a program calls as functions. Code over lanes is compiled for an instruction set
/// only where it is inlined; elsewhere each of its instructions is a call, which is several times slower.
pub fn run(args: &DoctorArgs) -> Result<Outcome> {
    let path = args.program.display();
    let bytes = std::fs::read(&args.program).with_context(|| format!("{path}: cannot be read"))?;
    if let Ok(archive) = ArchiveFile::parse(&*bytes) {
        let found = lane_instances(&archive, &bytes).with_context(|| path.to_string())?;
        if found == 0 {
            stdout_line!("{path}: has no code over lanes");
            return Ok(Outcome::Done);
        }
        stdout_line!(
            "{path}: has {found} functions over lanes; let another crate instantiate them, or give this one opt-level 3"
        );
        return Ok(Outcome::Degraded);
    }
    let found = examine(&bytes).with_context(|| path.to_string())?;
    if found.is_empty() {
        stdout_line!("{path}: all vector instructions are inlined");
        return Ok(Outcome::Done);
    }
    for (function, instructions) in &found {
        let function = described(function);
        let named: Vec<&str> = instructions.iter().take(NAMED).map(String::as_str).collect();
        let more = if instructions.len() > NAMED { ", .." } else { "" };
        stdout_line!("{function} calls {}{more}", named.join(", "));
    }
    stdout_line!(
        "{path}: {} functions call vector instructions instead of having them inlined, which makes them several times \
         slower; mark them, and what they call, #[inline(always)]; write functions instead of closures",
        found.len()
    );
    Ok(Outcome::Degraded)
}

/// Functions by name, with the vector instructions that each calls.
pub type Callers = BTreeMap<String, BTreeSet<String>>;

/// Looks at the program that runs, on a thread of its own, if the program has plug-ins and is optimised. Without
/// symbols nothing is found.
pub fn examine_self(registry: &Registry) -> Option<JoinHandle<Callers>> {
    if cfg!(debug_assertions) || !registry.has_plugins() {
        return None;
    }
    Some(std::thread::spawn(|| {
        let bytes = std::env::current_exe().and_then(std::fs::read);
        bytes.ok().and_then(|bytes| examine(&bytes).ok()).unwrap_or_default()
    }))
}

/// Warns of what [`examine_self`] has found.
pub fn warn_of(examination: Option<JoinHandle<Callers>>) {
    let found = examination.map(JoinHandle::join).and_then(Result::ok).unwrap_or_default();
    for function in found.keys() {
        log::warn!(
            "{} is several times slower than it could be: {} (`raystream doctor` says more)",
            described(function),
            remedy(function)
        );
    }
}

/// True if a function is the standard library's. What it calls over lanes is a closure of the user's, whose name its
/// own lacks.
fn is_of_std(function: &str) -> bool {
    let path = function.trim_start_matches('<');
    ["core::", "alloc::", "std::"].iter().any(|library| path.starts_with(library))
}

/// The name of a function, with what it says of the user's code.
fn described(function: &str) -> String {
    if is_of_std(function) { format!("a closure that is called by {function}") } else { function.to_owned() }
}

/// What makes a function fast.
fn remedy(function: &str) -> &'static str {
    if is_of_std(function) {
        "closures over lanes are not inlined reliably; write a loop instead"
    } else {
        "mark it, and what it calls, #[inline(always)]"
    }
}

/// Number of tasks over lanes that an archive of object files instantiates.
fn lane_instances(archive: &ArchiveFile<'_>, bytes: &[u8]) -> Result<usize> {
    let mut found = 0;
    for member in archive.members() {
        let data = member.and_then(|member| member.data(bytes)).context("a damaged archive")?;
        // Metadata is no object file.
        let Ok(file) = object::File::parse(data) else { continue };
        let is_instance = |symbol: &object::Symbol<'_, '_>| {
            let is_defined = symbol.kind() == SymbolKind::Text && symbol.is_definition();
            is_defined
                && symbol.name().is_ok_and(|name| demangled(name).contains("lanes::level::Instances>::"))
        };
        found += file.symbols().filter(is_instance).count();
    }
    Ok(found)
}

/// Crates with vector code of their own, which nothing here can mend. Kernels do not call it.
const FOREIGN: [&str; 3] = ["core::slice::ascii::", "hashbrown::", "memchr::"];

/// The name of a symbol as the source has it.
fn demangled(symbol: &str) -> String {
    format!("{:#}", rustc_demangle::demangle(symbol))
}

fn examine(bytes: &[u8]) -> Result<Callers> {
    let file = object::File::parse(bytes).context("not a program")?;
    // Some symbols have no size: a function reaches up to the next one.
    let mut functions: Vec<(u64, &str)> = file
        .symbols()
        .filter(|symbol| symbol.kind() == SymbolKind::Text && symbol.address() != 0)
        .filter_map(|symbol| Some((symbol.address(), symbol.name().ok()?)))
        .collect();
    ensure!(!functions.is_empty(), "it has no symbols; build it without `strip`");
    functions.sort_unstable();
    let instructions: HashMap<u64, String> = functions
        .iter()
        .filter(|(_, symbol)| symbol.contains("core_arch"))
        .filter_map(|&(address, symbol)| Some((address, instruction(&demangled(symbol))?.to_owned())))
        .collect();
    let mut callers = Callers::new();
    if instructions.is_empty() {
        return Ok(callers);
    }
    for section in file.sections().filter(|section| section.kind() == SectionKind::Text) {
        let code = section.data().context("its code cannot be read")?;
        for (place, target) in calls(file.architecture(), code, section.address()) {
            let Some(called) = instructions.get(&target) else { continue };
            let after = functions.partition_point(|(address, _)| *address <= place);
            let Some(&(address, caller)) = functions[..after].last() else { continue };
            if instructions.contains_key(&address) {
                continue;
            }
            let caller = demangled(caller);
            if !FOREIGN.iter().any(|path| caller.starts_with(path)) {
                callers.entry(caller).or_default().insert(called.clone());
            }
        }
    }
    Ok(callers)
}

/// The vector instruction that a function is, if it is one. Loads and stores are left out: the standard library calls
/// some.
fn instruction(function: &str) -> Option<&str> {
    let (path, name) = function.rsplit_once("::")?;
    let is_vector = match path.split_once("core_arch::")?.1 {
        x86 if x86.starts_with("x86") => name.starts_with("_mm"),
        arm => arm.contains("neon") && name.starts_with('v'),
    };
    (is_vector && !name.contains("_load") && !name.contains("_store")).then_some(name)
}

/// Addresses of call instructions and of what they call. On x86-64 some are no instructions but data that looks alike;
/// that such data is the address of a function is as good as impossible.
fn calls(architecture: Architecture, code: &[u8], base: u64) -> Vec<(u64, u64)> {
    match architecture {
        Architecture::X86_64 => (0..code.len().saturating_sub(4))
            .filter(|&at| matches!(code[at], 0xE8 | 0xE9))
            .map(|at| {
                let distance = i32::from_le_bytes([code[at + 1], code[at + 2], code[at + 3], code[at + 4]]);
                let place = base + at as u64;
                (place, place.wrapping_add(5).wrapping_add_signed(i64::from(distance)))
            })
            .collect(),
        Architecture::Aarch64 => code
            .as_chunks::<4>()
            .0
            .iter()
            .enumerate()
            .map(|(at, word)| (base + 4 * at as u64, u32::from_le_bytes(*word)))
            // BL and B: an opcode of 6 bits, then a distance in words.
            .filter(|(_, word)| matches!(word >> 26, 0b10_0101 | 0b00_0101))
            .map(|(place, word)| (place, place.wrapping_add_signed(i64::from((word << 6) as i32 >> 4))))
            .collect(),
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use raystream::lanes::{LaneTask, Lanes, Num, SimdLevel};

    /// What a user forgets: a function over lanes that is not inlined.
    #[inline(never)]
    fn forgotten_polynomial<L: Lanes>(x: Num<L>) -> Num<L> {
        (x * 3.0 + 1.0) * x + x.sqrt()
    }

    struct Forgetful;

    impl LaneTask for Forgetful {
        type Output = f32;

        #[inline(always)]
        fn run<L: Lanes>(self, l: L) -> f32 {
            forgotten_polynomial(Num::splat(l, 4.0)).to_array()[0]
        }
    }

    #[test]
    fn a_function_without_its_attribute_is_named() {
        assert!(SimdLevel::available().into_iter().all(|level| level.run(Forgetful) == 54.0));
        let program = std::env::current_exe().expect("this test");
        let found = examine(&std::fs::read(program).expect("this test")).expect("it has symbols");
        let name = "raystream_cli::doctor::tests::forgotten_polynomial";
        let instructions = found.get(name).unwrap_or_else(|| panic!("not among {:?}", found.keys()));
        assert!(instructions.iter().any(|name| name.contains("sqrt")), "{instructions:?}");
    }

    #[test]
    fn code_over_lanes_is_found_in_a_library() {
        // An archive of one object file: this test, which has such code.
        let program = std::fs::read(std::env::current_exe().expect("this test")).expect("this test");
        let mut archive =
            format!("!<arch>\n{:<16}{:<12}{:<6}{:<6}{:<8}{:<10}`\n", "a.o/", 0, 0, 0, 644, program.len());
        assert_eq!(archive.len(), 68);
        let mut bytes = std::mem::take(&mut archive).into_bytes();
        bytes.extend(&program);
        let found = |bytes: &[u8]| {
            lane_instances(&ArchiveFile::parse(bytes).expect("an archive"), bytes).expect("whole")
        };
        assert!(found(&bytes) >= SimdLevel::available().len());
        assert_eq!(found(b"!<arch>\n"), 0);
    }

    #[test]
    fn a_closure_within_the_standard_library_is_called_one() {
        let within = "<core::ops::try_trait::Wrapped<T,A,F> as core::ops::function::FnMut<(A,)>>::call_mut";
        assert_eq!(described(within), format!("a closure that is called by {within}"));
        assert!(remedy(within).ends_with("write a loop instead"));
        let own = "mine::scorecard::polynomial";
        assert!(described(own) == own && remedy(own).contains("#[inline(always)]"));
    }

    #[test]
    fn calls_are_found_by_their_distance() {
        let code = [0x90, 0xE8, 0x0A, 0, 0, 0, 0xE9, 0xF5, 0xFF, 0xFF, 0xFF];
        assert_eq!(calls(Architecture::X86_64, &code, 0x1000), [(0x1001, 0x1010), (0x1006, 0x1000)]);
        // bl #8; b #-4; ret
        let code = [0x02, 0, 0, 0x94, 0xFF, 0xFF, 0xFF, 0x17, 0xC0, 0x03, 0x5F, 0xD6];
        assert_eq!(calls(Architecture::Aarch64, &code, 0x1000), [(0x1000, 0x1008), (0x1004, 0x1000)]);
    }

    #[test]
    fn what_is_no_program_is_refused() {
        assert!(format!("{:#}", examine(b"text").expect_err("text")).starts_with("not a program"));
        assert_eq!(instruction("core::core_arch::x86::avx512f::_mm512_add_ps"), Some("_mm512_add_ps"));
        assert_eq!(instruction("core::core_arch::x86::sse2::_mm_loadu_si128"), None);
        assert_eq!(instruction("core::core_arch::arm_shared::neon::generated::vaddq_f32"), Some("vaddq_f32"));
        assert_eq!(instruction("mine::_mm_add"), None);
    }
}
