// exp(x), and NaN for NaN, which some drivers' exp turns into infinity.
fn scalar_exp(x: f32) -> f32 {
    return select(exp(x), x, scalar_is_nan(x));
}
