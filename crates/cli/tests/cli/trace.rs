use super::{folder, json, run, shipped};
use npyz::WriterBuilder;
use raystream::geom::{CanonicalRay, Sampler};
use raystream::scene::{Colour, Surface, load};
use std::io::Read;
use std::path::Path;

pub fn write_rays(path: &Path, rays: &[f32]) {
    let file = std::fs::File::create(path).expect("file");
    let options = npyz::WriteOptions::new().default_dtype().shape(&[rays.len() as u64 / 8, 8]);
    let mut npy = options.writer(file).begin_nd().expect("header");
    npy.extend(rays.iter().copied()).expect("rays");
    npy.finish().expect("rays");
}

pub fn array<T: npyz::Deserialize>(path: &Path, name: &str) -> Vec<T> {
    let mut archive = zip::ZipArchive::new(std::fs::File::open(path).expect("npz")).expect("zip");
    let mut bytes = Vec::new();
    archive.by_name(&format!("{name}.npy")).expect(name).read_to_end(&mut bytes).expect(name);
    npyz::NpyFile::new(&bytes[..]).expect("header").into_vec().expect("data")
}

/// Rays from everywhere in and around the Cornell box, some of them short.
fn random_rays(count: u32) -> Vec<f32> {
    (0..count)
        .flat_map(|i| {
            let s = Sampler::new(i, 0, 5);
            let [x, y] = s.pair(0);
            let [z, length] = s.pair(1);
            let d = raystream::geom::warp::sphere(s.pair(2));
            let far = if i % 3 == 0 { 500.0 * length } else { f32::INFINITY };
            [700.0 * x - 70.0, 700.0 * y - 70.0, 700.0 * z - 70.0, 0.0, d.x, d.y, d.z, far]
        })
        .collect()
}

#[test]
fn a_mesh_file_says_what_its_materials_are() {
    let folder = folder();
    let file = folder.path().join("m.npz");
    for name in ["cornell.json", "showcase.json"] {
        let path = shipped(name);
        run(folder.path(), &["mesh", &path, "-o", "m.npz", "--images"], 0);
        let scene = load::load(&path).expect("scene");
        assert_eq!(array::<f32>(&file, "uvs").len(), 2 * scene.mesh.uvs.len());
        assert_eq!(array::<f32>(&file, "normals").len(), 3 * scene.mesh.normals.len());
        let (base, texture) = (array::<f32>(&file, "base_colour"), array::<u32>(&file, "base_texture"));
        let (metallic, transmission) = (array::<f32>(&file, "metallic"), array::<f32>(&file, "transmission"));
        for (i, material) in scene.materials.iter().enumerate() {
            let (colour, metal, clear) = match &material.surface {
                Surface::Matte { reflectance } => (*reflectance, 0.0, 0.0),
                Surface::Mirror { reflectance } => (*reflectance, 1.0, 0.0),
                Surface::Dielectric { transmittance, .. } => (Colour::constant(*transmittance), 0.0, 1.0),
                Surface::Principled(s) => (s.base_colour, s.metallic.factor, s.transmission.factor),
                _ => continue,
            };
            assert_eq!(base[3 * i..3 * i + 3], colour.factor.to_array(), "{}", material.name);
            assert_eq!(texture[i], colour.texture.map_or(u32::MAX, |texture| texture.texture));
            assert_eq!((metallic[i], transmission[i]), (metal, clear), "{}", material.name);
        }
        for (i, texture) in scene.textures.iter().enumerate() {
            let texels = array::<u32>(&file, &format!("texture{i}"));
            assert_eq!(bytemuck::cast_slice::<_, [u8; 4]>(&texels), texture.image());
        }
        assert_eq!(scene.textures.is_empty(), name == "cornell.json");
    }
}

#[test]
fn hits_are_those_of_brute_force() {
    let folder = folder();
    let scene = shipped("cornell.json");
    let rays = random_rays(100_000);
    write_rays(&folder.path().join("r.npy"), &rays);
    let args = ["trace", &scene, "--rays", "r.npy", "-o", "h.npz", "--repeat", "2", "--stats", "s.json"];
    run(folder.path(), &args, 0);
    run(folder.path(), &["trace", &scene, "--rays", "r.npy", "-o", "o.npz", "--any-hit"], 0);
    run(folder.path(), &["mesh", &scene, "-o", "m.npz"], 0);

    let hits = folder.path().join("h.npz");
    let (primitive, t, uv) =
        (array::<u32>(&hits, "primitive"), array::<f32>(&hits, "t"), array::<f32>(&hits, "uv"));
    let occluded: Vec<bool> = array(&folder.path().join("o.npz"), "occluded");
    let mesh = load::load(&scene).expect("scene").mesh;
    let triangles: Vec<u32> = array(&folder.path().join("m.npz"), "triangles");
    assert_eq!(triangles, mesh.triangles.as_flattened());
    let emission: Vec<f32> = array(&folder.path().join("m.npz"), "emission");
    let shines = |m: &u32| emission[3 * *m as usize] > 0.0;
    assert_eq!(mesh.materials.iter().filter(|m| shines(m)).count(), 2, "the lamp's triangles");
    let max_abs = mesh.bounds().max_abs();
    let mut found = 0;
    for (i, r) in rays.chunks_exact(8).enumerate() {
        let ray = CanonicalRay::new([r[0], r[1], r[2]], r[3], [r[4], r[5], r[6]], r[7], max_abs);
        let nearest = (0..mesh.triangles.len() as u32)
            .filter_map(|p| {
                let [a, b, c] = mesh.corners(p);
                ray.triangle(a, b, c).map(|hit| (hit, p))
            })
            .min_by(|a, b| a.0.t.total_cmp(&b.0.t).then(a.1.cmp(&b.1)));
        let (hit, p) = match nearest {
            Some((hit, p)) => ([hit.t, hit.u, hit.v], p),
            None => ([f32::INFINITY, 0.0, 0.0], u32::MAX),
        };
        assert_eq!((primitive[i], [t[i], uv[2 * i], uv[2 * i + 1]]), (p, hit), "ray {i}");
        assert_eq!(occluded[i], nearest.is_some(), "ray {i}");
        found += usize::from(nearest.is_some());
    }
    let stats = json(&folder.path().join("s.json"));
    assert_eq!(stats["hits"], found);
    assert_eq!(stats["units"]["cpu"]["rays"], 200_000);
    assert!(stats["mray_per_s"]["median"].as_f64() > Some(0.0));
}

#[test]
fn rays_that_cannot_be_traced_are_counted() {
    let folder = folder();
    let scene = shipped("cornell.json");
    let good = [278.0, 273.0, -800.0, 0.0, 0.0, 0.0, 1.0, f32::INFINITY];
    let bad = |place: usize, value: f32| {
        let mut ray = good;
        ray[place] = value;
        ray
    };
    let wrong = [
        bad(0, f32::NAN),
        bad(6, f32::INFINITY),
        bad(6, 0.0),
        bad(6, 3e38),
        bad(3, f32::NAN),
        bad(7, f32::NAN),
    ];
    // An empty interval is no mistake: such a ray asks for nothing.
    let rays = [&[good, bad(7, -1.0)][..], &wrong, &[good]].concat();
    write_rays(&folder.path().join("r.npy"), rays.as_flattened());
    let args = ["trace", &scene, "--rays", "r.npy", "-o", "h.npz", "--repeat", "2", "--stats", "s.json"];
    let text = run(folder.path(), &args, 0);
    let told = "r.npy: 6 of 9 rays cannot be traced and count as misses, the first in row 2";
    assert_eq!(text.matches(told).count(), 1, "{text}");
    let stats = json(&folder.path().join("s.json"));
    assert_eq!((&stats["untraceable_rays"], &stats["hits"]), (&6.into(), &2.into()));
    let primitive = array::<u32>(&folder.path().join("h.npz"), "primitive");
    assert!(primitive[2..8].iter().all(|&primitive| primitive == u32::MAX) && primitive[8] == primitive[0]);
}

#[cfg(feature = "gpu")]
#[test]
fn cpu_and_gpu_write_the_same_arrays() {
    let folder = folder();
    let scene = shipped("cornell.json");
    write_rays(&folder.path().join("r.npy"), &random_rays(100_000));
    for any in [false, true] {
        for tracer in ["cpu", "gpu", "hybrid"] {
            let out = format!("{tracer}.npz");
            let mut args = vec!["trace", &scene, "--rays", "r.npy", "-o", &out, "--tracer", tracer];
            args.extend(any.then_some("--any-hit"));
            run(folder.path(), &args, 0);
        }
        let bytes = |tracer: &str| {
            let path = folder.path().join(format!("{tracer}.npz"));
            match any {
                true => array::<bool>(&path, "occluded").into_iter().map(u32::from).collect(),
                false => [
                    array::<u32>(&path, "primitive"),
                    array::<f32>(&path, "t").into_iter().map(f32::to_bits).collect(),
                    array::<f32>(&path, "uv").into_iter().map(f32::to_bits).collect(),
                ]
                .concat(),
            }
        };
        assert!(bytes("cpu") == bytes("gpu") && bytes("cpu") == bytes("hybrid"));
    }
}

#[test]
fn bench_rays_compares_every_instruction_set_with_its_peers() {
    let folder = folder();
    let scene = shipped("cornell.json");
    let args =
        ["bench", "rays", &scene, "--size", "64x64", "--rounds", "2", "--threads", "1,2", "--json", "b.json"];
    run(folder.path(), &args, 0);
    let sheet = json(&folder.path().join("b.json"));
    let rows = sheet["rows"].as_array().expect("rows");
    for kind in ["camera", "bounce", "shuffled-bounce", "soft-shadow", "occluded-bounce"] {
        let speeds = rows.iter().filter(|row| row["kind"] == kind && row["simd"].is_string());
        assert!(speeds.clone().count() >= 2, "{kind}: one thread and two");
        for row in speeds {
            assert!(row["mray_per_s"]["median"].as_f64() > Some(0.0), "{row}");
        }
    }
    run(folder.path(), &["bench", "rays", &scene, "--size", "8x8", "--embree", "no-such-library.so"], 2);
}

#[test]
fn variants_are_listed_and_chosen_by_name() {
    let folder = folder();
    // Accessors without data are 0.
    let scene = r#"{ "asset": { "version": "2.0" },
        "accessors": [{ "componentType": 5126, "type": "VEC3", "count": 3 }],
        "materials": [{ "pbrMetallicRoughness": { "baseColorFactor": [1, 0, 0, 1] } }, {}], "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "COLOR_0": 0 }, "material": 0,
            "extensions": { "KHR_materials_variants": { "mappings": [{ "material": 1, "variants": [1] }] } } }] }],
        "extensions": { "KHR_materials_variants": { "variants": [{ "name": "day" }, { "name": "night" }] } } }"#;
    std::fs::write(folder.path().join("a.gltf"), scene).expect("scene");
    let mesh = |variant: &[&str], code| {
        run(folder.path(), &[&["mesh", "a.gltf", "-o", "m.npz"], variant].concat(), code)
    };
    assert!(mesh(&[], 0).contains("variants: day, night"));
    let file = folder.path().join("m.npz");
    assert_eq!((array::<u32>(&file, "material"), array::<f32>(&file, "colours").len()), (vec![0], 12));
    mesh(&["--variant", "night"], 0);
    assert_eq!(array::<u32>(&file, "material"), [1]);
    let message = mesh(&["--variant", "dusk"], 2);
    assert!(message.contains("\"dusk\"") && message.contains("\"day\", \"night\""), "{message}");
}
