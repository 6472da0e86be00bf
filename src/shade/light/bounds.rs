//! Bounds of the positions and emission directions of lights, from which light trees are built.

use glam::Vec3;
use std::f32::consts::{FRAC_PI_2, PI};

/// Bounds of one or several lights (Conty Estevez and Kulla 2018, *Importance Sampling of Many Lights with
/// Adaptive Tree Splitting*). All normals are within `spread` of the axis. All light leaves within `reach` of
/// a normal.
#[derive(Clone, Copy, Debug)]
pub struct LightBounds {
    /// Least corner of the bounding box.
    pub low: Vec3,
    /// Greatest corner of the bounding box.
    pub high: Vec3,
    /// Unit axis of the cone of normals.
    pub axis: Vec3,
    /// Greatest angle between the axis and a normal, in radians, 0 to π.
    pub spread: f32,
    /// Greatest angle between a normal and emitted light, in radians, 0 to π / 2.
    pub reach: f32,
    /// Luminous power, > 0.
    pub power: f32,
    /// True if some of the lights emit to both sides.
    pub two_sided: bool,
}

impl LightBounds {
    /// Bounds of the lights of both.
    pub fn union(&self, other: &Self) -> Self {
        let two_sided = self.two_sided || other.two_sided;
        let (axis, spread) = self.cone_with(other);
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            axis,
            spread,
            reach: self.reach.max(other.reach),
            power: self.power + other.power,
            two_sided,
        }
    }

    /// Axis and spread of the smallest cone around both cones.
    fn cone_with(&self, other: &Self) -> (Vec3, f32) {
        // All directions are within it already. Balls have many such cones, and an arc cosine takes long.
        if self.spread >= PI {
            return (self.axis, self.spread);
        }
        let mut cosine = self.axis.dot(other.axis).clamp(-1.0, 1.0);
        let mut towards = other.axis;
        if self.two_sided && other.two_sided && cosine < 0.0 {
            // A two-sided light may use either direction of its axis.
            (cosine, towards) = (-cosine, -towards);
        }
        let between = libm::acosf(cosine);
        if (between + other.spread).min(PI) <= self.spread {
            return (self.axis, self.spread);
        }
        if (between + self.spread).min(PI) <= other.spread {
            return (other.axis, other.spread);
        }
        let spread = 0.5 * (self.spread + between + other.spread);
        let turn = spread - self.spread;
        let Some(aside) = (towards - self.axis * cosine).try_normalize() else {
            // The axes are equal or opposite. No axis between opposite ones is better than another.
            return (self.axis, if cosine > 0.0 { self.spread.max(other.spread) } else { PI });
        };
        if spread >= PI {
            return (self.axis, PI);
        }
        let axis = self.axis * libm::cosf(turn) + aside * libm::sinf(turn);
        (axis.try_normalize().unwrap_or(self.axis), spread)
    }

    /// Centre of the box.
    pub fn centre(&self) -> Vec3 {
        (self.low + self.high) * 0.5
    }

    /// Radius of the sphere around the box.
    pub fn radius(&self) -> f32 {
        (self.high - self.low).length() * 0.5
    }

    /// Cost of a node with these bounds: power × solid angle × surface. The measure of surface is nonzero for
    /// lights in a row too.
    pub fn cost(&self) -> f32 {
        const LEAST: f32 = 1e-3;
        let size = self.high - self.low;
        let surface = 2.0 * (size.x * size.y + size.y * size.z + size.z * size.x);
        let surface = surface.max(LEAST * size.length_squared());
        self.power * self.solid_angle() * surface
    }

    /// Measure of the directions of emission, weighted by the cosine beyond the spread.
    fn solid_angle(&self) -> f32 {
        let (sine, cosine) = (libm::sinf(self.spread), libm::cosf(self.spread));
        let outer = (self.spread + self.reach).min(PI);
        let inner = 2.0 * PI * (1.0 - cosine);
        let rim =
            2.0 * outer * sine - libm::cosf(self.spread - 2.0 * outer) - 2.0 * self.spread * sine + cosine;
        inner + FRAC_PI_2 * rim
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{Sampler, warp};

    fn any(s: &Sampler, at: u32) -> LightBounds {
        let corner = Vec3::from(std::array::from_fn(|k| s.single(at + k as u32)));
        let [u, v] = s.pair(at + 4);
        LightBounds {
            low: corner,
            high: corner + Vec3::splat(v),
            axis: warp::sphere(s.pair(at + 5)),
            spread: u * u * PI,
            reach: FRAC_PI_2,
            power: 1.0 + u,
            two_sided: s.single(at + 6) < 0.3,
        }
    }

    #[test]
    fn a_union_holds_the_boxes_and_the_cones_of_both() {
        let mut narrow = 0;
        for i in 0..4000 {
            let s = Sampler::new(i, 0, 8);
            let (a, b) = (any(&s, 0), any(&s, 10));
            let both = a.union(&b);
            narrow += u32::from(both.spread < PI);
            assert!((both.axis.length() - 1.0).abs() < 1e-5);
            for part in [&a, &b] {
                assert!(both.low.cmple(part.low).all() && both.high.cmpge(part.high).all());
                let mut apart = part.axis.dot(both.axis).clamp(-1.0, 1.0);
                if a.two_sided && b.two_sided {
                    apart = apart.abs();
                }
                assert!(libm::acosf(apart) + part.spread <= both.spread + 2e-3 || both.spread >= PI, "{i}");
            }
        }
        assert!(narrow > 1000, "most cones stay cones: {narrow}");
    }

    #[test]
    fn solid_angles_match_known_lamps() {
        let lamp = |spread, reach| {
            let zero = Vec3::ZERO;
            LightBounds { low: zero, high: zero, axis: Vec3::Y, spread, reach, power: 1.0, two_sided: false }
        };
        // A sphere emits in all directions. A flat lamp emits into its hemisphere, weighted by the cosine.
        assert!((lamp(PI, FRAC_PI_2).solid_angle() - 4.0 * PI).abs() < 1e-4);
        assert!((lamp(0.0, FRAC_PI_2).solid_angle() - PI).abs() < 1e-4);
    }
}
