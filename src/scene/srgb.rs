//! The sRGB transfer function for bytes.

use std::sync::OnceLock;

/// The linear value of each byte.
#[inline]
pub(super) fn table() -> &'static [f32; 256] {
    static TABLE: OnceLock<[f32; 256]> = OnceLock::new();
    TABLE.get_or_init(|| std::array::from_fn(|i| light(i as f64 / 255.0)))
}

/// The linear value of a coded value from 0 to 1 (IEC 61966-2-1).
#[inline]
fn light(v: f64) -> f32 {
    (if v <= 0.04045 { v / 12.92 } else { libm::pow((v + 0.055) / 1.055, 2.4) }) as f32
}

/// A colour of floats as linear light, with its alpha. Components are clamped to 0..=1, and NaN counts as 0.
#[cfg(feature = "meshes")]
pub(super) fn decoded(colour: [f32; 4]) -> glam::Vec4 {
    // The comparison fails for NaN.
    let [r, g, b, alpha] = colour.map(|value| if value > 0.0 { value.min(1.0) } else { 0.0 });
    let linear = |value: f32| {
        let byte = (value * 255.0).round();
        if (byte / 255.0).to_bits() == value.to_bits() {
            table()[byte as usize]
        } else {
            light(f64::from(value))
        }
    };
    glam::Vec4::new(linear(r), linear(g), linear(b), alpha)
}

/// The byte whose linear value is nearest.
#[inline]
pub(super) fn byte(light: f32) -> u8 {
    /// Enough steps that no two bytes share one.
    const STEPS: usize = 4096;
    static START: OnceLock<Vec<u8>> = OnceLock::new();
    let table = table();
    let start = START.get_or_init(|| {
        let below = |i: usize| table.partition_point(|&x| x <= i as f32 / STEPS as f32) - 1;
        (0..=STEPS).map(|i| below(i) as u8).collect()
    });
    let light = light.clamp(0.0, 1.0);
    let mut byte = usize::from(start[(light * STEPS as f32) as usize]);
    while byte < 255 && table[byte + 1] - light <= light - table[byte] {
        byte += 1;
    }
    byte as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_is_nearest_to_its_own_value_and_to_values_beside_it() {
        let table = table();
        for i in 0..=255u8 {
            let at = usize::from(i);
            assert_eq!(byte(table[at]), i);
            if i < 255 {
                let step = table[at + 1] - table[at];
                assert_eq!(byte(table[at] + 0.49 * step), i);
                assert_eq!(byte(table[at] + 0.51 * step), i + 1);
            }
        }
        assert_eq!([byte(-1.0), byte(7.0), byte(f32::NAN)], [0, 255, 0]);
    }
}
