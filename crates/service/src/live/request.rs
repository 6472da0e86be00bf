//! What clients ask of a live view, as JSON.

use crate::contract::Pose;
use raystream::scene::MaterialEdit;
use serde::Deserialize;

/// A request. Those that change the picture carry a generation, which rises with each; frames carry the generation of
/// the last change that they show.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
#[non_exhaustive]
pub enum Request {
    /// Moves the camera.
    Camera {
        /// See [`Request`].
        generation: u32,
        /// The new pose.
        pose: Pose,
    },
    /// Sets the size of the full picture.
    Size {
        /// See [`Request`].
        generation: u32,
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// Sets samples a pixel and bounces of the full picture.
    Quality {
        /// See [`Request`].
        generation: u32,
        /// Samples a pixel of the full picture.
        spp: u32,
        /// Maximum number of bounces.
        max_bounces: u32,
    },
    /// Changes how radiance is shown. Nothing is rendered again.
    Look {
        /// Stops; `None` is automatic.
        exposure: Option<f32>,
        /// Name of the view transform ([`raystream::film::View`]).
        view: String,
    },
    /// Shows a layer in place of radiance.
    Layer {
        /// See [`Request`].
        generation: u32,
        /// Name of the layer ([`raystream::render::Aov`]); `None` is radiance.
        layer: Option<String>,
    },
    /// Chooses the scheduler's policy and the units that trace.
    Scheduling {
        /// See [`Request`].
        generation: u32,
        /// Name of the policy ([`raystream::schedule::Policy`]); `None` is that of the units.
        policy: Option<String>,
        /// `cpu`, `gpu` or `hybrid`; `None` is that of the scene.
        unit: Option<String>,
    },
    /// Edits a material, and all others of its name.
    Material {
        /// See [`Request`].
        generation: u32,
        /// Index of the material.
        material: u32,
        /// What changes.
        edit: MaterialEdit,
    },
    /// Gives a material, and all others of its name, a surface in WGSL.
    Shader {
        /// See [`Request`].
        generation: u32,
        /// Index of the material.
        material: u32,
        /// The shader's text; `None` gives the material the surface that it has without a shader.
        source: Option<String>,
    },
    /// Shows the scene at a time.
    Time {
        /// See [`Request`].
        generation: u32,
        /// Seconds; `None` is the scene at rest.
        seconds: Option<f64>,
        /// Name of the animation; `None` is the file's first one.
        #[serde(default)]
        animation: Option<String>,
    },
    /// Says whether noise is removed from frames while the camera or the scene moves. At first it is.
    Denoise {
        /// True if it is.
        moving: bool,
    },
    /// Asks what is seen at a pixel of the full picture.
    Pick {
        /// Comes back with the answer.
        id: u32,
        /// Column.
        x: u32,
        /// Row.
        y: u32,
    },
    /// Asks for a file of the picture as it is now.
    Save {
        /// The file's format.
        format: PictureFile,
    },
    /// Asks for the render spec of what the view shows.
    Spec,
    /// Says that a frame has been shown, which is a credit for another one.
    Ack {
        /// Its number.
        sequence: u32,
    },
}

/// Formats of saved pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum PictureFile {
    /// What the look shows, 8 bits a channel.
    Png,
    /// Linear radiance and the layer that is shown.
    Exr,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_are_read_as_documented() {
        let read = |text: &str| serde_json::from_str::<Request>(text);
        let pose = r#"{"eye":[0,1,5],"target":[0,0,0],"up":[0,1,0],"fov":40,"lens":null}"#;
        let camera = read(&format!(r#"{{"type":"camera","generation":3,"pose":{pose}}}"#));
        assert!(matches!(camera, Ok(Request::Camera { generation: 3, pose: Pose { fov: Some(40.0), .. } })));
        assert_eq!(read(r#"{"type":"ack","sequence":9}"#).ok(), Some(Request::Ack { sequence: 9 }));
        let look = Request::Look { exposure: None, view: "agx".into() };
        assert_eq!(read(r#"{"type":"look","exposure":null,"view":"agx"}"#).ok(), Some(look));
        assert_eq!(
            read(r#"{"type":"save","format":"exr"}"#).ok(),
            Some(Request::Save { format: PictureFile::Exr })
        );
        let time = Request::Time { generation: 4, seconds: Some(0.5), animation: None };
        assert_eq!(read(r#"{"type":"time","generation":4,"seconds":0.5}"#).ok(), Some(time));
        let denoise = Request::Denoise { moving: false };
        assert_eq!(read(r#"{"type":"denoise","moving":false}"#).ok(), Some(denoise));
        for bad in [
            r#"{"type":"time","generation":1,"seconds":NaN}"#,
            r#"{"type":"time","generation":1,"seconds":1e999}"#,
        ] {
            assert!(read(bad).is_err(), "{bad}");
        }
        for bad in ["", "{}", r#"{"type":"camera"}"#, r#"{"type":"ack","sequence":-1}"#, r#"{"type":"x"}"#] {
            assert!(read(bad).is_err(), "{bad}");
        }
    }
}
