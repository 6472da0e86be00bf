//! What a client sends to get a job.

use crate::picture::{RenderSpec, SpecGroup};
use crate::render::PICTURE_VERSION;
use crate::schedule::Priority;
use crate::serve::auth::hex;
use crate::serve::ledger::{Job, priority};
use crate::serve::{Kind, Problem};
use serde::de::{DeserializeOwned, Error};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};

/// A request for a job: a render spec whose scene is the SHA-256 of an upload, with what the service alone wants to
/// know.
#[derive(Clone, Debug)]
pub struct JobRequest {
    /// SHA-256 of the scene, which has been uploaded.
    pub scene: String,
    /// The scene file in a pack, if there are several.
    pub entry: Option<String>,
    /// The picture, without the scene.
    pub spec: RenderSpec,
    /// `interactive`, `normal` or `background`.
    pub priority: Option<String>,
    /// Who is called when the job ends.
    pub webhook: Option<Webhook>,
}

impl Serialize for JobRequest {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Self { scene, entry, spec, priority, webhook } = self;
        let own = [
            ("scene", Some(json!(scene))),
            ("entry", entry.as_ref().map(|entry| json!(entry))),
            ("priority", priority.as_ref().map(|priority| json!(priority))),
            ("webhook", webhook.as_ref().map(|webhook| json!(webhook))),
        ];
        let own = own.into_iter().filter_map(|(name, value)| Some((name, value?)));
        serializer.collect_map(own.chain(spec.entries(false)))
    }
}

impl<'de> Deserialize<'de> for JobRequest {
    /// Reads a request. Those of earlier builds have the options of the picture in an object of their own, `options`.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut all = Map::deserialize(deserializer)?;
        let scene: Option<String> = of_key(&mut all, "scene")?;
        let entry = of_key(&mut all, "entry")?;
        let (priority, webhook) = (of_key(&mut all, "priority")?, of_key(&mut all, "webhook")?);
        if let Some(options) = of_key::<Map<String, Value>, _>(&mut all, "options")? {
            if let Some(key) = options.keys().find(|key| all.contains_key(*key)) {
                return Err(D::Error::custom(format!("{key}: given twice, also in `options`")));
            }
            all.extend(options);
        }
        let spec = RenderSpec::of(&all).map_err(D::Error::custom)?;
        let scene = scene.ok_or_else(|| D::Error::missing_field("scene"))?;
        Ok(Self { scene, entry, spec, priority, webhook })
    }
}

/// Takes a value out of a map. `null` is none.
fn of_key<T: DeserializeOwned, E: Error>(all: &mut Map<String, Value>, key: &str) -> Result<Option<T>, E> {
    let Some(value) = all.remove(key) else { return Ok(None) };
    serde_json::from_value(value).map_err(|error| E::custom(format!("{key}: {error}")))
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
        let Self { scene, entry, spec, .. } = self;
        // Maps of serde_json are in the order of their keys.
        let all = json!([PICTURE_VERSION, scene, entry, spec.canonical()]);
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
