//! glTF files of tests.

use serde_json::{Value, json};

/// The numbers of an accessor.
pub struct Array {
    pub kind: &'static str,
    /// glTF's number of the type: 5121 bytes, 5126 floats.
    pub component: u32,
    pub bytes: Vec<u8>,
}

impl Array {
    pub fn floats(kind: &'static str, numbers: &[f32]) -> Self {
        let bytes = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
        Self { kind, component: 5126, bytes }
    }
}

/// A file whose accessors are these arrays, in order, each in a view of its own; `rest` has all else.
pub fn file(arrays: &[Array], mut rest: Value) -> String {
    let (mut bytes, mut views, mut accessors) = (Vec::new(), Vec::new(), Vec::new());
    for Array { kind, component, bytes: own } in arrays {
        let width =
            ["SCALAR", "VEC2", "VEC3", "VEC4"].iter().position(|known| known == kind).expect("a kind");
        let size = if *component == 5121 { 1 } else { 4 };
        let count = own.len() / (size * (1 + width));
        accessors.push(
            json!({ "bufferView": views.len(), "componentType": component, "type": kind, "count": count }),
        );
        views.push(json!({ "buffer": 0, "byteOffset": bytes.len(), "byteLength": own.len() }));
        bytes.extend_from_slice(own);
    }
    let data = bytes.iter().map(|byte| format!("%{byte:02x}")).collect::<String>();
    let uri = format!("data:application/octet-stream,{data}");
    rest["asset"] = json!({ "version": "2.0" });
    rest["buffers"] = json!([{ "byteLength": bytes.len(), "uri": uri }]);
    (rest["bufferViews"], rest["accessors"]) = (json!(views), json!(accessors));
    rest.to_string()
}
