// exp(x), but NaN for NaN, which some drivers turn into infinity.
fn exp_or_nan(x: f32) -> f32 {
    let is_nan = (bitcast<u32>(x) & 0x7fffffffu) > 0x7f800000u;
    return select(exp(x), x, is_nan);
}
