// Whether x is NaN. Tested on the bits: drivers may assume that x == x.
fn scalar_is_nan(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7fffffffu) > 0x7f800000u;
}
