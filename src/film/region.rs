//! Rectangles of pixels.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::Range;
use std::str::FromStr;

/// A rectangle of a picture's pixels. Its text is `X,Y,W,H`: columns and rows of the whole picture, from its upper left
/// corner.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Region {
    /// The leftmost column.
    pub x: u32,
    /// The uppermost row.
    pub y: u32,
    /// Number of columns.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
}

impl Region {
    /// All pixels of a picture.
    pub const fn whole(width: u32, height: u32) -> Self {
        Self { x: 0, y: 0, width, height }
    }

    /// Its columns.
    pub const fn columns(self) -> Range<u32> {
        self.x..self.x.saturating_add(self.width)
    }

    /// Its rows.
    pub const fn rows(self) -> Range<u32> {
        self.y..self.y.saturating_add(self.height)
    }

    /// Number of pixels.
    pub const fn area(self) -> u64 {
        self.width as u64 * self.height as u64
    }

    /// True if it has a pixel, and all its pixels are in a picture of this size.
    pub fn is_within(self, width: u32, height: u32) -> bool {
        let fits = |start: u32, len: u32, all: u32| start.checked_add(len).is_some_and(|end| end <= all);
        self.area() > 0 && fits(self.x, self.width, width) && fits(self.y, self.height, height)
    }

    /// The region's values of a picture `width` pixels wide, which has `per_pixel` of them a pixel.
    ///
    /// # Panics
    /// If the picture does not have the region.
    pub fn crop<T: Clone>(self, values: &[T], width: u32, per_pixel: usize) -> Vec<T> {
        let row = |y: u32| {
            let start = (y as usize * width as usize + self.x as usize) * per_pixel;
            values[start..start + self.width as usize * per_pixel].iter().cloned()
        };
        self.rows().flat_map(row).collect()
    }
}

impl fmt::Display for Region {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { x, y, width, height } = self;
        write!(f, "{x},{y},{width},{height}")
    }
}

impl FromStr for Region {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        const HELP: &str = "write X,Y,WIDTH,HEIGHT in pixels of the whole picture, as in 0,0,480,270";
        let numbers: Result<Vec<u32>, _> = text.split(',').map(|number| number.trim().parse()).collect();
        match numbers.as_deref() {
            Ok(&[x, y, width, height]) if width > 0 && height > 0 => Ok(Self { x, y, width, height }),
            _ => Err(HELP),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_region_is_four_numbers() {
        let region: Region = "3, 4,5,6".parse().expect("a region");
        assert_eq!(region, Region { x: 3, y: 4, width: 5, height: 6 });
        assert_eq!(region.to_string(), "3,4,5,6");
        for bad in
            ["", "1,2,3", "1,2,3,4,5", "1,2,0,4", "1,2,3,0", "-1,2,3,4", "1,2,3,4.5", "1,2,3,99999999999"]
        {
            assert!(bad.parse::<Region>().is_err(), "{bad}");
        }
    }

    #[test]
    fn a_region_ends_where_its_picture_ends() {
        let region = Region { x: 3, y: 4, width: 5, height: 6 };
        assert!(region.is_within(8, 10) && !region.is_within(7, 10) && !region.is_within(8, 9));
        assert!(!Region { x: u32::MAX, ..region }.is_within(8, 10));
        assert!(!Region { width: 0, ..region }.is_within(8, 10));
        let values: Vec<usize> = (0..2 * 8 * 10).collect();
        let crop = Region { x: 1, y: 2, width: 2, height: 2 }.crop(&values, 8, 2);
        assert_eq!(crop, [34, 35, 36, 37, 50, 51, 52, 53]);
    }
}
