//! Renders reference scenes and compares them with images made by another renderer, with a test that knows
//! the noise of both sides:
//!
//! ```text
//! cargo run --release --example compare_reference -- FOLDER [SAMPLES]
//! ```
//!
//! FOLDER holds `cornell/cornell.obj`, `cornell/cornell-glass.obj` and, beside each, its linear radiance as
//! `.npy`: float32 (256, 256, 3), independent samples, box filter, no Russian roulette. Our picture is the mean of 32
//! renders of SAMPLES samples each, by default 32. Exits with 1 when they disagree.

use glam::Vec3;
use raystream::engine::{PreparedScene, Units};
use raystream::render::{PathTracer, Settings};
use raystream::scene::{Camera, load};
use raystream::schedule::{JobOptions, Service, ServiceOptions};
use std::error::Error;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;

const SIZE: usize = 256;
const BLOCK: usize = 16;
const BLOCKS: usize = (SIZE / BLOCK) * (SIZE / BLOCK);

/// Our picture is the mean of this many renders.
const RENDERS: u32 = 32;

/// Samples of each of them, unless the arguments say otherwise.
const SAMPLES: u32 = 32;

/// Renders of one sample each: their spread is that of independent samples, as the reference has them.
const SINGLES: u32 = 64;

/// Largest relative difference of a channel's mean.
const MEAN_TOLERANCE: f64 = 0.005;

/// Largest deviation of a block in standard deviations; by chance, one of 768 blocks and channels exceeds it
/// in about one comparison of a thousand.
const MAX_SIGMA: f64 = 5.0;

struct Reference {
    name: &'static str,
    max_bounces: u32,
    samples: f64,
    /// Whether blocks are normally distributed (no caustics).
    test_blocks: bool,
}

const REFERENCES: [Reference; 2] = [
    Reference { name: "cornell", max_bounces: 4, samples: 2048.0, test_blocks: true },
    Reference { name: "cornell-glass", max_bounces: 8, samples: 3072.0, test_blocks: false },
];

/// Mean radiance of each block and channel.
type Blocks = Vec<[f64; 3]>;

fn main() -> Result<ExitCode, Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().ok_or("name the folder with the reference images")?;
    let samples = arguments.next().map_or(Ok(SAMPLES), |samples| samples.parse())?;
    let service = Service::new(ServiceOptions::default().with_device_thread(false))?;
    let mut agree = true;
    for reference in &REFERENCES {
        agree &= compare(Path::new(&folder), reference, samples, &service)?;
    }
    Ok(if agree { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn compare(
    folder: &Path,
    reference: &Reference,
    samples: u32,
    service: &Service,
) -> Result<bool, Box<dyn Error>> {
    let name = reference.name;
    let file = |extension: &str| folder.join("cornell").join(name).with_extension(extension);
    let npy = npyz::NpyFile::new(std::io::BufReader::new(std::fs::File::open(file("npy"))?))?;
    let values: Vec<f32> = npy.into_vec()?;
    let wanted = blocks(bytemuck::cast_slice(&values));

    let mut scene = load::load(file("obj"))?;
    // The reference's lamp shines on its front alone; a back that shines would light the ceiling above it.
    for emission in scene.materials.iter_mut().filter_map(|material| material.emission.as_mut()) {
        emission.two_sided = false;
    }
    let prepared = PreparedScene::new(Arc::new(scene), &Units::cpu())?;
    let camera = Camera::new(Vec3::new(278.0, 273.0, -800.0), Vec3::new(278.0, 273.0, 0.0)).with_fov(39.3);
    let render = |seed: u64, spp: u32| -> Result<Blocks, Box<dyn Error>> {
        let (width, height) = (SIZE as u32, SIZE as u32);
        let settings = Settings::new(width, height)
            .with_spp(spp)
            .with_max_bounces(reference.max_bounces)
            .with_seed(seed);
        let path = Arc::new(PathTracer::new(prepared.scene.clone(), &camera, settings, None)?);
        prepared.submit(service, path.clone(), JobOptions::default())?.wait()?;
        Ok(blocks(&path.film().resolve()))
    };
    let ours = (0..u64::from(RENDERS)).map(|seed| render(seed, samples)).collect::<Result<Vec<_>, _>>()?;
    let singles =
        (0..u64::from(SINGLES)).map(|seed| render(1000 + seed, 1)).collect::<Result<Vec<_>, _>>()?;

    let mut agree = true;
    let mut worst: f64 = 0.0;
    for (channel, colour) in ["red", "green", "blue"].into_iter().enumerate() {
        let mean_of = |blocks: &Blocks| blocks.iter().map(|b| b[channel]).sum::<f64>() / BLOCKS as f64;
        let mean = ours.iter().map(mean_of).sum::<f64>() / f64::from(RENDERS);
        let target = mean_of(&wanted);
        let off = mean / target - 1.0;
        println!("{name} {colour}: mean {mean:.5}, reference {target:.5}, {:+.3} %", 100.0 * off);
        agree &= off.abs() <= MEAN_TOLERANCE;
        for (block, wanted) in wanted.iter().enumerate() {
            let (mean, variance) = moments(ours.iter().map(|o| o[block][channel]));
            let (_, single_variance) = moments(singles.iter().map(|o| o[block][channel]));
            let noise = variance / f64::from(RENDERS) + single_variance / reference.samples;
            worst = worst.max((mean - wanted[channel]).abs() / noise.sqrt().max(1e-9));
        }
    }
    let bound =
        if reference.test_blocks { format!("at most {MAX_SIGMA} allowed") } else { "not a test".into() };
    println!("{name}: worst 16x16 block off by {worst:.2} standard deviations ({bound})");
    Ok(agree && (!reference.test_blocks || worst <= MAX_SIGMA))
}

fn blocks(pixels: &[[f32; 3]]) -> Blocks {
    let mut sums = vec![[0.0; 3]; BLOCKS];
    for (i, pixel) in pixels.iter().enumerate() {
        let block = i / SIZE / BLOCK * (SIZE / BLOCK) + i % SIZE / BLOCK;
        for channel in 0..3 {
            sums[block][channel] += f64::from(pixel[channel]) / (BLOCK * BLOCK) as f64;
        }
    }
    sums
}

/// Mean and variance of a sample.
fn moments(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let n = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / n;
    (mean, values.map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0))
}
