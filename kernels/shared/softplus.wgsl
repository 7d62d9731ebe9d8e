// ln(1 + exp(x)) = max(x, 0) + ln(1 + exp(-|x|)).
fn scalar_softplus(x: f32) -> f32 {
    return select(0.0, x, x > 0.0) + scalar_ln_1p(exp(-abs(x)));
}
