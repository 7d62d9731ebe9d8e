// a^b for a >= 0; 1 for b = 0; otherwise NaN if either is NaN, which some drivers' exp turns into infinity.
fn scalar_powf(a: f32, b: f32) -> f32 {
    let product = b * scalar_ln(a);
    let is_nan = (bitcast<u32>(product) & 0x7fffffffu) > 0x7f800000u;
    let value = select(exp(product), product, is_nan);
    return select(value, 1.0, b == 0.0);
}
