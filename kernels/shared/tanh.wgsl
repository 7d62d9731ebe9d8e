// Hyperbolic tangent with full relative precision near 0 and no overflow: t / (t + 2) with t = exp(2|x|) - 1;
// NaN for NaN: drivers may take the bound on |x| for a minimum, which drops NaN.
fn scalar_tanh(x: f32) -> f32 {
    let a = abs(x);
    let t = scalar_exp_m1(select(2.0 * a, 20.0, a > 10.0));
    let value = t / (t + 2.0);
    return select(select(value, -value, x < 0.0), x, scalar_is_nan(x));
}
