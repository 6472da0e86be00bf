//! Values of metrics that follow from their definitions.

use super::*;

fn grey(light: f32) -> Vec<[f32; 3]> {
    vec![[light; 3]; 24 * 16]
}

fn pair(a: Vec<[f32; 3]>, b: Vec<[f32; 3]>) -> Pair {
    let content = |pixels| Content::Shown(Image::new(24, 16, pixels));
    Pair::new(content(a), content(b), &Look::default()).expect("equal sizes")
}

#[test]
fn equal_pictures_do_not_differ() {
    let noisy: Vec<_> = (0..24 * 16).map(|i| [i % 7, i % 5, i % 3].map(|n| n as f32 / 8.0)).collect();
    let equal = pair(noisy.clone(), noisy);
    let values = Metric::ALL.map(|metric| equal.measure(metric).expect("large enough"));
    assert_eq!(values[..3], [0.0, 0.0, f64::INFINITY]);
    assert!((values[3] - 1.0).abs() < 1e-12 && values[4] == 0.0, "{values:?}");
}

#[test]
fn constant_pictures_have_known_values() {
    let differing = pair(grey(0.5), grey(0.6));
    let value = |metric| differing.measure(metric).expect("large enough");
    assert!((value(Metric::Psnr) - 20.0).abs() < 1e-5, "a tenth of the peak");
    let luminance = (2.0 * 0.5 * 0.6 + 1e-4) / (0.25 + 0.36 + 1e-4);
    assert!((value(Metric::Ssim) - luminance).abs() < 1e-6);
    let [a, b] = [0.5, 0.6].map(|srgb: f64| libm::pow((srgb + 0.055) / 1.055, 2.4));
    assert!((value(Metric::Mse) - (a - b) * (a - b)).abs() < 1e-7);
    assert!((value(Metric::RelMse) - (a - b) * (a - b) / (a * a + 0.01)).abs() < 1e-6);
}

#[test]
fn black_against_white_is_the_most_that_flip_has_of_lightness() {
    let flip = pair(grey(0.0), grey(1.0)).measure(Metric::Flip).expect("large enough");
    assert!(flip > 0.95 && flip <= 1.0, "{flip}");
    let small = pair(grey(0.5), grey(0.51)).measure(Metric::Flip).expect("large enough");
    assert!(small > 0.0 && small < 0.1, "{small}");
}

#[test]
fn what_is_not_finite_differs_infinitely_unless_it_is_equal() {
    let content = |pixels| Content::Radiance(Image::new(24, 16, pixels));
    let mut broken = grey(0.5);
    broken[3][1] = f32::INFINITY;
    broken[4][1] = f32::NAN;
    let measure = |a: &[[f32; 3]], b: &[[f32; 3]]| {
        let pair =
            Pair::new(content(a.to_vec()), content(b.to_vec()), &Look::default()).expect("equal sizes");
        pair.measure(Metric::Mse).expect("a value")
    };
    assert_eq!((measure(&broken, &broken), measure(&broken, &grey(0.5))), (0.0, f64::INFINITY));
}

#[test]
fn sizes_that_differ_are_refused() {
    let content = |width| Content::Shown(Image::new(width, 1, vec![[0.0; 3]; width as usize]));
    let error = Pair::new(content(2), content(3), &Look::default()).expect_err("sizes differ");
    assert!(error.to_string().contains("2x1 pixels and the test picture 3x1"), "{error}");
    let small = Pair::new(content(2), content(2), &Look::default()).expect("equal sizes");
    assert_eq!(small.measure(Metric::Ssim), Err(CompareError::TooSmall(11)));
    assert_eq!(small.measure(Metric::Flip), Ok(0.0));
}
