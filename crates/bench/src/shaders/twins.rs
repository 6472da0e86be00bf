//! The surfaces of shipped shaders in Rust, with the same bits.

use glam::Vec3;
use raystream::geom::warp::lanes as warp;
use raystream::lanes::{Lanes, Num, Vector, trigonometry};
use raystream::program::{ease, noise};
use raystream::scene::{Finish, Points, Procedural, Scattered, Scattering};
use std::f32::consts::TAU;

/// `scenes/shaders/wood.wgsl`.
#[derive(Debug)]
pub struct Wood {
    /// Rings in a unit of length.
    pub rings: f32,
}

#[inline(always)]
fn turbulence<L: Lanes>(p: Vector<L>, octaves: u32) -> Num<L> {
    let mut sum = Num::zero(p.lanes());
    let (mut size, mut strength) = (1.0f32, 1.0f32);
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
        let slow = Vector::new(p.x * 0.11, p.y * 0.03, p.z * 0.11);
        let x = p.x + turbulence(slow, 5) * 5.0;
        let z = p.z + turbulence(Vector::new(slow.z + 37.0, slow.y, slow.x - 11.0), 5) * 5.0;
        let radius = (x * x + z * z).sqrt() + turbulence(p * 0.9, 4) * 0.35;
        let year = radius - radius.floor();
        let darkening = year * year * (1.0 - ease(((year - 0.86) * 7.0).clamp(0.0, 1.0)));
        let width = noise(Vector::new(radius.floor() * 3.7, zero, zero));
        let late = darkening * (width * 0.7 + 0.5);
        let fibres = turbulence(Vector::new(x * 3.0, p.y * 0.12, z * 3.0), 6);
        let hole = noise(Vector::new(x * 8.0, p.y * 0.3, z * 8.0));
        let pores = ease(((hole - 0.66) * 5.0).clamp(0.0, 1.0)) * (1.0 - late * 0.5);
        let turn = trigonometry::atan2_turns(z, x) * TAU / TAU;
        let shimmer = noise(Vector::new(turn * 60.0 + 400.0, p.y * 0.3, radius * 0.2));
        let rays = ease(((shimmer - 0.7) * 4.0).clamp(0.0, 1.0));
        let early = Vector::splat(l, Vec3::new(0.62, 0.36, 0.17));
        let dark = Vector::splat(l, Vec3::new(0.27, 0.11, 0.04));
        let light = 1.0 + fibres * 0.4 - pores * 0.35 + rays * 0.12;
        let one = Num::splat(l, 1.0);
        Finish {
            colour: early.lerp(dark, late.clamp(0.0, 1.0)) * light,
            roughness: one * 0.42 + pores * 0.35 - late * 0.1,
            clearcoat: one * 0.35 - pores * 0.3,
            ..Finish::matte(points)
        }
    }
}

/// `scenes/shaders/dust.wgsl`.
#[derive(Debug)]
pub struct Dust {
    /// Share of the light that a grain scatters, 0 to 1.
    pub albedo: f32,
}

impl Scattering for Dust {
    #[inline(always)]
    fn evaluate<L: Lanes>(&self, at: &Points<L>, wo: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        let cosine = wi.z.clamp(0.0, 1.0);
        let scale = self.albedo * 0.079_577_47;
        let value = cosine * scale / (wo.z + cosine);
        let colour = Vector::splat(at.lanes(), Vec3::new(1.0, 0.95, 0.88));
        (colour * value, warp::cosine_hemisphere_pdf(wi.z))
    }

    #[inline(always)]
    fn sample<L: Lanes>(&self, at: &Points<L>, wo: Vector<L>, _: Num<L>, u2: [Num<L>; 2]) -> Scattered<L> {
        let wi = warp::cosine_hemisphere(u2);
        Scattered::evaluated(wi, self.evaluate(at, wo, wi))
    }
}
