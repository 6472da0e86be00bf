//! The camera's projection and lens.

use super::form;
use super::option::spec_group;
use crate::picture::matrix;
use crate::scene::{Aperture, Camera, CameraError, FULL_FRAME_HEIGHT, Intrinsics, Projection};
use anyhow::{Context, Result, bail, ensure};
use glam::Vec2;
use std::path::Path;

spec_group! {
    /// The camera's projection and lens.
    pub struct OpticsSpec {
        /// Use the scene's camera of this name; `all` renders one picture for each, and the output's name numbers
        /// (%04d) or names (%s) them [default: the first].
        maybe "camera" camera: form::Text, "NAME|all";
        /// Render many views in one run, and a transforms.json in NeRF's form beside them: N on a sphere around the
        /// scene, or the cameras of a .json file (a transforms.json, or a list of cameras as in recipes).
        maybe "views" views: form::Text, "FILE|N";
        /// Orthographic projection: the height of the picture in world units.
        maybe "orthographic" orthographic: form::Plain, "HEIGHT";
        /// Everything around the eye, as an equirectangular picture.
        flag "panorama" panorama;
        /// Intrinsics in pixels of the picture; (0.5, 0.5) is the centre of the top left pixel.
        maybe "K" k: form::Calibration, "FX,FY,CX,CY";
        /// Lens distortion of --K (Brown-Conrady), in OpenCV's order: `K1,K2,P1,P2[,K3[,K4,K5,K6[,S1,S2,S3,S4]]]`.
        maybe "distortion" distortion: form::BrownConrady, "K1,K2,P1,P2[,..]";
        /// Lens distortion of --K by OpenCV's fisheye model.
        maybe "fisheye" fisheye: form::Fisheye, "K1,K2,K3,K4";
        /// Pose of the camera in OpenCV's convention (x right, y down, z forward): 12 or 16 numbers, row after row, or
        /// a .json, .npy or .txt file of them.
        maybe "world-to-camera" world_to_camera: form::Text, "FILE|NUMBERS";
        /// Move the picture to the right and up, in widths and heights of the picture (lens shift).
        maybe "shift" shift: form::Shift, "X,Y";
        /// Thin lens: focal length over the diameter of its opening, for a sensor 24 mm high in a world in metres.
        maybe "f-stop" f_stop: form::Plain, "N";
        /// Thin lens: radius of its opening in world units; 0 for a pinhole.
        maybe "aperture-radius" aperture_radius: form::Plain, "R";
        /// Thin lens: distance of the plane that is sharp, along the view axis.
        maybe "focus-distance" focus_distance: form::Plain, "D";
        /// Thin lens: number of blades of the aperture; 0 for a disk.
        maybe "aperture-blades" aperture_blades: form::Count<0, { u32::MAX }>, "N";
        /// Thin lens: rotation of the blades.
        maybe "aperture-rotation" aperture_rotation: form::Angle, "DEG";
    }
}

impl OpticsSpec {
    /// True if one picture is rendered for each camera of the scene.
    pub fn is_all(&self) -> bool {
        self.camera.as_deref() == Some("all")
    }

    /// True if several pictures are rendered, each by a camera of its own.
    pub fn has_several(&self) -> bool {
        self.is_all() || self.views.is_some()
    }

    /// The file that `views` names, if it names one.
    pub fn views_file(&self) -> Option<&Path> {
        self.views.as_deref().filter(|text| text.parse::<u64>().is_err()).map(Path::new)
    }

    /// The file that `world-to-camera` names, if it names one.
    pub fn world_to_camera_file(&self) -> Option<&Path> {
        let is_number = |part: &str| part.trim().parse::<f64>().is_ok();
        self.world_to_camera.as_deref().filter(|text| !text.split(',').all(is_number)).map(Path::new)
    }

    /// An option that gives the projection, if there is one.
    pub fn projection_option(&self) -> Option<&'static str> {
        let given = [
            ("--orthographic", self.orthographic.is_some()),
            ("--panorama", self.panorama),
            ("--K", self.k.is_some()),
        ];
        given.into_iter().find_map(|(name, is_given)| is_given.then_some(name))
    }

    /// A camera changed by the options; `size` is that of the picture.
    pub fn apply(&self, camera: Camera, size: (u32, u32)) -> Result<Camera> {
        let mut camera = camera;
        if let Some(text) = &self.world_to_camera {
            let matrix = matrix::world_to_camera(text)?;
            let none = Intrinsics::new(1.0, 1.0, 0.0, 0.0);
            let posed = Camera::calibrated(none, &matrix)
                .with_context(|| format!("--world-to-camera {}", matrix::named(text)))?;
            camera = camera.posed_as(&posed);
        }
        let k = self.k.map(|k| match self.distortion.or(self.fisheye) {
            Some(distortion) => k.with_distortion(distortion),
            None => k,
        });
        let projection = match (self.orthographic, k) {
            (Some(height), _) => Some(Projection::Orthographic { height }),
            (_, Some(k)) => Some(Projection::Intrinsics(k)),
            _ => self.panorama.then_some(Projection::Panorama),
        };
        if let Some(projection) = projection {
            camera = camera.with_projection(projection);
            let no_shift = matches!(projection, Projection::Intrinsics(_) | Projection::Panorama);
            camera = if no_shift { camera.with_shift(Vec2::ZERO) } else { camera };
        }
        camera = camera.with_shift(self.shift.unwrap_or(camera.shift));
        camera = self.focus(camera, size)?;
        match camera.lens(size.0, size.1) {
            Err(error @ (CameraError::ShiftOf(_) | CameraError::ApertureOf(_) | CameraError::Height(_))) => {
                Err(error.into())
            }
            _ => Ok(camera),
        }
    }

    /// The camera with the aperture of the options, or with its own as they change it.
    fn focus(&self, camera: Camera, size: (u32, u32)) -> Result<Camera> {
        let radius = match self.f_stop {
            Some(number) => Some(radius_of(number, &camera, size)?),
            None => self.aperture_radius,
        };
        if radius == Some(0.0) {
            return Ok(Camera { aperture: None, ..camera });
        }
        let own = camera.aperture;
        let changes = self.focus_distance.is_some()
            || self.aperture_blades.is_some()
            || self.aperture_rotation.is_some();
        let Some(radius) = radius.or(own.map(|own| own.radius)) else {
            ensure!(
                !changes,
                "--focus-distance, --aperture-blades and --aperture-rotation need an aperture: add --f-stop N or \
                 --aperture-radius R"
            );
            return Ok(camera);
        };
        let Some(focus_distance) = self.focus_distance.or(own.map(|own| own.focus_distance)) else {
            bail!("an aperture needs the distance that is sharp: add --focus-distance D")
        };
        let blades = self.aperture_blades.or(own.map(|own| own.blades)).unwrap_or(0);
        let rotation = self.aperture_rotation.or(own.map(|own| own.rotation_degrees)).unwrap_or(0.0);
        Ok(camera.with_aperture(Aperture::new(radius, focus_distance).with_blades(blades, rotation)))
    }
}

/// The radius of the opening of a full-frame camera.
fn radius_of(f_stop: f32, camera: &Camera, (width, height): (u32, u32)) -> Result<f32> {
    ensure!(f_stop > 0.0 && f_stop.is_finite(), "--f-stop {f_stop}: write a positive number, as in 2.8");
    let Some(k) = camera.intrinsics(width, height) else {
        bail!("--f-stop needs a focal length, which this projection does not have; use --aperture-radius")
    };
    let focal_length = k.fy / f64::from(height) * f64::from(FULL_FRAME_HEIGHT);
    Ok((0.5 * focal_length / f64::from(f_stop)) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn camera() -> Camera {
        Camera::new(Vec3::ZERO, Vec3::NEG_Z).with_fov(40.0)
    }

    #[test]
    fn apertures_need_a_focus() {
        let apply = |args: OpticsSpec| args.apply(camera(), (100, 50)).map(|camera| camera.aperture);
        let f_stop = || OpticsSpec { f_stop: Some(2.0), ..OpticsSpec::default() };
        assert!(apply(f_stop()).expect_err("no focus").to_string().contains("--focus-distance"));
        let blades = OpticsSpec { aperture_blades: Some(6), ..OpticsSpec::default() };
        assert!(apply(blades).expect_err("no aperture").to_string().contains("--f-stop"));
        let opening =
            apply(OpticsSpec { focus_distance: Some(3.0), ..f_stop() }).expect("a lens").expect("open");
        // Focal length 0.012 / tan 20° = 33 mm.
        assert!((opening.radius - 0.25 * 0.032_97).abs() < 1e-5, "{}", opening.radius);
        let dome =
            OpticsSpec { panorama: true, aperture_radius: Some(1.0), focus_distance: Some(1.0), ..f_stop() };
        assert!(apply(OpticsSpec { f_stop: None, ..dome }).is_err());
    }

    #[test]
    fn poses_come_from_matrices() {
        let numbers = "1,0,0,-4, 0,-1,0,2, 0,0,-1,9".to_owned();
        let args = OpticsSpec { world_to_camera: Some(numbers), ..OpticsSpec::default() };
        let posed = args.apply(camera(), (8, 8)).expect("rigid");
        assert_eq!((posed.eye, posed.projection), (Vec3::new(4.0, 2.0, 9.0), camera().projection));
        assert_eq!((posed.target - posed.eye).normalize(), Vec3::NEG_Z);
        let mirrored = OpticsSpec { world_to_camera: Some("1,0,0,0,0,1,0,0,0,0,-1,0".into()), ..args };
        assert!(mirrored.apply(camera(), (8, 8)).is_err());
    }
}
