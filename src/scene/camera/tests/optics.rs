//! Folds, apertures, parallel and panoramic projections.

use crate::geom::Sampler;
use crate::lanes::{Int, LaneTask, Lanes, Num, SimdLevel};
use crate::scene::{Aperture, Camera, CameraError, Distortion, Intrinsics, Lens, Projection};
use glam::{DMat4, Vec2, Vec3};

const EYE: Vec3 = Vec3::new(1.0, 2.0, 3.0);

fn camera() -> Camera {
    Camera::new(EYE, Vec3::new(1.0, 2.0, -7.0))
}

fn calibrated(distortion: Distortion) -> Camera {
    let intrinsics = Intrinsics::new(60.0, 62.0, 49.0, 38.0).with_distortion(distortion);
    camera().with_projection(Projection::Intrinsics(intrinsics))
}

/// Cameras of all kinds.
fn all() -> Vec<Camera> {
    let brown = |c: &[f64]| Distortion::brown_conrady(c).expect("as many");
    vec![
        camera(),
        camera().with_shift(Vec2::new(0.3, -0.1)),
        camera().with_aperture(Aperture::new(0.3, 5.0)),
        camera().with_projection(Projection::Orthographic { height: 3.0 }),
        camera()
            .with_projection(Projection::Orthographic { height: 3.0 })
            .with_aperture(Aperture::new(0.3, 5.0)),
        calibrated(Distortion::None),
        calibrated(brown(&[-0.28, 0.074, 1.2e-3, -4e-4])),
        calibrated(brown(&[-0.5, 0.0, 0.0, 0.0])).with_aperture(Aperture::new(0.1, 9.0).with_blades(5, 20.0)),
        calibrated(Distortion::Fisheye { k: [-0.1, -0.05, 0.0, 0.0] }),
        camera().with_projection(Projection::Panorama),
    ]
}

/// The bits of all rays of a picture of 99 × 70 pixels.
struct Bits(Lens);

impl LaneTask for Bits {
    type Output = Vec<Option<[u32; 6]>>;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Self::Output {
        let mut bits = Vec::new();
        let pixels: Vec<u32> = (0..99 * 70).collect();
        for chunk in pixels.chunks(L::LANES) {
            let (pixel, _) = Int::some(l, chunk, 0);
            let numbers = |of: fn(u32) -> u32| {
                let numbers: Vec<u32> = chunk.iter().map(|&pixel| of(pixel)).collect();
                Int::some(l, &numbers, 0).0.to_num()
            };
            let (x, y): (Num<L>, Num<L>) = (numbers(|pixel| pixel % 99), numbers(|pixel| pixel / 99));
            let sampler = Sampler::of(pixel, pixel, 5);
            let place = sampler.two(Int::splat(l, 0));
            let through = self.0.has_aperture().then(|| sampler.two(Int::splat(l, 1)));
            let rays = self.0.rays(x, y, place, through);
            let (o, d) = (rays.origin, rays.direction);
            let columns = [o.x, o.y, o.z, d.x, d.y, d.z].map(|column| column.to_bits().to_array());
            bits.extend(
                (0..chunk.len())
                    .map(|lane| rays.exist.test(lane).then(|| columns.map(|column| column.as_ref()[lane]))),
            );
        }
        bits
    }
}

#[test]
fn all_simd_levels_give_the_same_rays() {
    for camera in all() {
        let lens = camera.lens(99, 70).expect("a view");
        let expected = SimdLevel::narrowest().run(Bits(lens));
        assert!(expected.iter().any(Option::is_some));
        for level in SimdLevel::available() {
            assert!(level.run(Bits(lens)) == expected, "{level:?}: {camera}");
        }
    }
}

#[test]
fn what_distortion_cannot_reach_is_not_seen() {
    // With k1 = −0.5, distances grow to r = √(2/3) and fall beyond; what lies outside of that circle has no ray.
    let barrel = Distortion::brown_conrady(&[-0.5, 0.0, 0.0, 0.0]).expect("four");
    let lens = calibrated(barrel).lens(99, 70).expect("a view");
    let reach = (2.0_f64 / 3.0).sqrt() * (1.0 - 0.5 * 2.0 / 3.0);
    let mut blind = 0;
    for (x, y) in (0..70).flat_map(|y| (0..99).map(move |x| (x, y))) {
        let at = [(f64::from(x) + 0.5 - 49.0) / 60.0, (f64::from(y) + 0.5 - 38.0) / 62.0];
        let distance = at[0].hypot(at[1]);
        let ray = lens.ray(x, y, [0.5; 2]);
        blind += u64::from(ray.is_none());
        if (distance - reach).abs() > 1e-3 {
            assert_eq!(ray.is_some(), distance < reach, "{x},{y}");
        }
        let Some((_, direction)) = ray else { continue };
        let seen = (direction / -direction.z).truncate().as_dvec2();
        let back = seen.length() * (1.0 - 0.5 * seen.length_squared());
        assert!((back - distance).abs() < 2e-6, "{x},{y}: {back} for {distance}");
    }
    assert!(blind > 500, "{blind}");
    assert_eq!(lens.blind_pixels(), blind);
    assert_eq!(camera().lens(99, 70).expect("a view").blind_pixels(), 0);
    // Tangential terms move points sideways, so the edge of what is seen is no circle; no ray beyond it is invented.
    let tilted = Distortion::brown_conrady(&[-0.5, 0.0, 0.02, 0.03]).expect("four");
    let lens = calibrated(tilted).lens(99, 70).expect("a view");
    let tilted = lens.blind_pixels();
    assert!((blind..blind + 500).contains(&tilted), "{tilted} and {blind}");
}

#[test]
fn thin_lenses_are_sharp_at_their_focus() {
    for base in [camera(), calibrated(Distortion::None), all()[4].with_shift(Vec2::new(0.2, 0.1))] {
        let opening = Aperture::new(0.4, 5.0);
        let [sharp, thin] = [Camera { aperture: None, ..base }, base.with_aperture(opening)]
            .map(|camera| camera.lens(64, 48).expect("a view"));
        for i in 0..200 {
            let sampler = Sampler::new(i, i, 1);
            let place = sampler.pair(0);
            let (x, y) = (i * 7 % 64, i * 5 % 48);
            let (origin, direction) = sharp.ray(x, y, place).expect("a ray");
            let focus = origin + direction * (5.0 / -direction.z);
            let through = sampler.two(1.into());
            let place = place.map(Num::from);
            let rays = thin.rays(Num::from(x as f32), Num::from(y as f32), place, Some(through));
            let (start, towards): (Vec3, Vec3) = (rays.origin.into(), rays.direction.into());
            assert!((start - origin).length() <= 0.4001 && (start - origin).z == 0.0);
            let passed = start + towards * ((focus - start).length());
            assert!((passed - focus).length() < 1e-5, "{passed} for {focus}");
        }
    }
}

#[test]
fn apertures_are_covered_evenly() {
    // Mean squared distances from the middle: of a disk r²/2, of a polygon r²/6 · (2 + cos 2π/n).
    for blades in [0, 3, 5, 8] {
        let aperture = Aperture::new(2.0, 1.0).with_blades(blades, 33.0);
        let expected = match blades {
            0 => 2.0,
            n => 4.0 / 6.0 * (2.0 + (std::f32::consts::TAU / n as f32).cos()),
        };
        let (mut squares, mut middle) = (0.0, Vec2::ZERO);
        let samples = 1 << 14;
        for i in 0..samples {
            let [x, y] = aperture.point(Sampler::new(0, i, 2).two(0.into())).map(Num::get);
            squares += (x * x + y * y) / samples as f32;
            middle += Vec2::new(x, y) / samples as f32;
            let corner = if blades == 0 { 1.0 } else { (std::f32::consts::PI / blades as f32).cos() };
            // Seen along the normal of any side, the point lies inside of it.
            for side in 0..blades {
                let angle =
                    33.0_f32.to_radians() + (side as f32 + 0.5) * std::f32::consts::TAU / blades as f32;
                assert!(x * angle.cos() + y * angle.sin() <= 2.0 * corner + 1e-5);
            }
        }
        assert!(
            (squares / expected - 1.0).abs() < 2e-3 && middle.length() < 2e-3,
            "{blades}: {squares} {middle}"
        );
    }
}

#[test]
fn orthographic_rays_are_parallel_and_evenly_spaced() {
    let lens = camera().with_projection(Projection::Orthographic { height: 3.0 }).lens(6, 4).expect("a view");
    let ray = |x, y| lens.ray(x, y, [0.5; 2]).expect("a ray");
    for (x, y) in [(0, 0), (5, 3), (2, 1)] {
        let (origin, direction) = ray(x, y);
        assert_eq!(direction, Vec3::NEG_Z);
        let expected = EYE + Vec3::new((x as f32 - 2.5) * 0.75, (1.5 - y as f32) * 0.75, 0.0);
        assert!((origin - expected).length() < 1e-6, "{origin} for {expected}");
    }
    assert_eq!(lens.cone(), [0.75, 0.0]);
}

#[test]
fn panoramas_see_to_all_sides() {
    let lens = camera().with_projection(Projection::Panorama).lens(8, 4).expect("a view");
    let sees = |x, y, place, expected: Vec3| {
        let (origin, direction) = lens.ray(x, y, place).expect("a ray");
        assert!(origin == EYE && (direction - expected).length() < 1e-6, "{direction} for {expected}");
    };
    sees(4, 2, [0.0; 2], Vec3::NEG_Z);
    sees(6, 2, [0.0; 2], Vec3::X);
    sees(2, 2, [0.0; 2], Vec3::NEG_X);
    sees(0, 2, [0.0; 2], Vec3::Z);
    sees(7, 2, [1.0, 0.0], Vec3::Z);
    sees(1, 0, [0.0; 2], Vec3::Y);
    sees(5, 3, [0.0, 1.0], Vec3::NEG_Y);
}

#[test]
fn shift_moves_the_picture() {
    let [plain, moved] = [Vec2::ZERO, Vec2::new(0.25, 0.5)]
        .map(|shift| camera().with_shift(shift).lens(8, 6).expect("a view"));
    for (x, y) in [(2, 3), (5, 5)] {
        let [a, b] =
            [plain.ray(x, y, [0.5; 2]), moved.ray(x - 2, y, [0.5; 2])].map(|ray| ray.expect("a ray").1);
        let up = plain.ray(x, y - 3, [0.5; 2]).expect("a ray").1;
        assert!((up - b).length() < 1e-6 && (a - b).length() > 0.1, "{up} {b}");
    }
}

#[test]
fn texts_tell_cameras_apart() {
    let texts: std::collections::BTreeSet<String> = all().iter().map(Camera::to_string).collect();
    assert_eq!(texts.len(), all().len());
    let photo = camera().with_shift(Vec2::X).with_aperture(Aperture::new(0.5, 4.0).with_blades(6, 15.0));
    let text = photo.to_string();
    assert!(text.ends_with("fov 40 shift 1,0 aperture 0.5 focus 4 blades 6 rotated 15"), "{text}");
    let barrel = Distortion::brown_conrady(&[0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 1.1, 1.2, 1.3, 1.4]);
    let text = calibrated(barrel.expect("twelve")).to_string();
    let numbers = "K 60,62,49,38 brown-conrady 0.1,0.2,0.5,0.6,0.7,0.8,0.3,0.4,1.1,1.2,1.3,1.4";
    assert!(text.ends_with(numbers), "{text}");
}

#[test]
fn invalid_optics_are_refused() {
    let error = |camera: Camera| camera.lens(8, 8).expect_err("refused");
    let with = |projection| camera().with_projection(projection);
    let k = |fx, cx| Projection::Intrinsics(Intrinsics::new(fx, 1.0, cx, 0.0));
    assert!(matches!(error(with(Projection::Orthographic { height: 0.0 })), CameraError::Height(_)));
    assert!(matches!(error(with(k(0.0, 0.0))), CameraError::Focal { .. }));
    assert!(matches!(error(with(k(1.0, f64::NAN))), CameraError::PrincipalPoint { .. }));
    let fisheye = calibrated(Distortion::Fisheye { k: [f64::INFINITY, 0.0, 0.0, 0.0] });
    assert!(matches!(error(fisheye), CameraError::Distortion(_)));
    assert!(matches!(error(camera().with_shift(Vec2::NAN)), CameraError::Shift(_)));
    assert!(matches!(
        error(with(Projection::Panorama).with_shift(Vec2::X)),
        CameraError::ShiftOf("panorama")
    ));
    let thin = |aperture| error(camera().with_aperture(aperture));
    assert!(matches!(thin(Aperture::new(-1.0, 1.0)), CameraError::ApertureRadius(_)));
    assert!(matches!(thin(Aperture::new(1.0, f32::NAN)), CameraError::FocusDistance(_)));
    assert!(matches!(thin(Aperture::new(1.0, 1.0).with_blades(2, 0.0)), CameraError::Blades(2)));
    let dome = with(Projection::Panorama).with_aperture(Aperture::new(1.0, 1.0));
    assert!(matches!(error(dome), CameraError::ApertureOf("panorama")));
    for matrix in
        [DMat4::from_scale(glam::DVec3::splat(2.0)), DMat4::from_scale(glam::DVec3::new(1.0, 1.0, -1.0))]
    {
        let refused = Camera::calibrated(Intrinsics::new(1.0, 1.0, 0.0, 0.0), &matrix);
        assert_eq!(refused, Err(CameraError::Rigid));
    }
}
