// The alpha test where the scene has no table: the filter's.

fn alpha_decision(primitive: u32, u: u32, v: u32) -> u32 {
    return OF_FILTER;
}
