// ln(1 + x) without cancellation near 0: there the series in x itself, so that nothing depends on how 1 + x is rounded.
// (Adding back what the rounding lost, as the CPU does, fails where a driver takes (1 + x) - 1 for x.)
fn scalar_ln_1p(x: f32) -> f32 {
    let near = clamp(x, -0.29, 0.41);
    return select(scalar_ln(1.0 + x), near + scalar_ln_tail(near), x > -0.29 && x < 0.41);
}
