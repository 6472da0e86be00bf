//! The inverse of lens distortion, in lanes. It takes a fixed number of steps, so every SIMD level gives the same bits.

use super::aperture::turned;
use super::{Distortion, Intrinsics};
use crate::lanes::{Lanes, Mask, Num, Vector};
use serde::{Deserialize, Serialize};
use std::f32::consts::TAU;
use std::f64::consts::PI;

/// Halvings of the interval of radii, after which Newton's method does not run in circles.
const HALVINGS: u32 = 6;
/// Newton steps of the search for a radius.
const RADIUS_STEPS: u32 = 10;
/// Newton steps in the plane, which start next to the solution.
const PLANE_STEPS: u32 = 6;
/// Greatest error of a solution in distorted coordinates, as a share of 1 + their size. The rounding of polynomials
/// is some parts in 10⁷; beyond the edge of what a lens sees nothing comes close.
const TOLERANCE: f32 = 4e-6;
/// Largest tangent of the angle to the view axis that is looked for.
const MAX_RADIUS: f64 = 1e3;

/// Intrinsics with distortion, prepared for a picture: finds the directions that pixels see.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct Undistortion {
    /// Whole and fractional parts of the principal point, so that pixel coordinates lose no digits.
    centre: [[f32; 2]; 2],
    per_pixel: [f32; 2],
    radial: Radial,
    plane: Option<Plane>,
}

/// The distance of a point from the view axis after distortion: r·N(r²)/D(r²). For fisheye lenses r is an angle, for
/// others the tangent of an angle.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Radial {
    /// Coefficients of N(s) = 1 + n1 s + .. + n4 s⁴.
    numerator: [f32; 4],
    /// Coefficients of D(s) = 1 + d1 s + d2 s² + d3 s³.
    denominator: [f32; 3],
    /// The function increases from 0 to this radius at least, which is as much as the picture needs.
    limit: f32,
    /// The function at the limit.
    reach: f32,
}

/// Tangential and prism coefficients.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Plane {
    p: [f32; 2],
    s: [f32; 4],
}

impl Undistortion {
    /// `None` if there is no distortion.
    pub(super) fn new(intrinsics: &Intrinsics, width: u32, height: u32) -> Option<Self> {
        let Intrinsics { fx, fy, cx, cy, distortion } = *intrinsics;
        let (numerator, denominator, plane, end) = match distortion {
            Distortion::None => return None,
            Distortion::BrownConrady { k: [k1, k2, k3, k4, k5, k6], p, s } => {
                let plane = Plane { p: p.map(|p| p as f32), s: s.map(|s| s as f32) };
                ([k1, k2, k3, 0.0], [k4, k5, k6], Some(plane), MAX_RADIUS)
            }
            Distortion::Fisheye { k } => (k, [0.0; 3], None, PI),
        };
        // The farthest corner, with room for pixel filters and for what moves points sideways.
        let across = |c: f64, size: u32, f: f64| (c.abs().max((f64::from(size) - c).abs()) + 16.0) / f;
        let farthest = 1.5 * across(cx, width, fx).hypot(across(cy, height, fy));
        let (limit, reach) = increasing(&numerator, &denominator, farthest, end);
        let part = |c: f64| [c.floor() as f32, (c - c.floor()) as f32];
        Some(Self {
            centre: [part(cx), part(cy)],
            per_pixel: [(1.0 / fx) as f32, (1.0 / fy) as f32],
            radial: Radial {
                numerator: numerator.map(|n| n as f32),
                denominator: denominator.map(|d| d as f32),
                limit: limit as f32,
                reach: reach as f32,
            },
            plane,
        })
    }

    /// The directions that points of the picture see, in the axes of the camera (right, up, forward), not normalised,
    /// and the lanes in which there is one.
    #[inline(always)]
    pub(super) fn directions<L: Lanes>(
        &self,
        [x, y]: [Num<L>; 2],
        place: [Num<L>; 2],
    ) -> (Vector<L>, Mask<L>) {
        let [[cx, cx_part], [cy, cy_part]] = self.centre;
        let x = ((x - cx) + (place[0] - cx_part)) * self.per_pixel[0];
        let y = ((y - cy) + (place[1] - cy_part)) * self.per_pixel[1];
        let distance = (x * x + y * y).sqrt();
        let (radius, exists) = self.radial.solve(distance);
        let is_centre = distance.below(1e-20);
        let Some(plane) = &self.plane else {
            let (sine, cosine) = turned(radius * (1.0 / TAU));
            let scale = Num::select(is_centre, Num::splat(x.lanes(), 1.0), sine / distance);
            return (Vector::new(x * scale, -(y * scale), cosine), exists);
        };
        let scale = Num::select(is_centre, Num::splat(x.lanes(), 1.0), radius / distance);
        let start = [x * scale, y * scale];
        let ([a, b], exists_in_plane) = self.radial.solve_plane(plane, [x, y], start);
        (Vector::new(a, -b, Num::splat(x.lanes(), 1.0)), exists & exists_in_plane)
    }
}

impl Radial {
    /// N/D and its derivative, as functions of s = r².
    #[inline(always)]
    fn ratio<L: Lanes>(&self, s: Num<L>) -> [Num<L>; 2] {
        let [n1, n2, n3, n4] = self.numerator;
        let [d1, d2, d3] = self.denominator;
        let n = (((s * n4 + n3) * s + n2) * s + n1) * s + 1.0;
        let n_slope = ((s * (4.0 * n4) + 3.0 * n3) * s + 2.0 * n2) * s + n1;
        let d = ((s * d3 + d2) * s + d1) * s + 1.0;
        let d_slope = (s * (3.0 * d3) + 2.0 * d2) * s + d1;
        let ratio = n / d;
        [ratio, (n_slope - ratio * d_slope) / d]
    }

    /// The radius that distortion moves to a distance, and the lanes in which there is one.
    #[inline(always)]
    fn solve<L: Lanes>(&self, distance: Num<L>) -> (Num<L>, Mask<L>) {
        let l = distance.lanes();
        let (mut low, mut high) = (Num::zero(l), Num::splat(l, self.limit));
        let mut radius = 0.5 * high;
        for step in 0..HALVINGS + RADIUS_STEPS {
            let s = radius * radius;
            let [ratio, slope] = self.ratio(s);
            let off = radius * ratio - distance;
            let is_beyond = off.above(0.0);
            high = Num::select(is_beyond, radius, high);
            low = Num::select(is_beyond, low, radius);
            let newton = radius - off / (ratio + 2.0 * s * slope);
            let is_taken = newton.ge(low) & newton.le(high) & Mask::splat(l, step >= HALVINGS);
            radius = Num::select(is_taken, newton, 0.5 * (low + high));
        }
        let [ratio, _] = self.ratio(radius * radius);
        let is_near = (radius * ratio - distance).abs().le((distance + 1.0) * TOLERANCE);
        (radius, is_near & distance.le(Num::splat(l, self.reach)))
    }

    /// The point that distortion moves to `to`, by Newton's method from `point`, and the lanes in which there is one.
    #[inline(always)]
    fn solve_plane<L: Lanes>(
        &self,
        plane: &Plane,
        to: [Num<L>; 2],
        mut point: [Num<L>; 2],
    ) -> ([Num<L>; 2], Mask<L>) {
        for _ in 0..PLANE_STEPS {
            let (off, [xx, xy, yx, yy]) = self.distort(plane, point, to);
            let by_determinant = 1.0 / (xx * yy - xy * yx);
            point[0] -= (off[0] * yy - off[1] * xy) * by_determinant;
            point[1] -= (off[1] * xx - off[0] * yx) * by_determinant;
        }
        let (off, [xx, xy, yx, yy]) = self.distort(plane, point, to);
        let tolerance = (to[0].abs() + to[1].abs() + 1.0) * TOLERANCE;
        let is_near = (off[0].abs() + off[1].abs()).le(tolerance);
        // Beyond a fold of the picture lies a second solution, which mirrors the scene.
        (point, is_near & (xx * yy).gt(xy * yx) & (xx + yy).above(0.0))
    }

    /// Distance by which distortion moves a point past `to`, and the derivatives: xx, xy (of x by y), yx, yy.
    #[inline(always)]
    fn distort<L: Lanes>(
        &self,
        plane: &Plane,
        [x, y]: [Num<L>; 2],
        to: [Num<L>; 2],
    ) -> ([Num<L>; 2], [Num<L>; 4]) {
        let ([p1, p2], [s1, s2, s3, s4]) = (plane.p, plane.s);
        let (x2, y2, xy) = (x * x, y * y, x * y);
        let s = x2 + y2;
        let [ratio, slope] = self.ratio(s);
        let off_x = x * ratio + xy * (2.0 * p1) + (s + 2.0 * x2) * p2 + (s * s2 + s1) * s - to[0];
        let off_y = y * ratio + (s + 2.0 * y2) * p1 + xy * (2.0 * p2) + (s * s4 + s3) * s - to[1];
        // The derivatives of the prism's terms by s.
        let (prism_x, prism_y) = (s * (2.0 * s2) + s1, s * (2.0 * s4) + s3);
        let cross = 2.0 * xy * slope;
        let xx = ratio + 2.0 * x2 * slope + y * (2.0 * p1) + x * (6.0 * p2) + 2.0 * x * prism_x;
        let xy = cross + x * (2.0 * p1) + y * (2.0 * p2) + 2.0 * y * prism_x;
        let yx = cross + x * (2.0 * p1) + y * (2.0 * p2) + 2.0 * x * prism_y;
        let yy = ratio + 2.0 * y2 * slope + y * (6.0 * p1) + x * (2.0 * p2) + 2.0 * y * prism_y;
        ([off_x, off_y], [xx, xy, yx, yy])
    }
}

/// End of the increase of r·N(r²)/D(r²) from r = 0, and the value there. Looks no farther than to where it exceeds
/// `enough`, and to `end`.
fn increasing(numerator: &[f64; 4], denominator: &[f64; 3], enough: f64, end: f64) -> (f64, f64) {
    let [n1, n2, n3, n4] = *numerator;
    let [d1, d2, d3] = *denominator;
    // D, the function, its slope.
    let at = |r: f64| {
        let s = r * r;
        let n = (((s * n4 + n3) * s + n2) * s + n1) * s + 1.0;
        let n_slope = ((s * 4.0 * n4 + 3.0 * n3) * s + 2.0 * n2) * s + n1;
        let d = ((s * d3 + d2) * s + d1) * s + 1.0;
        let d_slope = (s * 3.0 * d3 + 2.0 * d2) * s + d1;
        let ratio = n / d;
        [d, r * ratio, ratio + 2.0 * s * (n_slope - ratio * d_slope) / d]
    };
    let increases = |r: f64| {
        let [d, _, slope] = at(r);
        d > 0.0 && slope > 0.0
    };
    let mut r = 0.0;
    loop {
        let next = (r + (enough.min(1.0) + r) / 512.0).min(end);
        if !increases(next) {
            let (mut low, mut high) = (r, next);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if increases(middle) { low = middle } else { high = middle }
            }
            return (low, at(low)[1]);
        }
        r = next;
        if at(r)[1] > enough || r >= end {
            return (r, at(r)[1]);
        }
    }
}
