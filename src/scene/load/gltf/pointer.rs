//! Properties that an animation names by a pointer (KHR_animation_pointer). The `gltf` crate refuses such channels, so
//! they are taken out of the JSON before it reads them.

use super::super::LoadProblem;
use super::super::session::Session;
use super::animation::Keys;
use super::{Context, fill_scenes, pose};
use crate::scene::Track;
use ::gltf::camera::Projection;
use ::gltf::json::Value;
use ::gltf::{Animation, Camera, Document};
use serde_json::json;

/// The path of a channel's target that stands for a pointer.
const POINTER: &str = "pointer";

/// The end of pointers to parts of KHR_texture_transform.
const TEXTURE_TRANSFORM: &str = "/extensions/KHR_texture_transform/";

/// The kind of a property.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Number,
    /// A list of so many numbers.
    List(usize),
    Boolean,
    /// The weights of all morph targets.
    Weights,
    /// The weight of one morph target.
    Weight,
}

use Kind::{Boolean, List, Number, Weight, Weights};

/// The properties that may be animated; `#` stands for a place in a list. Parts of KHR_texture_transform are found by
/// their ends.
const PROPERTIES: [(&str, Kind); 53] = [
    ("/cameras/#/orthographic/xmag", Number),
    ("/cameras/#/orthographic/ymag", Number),
    ("/cameras/#/orthographic/zfar", Number),
    ("/cameras/#/orthographic/znear", Number),
    ("/cameras/#/perspective/aspectRatio", Number),
    ("/cameras/#/perspective/yfov", Number),
    ("/cameras/#/perspective/zfar", Number),
    ("/cameras/#/perspective/znear", Number),
    ("/extensions/KHR_lights_punctual/lights/#/color", List(3)),
    ("/extensions/KHR_lights_punctual/lights/#/intensity", Number),
    ("/extensions/KHR_lights_punctual/lights/#/range", Number),
    ("/extensions/KHR_lights_punctual/lights/#/spot/innerConeAngle", Number),
    ("/extensions/KHR_lights_punctual/lights/#/spot/outerConeAngle", Number),
    ("/materials/#/alphaCutoff", Number),
    ("/materials/#/emissiveFactor", List(3)),
    ("/materials/#/extensions/KHR_materials_anisotropy/anisotropyRotation", Number),
    ("/materials/#/extensions/KHR_materials_anisotropy/anisotropyStrength", Number),
    ("/materials/#/extensions/KHR_materials_clearcoat/clearcoatFactor", Number),
    ("/materials/#/extensions/KHR_materials_clearcoat/clearcoatNormalTexture/scale", Number),
    ("/materials/#/extensions/KHR_materials_clearcoat/clearcoatRoughnessFactor", Number),
    ("/materials/#/extensions/KHR_materials_diffuse_transmission/diffuseTransmissionColorFactor", List(3)),
    ("/materials/#/extensions/KHR_materials_diffuse_transmission/diffuseTransmissionFactor", Number),
    ("/materials/#/extensions/KHR_materials_dispersion/dispersion", Number),
    ("/materials/#/extensions/KHR_materials_emissive_strength/emissiveStrength", Number),
    ("/materials/#/extensions/KHR_materials_ior/ior", Number),
    ("/materials/#/extensions/KHR_materials_iridescence/iridescenceFactor", Number),
    ("/materials/#/extensions/KHR_materials_iridescence/iridescenceIor", Number),
    ("/materials/#/extensions/KHR_materials_iridescence/iridescenceThicknessMaximum", Number),
    ("/materials/#/extensions/KHR_materials_iridescence/iridescenceThicknessMinimum", Number),
    ("/materials/#/extensions/KHR_materials_pbrSpecularGlossiness/diffuseFactor", List(4)),
    ("/materials/#/extensions/KHR_materials_pbrSpecularGlossiness/glossinessFactor", Number),
    ("/materials/#/extensions/KHR_materials_pbrSpecularGlossiness/specularFactor", List(3)),
    ("/materials/#/extensions/KHR_materials_sheen/sheenColorFactor", List(3)),
    ("/materials/#/extensions/KHR_materials_sheen/sheenRoughnessFactor", Number),
    ("/materials/#/extensions/KHR_materials_specular/specularColorFactor", List(3)),
    ("/materials/#/extensions/KHR_materials_specular/specularFactor", Number),
    ("/materials/#/extensions/KHR_materials_transmission/transmissionFactor", Number),
    ("/materials/#/extensions/KHR_materials_volume/attenuationColor", List(3)),
    ("/materials/#/extensions/KHR_materials_volume/attenuationDistance", Number),
    ("/materials/#/extensions/KHR_materials_volume/thicknessFactor", Number),
    ("/materials/#/normalTexture/scale", Number),
    ("/materials/#/occlusionTexture/strength", Number),
    ("/materials/#/pbrMetallicRoughness/baseColorFactor", List(4)),
    ("/materials/#/pbrMetallicRoughness/metallicFactor", Number),
    ("/materials/#/pbrMetallicRoughness/roughnessFactor", Number),
    ("/meshes/#/weights", Weights),
    ("/meshes/#/weights/#", Weight),
    ("/nodes/#/extensions/KHR_node_visibility/visible", Boolean),
    ("/nodes/#/rotation", List(4)),
    ("/nodes/#/scale", List(3)),
    ("/nodes/#/translation", List(3)),
    ("/nodes/#/weights", Weights),
    ("/nodes/#/weights/#", Weight),
];

/// Bytes that a byte of JSON text takes as values, at most: `[0,0,0` and so on.
const BYTES_OF_VALUES: u64 = size_of::<Value>() as u64 / 2;

/// What has weights of morph targets, by its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Owner {
    Node(usize),
    Mesh(usize),
}

/// A channel that names what it animates by a pointer.
#[derive(Debug)]
pub(super) struct PointedChannel {
    animation: usize,
    number: usize,
    sampler: usize,
    pointer: String,
    kind: Kind,
}

/// The channels with pointers of a document, and its JSON without them.
#[derive(Debug, Default)]
pub(super) struct Pointers {
    /// `None` if there was no such channel.
    json: Option<Value>,
    channels: Vec<PointedChannel>,
    /// The numbers that the channels that are left of each animation have in the file.
    left: Vec<Vec<usize>>,
}

/// What a pointer leads to.
enum Found {
    /// What a channel without a pointer can say: the node and the path.
    Plain(usize, &'static str),
    Property(Kind),
    /// Nothing that can be animated; the sentence says why.
    Nothing(String),
}

impl Pointers {
    /// Takes the channels with pointers out of a document. Those of nodes become plain channels.
    ///
    /// # Errors
    /// When a channel has no pointer or no sampler, or a pointer names an element of a list that is not there.
    pub(super) fn take(session: &mut Session, text: &[u8]) -> Result<Self, LoadProblem> {
        let has_some = std::str::from_utf8(text).is_ok_and(|text| text.contains("\"pointer\""));
        if !has_some {
            return Ok(Self::default());
        }
        let bytes = 2 * BYTES_OF_VALUES * text.len() as u64;
        session.check("the animated values", bytes).map_err(|source| session.over(source))?;
        // Whoever reads the text again tells what is wrong with it.
        let Ok(mut root) = serde_json::from_slice::<Value>(text) else { return Ok(Self::default()) };
        let mut own = Self::default();
        let list = root.get_mut("animations").and_then(Value::as_array_mut);
        let mut animations = list.map(std::mem::take).unwrap_or_default();
        for (animation, source) in animations.iter_mut().enumerate() {
            own.take_channels(session, &root, animation, source)?;
        }
        if let Some(list) = root.get_mut("animations") {
            *list = animations.into();
        }
        fill_scenes(&mut root);
        own.json = Some(root);
        Ok(own)
    }

    fn take_channels(
        &mut self,
        session: &mut Session,
        root: &Value,
        animation: usize,
        source: &mut Value,
    ) -> Result<(), LoadProblem> {
        let samplers = source.get("samplers").and_then(Value::as_array).map_or(0, Vec::len);
        let list = source.get_mut("channels").and_then(Value::as_array_mut);
        let Some(list) = list else {
            self.left.push(Vec::new());
            return Ok(());
        };
        let mut left = Vec::new();
        for (number, mut channel) in std::mem::take(list).into_iter().enumerate() {
            if channel["target"]["path"] == POINTER {
                let wrong = |problem: String| LoadProblem::Place {
                    path: session.path.clone(),
                    place: format!("animations[{animation}].channels[{number}]"),
                    problem,
                };
                let pointer = &channel["target"]["extensions"]["KHR_animation_pointer"]["pointer"];
                let pointer = pointer.as_str().map(str::to_owned).ok_or_else(|| {
                    wrong("has the path \"pointer\", but KHR_animation_pointer gives it no pointer".into())
                })?;
                match find(root, &pointer)
                    .map_err(|problem| wrong(format!("its pointer {pointer:?} {problem}")))?
                {
                    Found::Plain(node, path) => channel["target"] = json!({ "node": node, "path": path }),
                    Found::Property(kind) => {
                        let sampler = channel["sampler"].as_u64().and_then(|number| number.try_into().ok());
                        let sampler = sampler.filter(|&number| number < samplers).ok_or_else(|| {
                            wrong(format!(
                                "names the sampler {}, but there are {samplers}",
                                channel["sampler"]
                            ))
                        })?;
                        self.channels.push(PointedChannel { animation, number, sampler, pointer, kind });
                        continue;
                    }
                    Found::Nothing(why) => {
                        session
                            .warnings
                            .add(format!("The animation's pointer {pointer:?} is ignored: {why}."));
                        continue;
                    }
                }
            }
            left.push(number);
            list.push(channel);
        }
        self.left.push(left);
        Ok(())
    }

    /// The JSON without the channels. `None` if there were none.
    pub(super) fn json(&self) -> Option<&Value> {
        self.json.as_ref()
    }

    /// The number that a channel which is left has in the file.
    pub(super) fn number(&self, animation: &Animation, channel: usize) -> usize {
        self.left.get(animation.index()).map_or(channel, |left| left[channel])
    }

    /// The channels of an animation.
    pub(super) fn of(&self, animation: &Animation) -> impl Iterator<Item = &PointedChannel> {
        let animation = animation.index();
        self.channels.iter().filter(move |channel| channel.animation == animation)
    }

    /// The channel that animates a camera's angle of view or its height.
    pub(super) fn lens(&self, animation: &Animation, camera: &Camera) -> Option<&PointedChannel> {
        let property = match camera.projection() {
            Projection::Perspective(_) => "perspective/yfov",
            Projection::Orthographic(_) => "orthographic/ymag",
        };
        let pointer = format!("/cameras/{}/{property}", camera.index());
        self.of(animation).find(|channel| channel.pointer == pointer)
    }

    /// The document as it is at the time that the options choose. `None` if that changes none of its values.
    ///
    /// # Errors
    /// When there is no such animation, or keys are missing, out of order or of the wrong type.
    pub(super) fn shown(&self, context: &mut Context) -> Result<Option<Document>, LoadProblem> {
        let Some(json) = &self.json else { return Ok(None) };
        let (Some(time), Some(animation)) = (pose::time(context), pose::chosen(context)?) else {
            return Ok(None);
        };
        let mut json = json.clone();
        for channel in self.of(&animation) {
            if let Some(value) = channel.value(context, &animation, time)? {
                set(&mut json, &channel.pointer, value);
            }
        }
        let root = super::root_of(&json).map_err(|error| LoadProblem::File {
            path: context.session.path.clone(),
            problem: format!("not valid glTF JSON: {error}"),
        })?;
        Ok(Some(Document::from_json_without_validation(root)))
    }
}

impl PointedChannel {
    /// True if it changes more than cameras.
    pub(super) fn shows(&self) -> bool {
        !self.pointer.starts_with("/cameras/")
    }

    /// What has the weights that it animates, and which of them if it is not all. `None` if it animates no weights.
    pub(super) fn weights(&self) -> Option<(Owner, Option<usize>)> {
        let mut tokens = self.pointer.split('/').skip(1);
        let (list, number) = (tokens.next()?, tokens.next()?.parse().ok()?);
        let owner = if list == "nodes" { Owner::Node(number) } else { Owner::Mesh(number) };
        match self.kind {
            Weights => Some((owner, None)),
            Weight => Some((owner, Some(tokens.nth(1)?.parse().ok()?))),
            Number | List(_) | Boolean => None,
        }
    }

    pub(super) fn place(&self) -> String {
        format!("animations[{}].channels[{}] ({})", self.animation, self.number, self.pointer)
    }

    /// The keys of values of so many numbers.
    ///
    /// # Errors
    /// When they cannot be read.
    pub(super) fn keys<'a>(
        &self,
        context: &'a Context,
        animation: &Animation,
        width: usize,
    ) -> Result<Keys<'a>, LoadProblem> {
        let sampler = animation.samplers().nth(self.sampler).expect("it has been looked for");
        Keys::pointed(context, self.place(), &sampler, width)
    }

    /// The track of a single number.
    ///
    /// # Errors
    /// When keys are missing, out of order or of the wrong type.
    pub(super) fn number(&self, context: &Context, animation: &Animation) -> Result<Track<f64>, LoadProblem> {
        self.keys(context, animation, 1)?.track((0, 1), |numbers| numbers[0])
    }

    /// The value at a time. `None` if it is no value of the JSON but the weights of morph targets.
    fn value(
        &self,
        context: &Context,
        animation: &Animation,
        time: f64,
    ) -> Result<Option<Value>, LoadProblem> {
        let width = match self.kind {
            Number | Boolean => 1,
            List(width) => width,
            Weights | Weight => return Ok(None),
        };
        let keys = self.keys(context, animation, width)?;
        if self.kind == Boolean && !keys.are_steps() {
            return Err(context.error(self.place(), "is true or false, so its interpolation must be STEP"));
        }
        let component = |component: usize| {
            let value = keys.track((0, 1), |numbers| numbers[component])?.at(time);
            let is_finite = (value as f32).is_finite();
            is_finite.then_some(value).ok_or_else(|| {
                context.error(self.place(), format!("has the value {value} at {time} s, which is too large"))
            })
        };
        let values = (0..width).map(component).collect::<Result<Vec<_>, _>>()?;
        Ok(Some(match self.kind {
            List(_) => values.into(),
            Boolean => (values[0] != 0.0).into(),
            Number | Weights | Weight => values[0].into(),
        }))
    }
}

/// True for the place of an element in a list.
fn is_place(token: &str) -> bool {
    let has_digits = !token.is_empty() && token.bytes().all(|byte| byte.is_ascii_digit());
    has_digits && (token == "0" || !token.starts_with('0'))
}

/// The kind of the property of a pointer. `None` if it is none of the properties that may be animated.
fn kind(pointer: &str) -> Option<Kind> {
    let tokens = pointer.split('/').map(|token| if is_place(token) { "#" } else { token });
    let form = tokens.collect::<Vec<_>>().join("/");
    if let Some((texture, part)) = form.rsplit_once(TEXTURE_TRANSFORM)
        && texture.starts_with("/materials/#/")
        && texture.ends_with("Texture")
    {
        return match part {
            "offset" | "scale" => Some(List(2)),
            "rotation" => Some(Number),
            _ => None,
        };
    }
    PROPERTIES.iter().find(|(known, _)| *known == form).map(|&(_, kind)| kind)
}

/// What a pointer leads to in a document.
///
/// # Errors
/// When it names an element of a list that is not there.
fn find(root: &Value, pointer: &str) -> Result<Found, String> {
    let Some(kind) = kind(pointer) else {
        return Ok(Found::Nothing("it names no property that can be animated".into()));
    };
    static ABSENT: Value = Value::Null;
    let tokens: Vec<&str> = pointer.split('/').skip(1).collect();
    let (mut at, mut list) = (root, "");
    // The last token names the property; weights need not be there.
    let parents = if matches!(kind, Weights | Weight) { 2 } else { tokens.len() - 1 };
    for (depth, &token) in tokens[..parents].iter().enumerate() {
        if is_place(token) {
            let count = at.as_array().map_or(0, Vec::len);
            let found = token.parse::<usize>().ok().and_then(|number| at.get(number));
            at = found.ok_or_else(|| format!("names {list}[{token}], but there are {count}"))?;
            continue;
        }
        at = match at.get(token) {
            Some(found) => found,
            // It has a default, as lists have, which are empty.
            None if ["pbrMetallicRoughness", "cameras", "materials", "meshes", "nodes"].contains(&token) => {
                &ABSENT
            }
            None => {
                let absent = tokens[..=depth].join("/");
                return Ok(Found::Nothing(format!("there is no \"/{absent}\"")));
            }
        };
        list = token;
    }
    if !at.is_object() && !at.is_null() {
        return Ok(Found::Nothing(format!("{list} is no object")));
    }
    if let ["nodes", node, path] = tokens[..]
        && let Some(path) = ["translation", "rotation", "scale", "weights"].into_iter().find(|p| *p == path)
    {
        let node = node.parse().map_err(|error| format!("names nodes[{node}]: {error}"))?;
        return Ok(Found::Plain(node, path));
    }
    Ok(Found::Property(kind))
}

/// Sets a value that a pointer names; its parents have been found.
fn set(root: &mut Value, pointer: &str, value: Value) {
    let mut at = root;
    for token in pointer.split('/').skip(1) {
        at = match at {
            Value::Array(list) => &mut list[token.parse::<usize>().expect("a place that has been found")],
            object => &mut object[token],
        };
    }
    *at = value;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn properties_are_in_order_and_known_by_their_pointers() {
        assert!(PROPERTIES.windows(2).all(|pair| pair[0].0 < pair[1].0));
        for (form, of) in PROPERTIES {
            assert_eq!(kind(&form.replace('#', "10")), Some(of), "{form}");
        }
        let texture = "/materials/2/pbrMetallicRoughness/baseColorTexture/extensions/KHR_texture_transform";
        assert_eq!(kind(&format!("{texture}/offset")), Some(List(2)));
        assert_eq!(kind(&format!("{texture}/rotation")), Some(Number));
        for none in ["", "/", "nodes/0/scale", "/nodes/00/scale", "/nodes/-1/scale", "/nodes/0/scale/"] {
            assert_eq!(kind(none), None, "{none}");
        }
        assert_eq!(kind(&format!("{texture}/texCoord")), None);
    }

    #[test]
    fn values_are_set_where_the_pointer_leads() {
        let mut root = json!({ "materials": [{}, {}] });
        set(&mut root, "/materials/1/pbrMetallicRoughness/metallicFactor", json!(0.5));
        assert_eq!(root, json!({ "materials": [{}, { "pbrMetallicRoughness": { "metallicFactor": 0.5 } }] }));
    }
}
