// a^b for a >= 0; 1 for b = 0.
fn scalar_powf(a: f32, b: f32) -> f32 {
    let value = exp(b * scalar_ln(a));
    return select(value, 1.0, b == 0.0);
}
