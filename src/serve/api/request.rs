//! What a client sends to get a job.

use crate::render::PICTURE_VERSION;
use crate::schedule::Priority;
use crate::serve::auth::hex;
use crate::serve::ledger::{Job, priority};
use crate::serve::{Kind, Problem};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};

/// A request for a job.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JobRequest {
    /// SHA-256 of the scene, which has been uploaded.
    pub scene: String,
    /// The scene file in a pack, if there are several.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub entry: Option<String>,
    /// Options of `raystream render` by their long names.
    #[serde(default)]
    pub options: Map<String, Value>,
    /// `interactive`, `normal` or `background`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub priority: Option<String>,
    /// Who is called when the job ends.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub webhook: Option<Webhook>,
}

/// Who is called when a job ends.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Webhook {
    /// The address, `http://` or `https://`.
    pub url: String,
    /// The key of the signature.
    pub secret: String,
}

impl JobRequest {
    /// How urgent the job is.
    ///
    /// # Errors
    /// 422 if the name is none of a priority.
    pub fn priority(&self) -> Result<Priority, Problem> {
        self.priority.as_deref().map_or(Ok(Priority::Normal), parse_priority)
    }

    /// The SHA-256 of all that the pictures depend on.
    pub fn hash(&self) -> String {
        let Self { scene, entry, options, .. } = self;
        // Maps of serde_json are in the order of their keys.
        let all = json!([PICTURE_VERSION, scene, entry, options]);
        hex(&Sha256::digest(all.to_string().as_bytes()))
    }

    /// The request of a job.
    pub fn of(job: &Job) -> Option<Self> {
        serde_json::from_str(&job.request).ok()
    }

    /// Whether the pictures of a demand are a function of the request.
    pub fn is_function(kind: Kind) -> bool {
        kind != Kind::Seconds
    }
}

/// The priority of a name.
///
/// # Errors
/// 422 if there is none.
pub fn parse_priority(name: &str) -> Result<Priority, Problem> {
    priority(name).ok_or_else(|| {
        let names = Priority::ALL.map(Priority::name).join(", ");
        Problem::unprocessable(format!("{name:?} is no priority; choose one of {names}"))
    })
}
