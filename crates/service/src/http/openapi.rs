//! The description of the API (OpenAPI 3.1).

use crate::coordinator::ledger::JobState;
use axum::Json;
use raystream::picture::RenderSpec;
use raystream::schedule::Priority;
use serde_json::{Value, json};

/// A route: method, path, what it does, codes of success with their media type, and the schema of its body.
struct Route(&'static str, &'static str, &'static str, &'static [u16], &'static str, Option<&'static str>);

const JSON: &str = "application/json";
const ANY: &str = "application/octet-stream";
const TEXT: &str = "text/plain";
const PICTURES: &str = "image/png, image/x-exr, application/zip, application/octet-stream";
const FORM: &str = "multipart/form-data";

const ROUTES: &[Route] = &[
    Route("get", "/healthz", "Whether the process answers", &[200], TEXT, None),
    Route("get", "/readyz", "Whether the service can work", &[200], TEXT, None),
    Route("get", "/openapi.json", "This document", &[200], JSON, None),
    Route("get", "/metrics", "Measurements for Prometheus", &[200], TEXT, None),
    Route("post", "/api/v1/session", "Token in, cookie out", &[204], JSON, Some("Login")),
    Route("delete", "/api/v1/session", "Forget the cookie", &[204], JSON, None),
    Route("get", "/api/v1/scenes/{sha256}", "Whether a scene is here", &[200], JSON, None),
    Route(
        "put",
        "/api/v1/scenes/{sha256}",
        "Upload a GLB, or a zip of files",
        &[200, 201],
        JSON,
        Some("Bytes"),
    ),
    Route("get", "/api/v1/jobs", "Jobs, the latest first", &[200], JSON, None),
    Route("post", "/api/v1/jobs", "Submit a job", &[200, 202], JSON, Some("JobRequest")),
    Route("get", "/api/v1/jobs/{id}", "A job and its pictures", &[200], JSON, None),
    Route("post", "/api/v1/jobs/{id}/cancel", "Abandon a job", &[200], JSON, None),
    Route("post", "/api/v1/jobs/{id}/pause", "Let a job wait", &[200], JSON, None),
    Route("post", "/api/v1/jobs/{id}/resume", "Go on with a paused job", &[200], JSON, None),
    Route("post", "/api/v1/jobs/{id}/retry", "Go on with a failed or cancelled job", &[200], JSON, None),
    Route("post", "/api/v1/jobs/{id}/priority", "Change the priority", &[200], JSON, Some("Priority")),
    Route(
        "get",
        "/api/v1/jobs/{id}/events",
        "Events of a job as they happen",
        &[200],
        "text/event-stream",
        None,
    ),
    Route(
        "get",
        "/api/v1/jobs/{id}/timeline",
        "Who rendered which unit when, as a Chrome trace",
        &[200],
        JSON,
        None,
    ),
    Route("get", "/api/v1/workers", "Who renders, how fast, and what each has done", &[200], JSON, None),
    Route("post", "/api/v1/workers/{key}/trust", "Let a worker take units again", &[200], JSON, None),
    Route("get", "/api/v1/events", "Events of all jobs as they happen", &[200], "text/event-stream", None),
    Route("get", "/api/v1/live", "A live view on a WebSocket", &[101], JSON, None),
    Route(
        "get",
        "/api/v1/jobs/{id}/frames/{file}",
        "FRAME.png, .exr, .npz or .npy",
        &[200, 304],
        PICTURES,
        None,
    ),
    Route("get", "/api/v1/jobs/{id}/frames/{frame}/{file}", "LAYER.npy of a frame", &[200, 304], ANY, None),
    Route(
        "post",
        "/api/v1/query",
        "Rays in (.npy), hits out (.npz)",
        &[200],
        "application/zip",
        Some("Bytes"),
    ),
    Route(
        "post",
        "/render",
        "A picture of Drake's glTF scene",
        &[200],
        "image/png, image/tiff",
        Some("RenderForm"),
    ),
];

/// Routes that need no token.
const OPEN: [&str; 4] = ["/healthz", "/readyz", "/openapi.json", "/api/v1/session"];

/// Codes of refusals. A route may answer any of them.
const REFUSALS: [u16; 13] = [400, 401, 403, 404, 405, 408, 409, 413, 415, 422, 429, 503, 507];

/// Name, type and whether it is required.
type Parameter = (&'static str, &'static str, bool);

/// Parameters of addresses and queries, by route.
const QUERIES: &[(&str, &[Parameter])] = &[
    (
        "/api/v1/jobs",
        &[("state", "string", false), ("cursor", "integer", false), ("limit", "integer", false)],
    ),
    ("/api/v1/live", &[("scene", "string", false)]),
    ("/api/v1/jobs/{id}/frames/{file}", &[("view", "string", false), ("exposure", "string", false)]),
    (
        "/api/v1/query",
        &[("scene", "string", true), ("entry", "string", false), ("any_hit", "boolean", false)],
    ),
];

/// `GET /openapi.json`.
pub async fn document() -> Json<Value> {
    Json(described())
}

fn described() -> Value {
    let mut paths = serde_json::Map::new();
    for route in ROUTES {
        let path = paths.entry(route.1).or_insert_with(|| json!({}));
        path[route.0] = operation(route);
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

fn operation(&Route(method, path, summary, codes, media, body): &Route) -> Value {
    let mut parameters: Vec<Value> = path
        .split(['{', '}'])
        .skip(1)
        .step_by(2)
        .map(|name| json!({ "name": name, "in": "path", "required": true, "schema": { "type": "string" } }))
        .collect();
    let queries =
        QUERIES.iter().filter(|(of, _)| *of == path && (method == "get" || path.ends_with("query")));
    for &(name, kind, required) in queries.flat_map(|(_, parameters)| *parameters) {
        let schema = json!({ "type": kind });
        parameters.push(json!({ "name": name, "in": "query", "required": required, "schema": schema }));
    }
    let mut responses = serde_json::Map::new();
    for &code in codes {
        let content = match code {
            204 | 304 => json!({ "description": "nothing more" }),
            101 => json!({ "description": "a WebSocket" }),
            _ => {
                let schema = answer_schema(path);
                let content: serde_json::Map<String, Value> =
                    media.split(", ").map(|media| (media.to_owned(), schema.clone())).collect();
                json!({ "description": summary, "content": content })
            }
        };
        responses.insert(code.to_string(), content);
    }
    for code in REFUSALS {
        let schema = json!({ "$ref": "#/components/schemas/Problem" });
        let content = json!({ "application/problem+json": { "schema": schema } });
        responses.insert(code.to_string(), json!({ "description": "refused", "content": content }));
    }
    let mut operation = json!({ "summary": summary, "parameters": parameters, "responses": responses });
    if OPEN.contains(&path) {
        operation["security"] = json!([]);
    }
    match body {
        None => {}
        Some("Bytes") => {
            let schema = json!({ "type": "string", "format": "binary" });
            operation["requestBody"] = json!({ "required": true, "content": { ANY: { "schema": schema } } });
        }
        Some("RenderForm") => {
            let schema = json!({ "$ref": "#/components/schemas/RenderForm" });
            operation["requestBody"] = json!({ "required": true, "content": { FORM: { "schema": schema } } });
        }
        Some(schema) => {
            let schema = json!({ "$ref": format!("#/components/schemas/{schema}") });
            operation["requestBody"] = json!({ "required": true, "content": { JSON: { "schema": schema } } });
        }
    }
    operation
}

/// What an answer's JSON is, where it is described.
fn answer_schema(path: &str) -> Value {
    let name = match path {
        "/api/v1/scenes/{sha256}" => "Scene",
        "/api/v1/jobs/{id}" => "Job",
        "/api/v1/jobs/{id}/priority" => "Steered",
        path if ["cancel", "pause", "resume", "retry"].iter().any(|verb| path.ends_with(verb)) => "Steered",
        _ => return json!({}),
    };
    json!({ "schema": { "$ref": format!("#/components/schemas/{name}") } })
}

/// What answers hold.
fn answers() -> [(&'static str, Value); 3] {
    let text = || json!({ "type": "string" });
    let count = || json!({ "type": "integer", "minimum": 0 });
    let states = json!({ "enum": JobState::ALL.map(JobState::name) });
    let job = json!({ "type": "object", "required": ["id", "state", "progress", "pictures"], "properties": {
        "id": text(), "state": states.clone(), "priority": text(), "scene": text(),
        "spec": { "$ref": "#/components/schemas/RenderSpec" },
        "size": { "type": "array", "items": count() }, "spp": count(), "kind": text(),
        "created_ms": { "type": "integer" }, "ended_ms": { "type": ["integer", "null"] },
        "error": { "type": ["string", "null"] }, "progress": { "type": "number", "minimum": 0, "maximum": 1 },
        "frames": count(), "frames_done": count(), "units": count(), "units_done": count(),
        "pictures": { "type": "array", "items": { "type": "object", "required": ["frame", "name", "hash"] } } } });
    let scene = json!({ "type": "object", "required": ["sha256", "bytes"],
        "properties": { "sha256": text(), "bytes": count() } });
    let steered = json!({ "type": "object", "required": ["id", "state"],
        "properties": { "id": text(), "state": states, "kept": { "type": "object" }, "priority": text() } });
    [("Job", job), ("Scene", scene), ("Steered", steered)]
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
        "Login": object(&["token"], json!({ "token": text() })),
        "Priority": object(&["priority"], json!({ "priority": text() })),
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

    /// The document names each route of the router, and no other.
    #[test]
    fn all_routes_are_described() {
        let code = [include_str!("api/mod.rs"), include_str!("drake/mod.rs"), include_str!("live/mod.rs")];
        let routes: Vec<&str> = code
            .iter()
            .flat_map(|code| code.split(".route(\"").skip(1))
            .filter_map(|rest| rest.split('"').next())
            .collect();
        let described = described();
        let paths = described["paths"].as_object().expect("paths");
        assert!(routes.iter().all(|route| paths.contains_key(*route)), "{routes:?}");
        assert_eq!(routes.len(), paths.len());
    }
}
