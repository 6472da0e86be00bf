//! Options of the camera's projection and lens.

use super::view::angle;
use crate::cli::matrix;
use crate::scene::{Aperture, Camera, CameraError, Distortion, FULL_FRAME_HEIGHT, Intrinsics, Projection};
use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use glam::Vec2;

/// Options of the camera's projection and lens.
#[derive(Debug, Default, Args)]
pub struct OpticsArgs {
    /// Use the scene's camera of this name; `all` renders one picture for each, and the output's name numbers (%04d) or
    /// names (%s) them [default: the first].
    #[arg(long, value_name = "NAME|all")]
    pub camera: Option<String>,
    /// Render many views in one run, and a transforms.json in NeRF's form beside them: N on a sphere around the scene,
    /// or the cameras of a .json file (a transforms.json, or a list of cameras as in recipes).
    #[arg(
        long,
        value_name = "FILE|N",
        conflicts_with_all = ["eye", "target", "up", "world_to_camera", "frames", "orthographic", "panorama"]
    )]
    pub views: Option<String>,
    /// Orthographic projection: the height of the picture in world units.
    #[arg(long, value_name = "HEIGHT", allow_hyphen_values = true, conflicts_with = "fov")]
    pub orthographic: Option<f32>,
    /// Everything around the eye, as an equirectangular picture.
    #[arg(long, conflicts_with_all = ["fov", "orthographic"])]
    pub panorama: bool,
    /// Intrinsics in pixels of the picture; (0.5, 0.5) is the centre of the top left pixel.
    #[arg(
        long = "K",
        value_name = "FX,FY,CX,CY",
        allow_hyphen_values = true,
        conflicts_with_all = ["fov", "orthographic", "panorama"],
        value_parser = intrinsics
    )]
    pub k: Option<Intrinsics>,
    /// Lens distortion of --K (Brown-Conrady), in OpenCV's order: K1,K2,P1,P2[,K3[,K4,K5,K6[,S1,S2,S3,S4]]].
    #[arg(
        long,
        value_name = "K1,K2,P1,P2[,..]",
        allow_hyphen_values = true,
        requires = "k",
        value_parser = brown_conrady
    )]
    pub distortion: Option<Distortion>,
    /// Lens distortion of --K by OpenCV's fisheye model.
    #[arg(
        long,
        value_name = "K1,K2,K3,K4",
        allow_hyphen_values = true,
        requires = "k",
        conflicts_with = "distortion",
        value_parser = fisheye
    )]
    pub fisheye: Option<Distortion>,
    /// Pose of the camera in OpenCV's convention (x right, y down, z forward): 12 or 16 numbers, row after row, or a
    /// .json, .npy or .txt file of them.
    #[arg(
        long,
        value_name = "FILE|NUMBERS",
        allow_hyphen_values = true,
        conflicts_with_all = ["eye", "target", "up"]
    )]
    pub world_to_camera: Option<String>,
    /// Move the picture to the right and up, in widths and heights of the picture (lens shift).
    #[arg(
        long,
        value_name = "X,Y",
        allow_hyphen_values = true,
        conflicts_with_all = ["k", "panorama"],
        value_parser = shift
    )]
    pub shift: Option<Vec2>,
    /// Thin lens: focal length over the diameter of its opening, for a sensor 24 mm high in a world in metres.
    #[arg(long, value_name = "N", allow_hyphen_values = true, conflicts_with = "aperture_radius")]
    pub f_stop: Option<f32>,
    /// Thin lens: radius of its opening in world units.
    #[arg(long, value_name = "R", allow_hyphen_values = true)]
    pub aperture_radius: Option<f32>,
    /// Thin lens: distance of the plane that is sharp, along the view axis.
    #[arg(long, value_name = "D", allow_hyphen_values = true)]
    pub focus_distance: Option<f32>,
    /// Thin lens: number of blades of the aperture; 0 for a disk.
    #[arg(long, value_name = "N")]
    pub aperture_blades: Option<u32>,
    /// Thin lens: rotation of the blades.
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, value_parser = angle)]
    pub aperture_rotation: Option<f32>,
}

impl OpticsArgs {
    /// Whether one picture is rendered for each camera of the scene.
    pub fn is_all(&self) -> bool {
        self.camera.as_deref() == Some("all")
    }

    /// Whether several pictures are rendered, each by a camera of its own.
    pub fn has_several(&self) -> bool {
        self.is_all() || self.views.is_some()
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

/// Finite numbers with commas between them.
fn numbers(text: &str) -> Result<Vec<f64>, String> {
    let number = |s: &str| s.trim().parse::<f64>().map_err(|e| format!("{s:?}: {e}"));
    let numbers: Vec<f64> = text.split(',').map(number).collect::<Result<_, _>>()?;
    if numbers.iter().all(|n| n.is_finite()) { Ok(numbers) } else { Err("numbers must be finite".into()) }
}

fn intrinsics(text: &str) -> Result<Intrinsics, String> {
    match numbers(text)?[..] {
        [fx, fy, cx, cy] => Ok(Intrinsics::new(fx, fy, cx, cy)),
        _ => Err("write four numbers FX,FY,CX,CY in pixels, as in 610,608.5,322.4,241".into()),
    }
}

fn brown_conrady(text: &str) -> Result<Distortion, String> {
    let numbers = numbers(text)?;
    Distortion::brown_conrady(&numbers)
        .ok_or_else(|| format!("{} numbers; write 4, 5, 8 or 12, in OpenCV's order", numbers.len()))
}

fn fisheye(text: &str) -> Result<Distortion, String> {
    let k = numbers(text)?.try_into().map_err(|_| "write four numbers K1,K2,K3,K4")?;
    Ok(Distortion::Fisheye { k })
}

fn shift(text: &str) -> Result<Vec2, String> {
    match numbers(text)?[..] {
        [x, y] => Ok(Vec2::new(x as f32, y as f32)),
        _ => Err("write two numbers X,Y, as in 0,0.25".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn camera() -> Camera {
        Camera::new(Vec3::ZERO, Vec3::NEG_Z).with_fov(40.0)
    }

    #[test]
    fn numbers_of_wrong_counts_are_refused() {
        assert!(intrinsics("1,2,3").is_err() && intrinsics("1,2,3,nan").is_err());
        assert!(brown_conrady("1,2,3").is_err() && brown_conrady("1,2,3,4").is_ok());
        assert!(fisheye("1,2,3").is_err() && shift("1").is_err());
    }

    #[test]
    fn apertures_need_a_focus() {
        let apply = |args: OpticsArgs| args.apply(camera(), (100, 50)).map(|camera| camera.aperture);
        let f_stop = || OpticsArgs { f_stop: Some(2.0), ..OpticsArgs::default() };
        assert!(apply(f_stop()).expect_err("no focus").to_string().contains("--focus-distance"));
        let blades = OpticsArgs { aperture_blades: Some(6), ..OpticsArgs::default() };
        assert!(apply(blades).expect_err("no aperture").to_string().contains("--f-stop"));
        let opening =
            apply(OpticsArgs { focus_distance: Some(3.0), ..f_stop() }).expect("a lens").expect("open");
        // Focal length 0.012 / tan 20° = 33 mm.
        assert!((opening.radius - 0.25 * 0.032_97).abs() < 1e-5, "{}", opening.radius);
        let dome =
            OpticsArgs { panorama: true, aperture_radius: Some(1.0), focus_distance: Some(1.0), ..f_stop() };
        assert!(apply(OpticsArgs { f_stop: None, ..dome }).is_err());
    }

    #[test]
    fn poses_come_from_matrices() {
        let numbers = "1,0,0,-4, 0,-1,0,2, 0,0,-1,9".to_owned();
        let args = OpticsArgs { world_to_camera: Some(numbers), ..OpticsArgs::default() };
        let posed = args.apply(camera(), (8, 8)).expect("rigid");
        assert_eq!((posed.eye, posed.projection), (Vec3::new(4.0, 2.0, 9.0), camera().projection));
        assert_eq!((posed.target - posed.eye).normalize(), Vec3::NEG_Z);
        let mirrored = OpticsArgs { world_to_camera: Some("1,0,0,0,0,1,0,0,0,0,-1,0".into()), ..args };
        assert!(mirrored.apply(camera(), (8, 8)).is_err());
    }
}
