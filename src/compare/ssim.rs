//! Structural similarity (Wang, Bovik, Sheikh and Simoncelli 2004).

use super::plane::{Plane, gaussian};

/// Width and height of the window.
pub const WINDOW: usize = 11;

const DEVIATION: f64 = 1.5;

/// Constants (0.01 L)² and (0.03 L)² that keep the quotient stable, for values up to L = 1.
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// The mean over all windows inside the picture and over the three channels.
pub fn mean(width: usize, height: usize, pictures: [&[[f32; 3]]; 2]) -> f64 {
    let channel = |c: usize| {
        let planes = pictures.map(|pixels| Plane::new(width, pixels.iter().map(|p| p[c].into()).collect()));
        mean_of_channel(width, height, &planes)
    };
    (channel(0) + channel(1) + channel(2)) / 3.0
}

fn mean_of_channel(width: usize, height: usize, [a, b]: &[Plane; 2]) -> f64 {
    let filter = gaussian((WINDOW / 2) as i32, DEVIATION);
    let windowed = |plane: &Plane| plane.filtered(&filter, &filter);
    let means = [windowed(a), windowed(b)];
    let squares = [windowed(&a.times(a)), windowed(&b.times(b))];
    let products = windowed(&a.times(b));
    let border = WINDOW / 2;
    let similarity = |i: usize| {
        let [ma, mb] = means.each_ref().map(|plane| plane.values()[i]);
        let [aa, bb] = squares.each_ref().map(|plane| plane.values()[i]);
        let (va, vb, covariance) = (aa - ma * ma, bb - mb * mb, products.values()[i] - ma * mb);
        (2.0 * ma * mb + C1) * (2.0 * covariance + C2) / ((ma * ma + mb * mb + C1) * (va + vb + C2))
    };
    let inside = (border..height - border).flat_map(|y| (border..width - border).map(move |x| y * width + x));
    let count = (width - 2 * border) * (height - 2 * border);
    inside.map(similarity).sum::<f64>() / count as f64
}
