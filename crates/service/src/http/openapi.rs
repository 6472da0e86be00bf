//! The description of the API (OpenAPI 3.1).

use super::route::{ANY, Access, Body, JSON, Route};
use super::routes;
use crate::coordinator::ledger::{DeliveryState, JobState, Role};
use axum::Json;
use raystream::picture::RenderSpec;
use raystream::schedule::Priority;
use serde_json::{Value, json};

const FORM: &str = "multipart/form-data";

/// Codes of refusals. A route may answer any of them.
const REFUSALS: [u16; 14] = [400, 401, 403, 404, 405, 408, 409, 413, 415, 422, 429, 502, 503, 507];

/// `GET /openapi.json`.
pub async fn document() -> Json<Value> {
    Json(api())
}

/// The description of the API, an OpenAPI 3.1 document: what `GET /openapi.json` answers.
pub fn api() -> Value {
    let mut paths = serde_json::Map::new();
    for route in routes::all() {
        let path = paths.entry(route.path).or_insert_with(|| json!({}));
        path[route.method] = operation(&route);
    }
    json!({
        "openapi": "3.1.0",
        "info": { "title": "raystream", "version": env!("CARGO_PKG_VERSION"), "license": { "name": "MIT" } },
        "paths": paths,
        "security": [{ "token": [] }, { "cookie": [] }],
        "components": {
            "securitySchemes": {
                "token": { "type": "http", "scheme": "bearer" },
                "cookie": { "type": "apiKey", "in": "cookie", "name": super::auth::COOKIE }
            },
            "schemas": schemas()
        }
    })
}

fn operation(route: &Route) -> Value {
    let mut parameters: Vec<Value> = route
        .path
        .split(['{', '}'])
        .skip(1)
        .step_by(2)
        .map(|name| json!({ "name": name, "in": "path", "required": true, "schema": { "type": "string" } }))
        .collect();
    for &(name, kind, required) in route.query {
        let schema = match kind {
            "state" => json!({ "enum": JobState::ALL.map(JobState::name) }),
            kind => json!({ "type": kind }),
        };
        parameters.push(json!({ "name": name, "in": "query", "required": required, "schema": schema }));
    }
    let mut responses = serde_json::Map::new();
    for &code in route.codes {
        responses.insert(code.to_string(), success(route, code));
    }
    for code in REFUSALS {
        let content = json!({ "application/problem+json": { "schema": reference("Problem") } });
        responses.insert(code.to_string(), json!({ "description": "refused", "content": content }));
    }
    let mut operation = json!({ "summary": route.summary, "parameters": parameters, "responses": responses });
    match route.access {
        Access::Open => operation["security"] = json!([]),
        access => operation["x-role"] = access.role().name().into(),
    }
    let (media, schema) = match route.body {
        Body::None => return operation,
        Body::Bytes => (ANY, json!({ "type": "string", "format": "binary" })),
        Body::Json(name) => (JSON, reference(name)),
        Body::Form(name) => (FORM, reference(name)),
    };
    operation["requestBody"] = json!({ "required": true, "content": { media: { "schema": schema } } });
    operation
}

/// The answer of a route with a code of success.
fn success(route: &Route, code: u16) -> Value {
    match code {
        204 | 304 => return json!({ "description": "nothing more" }),
        307 => {
            return json!({ "description": "the file in the storage; the body names its bytes and its SHA-256" });
        }
        101 => return json!({ "description": "a WebSocket" }),
        _ => {}
    }
    let schema = route.answer.map_or_else(|| json!({}), |name| json!({ "schema": reference(name) }));
    let content: serde_json::Map<String, Value> =
        route.media.iter().map(|&media| (media.to_owned(), schema.clone())).collect();
    json!({ "description": route.summary, "content": content })
}

fn reference(schema: &str) -> Value {
    json!({ "$ref": format!("#/components/schemas/{schema}") })
}

/// The names of priorities.
fn priorities() -> Value {
    json!({ "enum": Priority::ALL.map(Priority::name) })
}

/// What answers hold.
fn answers() -> [(&'static str, Value); 6] {
    let text = || json!({ "type": "string" });
    let count = || json!({ "type": "integer", "minimum": 0 });
    let states = json!({ "enum": JobState::ALL.map(JobState::name) });
    let job = json!({ "type": "object", "required": ["id", "state", "progress", "pictures"], "properties": {
        "id": text(), "tenant": text(), "state": states.clone(), "priority": priorities(), "scene": text(),
        "title": { "type": ["string", "null"] }, "labels": { "type": "array", "items": text() },
        "began_ms": { "type": ["integer", "null"] }, "left_s": { "type": ["integer", "null"] },
        "spec": { "$ref": "#/components/schemas/RenderSpec" },
        "size": { "type": "array", "items": count() }, "spp": count(),
        "kind": { "enum": ["samples", "noise", "seconds"] },
        "created_ms": { "type": "integer" }, "ended_ms": { "type": ["integer", "null"] },
        "error": { "type": ["string", "null"] }, "progress": { "type": "number", "minimum": 0, "maximum": 1 },
        "frames": count(), "frames_done": count(), "units": count(), "units_done": count(),
        "pinned": { "type": "boolean" }, "deliveries": { "type": "object" },
        "pictures": { "type": "array", "items": { "type": "object", "required": ["frame", "name", "hash"] } } } });
    let scene = json!({ "type": "object", "required": ["sha256", "bytes"],
        "properties": { "sha256": text(), "bytes": count() } });
    let address = json!({ "type": "object", "required": ["method", "url", "headers", "expires_s"],
        "properties": { "method": text(), "url": text(), "headers": { "type": "object" }, "expires_s": count() } });
    let steered = json!({ "type": "object", "required": ["id", "state"],
        "properties": { "id": text(), "state": states, "kept": { "type": "object" }, "priority": priorities(),
            "pinned": { "type": "boolean" } } });
    let end = json!({ "type": ["integer", "null"] });
    let caller = json!({ "type": "object", "required": ["name", "tenant", "role", "expires_ms", "quotas", "used"],
        "properties": {
            "name": text(), "tenant": text(), "role": { "enum": Role::ALL.map(Role::name) }, "expires_ms": end.clone(),
            "quotas": { "type": "object" }, "used": { "type": "object" } } });
    let delivery = json!({ "type": "object", "required": ["id", "url", "state", "attempts"], "properties": {
        "id": text(), "url": text(), "state": { "enum": DeliveryState::ALL.map(DeliveryState::name) },
        "attempts": count(), "created_ms": { "type": "integer" }, "last_ms": end.clone(), "next_ms": end.clone(),
        "status": end.clone(), "error": { "type": ["string", "null"] } } });
    let deliveries = json!({ "type": "object", "required": ["deliveries"],
        "properties": { "deliveries": { "type": "array", "items": delivery } } });
    [
        ("Job", job),
        ("Scene", scene),
        ("UploadAddress", address),
        ("Steered", steered),
        ("Caller", caller),
        ("Deliveries", deliveries),
    ]
}

fn schemas() -> Value {
    let mut all = requests();
    all.as_object_mut().into_iter().for_each(|all| {
        all.extend(answers().map(|(name, schema)| (name.to_owned(), schema)));
    });
    all
}

/// What requests hold, and refusals.
fn requests() -> Value {
    let text = || json!({ "type": "string" });
    let object = |required: &[&str], properties: Value| {
        json!({
            "type": "object", "additionalProperties": false,
            "required": required, "properties": properties,
        })
    };
    json!({
        "Size": object(&["bytes"], json!({ "bytes": { "type": "integer", "minimum": 1 } })),
        "Login": object(&["token"], json!({ "token": text() })),
        "Priority": object(&["priority"], json!({ "priority": priorities() })),
        "Webhook": object(&["url", "secret"], json!({ "url": text(), "secret": text() })),
        "RenderSpec": RenderSpec::schema(),
        "JobRequest": job_request(),
        "RenderForm": render_form(),
        "Problem": { "type": "object", "required": ["type", "title", "status", "detail"], "properties": {
            "type": text(), "title": text(), "status": { "type": "integer" }, "detail": text(),
            "limit": text(), "value": { "type": "integer" }, "state": text() } }
    })
}

/// A render spec whose scene is an upload's, and what the service alone wants to know.
fn job_request() -> Value {
    let mut schema = RenderSpec::schema();
    schema["required"] = json!(["scene"]);
    let properties = &mut schema["properties"];
    properties["scene"] = json!({ "type": "string", "pattern": "^[0-9a-fA-F]{64}$" });
    properties["title"] = json!({ "type": ["string", "null"], "minLength": 1, "maxLength": 200 });
    let label = json!({ "type": "string", "minLength": 1, "maxLength": 64 });
    properties["labels"] = json!({ "type": ["array", "null"], "maxItems": 20, "items": label });
    properties["entry"] = json!({ "type": ["string", "null"] });
    let priorities: Vec<Option<&str>> =
        Priority::ALL.map(|one| Some(one.name())).into_iter().chain([None]).collect();
    properties["priority"] = json!({ "enum": priorities });
    properties["webhook"] =
        json!({ "oneOf": [{ "type": "null" }, { "$ref": "#/components/schemas/Webhook" }] });
    schema
}

/// The form of Drake's clients.
fn render_form() -> Value {
    let fields = [
        ("scene", json!({ "type": "string", "format": "binary" })),
        ("scene_sha256", json!({ "type": "string" })),
        ("image_type", json!({ "type": "string", "enum": ["color", "depth", "label"] })),
        ("width", json!({ "type": "integer", "minimum": 1 })),
        ("height", json!({ "type": "integer", "minimum": 1 })),
        ("near", json!({ "type": "number" })),
        ("far", json!({ "type": "number" })),
        ("focal_x", json!({ "type": "number" })),
        ("focal_y", json!({ "type": "number" })),
        ("center_x", json!({ "type": "number" })),
        ("center_y", json!({ "type": "number" })),
    ];
    let required: Vec<&str> = fields.iter().map(|(name, _)| *name).collect();
    let mut properties: serde_json::Map<String, Value> =
        fields.iter().map(|(name, schema)| ((*name).to_owned(), schema.clone())).collect();
    for name in ["fov_x", "fov_y", "min_depth", "max_depth"] {
        properties.insert(name.into(), json!({ "type": "number" }));
    }
    json!({ "type": "object", "required": required, "properties": properties })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each schema that the document refers to is there.
    #[test]
    fn references_lead_somewhere() {
        let described = api();
        let text = described.to_string();
        let names: Vec<&str> =
            text.split("#/components/schemas/").skip(1).filter_map(|rest| rest.split('"').next()).collect();
        assert!(names.len() > 20, "{names:?}");
        let schemas = &described["components"]["schemas"];
        assert!(names.iter().all(|name| schemas[name].is_object()), "{names:?}");
        assert!(
            described["paths"]["/api/v1/session"]["delete"]["security"].as_array().is_some_and(Vec::is_empty)
        );
    }
}
