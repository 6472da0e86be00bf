//! A surface with a BSDF of its own: a full moon of dust beside one of plaster. Plaster is dark at the rim, where the
//! sun grazes it; dust sends light back out of its gaps, so the moon looks like a flat disk.
//! `cargo run --release --example moon -- [OUT.png [WxH [SPP]]]`.

use anyhow::{Context, Result};
use glam::Vec3;
use raystream::engine::{PreparedScene, Units};
use raystream::film::{Image, Look, write_image};
use raystream::geom::warp::lanes as warp;
use raystream::lanes::{Lanes, Num, Vector, trigonometry};
use raystream::render::{PathTracer, Settings};
use raystream::scene::recipe::Recipe;
use raystream::scene::{Light, LightShape, Points, Scattered, Scattering, ScatteringSurface, Scene, Surface};
use raystream::schedule::{JobOptions, Service, ServiceOptions};
use std::f32::consts::PI;
use std::sync::Arc;

/// Dust in a thick layer. Each grain scatters light evenly and once (Lommel and Seeliger's law).
#[derive(Clone, Copy, Debug)]
struct Dust {
    /// Share of light that a grain of the highlands scatters, 0 to 1.
    light: f32,
    /// The same of the seas.
    dark: f32,
}

/// A wave of period 1.
#[inline(always)]
fn wave<L: Lanes>(turns: Num<L>) -> Num<L> {
    trigonometry::sin_cos_turns(turns - turns.floor()).0
}

impl Dust {
    /// How much light grains scatter at a place: seas lie where slow waves are high.
    #[inline(always)]
    fn albedo<L: Lanes>(&self, at: Vector<L>) -> Num<L> {
        let bend = wave(at.x * 0.45 + at.z * 0.3) * 0.12;
        let sea = wave(at.x * 0.52 + at.y * 0.2 + bend + 0.55)
            + wave(at.y * 0.47 - at.z * 0.36 + bend) * 0.8
            + wave(at.x * 1.9 - at.y * 2.3 + bend * 6.0) * 0.15;
        let shore = ((sea - 0.4) * 4.0).clamp(0.0, 1.0);
        shore * (self.dark - self.light) + self.light
    }
}

impl Scattering for Dust {
    #[inline(always)]
    fn evaluate<L: Lanes>(&self, at: &Points<L>, wo: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        let cosine = wi.z.clamp(0.0, 1.0);
        let value = self.albedo(at.position) * cosine / ((wo.z + cosine) * (4.0 * PI));
        (Vector::grey(value), warp::cosine_hemisphere_pdf(wi.z))
    }

    #[inline(always)]
    fn sample<L: Lanes>(&self, at: &Points<L>, wo: Vector<L>, _: Num<L>, u2: [Num<L>; 2]) -> Scattered<L> {
        let wi = warp::cosine_hemisphere(u2);
        Scattered::evaluated(wi, self.evaluate(at, wo, wi))
    }
}

/// Plaster on the left, dust on the right, equally bright in the middle, the sun behind whoever looks.
fn moons(cells: u32) -> Result<Scene> {
    let recipe = format!(
        r#"{{ "camera": {{ "eye": [0, 0, 40], "target": [0, 0, 0], "fov_degrees": 4.2 }},
             "materials": {{ "plaster": {{ "colour": [0.11, 0.11, 0.11] }}, "dust": {{ "colour": [1, 1, 1] }} }},
             "shapes": [ {{ "shape": "sphere", "centre": [-1.25, 0, 0], "radius": 1, "cells": {cells},
                            "material": "plaster" }},
                         {{ "shape": "sphere", "centre": [1.25, 0, 0], "radius": 1, "cells": {cells},
                            "material": "dust" }} ] }}"#
    );
    let mut scene = Recipe::parse(&recipe)?.build()?;
    scene.scatterings.push(ScatteringSurface::new(Dust { light: 0.88, dark: 0.5 }));
    let dust = scene.materials.iter_mut().find(|material| material.name == "dust").context("dust")?;
    dust.surface = Surface::Scattering(0);
    let shape = LightShape::Directional { direction: Vec3::new(0.06, -0.03, -1.0).normalize() };
    scene.lights.push(Light { name: "sun".into(), intensity: Vec3::splat(20.0), shape });
    Ok(scene)
}

fn render(scene: Scene, settings: Settings) -> Result<Image> {
    let prepared = PreparedScene::new(Arc::new(scene), &Units::cpu())?;
    let camera = prepared.scene.camera.context("the recipe has a camera")?;
    let frame = Arc::new(PathTracer::new(prepared.scene.clone(), &camera, settings, None)?);
    let service = Service::new(ServiceOptions::default())?;
    prepared.submit(&service, frame.clone(), JobOptions::default())?.wait()?;
    Ok(frame.film().image())
}

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let output = arguments.next().unwrap_or_else(|| "moon.png".into());
    let size = arguments.next().unwrap_or_else(|| "640x320".into());
    let spp = arguments.next().map_or(Ok(64), |n| n.parse()).context("SPP is a number")?;
    let (width, height) = size.split_once('x').context("the size is WIDTHxHEIGHT")?;
    let settings = Settings::new(width.parse()?, height.parse()?).with_spp(spp).with_max_bounces(2);
    write_image(&output, &render(moons(256)?, settings)?, &Look::default())?;
    println!("{output}");
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dust_is_as_bright_at_the_rim_as_in_the_middle_and_plaster_is_not() {
        let settings = Settings::new(100, 50).with_spp(16).with_max_bounces(0);
        let mut scene = moons(64).expect("a scene");
        scene.scatterings[0] = ScatteringSurface::new(Dust { light: 0.88, dark: 0.88 });
        let image = render(scene, settings).expect("a picture");
        let at = |x: usize, y: usize| image.pixels[y * 100 + x][0];
        // Half-way up the disks, and near their upper rims.
        let (plaster, dust) = ((at(29, 25), at(29, 10)), (at(71, 25), at(71, 10)));
        assert!((plaster.0 / dust.0 - 1.0).abs() < 0.1, "{plaster:?} and {dust:?}");
        assert!((dust.1 / dust.0 - 1.0).abs() < 0.15, "{dust:?}");
        assert!(plaster.1 < plaster.0 * 0.8, "{plaster:?}");
    }
}
