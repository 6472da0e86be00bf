//! Decompresses buffer views of EXT_meshopt_compression and KHR_meshopt_compression.

use super::super::LoadProblem;
use super::super::guard::guarded;
use super::super::session::Session;
use super::buffers::{Buffers, number};
use ::gltf::Document;
use ::gltf::buffer::{Buffer, View};
use ::gltf::json::Value;
use meshoptimizer_rs::{Limits, Workspace, codec};
use std::collections::BTreeMap;

/// The names of the extension, which differ in the codecs that they allow.
const NAMES: [&str; 2] = ["KHR_meshopt_compression", "EXT_meshopt_compression"];

/// True if a buffer says that it only stands in for decompressed bytes.
pub(super) fn is_fallback(buffer: &Buffer) -> bool {
    let extension = NAMES.iter().find_map(|name| buffer.extension_value(name));
    extension.is_some_and(|extension| extension["fallback"].as_bool() == Some(true))
}

/// For each buffer, true if it has views and all of them are compressed. Without bytes, it is a fallback as well.
pub(super) fn are_compressed(document: &Document) -> Vec<bool> {
    let (mut has_views, mut has_plain) =
        (vec![false; document.buffers().len()], vec![false; document.buffers().len()]);
    for view in document.views() {
        let buffer = view.buffer().index();
        has_views[buffer] = true;
        has_plain[buffer] |= NAMES.iter().all(|name| view.extension_value(name).is_none());
    }
    has_views.into_iter().zip(has_plain).map(|(has_views, has_plain)| has_views && !has_plain).collect()
}

/// The compressed form of a buffer view.
struct Compressed<'a> {
    source: &'a [u8],
    mode: String,
    filter: String,
    count: usize,
    stride: usize,
}

/// The bytes of all compressed buffer views, by their index.
///
/// # Errors
/// When a view is damaged, or does not have the size that it promises, or all of them are over the budget.
pub(super) fn decompress(
    session: &Session,
    document: &Document,
    buffers: &Buffers,
) -> Result<BTreeMap<usize, Vec<u8>>, LoadProblem> {
    let mut found = Vec::new();
    for view in document.views() {
        let Some(extension) = NAMES.iter().find_map(|name| view.extension_value(name)) else { continue };
        let compressed =
            Compressed::new(&view, extension, buffers).map_err(|problem| place(session, &view, problem))?;
        found.push((view, compressed));
    }
    let all = found.iter().fold(0, |sum: u64, (_, compressed)| sum.saturating_add(compressed.bytes() as u64));
    session.check("the decompressed buffer views", all).map_err(|source| session.over(source))?;
    let mut views = BTreeMap::new();
    for (view, compressed) in found {
        let bytes = guarded(|| compressed.decode()).map_err(|problem| place(session, &view, problem))?;
        views.insert(view.index(), bytes);
    }
    Ok(views)
}

fn place(session: &Session, view: &View, problem: String) -> LoadProblem {
    let place = format!("bufferViews[{}]", view.index());
    LoadProblem::Place {
        path: session.path.clone(),
        place,
        problem: format!("compressed by meshopt: {problem}"),
    }
}

impl<'a> Compressed<'a> {
    /// Reads a view's extension, and checks it against the view.
    fn new(view: &View, extension: &Value, buffers: &'a Buffers) -> Result<Self, String> {
        let buffer = number(extension, "buffer", None)?;
        let offset = number(extension, "byteOffset", Some(0))?;
        let source = buffers.slice(buffer, offset, number(extension, "byteLength", None)?)?;
        let (count, stride) = (number(extension, "count", None)?, number(extension, "byteStride", None)?);
        if count.checked_mul(stride) != Some(view.length()) {
            return Err(format!(
                "{count} elements of {stride} bytes, but the view has {} bytes",
                view.length()
            ));
        }
        let text = |key| extension[key].as_str().map(str::to_owned);
        let mode = text("mode").ok_or("has no mode")?;
        Ok(Self { source, mode, filter: text("filter").unwrap_or_else(|| "NONE".into()), count, stride })
    }

    fn bytes(&self) -> usize {
        self.count * self.stride
    }

    fn decode(&self) -> Result<Vec<u8>, String> {
        let (count, stride) = (self.count, self.stride);
        // The budget has been asked.
        let mut workspace = Workspace::new(Limits { max_bytes: usize::MAX, max_work: u64::MAX });
        let decoded = match self.mode.as_str() {
            "ATTRIBUTES" => codec::decode_vertex_buffer(count, stride, self.source, &mut workspace),
            "TRIANGLES" => codec::decode_index_buffer(count, stride, self.source, &mut workspace),
            "INDICES" => codec::decode_index_sequence(count, stride, self.source, &mut workspace),
            mode => return Err(format!("its mode is {mode:?}, which is none that is known")),
        };
        let mut bytes = decoded.map_err(|problem| problem.to_string())?;
        let filter = match self.filter.as_str() {
            "NONE" => return Ok(bytes),
            "OCTAHEDRAL" => codec::decode_filter_oct,
            "QUATERNION" => codec::decode_filter_quat,
            "EXPONENTIAL" => codec::decode_filter_exp,
            "COLOR" => codec::decode_filter_color,
            filter => return Err(format!("its filter is {filter:?}, which is none that is known")),
        };
        if self.mode != "ATTRIBUTES" {
            return Err(format!("its filter {:?} is only for attributes", self.filter));
        }
        filter(&mut bytes, count, stride, &mut workspace).map_err(|problem| problem.to_string())?;
        Ok(bytes)
    }
}
