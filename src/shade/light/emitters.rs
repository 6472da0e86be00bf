//! Triangles that shine.

use super::{AliasTable, LightBounds, LightTree, Receiver};
use crate::geom::warp::lanes as warp;
use crate::lanes::{Int, Lanes, Num, One, Vector};
use crate::scene::{Emission, Footprint, Scene};
use crate::shade::lookup::{self, luminance};
use crate::shade::offset;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use std::f32::consts::{FRAC_PI_2, PI};

/// Barycentric points at which a textured emission is looked up to estimate a triangle's power.
const PROBES: [[f32; 2]; 7] =
    [[0.333, 0.333], [0.6, 0.2], [0.2, 0.6], [0.2, 0.2], [0.9, 0.05], [0.05, 0.9], [0.05, 0.05]];

/// All emissive triangles: few are chosen by power, many by what they may give to the receiver.
#[derive(Clone, Debug, Default)]
pub struct Emitters {
    records: Vec<Record>,
    /// What those in `records` give off, for those whose emission is a texture's.
    emissions: Vec<Emission>,
    table: AliasTable,
    /// Chooses instead of the table when there are more than [`FEW`].
    tree: Option<LightTree>,
    /// For each triangle of the scene its place in `records`, or [`NONE`]; empty when no triangle
    /// shines.
    places: Vec<u32>,
}

/// A triangle that shines, with all that sampling it needs.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Record {
    corners: [[f32; 3]; 3],
    /// Unit normal, zero for a triangle without area.
    normal: [f32; 3],
    area: f32,
    /// Distance off the triangle at which rays to it end.
    offset: f32,
    /// Of the front; before its texture, if there is one.
    radiance: [f32; 3],
    /// [`TWO_SIDED`] and [`TEXTURED`].
    flags: u32,
    primitive: u32,
}

/// As many are as well chosen by power alone: with the eight of a kitchen the tree takes 1.5 % of the noise and costs
/// 4 % of the time.
const FEW: usize = 16;

/// Words of a [`Record`].
const WORDS: usize = size_of::<Record>() / 4;

const TWO_SIDED: u32 = 1;
const TEXTURED: u32 = 2;
const NONE: u32 = u32::MAX;

/// Sampled points of emissive triangles.
#[derive(Clone, Copy, Debug)]
pub struct EmitterSample<L: Lanes> {
    /// Lanes that have one; of the others nothing below counts.
    pub valid: u32,
    /// The point, a little off the triangle towards whoever asked.
    pub position: Vector<L>,
    /// Radiance towards them.
    pub radiance: Vector<L>,
    /// Density per solid angle, seen from them.
    pub pdf: Num<L>,
}

impl Emitters {
    /// The emissive triangles of a scene.
    pub fn new(scene: &Scene) -> Self {
        let (mut records, mut emissions, mut weights) = (Vec::new(), Vec::new(), Vec::new());
        for (primitive, &material) in scene.mesh.materials.iter().enumerate() {
            if let Some(emission) = scene.materials[material as usize].emission {
                let record = Record::new(scene, primitive as u32, &emission);
                let power = f64::from(power(scene, &record, &emission));
                if power > 0.0 && power.is_finite() {
                    records.push(record);
                    emissions.push(emission);
                    weights.push(power);
                }
            }
        }
        let table = AliasTable::new(&weights);
        let tree = (records.len() > FEW).then(|| {
            let lights: Vec<_> = records.iter().zip(&weights).map(|(r, &w)| r.bounds(w as f32)).collect();
            LightTree::new(&lights)
        });
        let mut places = Vec::new();
        if !records.is_empty() {
            places.resize(scene.mesh.triangles.len(), NONE);
            for (place, record) in records.iter().enumerate() {
                places[record.primitive as usize] = place as u32;
            }
        }
        Self { records, emissions, table, tree, places }
    }

    /// Luminous power of all of them.
    pub fn power(&self) -> f64 {
        self.table.total()
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.records.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.records.is_empty()
    }

    /// Samples points on some of them for receivers: `u` chooses the triangle, `u2` the point.
    /// `None` when there are none.
    #[inline(always)]
    pub fn sample<L: Lanes>(
        &self,
        scene: &Scene,
        to: &Receiver<L>,
        u: Num<L>,
        u2: [Num<L>; 2],
    ) -> Option<EmitterSample<L>> {
        let (place, chance) = self.choose(to, u)?;
        let record: [Int<L>; WORDS] = place.rows(bytemuck::cast_slice(&self.records));
        let [v, w] = warp::triangle(u2);
        let on = vector(&record, 0) * (1.0 - v - w) + vector(&record, 3) * v + vector(&record, 6) * w;
        let normal = vector(&record, 9);
        let (area, offset) = (record[12].to_num_bits(), record[13].to_num_bits());
        let away = to.position - on;
        let cosine = normal.dot(away);
        let front = cosine.above(0.0);
        let flags = record[17];
        let mut radiance = vector(&record, 14).only(front | (flags & TWO_SIDED).is(TWO_SIDED));
        let textured = (flags & TEXTURED).is(TEXTURED);
        if textured != 0 {
            radiance =
                Vector::select(textured, self.textured(scene, textured, place, [v, w], front), radiance);
        }
        let distance2 = away.length_squared();
        let pdf = chance * distance2 / ((cosine / distance2.sqrt()).abs() * area);
        let valid = !radiance.is_zero() & !cosine.is_zero() & pdf.above(0.0) & pdf.is_finite();
        Some(EmitterSample { valid, position: on + normal * offset.copysign(cosine), radiance, pdf })
    }

    /// Chooses emitters for receivers by `u`: their places among the emitters, and their chances. `None`
    /// when there are none.
    #[inline(always)]
    pub(super) fn choose<L: Lanes>(&self, to: &Receiver<L>, u: Num<L>) -> Option<(Int<L>, Num<L>)> {
        match &self.tree {
            Some(tree) => Some(tree.choose(to, u)),
            None => self.table.choose(u),
        }
    }

    /// The chances with which [`Emitters::choose`] gives these.
    #[inline(always)]
    pub(super) fn chance<L: Lanes>(&self, to: &Receiver<L>, place: Int<L>) -> Num<L> {
        match &self.tree {
            Some(tree) => tree.chance(to, place),
            None => self.table.chance(place),
        }
    }

    /// Radiance of textured emitters at points given by the weights of the second and third corner, lane
    /// by lane: they are few.
    fn textured<L: Lanes>(
        &self,
        scene: &Scene,
        lanes: u32,
        place: Int<L>,
        [v, w]: [Num<L>; 2],
        front: u32,
    ) -> Vector<L> {
        let l = v.lanes();
        let (place, v, w) = (place.to_array(), v.to_array(), w.to_array());
        let mut radiance = [L::array(0.0); 3];
        for lane in (0..L::LANES).filter(|lane| lanes >> lane & 1 == 1) {
            let place = place[lane] as usize;
            let at = [v[lane], w[lane]];
            let primitive = self.records[place].primitive;
            let light = radiance_at(scene, &self.emissions[place], primitive, at, front >> lane & 1 == 1);
            for (channel, light) in radiance.iter_mut().zip(light.to_array()) {
                channel[lane] = light;
            }
        }
        let [r, g, b] = &radiance;
        Vector::new(Num::from_array(l, r), Num::from_array(l, g), Num::from_array(l, b))
    }

    /// Density per solid angle with which [`Emitters::sample`] finds a point of a triangle for a receiver,
    /// seen from a squared distance and under a cosine to its normal; 0 when it is not an emitter.
    #[inline(always)]
    pub fn pdf<L: Lanes>(
        &self,
        to: &Receiver<L>,
        primitive: Int<L>,
        distance2: Num<L>,
        cosine: Num<L>,
    ) -> Num<L> {
        if self.places.is_empty() {
            return cosine.only(0);
        }
        let [place] = primitive.rows(&self.places);
        let there = !place.is(NONE);
        let place = place.at_most(self.records.len() as u32 - 1);
        let record: [Int<L>; WORDS] = place.rows(bytemuck::cast_slice(&self.records));
        let area = record[12].to_num_bits();
        (self.chance(to, place) * distance2 / (cosine.abs() * area)).only(there)
    }
}

impl Record {
    fn new(scene: &Scene, primitive: u32, emission: &Emission) -> Self {
        let corners = scene.mesh.corners(primitive);
        let lanes = corners.map(Vector::from);
        let normal: Vec3 = offset::normal(&lanes, Vec3::ZERO.into()).0.into();
        let textured = if emission.radiance.texture.is_some() { TEXTURED } else { 0 };
        Self {
            corners: corners.map(|corner| corner.to_array()),
            normal: normal.to_array(),
            area: 0.5 * (corners[1] - corners[0]).cross(corners[2] - corners[0]).length(),
            offset: offset::distance(&lanes).get(),
            radiance: emission.radiance.factor.max(Vec3::ZERO).to_array(),
            flags: textured | if emission.two_sided { TWO_SIDED } else { 0 },
            primitive,
        }
    }

    fn bounds(&self, power: f32) -> LightBounds {
        let [a, b, c] = self.corners.map(Vec3::from_array);
        LightBounds {
            low: a.min(b).min(c),
            high: a.max(b).max(c),
            axis: Vec3::from_array(self.normal),
            spread: 0.0,
            reach: FRAC_PI_2,
            power,
            two_sided: self.flags & TWO_SIDED != 0,
        }
    }
}

/// Three numbers of records, from word `at` on.
#[inline(always)]
fn vector<L: Lanes>(record: &[Int<L>; WORDS], at: usize) -> Vector<L> {
    Vector::new(record[at].to_num_bits(), record[at + 1].to_num_bits(), record[at + 2].to_num_bits())
}

/// Radiance at a point of a triangle, given by the weights of the second and third corner.
fn radiance_at(scene: &Scene, emission: &Emission, primitive: u32, [v, w]: [f32; 2], front: bool) -> Vec3 {
    let uv = scene.mesh.uv_at(primitive, v, w).to_array();
    lookup::emission(scene, emission, uv.map(Num::from), &Footprint::point(One::default()), front.into())
        .into()
}

/// Luminous power: exact for an even emission, an estimate for a textured one.
fn power(scene: &Scene, record: &Record, emission: &Emission) -> f32 {
    let brightness = match emission.radiance.texture {
        None => luminance(emission.radiance.factor),
        Some(_) => {
            let probes = PROBES.map(|at| luminance(radiance_at(scene, emission, record.primitive, at, true)));
            probes.iter().sum::<f32>() / PROBES.len() as f32
        }
    };
    let sides = if emission.two_sided { 2.0 } else { 1.0 };
    sides * PI * brightness.max(0.0) * record.area
}
