// The larger of two; the first on a tie; NaN if either is NaN (the built-in max drops NaN).
fn scalar_max(a: f32, b: f32) -> f32 {
    return select(select(a, b, b > a || scalar_is_nan(b)), a, scalar_is_nan(a));
}
