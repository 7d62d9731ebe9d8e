// ln(1 + exp(x)) = max(x, 0) + ln(1 + exp(-|x|)); NaN for NaN, which some drivers' exp turns into infinity.
fn scalar_softplus(x: f32) -> f32 {
    return select(select(0.0, x, x > 0.0) + scalar_ln_1p(exp(-abs(x))), x, scalar_is_nan(x));
}
