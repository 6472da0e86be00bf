//! View transforms: from linear Rec. 709 radiance to the linear light of a display.

use crate::lanes::each;

/// A view transform. Radiance of 1 is white for [`View::Standard`]; the others leave room for what is brighter.
///
/// All are functions of one pixel. They use libm's functions, so that every machine computes the same bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum View {
    /// AgX (Sobotka 2022) in Rec. 2020, with the inset, the outset and the polynomial of the contrast that Filament and
    /// three.js use: 16.5 stops around middle grey. Bright colours fade to white as on film.
    #[default]
    Agx,
    /// AgX with the look that Filament and Blender call punchy: after the contrast, power 1.35 and saturation 1.4.
    AgxPunchy,
    /// Khronos PBR Neutral: base colours are shown as they are, up to 0.76; what is brighter is compressed.
    PbrNeutral,
    /// ACES: Hill's fit of the reference rendering transform, scaled so that middle grey stays about as bright.
    Aces,
    /// Filmic: the curve of Hable (2010), white at 11.2.
    Filmic,
    /// Radiance cut at 1, with the sRGB transfer function.
    Standard,
    /// Radiance cut at 1 and written as it is, without a transfer function: for data.
    Raw,
}

impl View {
    /// All views.
    pub const ALL: [Self; 7] =
        [Self::Agx, Self::AgxPunchy, Self::PbrNeutral, Self::Aces, Self::Filmic, Self::Standard, Self::Raw];

    /// The name that arguments and metadata use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Agx => "agx",
            Self::AgxPunchy => "agx-punchy",
            Self::PbrNeutral => "pbr-neutral",
            Self::Aces => "aces",
            Self::Filmic => "filmic",
            Self::Standard => "standard",
            Self::Raw => "raw",
        }
    }

    /// The light of a display for linear radiance, each channel in 0..=1. NaN gives 0.
    pub fn apply(self, radiance: [f32; 3]) -> [f32; 3] {
        // Written so that NaN becomes 0.
        let radiance = each(radiance, |channel| if channel > 0.0 { channel.min(f32::MAX) } else { 0.0 });
        let shown = match self {
            Self::Agx => agx(radiance, |shown| shown),
            Self::AgxPunchy => agx(radiance, punchy),
            Self::PbrNeutral => pbr_neutral(radiance),
            Self::Aces => aces(radiance),
            Self::Filmic => each(radiance, |channel| hable(2.0 * channel) / hable(11.2)),
            Self::Standard | Self::Raw => radiance,
        };
        each(shown, |channel| channel.clamp(0.0, 1.0))
    }

    /// Value that a file stores for [`View::apply`]'s result, in 0..=1: the sRGB transfer function, or nothing for
    /// [`View::Raw`].
    pub fn encode(self, light: f32) -> f32 {
        match self {
            Self::Raw => light,
            _ if light <= 0.003_130_8 => 12.92 * light,
            _ => 1.055 * libm::powf(light, 1.0 / 2.4) - 0.055,
        }
    }
}

/// Rows times a column.
#[inline]
pub(super) fn times(rows: &[[f32; 3]; 3], [x, y, z]: [f32; 3]) -> [f32; 3] {
    each(*rows, |[a, b, c]| a * x + b * y + c * z)
}

/// AgX with a look, which changes colours after the contrast.
fn agx(radiance: [f32; 3], look: impl Fn([f32; 3]) -> [f32; 3]) -> [f32; 3] {
    const TO_REC2020: [[f32; 3]; 3] =
        [[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0113], [0.0164, 0.0880, 0.8956]];
    const FROM_REC2020: [[f32; 3]; 3] =
        [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]];
    const INSET: [[f32; 3]; 3] = [
        [0.856_627_17, 0.095_121_24, 0.048_251_606],
        [0.137_318_97, 0.761_242, 0.101_439_04],
        [0.111_898_21, 0.076_799_415, 0.811_302_4],
    ];
    const OUTSET: [[f32; 3]; 3] = [
        [1.127_100_6, -0.110_606_64, -0.016_493_94],
        [-0.141_329_76, 1.157_823_7, -0.016_493_94],
        [-0.141_329_76, -0.110_606_64, 1.251_936_4],
    ];
    /// Binary logarithms of the least and the greatest radiance: 10 stops below 0.18 and 6.5 above.
    const LEAST: f32 = -12.473_93;
    const GREATEST: f32 = 4.026_069;
    let contrast = |channel: f32| {
        let x = ((libm::log2f(channel.max(1e-10)) - LEAST) / (GREATEST - LEAST)).clamp(0.0, 1.0);
        let (x2, x4) = (x * x, x * x * x * x);
        15.5 * x4 * x2 - 40.14 * x4 * x + 31.96 * x4 - 6.868 * x2 * x + 0.4298 * x2 + 0.1191 * x - 0.002_32
    };
    let shown = look(each(times(&INSET, times(&TO_REC2020, radiance)), contrast));
    times(&FROM_REC2020, each(times(&OUTSET, shown), |channel| libm::powf(channel.max(0.0), 2.2)))
}

fn punchy(shown: [f32; 3]) -> [f32; 3] {
    const POWER: f32 = 1.35;
    const SATURATION: f32 = 1.4;
    let [r, g, b] = each(shown, |channel| channel.max(0.0));
    let luma = 0.2126 * r + 0.7152 * g + 0.0722 * b;
    each([r, g, b], |channel| luma + SATURATION * (libm::powf(channel, POWER) - luma))
}

fn pbr_neutral(radiance: [f32; 3]) -> [f32; 3] {
    /// Start of compression: 0.8 less the reflectance of a dielectric at normal incidence.
    const START: f32 = 0.8 - 0.04;
    const DESATURATION: f32 = 0.15;
    let least = radiance.into_iter().fold(f32::MAX, f32::min);
    let offset = if least < 0.08 { least - 6.25 * least * least } else { 0.04 };
    let shown = each(radiance, |channel| channel - offset);
    let peak = shown.into_iter().fold(0.0, f32::max);
    if peak < START {
        return shown;
    }
    let rest = 1.0 - START;
    let compressed = 1.0 - rest * rest / (peak + rest - START);
    let white = 1.0 - 1.0 / (DESATURATION * (peak - compressed) + 1.0);
    each(shown, |channel| {
        let scaled = channel * (compressed / peak);
        scaled + (compressed - scaled) * white
    })
}

fn aces(radiance: [f32; 3]) -> [f32; 3] {
    const IN: [[f32; 3]; 3] =
        [[0.597_19, 0.354_58, 0.048_23], [0.076, 0.908_34, 0.015_66], [0.0284, 0.133_83, 0.837_77]];
    const OUT: [[f32; 3]; 3] = [
        [1.604_75, -0.531_08, -0.073_67],
        [-0.102_08, 1.108_13, -0.006_05],
        [-0.003_27, -0.072_76, 1.076_02],
    ];
    // Beyond this the quotient is 1 to the last bit, and squares would overflow.
    let fit = |channel: f32| {
        let v = channel.min(1e9);
        (v * (v + 0.024_578_6) - 0.000_090_537) / (v * (0.983_729 * v + 0.432_951) + 0.238_081)
    };
    times(&OUT, times(&IN, each(radiance, |channel| channel / 0.6)).map(fit))
}

/// Hable's curve: shoulder, linear part and toe.
fn hable(radiance: f32) -> f32 {
    let x = radiance.min(1e9);
    (x * (0.15 * x + 0.05) + 0.004) / (x * (0.15 * x + 0.5) + 0.06) - 0.02 / 0.3
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten thousand colours over 24 stops, greys, primaries and the bounds among them.
    fn colours() -> impl Iterator<Item = [f32; 3]> {
        let channel = |i: u32| {
            let random = (i + 1).wrapping_mul(0x9e37_79b9);
            if random >> 29 == 0 { 0.0 } else { libm::exp2f(random as f32 / u32::MAX as f32 * 24.0 - 14.0) }
        };
        let greys = (0..1000u32).map(move |i| [channel(8 * i + 1); 3]);
        greys.chain((0..9000).map(move |i| [channel(3 * i), channel(3 * i + 1), channel(3 * i + 2)]))
    }

    /// The greatest difference of what is stored, in steps of a byte.
    fn difference(view: View, published: impl Fn([f64; 3]) -> [f64; 3]) -> f64 {
        let mut greatest = 0.0f64;
        for colour in colours() {
            let wanted = published(colour.map(f64::from));
            for (ours, theirs) in view.apply(colour).into_iter().zip(wanted) {
                let light = theirs.clamp(0.0, 1.0);
                let stored =
                    if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 };
                greatest = greatest.max((f64::from(view.encode(ours)) - stored).abs() * 255.0);
            }
        }
        greatest
    }

    fn columns(m: [[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|row| (0..3).map(|column| m[column][row] * v[column]).sum())
    }

    /// AgX as Filament and three.js publish it: matrices by columns. Punchy is Filament's.
    #[test]
    fn agx_is_the_published_formula() {
        let published = |colour, punchy| {
            let v = columns(
                [[0.6274, 0.0691, 0.0164], [0.3293, 0.9195, 0.0880], [0.0433, 0.0113, 0.8956]],
                colour,
            );
            let v = columns(
                [
                    [0.856627153315983, 0.137318972929847, 0.11189821299995],
                    [0.0951212405381588, 0.761241990602591, 0.0767994186031903],
                    [0.0482516061458583, 0.101439036467562, 0.811302368396859],
                ],
                v,
            );
            let v = v.map(|x| {
                let x = ((x.max(1e-10).log2() + 12.47393) / (4.026069 + 12.47393)).clamp(0.0, 1.0);
                15.5 * x.powi(6) - 40.14 * x.powi(5) + 31.96 * x.powi(4) - 6.868 * x.powi(3)
                    + 0.4298 * x.powi(2)
                    + 0.1191 * x
                    - 0.00232
            });
            let v = if punchy {
                let luma: f64 =
                    v.iter().zip([0.2126, 0.7152, 0.0722]).map(|(x, weight)| x.max(0.0) * weight).sum();
                v.map(|x| luma + 1.4 * (x.max(0.0).powf(1.35) - luma))
            } else {
                v
            };
            let v = columns(
                [
                    [1.1271005818144368, -0.1413297634984383, -0.14132976349843826],
                    [-0.11060664309660323, 1.157823702216272, -0.11060664309660294],
                    [-0.016493938717834573, -0.016493938717834257, 1.2519364065950405],
                ],
                v,
            );
            columns(
                [[1.6605, -0.1246, -0.0182], [-0.5876, 1.1329, -0.1006], [-0.0728, -0.0083, 1.1187]],
                v.map(|x| x.max(0.0).powf(2.2)),
            )
        };
        for (view, punchy) in [(View::Agx, false), (View::AgxPunchy, true)] {
            let difference = difference(view, |colour| published(colour, punchy));
            assert!(difference < 0.05, "{view:?}: {difference} steps of a byte");
        }
    }

    /// PBR Neutral as Khronos publishes it.
    #[test]
    fn pbr_neutral_is_the_published_formula() {
        let published = |colour: [f64; 3]| {
            let x = colour[0].min(colour[1].min(colour[2]));
            let offset = if x < 0.08 { x - 6.25 * x * x } else { 0.04 };
            let colour = colour.map(|channel| channel - offset);
            let peak = colour[0].max(colour[1].max(colour[2]));
            if peak < 0.76 {
                return colour;
            }
            let new_peak = 1.0 - 0.24 * 0.24 / (peak + 0.24 - 0.76);
            let g = 1.0 - 1.0 / (0.15 * (peak - new_peak) + 1.0);
            colour.map(|channel| channel * new_peak / peak * (1.0 - g) + new_peak * g)
        };
        let difference = difference(View::PbrNeutral, published);
        assert!(difference < 0.05, "{difference} steps of a byte");
    }

    #[test]
    fn every_view_is_monotonic_in_grey_and_ends_at_black_and_white() {
        for view in View::ALL {
            let mut before = [0.0; 3];
            for step in 0..2000 {
                let shown = view.apply([libm::exp2f(step as f32 / 100.0 - 14.0); 3]);
                for (now, before) in shown.into_iter().zip(before) {
                    assert!(now >= before - 1e-6, "{view:?} at step {step}: {now} after {before}");
                }
                let [least, greatest] =
                    [shown.into_iter().fold(1.0, f32::min), shown.into_iter().fold(0.0, f32::max)];
                assert!(greatest - least < 0.012, "{view:?} tints grey: {shown:?}");
                before = shown;
            }
            assert!(
                before.iter().all(|&white| view.encode(white) > 0.99),
                "{view:?} never reaches white: {before:?}"
            );
            assert!(
                view.apply([0.0; 3]).iter().all(|&black| view.encode(black) < 0.5 / 255.0),
                "{view:?} has no black"
            );
            for odd in [f32::NAN, f32::INFINITY, f32::MAX, -1.0, 1e-40] {
                assert!(
                    view.apply([odd, 0.5, odd]).iter().all(|x| (0.0..=1.0).contains(x)),
                    "{view:?} of {odd}"
                );
            }
        }
    }
}
