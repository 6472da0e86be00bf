//! Camera rays alone: a picture of one ray a pixel, flat shaded by the geometric normal in parallel light without
//! shadows. It has what a rasteriser's picture has, and no more.

use super::Order;
use glam::Vec3;
use rayon::prelude::*;
use raystream::bvh::Bvh;
use raystream::lanes::{Int, LaneTask, Lanes, Mask, Num, SimdLevel};
use raystream::render::NewRays;
use raystream::scene::{Camera, CameraError, Lens};
use raystream::stream::{Hit, Ray, Tracer};
use raystream::trace::cpu::CpuTracer;
use std::sync::Arc;

/// Rows that a thread renders at a time; as many as blocks are high, or more.
const BAND: u32 = 32;

/// The share of light that surfaces reflect.
pub const ALBEDO: f32 = 0.8;

/// The unit direction from which light comes.
pub fn to_light() -> Vec3 {
    Vec3::new(0.4, 1.0, 0.3).normalize()
}

/// Shade of a triangle seen along `direction`, 0 to 255: of the side that is seen, if light falls on it.
pub fn shade([a, b, c]: [Vec3; 3], direction: Vec3) -> u32 {
    let normal = (b - a).cross(c - a);
    let lit = normal.dot(to_light());
    // Seen from the other side the normal points the other way.
    let lit = if normal.dot(direction) > 0.0 { -lit } else { lit };
    let cosine = lit.max(0.0) / normal.length().max(f32::MIN_POSITIVE);
    (cosine * ALBEDO).mul_add(255.0, 0.5) as u32
}

/// A scene with a camera, and the tracer of its rays.
#[derive(Debug)]
pub struct FlatPicture {
    bvh: Arc<Bvh>,
    tracer: CpuTracer,
    lens: Lens,
    /// Columns and rows.
    pub size: [u32; 2],
    /// The pixels of a band of [`BAND`] rows, and of the last one, in the order of their rays.
    bands: [Vec<u32>; 2],
}

/// Memory of a thread.
#[derive(Default)]
struct Scratch {
    rays: Vec<Ray>,
    hits: Vec<Hit>,
}

impl FlatPicture {
    /// A picture of a tree's triangles.
    ///
    /// # Errors
    /// When the camera gives no view.
    pub fn new(bvh: Arc<Bvh>, camera: &Camera, size: [u32; 2]) -> Result<Self, CameraError> {
        let [width, height] = size;
        let lens = camera.lens(width, height)?;
        let tracer =
            CpuTracer::new(bvh.clone(), None, SimdLevel::detect()).expect("what is detected is there");
        let order = |rows| if rows > 0 { Order::Blocks.pixels(width, rows) } else { Vec::new() };
        let bands = [order(BAND.min(height)), order(height % BAND)];
        Ok(Self { bvh, tracer, lens, size, bands })
    }

    /// The camera's rays through the middles of the pixels, band after band.
    pub fn rays(&self) -> Vec<Ray> {
        let mut all = Vec::new();
        for (first, order) in self.in_bands() {
            let mut rays = Vec::new();
            self.make_rays(first, order, &mut rays);
            all.extend(rays);
        }
        all
    }

    /// The hits of [`FlatPicture::rays`], each at its pixel.
    pub fn hits(&self) -> Vec<Hit> {
        let rays = self.rays();
        let mut traced = vec![Hit::NONE; rays.len()];
        self.tracer.closest(&rays, &mut traced);
        let mut hits = traced.clone();
        let pixels = self.in_bands().into_iter().flat_map(|(first, order)| {
            order.iter().map(move |pixel| (first * self.size[0] + pixel) as usize)
        });
        for (pixel, hit) in pixels.zip(traced) {
            hits[pixel] = hit;
        }
        hits
    }

    /// Traces rays into `hits`, as many, on the current rayon pool.
    pub fn trace(&self, rays: &[Ray], hits: &mut [Hit]) {
        let most = (self.size[0] * BAND) as usize;
        let chunks = rays.par_chunks(most).zip(hits.par_chunks_mut(most));
        chunks.for_each(|(rays, hits)| self.tracer.closest(rays, hits));
    }

    /// Renders the picture on the current rayon pool: rays, hits, shades. Each pixel becomes a grey of 8 bits a channel
    /// with an alpha of 255, or 0 where there is nothing.
    ///
    /// # Panics
    /// If there are not as many pixels as in the picture.
    pub fn render(&self, pixels: &mut [u32]) {
        let [width, height] = self.size;
        assert_eq!(pixels.len(), width as usize * height as usize, "a picture of {width} x {height}");
        let bands = pixels.par_chunks_mut((width * BAND) as usize).zip(self.in_bands());
        bands.for_each_init(Scratch::default, |scratch, (band, (first, order))| {
            self.make_rays(first, order, &mut scratch.rays);
            scratch.hits.resize(scratch.rays.len(), Hit::NONE);
            self.tracer.closest(&scratch.rays, &mut scratch.hits);
            for ((&pixel, ray), hit) in order.iter().zip(&scratch.rays).zip(&scratch.hits) {
                band[pixel as usize] = self.colour(ray, hit);
            }
        });
    }

    /// The first row of each band and the order of its pixels.
    fn in_bands(&self) -> Vec<(u32, &[u32])> {
        let whole = (0..self.size[1] / BAND).map(|band| (band * BAND, &*self.bands[0]));
        let rest = self.size[1] % BAND;
        whole.chain((rest > 0).then(|| (self.size[1] - rest, &*self.bands[1]))).collect()
    }

    fn make_rays(&self, first: u32, order: &[u32], rays: &mut Vec<Ray>) {
        rays.clear();
        rays.resize(order.len(), Ray::default());
        SimdLevel::detect().run(MakeRays { lens: &self.lens, width: self.size[0], first, order, rays });
    }

    #[inline]
    fn colour(&self, ray: &Ray, hit: &Hit) -> u32 {
        if hit.is_miss() {
            return 0;
        }
        let grey = shade(self.bvh.corners(hit.primitive), Vec3::from(ray.direction));
        (grey * 0x01_01_01) | (0xff << 24)
    }
}

/// Makes the rays of a band.
struct MakeRays<'a> {
    lens: &'a Lens,
    width: u32,
    first: u32,
    order: &'a [u32],
    rays: &'a mut [Ray],
}

impl LaneTask for MakeRays<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let middle = [Num::splat(l, 0.5); 2];
        let (mut xs, mut ys) = (L::array(0), L::array(0));
        for (pixels, rays) in self.order.chunks(L::LANES).zip(self.rays.chunks_mut(L::LANES)) {
            for (lane, &pixel) in pixels.iter().enumerate() {
                (xs[lane], ys[lane]) = (pixel % self.width, self.first + pixel / self.width);
            }
            let (x, y) = (Int::from_array(l, &xs).to_num(), Int::from_array(l, &ys).to_num());
            let made = self.lens.rays(x, y, middle, None);
            // A direction of 0 hits nothing; no perspective has one.
            let rows = NewRays::new(made.origin, made.direction).rows(Mask::splat(l, true));
            rays.copy_from_slice(&bytemuck::cast_slice::<[f32; 8], Ray>(rows.as_ref())[..rays.len()]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use raystream::scene::generate;
    use raystream::trace::cpu::Oracle;

    #[test]
    fn each_pixel_has_the_shade_of_what_its_ray_hits() {
        let (positions, triangles) = generate::terrain(20);
        let bvh = Arc::new(Bvh::build(&positions, &triangles, |_| false));
        let camera = Camera::framing(&bvh.bounds(), 1.0);
        // The last band is shorter, and its width no multiple of lanes.
        let size = [75, 90];
        let picture = FlatPicture::new(bvh.clone(), &camera, size).expect("a view");
        let mut pixels = vec![1; 75 * 90];
        picture.render(&mut pixels);
        let (oracle, lens) = (Oracle::new(bvh.clone(), None), camera.lens(75, 90).expect("a view"));
        let hits = picture.hits();
        let mut seen = 0;
        for (i, (&pixel, found)) in pixels.iter().zip(&hits).enumerate() {
            let (origin, direction) =
                lens.ray(i as u32 % 75, i as u32 / 75, [0.5; 2]).expect("no distortion");
            let hit = oracle.closest_one(&Ray::new(origin, direction));
            assert_eq!(&hit, found);
            let expected = if hit.is_miss() {
                0
            } else {
                let [a, b, c] = bvh.corners(hit.primitive);
                let up = (b - a).cross(c - a).normalize();
                let up = if up.dot(direction) > 0.0 { -up } else { up };
                seen += 1;
                (255.0 * 0.8 * up.dot(to_light()).max(0.0)).round() as u32
            };
            assert!((pixel & 255).abs_diff(expected) <= 1, "{i}: {pixel:x}, {expected}");
            assert_eq!(pixel >> 24, if hit.is_miss() { 0 } else { 255 });
        }
        assert!(seen > 75 * 90 / 4, "{seen}");
    }
}
