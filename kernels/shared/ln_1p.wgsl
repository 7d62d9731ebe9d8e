// ln(1 + x) = ln u + (x - (u - 1)) / u with u the rounded 1 + x: the second term is what the rounding lost.
// Below 1e-3 a series, which does not rely on how the device rounds u.
fn scalar_ln_1p(x: f32) -> f32 {
    let u = 1.0 + x;
    let value = scalar_ln(u);
    let finite = u > 0.0 && u < 3.4028235e38;
    let lost = (x - (u - 1.0)) / select(1.0, u, finite);
    let series = x * (1.0 - x * (0.5 - x * (0.33333333 - 0.25 * x)));
    return select(select(value, value + lost, finite), series, abs(x) < 1e-3);
}
