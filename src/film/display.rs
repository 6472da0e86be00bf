//! From radiance to the bytes of a display, quickly.

use super::{Exposure, Image, Look, View};
use std::sync::OnceLock;

/// The stops that the table covers: black below, white above.
const LEAST_STOP: f32 = -13.0;
const GREATEST_STOP: f32 = 7.0;

/// Nodes of the table for each stop.
const PER_STOP: usize = 3;

/// Nodes of the table along each axis.
const NODES: usize = (GREATEST_STOP - LEAST_STOP) as usize * PER_STOP + 1;

/// A view transform with its transfer function as a table over the logarithm of each channel, interpolated linearly
/// between nodes. A picture file is shown by [`Look::encode`] itself. A live frame is shown by the table, which takes a
/// tenth of the time. It is off by less than a step of a byte on average, by at most 12 in colours so saturated that
/// the view cuts them.
#[derive(Debug)]
pub struct DisplayTable {
    view: View,
    nodes: Vec<[f32; 3]>,
}

impl DisplayTable {
    /// The table of a view, which the first call makes.
    pub fn of(view: View) -> &'static Self {
        static TABLES: [OnceLock<DisplayTable>; View::ALL.len()] =
            [const { OnceLock::new() }; View::ALL.len()];
        let index = View::ALL.iter().position(|&other| other == view).expect("all views are listed");
        TABLES[index].get_or_init(|| Self::new(view))
    }

    fn new(view: View) -> Self {
        let radiance = |node: usize| match node {
            0 => 0.0,
            _ => libm::exp2f(LEAST_STOP + node as f32 / PER_STOP as f32),
        };
        let mut radiances = Vec::with_capacity(NODES.pow(3));
        for (b, g, r) in
            (0..NODES).flat_map(|b| (0..NODES).flat_map(move |g| (0..NODES).map(move |r| (b, g, r))))
        {
            radiances.push([r, g, b].map(radiance));
        }
        let image = Image::new((NODES * NODES) as u32, NODES as u32, radiances);
        let shown: Vec<f32> = Look::default().with_view(view).encode(&image).collect();
        Self { view, nodes: shown.as_chunks().0.to_vec() }
    }

    /// Red, green and blue of each pixel in a look, which has the table's view.
    pub fn bytes(&self, image: &Image, look: &Look) -> Vec<u8> {
        debug_assert_eq!(look.view(), self.view);
        let stops = look.with_exposure(Exposure::Stops(look.stops(image))).stops(image);
        let gain = libm::exp2f(stops);
        let mut bytes = vec![0; 3 * image.pixels.len()];
        // No `map` of arrays, here and below: it is no inlined loop.
        for (shown, &[r, g, b]) in bytes.as_chunks_mut().0.iter_mut().zip(&image.pixels) {
            *shown = self.at([place(r * gain), place(g * gain), place(b * gain)]);
        }
        bytes
    }

    /// The bytes at a place of the table, in nodes.
    #[inline(always)]
    fn at(&self, place: [f32; 3]) -> [u8; 3] {
        let (mut cell, mut share) = ([0; 3], [0.0; 3]);
        for axis in 0..3 {
            cell[axis] = (place[axis] as usize).min(NODES - 2);
            share[axis] = place[axis] - cell[axis] as f32;
        }
        let first = cell[0] + NODES * (cell[1] + NODES * cell[2]);
        let [r, g, b] = mix(self.face(first, share), self.face(first + NODES * NODES, share), share[2]);
        let byte = |light: f32| (light * 255.0 + 0.5) as u8;
        [byte(r), byte(g), byte(b)]
    }

    #[inline(always)]
    fn face(&self, at: usize, share: [f32; 3]) -> [f32; 3] {
        let nodes = &self.nodes;
        let near = mix(nodes[at], nodes[at + 1], share[0]);
        mix(near, mix(nodes[at + NODES], nodes[at + NODES + 1], share[0]), share[1])
    }
}

#[inline(always)]
fn mix(a: [f32; 3], b: [f32; 3], share: f32) -> [f32; 3] {
    [a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share, a[2] + (b[2] - a[2]) * share]
}

/// The place of a radiance along an axis of the table, in nodes.
#[inline(always)]
fn place(radiance: f32) -> f32 {
    // NaN is black.
    let radiance = if radiance > 0.0 { radiance } else { 0.0 };
    ((log2(radiance) - LEAST_STOP) * PER_STOP as f32).clamp(0.0, (NODES - 1) as f32)
}

/// The binary logarithm of a positive number to three decimal places; about −127 for 0.
#[inline(always)]
fn log2(x: f32) -> f32 {
    let bits = x.to_bits();
    let exponent = (bits >> 23) as f32 - 127.0;
    let m = f32::from_bits(bits & 0x007f_ffff | 0x3f80_0000) - 1.0;
    // Zero error at both ends of an octave, so that there is no step between two.
    exponent + m * (1.441_479 + m * (-0.707_254 + m * (0.411_415 + m * (-0.189_284 + m * 0.043_644))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logarithms_are_right_to_three_places() {
        for step in 0..4000 {
            let x = libm::exp2f(-14.0 + step as f32 / 180.0);
            assert!((log2(x) - libm::log2f(x)).abs() < 1e-3, "{x}: {}", log2(x));
        }
        assert_eq!(place(f32::NAN), 0.0);
        assert_eq!(place(-1.0), 0.0);
        assert_eq!(place(f32::INFINITY), (NODES - 1) as f32);
    }

    #[test]
    fn tables_show_what_looks_show() {
        let channel = |i: u32| {
            let hash = i.wrapping_mul(0x9e37_79b9) ^ (i.wrapping_mul(0x85eb_ca6b) >> 13);
            libm::exp2f(-10.0 + 15.0 * (hash >> 8) as f32 / (1 << 24) as f32)
        };
        let pixels: Vec<[f32; 3]> = (0..3000).map(|i| [3 * i, 3 * i + 1, 3 * i + 2].map(channel)).collect();
        let image = Image::new(3000, 1, pixels);
        for view in View::ALL {
            let look = Look::default().with_view(view).with_exposure(Exposure::Stops(-0.5));
            let shown = DisplayTable::new(view).bytes(&image, &look);
            let exact = look.encode(&image).map(|light| (light * 255.0 + 0.5) as u8);
            let steps: Vec<u32> = shown.iter().zip(exact).map(|(&a, b)| a.abs_diff(b).into()).collect();
            let mean = f64::from(steps.iter().sum::<u32>()) / steps.len() as f64;
            assert!(
                mean < 1.0 && steps.iter().max() <= Some(&12),
                "{}: {mean}, {:?}",
                view.name(),
                steps.iter().max()
            );
        }
    }
}
