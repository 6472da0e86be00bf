//! The resolution of a picture while the camera moves.

use std::time::Duration;

/// The time that is aimed at, until the picture is handed to the encoder. What is left of a tenth of a second is for
/// the encoder, which runs beside the next frame, and for what varies between frames.
const AIM: Duration = Duration::from_millis(55);

/// The time that is aimed at for the first frame after a rest: the view is to react at once.
const FIRST_AIM: Duration = Duration::from_millis(14);

/// The least share of width and height.
const LEAST_SHARE: f64 = 0.25;

/// The greatest increase of the share from one frame to the next.
const GROWTH: f64 = 1.25;

/// A frame whose time is this close to the aim, as a factor, leaves the share as it is: a picture whose sharpness
/// changes with every frame is unpleasant.
const TOLERANCE: f64 = 1.2;

/// Chooses the size of moving frames from the time that earlier ones took. A value is never changed: each frame's time
/// leads to the next value.
///
/// The time of a frame is taken as proportional to its number of pixels. A frame that took too long lowers the share at
/// once; one that was quick raises it by steps. The first frame after a rest has a smaller share than those that
/// follow.
///
/// ```
/// use raystream_service::live::Resolution;
/// use std::time::Duration;
///
/// let mut resolution = Resolution::default();
/// assert_eq!(resolution.size([1280, 720]), [320, 180], "the first frame is the smallest");
/// resolution = resolution.after(Duration::from_millis(10));
/// assert!(resolution.share() > 0.25);
/// resolution = resolution.after(Duration::from_secs(2));
/// assert_eq!(resolution.share(), 0.25);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resolution {
    /// The share of frames that follow each other.
    flowing: f64,
    /// True if the next frame is the first after a rest.
    is_first: bool,
}

impl Default for Resolution {
    /// The smallest frames.
    fn default() -> Self {
        Self { flowing: LEAST_SHARE, is_first: true }
    }
}

impl Resolution {
    /// Share of the full width and height of the next moving frame, 0.25 to 1.
    pub fn share(self) -> f64 {
        if self.is_first { (self.flowing * first_factor()).max(LEAST_SHARE) } else { self.flowing }
    }

    /// The resolution when the camera has come to rest.
    pub fn rested(self) -> Self {
        Self { is_first: true, ..self }
    }

    /// Width and height of the next moving frame of a picture of this size: at least a quarter of it, at least 1.
    pub fn size(self, full: [u32; 2]) -> [u32; 2] {
        full.map(|side| ((f64::from(side) * self.share()).ceil() as u32).clamp(1, side.max(1)))
    }

    /// The resolution after a frame of this one that took `time`.
    pub fn after(self, time: Duration) -> Self {
        // The time that a frame after it would have taken.
        let flowing_s = time.as_secs_f64() * (self.flowing / self.share()).powi(2);
        let ratio = AIM.as_secs_f64() / flowing_s.max(1e-6);
        let is_close = (1.0 / TOLERANCE..=TOLERANCE).contains(&ratio);
        let change = if is_close { 1.0 } else { ratio.sqrt().min(GROWTH) };
        Self { flowing: (self.flowing * change).clamp(LEAST_SHARE, 1.0), is_first: false }
    }
}

/// The share of a first frame, divided by that of the frames that follow.
fn first_factor() -> f64 {
    (FIRST_AIM.as_secs_f64() / AIM.as_secs_f64()).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The resolution after many frames on a machine that takes this long for the full picture.
    fn after_many(full_s: f64) -> (Resolution, f64) {
        let mut resolution = Resolution::default();
        let time = |resolution: Resolution| full_s * resolution.share() * resolution.share();
        for _ in 0..40 {
            resolution = resolution.after(Duration::from_secs_f64(time(resolution)));
        }
        (resolution, time(resolution))
    }

    #[test]
    fn frames_take_at_most_a_tenth_of_a_second_where_that_is_possible() {
        for full_s in [0.01, 0.05, 0.08, 0.2, 0.5, 1.0, 1.5] {
            let (resolution, frame_s) = after_many(full_s);
            assert!(frame_s <= 0.1, "{full_s} s: {resolution:?} takes {frame_s} s");
            assert!(
                frame_s > 0.04 || resolution.share() == 1.0,
                "{full_s} s: {resolution:?} could be sharper"
            );
        }
    }

    #[test]
    fn the_share_stays_between_a_quarter_and_one() {
        for full_s in [1e-6, 3.0, 60.0] {
            let (resolution, _) = after_many(full_s);
            assert!((LEAST_SHARE..=1.0).contains(&resolution.share()), "{full_s} s");
        }
        assert_eq!(after_many(60.0).0.share(), LEAST_SHARE);
        assert_eq!(Resolution::default().after(Duration::ZERO).share(), LEAST_SHARE * GROWTH);
    }

    #[test]
    fn one_slow_frame_lowers_the_share_at_once() {
        let (quick, _) = after_many(0.05);
        assert_eq!(quick.share(), 1.0);
        let slower = quick.after(4 * AIM);
        assert_eq!(slower.share(), 0.5);
    }

    #[test]
    fn a_share_near_the_aim_does_not_change() {
        let (resolution, frame_s) = after_many(0.5);
        for factor in [0.9, 1.0, 1.1] {
            assert_eq!(resolution.after(AIM.mul_f64(factor)), resolution, "{frame_s} s");
        }
    }

    #[test]
    fn the_first_frame_after_a_rest_is_quick_and_changes_what_follows_by_little() {
        for full_s in [0.08, 0.2, 0.25] {
            let (resolution, _) = after_many(full_s);
            let first = resolution.rested();
            let first_s = full_s * first.share() * first.share();
            assert!(first_s <= 0.03, "{full_s} s: the first frame takes {first_s} s");
            let next = first.after(Duration::from_secs_f64(first_s));
            assert!(
                (next.share() / resolution.share() - 1.0).abs() < 1e-9,
                "{full_s} s: {resolution:?}, {next:?}"
            );
        }
        assert_eq!(after_many(60.0).0.rested().share(), LEAST_SHARE);
    }

    #[test]
    fn sizes_are_never_below_a_quarter_or_one() {
        let least = Resolution::default();
        assert_eq!(least.size([1281, 719]), [321, 180]);
        assert_eq!(least.size([1, 2]), [1, 1]);
    }
}
