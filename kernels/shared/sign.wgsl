// -1, 0 or 1; a zero keeps its sign and NaN stays NaN.
fn scalar_sign(x: f32) -> f32 {
    return select(select(x, -1.0, x < 0.0), 1.0, x > 0.0);
}
