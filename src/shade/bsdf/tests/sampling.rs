//! Samples follow the stated density.

use super::*;

/// Cells of a histogram of each hemisphere, evenly spaced in z² (cosine-weighted) and φ.
const RINGS: usize = 12;
const SECTORS: usize = 16;

/// The integral of the density over each cell, by the midpoint rule.
fn expected(bsdf: &Bsdf, wo: Vec3) -> Vec<f64> {
    const FINE: usize = 16;
    let sides = if bsdf.is_frosted() { 2 } else { 1 };
    let mut cells = vec![0.0; 2 * RINGS * SECTORS];
    for ring in 0..sides * RINGS * FINE {
        for sector in 0..SECTORS * FINE {
            let z2 = ((ring % (RINGS * FINE)) as f32 + 0.5) / (RINGS * FINE) as f32;
            let z = z2.sqrt();
            let side = if ring < RINGS * FINE { Vec3::ONE } else { Vec3::new(1.0, 1.0, -1.0) };
            let phi = TAU * (sector as f32 + 0.5) / (SECTORS * FINE) as f32;
            let (_, pdf) = bsdf.evaluate(wo, direction(z, phi) * side);
            // dω = dz dφ = d(z²) dφ / 2z.
            let area = TAU / (2.0 * z * (RINGS * SECTORS * FINE * FINE) as f32);
            cells[ring / FINE * SECTORS + sector / FINE] += f64::from(pdf * area);
        }
    }
    cells
}

#[test]
fn samples_follow_the_stated_density() {
    let mut tested = 0;
    // Rough enough for the midpoint rule above to resolve the lobes.
    let mut all = lossless_of(&[0.5, 0.75, 1.0], &[0.0, 0.6]);
    all.extend(lossy().into_iter().filter(|(name, _)| name.ends_with("roughness 1")));
    all.extend(stacked(0.7, &[0.5, 0.8], VARNISH));
    all.extend(openpbr::of_roughness(0.8));
    // An index of 1.1 hardly turns light, however rough the facets. Its lobe is narrow; it passes with 160
    // points a side of a cell.
    let rough = all.iter().filter(|(name, b)| !b.is_smooth() && !name.contains("index 1.1"));
    for (case, (name, bsdf)) in rough.enumerate() {
        for wo in in_turn(case, [direction(0.95, 0.3), direction(0.5, 2.0), direction(0.15, 4.0)]) {
            let density = expected(bsdf, wo);
            assert!(density.iter().sum::<f64>() < 1.005, "{name}: density integrates to more than 1");
            let n = 1u32 << 15;
            let mut counts = vec![0u32; density.len()];
            for i in 0..n {
                // Independent numbers: the statistic below assumes them.
                let sampler = Sampler::new(i, 0, 42);
                if let Some(s) = bsdf.sample(wo, sampler.single(0), sampler.pair(1))
                    && !s.specular
                {
                    let ring = ((s.wi.z * s.wi.z * RINGS as f32) as usize).min(RINGS - 1);
                    let ring = if s.wi.z > 0.0 { ring } else { ring + RINGS };
                    let turn = libm::atan2f(s.wi.y, s.wi.x).rem_euclid(TAU) / TAU;
                    counts[ring * SECTORS + ((turn * SECTORS as f32) as usize).min(SECTORS - 1)] += 1;
                }
            }
            let (mut statistic, mut cells) = (0.0, 0.0);
            for (&count, &share) in counts.iter().zip(&density) {
                let mean = share * f64::from(n);
                if mean > 5.0 {
                    statistic += (f64::from(count) - mean).powi(2) / mean;
                    cells += 1.0;
                }
            }
            if cells == 0.0 {
                // The lobe is hardly ever chosen beside a specular one.
                continue;
            }
            tested += 1;
            // Wilson and Hilferty's approximation: five standard deviations above the mean of chi-square.
            let spread = 2.0 / (9.0 * cells);
            let z = ((statistic / cells).cbrt() - (1.0 - spread)) / spread.sqrt();
            assert!(z < 5.0, "{name} from {wo}: chi-square {statistic:.0} over {cells} cells");
        }
    }
    assert!(tested > 33, "{tested}");
}

#[test]
fn narrow_lobes_are_sampled_by_their_density() {
    // These lobes are too narrow for the histogram. The mean of 1 / density over a known solid angle around
    // the mirrored direction must equal that solid angle.
    for roughness in [0.1, 0.2, 0.3] {
        let bsdf = principled(|s| {
            rough(roughness)(s);
            s.metallic = Scalar::constant(1.0);
        });
        for wo in [direction(0.9, 1.0), direction(0.4, 5.0)] {
            let axis = Vec3::new(-wo.x, -wo.y, wo.z);
            let cap = (roughness * roughness).min(0.3);
            let n = 1 << 16;
            let sum: f64 = (0..n)
                .filter_map(|i| {
                    let sampler = Sampler::new(2, i, 11);
                    let s = bsdf.sample(wo, sampler.single(0), sampler.pair(1))?;
                    (1.0 - s.wi.dot(axis) < 0.5 * cap * cap).then(|| 1.0 / f64::from(s.pdf))
                })
                .sum();
            let area = f64::from(PI * cap * cap);
            let found = sum / f64::from(n);
            assert!((found / area - 1.0).abs() < 0.03, "roughness {roughness}: {found} for {area}");
        }
    }
}
