//! BSDFs that are right, and such that break one promise each.

use super::*;
use crate::scene::Scattering;

/// A matte surface, with one mistake.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Mistake {
    #[default]
    None,
    /// It returns three times the light.
    Light,
    /// Both functions state half of the density.
    HalfDensity,
    /// `sample` alone states half of the density.
    OtherDensity,
    /// Directions of one side come twice as often.
    OneSide,
    /// `sample` gives twice the weight.
    Weight,
    /// `evaluate` depends on `wi` alone.
    OneWay,
    /// Light from near the surface is NaN.
    NotANumber,
    /// Light is taken away.
    Negative,
    /// Sampled directions are twice as long.
    Long,
}

#[derive(Debug)]
struct Matte(Mistake);

impl Scattering for Matte {
    #[inline(always)]
    fn evaluate<L: Lanes>(&self, _: &Points<L>, _: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        let (l, pdf) = (wi.lanes(), warp::lanes::cosine_hemisphere_pdf(wi.z));
        let value = match self.0 {
            Mistake::Light => pdf * 3.0,
            Mistake::OneWay => pdf * (0.5 * wi.z + 0.2),
            Mistake::NotANumber => Num::select(wi.z.below(0.1), Num::splat(l, f32::NAN), pdf * 0.8),
            Mistake::Negative => pdf * -0.2,
            _ => pdf * 0.8,
        };
        let density = if self.0 == Mistake::HalfDensity { pdf * 0.5 } else { pdf };
        (Vector::grey(value), density)
    }

    #[inline(always)]
    fn sample<L: Lanes>(&self, at: &Points<L>, wo: Vector<L>, u: Num<L>, u2: [Num<L>; 2]) -> Scattered<L> {
        let mut wi = warp::lanes::cosine_hemisphere(u2);
        if self.0 == Mistake::OneSide {
            wi.x = Num::select(u.below(1.0 / 3.0), wi.x.abs(), wi.x);
        }
        let mut sample = Scattered::evaluated(wi, self.evaluate(at, wo, wi));
        match self.0 {
            Mistake::OtherDensity => sample.pdf = sample.pdf * 0.5,
            Mistake::Weight => sample.weight = sample.weight * 2.0,
            Mistake::Long => sample.wi = sample.wi * 2.0,
            _ => {}
        }
        sample
    }
}

/// The kinds of faults that are found, and the greatest albedo.
fn faults(mistake: Mistake) -> (Vec<ScatteringFault>, f64) {
    let report = ScatteringSurface::new(Matte(mistake)).measure();
    (report.faults, report.albedo[1])
}

#[test]
fn a_right_surface_has_no_fault() {
    let report = ScatteringSurface::new(Matte(Mistake::None)).measure();
    assert_eq!(report.faults, []);
    assert!(report.albedo.iter().all(|albedo| (albedo - 0.8).abs() < 0.02), "{:?}", report.albedo);
}

#[test]
fn each_mistake_is_named() {
    use ScatteringFault::*;
    let of = |mistake| faults(mistake).0;
    let light = of(Mistake::Light);
    assert!(matches!(light[..], [Energy { albedo, .. }] if (albedo - 3.0).abs() < 0.1), "{light:?}");
    let half = of(Mistake::HalfDensity);
    assert!(
        matches!(half[..], [Sampling { factor, near: None, .. }] if (factor - 2.0).abs() < 0.2),
        "{half:?}"
    );
    let side = of(Mistake::OneSide);
    assert!(matches!(side[..], [Sampling { wo: None, near: Some(_), .. }]), "{side:?}");
    let other = of(Mistake::OtherDensity);
    assert!(matches!(other[..], [Densities { stated, density, .. }] if stated < 0.6 * density), "{other:?}");
    let weight = of(Mistake::Weight);
    assert!(matches!(weight[..], [Weight { weight, .. }] if (weight - 1.6).abs() < 1e-3), "{weight:?}");
    let one_way = of(Mistake::OneWay);
    assert!(matches!(one_way[..], [NotReciprocal { .. }]), "{one_way:?}");
    let nan = of(Mistake::NotANumber);
    assert!(matches!(nan[..], [NotFinite { value, .. }] if value.is_nan()), "{nan:?}");
    let negative = of(Mistake::Negative);
    assert!(matches!(negative[..], [Negative { .. }]), "{negative:?}");
    let long = of(Mistake::Long);
    assert!(long.iter().any(|fault| matches!(fault, NotUnit { length, .. } if (length - 2.0).abs() < 1e-3)));
}

#[test]
fn reports_are_the_same_at_every_level() {
    for mistake in [Mistake::None, Mistake::HalfDensity, Mistake::OneWay] {
        let surface = ScatteringSurface::new(Matte(mistake));
        let reports: Vec<_> =
            SimdLevel::available().into_iter().map(|level| surface.measure_at(level)).collect();
        assert!(reports.windows(2).all(|pair| pair[0] == pair[1]), "{reports:?}");
    }
}
