//! The host's half of a dispatch: candidates become canonical answers.

use super::layout::UNDECIDED;
use crate::bvh::Bvh;
use crate::geom::CanonicalRay;
use crate::stream::{DeviceReport, Hit, MISS, Ray, Tracer};

/// Evaluates every candidate canonically; has `cpu` trace the rays whose answer is undecided, or
/// whose candidate the canonical test refuses (which a sound device never gives).
pub(super) fn closest(
    bvh: &Bvh,
    cpu: &dyn Tracer,
    rays: &[Ray],
    candidates: &[u32],
    hits: &mut [Hit],
) -> DeviceReport {
    let mut report = DeviceReport::default();
    let mut open = Vec::new();
    for (index, ((ray, &candidate), hit)) in rays.iter().zip(candidates).zip(&mut *hits).enumerate() {
        match candidate {
            MISS => *hit = Hit::NONE,
            UNDECIDED => {
                report.flagged += 1;
                open.push(index);
            }
            primitive => match canonical(bvh, ray, primitive) {
                Some(found) => *hit = found,
                None => open.push(index),
            },
        }
    }
    report.retraced = open.len() as u64;
    if !open.is_empty() {
        let again: Vec<Ray> = open.iter().map(|&index| rays[index]).collect();
        let mut answers = vec![Hit::NONE; again.len()];
        cpu.closest(&again, &mut answers);
        for (&index, answer) in open.iter().zip(answers) {
            hits[index] = answer;
        }
    }
    report
}

/// The same for occlusion, whose candidates are 1, 0 or undecided.
pub(super) fn occluded(
    cpu: &dyn Tracer,
    rays: &[Ray],
    candidates: &[u32],
    occluded: &mut [u32],
) -> DeviceReport {
    let open: Vec<usize> = (0..rays.len()).filter(|&index| candidates[index] > 1).collect();
    occluded.copy_from_slice(candidates);
    if !open.is_empty() {
        let again: Vec<Ray> = open.iter().map(|&index| rays[index]).collect();
        let mut answers = vec![0; again.len()];
        cpu.occluded(&again, &mut answers);
        for (&index, answer) in open.iter().zip(answers) {
            occluded[index] = answer;
        }
    }
    let open = open.len() as u64;
    DeviceReport { bytes_copied: 0, flagged: open, retraced: open }
}

fn canonical(bvh: &Bvh, ray: &Ray, primitive: u32) -> Option<Hit> {
    if primitive as usize >= bvh.len() {
        return None;
    }
    let prepared = CanonicalRay::new(ray.origin, ray.t_min, ray.direction, ray.t_max, bvh.scene_max_abs());
    let [v0, v1, v2] = bvh.corners(primitive);
    prepared.triangle(v0, v1, v2).map(|hit| Hit { t: hit.t, u: hit.u, v: hit.v, primitive })
}
