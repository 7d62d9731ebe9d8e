// 1 / (1 + exp(-x)), as exp(x) / (1 + exp(x)) below 0.
fn scalar_logistic(x: f32) -> f32 {
    let e = scalar_exp(-abs(x));
    return select(e, 1.0, x >= 0.0) / (1.0 + e);
}
