//! What a client sends to get a job.

use super::ledger::{Job, priority};
use crate::backend::StopRule;
use crate::contract::{Problem, hex};
use raystream::picture::{Denoiser, RenderSpec, SpecGroup};
use raystream::render::PICTURE_VERSION;
use raystream::schedule::Priority;
use serde::de::{DeserializeOwned, Error};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};

/// The most characters of a title, labels of a job, and characters of a label.
const MOST_TITLE: usize = 200;
const MOST_LABELS: usize = 20;
const MOST_LABEL: usize = 64;

/// A request for a job: a render spec whose scene is the SHA-256 of an upload, with what the service alone wants to
/// know.
#[derive(Clone, Debug)]
pub struct JobRequest {
    /// SHA-256 of the scene, which has been uploaded.
    pub scene: String,
    /// The scene file in a pack, if there are several.
    pub entry: Option<String>,
    /// What people call the job.
    pub title: Option<String>,
    /// Words by which it is found.
    pub labels: Vec<String>,
    /// The picture, without the scene.
    pub spec: RenderSpec,
    /// `interactive`, `normal` or `background`.
    pub priority: Option<String>,
    /// The address that is called when the job ends.
    pub webhook: Option<Webhook>,
}

impl Serialize for JobRequest {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Self { scene, entry, title, labels, spec, priority, webhook } = self;
        let own = [
            ("scene", Some(json!(scene))),
            ("entry", entry.as_ref().map(|entry| json!(entry))),
            ("title", title.as_ref().map(|title| json!(title))),
            ("labels", (!labels.is_empty()).then(|| json!(labels))),
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
        let (title, labels) = (of_key(&mut all, "title")?, of_key(&mut all, "labels")?.unwrap_or_default());
        let (priority, webhook) = (of_key(&mut all, "priority")?, of_key(&mut all, "webhook")?);
        if let Some(options) = of_key::<Map<String, Value>, _>(&mut all, "options")? {
            if let Some(key) = options.keys().find(|key| all.contains_key(*key)) {
                return Err(D::Error::custom(format!("{key}: given twice, also in `options`")));
            }
            all.extend(options);
        }
        let spec = RenderSpec::of(&all).map_err(D::Error::custom)?;
        let scene = scene.ok_or_else(|| D::Error::missing_field("scene"))?;
        Ok(Self { scene, entry, title, labels, spec, priority, webhook })
    }
}

/// Takes a value out of a map. `null` is none.
fn of_key<T: DeserializeOwned, E: Error>(all: &mut Map<String, Value>, key: &str) -> Result<Option<T>, E> {
    let Some(value) = all.remove(key) else { return Ok(None) };
    serde_json::from_value(value).map_err(|error| E::custom(format!("{key}: {error}")))
}

/// The address that is called when a job ends, and the key that signs the call.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Webhook {
    /// The address, `http://` or `https://`.
    pub url: String,
    /// The key of the signature.
    pub secret: String,
}

impl JobRequest {
    /// Returns the priority of the job, which is normal unless the request names one.
    ///
    /// # Errors
    /// 422 if the name is none of a priority.
    pub fn priority(&self) -> Result<Priority, Problem> {
        self.priority.as_deref().map_or(Ok(Priority::Normal), parse_priority)
    }

    /// Checks title and labels, which stand in lists.
    ///
    /// # Errors
    /// 422 if one of them is empty, too long or has control characters, or there are too many.
    pub fn check_words(&self) -> Result<(), Problem> {
        let is_word = |text: &str, most: usize| {
            (1..=most).contains(&text.chars().count()) && !text.chars().any(char::is_control)
        };
        if self.title.as_deref().is_some_and(|title| !is_word(title, MOST_TITLE)) {
            let detail = format!("title: write 1 to {MOST_TITLE} characters on one line");
            return Err(Problem::unprocessable(detail));
        }
        if self.labels.len() > MOST_LABELS || !self.labels.iter().all(|label| is_word(label, MOST_LABEL)) {
            let detail = format!("labels: write at most {MOST_LABELS} of 1 to {MOST_LABEL} characters each");
            return Err(Problem::unprocessable(detail));
        }
        Ok(())
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

    /// True if the pictures of a demand are a function of the request: neither time nor OIDN decides on them.
    pub fn is_function(&self, kind: StopRule) -> bool {
        kind != StopRule::Seconds && self.spec.layers.denoise != Denoiser::Oidn
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

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<JobRequest, String> {
        serde_json::from_str(text).map_err(|error| error.to_string())
    }

    /// A row of the ledger of commit 22fbd17.
    const STORED: &str = r#"{"scene":"ab","entry":"a.obj","options":{"aov":"z,normal","eye":"0,1,5","noise":0.05,
        "size":"64x36","surface":["wall=w.wgsl"],"transparent":true},"priority":"background",
        "webhook":{"url":"https://a/","secret":"s"}}"#;

    #[test]
    fn requests_of_earlier_builds_are_those_with_the_keys_beside_the_scene() {
        let stored = read(STORED).expect("a request");
        let flat = r#"{"scene":"ab","entry":"a.obj","aov":["z","normal"],"eye":[0,1,5],"noise":0.05,"size":[64,36],
            "surface":"wall=w.wgsl","transparent":true,"priority":null}"#;
        let flat = read(flat).expect("a request");
        assert_eq!((stored.spec, stored.scene), (flat.spec.clone(), flat.scene.clone()));
        assert_eq!(read(STORED).expect("a request").hash(), flat.hash(), "the answer is known");
        assert_eq!(stored.webhook.map(|hook| hook.url), Some("https://a/".into()));
        let written = serde_json::to_string(&flat).expect("JSON");
        assert_eq!(read(&written).expect("a request").spec, flat.spec);
    }

    #[test]
    fn wrong_requests_name_their_key() {
        for (text, says) in [
            (r#"{"size":"8x8"}"#, "missing field `scene`"),
            (r#"{"scene":"ab","options":{"threads":2}}"#, "\"threads\" is no option of a picture"),
            (r#"{"scene":"ab","size":"8x8","options":{"size":"4x4"}}"#, "size: given twice"),
            (r#"{"scene":"ab","spp":0}"#, "spp: 0 is not in"),
            (r#"{"scene":7}"#, "scene: invalid type"),
            (r#"{"scene":"ab","webhook":{"url":"a"}}"#, "webhook: missing field `secret`"),
        ] {
            let error = read(text).expect_err(text);
            assert!(error.contains(says), "{text}: {error}");
        }
    }
}
