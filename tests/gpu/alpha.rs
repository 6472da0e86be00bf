//! Alpha, which the device decides where a table says how.

use crate::{compare, meshes, rays, shared, trace};
use glam::{Vec2, Vec3, Vec4};
use raystream::bvh::{Bvh, Filter};
use raystream::device::Gpu;
use raystream::scene::{
    AlphaMode, Averaging, Channel, ColourSpace, Material, Mipmap, Scene, Texture, TextureRef, TriangleMesh,
    Wrap,
};
use raystream::stream::Ray;
use raystream::trace::cpu::Oracle;
use raystream::trace::gpu::GpuTracer;
use std::sync::Arc;

/// An image of noise with mipmap levels, which are none of alpha's business.
fn texture(
    width: u32,
    height: u32,
    space: ColourSpace,
    [wrap_u, wrap_v]: [Wrap; 2],
    mean: Averaging,
) -> Texture {
    let mut random = meshes::Random::new(u64::from(width * 31 + height));
    let texels = (0..width * height).map(|_| [0; 4].map(|_: u8| random.below(256) as u8));
    let mut texture = Texture {
        name: String::new(),
        width,
        height,
        texels: texels.collect(),
        space,
        wrap_u,
        wrap_v,
        mipmap: Mipmap::default(),
    };
    texture.add_mipmap(mean);
    texture
}

/// A mesh of materials with every mode, channel, addressing and transform, on two sets of texture coordinates, with
/// vertex colours if asked.
fn scene(has_colours: bool, factor: f32) -> Scene {
    let soup = meshes::soup(2000, 0.15, 21);
    let mut mesh = TriangleMesh::new(soup.positions, soup.triangles);
    let mut random = meshes::Random::new(22);
    let vertices = mesh.positions.len();
    let mut uv = |scale: f32| (0..vertices).map(|_| scale * random.point().truncate()).collect::<Vec<Vec2>>();
    (mesh.uvs, mesh.more_uvs) = (uv(1.0), vec![uv(40.0)]);
    if has_colours {
        mesh.colours = mesh.uvs.iter().map(|uv| Vec4::new(0.0, 0.5, 1.0, uv.x.abs())).collect();
    }
    let textures = vec![
        texture(16, 9, ColourSpace::Srgb, [Wrap::Repeat, Wrap::Mirror], Averaging::Light),
        texture(5, 12, ColourSpace::Linear, [Wrap::Clamp, Wrap::Repeat], Averaging::Light),
        texture(1, 1, ColourSpace::Srgb, [Wrap::Mirror, Wrap::Clamp], Averaging::Light),
        texture(6, 6, ColourSpace::Linear, [Wrap::Repeat, Wrap::Repeat], Averaging::Normals),
    ];
    let channels = [Channel::R, Channel::G, Channel::B, Channel::A, Channel::Luminance];
    let materials = (0..60usize).map(|kind| {
        let mut material = Material::fallback();
        let alpha = &mut material.alpha;
        alpha.mode = match kind % 5 {
            0 => AlphaMode::Opaque,
            1 | 2 => AlphaMode::Mask { cutoff: 0.3 + 0.1 * (kind % 3) as f32 },
            _ => AlphaMode::Blend,
        };
        (alpha.value.factor, alpha.vertex) = (factor, kind % 2 == 0);
        let transformed = TextureRef {
            set: 1,
            scale: Vec2::new(0.7, -2.0),
            rotation: if kind % 3 == 0 { 0.0 } else { kind as f32 },
            offset: Vec2::new(0.1, 12.5),
            ..TextureRef::plain(kind as u32 % 4)
        };
        let texture = if kind % 4 < 2 { transformed } else { TextureRef::plain(kind as u32 / 5 % 4) };
        alpha.value.texture = (kind % 11 != 3).then_some((texture, channels[kind / 3 % 5]));
        material
    });
    let materials: Vec<Material> = materials.collect();
    for (primitive, material) in mesh.materials.iter_mut().enumerate() {
        *material = (primitive % materials.len()) as u32;
    }
    let mut scene = Scene::new(mesh, materials);
    scene.textures = textures;
    scene
}

fn tree(scene: &Scene) -> Arc<Bvh> {
    Arc::new(Bvh::build(&scene.mesh.positions, &scene.mesh.triangles, |primitive| scene.is_masked(primitive)))
}

fn tracers(gpu: &Arc<Gpu>, bvh: &Arc<Bvh>, scene: Scene) -> (Oracle, GpuTracer) {
    let filter: Option<Arc<dyn Filter>> = Some(Arc::new(scene));
    let oracle = Oracle::new(bvh.clone(), filter.clone());
    let cpu = Arc::new(oracle.clone());
    let tracer = GpuTracer::new(gpu.clone(), bvh.clone(), filter, cpu).expect("the scene fits");
    (oracle, tracer)
}

fn some_rays() -> Vec<Ray> {
    rays::mixed(&meshes::soup(2000, 0.15, 21), 8000, Vec3::ZERO, 1.0, 40)
}

#[test]
fn a_scenes_alpha_is_decided_on_the_device() {
    let (gpu, rays) = (shared(), some_rays());
    for has_colours in [false, true] {
        let scene = scene(has_colours, 0.9);
        let (oracle, tracer) = tracers(&gpu, &tree(&scene), scene);
        assert!(tracer.exact_hits().is_some(), "{:?}", tracer.refused_hits());
        let (hits, occluded, report) = trace(&tracer, &rays, &rays);
        compare("alpha", &oracle, &rays, &hits, &occluded);
        assert_eq!(report.masked, 0);
        // Some of these rays go through corners, where weights come near subnormal numbers.
        assert!(report.retraced <= 40, "{report:?}");
    }
}

/// Where it is not, the CPU decides, and the answers are the same.
#[test]
fn what_no_table_can_say_is_the_hosts() {
    let (gpu, rays) = (shared(), some_rays());
    let mut scene = scene(false, 0.9);
    for uv in &mut scene.mesh.uvs {
        uv.x *= 1e13;
    }
    let (oracle, tracer) = tracers(&gpu, &tree(&scene), scene);
    let (hits, occluded, report) = trace(&tracer, &rays, &rays);
    compare("beyond a table", &oracle, &rays, &hits, &occluded);
    assert!(report.retraced > 1000, "{report:?}");
}

#[test]
fn another_filter_is_the_devices_too() {
    let (gpu, rays) = (shared(), some_rays());
    let first = scene(false, 0.9);
    let bvh = tree(&first);
    let (_, tracer) = tracers(&gpu, &bvh, first);
    for factor in [0.5, 0.9] {
        let filter: Option<Arc<dyn Filter>> = Some(Arc::new(scene(false, factor)));
        let oracle = Oracle::new(bvh.clone(), filter.clone());
        let other = tracer.with_filter(filter, Arc::new(oracle.clone())).expect("the scene fits");
        let (hits, occluded, report) = trace(&other, &rays, &rays);
        compare("another filter", &oracle, &rays, &hits, &occluded);
        assert_eq!(report.masked, 0);
    }
}
