// A fused multiply-add by the device's own. Vulkan lets a device round it twice, so a probe asks before it is used.

// 2 to the power -78: the least product whose sum with any number is 0 or normal.
const LEAST_PRODUCT: u32 = 0x18800000u;

fn op_fma(a: u32, b: u32, c: u32) -> u32 {
    let result = bitcast<u32>(fma(bitcast<f32>(a), bitcast<f32>(b), bitcast<f32>(c)));
    if FLUSHES {
        let product = bitcast<u32>(bitcast<f32>(a) * bitcast<f32>(b)) & MAGNITUDE;
        let has_product = ((a & MAGNITUDE) != 0u) & ((b & MAGNITUDE) != 0u);
        // The device may have made a zero of a subnormal sum.
        undecided = undecided | (((result & MAGNITUDE) == 0u) & has_product & (product < LEAST_PRODUCT));
        undecided = undecided | is_near_zero(a) | is_near_zero(b) | is_near_zero(c) | is_near_zero(result);
    }
    return result;
}
