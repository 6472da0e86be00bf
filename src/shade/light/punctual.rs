//! Point, spot and directional lights.

use super::{AliasTable, FEW, LightBounds, LightSample, LightTree, Receiver};
use crate::lanes::{Int, Lanes, Mask, Num, Vector};
use crate::scene::{Light, LightShape};
use crate::shade::lookup::luminance;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use std::f32::consts::{FRAC_PI_2, PI};

/// All lights that no ray can hit. A few are chosen by power. If there are many point and spot lights, a
/// light tree chooses among those.
#[derive(Clone, Debug, Default)]
pub struct Punctual {
    records: Vec<Record>,
    power: f64,
    /// The lights that are not in the tree, by power.
    table: AliasTable,
    tree: Option<LocalLights>,
}

/// Point and spot lights with a tree.
#[derive(Clone, Debug)]
struct LocalLights {
    tree: LightTree,
    /// Index among all lights of each light of the tree.
    lights: Vec<u32>,
    /// Probability of choosing from the tree instead of from the table.
    tree_probability: f32,
}

impl Punctual {
    /// The punctual lights of a scene of radius `scene_radius`.
    pub fn new(lights: &[Light], scene_radius: f32) -> Self {
        let mut powers: Vec<f64> = lights.iter().map(|light| f64::from(power(light, scene_radius))).collect();
        let total: f64 = powers.iter().sum();
        let (places, near): (Vec<u32>, Vec<LightBounds>) = (0..)
            .zip(lights)
            .filter_map(|(place, light)| Some((place, bounds(light)?)))
            .filter(|(_, bounds)| bounds.power > 0.0 && bounds.power.is_finite())
            .unzip();
        let mut tree = None;
        if near.len() > FEW {
            places.iter().for_each(|&place| powers[place as usize] = 0.0);
            let far: f64 = powers.iter().sum();
            let [tree_probability, _] = super::probabilities([total - far, far]);
            tree = Some(LocalLights { tree: LightTree::new(&near), lights: places, tree_probability });
        }
        let records = lights.iter().map(Record::from).collect();
        Self { records, power: total, table: AliasTable::new(&powers), tree }
    }

    /// Number of lights.
    #[inline]
    pub fn len(&self) -> usize {
        self.records.len()
    }

    /// True if there are no lights.
    pub fn is_empty(&self) -> bool {
        self.records.is_empty()
    }

    /// Total luminous power.
    pub fn power(&self) -> f64 {
        self.power
    }

    /// True if there are so many lights that a [`LightTree`] chooses. The choice then depends on the
    /// receiver's normal.
    #[inline]
    pub fn are_many(&self) -> bool {
        self.tree.is_some()
    }

    /// Chooses lights for receivers by `u`. Returns their indices and probabilities; `None` if there are
    /// none.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn choose<L: Lanes>(&self, to: &Receiver<L>, u: Num<L>) -> Option<(Int<L>, Num<L>)> {
        let Some(LocalLights { tree, lights, tree_probability }) = &self.tree else {
            let (index, probability, _) = self.table.choose(u)?;
            return Some((index, probability));
        };
        let near = u.below(*tree_probability);
        let (place, by_tree, _) =
            tree.choose(to, (u * (1.0 / tree_probability)).clamp(0.0, 1.0 - f32::EPSILON));
        let [mut index] = place.rows(lights);
        let mut probability = by_tree * *tree_probability;
        if !near.all() {
            let rest =
                ((u - *tree_probability) * (1.0 / (1.0 - tree_probability))).clamp(0.0, 1.0 - f32::EPSILON);
            let (far, by_power, _) = self.table.choose(rest)?;
            index = Int::select(near, index, far);
            probability = Num::select(near, probability, by_power * (1.0 - tree_probability));
        }
        Some((index, probability))
    }

    /// The light that lights `index` send to points, if nothing occludes it. A spot light sends none outside
    /// of its cone. [`LightSample::pdf`] is 1.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn illuminate<L: Lanes>(&self, index: Int<L>, from: Vector<L>) -> LightSample<L> {
        let record: [Num<L>; WORDS] = index.rows_of(bytemuck::cast_slice(&self.records));
        let kind = record[11].to_bits();
        let (spot, far) = (kind.is(SPOT), kind.is(DIRECTIONAL));
        let position = Vector::new(record[0], record[1], record[2]);
        let direction = Vector::new(record[3], record[4], record[5]);
        let intensity = Vector::new(record[6], record[7], record[8]);
        let towards = position - from;
        let distance2 = towards.length_squared();
        let wi = Vector::select(far, -direction, towards * (1.0 / distance2.sqrt()));
        let inside = (-wi).dot(direction) - record[9];
        let edge = (inside * record[10]).clamp(0.0, 1.0);
        let one = Num::splat(from.lanes(), 1.0);
        let share = Num::select(spot, edge * edge, one);
        let radiance = Vector::select(far, intensity, intensity * (share / distance2));
        let valid = wi.length_squared().is_finite() & !radiance.is_zero();
        LightSample {
            valid,
            wi,
            target: position,
            near: !far,
            radiance,
            pdf: one,
            delta: Mask::splat(from.lanes(), true),
        }
    }
}

/// A light in the form that lanes gather.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Record {
    position: [f32; 3],
    /// Direction of a spot or directional light.
    direction: [f32; 3],
    intensity: [f32; 3],
    /// Cosine of a spot light's outer angle, and the factor for the excess of a cosine over it.
    cos_outer: f32,
    steepness: f32,
    kind: u32,
}

/// Words of a [`Record`].
const WORDS: usize = size_of::<Record>() / 4;

const POINT: u32 = 0;
const SPOT: u32 = 1;
const DIRECTIONAL: u32 = 2;

impl From<&Light> for Record {
    fn from(light: &Light) -> Self {
        let mut record = Self { intensity: light.intensity.to_array(), ..Self::zeroed() };
        match light.shape {
            LightShape::Point { position } => {
                (record.kind, record.position) = (POINT, position.to_array());
            }
            LightShape::Spot { position, direction, cos_inner, cos_outer } => {
                (record.kind, record.position) = (SPOT, position.to_array());
                record.direction = direction.to_array();
                record.cos_outer = cos_outer;
                record.steepness = 1.0 / (cos_inner - cos_outer).max(1e-4);
            }
            LightShape::Directional { direction } => {
                (record.kind, record.direction) = (DIRECTIONAL, direction.to_array());
            }
        }
        record
    }
}

/// Luminous power that a light sends into a scene of the given radius.
fn power(light: &Light, scene_radius: f32) -> f32 {
    let solid_angle = match light.shape {
        LightShape::Point { .. } => 4.0 * PI,
        LightShape::Spot { cos_inner, cos_outer, .. } => {
            2.0 * PI * (1.0 - 0.5 * (cos_inner + cos_outer)).max(0.0)
        }
        LightShape::Directional { .. } => PI * scene_radius * scene_radius,
    };
    luminance(light.intensity).max(0.0) * solid_angle
}

/// Bounds of a light's position and directions. A point light emits in all directions. A spot light is
/// constant up to the inner angle and then falls off. Its power counts as if it emitted in all directions,
/// since that is what a point within the cone receives. `None` for a directional light, which has no
/// position.
fn bounds(light: &Light) -> Option<LightBounds> {
    let (at, axis, spread, reach) = match light.shape {
        LightShape::Point { position } => (position, Vec3::Z, PI, FRAC_PI_2),
        LightShape::Spot { position, direction, cos_inner, cos_outer } => {
            let (inner, outer) = (libm::acosf(cos_inner), libm::acosf(cos_outer));
            (position, direction, inner, (outer - inner).clamp(0.0, FRAC_PI_2))
        }
        LightShape::Directional { .. } => return None,
    };
    let power = luminance(light.intensity).max(0.0) * 4.0 * PI;
    Some(LightBounds { low: at, high: at, axis, spread, reach, power, two_sided: false })
}
