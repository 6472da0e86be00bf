//! RTRT's Figure 5: time against the number of triangles. Hills of 1k to 8M triangles, seen whole.

use crate::{Kind, Order, Spread, Workload};
use raystream::bvh::Bvh;
use raystream::lanes::SimdLevel;
use raystream::scene::generate;
use raystream::scene::{Camera, CameraError};
use raystream::stream::{Hit, Tracer};
use raystream::trace::cpu::CpuTracer;
use serde::Serialize;
use std::sync::Arc;
use std::time::Instant;

/// Cells along an edge of each terrain. It has twice the square of them as triangles: 968 to 8 million.
pub const CELLS: [u32; 8] = [22, 70, 224, 500, 707, 1000, 1414, 2000];

/// Results of one terrain.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The figure of RTRT.
    pub configuration: &'static str,
    /// Number of triangles.
    pub triangles: usize,
    /// Edge of the picture, in rays.
    pub resolution: u32,
    /// Seconds of building the tree.
    pub build_s: f64,
    /// Millions of camera rays per second, one thread.
    pub camera_mray_per_s: Spread,
    /// Millions of diffuse bounces per second, one for each camera ray that hit.
    pub bounce_mray_per_s: Spread,
}

/// Measures one terrain for each number of cells along an edge.
///
/// # Errors
/// When the camera gives no view.
pub fn run(cells: &[u32], resolution: u32, rounds: usize) -> Result<Vec<Row>, CameraError> {
    let mut rows = Vec::new();
    for &cells in cells {
        let scene = generate::matte(generate::terrain(cells));
        let started = Instant::now();
        let bvh = Arc::new(Bvh::build(&scene.mesh.positions, &scene.mesh.triangles, |_| false));
        let build_s = started.elapsed().as_secs_f64();
        let tracer =
            CpuTracer::new(bvh.clone(), None, SimdLevel::detect()).expect("what is detected is there");
        let camera = Camera::framing(&bvh.bounds(), 1.0);
        let workload = Workload::new(&scene, &bvh, &tracer, &camera, (resolution, resolution))?;
        let speed = |kind| {
            let rays = workload.rays(kind, Order::Blocks);
            let mut hits = vec![Hit::NONE; rays.len()];
            let rates = (0..=rounds).map(|_| {
                let started = Instant::now();
                tracer.closest(&rays, &mut hits);
                rays.len() as f64 / (started.elapsed().as_secs_f64() * 1e6)
            });
            // The first round warms caches.
            Spread::of_rates(rates.skip(1).collect())
        };
        rows.push(Row {
            configuration: "complexity",
            triangles: scene.mesh.triangles.len(),
            resolution,
            build_s,
            camera_mray_per_s: speed(Kind::Camera),
            bounce_mray_per_s: speed(Kind::Bounce),
        });
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sizes_go_from_a_thousand_to_eight_million() {
        assert_eq!((2 * CELLS[0].pow(2), 2 * CELLS[CELLS.len() - 1].pow(2)), (968, 8_000_000));
        let rows = run(&[10, 20], 32, 2).expect("a view");
        assert_eq!(rows.iter().map(|row| row.triangles).collect::<Vec<_>>(), [200, 800]);
        assert!(
            rows.iter().all(|row| row.camera_mray_per_s.worst > 0.0 && row.bounce_mray_per_s.worst > 0.0)
        );
    }
}
