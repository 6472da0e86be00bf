//! Facts that picture files hold beside pixels.

use super::{Denoiser, Rendering};
use crate::film::Picture;
use crate::render::{PICTURE_VERSION, Settings};
use crate::scene::{Camera, Distortion};
use std::collections::BTreeMap;

impl Rendering {
    /// Facts about a picture that its file holds, by the names in `docs/guide/picture-files.md`.
    pub fn facts(&self, picture: &Picture, camera: &Camera, mean_spp: f64) -> BTreeMap<String, String> {
        let (spec, settings) = (self.spec(), self.spec().settings());
        let look = spec.look.look();
        let facts = [
            ("scene_hash", self.prepared().scene_hash().to_owned()),
            ("picture_hash", picture.hash()),
            ("picture_version", PICTURE_VERSION.to_string()),
            ("camera", camera.to_string()),
            ("integrator", self.integrator_name().to_owned()),
            ("spp", settings.spp.to_string()),
            ("mean_spp", mean_spp.to_string()),
            ("max_bounces", settings.max_bounces.to_string()),
            ("seed", settings.seed.to_string()),
            ("filter", spec.sampling.filter.to_string()),
            ("view", look.view().name().to_owned()),
            ("exposure_stops", look.stops(&picture.image).to_string()),
        ];

        let optional = [
            ("indirect_limit", spec.indirect_limit().map(|limit| limit.to_string())),
            (Picture::DENOISE, (spec.layers.denoise == Denoiser::Oidn).then(|| "oidn".to_owned())),
            ("white_balance", spec.look.white_balance.map(|kelvin| kelvin.to_string())),
            (Picture::WORLD_TO_CAMERA, world_to_camera(camera)),
            (Picture::INTRINSICS, intrinsics(camera, &settings)),
            (Picture::REGION, spec.part.region.map(|region| region.to_string())),
            (
                Picture::WHOLE_SIZE,
                spec.part.region.map(|_| format!("{},{}", settings.width, settings.height)),
            ),
            (
                "samples",
                spec.part.samples.as_ref().map(|samples| format!("{}..{}", samples.start, samples.end)),
            ),
        ];
        let optional = optional
            .into_iter()
            .chain(picture.denoising_facts())
            .filter_map(|(name, text)| Some((name, text?)));
        facts.into_iter().chain(optional).map(|(name, text)| (name.to_owned(), text)).collect()
    }
}

/// The matrix in OpenCV's axes, row after row.
fn world_to_camera(camera: &Camera) -> Option<String> {
    let opengl = camera.to_world().ok()?.inverse();
    // y and z point the other way.
    let row =
        |i: usize| opengl.row(i).to_array().map(|number| if i == 1 || i == 2 { -number } else { number });
    // Without the negative zeros that signs make.
    Some(joined(&[row(0), row(1), row(2), row(3)].as_flattened().iter().map(|x| x + 0.0).collect::<Vec<_>>()))
}

/// `fx,fy,cx,cy` of a camera without distortion.
fn intrinsics(camera: &Camera, settings: &Settings) -> Option<String> {
    let pinhole = camera.intrinsics(settings.width, settings.height)?;
    (pinhole.distortion == Distortion::None)
        .then(|| joined(&[pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy]))
}

fn joined(numbers: &[f64]) -> String {
    numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn matrices_are_those_of_opencv() {
        let camera = Camera::new(Vec3::new(0.0, 0.0, 5.0), Vec3::ZERO).with_fov(90.0);
        let text = world_to_camera(&camera).expect("a pose");
        assert_eq!(text, "1,0,0,0,0,-1,0,0,0,0,-1,5,0,0,0,1");
        let settings = Settings::new(64, 32);
        let numbers = intrinsics(&camera, &settings).expect("a pinhole");
        let numbers: Vec<f64> = numbers.split(',').map(|number| number.parse().expect("a number")).collect();
        let wanted = [16.0, 16.0, 32.0, 16.0];
        assert!(numbers.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-9), "{numbers:?}");
    }
}
