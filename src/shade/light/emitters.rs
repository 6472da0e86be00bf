//! Emissive triangles.

use super::{AliasTable, FEW, LightBounds, LightTree, Receiver};
use crate::geom::warp::lanes as warp;
use crate::lanes::{Int, Lanes, Mask, Num, Vector};
use crate::scene::{Emission, Scene, TexturePoint};
use crate::shade::lookup::{self, luminance};
use crate::shade::{offset, sought_materials};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use std::f32::consts::{FRAC_PI_2, PI};

/// Barycentric coordinates at which a textured emission is looked up to estimate a triangle's power.
const PROBES: [[f32; 2]; 7] =
    [[0.333, 0.333], [0.6, 0.2], [0.2, 0.6], [0.2, 0.2], [0.9, 0.05], [0.05, 0.9], [0.05, 0.05]];

/// All emissive triangles. Few are chosen by power, many by the light that they may contribute at the
/// receiver.
#[derive(Clone, Debug, Default)]
pub struct Emitters {
    records: Vec<Record>,
    /// Areas of the triangles in `records`, and their indices in the scene.
    areas: Vec<f32>,
    primitives: Vec<u32>,
    /// Emissions of the triangles in `records`.
    emissions: Vec<Emission>,
    table: AliasTable,
    /// Light tree that replaces the table if there are more than [`FEW`] triangles.
    tree: Option<LightTree>,
    /// Index in `records` of each triangle of the scene, or [`NONE`]; empty if no triangle is emissive.
    places: Vec<u32>,
    /// True if any light differs from point to point.
    varies: bool,
}

/// An emissive triangle with all data for sampling it, in two rows of eight words.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Record {
    corners: [[f32; 3]; 3],
    /// Normal, as long as the area.
    normal: [f32; 3],
    /// Radiance of the front, unless it differs from point to point.
    radiance: [f32; 3],
    /// Distance from the triangle at which rays towards it end, relative to the area. The two lowest bits are
    /// [`TWO_SIDED`] and [`VARYING`].
    offset_and_flags: u32,
}

/// Words of a [`Record`].
const WORDS: usize = 16;
const _: () = assert!(size_of::<Record>() == WORDS * 4);

const TWO_SIDED: u32 = 1;
/// The emission has a texture or vertex colours, or alpha decides where the triangle is.
const VARYING: u32 = 2;
const FLAGS: u32 = TWO_SIDED | VARYING;
const NONE: u32 = u32::MAX;

/// Sampled points of emissive triangles.
#[derive(Clone, Copy, Debug)]
pub struct EmitterSample<L: Lanes> {
    /// Lanes that have a sample; the other fields mean nothing in the other lanes.
    pub valid: Mask<L>,
    /// The point, offset a little from the triangle towards the receiver.
    pub position: Vector<L>,
    /// Unit direction from the receiver to the point.
    pub wi: Vector<L>,
    /// Radiance towards the receiver.
    pub radiance: Vector<L>,
    /// Density per solid angle at the receiver.
    pub pdf: Num<L>,
}

impl Emitters {
    /// The emissive triangles of a scene. Those whose opacity is computed are not among them: a sampled point does not
    /// tell whether rays meet the surface there.
    pub fn new(scene: &Scene) -> Self {
        let mut all = Self::default();
        let mut weights = Vec::new();
        let passed = materials_of_computed_opacity(scene);
        let emits: Vec<bool> =
            scene.materials.iter().zip(passed).map(|(of, passed)| of.emission.is_some() && !passed).collect();
        let all_materials = scene.mesh.materials.iter().enumerate();
        for (primitive, &material) in all_materials.filter(|(_, material)| emits[**material as usize]) {
            let emission = scene.materials[material as usize].emission;
            if let Some(emission) = emission.filter(|emission| emission.is_light) {
                let primitive = primitive as u32;
                let (record, area) = Record::new(scene, primitive, &emission);
                let power = f64::from(power(scene, primitive, area, &emission));
                if power > 0.0 && power.is_finite() {
                    all.records.push(record);
                    all.areas.push(area);
                    all.varies |= record.offset_and_flags & VARYING != 0;
                    all.primitives.push(primitive);
                    all.emissions.push(emission);
                    weights.push(power);
                }
            }
        }
        all.table = AliasTable::new(&weights);
        all.tree = (all.len() > FEW).then(|| {
            let lights: Vec<_> = all.records.iter().zip(&weights).map(|(r, &w)| r.bounds(w as f32)).collect();
            LightTree::new(&lights)
        });
        if !all.is_empty() {
            all.places.resize(scene.mesh.triangles.len(), NONE);
            for (place, &primitive) in all.primitives.iter().enumerate() {
                all.places[primitive as usize] = place as u32;
            }
        }
        all
    }

    /// True if there are so many triangles that a [`LightTree`] chooses. The choice then depends on the
    /// receiver's normal.
    #[inline]
    pub fn are_many(&self) -> bool {
        self.tree.is_some()
    }

    /// Total luminous power.
    pub fn power(&self) -> f64 {
        self.table.total()
    }

    /// Number of emissive triangles.
    pub fn len(&self) -> usize {
        self.records.len()
    }

    /// True if there are no emissive triangles.
    pub fn is_empty(&self) -> bool {
        self.records.is_empty()
    }

    /// Samples points on emissive triangles for receivers. `u` chooses the triangle, `u2` the point. If `u`
    /// is `None`, the first number of `u2` also chooses the triangle. Returns `None` if there are no emissive
    /// triangles.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn sample<L: Lanes>(
        &self,
        scene: &Scene,
        to: &Receiver<L>,
        u: Option<Num<L>>,
        [mut x, y]: [Num<L>; 2],
    ) -> Option<EmitterSample<L>> {
        let (place, probability, rest) = self.choose(to, u.unwrap_or(x))?;
        if u.is_none() {
            x = rest;
        }
        Some(self.sample_on(scene, to.position, (place, probability), [x, y]))
    }

    /// Like [`Emitters::sample`] for receivers at `from`, with the triangle chosen by power however many there are. The
    /// first number of `u2` also chooses the triangle.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn sample_by_power<L: Lanes>(
        &self,
        scene: &Scene,
        from: Vector<L>,
        [x, y]: [Num<L>; 2],
    ) -> Option<EmitterSample<L>> {
        let (place, probability, rest) = self.table.choose(x)?;
        Some(self.sample_on(scene, from, (place, probability), [rest, y]))
    }

    /// Samples points on triangles that were chosen with a probability.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn sample_on<L: Lanes>(
        &self,
        scene: &Scene,
        from: Vector<L>,
        (place, probability): (Int<L>, Num<L>),
        u2: [Num<L>; 2],
    ) -> EmitterSample<L> {
        let record = Record::load(&self.records, place);
        let [v, w] = warp::triangle(u2);
        let on = vector(&record, 0) * (1.0 - v - w) + vector(&record, 3) * v + vector(&record, 6) * w;
        let normal = vector(&record, 9);
        let away = from - on;
        let cosine = normal.dot(away);
        let front = cosine.above(0.0);
        let (flags, offset) = (record[15] & FLAGS, (record[15] & !FLAGS).to_num_bits());
        let mut radiance = vector(&record, 12).only(front | (flags & TWO_SIDED).is(TWO_SIDED));
        let varying = (flags & VARYING).is(VARYING);
        if self.varies && varying.any() {
            radiance = Vector::select(varying, self.varying(scene, varying, place, [v, w], front), radiance);
        }
        let distance2 = away.length_squared();
        let nearness = 1.0 / distance2.sqrt();
        let pdf = probability * distance2 / (cosine * nearness).abs();
        let valid = !radiance.is_zero() & !cosine.is_zero() & pdf.above(0.0) & pdf.is_finite();
        let position = on + normal * offset.copysign(cosine);
        EmitterSample { valid, position, wi: away * -nearness, radiance, pdf }
    }

    /// Chooses emissive triangles for receivers by `u`. Returns their indices among the emitters, their
    /// probabilities and the remainders of `u`; `None` if there are none.
    #[inline(always)]
    pub(super) fn choose<L: Lanes>(&self, to: &Receiver<L>, u: Num<L>) -> Option<(Int<L>, Num<L>, Num<L>)> {
        match &self.tree {
            Some(tree) => Some(tree.choose(to, u)),
            None => self.table.choose(u),
        }
    }

    /// The probabilities with which [`Emitters::choose`] returns these emitters.
    #[inline(always)]
    pub(super) fn probability<L: Lanes>(&self, to: &Receiver<L>, place: Int<L>) -> Num<L> {
        match &self.tree {
            Some(tree) => tree.probability(to, place),
            None => self.table.probability(place),
        }
    }

    /// Radiance of emitters that differ from point to point. The points are given by the weights of the second and
    /// third corner. Lanes are looked up one by one, since such emitters are few.
    fn varying<L: Lanes>(
        &self,
        scene: &Scene,
        lanes: Mask<L>,
        place: Int<L>,
        [v, w]: [Num<L>; 2],
        front: Mask<L>,
    ) -> Vector<L> {
        let l = v.lanes();
        let (place, v, w) = (place.to_array(), v.to_array(), w.to_array());
        let mut radiance = [L::array(0.0); 3];
        for lane in lanes.iter() {
            let place = place[lane] as usize;
            let at = [v[lane], w[lane]];
            let primitive = self.primitives[place];
            let light = radiance_at(scene, &self.emissions[place], primitive, at, front.test(lane));
            for (channel, light) in radiance.iter_mut().zip(light.to_array()) {
                channel[lane] = light;
            }
        }
        let [r, g, b] = &radiance;
        Vector::new(Num::from_array(l, r), Num::from_array(l, g), Num::from_array(l, b))
    }

    /// Density per solid angle with which [`Emitters::sample`] returns a point of a triangle to a receiver.
    /// `distance2` is the squared distance, `cosine` the cosine to the triangle's normal. 0 if the triangle
    /// emits nothing.
    #[inline(always)]
    pub fn pdf<L: Lanes>(
        &self,
        to: &Receiver<L>,
        primitive: Int<L>,
        distance2: Num<L>,
        cosine: Num<L>,
    ) -> Num<L> {
        self.pdf_of(primitive, distance2, cosine, |place| self.probability(to, place))
    }

    /// Density per solid angle with which [`Emitters::sample_by_power`] returns a point of a triangle.
    #[inline(always)]
    pub fn pdf_by_power<L: Lanes>(&self, primitive: Int<L>, distance2: Num<L>, cosine: Num<L>) -> Num<L> {
        self.pdf_of(primitive, distance2, cosine, |place| self.table.probability(place))
    }

    /// Density per solid angle of points of triangles that are chosen with a probability.
    #[inline(always)]
    fn pdf_of<L: Lanes>(
        &self,
        primitive: Int<L>,
        distance2: Num<L>,
        cosine: Num<L>,
        probability: impl Fn(Int<L>) -> Num<L>,
    ) -> Num<L> {
        if self.places.is_empty() {
            return Num::zero(cosine.lanes());
        }
        let [place] = primitive.rows(&self.places);
        let there = !place.is(NONE);
        let place = place.at_most(self.records.len() as u32 - 1);
        let area = place.of(&self.areas);
        (probability(place) * distance2 / (cosine.abs() * area)).only(there)
    }
}

impl Record {
    /// The record of a triangle, and the triangle's area.
    fn new(scene: &Scene, primitive: u32, emission: &Emission) -> (Self, f32) {
        let corners = scene.mesh.corners(primitive);
        let lanes = corners.map(Vector::from);
        let plane = offset::plane(&lanes, Vec3::ZERO.into());
        let area = 0.5 * plane.twice_area.get();
        let flags = if is_even(scene, primitive, emission) { 0 } else { VARYING }
            | if emission.two_sided { TWO_SIDED } else { 0 };
        let record = Self {
            corners: corners.map(|corner| corner.to_array()),
            normal: (Vec3::from(plane.normal) * area).to_array(),
            radiance: emission.radiance.factor.max(Vec3::ZERO).to_array(),
            offset_and_flags: (plane.offset.get() / area).to_bits() & !FLAGS | flags,
        };
        (record, area)
    }

    #[inline(always)]
    fn load<L: Lanes>(records: &[Self], place: Int<L>) -> [Int<L>; WORDS] {
        let rows: &[u32] = bytemuck::cast_slice(records);
        let [a, b, c, d, e, f, g, h] = (place << 1).rows(rows);
        let [i, j, k, l, m, n, o, p] = ((place << 1) + 1).rows(rows);
        [a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p]
    }

    fn bounds(&self, power: f32) -> LightBounds {
        let [a, b, c] = self.corners.map(Vec3::from_array);
        let plane = offset::plane(&[a, b, c].map(Vector::from), Vec3::Z.into());
        LightBounds {
            low: a.min(b).min(c),
            high: a.max(b).max(c),
            axis: plane.normal.into(),
            spread: 0.0,
            reach: FRAC_PI_2,
            power,
            two_sided: self.offset_and_flags & TWO_SIDED != 0,
        }
    }
}

/// Three numbers of a record, starting at word `at`.
#[inline(always)]
fn vector<L: Lanes>(record: &[Int<L>; WORDS], at: usize) -> Vector<L> {
    Vector::new(record[at].to_num_bits(), record[at + 1].to_num_bits(), record[at + 2].to_num_bits())
}

/// Radiance at a point of a triangle, less what alpha lets pass. The point is given by the weights of the second and
/// third corner.
fn radiance_at(scene: &Scene, emission: &Emission, primitive: u32, [v, w]: [f32; 2], front: bool) -> Vec3 {
    let point = TexturePoint::on(&scene.mesh, primitive, v, w);
    let radiance: Vec3 = lookup::emission(scene, emission, &point, front.into()).into();
    radiance * scene.coverage(primitive, v, w)
}

/// True if a triangle shines alike at all points.
fn is_even(scene: &Scene, primitive: u32, emission: &Emission) -> bool {
    emission.radiance.is_constant() && !scene.is_masked(primitive)
}

/// Luminous power: exact if it is the same everywhere, else estimated.
fn power(scene: &Scene, primitive: u32, area: f32, emission: &Emission) -> f32 {
    let brightness = if is_even(scene, primitive, emission) {
        luminance(emission.radiance.factor)
    } else {
        let probes = PROBES.map(|at| luminance(radiance_at(scene, emission, primitive, at, true)));
        probes.iter().sum::<f32>() / PROBES.len() as f32
    };
    let sides = if emission.two_sided { 2.0 } else { 1.0 };
    sides * PI * brightness.max(0.0) * area
}

/// For each material of a scene, true if it computes opacity, or a part of it does if it is a mix.
pub(super) fn materials_of_computed_opacity(scene: &Scene) -> Vec<bool> {
    sought_materials(scene, |material| scene.computes_opacity(material))
}
