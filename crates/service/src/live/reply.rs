//! What a live view says beside frames, as JSON.

use super::{Picked, Statistics, Timeline};
use crate::contract::{Pose, ShaderTexts};
use raystream::picture::RenderSpec;
use raystream::scene::AnimationSpan;
use serde::Serialize;

/// A message to the client.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "type", rename_all = "snake_case")]
#[non_exhaustive]
pub enum Reply {
    /// The first message of a view: what it shows, and what can be chosen.
    Hello {
        /// The scene's name.
        scene: String,
        /// The scene's camera.
        pose: Pose,
        /// Least corner of the scene's bounding box.
        least: [f32; 3],
        /// Greatest corner of the scene's bounding box.
        greatest: [f32; 3],
        /// The animations that can be played.
        animations: Vec<AnimationSpan>,
        /// True if a surface asks for the time, so that there is something to play even without an animation.
        reads_time: bool,
        /// Number of triangles.
        triangles: usize,
        /// Names of the materials.
        materials: Vec<String>,
        /// Names of the view transforms.
        views: Vec<&'static str>,
        /// Names of the layers.
        layers: Vec<&'static str>,
        /// Names of the scheduler's policies.
        policies: Vec<&'static str>,
        /// Units that can trace.
        units: Vec<&'static str>,
        /// Name of the GPU adapter in use.
        adapter: Option<String>,
    },
    /// How fast the view is.
    Statistics(Statistics),
    /// What the threads did during the last frame.
    Timeline(Timeline),
    /// What is seen at a pixel.
    Picked {
        /// The request's.
        id: u32,
        /// `None` if nothing is hit there.
        hit: Option<Picked>,
        /// Radiance of the pixel, linear Rec. 709; `None` before the first frame.
        radiance: Option<[f32; 3]>,
    },
    /// Whether a shader could be attached.
    Shader {
        /// Index of the material.
        material: u32,
        /// Why not, with file, line and column.
        error: Option<String>,
        /// True if a surface asks for the time now.
        reads_time: bool,
    },
    /// The picture that the view shows when it rests, as data: `raystream render --options` makes the same one.
    Spec {
        /// The picture. Its scene is the id of an upload, or the name of the file that the view was opened with.
        spec: Box<RenderSpec>,
        /// The files that it names for surfaces, with their texts.
        shaders: ShaderTexts,
    },
    /// A request was refused or failed; the view shows what it did before.
    Refused {
        /// Why, and what to do.
        reason: String,
    },
}
