//! A moving frame that several machines render.

use super::decisions::{self, COARSE};
use super::encoder::SharedPicture;
use super::tile_dispatch::Split;
use crate::contract::Tile;
use raystream::film::{Image, Light, Look};
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

/// Rows as they are shown.
#[derive(Clone, Debug)]
pub(super) enum Rows {
    /// Radiance, which is to be encoded.
    Radiance(Image),
    /// A JPEG of a worker.
    Jpeg(Arc<Vec<u8>>),
}

#[derive(Debug)]
struct Slot {
    rows: Range<u32>,
    /// True if the rows will not come.
    is_lost: bool,
    content: Option<Rows>,
}

/// A frame under way. It has come whole in parts from several machines, at its deadline at the latest; what is missing
/// then is rendered here, coarsely.
#[derive(Debug)]
pub(super) struct SharedFrame {
    number: u64,
    size: [u32; 2],
    /// With an exposure in stops.
    look: Look,
    split: Split,
    deadline: Instant,
    own: Option<Image>,
    slots: Vec<Slot>,
    /// The rows of the coarse frame under way.
    filling: Option<Range<u32>>,
    /// True if coarse rows stand in for some.
    is_coarse: bool,
    /// True if the exposure of the next frame follows from this one.
    is_metered: bool,
    light: Light,
}

impl SharedFrame {
    /// The same frame, with which the exposure of the next one is measured or not.
    pub fn metered(self, is_metered: bool) -> Self {
        Self { is_metered, ..self }
    }

    /// A frame with a number. Nothing of it has come.
    pub fn new(number: u64, size: [u32; 2], look: Look, split: Split, deadline: Instant) -> Self {
        let slot =
            |(_, rows): &(String, Range<u32>)| Slot { rows: rows.clone(), is_lost: false, content: None };
        let slots = split.tiles.iter().map(slot).collect();
        Self {
            number,
            size,
            look,
            split,
            deadline,
            own: None,
            slots,
            filling: None,
            is_coarse: false,
            is_metered: false,
            light: Light::default(),
        }
    }

    /// The frame's number.
    pub fn number(&self) -> u64 {
        self.number
    }

    /// The division of its rows among the coordinator and workers.
    pub fn split(&self) -> &Split {
        &self.split
    }

    /// The time at which it is to be ready.
    pub fn deadline(&self) -> Instant {
        self.deadline
    }

    /// True if it waits for others alone.
    pub fn waits(&self) -> bool {
        self.own.is_some() && self.filling.is_none()
    }

    /// True if its own rows are under way.
    pub fn waits_for_own(&self) -> bool {
        self.own.is_none()
    }

    /// Takes what a job of this process has rendered: its own rows, or coarse ones. Returns the number of own rows.
    pub fn take(&mut self, image: Image) -> Option<u32> {
        let Some(rows) = self.filling.take() else {
            let rows = image.height;
            if self.is_metered {
                self.light = self.light.and(Light::of(&image));
            }
            self.own = Some(image);
            return Some(rows);
        };
        for slot in self.slots.iter_mut().filter(|slot| slot.content.is_none()) {
            self.is_coarse = true;
            slot.content = Some(Rows::Radiance(enlarged(&image, &rows, self.size, &slot.rows)));
        }
        None
    }

    /// Takes rows of a worker.
    pub fn put(&mut self, tile: Tile) {
        let slot = self.slots.iter_mut().find(|slot| slot.rows == tile.rows && slot.content.is_none());
        if let Some(slot) = slot {
            let (lightness, pixels) = tile.light;
            self.light = self.light.and(Light { lightness, pixels });
            slot.content = Some(Rows::Jpeg(tile.jpeg));
        }
    }

    /// These rows will not come.
    pub fn lose(&mut self, rows: &Range<u32>) {
        self.slots.iter_mut().filter(|slot| slot.rows == *rows).for_each(|slot| slot.is_lost = true);
    }

    /// The rows that have not come.
    pub fn missing(&self) -> Vec<Range<u32>> {
        self.slots.iter().filter(|slot| slot.content.is_none()).map(|slot| slot.rows.clone()).collect()
    }

    /// True if all rows are there.
    pub fn is_complete(&self) -> bool {
        self.own.is_some() && self.slots.iter().all(|slot| slot.content.is_some())
    }

    /// True if what is missing is to be rendered here now.
    pub fn is_due(&self) -> bool {
        let is_late = Instant::now() >= self.deadline;
        let is_decided = |slot: &Slot| slot.content.is_some() || slot.is_lost || is_late;
        self.waits() && !self.is_complete() && self.slots.iter().all(is_decided)
    }

    /// True if coarse rows stand in for some that did not come.
    pub fn is_coarse(&self) -> bool {
        self.is_coarse
    }

    /// The size of a coarse frame, and its rows that cover what is missing.
    pub fn fill(&mut self) -> Option<([u32; 2], Range<u32>)> {
        let missing = self.missing();
        let all = missing.first()?.start..missing.last()?.end;
        let (size, rows) = decisions::coarse(self.size, &all);
        self.filling = Some(rows.clone());
        Some((size, rows))
    }

    /// The picture, once all rows are there.
    pub fn into_picture(self) -> SharedPicture {
        let own = self.own.map(Rows::Radiance);
        let others = self.slots.into_iter().filter_map(|slot| Some((slot.rows.start, slot.content?)));
        let mut parts: Vec<(u32, Rows)> =
            own.map(|own| (self.split.own.start, own)).into_iter().chain(others).collect();
        parts.sort_by_key(|part| part.0);
        SharedPicture {
            size: self.size,
            look: self.look,
            light: self.light,
            parts: parts.into_iter().map(|part| part.1).collect(),
        }
    }
}

/// Rows of a picture of this size from a coarse one; `image` has its rows `from`.
fn enlarged(image: &Image, from: &Range<u32>, [width, height]: [u32; 2], rows: &Range<u32>) -> Image {
    let coarse = [width, height].map(|side| side.div_ceil(COARSE));
    let at = |place: u32, side: u32, of: u32| (u64::from(place) * u64::from(side) / u64::from(of)) as u32;
    let pixel = |x: u32, y: u32| {
        let (column, row) = (at(x, coarse[0], width), at(y, coarse[1], height));
        let row = row.clamp(from.start, from.end - 1) - from.start;
        image.pixels[(row * image.width + column.min(image.width - 1)) as usize]
    };
    let pixels =
        rows.clone().flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| pixel(x, y)).collect();
    Image::new(width, rows.len() as u32, pixels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn frame() -> SharedFrame {
        let tiles = vec![("a".to_owned(), 16..48), ("b".to_owned(), 48..70)];
        let deadline = Instant::now() + Duration::from_secs(60);
        SharedFrame::new(3, [40, 70], Look::default(), Split { own: 0..16, tiles }, deadline)
    }

    fn image(width: u32, height: u32, light: f32) -> Image {
        Image::new(width, height, vec![[light; 3]; (width * height) as usize])
    }

    fn tile(rows: Range<u32>) -> Tile {
        Tile { rows, light: (2.0, 1), seconds: 0.0, jpeg: Arc::new(vec![7]) }
    }

    #[test]
    fn a_frame_is_complete_with_all_parts_in_any_order() {
        let mut shared = frame().metered(true);
        shared.put(tile(48..70));
        assert!(!shared.waits() && !shared.is_complete());
        assert_eq!(shared.take(image(40, 16, 0.5)), Some(16));
        assert!(shared.waits() && !shared.is_due(), "there is time");
        shared.put(tile(16..32));
        assert_eq!(shared.missing().first(), Some(&(16..48)), "no one was asked for these rows");
        shared.put(tile(16..48));
        assert!(shared.is_complete() && !shared.is_due() && !shared.is_coarse());
        let picture = shared.into_picture();
        assert!(matches!(&picture.parts[..], [Rows::Radiance(_), Rows::Jpeg(_), Rows::Jpeg(_)]));
        assert_eq!(picture.light.pixels, 40 * 16 + 2);
    }

    #[test]
    fn what_is_lost_is_filled_at_once_and_what_is_late_at_the_deadline() {
        let mut shared = frame();
        shared.take(image(40, 16, 0.5));
        shared.put(tile(16..48));
        assert!(!shared.is_due());
        shared.lose(&(48..70));
        assert!(shared.is_due(), "no one is waited for");
        let mut late = frame();
        late.deadline = Instant::now();
        late.take(image(40, 16, 0.5));
        assert!(late.is_due());
        assert_eq!(late.fill(), Some(([10, 18], 4..18)));
        assert!(!late.waits() && !late.is_due(), "it is being filled");
        late.put(tile(16..48));
        assert_eq!(late.take(image(10, 14, 0.25)), None);
        assert!(late.is_complete() && late.is_coarse());
        let parts = late.into_picture().parts;
        assert!(matches!(&parts[1], Rows::Jpeg(_)), "what comes while it is filled is shown");
        assert!(matches!(&parts[2], Rows::Radiance(filled) if *filled == image(40, 22, 0.25)));
    }

    #[test]
    fn coarse_rows_lie_where_the_fine_ones_would() {
        let coarse = Image::new(2, 3, (0..6).map(|i| [i as f32; 3]).collect());
        // Rows 4 to 6 of a coarse frame of 2 x 8 pixels.
        let fine = enlarged(&coarse, &(4..7), [8, 32], &(16..28));
        let row = |y: usize| (fine.pixels[8 * y][0], fine.pixels[8 * y + 7][0]);
        assert_eq!([row(0), row(3), row(4), row(11)], [(0.0, 1.0), (0.0, 1.0), (2.0, 3.0), (4.0, 5.0)]);
    }
}
