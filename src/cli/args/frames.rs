//! Options of an animation.

use super::view::angle;
use clap::Args;
use std::ops::Range;
use std::path::PathBuf;

/// Options of an animation.
#[derive(Debug, Args)]
pub struct FramesArgs {
    /// Render frames A to B - 1. The output name numbers them, as in out.%04d.png. A frame does not depend on
    /// which others are rendered.
    #[arg(long, value_name = "A..B", allow_hyphen_values = true, value_parser = frame_range)]
    pub frames: Option<Range<u32>>,
    /// Frames, or views, rendered at the same time, so that threads stay busy while the last paths of one frame end.
    /// Each takes memory for its rays and its film.
    #[arg(
        long,
        value_name = "K",
        default_value_t = 3,
        value_parser = clap::value_parser!(u32).range(1..=64)
    )]
    pub frames_in_flight: u32,
    /// Turn the camera around the centre of the scene by this angle per frame.
    #[arg(
        long,
        value_name = "DEG",
        allow_hyphen_values = true,
        requires = "frames",
        conflicts_with = "camera_path",
        value_parser = angle
    )]
    pub turntable: Option<f32>,
    /// Move the camera along the key poses of a .json file.
    #[arg(long, value_name = "FILE", requires = "frames", conflicts_with_all = ["eye", "target", "up", "fov"])]
    pub camera_path: Option<PathBuf>,
    /// Frames per second of the scene's own camera animation (glTF); frame 0 is its start.
    #[arg(
        long,
        value_name = "N",
        default_value_t = 24.0,
        requires = "frames",
        conflicts_with_all = ["turntable", "camera_path"],
        value_parser = rate
    )]
    pub fps: f64,
}

/// `A..B`, at least one frame.
fn frame_range(text: &str) -> Result<Range<u32>, String> {
    range(text, "write FIRST..END, as in 0..20 for frames 0 to 19")
}

/// `A..B`, not empty; `help` says how to write it.
pub(super) fn range(text: &str, help: &str) -> Result<Range<u32>, String> {
    let (a, b) = text.split_once("..").ok_or(help)?;
    let number = |s: &str| s.trim().parse::<u32>().map_err(|e| format!("{s:?}: {e}"));
    let range = number(a)?..number(b)?;
    if range.is_empty() {
        return Err(format!("the range is empty; its end is not rendered: {help}"));
    }
    Ok(range)
}

/// Frames per second.
fn rate(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(fps) if fps.is_normal() && fps > 0.0 => Ok(fps),
        _ => Err("write a positive number of frames per second, as in 24 or 29.97".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_holds_a_frame() {
        assert_eq!(frame_range("3..7"), Ok(3..7));
        for bad in ["3", "3..3", "7..3", "a..b", "-1..3", "3..=7"] {
            assert!(frame_range(bad).is_err(), "{bad}");
        }
    }
}
