use super::*;
use crate::flat::FlatPicture;
use crate::tables::crossover::Layers;
use raystream::bvh::Bvh;
use raystream::device::AdapterChoice;
use std::sync::Arc;

/// The fastest adapter, if there is one.
fn gpu() -> Option<Gpu> {
    let choice = AdapterChoice { name: None, allow_software: true };
    match Gpu::open(&choice) {
        Ok(gpu) => Some(gpu),
        Err(GpuError::NoAdapter { .. }) => None,
        Err(error) => panic!("{error}"),
    }
}

#[test]
fn the_rasteriser_and_the_rays_show_the_same_triangles() {
    let Some(gpu) = gpu() else { return };
    for (cells, count) in [(40, 1), (12, 3)] {
        let layers = Layers::new(cells, count);
        let mesh = (&*layers.positions, &*layers.triangles);
        let bvh = Arc::new(Bvh::build(mesh.0, mesh.1, |_| false));
        // The width is no multiple of what rows of a copy are aligned to.
        let size = [250, 240];
        let traced = FlatPicture::new(bvh, &layers.camera, size).expect("a view");
        let seen = triangles_seen(&gpu, mesh, &layers.camera, size).expect("a frame");
        let hits = traced.hits();
        let both = hits.iter().map(|hit| (!hit.is_miss()).then_some(hit.primitive)).zip(seen);
        // Pixels in which either shows a triangle.
        let shown: Vec<_> = both.filter(|pair| *pair != (None, None)).collect();
        let same = shown.iter().filter(|(traced, drawn)| traced == drawn).count();
        assert!(same as f64 >= 0.995 * shown.len() as f64, "{count} layers: {same} of {}", shown.len());
        assert!(shown.len() > hits.len() / 8, "{}", shown.len());

        let mut pixels = vec![0; hits.len()];
        traced.render(&mut pixels);
        let rasteriser = Rasteriser::new(&gpu, mesh, &layers.camera, size).expect("buffers");
        let drawn = rasteriser.picture().expect("a frame");
        // Normals from differences of neighbours have fewer digits.
        let is_near = |(a, b): (&u32, &u32)| (a & 255).abs_diff(b & 255) <= 3 && a >> 24 == b >> 24;
        // At silhouettes the neighbours lie on other triangles, or on none.
        let lit = pixels.iter().zip(&drawn).filter(|(a, b)| (**a | **b) & 255 > 0).count();
        let far = pixels.iter().zip(&drawn).filter(|&pair| !is_near(pair)).count();
        assert!(far as f64 <= 0.05 * lit as f64, "{count} layers: {far} of {lit}");
        for ranges in [layers.near_first(), layers.far_first()] {
            assert!(rasteriser.frame(&ranges).expect("a frame") > 0.0);
        }
    }
}

#[test]
fn what_the_rasteriser_cannot_draw_is_refused_by_name() {
    let Some(gpu) = gpu() else { return };
    let camera = raystream::scene::Camera::new(Vec3::Z, Vec3::ZERO);
    let wide = camera.with_projection(raystream::scene::Projection::Panorama);
    let mesh = (&[Vec3::ZERO, Vec3::X, Vec3::Y][..], &[[0, 1, 2]][..]);
    let refused = Rasteriser::new(&gpu, mesh, &wide, [8, 8]).expect_err("a panorama");
    assert!(refused.to_string().contains("panorama"), "{refused}");
}
