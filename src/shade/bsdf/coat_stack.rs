//! Coats over a surface, any of them rough, tinted, or on a share of it only.

use super::albedo::Reflectance;
use super::coat::{Coat, Polish};
use crate::lanes::{Lanes, Mask, Num, OutlinedTask, Vector, exponential};
use crate::scene::{self, Coats};

/// Coats, outermost first. They are described anew whenever they are asked about, which is rare: their numbers take
/// less room than they would in lanes.
///
/// Each coat passes what the facets below it reflect by the lesser of both directions' shares. Of what is scattered
/// below, all coats together pass the product of all shares over the mean of that product, so a white base under
/// untinted coats stays white however many they are. Light is tinted on its way down and on its way up.
#[derive(Clone, Copy, Debug)]
pub struct CoatStack<L: Lanes> {
    pub coats: Coats,
    pub polish: Polish<L>,
}

/// Towards one direction, what an even environment sends.
#[derive(Clone, Copy, Debug)]
pub struct Seen<L: Lanes> {
    /// Reflected by rough coats, about: the chance of sampling them is in proportion.
    pub rough: Num<L>,
    /// Reflected by coats that are mirrors.
    pub smooth: Vector<L>,
    /// What passes, to a mirror below and back.
    pub passed: Vector<L>,
    /// What passes, about, if it is scattered below.
    pub scattered: Vector<L>,
}

/// From one direction towards another.
#[derive(Clone, Copy, Debug)]
pub struct Between<L: Lanes> {
    /// What passes to facets below and back.
    pub passed: Vector<L>,
    /// How many times as much of what is scattered.
    pub scattered: Num<L>,
    /// Reflected by rough coats × cosine.
    pub light: Vector<L>,
    /// The density of [`Pick`], times [`Seen::rough`].
    pub density: Num<L>,
}

/// Gauss's quadrature over directions by their cosine, of powers of s = (1 − z)⁵ up to the ninth: nodes, and
/// weights times what passes a dielectric, 1 − s over its mean.
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
        let facets = self.polish.facets(Num::splat(l, of.roughness));
        Coat::new(Num::splat(l, of.weight), facets, f0 * f0)
    }
}

/// What is left of light that goes down or up through a coat, seen under a cosine from outside.
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

/// How much a rough coat weighs among the others to sample, if so much reaches it.
#[inline(always)]
fn weight<L: Lanes>(reach: Vector<L>, coat: &Coat<L>, near: &Reflectance<L>) -> Num<L> {
    let [single, _] = coat.reflected(near);
    (super::principled::mean(reach) * single).only(coat.facets.rough)
}

/// Asks for [`Seen`].
pub struct See<'a, L: Lanes> {
    pub stack: &'a CoatStack<L>,
    pub wo: Vector<L>,
}

impl<L: Lanes> OutlinedTask<L> for See<'_, L> {
    type Output = Seen<L>;

    #[inline(always)]
    fn run(self, l: L) -> Seen<L> {
        let Self { stack, wo } = self;
        let white = Vector::grey(Num::splat(l, 1.0));
        let mut seen = Seen { rough: Num::zero(l), smooth: Vector::zero(l), passed: white, scattered: white };
        for of in stack.coats.iter() {
            let coat = stack.coat(l, of);
            let near = coat.facets.at(wo);
            let [single, _] = coat.reflected(&near);
            seen.rough += weight(seen.passed, &coat, &near);
            seen.smooth += (seen.passed * single).only(!coat.facets.rough);
            let (passed, tint) = (coat.passed(&near), tinted(of, wo.z));
            let straight = Num::splat(l, 1.0);
            seen.passed = seen.passed * tint * tint * passed;
            seen.scattered = seen.scattered * tint * tinted(of, straight) * passed;
        }
        seen
    }
}

/// Asks for [`Between`]. Coats are lit from above in the lanes of `there`, in which `half` lies between the
/// directions; `under` is one more coat below.
pub struct Look<'a, L: Lanes> {
    pub stack: &'a CoatStack<L>,
    pub under: Option<&'a Coat<L>>,
    pub wo: Vector<L>,
    pub wi: Vector<L>,
    pub half: Vector<L>,
    pub there: Mask<L>,
}

impl<L: Lanes> OutlinedTask<L> for Look<'_, L> {
    type Output = Between<L>;

    #[inline(always)]
    fn run(self, l: L) -> Between<L> {
        let Self { stack, under, wo, wi, half, there } = self;
        let one = Num::splat(l, 1.0);
        let mut between = Between {
            passed: Vector::grey(one),
            scattered: one,
            light: Vector::zero(l),
            density: Num::zero(l),
        };
        let (mut reach, mut products) = (between.passed, [one; MEAN.len()]);
        let raised = Vector::new(wi.x, wi.y, wi.z.abs());
        for of in stack.coats.iter() {
            let coat = stack.coat(l, of);
            let near = coat.facets.at(wo);
            let (light, density) = coat.evaluate(wo, wi, half, &near, there);
            between.light += between.passed * light;
            between.density += weight(reach, &coat, &near) * density;
            let (there, back) = (coat.passed(&near), coat.passed(&coat.facets.at(raised)));
            let tint = tinted(of, wo.z);
            between.passed = between.passed * tint * tinted(of, raised.z) * there.min(back);
            between.scattered *= there.max(back);
            reach = reach * tint * tint * there;
            multiply(&mut products, &coat);
        }
        if let Some(under) = under {
            // Its own share of the mean is divided by elsewhere.
            between.scattered *= under.passed_on_average();
            multiply(&mut products, under);
        }
        let mut mean = Num::zero(l);
        for (product, [_, weight]) in products.into_iter().zip(MEAN) {
            mean += product * weight;
        }
        between.scattered /= mean;
        between
    }
}

/// Multiplies what passes, at the nodes of the mean.
#[inline(always)]
fn multiply<L: Lanes>(products: &mut [Num<L>; MEAN.len()], coat: &Coat<L>) {
    let [level, slope] = coat.trend();
    for (product, [node, _]) in products.iter_mut().zip(MEAN) {
        *product *= level - slope * node;
    }
}

/// Directions about as rough coats reflect them; `u` chooses among the coats.
pub struct Pick<'a, L: Lanes> {
    pub stack: &'a CoatStack<L>,
    pub wo: Vector<L>,
    pub u: Num<L>,
    pub u2: [Num<L>; 2],
}

impl<L: Lanes> OutlinedTask<L> for Pick<'_, L> {
    type Output = Vector<L>;

    #[inline(always)]
    fn run(self, l: L) -> Vector<L> {
        let Self { stack, wo, u, u2 } = self;
        let Seen { rough, .. } = See { stack, wo }.run(l);
        let (place, mut sum) = (u * rough, Num::zero(l));
        let (mut reach, mut wi) = (Vector::grey(Num::splat(l, 1.0)), wo);
        for of in stack.coats.iter() {
            let coat = stack.coat(l, of);
            let near = coat.facets.at(wo);
            let weight = weight(reach, &coat, &near);
            // The last coat that has a chance takes what rounding leaves over.
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
