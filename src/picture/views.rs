//! Many views of one asset: from a number, or from a file of cameras.

use super::matrix;
use super::spec::OpticsSpec;
use crate::scene::recipe::View;
use crate::scene::{Camera, Distortion, Intrinsics, NamedCamera, Scene};
use anyhow::{Context, Result, bail, ensure};
use glam::{DMat4, Vec3};
use serde::Deserialize;
use serde_json::Value;
use std::path::Path;

/// The most views of a run.
const MAX_VIEWS: u32 = 1_000_000;

/// The cameras that `--views` asks for.
pub enum Views {
    /// So many on a sphere around the scene.
    Sphere(u32),
    /// Those of a file.
    Cameras(Vec<NamedCamera>),
}

/// A file in the form of NeRF's `transforms.json`, with nerfstudio's keys. Other keys are allowed.
#[derive(Deserialize)]
struct Transforms {
    /// Horizontal field of view in radians.
    camera_angle_x: Option<f64>,
    w: Option<f64>,
    h: Option<f64>,
    #[serde(flatten)]
    lens: TransformsLens,
    frames: Vec<TransformsFrame>,
}

#[derive(Deserialize)]
struct TransformsFrame {
    file_path: Option<String>,
    transform_matrix: Vec<Vec<f64>>,
    #[serde(flatten)]
    lens: TransformsLens,
}

/// The intrinsics of all frames or of one.
#[derive(Default, Deserialize)]
struct TransformsLens {
    camera_model: Option<String>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
}

/// A camera of a list: that of a recipe, and its name.
#[derive(Deserialize)]
struct ListedView {
    name: Option<String>,
    #[serde(flatten)]
    view: Value,
}

impl Views {
    /// Reads what `--views` asks for.
    pub fn read(text: &str, size: (u32, u32)) -> Result<Self> {
        if let Ok(count) = text.parse::<u64>() {
            ensure!(
                (1..=u64::from(MAX_VIEWS)).contains(&count),
                "--views {count}: ask for 1 to {MAX_VIEWS} views, or name a file of cameras"
            );
            return Ok(Self::Sphere(count as u32));
        }
        let bytes = std::fs::read(text).with_context(|| format!("{text}: cannot be read"))?;
        let value: Value = serde_json::from_slice(&bytes).with_context(|| format!("{text}: not JSON"))?;
        let cameras = if value.is_array() { listed(value) } else { of_transforms(value, size) };
        let cameras = cameras.with_context(|| text.to_owned())?;
        ensure!(!cameras.is_empty(), "{text}: there are no cameras in it");
        ensure!(cameras.len() <= MAX_VIEWS as usize, "{text}: more than {MAX_VIEWS} cameras");
        Ok(Self::Cameras(cameras))
    }

    /// The cameras. Those on a sphere look as `own` does, at the middle of the scene, from where all of it is seen.
    pub fn cameras(
        self,
        optics: &OpticsSpec,
        own: Camera,
        scene: &Scene,
        size: (u32, u32),
    ) -> Result<Vec<NamedCamera>> {
        let cameras = match self {
            Self::Sphere(count) => {
                let bounds = scene.bounds();
                let view = |index: u32| {
                    let camera = own.seeing(&bounds, on_sphere(index, count), size.0, size.1)?;
                    Some(NamedCamera::new(format!("view {index}"), camera))
                };
                (0..count).map(view).collect::<Option<_>>().with_context(|| {
                    let name = own.projection.name();
                    format!("--views needs a camera with a field of view, not one of projection {name}")
                })?
            }
            Self::Cameras(cameras) => cameras,
        };
        for named in &cameras {
            let camera = optics.apply(named.camera, size)?;
            let seen = camera.lens(size.0, size.1).map(|_| camera.intrinsics(size.0, size.1));
            let seen = seen.with_context(|| format!("camera {:?}", named.name))?;
            ensure!(
                seen.is_some(),
                "camera {:?}: transforms.json describes no camera of projection {}",
                named.name,
                camera.projection.name()
            );
            if let Some(Distortion::BrownConrady { k: [_, _, _, k @ ..], s, .. }) = seen.map(|k| k.distortion)
            {
                ensure!(
                    k == [0.0; 3] && s == [0.0; 4],
                    "camera {:?}: transforms.json has no keys for the distortion coefficients k4 to k6 and s1 to s4",
                    named.name
                );
            }
        }
        Ok(cameras)
    }
}

/// Unit vectors evenly spread over the sphere (a Fibonacci lattice), none of them upright.
fn on_sphere(index: u32, count: u32) -> Vec3 {
    let y = 1.0 - (2.0 * f64::from(index) + 1.0) / f64::from(count);
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let (sin, cos) = libm::sincos(golden * f64::from(index));
    let radius = (1.0 - y * y).sqrt();
    Vec3::new((radius * sin) as f32, y as f32, (radius * cos) as f32)
}

fn listed(value: Value) -> Result<Vec<NamedCamera>> {
    let views: Vec<ListedView> = serde_json::from_value(value)?;
    let camera = |(index, listed): (usize, ListedView)| {
        let view: View = serde_json::from_value(listed.view).with_context(|| format!("[{index}]"))?;
        let camera = view.camera().map_err(|problem| anyhow::anyhow!("[{index}]: {problem}"))?;
        Ok(NamedCamera::new(listed.name.unwrap_or_else(|| index.to_string()), camera))
    };
    views.into_iter().enumerate().map(camera).collect()
}

fn of_transforms(value: Value, (width, height): (u32, u32)) -> Result<Vec<NamedCamera>> {
    let file: Transforms = serde_json::from_value(value)
        .context("neither a list of cameras nor in the form of NeRF's transforms.json")?;
    let (w, h) = (file.w.unwrap_or(width.into()), file.h.unwrap_or(height.into()));
    let scale = [f64::from(width) / w, f64::from(height) / h];
    ensure!(
        (scale[0] / scale[1] - 1.0).abs() < 0.01,
        "its pictures are {w} x {h} pixels; render them with --size {w}x{h} or another size of that shape"
    );
    let camera = |(index, frame): (usize, &TransformsFrame)| {
        let place = || format!("frames[{index}]");
        let intrinsics = file.intrinsics(frame, w, h).with_context(place)?.scaled(scale[0], scale[1]);
        let rows: Vec<f64> = frame.transform_matrix.concat();
        let to_world = matrix::from_rows(&rows).with_context(|| format!("{}.transform_matrix", place()))?;
        let flip = DMat4::from_scale(glam::DVec3::new(1.0, -1.0, -1.0));
        let camera = Camera::calibrated(intrinsics, &(to_world * flip).inverse()).with_context(place)?;
        let stem = frame.file_path.as_deref().and_then(|path| Path::new(path).file_stem()?.to_str());
        Ok(NamedCamera::new(stem.map_or_else(|| index.to_string(), str::to_owned), camera))
    };
    file.frames.iter().enumerate().map(camera).collect()
}

impl Transforms {
    /// The intrinsics of a frame in pixels of the file's pictures: its own, else those of the file.
    fn intrinsics(&self, frame: &TransformsFrame, w: f64, h: f64) -> Result<Intrinsics> {
        let number = |of: fn(&TransformsLens) -> Option<f64>| of(&frame.lens).or(of(&self.lens));
        let angle = self.camera_angle_x.map(|angle| 0.5 * w / libm::tan(0.5 * angle));
        let Some(fx) = number(|lens| lens.fl_x).or(angle) else {
            bail!("it has neither fl_x nor camera_angle_x")
        };
        let fy = number(|lens| lens.fl_y).unwrap_or(fx);
        let (cx, cy) = (number(|lens| lens.cx).unwrap_or(0.5 * w), number(|lens| lens.cy).unwrap_or(0.5 * h));
        let [k1, k2, k3, k4, p1, p2] = [
            number(|lens| lens.k1),
            number(|lens| lens.k2),
            number(|lens| lens.k3),
            number(|lens| lens.k4),
            number(|lens| lens.p1),
            number(|lens| lens.p2),
        ]
        .map(Option::unwrap_or_default);
        let model = frame.lens.camera_model.as_ref().or(self.lens.camera_model.as_ref());
        let is_plain = [k1, k2, k3, k4, p1, p2] == [0.0; 6];
        let distortion = match model.map(String::as_str) {
            Some("OPENCV_FISHEYE") => Distortion::Fisheye { k: [k1, k2, k3, k4] },
            None | Some("PINHOLE" | "SIMPLE_PINHOLE" | "OPENCV") if is_plain => Distortion::None,
            None | Some("PINHOLE" | "SIMPLE_PINHOLE" | "OPENCV") => {
                ensure!(k4 == 0.0, "k4 is for the camera model OPENCV_FISHEYE");
                Distortion::brown_conrady(&[k1, k2, p1, p2, k3]).expect("five coefficients")
            }
            Some(other) => bail!("its camera model {other:?} is not known; use OPENCV or OPENCV_FISHEYE"),
        };
        Ok(Intrinsics::new(fx, fy, cx, cy).with_distortion(distortion))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::TriangleMesh;
    use serde_json::json;

    #[test]
    fn views_on_a_sphere_see_everything_from_all_sides() {
        let (min, max) = (Vec3::new(-3.0, 1.0, 2.0), Vec3::new(4.0, 9.0, 2.5));
        let scene = Scene::new(TriangleMesh::new(vec![min, max, min], vec![[0, 1, 2]]), Vec::new());
        let (own, size) = (Camera::new(Vec3::ZERO, Vec3::X).with_fov(30.0), (40, 60));
        for count in [1, 2, 7, 100] {
            let views =
                Views::Sphere(count).cameras(&OpticsSpec::default(), own, &scene, size).expect("views");
            let mut mean = Vec3::ZERO;
            for NamedCamera { camera, .. } in &views {
                let to_camera = camera.to_world().expect("a pose").inverse();
                let k = camera.intrinsics(size.0, size.1).expect("a field of view");
                for i in 0..8 {
                    let corner = Vec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), max, min);
                    let p = to_camera.transform_point3(corner.as_dvec3());
                    let (x, y) = (k.fx * p.x / -p.z + k.cx, k.fy * p.y / p.z + k.cy);
                    assert!((-0.01..40.01).contains(&x) && (-0.01..60.01).contains(&y), "{x},{y}");
                }
                mean += (camera.eye - 0.5 * (min + max)).normalize() / count as f32;
            }
            assert!(count < 100 || mean.length() < 0.02, "{mean}");
        }
    }

    #[test]
    fn transforms_are_read_as_nerf_has_them() {
        let frame = json!([[1, 0, 0, 4], [0, 1, 0, 2], [0, 0, 1, 9], [0, 0, 0, 1]]);
        let frames =
            |more: Value| json!([{ "file_path": "images/a.png", "transform_matrix": frame, "fl_x": more }]);
        let mut file = json!({ "w": 80, "h": 40, "camera_angle_x": 1.0, "frames": frames(Value::Null) });
        let read = |file: &Value| of_transforms(file.clone(), (40, 20));
        let [named] = &read(&file).expect("one")[..] else { panic!("one frame") };
        assert_eq!((&*named.name, named.camera.eye), ("a", Vec3::new(4.0, 2.0, 9.0)));
        assert!(((named.camera.target - named.camera.eye).normalize() - Vec3::NEG_Z).length() < 1e-6);
        let k = named.camera.intrinsics(40, 20).expect("intrinsics");
        assert!((k.fx - 20.0 / f64::tan(0.5)).abs() < 1e-9 && (k.cx, k.cy) == (20.0, 10.0), "{k:?}");
        file["frames"] = frames(json!(100.0));
        file["k1"] = json!(0.1);
        let k = read(&file).expect("one")[0].camera.intrinsics(40, 20).expect("intrinsics");
        let bent = Distortion::brown_conrady(&[0.1, 0.0, 0.0, 0.0]).expect("four");
        assert_eq!(k, Intrinsics::new(50.0, 50.0, 20.0, 10.0).with_distortion(bent));
        file["camera_model"] = json!("OPENCV_FISHEYE");
        let k = read(&file).expect("one")[0].camera.intrinsics(40, 20).expect("intrinsics");
        assert_eq!(k.distortion, Distortion::Fisheye { k: [0.1, 0.0, 0.0, 0.0] });
        let told =
            |file: &Value, size| format!("{:#}", of_transforms(file.clone(), size).expect_err("refused"));
        assert!(told(&file, (40, 40)).contains("80 x 40"));
        file["frames"][0]["transform_matrix"][0][0] = json!(3.0);
        assert!(told(&file, (40, 20)).starts_with("frames[0]: "), "{}", told(&file, (40, 20)));
        file["camera_model"] = json!("ODD");
        assert!(told(&file, (40, 20)).contains("ODD"));
    }
}
