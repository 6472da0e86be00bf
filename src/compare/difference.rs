//! Pictures of differences.

use super::{Pair, subtract};
use crate::film::Image;

/// The difference in linear radiance: test − reference, channel by channel.
pub fn radiance_difference(pair: &Pair) -> Image {
    subtract(pair.width, pair.height, &pair.radiance)
}

/// ꟻLIP's errors in the colours of magma, black for 0 and light yellow for 1, to be shown by
/// [`View::Raw`](crate::film::View::Raw).
pub fn flip_colours(pair: &Pair) -> Image {
    let pixels = pair.flip_map().into_iter().map(magma).collect();
    Image::new(pair.width as u32, pair.height as u32, pixels)
}

/// The colour map magma (Smith and van der Walt 2015), by a polynomial through its table (Zucker 2019).
fn magma(share: f64) -> [f32; 3] {
    const TERMS: [[f64; 3]; 7] = [
        [-0.002136485053939582, -0.000749655052795221, -0.005386127855323933],
        [0.2516605407371642, 0.6775232436837668, 2.494026599312351],
        [8.353717279216625, -3.577719514958484, 0.3144679030132573],
        [-27.66873308576866, 14.26473078096533, -13.64921318813922],
        [52.17613981234068, -27.94360607168351, 12.94416944238394],
        [-50.76852536473588, 29.04658282127291, 4.23415299384598],
        [18.65570506591883, -11.48977351997711, -5.601961508734096],
    ];
    let horner = |i: usize| TERMS.iter().rev().fold(0.0, |value, terms| value * share + terms[i]);
    std::array::from_fn(|i| horner(i).clamp(0.0, 1.0) as f32)
}
