// exp(x) - 1 without cancellation near 0. Twin of src/scalar/exp_ln.rs, with the same coefficients.
fn scalar_exp_m1(x: f32) -> f32 {
    let near = clamp(x, -0.35, 0.35);
    var p = 0.00019845957;
    p = p * near + 0.0013941653;
    p = p * near + 0.0083333915;
    p = p * near + 0.041666348;
    p = p * near + 0.16666666;
    p = p * near + 0.5;
    return select(scalar_exp(x) - 1.0, near + near * near * p, abs(x) < 0.35);
}
