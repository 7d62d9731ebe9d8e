// Rubber: Kirchhoff stress mu F F^T + (lambda ln J - mu) I.

struct Parameters {
    /// Young's modulus E [Pa], log10, 1e3 to 1e7
    young: f32,
    /// Poisson's ratio ν [-], between -0.45 and 0.45, 0 to 0.45, usually 0.30 +- 0.11
    poisson: f32,
}

fn stress(point: Point, p: Parameters) -> mat3x3<f32> {
    let m = lame(p.young, p.poisson);
    let f = point.f;
    return (f * transpose(f)) * m.x + identity() * (m.y * log(det(f)) - m.x);
}

// P-wave speed
fn wave_speed(p: Parameters, density: f32) -> f32 {
    let m = lame(p.young, p.poisson);
    return sqrt((m.y + 2.0 * m.x) / density);
}
