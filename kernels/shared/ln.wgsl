// ln(1 + f) - f for sqrt(1/2) <= 1 + f <= sqrt(2). Twin of src/scalar/exp_ln.rs, with the same coefficients.
fn scalar_ln_tail(f: f32) -> f32 {
    let square = f * f;
    var p = -0.07646038;
    p = p * f + 0.12779088;
    p = p * f - 0.13164198;
    p = p * f + 0.141997;
    p = p * f - 0.16622764;
    p = p * f + 0.20001292;
    p = p * f - 0.25000837;
    p = p * f + 0.3333333;
    return p * (square * f) - 0.5 * square;
}

// Natural logarithm, accurate near 1, where built-in ones lose half of their digits.
// x = m 2^e with sqrt(1/2) <= m < sqrt(2), as in src/scalar/exp_ln.rs.
fn scalar_ln(x: f32) -> f32 {
    let subnormal = x < 1.1754944e-38;
    let bits = bitcast<u32>(select(x, x * 8388608.0, subnormal));
    let above = bitcast<i32>(bits - 0x3f3504f3u) >> 23u;
    let m = bitcast<f32>(bits - (bitcast<u32>(above) << 23u));
    let e = f32(above) - select(0.0, 23.0, subnormal);
    let f = m - 1.0;
    let tail = scalar_ln_tail(f) + e * -2.9088971e-5;
    let value = e * 0.69317627 + (f + tail);
    // Outside the domain, from bits that are not known before the shader runs: -inf at 0, NaN below, x for +inf and
    // NaN.
    let raw = bitcast<u32>(x);
    let edge = bitcast<f32>(select(raw | 0x7fc00000u, raw | 0xff800000u, (raw & 0x7fffffffu) == 0u));
    let finite = select(edge, value, x > 0.0);
    return select(finite, x, (raw & 0x7f800000u) == 0x7f800000u && raw != 0xff800000u);
}
