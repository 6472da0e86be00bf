//! Display of a picture: exposure, white balance and view transform. Files of linear radiance have none of it.

use super::view::times;
use super::{Image, View};

/// Luminance that automatic exposure gives to a picture of one luminance: middle grey.
const MIDDLE_GREY: f32 = 0.18;

/// Brightness at which a picture is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Exposure {
    /// By this many stops brighter than the radiance.
    Stops(f32),
    /// So that the mean lightness of all pixels that are not black is middle grey's (0.18). Lightness is the cube root
    /// of luminance, as in CIE L*: neither dark corners nor lamps decide alone.
    Auto,
}

/// Display of a picture of linear radiance: white balance, then exposure, then a view transform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    view: View,
    exposure: Exposure,
    white_kelvin: Option<f32>,
}

impl Default for Look {
    /// [`View::Agx`], no stops, no white balance.
    fn default() -> Self {
        Self { view: View::default(), exposure: Exposure::Stops(0.0), white_kelvin: None }
    }
}

impl Look {
    /// Colour temperatures of white balance, in kelvin.
    pub const KELVINS: std::ops::RangeInclusive<f32> = 1667.0..=25000.0;

    /// This look with another view transform.
    pub fn with_view(self, view: View) -> Self {
        Self { view, ..self }
    }

    /// This look with another exposure.
    pub fn with_exposure(self, exposure: Exposure) -> Self {
        Self { exposure, ..self }
    }

    /// This look with light of this colour temperature shown as white (a Bradford adaptation to D65). Below 4000 K it
    /// is a black body's, above 5000 K daylight's, between the two it is a mixture. Clamped to [`Look::KELVINS`].
    pub fn with_white_balance(self, kelvin: f32) -> Self {
        let (least, greatest) = (*Self::KELVINS.start(), *Self::KELVINS.end());
        Self { white_kelvin: Some(kelvin.clamp(least, greatest)), ..self }
    }

    /// The view transform.
    pub fn view(&self) -> View {
        self.view
    }

    /// The stops by which a picture is brightened: those asked for, or what [`Exposure::Auto`] finds, rounded to a
    /// hundredth.
    pub fn stops(&self, image: &Image) -> f32 {
        match self.exposure {
            Exposure::Stops(stops) => stops,
            Exposure::Auto => Light::of(image).stops(),
        }
    }

    /// Brightness at which a picture is shown.
    pub fn exposure(&self) -> Exposure {
        self.exposure
    }

    /// Values that a picture file stores for each channel of each pixel, in 0..=1.
    pub fn encode<'a>(&self, image: &'a Image) -> impl Iterator<Item = f32> + use<'a> {
        let shown = self.encoder(image);
        image.pixels.iter().flat_map(move |&pixel| shown(pixel))
    }

    /// [`Look::encode`] for single pixels of an image.
    pub(super) fn encoder(&self, image: &Image) -> impl Fn([f32; 3]) -> [f32; 3] + Sync + use<> {
        let gain = libm::exp2f(self.stops(image));
        let balance = self.white_kelvin.map_or([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], balance);
        let (rows, view) = (balance.map(|row| row.map(|factor| factor * gain)), self.view);
        // A channel that is NaN or infinite leaves the others alone.
        let finite = |channel: f32| if channel > 0.0 { channel.min(1e30) } else { 0.0 };
        move |pixel| view.apply(times(&rows, pixel.map(finite))).map(|light| view.encode(light))
    }
}

/// Brightness of a picture, for automatic exposure. Those of its parts add up.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Light {
    /// The sum of the cube roots of the luminances of all pixels that are not black.
    pub lightness: f64,
    /// The number of these pixels.
    pub pixels: u32,
}

impl Light {
    /// Of a picture or a part of one.
    pub fn of(image: &Image) -> Self {
        let luminance =
            |&[r, g, b]: &[f32; 3]| 0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b);
        let lit = image.pixels.iter().map(luminance).filter(|&light| light > 0.0 && light.is_finite());
        lit.fold(Self::default(), |sum, light| sum.and(Self { lightness: libm::cbrt(light), pixels: 1 }))
    }

    /// Of two parts together.
    pub fn and(self, other: Self) -> Self {
        let pixels = self.pixels.saturating_add(other.pixels);
        Self { lightness: self.lightness + other.lightness, pixels }
    }

    /// The stops of automatic exposure ([`Exposure::Auto`]), rounded to a hundredth.
    pub fn stops(self) -> f32 {
        if self.pixels == 0 {
            return 0.0;
        }
        let mean = libm::log2(self.lightness / f64::from(self.pixels));
        let stops = f64::from(libm::log2f(MIDDLE_GREY)) - 3.0 * mean;
        (libm::round(stops * 100.0) / 100.0) as f32
    }
}

/// The matrix that shows light of this colour temperature as white, on linear Rec. 709 colours.
fn balance(kelvin: f32) -> [[f32; 3]; 3] {
    const D65: [f64; 2] = [0.3127, 0.3290];
    const TO_XYZ: [[f64; 3]; 3] = [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ];
    const FROM_XYZ: [[f64; 3]; 3] = [
        [3.2404542, -1.5371385, -0.4985314],
        [-0.9692660, 1.8760108, 0.0415560],
        [0.0556434, -0.2040259, 1.0572252],
    ];
    /// Bradford's cone responses.
    const TO_CONES: [[f64; 3]; 3] =
        [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]];
    const FROM_CONES: [[f64; 3]; 3] = [
        [0.9869929, -0.1470543, 0.1599627],
        [0.4323053, 0.5183603, 0.0492912],
        [-0.0085287, 0.0400428, 0.9684867],
    ];
    let cones = |[x, y]: [f64; 2]| apply(&TO_CONES, [x / y, 1.0, (1.0 - x - y) / y]);
    let (from, to) = (cones(chromaticity(f64::from(kelvin))), cones(D65));
    let columns = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|unit| {
        let cones = apply(&TO_CONES, apply(&TO_XYZ, unit));
        let adapted = std::array::from_fn(|i| cones[i] * to[i] / from[i]);
        apply(&FROM_XYZ, apply(&FROM_CONES, adapted))
    });
    std::array::from_fn(|row| std::array::from_fn(|column| columns[column][row] as f32))
}

fn apply(rows: &[[f64; 3]; 3], [x, y, z]: [f64; 3]) -> [f64; 3] {
    rows.map(|[a, b, c]| a * x + b * y + c * z)
}

/// The chromaticity (x, y) of light of a colour temperature.
fn chromaticity(kelvin: f64) -> [f64; 2] {
    let share = ((kelvin - 4000.0) / 1000.0).clamp(0.0, 1.0);
    let (black_body, daylight) = (black_body(kelvin), daylight(kelvin.max(4000.0)));
    std::array::from_fn(|i| black_body[i] + (daylight[i] - black_body[i]) * share)
}

/// A black body of 1667 to 25,000 K: the cubic fit of Kim and others (US patent 7024034).
fn black_body(kelvin: f64) -> [f64; 2] {
    let polynomial = |[a, b, c, d]: [f64; 4], t: f64| ((a * t + b) * t + c) * t + d;
    let inverse = 1000.0 / kelvin;
    let x = match kelvin {
        ..4000.0 => polynomial([-0.2661239, -0.2343589, 0.8776956, 0.179910], inverse),
        _ => polynomial([-3.0258469, 2.1070379, 0.2226347, 0.240390], inverse),
    };
    let y = match kelvin {
        ..2222.0 => polynomial([-1.1063814, -1.34811020, 2.18555832, -0.20219683], x),
        ..4000.0 => polynomial([-0.9549476, -1.37418593, 2.09137015, -0.16748867], x),
        _ => polynomial([3.0817580, -5.87338670, 3.75112997, -0.37001483], x),
    };
    [x, y]
}

/// CIE daylight of 4000 to 25,000 K (CIE 15).
fn daylight(kelvin: f64) -> [f64; 2] {
    let t = 1000.0 / kelvin;
    let x = match kelvin {
        ..=7000.0 => ((-4.6070 * t + 2.9678) * t + 0.09911) * t + 0.244063,
        _ => ((-2.0064 * t + 1.9018) * t + 0.24748) * t + 0.237040,
    };
    [x, -3.0 * x * x + 2.870 * x - 0.275]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(light: f32) -> Image {
        Image { width: 3, height: 1, pixels: vec![[light; 3], [light; 3], [0.0; 3]] }
    }

    #[test]
    fn automatic_exposure_makes_the_mean_middle_grey() {
        let look = Look::default().with_exposure(Exposure::Auto).with_view(View::Raw);
        for light in [1e-4, 0.18, 3.0, 500.0] {
            let shown = look.encode(&grey(light)).next().expect("a channel");
            assert!((shown / 0.18 - 1.0).abs() < 0.005, "{light} is shown as {shown}");
        }
        assert_eq!(look.stops(&grey(0.0)), 0.0, "a black picture is left alone");
        assert_eq!(look.stops(&grey(f32::NAN)), 0.0);
    }

    /// A dark vault around a sunlit floor: the floor is less bright than by a geometric mean, which gives it 36.
    #[test]
    fn automatic_exposure_keeps_what_is_bright() {
        let luminances = (0..100).map(|i| if i < 15 { 2.0 } else { 0.004 });
        let image = Image { width: 100, height: 1, pixels: luminances.map(|light| [light; 3]).collect() };
        let gain = libm::exp2f(Look::default().with_exposure(Exposure::Auto).stops(&image));
        assert!((10.0..11.0).contains(&(2.0 * gain)), "the floor has {}", 2.0 * gain);
        // A lamp in a hundredth of the picture leaves the rest as it is, to a stop.
        let lit = |lamp: f32| (0..100).map(move |i| if i == 0 { [lamp; 3] } else { [0.18; 3] });
        let image = |lamp| Image { width: 100, height: 1, pixels: lit(lamp).collect() };
        let stops = Look::default().with_exposure(Exposure::Auto).stops(&image(1000.0));
        assert!((-1.0..0.0).contains(&stops), "{stops}");
    }

    #[test]
    fn white_balance_shows_its_white_as_white() {
        // Linear Rec. 709 of a black body of 2700 K, and of D65, from their chromaticities by published tables.
        for (kelvin, [x, y]) in
            [(2700.0, [0.4599, 0.4106]), (6504.0, [0.3127, 0.3290]), (10000.0, [0.2788, 0.2920])]
        {
            let (xyz, unit) = ([x / y, 1.0, (1.0 - x - y) / y], [1.0, 1.0, 1.0]);
            let colour = apply(
                &[
                    [3.2404542, -1.5371385, -0.4985314],
                    [-0.9692660, 1.8760108, 0.0415560],
                    [0.0556434, -0.2040259, 1.0572252],
                ],
                xyz,
            );
            let shown = times(&balance(kelvin), colour.map(|channel| channel as f32));
            for (shown, white) in shown.into_iter().zip(unit) {
                assert!((shown - white).abs() < 0.02, "{kelvin} K: {shown}");
            }
        }
    }

    #[test]
    fn daylight_and_black_body_meet_without_a_step() {
        let mut before = chromaticity(1667.0);
        for kelvin in (1670..25000).step_by(10) {
            let now = chromaticity(f64::from(kelvin));
            assert!((now[0] - before[0]).abs() < 0.002 && (now[1] - before[1]).abs() < 0.002, "{kelvin} K");
            assert!(now[0] < before[0] + 1e-4, "{kelvin} K is redder than less");
            before = now;
        }
    }
}
