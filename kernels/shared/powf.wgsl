// a^b for a >= 0; 1 for b = 0; otherwise NaN if either is NaN.
fn scalar_powf(a: f32, b: f32) -> f32 {
    return select(scalar_exp(b * scalar_ln(a)), 1.0, b == 0.0);
}
