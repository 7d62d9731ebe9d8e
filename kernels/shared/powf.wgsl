// a^b; 1 for b = 0; NaN for a < 0 unless b is whole; otherwise NaN if either is NaN.
fn scalar_powf(a: f32, b: f32) -> f32 {
    let turned = a < 0.0 && floor(b) == b;
    let size = scalar_exp(b * scalar_ln(select(a, -a, turned)));
    let odd = turned && floor(0.5 * b) != 0.5 * b;
    return select(select(size, -size, odd), 1.0, b == 0.0);
}
