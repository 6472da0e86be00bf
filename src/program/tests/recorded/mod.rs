//! Native shading as a tape: what it does at a hit is recorded, replayed by the executor, and compared bit by bit with
//! the native code of every SIMD level.
//!
//! So native shading is operations of the table alone, which a device could do; a branch changes nothing in lanes that
//! do not want it; and the executor agrees with shading that was written without it.

mod lights;
mod materials;
mod replay;

use super::generated::same;
use crate::geom::{Sampler, warp};
use crate::lanes::record::{Slot, record};
use crate::lanes::{Int, LaneTask, Lanes, Mask, Num, SimdLevel, Vector};
use crate::scene::{Effects, Finish, Material, Procedural, ProceduralSurface, Scene, Surface};
use crate::shade::bsdf::{Sample, Smooth, Smoothness};
use crate::shade::{Bsdf, Hits, Interaction, base_colour, lookup};
use replay::Replay;

/// Words of a hit that is shaded.
const INPUTS: usize = 14;

/// A hit and the random numbers of its shading, in lanes.
struct Given<L: Lanes> {
    direction: Vector<L>,
    hits: Hits<L>,
    width: Num<L>,
    wi: Vector<L>,
    u: Num<L>,
    u2: [Num<L>; 2],
}

impl<L: Lanes> Given<L> {
    /// From the columns of [`points`]: `number` and `integer` give a column by its number.
    fn of(number: impl Fn(u32) -> Num<L>, integer: impl Fn(u32) -> Int<L>) -> Self {
        let vector = |first: u32| Vector::new(number(first), number(first + 1), number(first + 2));
        Self {
            direction: vector(0),
            hits: Hits { t: number(3), u: number(4), v: number(5), primitive: integer(6) },
            width: number(7),
            wi: vector(8),
            u: number(11),
            u2: [number(12), number(13)],
        }
    }
}

/// The words of random hits on `triangles` triangles, a column each. Some directions are near the horizon, some
/// random numbers at the ends of their range.
fn points(count: usize, seed: u32, triangles: u32) -> Vec<Vec<u32>> {
    let mut columns = vec![Vec::new(); INPUTS];
    for point in 0..count {
        let sampler = Sampler::new(point as u32, seed, 0);
        let direction = warp::sphere(sampler.pair(0));
        let mut wi = warp::sphere(sampler.pair(1));
        if point % 7 == 0 {
            wi = (wi * glam::Vec3::new(1.0, 1.0, 1e-3)).normalize();
        }
        let [u, v] = warp::triangle(sampler.pair(2));
        let [choice, width] = sampler.pair(3);
        let mut u2 = sampler.pair(4);
        if point % 31 == 0 {
            u2 = [0.0, choice];
        }
        let width = if point % 3 == 0 { 0.0 } else { 0.3 * width * width };
        let primitive = crate::geom::mix(point as u32 ^ seed) % triangles;
        let numbers = [direction.x, direction.y, direction.z, 1.5, u, v, 0.0, width, wi.x, wi.y, wi.z];
        for (column, number) in columns.iter_mut().zip(numbers.into_iter().chain([choice, u2[0], u2[1]])) {
            column.push(number.to_bits());
        }
        columns[6][point] = primitive;
    }
    columns
}

/// What shading computes, as words.
struct Words<L: Lanes>(Vec<Int<L>>);

impl<L: Lanes> Words<L> {
    fn numbers(&mut self, numbers: &[Num<L>]) {
        self.0.extend(numbers.iter().map(|number| number.to_bits()));
    }

    fn vector(&mut self, v: Vector<L>) {
        self.numbers(&[v.x, v.y, v.z]);
    }

    fn mask(&mut self, mask: Mask<L>) {
        let l = mask.lanes();
        self.0.push(Int::select(mask, Int::splat(l, u32::MAX), Int::splat(l, 0)));
    }

    /// The fields of a sample mean nothing where it is not valid.
    fn sample(&mut self, sample: Sample<L>) {
        let Sample { valid, wi, weight, pdf, specular, crosses, eta } = sample;
        [valid, specular & valid, crosses & valid].into_iter().for_each(|mask| self.mask(mask));
        [wi.only(valid), weight.only(valid)].into_iter().for_each(|v| self.vector(v));
        self.numbers(&[pdf.only(valid), eta.only(valid)]);
    }

    fn smooth(&mut self, smooth: Smooth<L>) {
        let Smooth { reflected, reflection, transmitted, transmission, eta } = smooth;
        [reflected, reflection, transmitted, transmission].into_iter().for_each(|v| self.vector(v));
        self.numbers(&[eta]);
    }
}

/// A surface whose finish depends on all that a computed finish may have.
#[derive(Debug)]
struct Computed(Effects);

impl Procedural for Computed {
    #[inline(always)]
    fn finish<L: Lanes>(&self, points: &crate::scene::Points<L>) -> Finish<L> {
        let share = points.position.y * 0.4 + 0.5;
        let mut finish = Finish { colour: points.position * 0.3, ..Finish::matte(points) };
        (finish.roughness, finish.metallic) = (share, 0.7 - share);
        finish.clearcoat = points.uv[0];
        if self.0.transmission.is_some() {
            finish.transmission = 1.0 - share;
        }
        finish
    }

    fn effects(&self) -> Effects {
        self.0
    }
}

/// A part of native shading.
trait Shading {
    /// Its name in messages.
    fn name(&self) -> &str;
    /// Number of triangles that may be hit.
    fn triangles(&self) -> usize;
    /// What it computes of hits.
    fn words<L: Lanes>(&self, given: &Given<L>) -> Words<L>;
}

/// All that a surface computes of a hit before it meets lights and rays: interaction, emission, BSDF.
struct SurfaceShading<'a> {
    scene: &'a Scene,
    material: &'a Material,
    smoothness: Smoothness,
}

impl Shading for SurfaceShading<'_> {
    fn name(&self) -> &str {
        &self.material.name
    }

    fn triangles(&self) -> usize {
        self.scene.mesh.triangles.len()
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn words<L: Lanes>(&self, given: &Given<L>) -> Words<L> {
        surface_words(self, given)
    }
}

#[cfg_attr(not(unoptimised), inline(always))]
fn surface_words<L: Lanes>(shading: &SurfaceShading<'_>, given: &Given<L>) -> Words<L> {
    let SurfaceShading { scene, material, smoothness } = *shading;
    let Given { direction, hits, width, wi, u, u2 } = given;
    // Surfaces of users go through trait objects lane by lane: what raystream makes of their finish is recorded.
    let mut plain = material.clone();
    let computed = match material.surface {
        Surface::Procedural(surface) => Some(Computed(*scene.procedurals[surface as usize].effects())),
        _ => None,
    };
    if computed.is_some() {
        plain.surface = Material::fallback().surface;
    }
    let mut at = Interaction::new(scene, &plain, *direction, hits, *width);
    if let Some(surface) = &computed {
        at.finish = Some(surface.finish(&at.points(scene)));
    }
    let mut words = Words(Vec::new());
    [at.position, at.normal, at.raised].into_iter().for_each(|v| words.vector(v));
    [at.basis.tangent, at.basis.bitangent, at.basis.normal].into_iter().for_each(|v| words.vector(v));
    words.vector(at.scattered_origin(at.basis.world(*wi)));
    words.vector(base_colour(scene, material, &at));
    if let Some(emission) = &material.emission {
        words.vector(lookup::emission(scene, emission, &at.texture, at.front));
    }
    let bsdf = Bsdf::new(scene, &material.surface, &at, smoothness);
    let wo = at.basis.local(at.wo);
    let (value, pdf) = bsdf.evaluate(wo, *wi);
    words.vector(value);
    words.numbers(&[pdf]);
    let sample = bsdf.sample(wo, *u, *u2);
    words.vector(at.smooth_direction(sample.wi, sample.crosses).only(sample.valid));
    words.sample(sample);
    words.smooth(bsdf.smooth(wo));
    words
}

/// Shades points with native code.
struct Native<'a, S> {
    shading: &'a S,
    points: &'a [Vec<u32>],
}

impl<S: Shading> LaneTask for Native<'_, S> {
    /// A column for each result.
    type Output = Vec<Vec<u32>>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) -> Self::Output {
        let Self { shading, points } = self;
        let mut columns: Vec<Vec<u32>> = Vec::new();
        for start in (0..points[0].len()).step_by(L::LANES) {
            let integer = |input: u32| Int::load(l, &points[input as usize][start..]);
            let given = Given::of(|input| integer(input).to_num_bits(), integer);
            let Words(words) = shading.words(&given);
            columns.resize(words.len(), Vec::new());
            for (column, word) in columns.iter_mut().zip(words) {
                column.extend(word.to_array().as_ref());
            }
        }
        columns
    }
}

/// Records shading.
fn recorded(shading: &impl Shading) -> Replay {
    let (tape, outputs) = record(|l| -> Vec<Slot> {
        let given = Given::of(|input| l.number(input), |input| l.integer(input));
        shading.words(&given).0.into_iter().map(Int::slot).collect()
    });
    Replay::new(&tape, outputs)
}

/// The points at which each tape is compared.
fn asked() -> usize {
    let asked = std::env::var("RAYSTREAM_RECORDED_POINTS").ok();
    asked.map_or(1 << 12, |count| count.parse().expect("a number"))
}

/// Compares a tape with native code at random points. Returns the operations of the tape.
fn compare(shading: &impl Shading, seed: u32) -> usize {
    let replay = recorded(shading);
    // In parts, so that memory stays small.
    const PART: usize = 1 << 12;
    for part in 0..asked().div_ceil(PART) {
        let points = points(PART, seed ^ part as u32, shading.triangles() as u32);
        let replayed = replay.run(&points);
        for level in SimdLevel::available() {
            let native = level.run(Native { shading, points: &points });
            assert_eq!(replayed.len(), native.len());
            for (result, (found, wanted)) in replayed.iter().zip(&native).enumerate() {
                let off = (0..PART).find(|&point| !same(found[point], wanted[point]));
                if let Some(point) = off {
                    let given: Vec<u32> = points.iter().map(|column| column[point]).collect();
                    panic!(
                        "{}, {level}: result {result} is {:?} on the tape and {:?} natively, of {given:?}",
                        shading.name(),
                        f32::from_bits(found[point]),
                        f32::from_bits(wanted[point])
                    );
                }
            }
        }
    }
    replay.operations()
}

#[test]
fn recorded_shading_has_the_bits_of_native_shading() {
    let mut scene = materials::scene();
    for effects in [
        Effects::default(),
        Effects::default().thin_transmission(),
        Effects::default().body_transmission(1.4),
    ] {
        scene.procedurals.push(ProceduralSurface::new(Computed(effects)));
    }
    let mut all = materials::materials();
    for surface in 0..scene.procedurals.len() as u32 {
        let surface = Surface::Procedural(surface);
        all.push(Material { surface, ..Material::matte("computed", glam::Vec3::ONE) });
    }
    for (seed, material) in (1u32..).zip(&all) {
        let smoothness = if seed % 5 == 0 { Smoothness::followed(0.2) } else { Smoothness::EXACT };
        let operations = compare(&SurfaceShading { scene: &scene, material, smoothness }, seed << 16);
        assert!(operations > 300, "{}: {operations} operations", material.name);
    }
}
