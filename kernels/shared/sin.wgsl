// Sine of an angle in radians; the built-in function far from 0; NaN for infinities and NaN.
fn scalar_sin(x: f32) -> f32 {
    let raw = bitcast<u32>(x);
    let finite = (raw & 0x7f800000u) != 0x7f800000u;
    let near = abs(x) <= 8192.0;
    let value = select(sin(x), scalar_quarter_turned(select(0.0, x, near), 0.0), near);
    return select(bitcast<f32>(raw | 0x7fc00000u), value, finite);
}
