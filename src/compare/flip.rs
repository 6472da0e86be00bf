//! ꟻLIP (Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström and Fairchild, HPG 2020): differences as they are seen
//! when two pictures alternate.

use super::plane::{Plane, gaussian};
use std::f64::consts::{PI, SQRT_2};

/// Pixels that a degree of the visual field covers: a display 0.7 m and 3840 pixels wide, seen from 0.7 m.
const PIXELS_PER_DEGREE: f64 = 3840.0 * PI / 180.0;

/// Exponents of colour and feature differences (sections 4.1.3 and 4.2.3).
const COLOUR_EXPONENT: f64 = 0.7;
const FEATURE_EXPONENT: f64 = 0.5;

/// Colour differences below this share of the greatest take this share of the range of errors (section 4.1.3).
const SHARE_OF_COLOURS: f64 = 0.4;
const SHARE_OF_ERRORS: f64 = 0.95;

/// Width of the features that are detected, in degrees (section 4.2.1).
const FEATURE_WIDTH: f64 = 0.082;

/// Linear Rec. 709 to CIE XYZ.
const TO_XYZ: [[f64; 3]; 3] = [
    [10135552.0 / 24577794.0, 8788810.0 / 24577794.0, 4435075.0 / 24577794.0],
    [2613072.0 / 12288897.0, 8788810.0 / 12288897.0, 887015.0 / 12288897.0],
    [1425312.0 / 73733382.0, 8788810.0 / 73733382.0, 70074185.0 / 73733382.0],
];
/// Its inverse.
const FROM_XYZ: [[f64; 3]; 3] = [
    [3.241003275, -1.537398934, -0.498615861],
    [-0.969224334, 1.875930071, 0.041554224],
    [0.055639423, -0.204011202, 1.057148933],
];
/// XYZ of white (D65).
const WHITE: [f64; 3] = [0.950428545, 1.0, 1.088900371];

/// The error of each pixel, from 0 to 1. Pictures are sRGB colours, 0 to 1, the reference first.
pub fn errors(width: usize, pictures: [&[[f32; 3]]; 2]) -> Vec<f64> {
    let opponents = pictures.map(|pixels| opponent_planes(width, pixels));
    let colours = opponents.each_ref().map(seen_colours);
    let features = opponents.each_ref().map(|[lightness, ..]| Features::of(lightness));
    let greatest = greatest_difference();
    let [reference, test] = &colours;
    let pairs = reference.iter().zip(test).enumerate();
    pairs
        .map(|(i, (reference, test))| {
            let colour = redistributed(libm::pow(distance(reference, test), COLOUR_EXPONENT), greatest);
            let feature = features[0].difference(&features[1], i);
            libm::pow(colour, 1.0 - libm::pow(feature / SQRT_2, FEATURE_EXPONENT))
        })
        .collect()
}

fn times(rows: &[[f64; 3]; 3], [a, b, c]: [f64; 3]) -> [f64; 3] {
    rows.map(|[x, y, z]| x * a + y * b + z * c)
}

fn linear(srgb: f64) -> f64 {
    if srgb > 0.04045 { libm::pow((srgb + 0.055) / 1.055, 2.4) } else { srgb / 12.92 }
}

/// The three planes of YCxCz, a linear version of CIELAB.
fn opponent_planes(width: usize, pixels: &[[f32; 3]]) -> [Plane; 3] {
    let mut planes = [(); 3].map(|()| Vec::with_capacity(pixels.len()));
    for pixel in pixels {
        let [x, y, z] = relative_xyz(pixel.map(|channel| linear(channel.into())));
        let opponent = [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)];
        planes.iter_mut().zip(opponent).for_each(|(plane, value)| plane.push(value));
    }
    planes.map(|values| Plane::new(width, values))
}

fn relative_xyz(linear: [f64; 3]) -> [f64; 3] {
    let xyz = times(&TO_XYZ, linear);
    std::array::from_fn(|i| xyz[i] / WHITE[i])
}

/// Colours as eyes at that distance see them (section 4.1.1), in CIELAB with the adjustment of Hunt (4.1.2).
fn seen_colours([y, cx, cz]: &[Plane; 3]) -> Vec<[f64; 3]> {
    // Scales of the Gaussians of the contrast sensitivity functions, and the radius of the widest.
    const BLUE_YELLOW: [(f64, f64); 2] = [(34.1, 0.04), (13.5, 0.025)];
    let deviation = |scale: f64| (scale / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE;
    let radius = (3.0 * deviation(BLUE_YELLOW[0].1)).ceil() as i32;
    let blurred = |plane: &Plane, scale: f64| {
        let filter = gaussian(radius, deviation(scale));
        plane.filtered(&filter, &filter)
    };
    let (y, cx) = (blurred(y, 0.0047), blurred(cx, 0.0053));
    // The share of each Gaussian of the sum of all weights.
    let weights = BLUE_YELLOW.map(|(height, scale)| {
        let row = (-radius..=radius).map(|x| libm::exp(-0.5 * f64::from(x * x) / deviation(scale).powi(2)));
        height * (PI / scale).sqrt() * row.sum::<f64>().powi(2)
    });
    let cz = BLUE_YELLOW.map(|(_, scale)| blurred(cz, scale));
    let mixed = |i: usize| {
        (weights[0] * cz[0].values()[i] + weights[1] * cz[1].values()[i]) / (weights[0] + weights[1])
    };
    let channels = y.values().iter().zip(cx.values()).enumerate();
    channels.map(|(i, (&y, &cx))| hunt_lab(from_opponent([y, cx, mixed(i)]))).collect()
}

/// Linear Rec. 709 of a YCxCz colour, cut to 0 to 1.
fn from_opponent([y, cx, cz]: [f64; 3]) -> [f64; 3] {
    let y = (y + 16.0) / 116.0;
    let relative = [y + cx / 500.0, y, y - cz / 200.0];
    times(&FROM_XYZ, std::array::from_fn(|i| relative[i] * WHITE[i])).map(|channel| channel.clamp(0.0, 1.0))
}

/// CIELAB, with a* and b* scaled by lightness.
fn hunt_lab(linear: [f64; 3]) -> [f64; 3] {
    const EDGE: f64 = 6.0 / 29.0;
    let curve = |t: f64| {
        if t > EDGE.powi(3) { libm::cbrt(t) } else { t / (3.0 * EDGE * EDGE) + 4.0 / 29.0 }
    };
    let [x, y, z] = relative_xyz(linear).map(curve);
    let lightness = 116.0 * y - 16.0;
    [lightness, 0.01 * lightness * 500.0 * (x - y), 0.01 * lightness * 200.0 * (y - z)]
}

/// HyAB: the difference of lightness plus the Euclidean distance of chroma.
fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    (a[0] - b[0]).abs() + libm::hypot(a[1] - b[1], a[2] - b[2])
}

/// The greatest difference of two colours of the gamut: of green and blue.
fn greatest_difference() -> f64 {
    libm::pow(distance(&hunt_lab([0.0, 1.0, 0.0]), &hunt_lab([0.0, 0.0, 1.0])), COLOUR_EXPONENT)
}

/// A colour difference in 0 to 1.
fn redistributed(difference: f64, greatest: f64) -> f64 {
    let bend = SHARE_OF_COLOURS * greatest;
    if difference < bend {
        SHARE_OF_ERRORS / bend * difference
    } else {
        SHARE_OF_ERRORS + (difference - bend) / (greatest - bend) * (1.0 - SHARE_OF_ERRORS)
    }
}

/// Amounts of an edge and of a point in each pixel (section 4.2.1).
struct Features {
    edges: Vec<f64>,
    points: Vec<f64>,
}

impl Features {
    fn of(lightness: &Plane) -> Self {
        let deviation = 0.5 * FEATURE_WIDTH * PIXELS_PER_DEGREE;
        let radius = (3.0 * deviation).ceil() as i32;
        let blur = gaussian(radius, deviation);
        let bell = |x: f64| libm::exp(-0.5 * x * x / (deviation * deviation));
        let first = derivative(radius, |x| -x * bell(x));
        let second = derivative(radius, |x| (x * x / (deviation * deviation) - 1.0) * bell(x));
        let magnitude = |filter: &[f64]| {
            // A constant does not matter: the lightness is scaled only.
            let (x, y) = (lightness.filtered(filter, &blur), lightness.filtered(&blur, filter));
            let lengths = x.values().iter().zip(y.values()).map(|(&x, &y)| libm::hypot(x, y) / 116.0);
            lengths.collect()
        };
        Self { edges: magnitude(&first), points: magnitude(&second) }
    }

    fn difference(&self, other: &Self, i: usize) -> f64 {
        (self.edges[i] - other.edges[i]).abs().max((self.points[i] - other.points[i]).abs())
    }
}

/// A filter whose positive weights sum to 1, and whose negative ones to −1.
fn derivative(radius: i32, weight: impl Fn(f64) -> f64) -> Vec<f64> {
    let weights: Vec<f64> = (-radius..=radius).map(|x| weight(f64::from(x))).collect();
    let sum = |sign: f64| weights.iter().map(|weight| (sign * weight).max(0.0)).sum::<f64>();
    let (positive, negative) = (sum(1.0), sum(-1.0));
    weights.iter().map(|&weight| weight / if weight > 0.0 { positive } else { negative }).collect()
}
