//! Where the pictures of many views were taken from: a `transforms.json` beside them.

use super::animation::Animation;
use crate::args::RenderArgs;
use crate::stats::FrameStats;
use anyhow::{Context, Result};
use raystream::files;
use raystream::film::picture_files;
use raystream::render::Aov;
use raystream::scene::{Distortion, Intrinsics};
use serde_json::{Value, json};
use std::io::Write;
use std::path::{Path, PathBuf};

/// The file that tells where the pictures were taken from.
pub fn transforms_file(args: &RenderArgs) -> Option<PathBuf> {
    args.spec
        .optics
        .views
        .as_ref()
        .and(args.picture_path())
        .map(|path| path.with_file_name("transforms.json"))
}

/// Writes where the pictures were taken from, beside them: NeRF's `transforms.json` with nerfstudio's keys.
pub fn write_transforms(args: &RenderArgs, animation: &Animation, frames: &[FrameStats]) -> Result<()> {
    let Some(path) = transforms_file(args) else { return Ok(()) };
    let (width, height) = args.spec.size;
    let mut entries = Vec::new();
    for &FrameStats { frame, .. } in frames {
        let Some(file) = animation.picture(frame) else { continue };
        let camera = animation.camera(frame)?;
        let k = camera.intrinsics(width, height).context("views have intrinsics")?;
        let mut entry = lens_entry(&k);
        // Without negative zeros.
        let matrix = camera.to_world()?.transpose().to_cols_array_2d().map(|row| row.map(|x| x + 0.0));
        entry["file_path"] = json!(file_name(&file));
        // Programs that read this file know one unit of depths for all frames.
        let files = picture_files(&file, [Aov::Z.name()], false, &args.spec.encoding.options())?;
        if let Some(depth) =
            files.get(1).filter(|file| file.extension().is_some_and(|format| format == "npy"))
        {
            entry["depth_file_path"] = json!(file_name(depth));
        }
        entry["transform_matrix"] = json!(matrix);
        entries.push(entry);
    }
    // What all frames share is said once.
    let mut whole = json!({ "w": width, "h": height });
    let shared: Vec<String> = entries.first().and_then(Value::as_object).map_or_else(Vec::new, |first| {
        let is_shared = |key: &&String| entries.iter().all(|entry| entry[*key] == first[*key]);
        first.keys().filter(is_shared).filter(|key| !is_of_frame(key)).cloned().collect()
    });
    for key in shared {
        whole[&key] = entries[0][&key].clone();
        entries.iter_mut().filter_map(Value::as_object_mut).for_each(|entry| drop(entry.remove(&key)));
    }
    if let Some(fx) = whole["fl_x"].as_f64() {
        whole["camera_angle_x"] = json!(2.0 * libm::atan(0.5 * f64::from(width) / fx));
    }
    whole["frames"] = Value::Array(entries);
    let text = serde_json::to_vec_pretty(&whole)?;
    files::write(&path, |file| file.write_all(&text))?;
    Ok(())
}

fn is_of_frame(key: &str) -> bool {
    matches!(key, "file_path" | "depth_file_path" | "transform_matrix")
}

fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

/// The keys of a lens.
fn lens_entry(k: &Intrinsics) -> Value {
    let mut entry = json!({ "camera_model": "OPENCV", "fl_x": k.fx, "fl_y": k.fy, "cx": k.cx, "cy": k.cy });
    match k.distortion {
        Distortion::BrownConrady { k: [k1, k2, k3, ..], p: [p1, p2], .. } => {
            for (key, number) in [("k1", k1), ("k2", k2), ("k3", k3), ("p1", p1), ("p2", p2)] {
                entry[key] = json!(number);
            }
        }
        Distortion::Fisheye { k } => {
            entry["camera_model"] = json!("OPENCV_FISHEYE");
            for (key, number) in ["k1", "k2", "k3", "k4"].into_iter().zip(k) {
                entry[key] = json!(number);
            }
        }
        _ => {}
    }
    entry
}
