//! A scene carved of wood: rings, fibres and pores, all computed where a ray hits, 8 or 16 hits at a time, after RA's
//! Figure 6 ("the majority of rendering time is spent computing the wood texture").
//! `cargo run --release --example wood -- [SCENE [OUT.png [WxH [SPP]]]]` writes a picture, and says how fast it was
//! made with and without SIMD.

use anyhow::{Context, Result, ensure};
use raystream::engine::{PreparedScene, Units};
use raystream::film::{Image, Look, write_image};
use raystream::lanes::{Int, Lanes, Num, SimdLevel, Vector, trigonometry};
use raystream::render::{PathTracer, Settings};
use raystream::scene::{
    Camera, Environment, Finish, Points, Procedural, ProceduralSurface, Scene, Surface, load,
};
use raystream::schedule::{JobOptions, Service, ServiceOptions};
use std::sync::Arc;

/// Wood of a tree that grew along y.
#[derive(Clone, Copy, Debug)]
struct Wood {
    /// Rings in a unit of length.
    rings: f32,
}

/// The middle of the lattice that noise lives on: coordinates are counted from there, to be positive.
const MIDDLE: f32 = 65_536.0;

/// A random number of 0 to 1 for each lattice point.
#[inline(always)]
fn lattice<L: Lanes>(x: Int<L>, y: Int<L>, z: Int<L>) -> Num<L> {
    let mixed = (x * 0x8da6_b343) ^ (y * 0xd816_3841) ^ (z * 0xcb1a_b31f);
    let mixed = (mixed ^ (mixed >> 15)) * 0x2c1b_3c6d;
    let mixed = (mixed ^ (mixed >> 12)) * 0x297a_2d39;
    ((mixed ^ (mixed >> 15)) >> 8).to_num() * (1.0 / (1 << 24) as f32)
}

/// Smooth noise of 0 to 1 with features of unit size.
#[inline(always)]
fn noise<L: Lanes>(p: Vector<L>) -> Num<L> {
    let (fx, fy, fz) = (p.x.floor(), p.y.floor(), p.z.floor());
    let low = [(fx + MIDDLE).to_int(), (fy + MIDDLE).to_int(), (fz + MIDDLE).to_int()];
    let [x, y, z] = low;
    let [x1, y1, z1] = [x + 1, y + 1, z + 1];
    let (u, v, w) = (ease(p.x - fx), ease(p.y - fy), ease(p.z - fz));
    let near =
        lattice(x, y, z).lerp(lattice(x1, y, z), u).lerp(lattice(x, y1, z).lerp(lattice(x1, y1, z), u), v);
    let far = lattice(x, y, z1)
        .lerp(lattice(x1, y, z1), u)
        .lerp(lattice(x, y1, z1).lerp(lattice(x1, y1, z1), u), v);
    near.lerp(far, w)
}

/// From 0 to 1 without a kink in the slope at either end.
#[inline(always)]
fn ease<L: Lanes>(x: Num<L>) -> Num<L> {
    x * x * x * (x * (x * 6.0 - 15.0) + 10.0)
}

/// Noise of many sizes, each half as large and half as strong as the one before, around 0.
#[inline(always)]
fn turbulence<L: Lanes>(p: Vector<L>, octaves: u32) -> Num<L> {
    let mut sum = Num::zero(p.lanes());
    let (mut size, mut strength) = (1.0, 1.0);
    for _ in 0..octaves {
        sum += (noise(p * size) - 0.5) * strength;
        size *= 2.03;
        strength *= 0.5;
    }
    sum
}

impl Procedural for Wood {
    #[inline(always)]
    fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
        let p = points.position * self.rings;
        let l = p.lanes();
        let zero = Num::zero(l);
        // The trunk bends, its rings are dented.
        let slow = Vector::new(p.x * 0.11, p.y * 0.03, p.z * 0.11);
        let x = p.x + turbulence(slow, 5) * 5.0;
        let z = p.z + turbulence(Vector::new(slow.z + 37.0, slow.y, slow.x - 11.0), 5) * 5.0;
        let radius = (x * x + z * z).sqrt() + turbulence(p * 0.9, 4) * 0.35;
        // Within a year wood darkens slowly, and is pale again all at once.
        let year = radius - radius.floor();
        let late = year * year * (1.0 - ease(((year - 0.86) * 7.0).clamp(0.0, 1.0)));
        let width = noise(Vector::new(radius.floor() * 3.7, zero, zero));
        let late = late * (width * 0.7 + 0.5);
        // Fibres and pores run along the trunk; rays from the pith outwards shimmer.
        let fibres = turbulence(Vector::new(x * 3.0, p.y * 0.12, z * 3.0), 6);
        let pores = noise(Vector::new(x * 8.0, p.y * 0.3, z * 8.0));
        let pores = ease(((pores - 0.66) * 5.0).clamp(0.0, 1.0)) * (1.0 - late * 0.5);
        let turn = trigonometry::atan2_turns(z, x);
        let rays = noise(Vector::new(turn * 60.0 + 400.0, p.y * 0.3, radius * 0.2));
        let rays = ease(((rays - 0.7) * 4.0).clamp(0.0, 1.0));

        let early = Vector::splat(l, glam::Vec3::new(0.62, 0.36, 0.17));
        let dark = Vector::splat(l, glam::Vec3::new(0.27, 0.11, 0.04));
        let light = 1.0 + fibres * 0.4 - pores * 0.35 + rays * 0.12;
        let one = Num::splat(l, 1.0);
        Finish {
            colour: early.lerp(dark, late.clamp(0.0, 1.0)) * light,
            metallic: zero,
            roughness: one * 0.42 + pores * 0.35 - late * 0.1,
            clearcoat: one * 0.35 - pores * 0.3,
            ..Finish::matte(points)
        }
    }
}

/// Carves everything of wood that does not shine, with so many rings from the scene's middle to its edge.
fn carve(scene: &mut Scene, rings: f32) {
    let rings = rings / scene.bounds().radius().max(f32::MIN_POSITIVE);
    scene.procedurals.push(ProceduralSurface::new(Wood { rings }));
    let wood = Surface::Procedural(scene.procedurals.len() as u32 - 1);
    for material in scene.materials.iter_mut().filter(|material| material.emission.is_none()) {
        material.surface = wood;
        material.normal_map = None;
    }
}

/// What rendering took.
struct Speed {
    mray_per_s: f64,
    /// Thread seconds spent on anything but tracing.
    shading_s: f64,
}

/// Renders a stage.
fn render(prepared: &PreparedScene, settings: Settings, simd: SimdLevel) -> Result<(Image, Speed)> {
    let Settings { width, height, .. } = settings;
    let framed = || Camera::framing(&prepared.scene.bounds(), width as f32 / height as f32);
    let camera = prepared.scene.camera.unwrap_or_else(framed);
    let frame = PathTracer::new(prepared.scene.clone(), &camera, settings, None)?.with_simd(simd);
    let frame = Arc::new(frame);
    let service = Service::new(ServiceOptions::default())?;
    let report = prepared.submit(&service, frame.clone(), JobOptions::default())?.wait()?;
    let image = frame.film().image();
    let busy_s: f64 = report.threads.iter().map(|thread| thread.busy_s).sum();
    let mray_per_s = report.rays.total() as f64 / report.wall_s / 1e6;
    Ok((image, Speed { mray_per_s, shading_s: busy_s - report.cpu.busy_s }))
}

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let scene = arguments.next().unwrap_or_else(|| "scenes/showcase.json".into());
    let output = arguments.next().unwrap_or_else(|| "wood.png".into());
    let size = arguments.next().unwrap_or_else(|| "640x360".into());
    let spp = arguments.next().map_or(Ok(8), |n| n.parse()).context("SPP is a number")?;
    let (width, height) = size.split_once('x').context("the size is WIDTHxHEIGHT")?;
    let (width, height) = (width.parse()?, height.parse()?);
    let mut scene = load::load(&scene)?;
    if scene.lights.is_empty() && scene.materials.iter().all(|material| material.emission.is_none()) {
        scene.environment = Environment::Constant(glam::Vec3::ONE);
    }
    carve(&mut scene, 180.0);
    let prepared = PreparedScene::new(scene, &Units::cpu())?;
    let settings = Settings::new(width, height).with_spp(spp).with_max_bounces(3);
    let simd = SimdLevel::detect();
    let (image, fast) = render(&prepared, settings, simd)?;
    write_image(&output, &image, &Look::default())?;
    let (same, slow) = render(&prepared, settings, SimdLevel::Scalar)?;
    ensure!(same.hash() == image.hash(), "{simd} and scalar shading made different pictures");
    println!(
        "{output}: {:.2} Mray/s shaded with {simd}, {:.2} with one lane: {:.1} times as fast, \
         the shading alone {:.1} times",
        fast.mray_per_s,
        slow.mray_per_s,
        fast.mray_per_s / slow.mray_per_s,
        slow.shading_s / fast.shading_s
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use raystream::scene::recipe::Recipe;

    #[test]
    fn wood_has_rings_and_is_the_same_with_every_instruction_set() {
        let recipe = Recipe::parse(
            r#"{ "camera": { "eye": [0, 3, 4], "target": [0, 0, 0], "fov_degrees": 40 }, "environment": [1, 1, 1],
                 "materials": { "any": { "colour": [1, 1, 1] } },
                 "shapes": [ { "shape": "block", "centre": [0, 0, 0], "half": [1, 0.3, 1], "round": 0.1, "cells": 8,
                               "material": "any" } ] }"#,
        );
        let mut scene = recipe.and_then(|recipe| recipe.build()).expect("a scene");
        carve(&mut scene, 3.0);
        let prepared = PreparedScene::new(scene, &Units::cpu()).expect("valid");
        let settings = Settings::new(48, 40).with_spp(4).with_max_bounces(2);
        let pictures: Vec<Image> = SimdLevel::available()
            .into_iter()
            .map(|simd| render(&prepared, settings, simd).expect("a picture").0)
            .collect();
        assert!(pictures.iter().all(|picture| picture.pixels == pictures[0].pixels));
        // Across the top are a few rings, in the colours of wood.
        let row = &pictures[0].pixels[48 * 18 + 15..48 * 18 + 33];
        let red = row.iter().map(|pixel| pixel[0]);
        let (darkest, lightest) = (red.clone().fold(f32::INFINITY, f32::min), red.fold(0.0, f32::max));
        assert!(lightest > 1.15 * darkest, "{row:?}");
        assert!(row.iter().all(|[r, g, b]| r > g && g > b), "{row:?}");
    }
}
