//! Tests of cameras.

mod known_points;
mod optics;

use super::*;

fn direction(lens: &Lens, x: u32, y: u32, place: [f32; 2]) -> Vec3 {
    lens.ray(x, y, place).expect("a ray").1
}

#[test]
fn a_cameras_text_has_all_its_fields() {
    let camera = Camera::new(Vec3::new(1.5, 0.1, -2.0), Vec3::ZERO);
    assert_eq!(camera.to_string(), "eye 1.5,0.1,-2 target 0,0,0 up 0,1,0 fov 40");
    let near = |v: Vec3, axis: usize| {
        let mut v = v;
        v[axis] = v[axis].next_up();
        v
    };
    for axis in 0..3 {
        for other in [
            Camera { eye: near(camera.eye, axis), ..camera },
            Camera { target: near(camera.target, axis), ..camera },
            Camera { up: near(camera.up, axis), ..camera },
        ] {
            assert_ne!(camera.to_string(), other.to_string());
        }
    }
    let wider = camera.with_fov(40.0_f32.next_up());
    assert_ne!(camera.to_string(), wider.to_string());
}

#[test]
fn the_middle_pixel_looks_at_the_target_and_x_goes_right() {
    let camera = Camera::new(Vec3::new(0.0, 1.0, 5.0), Vec3::Y).with_fov(90.0);
    let lens = camera.lens(4, 2).expect("valid");
    let middle = direction(&lens, 2, 1, [0.0, 0.0]);
    assert!((middle - Vec3::NEG_Z).length() < 1e-6);
    let right = direction(&lens, 3, 1, [0.5, 0.0]);
    assert!(right.x > 0.5 && right.y.abs() < 1e-6);
    let top = direction(&lens, 2, 0, [0.0, 0.0]);
    assert!((top - Vec3::new(0.0, 1.0, -1.0).normalize()).length() < 1e-6, "45 degrees up");
}

#[test]
fn framing_shows_every_corner() {
    for aspect in [0.5, 1.0, 16.0 / 9.0] {
        let b = Aabb { min: Vec3::new(-3.0, 1.0, 2.0), max: Vec3::new(4.0, 9.0, 2.5) };
        let c = Camera::framing(&b, aspect);
        let forward = (c.target - c.eye).normalize();
        let half = libm::tanf(0.5 * 40.0_f32.to_radians());
        let right = forward.cross(Vec3::Y).normalize();
        for i in 0..8 {
            let p = Vec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), b.max, b.min) - c.eye;
            let depth = p.dot(forward);
            assert!(p.dot(right).abs() <= depth * half * aspect * 1.0001);
            assert!(p.dot(right.cross(forward)).abs() <= depth * half * 1.0001);
        }
    }
}

#[test]
fn vectors_of_any_length_give_the_same_view() {
    let camera = Camera::new(Vec3::ZERO, Vec3::Z);
    let seen = |camera: Camera| direction(&camera.lens(4, 4).expect("valid"), 0, 1, [0.5; 2]);
    for length in [f32::MAX, 1e30, 1e-30, f32::MIN_POSITIVE] {
        assert_eq!(seen(Camera { up: Vec3::Y * length, ..camera }), seen(camera), "{length:e}");
        assert_eq!(seen(Camera { target: Vec3::Z * length, ..camera }), seen(camera), "{length:e}");
    }
    let far = Camera { eye: Vec3::Z * -1e38, ..camera }.lens(4, 4).expect_err("out of range").to_string();
    assert!(far.contains("(-0.0, -0.0, -1e38) is too far away"), "{far}");
    for bad in [Vec3::INFINITY, Vec3::NAN] {
        assert!(Camera { eye: bad, ..camera }.lens(1, 1).is_err());
        assert!(Camera { target: bad, ..camera }.lens(1, 1).is_err());
        assert!(Camera { up: bad, ..camera }.lens(1, 1).is_err());
    }
}

#[test]
fn invalid_cameras_are_refused() {
    let good = Camera::new(Vec3::ZERO, Vec3::Z);
    assert!(matches!(Camera { target: Vec3::ZERO, ..good }.lens(1, 1), Err(CameraError::View(..))));
    assert!(matches!(Camera { up: Vec3::NEG_Z, ..good }.lens(1, 1), Err(CameraError::Up(_))));
    assert!(matches!(good.with_fov(180.0).lens(1, 1), Err(CameraError::Fov(_))));
    assert!(matches!(good.with_fov(f32::NAN).lens(1, 1), Err(CameraError::Fov(_))));
}
