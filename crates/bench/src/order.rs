//! Orders in which the rays of a picture are traced.

use raystream::render::Blocks;

/// Edge of a square of pixels whose rays fill a packet of sixteen.
const SQUARE: u32 = 4;

/// An order of a picture's pixels, and so of the rays that start at them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Order {
    /// Row by row: sixteen neighbours are a strip.
    Rows,
    /// Squares of 4 × 4 pixels, these row by row: sixteen neighbours are a square.
    Squares,
    /// Along the Morton curve.
    Morton,
    /// Blocks of 16 × 16 pixels, each row by row: the order in which frames spawn camera rays.
    Blocks,
    /// At random.
    Shuffled,
}

impl Order {
    /// The orders of rays that follow the picture.
    pub const OF_PICTURE: [Self; 4] = [Self::Rows, Self::Squares, Self::Morton, Self::Blocks];

    /// Its name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rows => "rows",
            Self::Squares => "squares",
            Self::Morton => "morton",
            Self::Blocks => "blocks",
            Self::Shuffled => "shuffled",
        }
    }

    /// The pixels of a picture of `width` × `height` in this order, each as `y × width + x`.
    pub fn pixels(self, width: u32, height: u32) -> Vec<u32> {
        let mut pixels: Vec<u32> = (0..width * height).collect();
        let (x, y) = (|pixel: u32| pixel % width, |pixel: u32| pixel / width);
        match self {
            Self::Rows => {}
            Self::Squares => {
                pixels.sort_by_key(|&p| (y(p) / SQUARE, x(p) / SQUARE, y(p) % SQUARE, x(p) % SQUARE));
            }
            Self::Morton => pixels.sort_by_key(|&p| spread(x(p)) | spread(y(p)) << 1),
            Self::Blocks => {
                let blocks = Blocks::new(width, height);
                let of_block = |&block: &u32| blocks.indices(block).map(|pixel| pixel as u32);
                pixels = blocks.in_order().iter().flat_map(of_block).collect();
            }
            Self::Shuffled => {
                for i in (1..pixels.len()).rev() {
                    pixels.swap(i, raystream::geom::mix(i as u32) as usize % (i + 1));
                }
            }
        }
        pixels
    }
}

/// The bits of a number, each followed by a zero.
fn spread(number: u32) -> u64 {
    let mut bits = u64::from(number);
    for (shift, mask) in [
        (16, 0x0000_ffff_0000_ffff),
        (8, 0x00ff_00ff_00ff_00ff),
        (4, 0x0f0f_0f0f_0f0f_0f0f),
        (2, 0x3333_3333_3333_3333),
        (1, 0x5555_5555_5555_5555),
    ] {
        bits = (bits | bits << shift) & mask;
    }
    bits
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_order_has_every_pixel_once() {
        for order in Order::OF_PICTURE.into_iter().chain([Order::Shuffled]) {
            for (width, height) in [(1, 1), (37, 21), (64, 32)] {
                let mut pixels = order.pixels(width, height);
                if order != Order::Rows && width == 64 {
                    assert!(!pixels.is_sorted(), "{order:?}");
                }
                pixels.sort_unstable();
                assert!(pixels.into_iter().eq(0..width * height), "{order:?}");
            }
        }
    }

    #[test]
    fn sixteen_neighbours_are_a_strip_or_a_square() {
        let first = |order: Order| {
            let pixels = order.pixels(64, 64);
            let last = |of: &dyn Fn(u32) -> u32| pixels[..16].iter().map(|&p| of(p)).max();
            (last(&|p| p % 64), last(&|p| p / 64))
        };
        assert_eq!(first(Order::Rows), (Some(15), Some(0)));
        assert_eq!(first(Order::Blocks), (Some(15), Some(0)));
        assert_eq!(first(Order::Squares), (Some(3), Some(3)));
        assert_eq!(first(Order::Morton), (Some(3), Some(3)));
        assert_eq!(Order::Morton.pixels(4, 4)[..5], [0, 1, 4, 5, 2]);
    }
}
