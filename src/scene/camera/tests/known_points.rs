//! Known points, projected by OpenCV's formulas in double precision, lie where the rays of their pixels pass.

use crate::geom::Sampler;
use crate::scene::{Camera, Distortion, Intrinsics, Projection};
use glam::{DMat4, DQuat, DVec2, DVec3, Vec3};

/// Width and height of the pictures.
const SIZE: [u32; 2] = [1280, 960];
/// Pixels by which a ray may miss its point.
const TOLERANCE: f64 = 1e-3;

/// OpenCV's projection of a point in the axes of the camera (x right, y down, z forward), as its documentation of
/// `calib3d` and `fisheye` has it.
fn project(k: &Intrinsics, point: DVec3) -> DVec2 {
    let (a, b) = (point.x / point.z, point.y / point.z);
    let (x, y) = match k.distortion {
        Distortion::None => (a, b),
        Distortion::BrownConrady { k: [k1, k2, k3, k4, k5, k6], p: [p1, p2], s: [s1, s2, s3, s4] } => {
            let r2 = a * a + b * b;
            let (r4, r6) = (r2 * r2, r2 * r2 * r2);
            let radial = (1.0 + k1 * r2 + k2 * r4 + k3 * r6) / (1.0 + k4 * r2 + k5 * r4 + k6 * r6);
            let x = a * radial + 2.0 * p1 * a * b + p2 * (r2 + 2.0 * a * a) + s1 * r2 + s2 * r4;
            let y = b * radial + p1 * (r2 + 2.0 * b * b) + 2.0 * p2 * a * b + s3 * r2 + s4 * r4;
            (x, y)
        }
        Distortion::Fisheye { k: [k1, k2, k3, k4] } => {
            // The angle counts beyond a right angle too.
            let theta = f64::atan2(point.x.hypot(point.y), point.z);
            let t2 = theta * theta;
            let angle = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))));
            let r = point.x.hypot(point.y);
            if r == 0.0 { (0.0, 0.0) } else { (angle * point.x / r, angle * point.y / r) }
        }
    };
    DVec2::new(k.fx * x + k.cx, k.fy * y + k.cy)
}

/// World to camera.
fn extrinsics() -> DMat4 {
    let rotation = DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -2.1, 0.15);
    DMat4::from_rotation_translation(rotation, DVec3::new(0.7, -1.3, 4.2))
}

/// How far the rays through 1,000 points that are seen in the picture miss them, at most, in pixels.
fn worst(k: &Intrinsics, widest: f64) -> f64 {
    let camera = Camera::calibrated(*k, &extrinsics()).expect("rigid");
    let lens = camera.lens(SIZE[0], SIZE[1]).expect("a view");
    let size = DVec2::new(SIZE[0].into(), SIZE[1].into());
    let (mut worst, mut seen, mut index) = (0.0_f64, 0, 0);
    while seen < 1000 {
        index += 1;
        assert!(index < 100_000, "few points are seen");
        // A direction around the view axis and a depth.
        let [u, v] = Sampler::new(index, 0, 3).pair(0).map(f64::from);
        let (angle, depth) = (widest * u.sqrt(), 1.0 + 9.0 * f64::from(Sampler::new(index, 0, 3).single(1)));
        let (sin, cos) = (v * std::f64::consts::TAU).sin_cos();
        let point = depth * DVec3::new(angle.sin() * cos, angle.sin() * sin, angle.cos());
        let at = project(k, point);
        if at.cmplt(DVec2::ZERO).any() || at.cmpge(size).any() {
            continue;
        }
        seen += 1;
        let pixel = at.floor();
        let place = (at - pixel).as_vec2().to_array();
        let (origin, direction) = lens.ray(pixel.x as u32, pixel.y as u32, place).expect("a ray");
        // Where the ray passes the point's distance, seen again.
        let in_camera = |v: Vec3, w: f64| (extrinsics() * v.as_dvec3().extend(w)).truncate();
        let passed = in_camera(origin, 1.0) + in_camera(direction, 0.0) * point.length();
        worst = worst.max(project(k, passed).distance(at));
    }
    worst
}

#[test]
fn calibrated_pinholes_see_known_points_where_opencv_does() {
    for k in [Intrinsics::new(1100.0, 1100.0, 640.0, 480.0), Intrinsics::new(912.7, 873.1, 701.3, 402.9)] {
        let off = worst(&k, 0.9);
        assert!(off < TOLERANCE, "{off}");
    }
}

#[test]
fn brown_conrady_lenses_see_known_points_where_opencv_does() {
    let k = Intrinsics::new(912.7, 873.1, 701.3, 402.9);
    for coefficients in [
        &[-0.28, 0.074, 1.2e-3, -4e-4][..],
        &[0.12, -0.21, -8e-4, 2e-3, 0.09],
        &[0.62, -0.11, 3e-4, 7e-4, 0.02, 0.95, 0.06, -0.01],
        &[-0.31, 0.11, 5e-4, -1e-3, -0.02, 0.03, -0.01, 0.002, 2e-3, -1e-3, -3e-3, 4e-4],
    ] {
        let distortion = Distortion::brown_conrady(coefficients).expect("as many");
        let off = worst(&k.with_distortion(distortion), 0.75);
        assert!(off < TOLERANCE, "{coefficients:?}: {off}");
    }
}

#[test]
fn fisheye_lenses_see_known_points_where_opencv_does() {
    for (focal, k) in
        [(400.0, [0.0; 4]), (340.0, [-0.013, 0.021, -0.017, 0.0035]), (280.0, [0.06, -0.004, 0.002, -0.0003])]
    {
        let intrinsics = Intrinsics::new(focal, focal * 1.01, 655.5, 470.25);
        let off = worst(&intrinsics.with_distortion(Distortion::Fisheye { k }), 1.8);
        assert!(off < TOLERANCE, "{k:?}: {off}");
    }
}

#[test]
fn perspective_views_have_intrinsics() {
    let eye = Vec3::new(3.0, 2.0, 5.0);
    let camera = Camera::new(eye, Vec3::ZERO).with_fov(50.0).with_shift(glam::Vec2::new(0.1, -0.2));
    let [width, height] = SIZE;
    let k = camera.intrinsics(width, height).expect("a central projection");
    let to_camera =
        DMat4::from_scale(DVec3::new(1.0, -1.0, -1.0)) * camera.to_world().expect("a pose").inverse();
    let same = Camera::calibrated(k, &to_camera).expect("rigid").lens(width, height).expect("a view");
    let lens = camera.lens(width, height).expect("a view");
    for (x, y) in [(0, 0), (1279, 0), (640, 480), (3, 959)] {
        let [a, b] = [lens, same].map(|lens| lens.ray(x, y, [0.5; 2]).expect("a ray"));
        assert!((a.1 - b.1).length() < 3e-7 && (a.0 - eye).length() == 0.0, "{a:?} {b:?}");
    }
    assert_eq!(camera.with_projection(Projection::Panorama).intrinsics(width, height), None);
}
