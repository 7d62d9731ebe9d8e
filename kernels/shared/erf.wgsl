// The error function, and NaN for NaN: drivers may take the bound on |x| for a minimum, which drops NaN.
// Twin of src/scalar/erf.rs, with the same coefficients.
fn scalar_erf(x: f32) -> f32 {
    let square = x * x;
    var near = -0.0005959526;
    near = near * square + 0.0049873455;
    near = near * square - 0.026762964;
    near = near * square + 0.11281731;
    near = near * square - 0.3761249;
    near = near * square + 0.12837915;
    near = near * x + x;
    let t = select(abs(x), 4.0, abs(x) > 4.0);
    var p = 0.000011230011;
    p = p * t - 0.00032279402;
    p = p * t + 0.0036424296;
    p = p * t - 0.02376202;
    p = p * t + 0.106236845;
    p = p * t + 0.6351513;
    p = p * t + 0.12864849;
    let far = 1.0 - scalar_exp(-(p * t + t));
    let value = select(select(far, -far, x < 0.0), near, abs(x) < 0.92);
    return select(value, x, scalar_is_nan(x));
}
