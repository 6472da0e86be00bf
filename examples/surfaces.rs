//! One surface for each thing that a surface may compute: light (lava), opacity (a lantern of cut paper), transmission
//! (a screen of stained glass), normals (studs), a colour for each object, and a BSDF that reads a texture of the scene
//! (a road sign).
//! `cargo run --release --example surfaces -- [OUT.png [WxH [SPP]]]`.

use anyhow::{Context, Result};
use glam::Vec3;
use raystream::engine::{PreparedScene, Units};
use raystream::film::{Image, Look, write_image};
use raystream::geom::warp::lanes as warp;
use raystream::lanes::{Lanes, Num, Vector, trigonometry};
use raystream::render::{PathTracer, Settings};
use raystream::scene::recipe::Recipe;
use raystream::scene::{
    Effects, Finish, Points, Procedural, ProceduralSurface, Scattered, Scattering, ScatteringSurface, Scene,
    TextureRef,
};
use raystream::schedule::{JobOptions, Service, ServiceOptions};
use std::sync::Arc;

/// A wave of period 1 between −1 and 1.
#[inline(always)]
fn wave<L: Lanes>(turns: Num<L>) -> Num<L> {
    trigonometry::sin_cos_turns(turns - turns.floor()).0
}

/// From 0 to 1 where `x` rises from `low` to `low` + `width`.
#[inline(always)]
fn ramp<L: Lanes>(x: Num<L>, low: f32, width: Num<L>) -> Num<L> {
    ((x - low) / width.max(Num::splat(x.lanes(), 1e-4))).clamp(0.0, 1.0)
}

/// Black crust with glowing cracks.
#[derive(Clone, Copy, Debug)]
struct Lava {
    /// Radiance in the middle of a crack.
    heat: f32,
}

impl Procedural for Lava {
    #[inline(always)]
    fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
        let p = points.position * 1.3;
        let bend = wave(p.x * 0.7 + p.z * 0.4) * 0.3 + wave(p.y * 1.9 - p.x * 0.8) * 0.15;
        let cells = wave(p.x + bend) * wave(p.y * 1.1 - bend) * wave(p.z * 0.9 + bend * 2.0);
        let hot = (1.0 - cells.abs() * 9.0).clamp(0.0, 1.0);
        let hot = hot * hot * self.heat;
        let colour = Vector::splat(points.lanes(), Vec3::new(0.05, 0.04, 0.04));
        Finish { colour, emission: Vector::new(hot, hot * 0.25, hot * 0.03), ..Finish::matte(points) }
    }

    fn effects(&self) -> Effects {
        Effects::default().emission(self.heat)
    }
}

/// Paper with round holes. The edges are as wide as the pixels are, so they need no more samples than a texture.
#[derive(Clone, Copy, Debug)]
struct CutPaper {
    /// Holes along each edge of the texture's square.
    holes: f32,
}

impl Procedural for CutPaper {
    #[inline(always)]
    fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
        let [u, v] = [points.uv[0] * self.holes, points.uv[1] * self.holes];
        let [x, y] = [u - u.floor() - 0.5, v - v.floor() - 0.5];
        let away = (x * x + y * y).sqrt();
        let opacity = ramp(away, 0.3, points.footprint() * self.holes);
        let colour = Vector::splat(points.lanes(), Vec3::new(0.9, 0.85, 0.7));
        Finish { colour, opacity, ..Finish::matte(points) }
    }

    fn effects(&self) -> Effects {
        Effects::default().opacity()
    }
}

/// Panes of coloured glass in a frame of lead.
#[derive(Clone, Copy, Debug)]
struct StainedGlass;

impl Procedural for StainedGlass {
    #[inline(always)]
    fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
        let one = Num::splat(points.lanes(), 1.0);
        let [u, v] = [points.uv[0] * 4.0, points.uv[1] * 3.0];
        let (column, row) = (u.floor(), v.floor());
        let [x, y] = [(u - column - 0.5).abs(), (v - row - 0.5).abs()];
        let lead = ramp(x.max(y), 0.45, points.footprint() * 4.0);
        let hue = column * 0.29 + row * 0.37;
        let pane =
            Vector::new(wave(hue), wave(hue + 0.33), wave(hue + 0.67)) * 0.45 + Vector::grey(one * 0.5);
        let colour = pane.lerp(Vector::grey(one * 0.08), lead);
        let transmission = (one - lead) * 0.95;
        Finish { colour, transmission, roughness: one * 0.08 + lead * 0.4, ..Finish::matte(points) }
    }

    fn effects(&self) -> Effects {
        Effects::default().thin_transmission()
    }
}

/// Metal with studs. Each object has a colour of its own.
#[derive(Clone, Copy, Debug)]
struct Studs {
    /// Studs along each edge of the texture's square.
    count: f32,
}

impl Procedural for Studs {
    #[inline(always)]
    fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
        let one = Num::splat(points.lanes(), 1.0);
        let [u, v] = [points.uv[0] * self.count, points.uv[1] * self.count];
        let [x, y] = [u - u.floor() - 0.5, v - v.floor() - 0.5];
        let inside = (x * x + y * y).below(0.14);
        // v grows downwards in the texture.
        let frame = points.tangent_frame();
        let dome = points.normal + (frame.tangent * x - frame.bitangent * y) * 2.0;
        let hue = points.object().to_num() * 0.38;
        let colour =
            Vector::new(wave(hue), wave(hue + 0.33), wave(hue + 0.67)) * 0.3 + Vector::grey(one * 0.6);
        let normal = Vector::select(inside, dome.normalize(), points.normal);
        Finish { colour, normal, metallic: one, roughness: one * 0.3, ..Finish::matte(points) }
    }

    fn effects(&self) -> Effects {
        Effects::default().normals()
    }
}

/// Sends light back to where it comes from, in the colours of a texture.
#[derive(Clone, Debug)]
struct RoadSign {
    image: TextureRef,
}

impl RoadSign {
    /// Share of light that beads send back, within a narrow lobe around `wo`.
    const BEADS: f32 = 0.5;
    /// Exponent of that lobe.
    const SHARPNESS: i32 = 6;
}

impl Scattering for RoadSign {
    #[inline(always)]
    fn evaluate<L: Lanes>(&self, at: &Points<L>, wo: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        let [r, g, b, _] = at.texture(&self.image);
        let cosine = wi.z.clamp(0.0, 1.0);
        let mut lobe = wo.dot(wi).clamp(0.0, 1.0);
        for _ in 0..Self::SHARPNESS {
            lobe = lobe * lobe;
        }
        let pdf = warp::cosine_hemisphere_pdf(wi.z);
        let power = (1 << Self::SHARPNESS) as f32;
        let back = lobe * cosine * (Self::BEADS * (power + 1.0) / std::f32::consts::TAU);
        (Vector::new(r, g, b) * (pdf * (1.0 - Self::BEADS) + back), pdf)
    }

    #[inline(always)]
    fn sample<L: Lanes>(&self, at: &Points<L>, wo: Vector<L>, _: Num<L>, u2: [Num<L>; 2]) -> Scattered<L> {
        let wi = warp::cosine_hemisphere(u2);
        Scattered::evaluated(wi, self.evaluate(at, wo, wi))
    }
}

const RECIPE: &str = r#"{
    "camera": { "eye": [0, 2.4, 9], "target": [0, 1.15, 0], "fov_degrees": 34 },
    "environment": [0.16, 0.2, 0.28],
    "textures": { "stripes": { "pattern": "checker", "colours": [[230, 190, 20], [20, 20, 20]], "cells": 6 } },
    "materials": {
        "floor": { "colour": [0.5, 0.5, 0.52], "roughness": 0.5 },
        "wall": { "colour": [0.6, 0.58, 0.55] },
        "lamp": { "colour": [0, 0, 0], "emission": [30, 26, 20] },
        "bulb": { "colour": [0, 0, 0], "emission": [22, 17, 9] },
        "lava": { "colour": [1, 1, 1] }, "paper": { "colour": [1, 1, 1] }, "glass": { "colour": [1, 1, 1] },
        "studs": { "colour": [1, 1, 1] }, "sign": { "colour": [1, 1, 1], "texture": "stripes" } },
    "shapes": [
        { "shape": "quad", "corner": [-9, 0, 9], "u": [18, 0, 0], "v": [0, 0, -13], "material": "floor" },
        { "shape": "quad", "corner": [-9, 0, -4], "u": [18, 0, 0], "v": [0, 9, 0], "material": "wall" },
        { "shape": "quad", "corner": [3, 5, 5], "u": [0.5, 0, -1], "v": [1, 0.4, 0.5], "material": "lamp" },
        { "shape": "sphere", "centre": [-2.9, 0.8, 0.2], "radius": 0.8, "cells": 48, "material": "lava" },
        { "shape": "sphere", "centre": [-0.9, 0.85, 0], "radius": 0.85, "cells": 48, "material": "paper" },
        { "shape": "sphere", "centre": [-0.9, 0.85, 0], "radius": 0.16, "cells": 8, "material": "bulb" },
        { "shape": "quad", "corner": [0.5, 0, -1.1], "u": [1.5, 0, 0.5], "v": [0, 2, 0], "material": "glass" },
        { "shape": "sphere", "centre": [1.3, 0.4, 1.4], "radius": 0.4, "cells": 32, "material": "studs" },
        { "shape": "sphere", "centre": [2.25, 0.4, 1.2], "radius": 0.4, "cells": 32, "material": "studs" },
        { "shape": "sphere", "centre": [3.2, 0.4, 1.0], "radius": 0.4, "cells": 32, "material": "studs" },
        { "shape": "quad", "corner": [2.5, 1, -1.6], "u": [1.5, 0, 0], "v": [0, 1.5, 0], "material": "sign" } ] }"#;

fn scene() -> Result<Scene> {
    let mut scene = Recipe::parse(RECIPE)?.build()?;
    scene.add_mipmaps();
    scene.replace_surface("lava", ProceduralSurface::new(Lava { heat: 6.0 }))?;
    scene.replace_surface("paper", ProceduralSurface::new(CutPaper { holes: 5.0 }))?;
    scene.replace_surface("glass", ProceduralSurface::new(StainedGlass))?;
    scene.replace_surface("studs", ProceduralSurface::new(Studs { count: 5.0 }))?;
    let image = scene.textures.iter().position(|texture| texture.name == "stripes").context("stripes")?;
    let image = TextureRef::plain(image as u32);
    scene.replace_surface("sign", ScatteringSurface::new(RoadSign { image }))?;
    Ok(scene)
}

fn render(scene: Scene, settings: Settings) -> Result<Image> {
    let prepared = PreparedScene::new(Arc::new(scene), &Units::cpu())?;
    let camera = prepared.scene.camera.context("the recipe has a camera")?;
    let frame = Arc::new(PathTracer::new(prepared.scene.clone(), &camera, settings, Some(3))?);
    let service = Service::new(ServiceOptions::default())?;
    prepared.submit(&service, frame.clone(), JobOptions::default())?.wait()?;
    Ok(frame.film().image())
}

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let output = arguments.next().unwrap_or_else(|| "surfaces.png".into());
    let size = arguments.next().unwrap_or_else(|| "640x360".into());
    let spp = arguments.next().map_or(Ok(64), |n| n.parse()).context("SPP is a number")?;
    let (width, height) = size.split_once('x').context("the size is WIDTHxHEIGHT")?;
    let settings = Settings::new(width.parse()?, height.parse()?).with_spp(spp).with_max_bounces(6);
    write_image(&output, &render(scene()?, settings)?, &Look::default())?;
    println!("{output}");
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_surface_shows() {
        let settings = Settings::new(96, 54).with_spp(32).with_max_bounces(3);
        let picture = |scene: Scene| render(scene, settings).expect("a picture").pixels;
        let whole = picture(scene().expect("a scene"));
        for name in ["lava", "paper", "glass", "studs", "sign"] {
            let mut plain = scene().expect("a scene");
            let material = plain.materials.iter_mut().find(|material| material.name == name).expect("there");
            material.surface = raystream::scene::Material::fallback().surface;
            let off =
                |(a, b): (&[f32; 3], &[f32; 3])| (a[0] - b[0]).abs() > 0.05 || (a[2] - b[2]).abs() > 0.05;
            let differing = whole.iter().zip(&picture(plain)).filter(|pair| off(*pair)).count();
            assert!(differing > 20, "{name} changes {differing} pixels");
        }
    }
}
