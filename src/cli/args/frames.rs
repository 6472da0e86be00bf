//! Several pictures after each other.

use clap::Args;
use std::ops::Range;
use std::path::PathBuf;

/// Pictures after each other.
#[derive(Debug, Args)]
pub struct FramesArgs {
    /// Render frames A, A+1, ... up to but without B; -o then numbers them, as in out.%04d.png. Each frame is the
    /// same whichever others are rendered.
    #[arg(long, value_name = "A..B", value_parser = frame_range)]
    pub frames: Option<Range<u32>>,
    /// Frames in flight at a time: the next ones keep the threads busy while the last paths of one end. Each takes
    /// memory for its rays and its film.
    #[arg(
        long,
        value_name = "K",
        default_value_t = 3,
        requires = "frames",
        value_parser = clap::value_parser!(u32).range(1..=64)
    )]
    pub frames_in_flight: u32,
    /// Turn the camera around the middle of the scene, by so much from one frame to the next.
    #[arg(
        long,
        value_name = "DEG",
        allow_hyphen_values = true,
        requires = "frames",
        conflicts_with = "camera_path"
    )]
    pub turntable: Option<f32>,
    /// Move the camera through the key poses of a .json file.
    #[arg(long, value_name = "FILE", requires = "frames", conflicts_with_all = ["eye", "target", "up", "fov"])]
    pub camera_path: Option<PathBuf>,
    /// Frames a second, where the camera moves as the scene's glTF animation says: frame 0 is its beginning.
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
    let (a, b) = text.split_once("..").ok_or("write FIRST..END, as in 0..20 for the frames 0 to 19")?;
    let number = |s: &str| s.trim().parse::<u32>().map_err(|e| format!("{s:?}: {e}"));
    let range = number(a)?..number(b)?;
    if range.is_empty() {
        return Err(
            "there is no frame in it; the end is not rendered, so 0..20 are the frames 0 to 19".into()
        );
    }
    Ok(range)
}

/// Frames a second.
fn rate(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(fps) if fps.is_normal() && fps > 0.0 => Ok(fps),
        _ => Err("write how many frames a second has, as in 24 or 29.97".into()),
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
