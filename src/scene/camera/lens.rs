//! A camera with a picture size: converts pixels to rays.

use super::aperture::turned;
use super::distortion::Undistortion;
use super::{Aperture, Camera, Intrinsics, Projection};
use crate::lanes::{LaneTask, Lanes, Mask, Num, SimdLevel, Vector};
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// A camera with a picture size. It converts points of the picture to rays.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Lens {
    /// Position of the camera: the middle of its lens.
    pub eye: Vec3,
    /// The axes of the camera.
    right: Vec3,
    up: Vec3,
    forward: Vec3,
    size: [u32; 2],
    form: Form,
    aperture: Option<Aperture>,
}

/// Conversion of pixels.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
enum Form {
    Central(Pinhole),
    /// The rays start on a plane: its corner and steps, relative to the eye.
    Parallel(Grid),
    Distorted(Undistortion, [f32; 2]),
    Panorama,
}

/// A parallelogram of pixels.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Grid {
    /// The top left corner.
    corner: Vec3,
    step_x: Vec3,
    step_y: Vec3,
}

impl Grid {
    #[inline(always)]
    fn points<L: Lanes>(&self, x: Num<L>, y: Num<L>, place: [Num<L>; 2]) -> Vector<L> {
        let l = x.lanes();
        let across = Vector::splat(l, self.step_x) * (x + place[0]);
        let down = Vector::splat(l, self.step_y) * (y + place[1]);
        Vector::splat(l, self.corner) + across + down
    }

    fn step(&self) -> f32 {
        (self.step_x.length() * self.step_y.length()).sqrt()
    }
}

/// A lens whose rays all start at the eye and pass through a plane.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct Pinhole {
    /// Origin of all camera rays.
    pub(crate) eye: Vec3,
    grid: Grid,
}

impl Pinhole {
    /// The unit directions through points of the picture: see [`Lens::rays`].
    #[inline(always)]
    pub(crate) fn directions<L: Lanes>(&self, x: Num<L>, y: Num<L>, place: [Num<L>; 2]) -> Vector<L> {
        self.grid.points(x, y, place).normalize()
    }
}

/// Camera rays in lanes.
#[derive(Clone, Copy, Debug)]
pub struct LensRays<L: Lanes> {
    /// Origins.
    pub origin: Vector<L>,
    /// Unit directions.
    pub direction: Vector<L>,
    /// The lanes in which there is a ray. Elsewhere distortion leads nothing to that point of the picture.
    pub exist: Mask<L>,
}

impl Lens {
    /// See [`Camera::lens`].
    pub(super) fn new(camera: &Camera, [right, up, forward]: [Vec3; 3], [width, height]: [u32; 2]) -> Self {
        let eye = camera.eye;
        // A centred grid that is `half_width` and `half_height` large, shifted.
        let grid = |middle: Vec3, half_width: f32, half_height: f32| {
            let mut grid = Grid {
                corner: middle - right * half_width + up * half_height,
                step_x: right * (2.0 * half_width / width as f32),
                step_y: up * (-2.0 * half_height / height as f32),
            };
            if camera.shift != glam::Vec2::ZERO {
                grid.corner +=
                    right * (2.0 * half_width * camera.shift.x) + up * (2.0 * half_height * camera.shift.y);
            }
            grid
        };
        let aspect = width as f32 / height as f32;
        let form = match camera.projection {
            Projection::Perspective { fov_degrees } => {
                let half_height = libm::tanf(0.5 * fov_degrees.to_radians());
                let half_width = half_height * width as f32 / height as f32;
                Form::Central(Pinhole { eye, grid: grid(forward, half_width, half_height) })
            }
            Projection::Orthographic { height } => {
                Form::Parallel(grid(Vec3::ZERO, 0.5 * height * aspect, 0.5 * height))
            }
            Projection::Intrinsics(intrinsics) => match Undistortion::new(&intrinsics, width, height) {
                Some(inverse) => {
                    Form::Distorted(inverse, [intrinsics.fx, intrinsics.fy].map(|f| (1.0 / f) as f32))
                }
                None => {
                    let Intrinsics { fx, fy, cx, cy, .. } = intrinsics;
                    let [right, up, forward] = [right, up, forward].map(|axis| axis.as_dvec3());
                    let corner = forward - right * (cx / fx) + up * (cy / fy);
                    let (step_x, step_y) = ((right / fx).as_vec3(), (up / -fy).as_vec3());
                    Form::Central(Pinhole { eye, grid: Grid { corner: corner.as_vec3(), step_x, step_y } })
                }
            },
            Projection::Panorama => Form::Panorama,
        };
        Self { eye, right, up, forward, size: [width, height], form, aperture: camera.aperture }
    }

    /// The lens as a pinhole, if it is one.
    pub(crate) fn pinhole(&self) -> Option<Pinhole> {
        match self.form {
            Form::Central(pinhole) if self.aperture.is_none() => Some(pinhole),
            _ => None,
        }
    }

    /// True if rays depend on where they pass the lens.
    #[inline]
    pub fn has_aperture(&self) -> bool {
        self.aperture.is_some()
    }

    /// The unit direction of the view axis.
    pub fn axis(&self) -> Vec3 {
        self.forward
    }

    /// The rays through points of the picture. (`x`, `y`) is the pixel, with (0, 0) at the top left; `place` is the
    /// position within the pixel, 0..1 on both axes, or beyond for wide pixel filters. `through` selects the points of
    /// the aperture by two numbers in [0, 1); without it all rays pass the middle of the lens.
    #[inline(always)]
    pub fn rays<L: Lanes>(
        &self,
        x: Num<L>,
        y: Num<L>,
        place: [Num<L>; 2],
        through: Option<[Num<L>; 2]>,
    ) -> LensRays<L> {
        let l = x.lanes();
        let (eye, forward) = (Vector::splat(l, self.eye), Vector::splat(l, self.forward));
        let mut exist = Mask::splat(l, true);
        let mut origin = eye;
        let direction = match &self.form {
            Form::Central(pinhole) => pinhole.grid.points(x, y, place),
            Form::Parallel(grid) => {
                origin = eye + grid.points(x, y, place);
                forward
            }
            Form::Distorted(inverse, _) => {
                let (direction, there) = inverse.directions([x, y], place);
                exist = there;
                self.in_world(direction)
            }
            Form::Panorama => self.around(x, y, place),
        };
        if let (Some(aperture), Some(through)) = (&self.aperture, through) {
            let [a, b] = aperture.point(through);
            let aside = Vector::splat(l, self.right) * a + Vector::splat(l, self.up) * b;
            let to_focus = direction * (aperture.focus_distance / direction.dot(forward));
            return LensRays { origin: origin + aside, direction: (to_focus - aside).normalize(), exist };
        }
        LensRays { origin, direction: direction.normalize(), exist }
    }

    /// Directions in the axes of the camera, in world space.
    #[inline(always)]
    fn in_world<L: Lanes>(&self, direction: Vector<L>) -> Vector<L> {
        let l = direction.lanes();
        Vector::splat(l, self.right) * direction.x
            + Vector::splat(l, self.up) * direction.y
            + Vector::splat(l, self.forward) * direction.z
    }

    #[inline(always)]
    fn around<L: Lanes>(&self, x: Num<L>, y: Num<L>, place: [Num<L>; 2]) -> Vector<L> {
        let [width, height] = self.size.map(|size| size as f32);
        let (sin_longitude, cos_longitude) = turned((x + place[0]) * (1.0 / width) - 0.5);
        let (sin_latitude, cos_latitude) = turned(0.25 - (y + place[1]) * (0.5 / height));
        let direction = Vector::new(cos_latitude * sin_longitude, sin_latitude, cos_latitude * cos_longitude);
        self.in_world(direction)
    }

    /// Origin and unit direction of the ray through a point of the picture and the middle of the lens: see
    /// [`Lens::rays`]. `None` if distortion leads nothing there.
    pub fn ray(&self, x: u32, y: u32, place: [f32; 2]) -> Option<(Vec3, Vec3)> {
        let rays = self.rays(Num::from(x as f32), Num::from(y as f32), place.map(Num::from), None);
        rays.exist.get().then(|| (rays.origin.into(), rays.direction.into()))
    }

    /// Number of pixels whose centres see nothing, because distortion leads no ray there.
    pub fn blind_pixels(&self) -> u64 {
        match self.form {
            Form::Distorted(..) => SimdLevel::detect().run(BlindPixels(*self)),
            _ => 0,
        }
    }

    /// The width of a pixel's cone at the lens, and its increase per unit of distance. For lenses that are not a
    /// pinhole these are the values at the middle of the picture.
    pub fn cone(&self) -> [f32; 2] {
        match &self.form {
            Form::Central(pinhole) => [0.0, pinhole.grid.step()],
            Form::Parallel(grid) => [grid.step(), 0.0],
            Form::Distorted(_, [x, y]) => [0.0, (x * y).sqrt()],
            Form::Panorama => {
                let [width, height] = self.size.map(|size| size as f32);
                [0.0, std::f32::consts::PI * (2.0 / (width * height)).sqrt()]
            }
        }
    }
}

/// Counts pixels that see nothing.
struct BlindPixels(Lens);

impl LaneTask for BlindPixels {
    type Output = u64;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) -> u64 {
        let [width, height] = self.0.size;
        let (middle, columns) = ([Num::splat(l, 0.5); 2], crate::lanes::Int::iota(l));
        let mut blind = 0;
        for y in 0..height {
            for left in (0..width).step_by(L::LANES) {
                let x = (columns + left).to_num();
                let rays = self.0.rays(x, Num::splat(l, y as f32), middle, None);
                let inside = Mask::first(l, (width - left) as usize);
                blind += (inside & !rays.exist).count() as u64;
            }
        }
        blind
    }
}
