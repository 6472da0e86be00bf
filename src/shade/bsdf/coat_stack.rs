//! Several coats over a surface. Each may be rough, tinted, or cover only a share of the surface.

use super::albedo::Reflectance;
use super::coat::{Coat, CoatRoughness};
use super::fresnel::mean;
use crate::lanes::{Lanes, Mask, Num, OutlinedTask, Vector, exponential};
use crate::scene::{self, Coats};

/// Coats, outermost first. They are converted to lanes each time they are evaluated: coats are rare, and
/// their numbers take less memory than lanes would.
///
/// Of light reflected by the facets below, each coat passes the lesser of its shares for the two directions.
/// Of light scattered below, all coats together pass the product of all shares over the mean of that product.
/// So a white base under untinted coats stays white, however many coats there are. Light is tinted on its way
/// down and on its way up.
#[derive(Clone, Copy, Debug)]
pub struct CoatStack<L: Lanes> {
    pub coats: Coats,
    pub coat_roughness: CoatRoughness<L>,
}

/// The light that a uniform environment of radiance 1 sends towards one direction.
#[derive(Clone, Copy, Debug)]
pub struct StackAlbedo<L: Lanes> {
    /// Approximate reflection by rough coats. The probability of sampling them is proportional to it.
    pub rough: Num<L>,
    /// Reflection by coats that are mirrors.
    pub smooth: Vector<L>,
    /// Share that passes down to a mirror below and back up.
    pub passed: Vector<L>,
    /// Approximate share that passes if it is scattered below.
    pub scattered: Vector<L>,
}

/// Scattering by the coats from one direction into another.
#[derive(Clone, Copy, Debug)]
pub struct StackScattering<L: Lanes> {
    /// Share that passes down to facets below and back up.
    pub passed: Vector<L>,
    /// Factor by which more of the light passes if it is scattered below.
    pub scattered: Num<L>,
    /// Reflection by rough coats × cosine.
    pub light: Vector<L>,
    /// Density of [`SampleStack`] × [`StackAlbedo::rough`].
    pub density: Num<L>,
}

/// Gaussian quadrature over the cosine of directions, exact for powers of s = (1 − z)⁵ up to the ninth. Each
/// entry is a node and its weight. The weights contain the share that passes a dielectric, 1 − s, over its
/// mean.
const MEAN: [[f32; 2]; 5] = [
    [0.004_603_474, 0.833_605_4],
    [0.119_231_94, 0.128_979_72],
    [0.354_407_43, 0.031_962_79],
    [0.638_767_2, 0.005_185_554],
    [0.880_759_2, 0.000_266_489_94],
];

impl<L: Lanes> CoatStack<L> {
    #[inline(always)]
    fn coat(&self, l: L, of: &scene::Coat) -> Coat<L> {
        let f0 = (of.ior - 1.0) / (of.ior + 1.0);
        let facets = self.coat_roughness.facets(Num::splat(l, of.roughness));
        Coat::new(Num::splat(l, of.weight), facets, f0 * f0)
    }
}

/// Transmittance of a coat's tint for light that goes down or up through the coat. `z` is the cosine outside
/// of the coat.
#[inline(always)]
fn tinted<L: Lanes>(coat: &scene::Coat, z: Num<L>) -> Vector<L> {
    let l = z.lanes();
    let white = Vector::grey(Num::splat(l, 1.0));
    if coat.tint == glam::Vec3::ONE {
        return white;
    }
    let refracted = (1.0 - (1.0 - z * z) * (1.0 / (coat.ior * coat.ior))).clamp(1e-6, 1.0).sqrt();
    let way = Vector::splat(l, -coat.depth()) / refracted;
    let left = Vector::new(exponential::exp(way.x), exponential::exp(way.y), exponential::exp(way.z));
    white * (1.0 - coat.weight) + left * coat.weight
}

/// Sampling weight of a rough coat that the share `reach` of the light reaches.
#[inline(always)]
fn weight<L: Lanes>(reach: Vector<L>, coat: &Coat<L>, near: &Reflectance<L>) -> Num<L> {
    let [single, _] = coat.reflected(near);
    (mean(reach) * single).only(coat.facets.rough)
}

/// Computes a [`StackAlbedo`], out of line.
pub struct StackAlbedoTask<'a, L: Lanes> {
    pub stack: &'a CoatStack<L>,
    pub wo: Vector<L>,
}

impl<L: Lanes> OutlinedTask<L> for StackAlbedoTask<'_, L> {
    type Output = StackAlbedo<L>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, l: L) -> StackAlbedo<L> {
        let Self { stack, wo } = self;
        let white = Vector::grey(Num::splat(l, 1.0));
        let mut albedo =
            StackAlbedo { rough: Num::zero(l), smooth: Vector::zero(l), passed: white, scattered: white };
        for of in stack.coats.iter() {
            let coat = stack.coat(l, of);
            let near = coat.facets.at(wo);
            let [single, _] = coat.reflected(&near);
            albedo.rough += weight(albedo.passed, &coat, &near);
            albedo.smooth += (albedo.passed * single).only(!coat.facets.rough);
            let (passed, tint) = (coat.passed(&near), tinted(of, wo.z));
            let straight = Num::splat(l, 1.0);
            albedo.passed = albedo.passed * tint * tint * passed;
            albedo.scattered = albedo.scattered * tint * tinted(of, straight) * passed;
        }
        albedo
    }
}

/// Computes a [`StackScattering`], out of line. Coats are lit from above in the lanes of `there`; `half` is
/// valid in these lanes. `under` is one more coat below the stack.
pub struct EvaluateStack<'a, L: Lanes> {
    pub stack: &'a CoatStack<L>,
    pub under: Option<&'a Coat<L>>,
    pub wo: Vector<L>,
    pub wi: Vector<L>,
    pub half: Vector<L>,
    pub there: Mask<L>,
}

impl<L: Lanes> OutlinedTask<L> for EvaluateStack<'_, L> {
    type Output = StackScattering<L>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, l: L) -> StackScattering<L> {
        let Self { stack, under, wo, wi, half, there } = self;
        let one = Num::splat(l, 1.0);
        let mut scattering = StackScattering {
            passed: Vector::grey(one),
            scattered: one,
            light: Vector::zero(l),
            density: Num::zero(l),
        };
        let (mut reach, mut products) = (scattering.passed, [one; MEAN.len()]);
        let raised = Vector::new(wi.x, wi.y, wi.z.abs());
        for of in stack.coats.iter() {
            let coat = stack.coat(l, of);
            let near = coat.facets.at(wo);
            let (light, density) = coat.evaluate(wo, wi, half, &near, there);
            scattering.light += scattering.passed * light;
            scattering.density += weight(reach, &coat, &near) * density;
            let (there, back) = (coat.passed(&near), coat.passed(&coat.facets.at(raised)));
            let tint = tinted(of, wo.z);
            scattering.passed = scattering.passed * tint * tinted(of, raised.z) * there.min(back);
            scattering.scattered *= there.max(back);
            reach = reach * tint * tint * there;
            multiply(&mut products, &coat);
        }
        if let Some(under) = under {
            // The caller divides by the mean of that coat.
            scattering.scattered *= under.passed_on_average();
            multiply(&mut products, under);
        }
        let mut mean = Num::zero(l);
        for (product, [_, weight]) in products.into_iter().zip(MEAN) {
            mean += product * weight;
        }
        scattering.scattered /= mean;
        scattering
    }
}

/// Multiplies the products at the quadrature nodes by the share that a coat passes.
#[inline(always)]
fn multiply<L: Lanes>(products: &mut [Num<L>; MEAN.len()], coat: &Coat<L>) {
    let [level, slope] = coat.linear_fit();
    for (product, [node, _]) in products.iter_mut().zip(MEAN) {
        *product *= level - slope * node;
    }
}

/// Samples directions approximately as rough coats reflect them; `u` chooses among the coats.
pub struct SampleStack<'a, L: Lanes> {
    pub stack: &'a CoatStack<L>,
    pub wo: Vector<L>,
    pub u: Num<L>,
    pub u2: [Num<L>; 2],
}

impl<L: Lanes> OutlinedTask<L> for SampleStack<'_, L> {
    type Output = Vector<L>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, l: L) -> Vector<L> {
        let Self { stack, wo, u, u2 } = self;
        let StackAlbedo { rough, .. } = StackAlbedoTask { stack, wo }.run(l);
        let (place, mut sum) = (u * rough, Num::zero(l));
        let (mut reach, mut wi) = (Vector::grey(Num::splat(l, 1.0)), wo);
        for of in stack.coats.iter() {
            let coat = stack.coat(l, of);
            let near = coat.facets.at(wo);
            let weight = weight(reach, &coat, &near);
            // The last coat of nonzero weight also gets what rounding leaves over.
            let here = place.ge(sum) & weight.above(0.0);
            if here.any() {
                let normal = coat.facets.ggx.sample(wo, u2);
                wi = Vector::select(here, normal * (2.0 * wo.dot(normal)) - wo, wi);
            }
            sum += weight;
            let tint = tinted(of, wo.z);
            reach = reach * tint * tint * coat.passed(&near);
        }
        wi
    }
}
