//! The functions that an integrator defines, and their signatures.

use super::{MOST_ENTRY_BYTES, MOST_PAYLOAD_BYTES, too_large};
use crate::program::source::{Fault, Source};
use naga::{Function, Handle, Span, TypeInner, VectorSize};

const START: &str = "fn start(p: ptr<function, Payload>)";
const HIT: &str = "fn hit(at: Hit, p: Payload)";
const MISS: &str = "fn miss(direction: vec3f, p: Payload)";
const RESUME: &str = "fn resume(e: Entry, came: vec3f, p: Payload)";

/// The functions of an integrator.
pub(super) struct Found {
    pub start: Option<Handle<Function>>,
    pub hit: Handle<Function>,
    pub miss: Handle<Function>,
    /// The loop shader, and the scalars of its entry.
    pub resume: Option<(Handle<Function>, u32)>,
    /// Scalars of the payload.
    pub payload: u32,
    /// True if the functions return radiance.
    pub returns: bool,
}

/// Finds the functions and checks their signatures.
///
/// # Errors
/// When one is missing or has another signature; the message shows the right one.
pub(super) fn find(source: &Source) -> Result<Found, Fault> {
    let payload = struct_scalars(source, "Payload", MOST_PAYLOAD_BYTES)?;
    let entry = struct_scalars(source, "Entry", MOST_ENTRY_BYTES)?;
    let hit = required(source, "hit", HIT)?;
    let miss = required(source, "miss", MISS)?;
    let returns = checked(source, hit, &["Hit", "Payload"], HIT)?;
    same_result(source, miss, &["vec3f", "Payload"], MISS, returns)?;
    let start = named(source, "start");
    if let Some(start) = start
        && checked(source, start, &["*Payload"], START)?
    {
        return Err(another(source, start, "start", START));
    }
    let mut resume = None;
    if let Some(function) = named(source, "resume") {
        same_result(source, function, &["Entry", "vec3f", "Payload"], RESUME, returns)?;
        resume = Some((function, entry));
    } else if entry > 0 {
        return Err(Fault::new(
            Span::UNDEFINED,
            "the integrator has a `struct Entry` but no function `resume`",
            format!("define `{}`", with_result(RESUME, returns)),
        ));
    }
    Ok(Found { start, hit, miss, resume, payload, returns })
}

fn named(source: &Source, name: &str) -> Option<Handle<Function>> {
    let functions = source.module.functions.iter();
    functions.filter(|(_, function)| function.name.as_deref() == Some(name)).map(|(handle, _)| handle).next()
}

fn required(source: &Source, name: &str, signature: &str) -> Result<Handle<Function>, Fault> {
    named(source, name).ok_or_else(|| {
        Fault::new(
            Span::UNDEFINED,
            format!("the integrator has no function `{name}`"),
            format!("define `{signature}`"),
        )
    })
}

fn with_result(signature: &str, returns: bool) -> String {
    format!("{signature}{}", if returns { " -> vec3f" } else { "" })
}

fn another(source: &Source, function: Handle<Function>, name: &str, signature: &str) -> Fault {
    let span = source.module.functions.get_span(function);
    Fault::new(span, format!("`{name}` has another signature"), format!("write `{signature}`"))
}

/// A type as signatures name it.
fn type_name(source: &Source, ty: Handle<naga::Type>) -> Option<String> {
    let types = &source.module.types;
    match &types[ty].inner {
        TypeInner::Vector { size: VectorSize::Tri, scalar } if *scalar == naga::Scalar::F32 => {
            Some("vec3f".into())
        }
        TypeInner::Pointer { base, .. } => Some(format!("*{}", types[*base].name.as_deref()?)),
        _ => types[ty].name.clone(),
    }
}

/// Checks the arguments of a function; whether it returns a `vec3f`.
fn checked(
    source: &Source,
    handle: Handle<Function>,
    arguments: &[&str],
    signature: &str,
) -> Result<bool, Fault> {
    let function = &source.module.functions[handle];
    let name = function.name.as_deref().unwrap_or_default();
    let found: Vec<_> = function.arguments.iter().map(|argument| type_name(source, argument.ty)).collect();
    let wanted: Vec<_> = arguments.iter().map(|&argument| Some(argument.to_owned())).collect();
    let result = function.result.as_ref().map(|result| type_name(source, result.ty));
    match result {
        None if found == wanted => Ok(false),
        Some(Some(result)) if found == wanted && result == "vec3f" => Ok(true),
        _ => Err(another(source, handle, name, &format!("{signature}`, or `{signature} -> vec3f"))),
    }
}

/// Checks a function that returns what `hit` does.
fn same_result(
    source: &Source,
    handle: Handle<Function>,
    arguments: &[&str],
    signature: &str,
    returns: bool,
) -> Result<(), Fault> {
    if checked(source, handle, arguments, signature)? == returns {
        return Ok(());
    }
    let name = source.module.functions[handle].name.as_deref().unwrap_or_default();
    Err(Fault::new(
        source.module.functions.get_span(handle),
        format!("`{name}` and `hit` return different things"),
        format!("write `{}`", with_result(signature, returns)),
    ))
}

/// Scalars of a struct of the file; 0 if it has none.
fn struct_scalars(source: &Source, name: &str, most: usize) -> Result<u32, Fault> {
    let types = &source.module.types;
    let Some((handle, ty)) = types.iter().find(|(_, ty)| ty.name.as_deref() == Some(name)) else {
        return Ok(0);
    };
    let scalars = scalars(source, &ty.inner);
    if 4 * scalars > most {
        return Err(too_large(&format!("`struct {name}`"), 4 * scalars, most, types.get_span(handle)));
    }
    Ok(scalars as u32)
}

fn scalars(source: &Source, inner: &TypeInner) -> usize {
    let types = &source.module.types;
    match inner {
        TypeInner::Vector { size, .. } => *size as usize,
        TypeInner::Matrix { columns, rows, .. } => *columns as usize * *rows as usize,
        TypeInner::Array { base, size: naga::ArraySize::Constant(count), .. } => {
            scalars(source, &types[*base].inner).saturating_mul(count.get() as usize)
        }
        TypeInner::Struct { members, .. } => {
            members.iter().map(|member| scalars(source, &types[member.ty].inner)).sum()
        }
        _ => 1,
    }
}
